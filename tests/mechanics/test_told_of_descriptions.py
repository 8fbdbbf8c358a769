"""Properties of described scene classes, and refused descriptions: every entry by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.mechanics.descriptions import GROUND, rod, turning

from eomcheck.descriptions.build import mechanism, mechanism_source
from eomcheck.descriptions.doubtful_numbers import inertia_warning
from eomcheck.descriptions.elements import (
    Constraint,
    Joint,
    Link,
    coupling,
    distance,
    drive,
    hinge,
    knife_edge,
    on_quadric,
    pin,
    rolling_ball,
    rolling_circle,
    weld,
)
from eomcheck.descriptions.mechanism_class import Mechanism
from eomcheck.descriptions.random_mechanisms import poses
from eomcheck.descriptions.random_trees import RandomDescription
from eomcheck.errors import InputError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.mechanics.parameters import with_parameters

# ---- In the plane or in space --------------------------------------------------------------------

FLAT = Link("b", 1.0, (0.5, 0.1, 0.0), (0.7, 0.8, 0.9))
A_PIN = pin("p", "b", "ground", (0.3, 0.0, 0.0), (0.1, 0.0, 0.0))


def in_plane(link: Link = FLAT, constraint: Constraint | None = None, **more: Any) -> bool:
    """Return whether two links on hinges about z are planar, the second one modified."""
    second = Joint("β", **({"kind": "revolute", "parent": "a", "child": "b"} | more))
    given = [GROUND, FLAT._replace(name="a"), link], [turning("α", "ground", "a"), second]
    made = mechanism_source("Flat", *given, [] if constraint is None else [constraint])
    gravity = dict(made.defaults)["gravity"]
    assert len(gravity) == (2 if made.topology.planar else 3)
    return made.topology.planar


@pytest.mark.parametrize(
    ("change", "flat"),
    [
        ({}, True),
        ({"axis": (0.0, 0.0, -1.0)}, True),
        ({"kind": "prismatic", "axis": (0.0, -1.0, 0.0)}, True),
        ({"kind": "planar"}, True),
        ({"origin": (0.4, 0.2, 0.0)}, True),
        ({"constraint": A_PIN}, True),
        ({"axis": (0.0, 1.0, 0.0)}, False),
        ({"kind": "prismatic", "axis": (0.0, 0.0, 1.0)}, False),
        ({"kind": "spherical"}, False),
        ({"origin": (0.0, 0.0, 0.1)}, False),
        ({"orientation": (1.0, 0.2, 0.0, 0.0)}, False),
        ({"link": FLAT._replace(center=(0.5, 0.1, -0.2))}, False),
        ({"constraint": A_PIN._replace(points=(A_PIN.points[0], ("a", (0.0, 0.0, 0.1))))}, False),
        ({"constraint": A_PIN._replace(points=(("b", (0.0, 0.0, 0.1)), A_PIN.points[1]))}, False),
    ],
)
def test_a_mechanism_is_planar_as_long_as_nothing_of_it_leaves_the_plane(change, flat):
    assert in_plane(**change) is flat


# ---- What it says of itself ----------------------------------------------------------------------


def kind(joints: list[Joint], constraints=(), **more: Any) -> type[Mechanism]:
    names = [one.child for one in joints]
    return mechanism("Told", [GROUND, *map(rod, names)], joints, constraints, **more)


SLIDE = Joint("s", "prismatic", "ground", "a", axis=(1.0, 0.0, 0.0))
FREE = Joint("f", "floating", "a", "b")
TURNS = [turning("α", "ground", "a"), turning("β", "a", "b", (1.0, 0.0, 0.0))]
PI = float(np.pi)


@pytest.mark.parametrize(
    ("made", "ranges"),
    [
        (kind([SLIDE, FREE]), [(-1.0, 1.0)] * 4 + [(-PI, PI), (-1.2, 1.2), (-PI, PI)]),
        (kind([SLIDE, FREE._replace(kind="planar")]), [(-1.0, 1.0)] * 3 + [(-PI, PI)]),
        (kind([FREE._replace(kind="spherical", parent="ground")]),
         [(-PI, PI), (-1.2, 1.2), (-PI, PI)]),
        (kind([TURNS[0], turning("γ", "a", "b", mimics=("α", 2.0, 0.1))]), [(-PI, PI)]),
        (kind([TURNS[0], SLIDE._replace(parent="a", child="b", mimics=("α", 2.0, 0.1))]),
         [(-PI, PI)]),
        (kind([SLIDE, TURNS[1]], dependent=["β"]), [(-PI, PI), (-1.0, 1.0)]),
        (kind(TURNS, [drive("d", "α", 0.4)]), [(-PI, PI)] * 2),
        (kind(TURNS, [distance("d", "b", "ground", 1.0, (1.0, 0.0, 0.0))],
              pose={"β": 2.0, "α": -0.5}), [(-0.8, -0.2), (1.7, 2.3)]),
    ],
)  # fmt: skip
def test_a_coordinate_is_drawn_from_what_its_joint_and_its_loops_allow(made, ranges):
    found = [(one.low, one.high) for one in made().coordinate_ranges()]
    np.testing.assert_allclose(found, ranges, rtol=1e-15)


SPRUNG = TURNS[1]._replace(stiffness=2.0)
THIRD = turning("γ", "b", "c")


@pytest.mark.parametrize(
    ("made", "turned"),
    [
        (kind([*TURNS, THIRD]), [1, 1, 1]),
        (kind([SLIDE, *[TURNS[1], THIRD]]), [0, 1, 1]),
        (kind([TURNS[0], SPRUNG, THIRD]), [1, 0, 1]),
        (kind([TURNS[0], TURNS[1], THIRD._replace(mimics=("β", 0.5, 0.1))]), [1, 0]),
        (kind([*TURNS, THIRD], [coupling("c", "γ", "α", 0.5)]), [0, 1, 0]),
        (kind([*TURNS, THIRD], [drive("d", "β", 0.4)]), [1, 0, 1]),
        (kind([SLIDE]), None),
    ],
)
def test_full_turns_are_those_of_hinges_that_nothing_else_counts(made, turned):
    scene = made()
    q, v = np.linspace(0.3, 0.9, scene.n), np.linspace(-1.0, 1.0, scene.n)
    found = [*scene.symmetries(q, v)]
    assert [one.name for one in found] == ["full turns"] * (turned is not None)
    for one in found:
        assert one.q == pytest.approx(q + 2.0 * PI * np.array(turned))
        assert (one.v == v).all() and (one.image == np.eye(scene.n)).all()


def test_rows_are_named_by_their_constraints_and_holonomic_ones_come_first():
    joints = [FREE._replace(parent="ground", child="a"), turning("α", "a", "b", (1.0, 0.0, 0.0))]
    rows = [knife_edge("edge", "a", (0.0, 1.0, 0.0)), pin("pin", "b", "ground"),
            drive("clock", "α", 0.2)]  # fmt: skip
    scene = kind(joints, rows)()
    assert scene.constraint_names == ("pin 1", "pin 2", "pin 3", "clock", "edge")
    assert scene.holonomic == slice(0, 4)
    assert scene.depends_on_time and not scene.conserves_energy
    assert scene.why_not_conserved == "what a clock drives does work"
    assert scene.angle_coordinates == slice(0, 0)
    plain = kind(TURNS)()
    assert plain.angle_coordinates == slice(0, None)
    assert plain.conserves_energy and not plain.depends_on_time
    structures: Any = type(plain).structures()
    assert [one.gravity is None for one in structures] == [False, True]
    assert len([*kind(TURNS, gravity=None).structures()]) == 1


@pytest.mark.parametrize(
    ("constraint", "fixed"),
    [
        (distance("d", "b", "ground", 1.0, (1.0, 0.0, 0.0)), True),
        (coupling("c", "α", "β", 0.5), False),
        (drive("c", "α", 0.5), False),
        (knife_edge("e", "b", (0.0, 1.0, 0.0)), False),
    ],
)
def test_geometry_keeps_its_numbers_where_others_might_not_close(constraint, fixed):
    made = kind(TURNS, [constraint])
    drawn = made.ranges()
    assert ("offset" not in drawn) == fixed
    assert {"mass", "center", "moments"} <= drawn.keys()
    assert drawn["gravity"].optional and drawn["gravity"].shape in ((2,), (3,))
    assert not drawn["mass"].optional and drawn["mass"].shape == (2,)


# ---- Poses from the words alone ------------------------------------------------------------------


def test_links_are_where_the_scene_has_them_behind_every_kind_of_joint():
    tilted, oblique = (0.8, 0.3, -0.4, 0.2), (0.6, -1.0, 1.5)
    joints = [
        Joint("r", "revolute", "ground", "l1", (0.1, 0.2, 0.3), tilted, oblique),
        Joint("p", "prismatic", "l1", "l2", (0.3, -0.2, 0.1), tilted, oblique),
        Joint("f", "planar", "l2", "l3", (-0.3, 0.2, 0.4), tilted, oblique),
        Joint("s", "spherical", "l3", "l4", (0.5, 0.6, -0.1), tilted),
        Joint("x", "fixed", "l4", "l5", (0.2, 0.3, 0.5), tilted),
        Joint("o", "floating", "l1", "l6", (0.2, -0.7, 0.1), tilted),
        Joint(
            "m", "revolute", "l6", "l7", (0.4, 0.1, 0.2), tilted, oblique, mimics=("p", -2.0, 0.3)
        ),
        Joint(
            "n", "prismatic", "l7", "l8", (0.1, 0.4, 0.2), tilted, oblique, mimics=("m", 0.5, -0.4)
        ),
    ]
    links = [Link("ground"), *(rod(f"l{i}", (0.3, -0.1 * i, 0.2)) for i in range(1, 9))]
    pins = (pin(f"p {one.name}", one.name, "ground", one.center) for one in links[1:])
    given = RandomDescription(tuple(links), tuple(joints), tuple(pins))
    q = np.linspace(-1.1, 0.9, len(given.coordinates))
    there = poses(given._replace(pose=tuple(zip(given.coordinates, q.tolist(), strict=True))))
    scene = given.source("Posed").scene_class()()
    at = Evaluation(scene, q, np.zeros(scene.n))
    centers = at.call(scene.position_residual, at.parameters, at.prepared, at.q).reshape(8, 3)
    for link, center in zip(links[1:], centers, strict=True):
        np.testing.assert_allclose(there[link.name].point(link.center), center, atol=1e-14)
    for name in ("l3", "l5"):
        back = there[name].point(there[name].local_point(np.array([0.1, -2.0, 0.3])))
        np.testing.assert_allclose(back, [0.1, -2.0, 0.3], atol=1e-14)


# ---- What is refused -----------------------------------------------------------------------------

BALL = rolling_ball("w", "b", "ground", 0.3)[0]
B = TURNS[1]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"constraints": [A_PIN, A_PIN]}, "two constraints have the name 'p'"),
        ({"constraints": [A_PIN, A_PIN._replace(name="o"), A_PIN]}, "have the name 'p'"),
        ({"constraints": [A_PIN._replace(kind="glue")]}, "'p' has the kind 'glue', expected"),
        ({"constraints": [A_PIN._replace(points=(("b", (0, 0, 0)), ("a", (0, 0))))]},
         "a point of 'a' = .0, 0., expected three numbers"),
        ({"constraints": [distance("d", "b", "ground", 0.0)]}, "length = 0.0 m, expected a pos"),
        ({"constraints": [distance("d", "b", "ground", -1.0)]}, "length = -1.0 m, expected a p"),
        ({"constraints": [distance("d", "b", "b", 1.0)]}, "'d' is between 'b' and itself"),
        ({"constraints": [coupling("c", "β", "β", 1.0)]}, "'c' is between 'β' and itself"),
        ({"constraints": [coupling("c", "β", "α", np.inf)]}, "numbers = .inf, 0.0., expected fin"),
        ({"constraints": [drive("d", "β")._replace(numbers=(1.0, 2.0))]}, "expected three numbers"),
        ({"constraints": [coupling("c", "β", "α", 1.0)._replace(numbers=1.0)]}, "expected two num"),
        ({"constraints": [BALL._replace(numbers=0.0)]}, "radius = 0.0 m, expected a pos"),
        ({"constraints": [on_quadric("q", "b", "a", (1, 0, 0), True)]}, "three bends, three slo"),
        ({"constraints": [knife_edge("e", "b", (0, 0, 0))]}, "'e', on 'b', has the direction .0, "),
        ({"constraints": [knife_edge("e", "b", (1e-120, 0, 0))]}, "between 1e-100 and 1e.100"),
        ({"constraints": [knife_edge("e", "b", (1e120, 0, 0))]}, "between 1e-100 and 1e.100"),
        ({"constraints": [knife_edge("e", "b", (1, 0, 0))._replace(name="")]}, "has the name ''"),
        ({"constraints": [hinge("h", "b", "ground", axis=(0, 0, 1))]}, "in the plane a hinge is"),
        ({"constraints": [SLIDE]}, "is no constraint: expected a Constraint"),
        ({"links": [GROUND, FLAT._replace(name="a"), FLAT._replace(mass=True)]},
         "link 'b': mass = True, expected a number"),
        ({"links": [GROUND, FLAT._replace(name="a"), FLAT._replace(products=(0, 0, np.nan))]},
         "link 'b': products = .0, 0, nan., expected finite ones"),
        ({"links": [GROUND, FLAT._replace(name="a"), FLAT._replace(moments=(1, 1))]},
         "link 'b': moments = .1, 1., expected three numbers"),
        ({"links": [GROUND, FLAT._replace(name="a", moments=(1, 1, -0.25)), FLAT]},
         "behind joint 'α' has the principal moment of inertia -0.25 kg m², expected none below 0"),
        ({"joints": [B._replace(orientation=(1.0, 0.0, 0.0))]}, "orientation .1.0, 0.0, 0.0., exp"),
        ({"joints": [B._replace(origin=(1.0, np.inf, 0.0))]}, "'β': origin = .1.0, inf, 0.0., exp"),
        ({"joints": [B._replace(kind="prismatic", axis=(0, 0, 0))]}, "'β' has the axis .0, 0, 0"),
        ({"joints": [B._replace(damping=-0.5)]}, "'β': damping = -0.5, expected a number"),
        ({"joints": [B._replace(stiffness=-1.0)]}, "'β': stiffness = -1, expected a number"),
        ({"joints": [B._replace(armature=-1.0)]}, "'β': armature = -1, expected a number"),
        ({"joints": [B._replace(stiffness=1.0, rest_position=np.nan)]}, "position = nan, expected"),
        ({"joints": [B._replace(mimics=("α", 1.0))]}, "expected a joint, a ratio and a shift"),
        ({"joints": [B._replace(mimics=("α", 1.0, np.nan))]}, "mimics = .1.0, nan., expected fi"),
        ({"joints": [B._replace(kind="planar", mimics=("α", 1.0, 0.0))]}, "joints with one coord"),
        ({"gravity": (0.0, -9.81)}, "gravity = .0.0, -9.81., expected three numbers"),
        ({"pose": [0.0, 1.0]}, "pose = .0.0, 1.0., expected coordinates by name"),
        ({"pose": {"β": np.nan}}, "pose: β = nan, expected a finite number"),
    ],
)  # fmt: skip
def test_words_that_mean_nothing_are_refused_and_named(change, said):
    given: dict[str, Any] = {"links": [GROUND, FLAT._replace(name="a"), FLAT], "joints": [B]}
    given |= change
    given["joints"] = [TURNS[0], *given["joints"]]
    with pytest.raises(InputError, match=said):
        mechanism("Wrong", **given)


def test_what_is_just_allowed_is_no_mistake():
    free = Joint("β", "planar", "a", "b", axis=(0, 0, 1e-100))
    made = mechanism(
        "Sound",
        [GROUND, FLAT._replace(name="a"), FLAT._replace(moments=(0.5, 0.5, 1.0))],
        [TURNS[0]._replace(damping=0, stiffness=0, armature=0), free],
        rolling_circle("w", "b", "ground", 1e-9, (1e100, 0, 0)),
    )
    assert made().r == 2 and made().conserves_energy


def test_a_tree_with_many_roots_or_a_long_circle_is_told_in_part():
    links = [Link(f"l{i}", 1.0) for i in range(7)]
    names, few = "links are no joint's child ('l0', 'l1', 'l2'", "), expected one root"
    for count, said in ((3, f"3 {names}{few}"), (4, f"4 {names}, ...{few}")):
        with pytest.raises(InputError) as refused:
            mechanism("Wrong", links[:count], [])
        assert str(refused.value).startswith(said)
    for count, said in ((4, "'l0' <- 'l1' <- 'l2' <- 'l3' <- 'l0'"),
                        (5, "'l0' <- 'l1' <- 'l2' <- 'l3' <- ...")):  # fmt: skip
        ring = [turning(f"j{i}", f"l{(i + 1) % count}", f"l{i}") for i in range(count)]
        with pytest.raises(InputError) as refused:
            mechanism("Wrong", links[:count], ring)
        assert str(refused.value).endswith(said)


@pytest.mark.parametrize(
    ("moments", "products", "doubted"),
    [
        ((0.2, 0.3, 0.5), (0, 0, 0), False),
        ((0.2, 0.3, 0.5 * (1 + 1e-10)), (0, 0, 0), False),
        ((0.2, 0.3, 0.51), (0, 0, 0), True),
        ((0.51, 0.3, 0.2), (0, 0, 0), True),
        ((0.4, 0.4, 0.5), (0.3, 0, 0), True),
        ((-0.01, 0.3, 0.3), (0, 0, 0), True),
    ],
)
def test_every_link_whose_moments_no_body_has_is_named(moments, products, doubted):
    odd = [Link(name, 1.0, (0, 0, 0), moments, products) for name in "ab"]
    said = inertia_warning([rod("c"), odd[0], rod("d"), odd[1]])
    expected = "No body has the moments of inertia of 'a', 'b': one exceeds the sum of the others."
    assert said == (expected if doubted else "")


def test_a_thin_rod_is_a_body_whichever_way_it_stands():
    for along in np.random.default_rng(0).normal(size=(20, 3)):
        inertia = 0.3 * (along @ along * np.eye(3) - np.outer(along, along))
        products = inertia[[0, 0, 1], [1, 2, 2]].tolist()
        assert (
            inertia_warning([Link("rod", 1.0, (0, 0, 0), (*np.diagonal(inertia),), (*products,))])
            == ""
        )


def test_numbers_of_a_parameter_are_as_many_as_it_has_or_one_for_all():
    made = kind(TURNS)
    scene = with_parameters(made(), {"mass": [3.0, 4.0], "center": [0.5]})
    assert scene.mass.tolist() == [3.0, 4.0]
    assert scene.center.tolist() == [[0.5] * 2] * 2
    given = with_parameters(made(), {"center": [1.0, 2.0, 3.0, 4.0]})
    assert given.center.tolist() == [[1.0, 2.0], [3.0, 4.0]]
    for name, numbers, said in (
        ("mass", [1.0] * 3, "3 numbers, expected 2, or one for all of them"),
        ("center", [1.0] * 6, "6 numbers, expected 4, or one for all of them"),
        ("mass", [1.0, -2.0], r"mass\[1\] = -2.0, expected a number that is not negative"),
        ("mass", [-1.0], r"mass\[0\] = -1.0, expected a number that is not negative"),
    ):
        with pytest.raises(InputError, match=said):
            with_parameters(made(), {name: numbers})


def test_a_weld_in_the_plane_has_one_direction_and_in_space_three():
    flat = [Joint("β", "planar", "ground", "b")]
    assert mechanism("Flat", [GROUND, FLAT], flat, [weld("w", "b", "ground")])().r == 3
    solid = [Joint("β", "floating", "ground", "b")]
    assert mechanism("Solid", [GROUND, rod("b")], solid, [weld("w", "b", "ground")])().r == 6
