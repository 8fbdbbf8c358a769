"""Elements, parameters, trees and pictures of descriptions, with numbers computed by hand."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from tests.mechanics.descriptions import GROUND, FourBar, rod, turning
from tests.scenes.sketches import written

from eomcheck.descriptions import vector_algebra
from eomcheck.descriptions.build import mechanism
from eomcheck.descriptions.elements import (
    Constraint,
    Joint,
    Link,
    coupling,
    distance,
    drive,
    hinge,
    knife_edge,
    on_line,
    on_plane,
    on_quadric,
    perpendicular,
    pin,
    rolling_ball,
    rolling_circle,
    rolling_disk,
    weld,
)
from eomcheck.descriptions.joint_tree import RigidBody, check_positive
from eomcheck.descriptions.vector_algebra import (
    multiply_quaternions,
    roll_pitch_yaw,
    rotation_matrix,
    z_to_axis,
)
from eomcheck.errors import InputError
from eomcheck.mechanics.records import ANY_ANGLE, ANYWHERE, planar_tree
from eomcheck.mechanics.scene import GeneratorChoices
from eomcheck.mechanics.sketch import JointMark
from eomcheck.scenes import ChainPendulum

# ---- Words ---------------------------------------------------------------------------------------

HERE, THERE = (1, 2, 3), (4, 5, 6)
POINTS = ("l", HERE), ("o", THERE)
QUARTER = (1, 0, 0, 1)
"""A quarter turn about z, of length √2."""
X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
BACK_X, BACK_Z = (-1.0, 0.0, 0.0), (0.0, 0.0, -1.0)


def of(link: str, *directions: Any) -> tuple[Any, ...]:
    return tuple((link, one) for one in directions)


@pytest.mark.parametrize(
    ("made", "expected"),
    [
        (pin("n", "l", "o", HERE, THERE), [("pin", "n", POINTS)]),
        (weld("n", "l", "o", HERE, THERE, QUARTER), [("weld", "n", POINTS, of("l", Y, BACK_X, Z))]),
        (hinge("n", "l", "o", HERE, THERE, (0, 2, 0), (0, 0, 3)),
         [("hinge", "n", POINTS, (*of("l", X, BACK_Z), ("o", (0, 0, 3))))]),
        (distance("n", "l", "o", 2.0, HERE, THERE), [("distance", "n", POINTS, (), (), 2.0)]),
        (on_plane("n", "l", "o", Z, HERE, THERE), [("on-plane", "n", POINTS, of("o", Z))]),
        (on_quadric("n", "l", "o", (1, 2, 3), 4, (5, 6, 7), HERE, THERE, QUARTER),
         [("on-quadric", "n", POINTS, of("o", Y, BACK_X, Z), (), (1, 2, 3, 5, 6, 7, 4))]),
        (perpendicular("n", "l", HERE, "o", THERE), [("square", "n", (), POINTS)]),
        (coupling("n", "i", "j", 2.0), [("coupling", "n", (), (), ("i", "j"), (2.0, 0.0))]),
        (coupling("n", "i", "j", 2.0, 3.0), [("coupling", "n", (), (), ("i", "j"), (2.0, 3.0))]),
        (drive("n", "j", 1.0, 2.0, 3.0), [("drive", "n", (), (), ("j",), (1.0, 2.0, 3.0))]),
        (drive("n", "j"), [("drive", "n", (), (), ("j",), (0.0, 0.0, 0.0))]),
        (knife_edge("n", "l", THERE, HERE), [("edge", "n", POINTS[:1], of("l", THERE))]),
        (on_line("n", "l", "o", (2, 0, 0), HERE, THERE),
         [("on-plane", "n, x", POINTS, of("o", BACK_Z)),
          ("on-plane", "n, y", POINTS, of("o", Y))]),
        (rolling_ball("n", "l", "o", 2.0, HERE, THERE, (2, 0, 0)),
         [("touching", "n, touching", POINTS, of("o", X, X), (), 2.0),
          ("rolling", "n, along x", POINTS, of("o", BACK_Z, X), (), 2.0),
          ("rolling", "n, along y", POINTS, of("o", Y, X), (), 2.0)]),
        (rolling_disk("n", "l", "o", 2.0, HERE, THERE, (0, 3, 0), (2, 0, 0)),
         [("touching", "n, touching", POINTS, (("o", X), ("l", Y), ("o", X)), (), 2.0),
          ("rolling", "n, along x", POINTS, (("o", BACK_Z), ("l", Y), ("o", X)), (), 2.0),
          ("rolling", "n, along y", POINTS, (("o", Y), ("l", Y), ("o", X)), (), 2.0)]),
        (rolling_circle("n", "l", "o", 2.0, (3, 4, 0), HERE, THERE),
         [("touching", "n, touching", POINTS, of("o", (-0.8, 0.6, 0), (-0.8, 0.6, 0)), (), 2.0),
          ("rolling", "n, along x", POINTS, of("o", (0.6, 0.8, 0), (-0.8, 0.6, 0)), (), 2.0)]),
    ],
)  # fmt: skip
def test_a_constraint_has_these_points_directions_and_numbers(made, expected):
    made = [made] if isinstance(made, Constraint) else list(made)
    assert len(made) == len(expected)
    for one, told in zip(made, expected, strict=True):
        wanted = Constraint(*told)
        assert one._replace(directions=()) == wanted._replace(directions=())
        assert [link for link, _ in one.directions] == [link for link, _ in wanted.directions]
        for (_, x), (_, y) in zip(one.directions, wanted.directions, strict=True):
            np.testing.assert_allclose(x, y, atol=1e-15)


def test_turns_are_these_matrices():
    quarter = rotation_matrix(QUARTER)
    np.testing.assert_allclose(quarter, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)
    a, b = (1.0, 2.0, 3.0, 4.0), (0.5, -1.0, 0.25, 2.0)
    both = rotation_matrix(a) @ rotation_matrix(b)
    np.testing.assert_allclose(rotation_matrix(multiply_quaternions(a, b)), both, atol=1e-15)
    # First about x, then y, then z: a quarter each brings x to -z, y to y and z to x.
    turned = rotation_matrix(roll_pitch_yaw(np.pi / 2, np.pi / 2, np.pi / 2))
    np.testing.assert_allclose(turned, [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], atol=1e-15)
    for axis in ((1.0, 2.0, 2.0), (1.0, 2.0, -2.0), (0.0, 0.0, -5.0), (0.0, 0.0, 5.0)):
        length = np.hypot.reduce(axis)
        np.testing.assert_allclose(
            rotation_matrix(z_to_axis(axis))[:, 2], np.array(axis) / length, atol=1e-15
        )


# ---- Vectors of which parts are absent -----------------------------------------------------------


def full(a: Any) -> np.ndarray:
    return np.array([0.0 if x is None else x for x in a])


@pytest.mark.parametrize("gone", [(), (0,), (2,), (0, 2), (1, 2), (0, 1, 2)])
def test_absent_components_are_those_of_vectors_with_zeros(gone):
    random = np.random.default_rng(len(gone))
    a: Any = tuple(None if i in gone else float(x) for i, x in enumerate(random.normal(size=3)))
    b: Any = tuple(float(x) for x in random.normal(size=3))
    for x, y in ((a, b), (b, a), (a, a)):
        p, r = full(x), full(y)
        np.testing.assert_allclose(full(vector_algebra.add_vectors(x, y)), p + r)
        np.testing.assert_allclose(full(vector_algebra.subtract_vectors(x, y)), p - r)
        np.testing.assert_allclose(full(vector_algebra.cross(x, y)), np.cross(p, r), atol=1e-15)
        np.testing.assert_allclose(full([vector_algebra.dot(x, y)]), [p @ r])
        np.testing.assert_allclose(
            full(vector_algebra.centripetal(x, y)), np.cross(p, np.cross(p, r)), atol=1e-15
        )
    for axis in range(3):
        cos, sin = np.cos(0.4), np.sin(0.4)
        i, j = (axis + 1) % 3, (axis + 2) % 3
        R = np.eye(3)
        R[i, i], R[j, j], R[i, j], R[j, i] = cos, cos, -sin, sin
        np.testing.assert_allclose(full(vector_algebra.rotate(a, axis, cos, sin)), R @ full(a))
        np.testing.assert_allclose(
            full(vector_algebra.rotate_back(a, axis, cos, sin)), R.T @ full(a)
        )
        axes: Any = tuple(map(tuple, R.T.tolist()))
        np.testing.assert_allclose(full(vector_algebra.from_local(axes, a)), R @ full(a))
        np.testing.assert_allclose(full(vector_algebra.to_local(axes, a)), R.T @ full(a))
    out = np.full((2, 3), 7.0)
    vector_algebra.put_vector(out, (1, None), a)
    assert out[0].tolist() == [7.0] * 3
    assert [x if x != 7.0 else None for x in out[1]] == list(a)
    vector_algebra.put_vector(out, (None, 2), b, 2)
    assert out[:, 2].tolist() == [*b[:2]]


def test_literal_ones_and_what_is_absent_leave_no_operation():
    x = object()  # which neither adds nor multiplies
    assert vector_algebra.times(1, x) is x and vector_algebra.times(x, 1) is x
    assert vector_algebra.times(None, x) is None and vector_algebra.times(x, None) is None
    assert vector_algebra.plus(None, x) is x and vector_algebra.plus(x, None) is x
    assert vector_algebra.minus(x, None) is x and vector_algebra.negative(None) is None
    assert vector_algebra.total([None, x, None]) is x and vector_algebra.total([]) is None
    assert vector_algebra.plus(1, -1) is None and vector_algebra.minus(1, 1) is None
    assert vector_algebra.plus(1, 1) == 2 and vector_algebra.minus(None, 2.0) == -2.0
    assert vector_algebra.times(-1, 2.0) == -2.0 and vector_algebra.times(2.0, -1) == -2.0
    assert vector_algebra.times(3, 2.0) == 6.0 and vector_algebra.times(2.0, 3) == 6.0
    assert vector_algebra.as_vector([1.0, 2.0]) == (1.0, 2.0, None)
    assert vector_algebra.as_vector([1.0, 2.0, 3.0]) == (1.0, 2.0, 3.0)


# ---- Parameters ----------------------------------------------------------------------------------

FLAT = Link("b", 1.0, (0.5, 0.1, 0.0), (0.7, 0.8, 0.9))
EVERY = mechanism(
    "Every",
    [GROUND, FLAT._replace(name="a"), rod("b"), rod("c"), rod("d")],
    [
        turning("α", "ground", "a", orientation=QUARTER, damping=0.1, stiffness=2.0, armature=0.3),
        turning("β", "a", "b", axis=(1.0, 1.0, 0.0), mimics=("α", 2.0, 0.1)),
        Joint("f", "planar", "ground", "c"),
        turning("δ", "ground", "d"),
    ],
    [coupling("c", "α", "δ", 0.5), drive("d", "α"), *rolling_ball("r", "c", "ground", 0.5)[1:]],
)


def test_a_parameter_of_a_description_is_documented_and_drawn_as_follows():
    told = {name: one.documented for name, one in EVERY.declared.items()}
    assert told == {
        "orientation": "quaternions of seats that are turned, of any length, (2, 4), 1",
        "offset": "positions of seats, (4, 3), m",
        "damping": "of dampers at joints, (1,), N m s/rad or N s/m, >= 0, or None without",
        "relaxed": "where they rest, (1,), rad or m",
        "stiffness": "of springs at joints, (1,), N m/rad or N/m, >= 0",
        "armature": "inertia of rotors, (1,), kg m² or kg, >= 0",
        "ratio": "of joints that follow others, (1,), 1",
        "shift": "their position where the other's is 0, (1,), rad or m",
        "mass": "of bodies, (4,), kg, >= 0",
        "center": "centres of mass, (4, 3), m",
        "moments": "I, central, about the axes, (4, 3), kg m²",
        "products": "entries xy, xz, yz of I, central, (4, 3), kg m²",
        "couplings": "ratio and shift, (1, 2), 1, rad or m",
        "drives": "position, rate, acceleration, (1, 3), rad or m, /s, /s²",
        "points": "of closures, (1, 3), m",
        "directions": "of closures, of any length, (3, 3), 1",
        "lengths": "of rods, (1,), m, > 0",
        "gravity": "acceleration, (3,), m/s², or None without",
    }
    drawn = {name: (one.low, one.high) for name, one in EVERY.ranges().items()}
    assert drawn == {
        "orientation": (0.1, 1.0), "offset": (-1.0, 1.0), "damping": (0.0, 10.0),
        "relaxed": (-1.0, 1.0), "stiffness": (0.0, 100.0), "armature": (0.01, 1.0),
        "ratio": (0.2, 2.0), "shift": (-1.0, 1.0), "mass": (0.1, 10.0), "center": (-1.0, 1.0),
        "moments": (0.6, 1.0), "products": (-0.02, 0.02), "couplings": (0.2, 2.0),
        "drives": (-1.0, 1.0), "points": (-1.0, 1.0), "directions": (0.1, 1.0),
        "lengths": (0.5, 2.0), "gravity": (-20.0, 20.0),
    }  # fmt: skip
    assert {name for name, one in EVERY.ranges().items() if one.optional} == {"damping", "gravity"}
    assert (EVERY.__doc__ or "").startswith("Every, made of a description.\n\nArgs:\n    orientati")
    read = {name for name, one in EVERY.declared.items() if one.read}
    assert told.keys() - read == {"orientation", "moments", "products", "armature"}


def test_a_closed_mechanism_keeps_all_of_its_geometry():
    made = mechanism(
        "Closed",
        [GROUND, FLAT._replace(name="a"), rod("b")],
        [turning("α", "ground", "a", orientation=QUARTER), Joint("f", "floating", "ground", "b")],
        [distance("d", "b", "a", 1.0), coupling("c", "f_x", "α", 2.0),
         on_quadric("q", "b", "a", (1.0, 1.0, 1.0), 0.5)],
    )  # fmt: skip
    kept = {"orientation", "offset", "points", "directions", "lengths", "surfaces", "couplings"}
    assert made.declared.keys() - made.ranges().keys() == kept


# ---- Trees ---------------------------------------------------------------------------------------


def assert_tree(tree: Any, **expected: Any) -> None:
    for name, value in tree._asdict().items():
        if name not in expected:
            continue  # names, links and gravity have tests of their own
        if name in ("parent", "joint"):
            assert value == expected[name]
        else:
            np.testing.assert_allclose(value, expected[name], atol=1e-15, err_msg=name)


def test_a_tree_in_the_plane_has_these_numbers():
    slide = Joint("γ", "prismatic", "b", "c", (0.2, 0.3, 0.0), axis=(0.0, 1.0, 0.0))
    made = mechanism(
        "Flat",
        [GROUND, FLAT._replace(name="a"), FLAT._replace(mass=2.0), FLAT._replace(name="c")],
        [
            turning("α", "ground", "a", (1.0, 2.0, 0.0), axis=(0.0, 0.0, -1.0)),
            turning("β", "a", "b", axis=(0, 0, -1), mimics=("α", -0.5, 0.25), armature=0.4),
            slide._replace(mimics=("β", 2.0, 0.1)),
        ],
    )
    assert made.source.topology.planar
    assert_tree(
        made().tree(),
        parent=(-1, 0, 1),
        joint=("rz", "rz", "py"),
        rotation=[np.eye(3)] * 3,
        offset=[(1.0, 2.0, 0.0), (0.0, 0.0, 0.0), (0.2, 0.3, 0.0)],
        mass=[1.0, 2.0, 1.0],
        center=[(0.5, 0.1, 0.0)] * 3,
        inertia=[0.9 * np.eye(3)] * 3,
        # β = -α/2 + 1/4 and γ = 2 β + 1/10, the first two about -z.
        coordinates=[[-1.0], [0.5], [-1.0]],
        shift=[0.0, -0.25, 0.6],
        armature=[0.0, 0.4, 0.0],
    )


def test_a_tree_in_space_has_these_numbers():
    tilted = turning("β", "a", "b", (0.0, 0.0, 4.0), axis=(0.0, 3.0, 4.0), armature=0.5)
    links = [GROUND, Link("a", 3.0, (0.1, 0.2, 0.3), (0.7, 0.8, 0.9), (0.01, 0.02, -0.03)),
             Link("b", 2.0, (0.0, 0.0, 5.0), (1.0, 1.0, 1.0))]  # fmt: skip
    made = mechanism(
        "Solid",
        links,
        [turning("α", "ground", "a", axis=(-1.0, 0.0, 0.0), orientation=QUARTER), tilted],
    )
    assert_tree(
        made().tree(),
        parent=(-1, 0),
        joint=("rx", "rz"),
        rotation=[[[0, -1, 0], [1, 0, 0], [0, 0, 1]], [[1, 0, 0], [0, 0.8, 0.6], [0, -0.6, 0.8]]],
        offset=[(0, 0, 0), (0, 0, 4.0)],
        mass=[3.0, 2.0],
        center=[(0.1, 0.2, 0.3), (0.0, -3.0, 4.0)],
        inertia=[[[0.7, 0.01, 0.02], [0.01, 0.8, -0.03], [0.02, -0.03, 0.9]], np.eye(3)],
        coordinates=[[-1.0, 0.0], [0.0, 1.0]],
        shift=[0.0, 0.0],
        armature=[0.0, 0.5],
    )


def test_a_planar_tree_turns_each_moment_about_all_axes_and_adds_nothing():
    given = [[1.0, 2.0, 0.0]] * 2, [3.0, 4.0], [[0.1, 0.2, 0.0]] * 2, [5.0, 6.0], [[1.0, -1.0]] * 2
    tree = planar_tree((-1, 0), ("px", "rz"), *map(np.array, given))
    assert_tree(
        tree,
        parent=(-1, 0),
        joint=("px", "rz"),
        rotation=[np.eye(3)] * 2,
        offset=given[0],
        mass=given[1],
        center=given[2],
        inertia=[5.0 * np.eye(3), 6.0 * np.eye(3)],
        coordinates=given[4],
        shift=[0.0, 0.0],
        armature=[0.0, 0.0],
    )
    tree.shift[0] = 1.0
    assert tree.armature[0] == 0.0


# ---- Pictures ------------------------------------------------------------------------------------


def test_a_picture_in_the_plane_has_these_parts():
    slide = Joint("slide", "prismatic", "a", "b", (1.0, 0.5, 0.0), axis=(-1.0, 0.0, 0.0))
    made = mechanism(
        "Crank",
        [GROUND, FLAT._replace(name="a", center=(0.5, 0.0, 0.0)),
         FLAT._replace(center=(0.25, 0.0, 0.0)), FLAT._replace(name="c", center=(0.0, -0.5, 0.0)),
         FLAT._replace(name="d", center=(0.25, 0.0, 0.0))],
        [turning("left_turn", "ground", "a", (1.0, 0.0, 0.0)), slide, turning("wrist", "b", "c"),
         turning("right_turn", "a", "d", (0.5, 0.25, 0.0))],
        [distance("rod", "ground", "a", 1.0, (2.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
         drive("clock", "wrist", 0.1),
         pin("tip", "c", "ground", (0.5, 0.0, 0.0), (1.0, 2.0, 0.0))],
        gravity=(0.0, -10.0, 0.0),
    )  # fmt: skip
    # a stands upright on (1, 0); b has slid down from (0.5, 1); c stands on its head; d is on a.
    sketch = made().sketch(np.array([np.pi / 2, 0.25, np.pi, 0.0]))
    assert [written(part) for part in sketch.parts] == [
        "Arrow: name x axis, at [0.0, 0.0], along [0.15, 0.0], frame True",
        "Arrow: name y axis, at [0.0, 0.0], along [0.0, 0.15], frame True",
        "JointMark: at [1.0, 0.0], ground True, name left turn",
        "Center: at [1.0, 0.5]",
        "Body: points [[1.0, 0.0], [1.0, 0.5]], thin True",
        "Body: points [[1.0, 0.0], [0.5, 0.75]]",
        "Arrow: name slide, at [0.5, 0.75], along [0.0, -0.12]",
        "Center: at [0.5, 1.0]",
        "Body: points [[0.5, 0.75], [0.5, 1.0]], thin True",
        "JointMark: at [0.5, 0.75], name wrist",
        "Center: at [0.0, 0.75]",
        "Body: points [[0.5, 0.75], [0.0, 0.75]]",
        "Trail: at [0.0, 0.75]",
        "Body: points [[1.0, 0.0], [0.75, 0.5]]",
        "JointMark: at [0.75, 0.5], name right turn",
        "Center: at [0.75, 0.75]",
        "Body: points [[0.75, 0.5], [0.75, 0.75]]",
        "Trail: at [0.75, 0.75]",
        "ConstraintMark: name rod, at [2.0, 0.0], rows [0.0]",
        "Closing: at [2.0, 0.0], other [1.0, 1.0], rows [0.0]",
        "Body: points [[2.0, 0.0], [1.0, 1.0]], thin True",
        "Body: points [[1.0, 0.0], [1.0, 1.0]]",
        "ConstraintMark: name tip, at [0.5, 0.25], rows [2.0, 3.0]",
        "Closing: at [0.5, 0.25], other [1.0, 2.0], rows [2.0, 3.0]",
        "Body: points [[0.5, 0.75], [0.5, 0.25]]",
        "Arrow: name g, at [-0.2, 0.0], along [0.0, -0.2]",
    ]
    assert sketch[1:] == (0.35, 0.15, 1), "the view of a viewer: nearly on the plane"


def test_every_joint_on_the_ground_is_drawn_on_it_and_no_other():
    joints = [turning("left", "ground", "a"), turning("elbow", "a", "b"),
              turning("right", "ground", "c")]  # fmt: skip
    made = mechanism("Three", [GROUND, *map(rod, "abc")], joints)
    marks = [x for x in made().sketch(np.zeros(3)).parts if isinstance(x, JointMark)]
    assert {x.name: x.ground for x in marks} == {"left": True, "elbow": False, "right": True}


def test_a_picture_in_space_has_these_parts():
    out = Joint("out", "prismatic", "a", "b", (0.0, 0.0, 4.0), axis=(0.0, 3.0, 4.0))
    far = Joint("far", "prismatic", "ground", "c", (0, 0, 1), axis=X, mimics=("out", 2.0, 0.0))
    made = mechanism(
        "Space",
        [GROUND, rod("a", (0.0, 0.0, 2.0)), rod("b", (0.0, 0.0, 1.0)), rod("c", (0.0, 0.0, 0.5))],
        [turning("up", "ground", "a", axis=(0.0, 0.0, -1.0)), out, far],
        [knife_edge("edge", "b", (1.0, 0.0, 0.0), (0.0, 0.0, 2.0))],
    )
    # A quarter turn backwards about z after 0.25 m along (0, 0.6, 0.8).
    sketch = made().sketch(np.array([np.pi / 2, 0.25]))
    assert [written(part) for part in sketch.parts] == [
        "Arrow: name x axis, at [0.0, 0.0, 0.0], along [0.78, 0.0, 0.0], frame True",
        "Arrow: name y axis, at [0.0, 0.0, 0.0], along [0.0, 0.78, 0.0], frame True",
        "Arrow: name z axis, at [0.0, 0.0, 0.0], along [0.0, 0.0, 0.78], frame True",
        "Ground: at [0.0, 0.0, 0.0]",
        "JointMark: at [0.0, 0.0, 0.0], name up, axis [0.0, 0.0, -1.0]",
        "Center: at [0.0, 0.0, 2.0]",
        "Body: points [[0.0, 0.0, 0.0], [0.0, 0.0, 2.0]], thin True",
        "Body: points [[0.0, 0.0, 0.0], [0.15, 0.0, 4.2]]",
        "Arrow: name out, at [0.15, 0.0, 4.2], along [0.3744, 0.0, 0.4992]",
        "Center: at [0.15, 0.0, 5.2]",
        "Body: points [[0.15, 0.0, 4.2], [0.15, 0.0, 5.2]]",
        "Trail: at [0.15, 0.0, 5.2]",
        "Body: points [[0.0, 0.0, 0.0], [0.5, 0.0, 1.0]]",
        "Arrow: name far, at [0.5, 0.0, 1.0], along [0.624, 0.0, 0.0]",
        "Center: at [0.5, 0.0, 1.5]",
        "Body: points [[0.5, 0.0, 1.0], [0.5, 0.0, 1.5]]",
        "Trail: at [0.5, 0.0, 1.5]",
        "ConstraintMark: name edge, at [0.15, 0.0, 6.2], rows [0.0]",
        "Body: points [[0.15, 0.0, 4.2], [0.15, 0.0, 6.2]]",
        "Arrow: name g, at [-1.04, 0.0, 0.0], along [0.0, 0.0, -1.04]",
    ]
    assert sketch[1:] == (-1.0, 0.4, 2)
    assert made(gravity=None).sketch(np.zeros(2)).parts[-1].name != "g"
    assert made(gravity=(0.0, 0.0, 0.0)).sketch(np.zeros(2)).parts[-1].name != "g"


# ---- Choices and ranges --------------------------------------------------------------------------


def test_a_generator_chooses_all_that_there_is_and_nothing_else():
    choices = GeneratorChoices(np.random.default_rng(0))
    assert {choices.whole(2, 4) for _ in range(60)} == {2, 3, 4}
    assert {choices.one_of("abc") for _ in range(60)} == {*"abc"}
    assert choices.whole(5, 5) == 5 and type(choices.whole(1, 2)) is int
    numbers = [choices.number(-2.0, 6.0) for _ in range(400)]
    assert all(type(x) is float for x in numbers)
    assert -2.0 <= min(numbers) < -1.8 and 5.8 < max(numbers) < 6.0
    assert abs(np.mean(numbers) - 2.0) < 0.5


def test_ordinary_places_are_up_to_10_m_away_and_angles_up_to_half_a_turn():
    assert ANYWHERE == (-10.0, 10.0, (), False)
    assert tuple(ANY_ANGLE) == (-np.pi, np.pi, (), False)


# ---- What is made of them ------------------------------------------------------------------------


def test_what_is_as_described_is_printed_by_its_name_alone():
    assert repr(FourBar()) == "FourBar()" and FourBar().as_described
    heavier = FourBar().changed(mass=[1.0, 2.0, 3.0], gravity=None)
    assert repr(heavier) == "FourBar(mass=[1.0, 2.0, 3.0], gravity=None)"
    assert not heavier.as_described
    named: Any = FourBar.source._replace(code="robot('four.urdf')").scene_class()
    assert repr(named()) == "robot('four.urdf')"
    changed = named().changed(mass=[1.0, 2.0, 3.0], gravity=None)
    assert repr(changed) == "robot('four.urdf').changed(mass=[1.0, 2.0, 3.0], gravity=None)"


def test_parameters_that_are_read_back_cannot_be_changed_either():
    again = pickle.loads(pickle.dumps(FourBar(gravity=None)))
    assert again.gravity is None
    for name in ("mass", "offset", "points"):
        assert not getattr(again, name).flags.writeable
        assert (getattr(again, name) == getattr(FourBar(), name)).all()


def test_rounding_makes_no_moment_of_inertia_negative():
    def carried(least: float) -> dict[str, RigidBody]:
        large = RigidBody(1.0, np.zeros(3), np.diag([4.0, 2.0, 1.0]))
        return {"i": large, "j": RigidBody(1.0, np.zeros(3), np.diag([1.0, least, 2.0]))}

    check_positive(carried(-3.9e-12))
    check_positive({})
    said = r"behind joint 'j' has the principal moment of inertia -4\.1e-12 kg m², expected none"
    with pytest.raises(InputError, match=said):
        check_positive(carried(-4.1e-12))


def test_bodies_of_very_different_size_all_have_inertia():
    slides = [Joint(name, "prismatic", "ground", name, axis=X) for name in "abc"]
    links = [
        rod(name)._replace(mass=mass) for name, mass in zip("abc", (1e-9, 1.0, 1e9), strict=True)
    ]
    scene: Any = mechanism("Sizes", [GROUND, *links], slides)()
    assert scene.mass.tolist() == [1e-9, 1.0, 1e9]


def test_one_damper_is_enough_to_lose_energy():
    joints = [turning("α", "ground", "a", damping=0.0), turning("β", "a", "b", damping=0.5)]
    made = mechanism("Damped", [GROUND, rod("a"), rod("b")], joints)
    assert not made().conserves_energy
    assert made().why_not_conserved == "dampers in the joints take it"
    assert made(damping=[0.0, 0.0]).conserves_energy


def test_coordinates_of_what_is_closed_are_drawn_near_its_pose_each():
    joints = [turning("α", "ground", "a"), turning("β", "a", "b")]
    rows, pose = [distance("d", "b", "ground", 1.0, X)], {"α": 2.0, "β": -0.5}
    made = mechanism("Near", [GROUND, rod("a"), rod("b")], joints, rows, pose=pose)
    found = [(one.low, one.high) for one in made().coordinate_ranges()]
    np.testing.assert_allclose(found, [(1.7, 2.3), (-0.8, -0.2)])


def test_a_planar_joint_needs_an_axis_too():
    flat = Joint("β", "planar", "ground", "b", axis=(0.0, 0.0, 0.0))
    with pytest.raises(InputError, match=r"joint 'β' has the axis \(0, 0, 0\)"):
        mechanism("Wrong", [GROUND, rod("b")], [flat])


def test_every_link_of_a_scene_in_words_has_a_frame():
    scene: Any = next(ChainPendulum.structures(2))
    found = scene.frames(np.zeros(scene.n))
    assert len(found) == len(scene.tree().parent) > 1 and "ground" not in found
