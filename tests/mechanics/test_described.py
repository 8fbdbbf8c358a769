"""Mechanisms by description: every kind of joint and constraint is proved, its faults detected."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.mechanics.descriptions import (
    ALL,
    CLOSED,
    GROUND,
    TREES,
    Arm,
    FourBar,
    Skate,
    rod,
    turning,
)

import eomcheck
from eomcheck.claims.proof import prove
from eomcheck.claims.reproducer import reproducer_code
from eomcheck.claims.run import RunSelection, ValidationRun
from eomcheck.descriptions import (
    constraint_rows,
    elements,
    first_derivation,
    forces,
    second_derivation,
)
from eomcheck.descriptions.build import mechanism
from eomcheck.descriptions.described_scene import Described, Description
from eomcheck.descriptions.elements import Link, coupling, on_quadric, perpendicular, pin
from eomcheck.descriptions.mechanism_class import Mechanism, scene_class_of
from eomcheck.descriptions.vector_algebra import (
    ZERO_VECTOR,
    cross,
    roll_pitch_yaw,
    roll_pitch_yaw_of,
    rotation_matrix,
    scale_vector,
)
from eomcheck.errors import InputError
from eomcheck.evaluation.dynamics import assembled_position
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import check_consistent
from eomcheck.mechanics.parameters import parameter
from eomcheck.mechanics.records import State
from eomcheck.mechanics.sketch import Arrow, Center, ConstraintMark, JointMark
from eomcheck.numbers.linear import EPS

every_kind = pytest.mark.parametrize("kind", ALL.values(), ids=ALL)


def failed(kind: type[Mechanism]) -> set[str]:
    return {f.claim for f in prove(kind(), points=1, seed=0) if f.verdict != "passed"}


@pytest.mark.sampled(3)
@every_kind
def test_every_identity_is_proved(kind: type[Mechanism]):
    findings = prove(kind(), points=1, seed=0)
    assert [str(f) for f in findings if f.verdict != "passed"] == []
    proved = {f.claim for f in findings}
    assert {"mass-matrix", "bias", "equivalence", "equations-residual"} <= proved
    if kind in CLOSED.values():
        assert {"constraint-jacobian", "constraint-drift"} <= proved
        assert ("position-rate" in proved) == (kind is not Skate)


@pytest.mark.sampled(12)
@every_kind
def test_drawn_states_pass_every_claim_with_two_engines(kind: type[Mechanism]):
    findings = eomcheck.validate(kind(), examples=2, seed=1)
    assert [str(f) for f in findings if f.verdict == "failed"] == []
    if kind in TREES.values() and kind is not ALL["Following"]:
        assert any(f.subject == "pinocchio" for f in findings)


@every_kind
def test_it_starts_consistent_and_where_it_closes(kind: type[Mechanism]):
    scene = kind()
    q, v = scene.initial_state()
    check_consistent(at := Evaluation(scene, q, v))
    if scene.position_residual is not None:
        residual = scene.position_residual(at.parameters, at.prepared, at.q)
        assert np.abs(residual).max() < 1e-14


@every_kind
def test_scenes_and_their_kinds_are_pickled(kind: type[Mechanism]):
    scene = kind(mass=2.0 * kind().mass)
    again, known = pickle.loads(pickle.dumps((scene, kind)))
    assert type(again) is known is kind
    scene_class_of.cache_clear()  # as after many other descriptions
    assert pickle.loads(pickle.dumps(kind)) is kind
    assert repr(again) == repr(scene)
    with pytest.raises(ValueError, match="read-only"):
        again.mass[0] = 1.0


@every_kind
def test_it_is_printed_as_the_code_that_makes_it_again(kind: type[Mechanism]):
    for scene in (kind(), kind(mass=2.0 * kind().mass)):
        again = eval(repr(scene), {kind.__name__: kind})
        assert repr(again) == repr(scene)
        assert again.mass.tolist() == scene.mass.tolist()
    code = reproducer_code(Arm(), State(np.zeros(3), np.zeros(3)))
    assert "from tests.mechanics.descriptions import Arm" in code.replace("\n", " ")


# ---- Mistakes in one derivation ------------------------------------------------------------------


def without_rest(rates, arm):
    return ZERO_VECTOR


def carried_only(rates, arm):
    return cross(rates.alpha, arm)


def no_moment(inertia, rates):
    return first_derivation.inertia_times(inertia, rates.alpha)


def not_shifted(one, away):
    return one


def still(inertia, omega):
    return ZERO_VECTOR


def halved(a, b):
    row = RIGHT["product"](a, b)
    return row._replace(rest=None)


def other_way(axes, axis, cos, sin):
    return RIGHT["hinged"](axes, axis, cos, -sin)


def upwards(plan, parameters, prepared, Q):
    RIGHT["weigh"](plan, parameters._replace(gravity=-parameters.gravity), prepared, Q)


def standing(rates, k, a):
    return rates[k][0] if k >= 0 else ZERO_VECTOR


def twice(plan, frames, k):
    return {i: scale_vector(2, x) for i, x in RIGHT["turning_columns"](plan, frames, k).items()}


def upwards_rim(derivation, axis, normal):
    spoke, rate = RIGHT["rim"](derivation, axis, normal)
    return scale_vector(-1, spoke), rate


def still_rim(derivation, axis, normal):
    return RIGHT["rim"](derivation, axis, normal)[0], ZERO_VECTOR


def fixed_contact(read):
    return RIGHT["arm_of"](read)[0], ZERO_VECTOR


X_AXIS, Y_AXIS = (1, 0, 0), (0, 1, 0)

RIGHT = {
    "arm_of": constraint_rows.contact_arm,
    "rim": constraint_rows.FirstDerivation.rim,
    "product": constraint_rows.dot_row,
    "hinged": first_derivation.hinged,
    "weigh": forces.add_gravity_forces,
    "turning_columns": first_derivation.turning_columns,
}


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    ("places", "wrong", "kind", "claim"),
    [
        ([(first_derivation, "relative_acceleration")], without_rest, "Arm", "bias"),
        ([(first_derivation, "relative_acceleration")], carried_only, "Arm", "bias"),
        ([(first_derivation, "euler_moment")], no_moment, "Arm", "bias"),
        ([(first_derivation, "shifted_body")], not_shifted, "Branched", "mass-matrix"),
        ([(first_derivation, "momentum")], still, "Free", "kane-ml-force"),
        ([(constraint_rows, "relative_acceleration")], carried_only, "Welded", "constraint-drift"),
        ([(first_derivation, "hinged")], other_way, "Arm", "mass-matrix"),
        ([(forces, "add_gravity_forces")], upwards, "Arm", "generalized-forces"),
        ([(second_derivation, "point_velocity")], standing, "Arm", "mass-matrix"),
        ([(constraint_rows, "dot_row")], halved, "Hinged", "constraint-drift"),
        ([(constraint_rows, "turning_columns")], twice, "Hinged", "constraint-jacobian"),
        ([(constraint_rows.FirstDerivation, "rim")], upwards_rim, "Coin", "constraint-jacobian"),
        ([(constraint_rows.FirstDerivation, "rim")], still_rim, "Coin", "constraint-drift"),
        ([(constraint_rows, "contact_arm")], fixed_contact, "Coin", "constraint-drift"),
        ([(constraint_rows, "contact_arm")], fixed_contact, "Marble", "constraint-drift"),
    ],
)
def test_a_mistake_in_one_derivation_is_disproved_and_named(
    places, wrong, kind, claim, monkeypatch
):
    for module, name in places:
        monkeypatch.setattr(module, name, wrong)
    assert claim in failed(ALL[kind])


# ---- What it is ----------------------------------------------------------------------------------


def test_what_stays_in_the_plane_has_no_third_component():
    scene = FourBar()
    assert scene.source.topology.planar
    at = Evaluation(scene, *scene.initial_state())
    jacobians = scene.jacobians(at.parameters, at.prepared, at.q, at.v)
    assert jacobians.linear.shape == (3, 2, 3)
    assert jacobians.angular.shape == (3, 1, 3)
    assert jacobians.gyroscopic is None
    assert scene.offset.shape == (3, 2)


def test_what_is_not_there_is_absent():
    at = Evaluation(Skate(), np.ones(3), np.ones(3))
    assert at.terms.Q is None
    assert at.terms.b is None
    at = Evaluation(Arm(), np.ones(3), np.ones(3))
    assert at.terms[3:] == (None, None, None)
    assert not hasattr(FourBar(), "damping")
    assert FourBar.dissipation is None


def test_a_mechanism_moves_in_machine_code_and_keeps_its_energy():
    found = eomcheck.simulate(FourBar(), "em", 1.0)
    assert found.status == "finished"
    assert np.abs(found.energy - found.energy[0]).max() < 1e-6


@every_kind
def test_a_picture_shows_its_joints_by_their_names(kind: type[Mechanism]):
    scene = kind()
    sketch = scene.sketch(scene.initial_state()[0])
    told = {part.name for part in sketch.parts if isinstance(part, JointMark | Arrow)}
    assert {slot.name.replace("_", " ") for slot in kind.plan.joints} <= told
    rows = [i for part in sketch.parts if isinstance(part, ConstraintMark) for i in part.rows]
    assert len(set(rows)) == len(rows) <= scene.r
    d = 2 if kind.source.topology.planar else 3
    assert all(np.shape(part.at) == (d,) for part in sketch.parts if isinstance(part, Center))


@pytest.mark.sampled(4)
@pytest.mark.parametrize("key", ["Arm", "FourBar", "Free", "Lifted"])
def test_random_mechanisms_of_a_topology_pass_every_claim(key: str):
    kind, run = ALL[key], ValidationRun()
    selection = RunSelection.of(scenes=[kind])
    run.validate_kind(kind, selection, (1, 1), 4, 0)
    assert [str(f) for f in run.findings if f.verdict == "failed"] == []
    assert run.cases == 6
    drawn = [one.scene for one in run.sampled[1:]]
    assert len({repr(one) for one in drawn}) == 4
    if kind in CLOSED.values() and kind.source.fixed_geometry:
        assert all((one.offset == kind().offset).all() for one in drawn)


def on(name: str, constraint: elements.Constraint) -> Mechanism:
    """Return a small ball, free in space except for a constraint."""
    links = [GROUND, Link("ball", 2.0, moments=(0.1, 0.1, 0.1))]
    return mechanism(
        name, links, [elements.Joint("b", "floating", "ground", "ball")], [constraint]
    )()


def test_a_ball_on_a_sphere_is_one_on_a_rod():
    rod = on("OnRod", elements.distance("held", "ball", "ground", 2.0))
    sphere = on("OnSphere", elements.on_quadric("held", "ball", "ground", (0.5,) * 3, 1.0))
    q, v = np.zeros(6), np.zeros(6)
    q[:3], v[:3] = (1.2, 0.0, -1.6), (0.8, 0.3, 0.6)
    both = [eomcheck.acceleration(scene, "au", q, v).vdot for scene in (rod, sphere)]
    np.testing.assert_allclose(*both, rtol=1e-14, atol=1e-14)


def test_a_ball_closes_on_the_surface_that_is_meant():
    sphere = on("OnSphere", elements.on_quadric("held", "ball", "ground", (0.5,) * 3, 1.0))
    q = assembled_position(sphere, [1.0, 0.4, -1.5, 0.0, 0.0, 0.0])
    assert np.linalg.norm(q[:3]) == pytest.approx(2.0, rel=1e-14)


def test_a_ball_in_a_parabolic_bowl_runs_on_a_level_circle_at_one_rate():
    bowl = elements.on_quadric("bowl", "ball", "ground", (4.0, 4.0, 0.0), 0.0, (0.0, 0.0, -1.0))
    q, v = np.zeros(6), np.zeros(6)
    q[:3], v[1] = (0.3, 0.0, 2 * 0.3**2), 0.3 * np.sqrt(4.0 * 9.81)  # ω² = g k, at any radius
    vdot = eomcheck.acceleration(on("InBowl", bowl), "kane", q, v).vdot
    np.testing.assert_allclose(vdot[:3], (-0.3 * 4.0 * 9.81, 0.0, 0.0), atol=1e-13)


SLIDES = [
    elements.Joint("x", "prismatic", "ground", "carriage", axis=(1.0, 0.0, 0.0)),
    elements.Joint("y", "prismatic", "carriage", "b", axis=(0.0, 1.0, 0.0)),
]


def sliding(constraint: elements.Constraint) -> Mechanism:
    """Return a body that slides along x and y, except for a constraint."""
    return mechanism("Sliding", [GROUND, Link("carriage"), rod("b")], SLIDES, [constraint])()


def test_a_rod_from_a_point_off_the_plane_of_all_joints_keeps_its_length():
    scene = sliding(elements.distance("held", "b", "ground", 1.0, at_other=(0.0, 0.0, 0.6)))
    assert assembled_position(scene, [1.0, 0.0]) == pytest.approx([0.8, 0.0], abs=1e-14)


def edge_and_rod(parameters: Any) -> Description:
    body = elements.Link("body", parameters.mass[0])
    edge = elements.knife_edge("edge", "body", (0, 1, 0))
    held = elements.distance("held", "body", "ground", parameters.length[0], (0, 0, 0), (0, 0, 0))
    joint = elements.Joint("at", "planar", "ground", "body")
    return Description([body], [joint], constraints=[edge, held], planar=True)


class EdgeAndRod(Described, description=edge_and_rod, closed=True):
    """A body on an edge and on a rod, of which the edge is declared first."""

    mass: Any = parameter("m", "kg", "> 0", (0.1, 10.0), (1,), default=(1.0,))
    inertia: Any = parameter("I, central", "kg m²", "> 0", (0.1, 10.0), (1,), default=(1.0,))
    length: Any = parameter("of the rod", "m", "> 0", (0.1, 10.0), default=2.0)

    key, conserves_energy, angle_coordinates = "edge-and-rod", True, slice(2, None)
    named_coordinates, named_constraints = ("x", "y", "θ"), ("edge", "held")
    holonomic = slice(1, 2)

    def initial_state(self):
        return np.array([2.0, 0.0, np.pi / 2]), np.zeros(3)


def test_a_position_is_held_by_its_own_row_wherever_that_is_declared():
    scene = EdgeAndRod()
    q = np.array([3.0, 4.0, 0.5])
    assert np.hypot(*assembled_position(scene, q)[:2]) == pytest.approx(2.0, rel=1e-14)


@pytest.mark.parametrize(("apart", "start"), [(18.0, (9.0, -9.0)), (22.0, (0.0, 0.0))])
def test_a_pose_is_closed_if_it_closes_within_ten_of_it(apart, start):
    q, _ = sliding(coupling("apart", "x", "y", 1.0, apart)).initial_state()
    assert q == pytest.approx(start, abs=1e-14)


@pytest.mark.parametrize(("order", "walk"), [("abdc", "abdc"), ("acbd", "acbd"), ("dcba", "acbd")])
def test_coordinates_are_in_the_order_given_and_numbers_in_that_of_a_walk(order: str, walk: str):
    """Deep before wide; of joints on one link in the order in which they are given."""
    parents = {"a": "ground", "b": "a", "c": "a", "d": "b"}
    stiffness = {"a": 1.0, "b": 2.0, "c": 3.0, "d": 4.0}
    joints = [
        elements.Joint(one, "revolute", parents[one], one, stiffness=stiffness[one])
        for one in order
    ]
    scene: Any = mechanism("Branching", [GROUND, *map(rod, "abcd")], joints)()
    assert "".join(scene.coordinate_names) == order
    assert scene.stiffness.tolist() == [stiffness[one] for one in walk]


AXES_OF_JOINTS = [
    *((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    *((-1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0), (0.6, 0.0, -0.8)),
]


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
@pytest.mark.parametrize("axis", AXES_OF_JOINTS)
def test_a_spring_rests_where_its_joint_says_along_any_axis(kind, axis):
    """By hand, and of a joint that follows: -k (q - rest), times the ratio."""
    along = {"axis": axis, "stiffness": 3.0, "rest_position": 0.4, "damping": 0.2}
    joints = [
        elements.Joint("leader", kind, "ground", "a", **along),
        elements.Joint("f", kind, "a", "b", (1.0, 0.3, 0.2), mimics=("leader", -1.5, 0.7), **along),
    ]
    scene = mechanism("Sprung", [GROUND, rod("a"), rod("b")], joints, gravity=None)()
    at = Evaluation(scene, np.array([0.9]), np.array([0.5]))
    stretched, follower = 0.9 - 0.4, -1.5 * 0.9 + 0.7 - 0.4
    damped = 0.2 * (1.0 + 1.5**2) * 0.5
    forces = at.terms.Q
    assert forces == pytest.approx([-3.0 * (stretched - 1.5 * follower) - damped], rel=1e-14)
    energy = scene.potential(at.parameters, at.prepared, at.q)
    assert energy == pytest.approx(3.0 * (stretched**2 + follower**2) / 2, rel=1e-14)


@pytest.mark.parametrize("kind", ["spherical", "floating"])
@pytest.mark.parametrize("seed", range(5))
def test_a_spring_about_any_axis_pulls_along_the_shortest_rotation_to_its_rest(kind, seed):
    """Beside the rotation vector of SciPy, of quaternions of any length, at any angles."""
    random = np.random.default_rng(seed)
    rest, at_rest = random.uniform(-1.0, 1.0, 4), tuple(random.uniform(-1.0, 1.0, 3).tolist())
    joint = elements.Joint(
        *("ball", kind, "ground", "a", (0.1, 0.2, 0.3), tuple(random.uniform(-1.0, 1.0, 4))),
        stiffness=3.0,
        rest_position=at_rest if kind == "floating" else 0.0,
        rest_orientation=tuple(rest.tolist()),
    )
    scene = mechanism("Sprung", [GROUND, rod("a")], [joint], gravity=None)()
    q = random.uniform(-3.0, 3.0, scene.n)
    at = Evaluation(scene, q, np.zeros(scene.n))
    turned = Rotation.from_euler("ZYX", q[-3:])
    resting = Rotation.from_quat(np.roll(rest, -1))  # w last
    vector = (turned * resting.inv()).as_rotvec()
    stretched = q[:-3] - at_rest[: scene.n - 3]
    energy = scene.potential(at.parameters, at.prepared, at.q)
    assert energy == pytest.approx(1.5 * (vector @ vector + stretched @ stretched), rel=1e-12)
    axes = [[0.0, 0.0, 1.0]]
    axes += [Rotation.from_euler("Z", q[-3]).apply([0.0, 1.0, 0.0])]
    axes += [Rotation.from_euler("ZY", q[-3:-1]).apply([1.0, 0.0, 0.0])]
    forces = [*(-3.0 * stretched), *(-3.0 * np.array(axes) @ vector)]
    assert pytest.approx(forces, rel=1e-12, abs=1e-12) == at.terms.Q


def test_springs_of_several_gimbals_rest_each_where_its_joint_says():
    """One number is the rest of all three slides of a floating joint."""
    random = np.random.default_rng(0)
    rests = random.uniform(-1.0, 1.0, (2, 4))
    first, second = (tuple(rest.tolist()) for rest in rests)
    joints = [
        elements.Joint(
            *("free", "floating", "ground", "a"),
            stiffness=2.0,
            rest_position=0.3,
            rest_orientation=first,
        ),
        elements.Joint("ball", "spherical", "a", "b", stiffness=5.0, rest_orientation=second),
    ]
    scene = mechanism("Sprung", [GROUND, rod("a"), rod("b")], joints, gravity=None)()
    q = random.uniform(-1.0, 1.0, scene.n)
    at = Evaluation(scene, q, np.zeros(scene.n))
    turned = Rotation.from_euler("ZYX", [q[3:6], q[6:]])
    squares = (turned * Rotation.from_quat(np.roll(rests, -1, axis=1)).inv()).magnitude() ** 2
    energy = np.sum((q[:3] - 0.3) ** 2) + squares @ [1.0, 2.5]
    assert scene.potential(at.parameters, at.prepared, q) == pytest.approx(energy, rel=1e-12)


def test_the_series_of_an_angle_is_exact_to_rounding_up_to_half_a_turn():
    """Of an eighth of it, where 1 - cos is y."""
    y = np.linspace(0.0, 2.0 * np.sin(np.pi / 16) ** 2, 100)[1:]
    angle, sine = 2.0 * np.arcsin(np.sqrt(y / 2.0)), np.sqrt(y * (2.0 - y))
    for numerators, expected in (
        (forces.ANGLE_SQUARED, angle**2 / (2.0 * y)),
        (forces.ANGLE_BY_SINE, angle / sine),
    ):
        series = forces._series(numerators, y)
        np.testing.assert_allclose(series, expected, rtol=4 * EPS, atol=0.0)


class Motor(Described, description=lambda parameters: _motor(parameters), closed=True):
    """A lever about an axis that points down, and a motor."""

    mass: Any = parameter("m", "kg", "> 0", (0.1, 10.0), (1,))
    inertia: Any = parameter("I, central", "kg m²", ">= 0", (0.01, 10.0), (1,))
    torque: Any = parameter("motor", "N m", sample_range=(-1.0, 1.0))

    key, conserves_energy = "motor", True
    named_coordinates = ("turn",)

    def initial_state(self):
        return np.zeros(1), np.zeros(1)


def _motor(parameters) -> Description:
    joint = elements.Joint("turn", "revolute", "ground", "lever", axis=(0.0, 0.0, -1.0),
                        torque=parameters.torque[0])  # fmt: skip
    return Description([Link("lever", parameters.mass[0])], [joint], planar=True)


def test_a_motor_drives_its_joint_forwards_about_a_negative_axis():
    scene = Motor([2.0], [0.5], 0.25)
    at = Evaluation(scene, np.array([0.7]), np.zeros(1))
    assert at.terms.Q.tolist() == [0.25]
    assert scene.potential(at.parameters, at.prepared, at.q) == pytest.approx(-0.25 * 0.7)


# ---- Inertia and angles --------------------------------------------------------------------------


@pytest.mark.parametrize("moments", [(0.0, 0.0, 0.3), (0.1, 0.3, 0.3), (0.3, 0.1, 0.2)])
@pytest.mark.parametrize("carrier", [None, Link("a", moments=(0.0, 0.0, 0.2)), rod("a")])
def test_a_link_without_mass_has_the_moments_of_inertia_that_it_is_given(moments, carrier):
    rotor = Link("rotor", moments=moments)

    def inertia(*links: Link) -> float:
        first = turning("α", "ground", links[0].name)
        fixed = [elements.Joint("fixed", "fixed", "a", one.name) for one in links[1:]]
        scene = mechanism("Rotor", [GROUND, *links], [first, *fixed])()
        return Evaluation(scene, [0.3], [0.0]).terms.M[0, 0]

    if carrier is None:
        assert inertia(rotor) == moments[2]
    else:
        assert inertia(carrier, rotor) == pytest.approx(inertia(carrier) + moments[2], rel=4 * EPS)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("below", [0.0, 1e-17, 1e-12, 1e-9, 1e-6, 1e-3, 0.5, 1.5])
def test_angles_of_a_rotation_make_it_again_however_near_the_pitch_is_to_a_quarter(sign, below):
    for roll, yaw in ((0.3, -1.1), (-2.5, 3.0), (0.0, 0.0)):
        pitch = sign * (np.pi / 2 - below)
        R = rotation_matrix(roll_pitch_yaw(roll, pitch, yaw))
        found = roll_pitch_yaw_of(R)
        assert np.abs(rotation_matrix(roll_pitch_yaw(*found)) - R).max() <= 8 * EPS
        assert found[1] == pytest.approx(pitch, abs=4 * EPS)
    R[2, 0] = np.copysign(1.0 + EPS, R[2, 0])  # possible rounding error
    assert np.isfinite(roll_pitch_yaw_of(R)).all()


# ---- What is refused -----------------------------------------------------------------------------

BETA = turning("β", "a", "b")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"joints": [BETA]}, "2 links are no joint's child"),
        ({"links": []}, "joint 'α' has the parent 'ground', no such link"),
        ({"links": [], "joints": []}, "there is no link"),
        ({"joints": [BETA, turning("β", "ground", "a")]}, "two joints have the name 'β'"),
        ({"dependent": ["γ"]}, "dependent names 'γ', expected one of: α, β"),
        ({"pose": {"γ": 1.0}}, "pose names 'γ', expected one of: α, β"),
        ({"constraints": [pin("p", "a", "c")]}, "constraint 'p' is on the link 'c', no such link"),
        ({"constraints": [coupling("p", "α", "γ", 1.0)]}, "constraint 'p' names 'γ', expected"),
        ({"constraints": [pin("p", "a", "b", (np.nan, 0.0, 0.0))]}, "'p': a point of 'a' = .nan"),
        ({"constraints": [on_quadric("p", "a", "b", (0, 0, 0), 1.0)]}, "bends and slopes are 0"),
        ({"constraints": [on_quadric("p", "a", "b", (1, np.nan, 0), 1.0)]}, "expected finite ones"),
        ({"constraints": [perpendicular("p", "a", X_AXIS, "a", Y_AXIS)]}, "between 'a' and itself"),
        ({"constraints": [pin("p", "a", "a")]}, "'p' is between 'a' and itself"),
        ({"constraints": [coupling("p", "α", "α", 1.0)]}, "'p' is between 'α' and itself"),
        ({"joints": [BETA._replace(axis=(0.0, 0.0, 0.0))]}, "'β' has the axis .0, 0, 0."),
        ({"joints": [BETA._replace(orientation=(0.0,) * 4)]}, "joint 'β' has the orientation"),
        ({"joints": [BETA._replace(kind="ball")]}, "joint 'β' has the kind 'ball', expected one"),
        ({"joints": [BETA._replace(kind="planar", stiffness=1.0)]}, "'β' is planar: stiffness is"),
        ({"joints": [BETA._replace(kind="planar", mimics=("α", 1.0, 0.0))]}, "that it follows is"),
        ({"joints": [BETA._replace(rest_orientation=(0.0,) * 4)]}, "has the rest_orientation"),
        ({"joints": [BETA._replace(rest_position=(0.0,) * 3)]}, "rest_position = .0.0, 0.0, 0.0."),
        ({"joints": [BETA._replace(mimics=("β", 1.0, 0.0))]}, "joint 'β' follows itself"),
        ({"joints": [BETA._replace(name="α_x"), turning("α", "ground", "a")._replace(
            kind="planar")]}, "two coordinates have the name 'α_x'"),
        ({"links": [GROUND, Link("a"), Link("b")]}, "nothing that moves has inertia"),
        ({"links": [GROUND, rod("a"), Link("b")]}, "joint 'β' moves nothing that has inertia"),
        ({"links": [GROUND, rod("a"), rod("b")._replace(mass=-1.0)]}, "mass = -1 kg"),
    ],
)  # fmt: skip
def test_a_description_that_contradicts_itself_is_refused(change, said):
    given = {"links": [GROUND, rod("a"), rod("b")], "joints": [turning("α", "ground", "a"), BETA]}
    if "joints" in change and len(change["joints"]) == 1 and "2 links" not in said:
        change = {**change, "joints": [turning("α", "ground", "a"), *change["joints"]]}
    with pytest.raises(InputError, match=said):
        mechanism("Wrong", **(given | change))


def test_energy_is_kept_unless_a_damper_takes_it():
    links = [Link("ground"), Link("rod", 1.0, (0.5, 0.0, 0.0), (0.1, 0.1, 0.1))]
    kept, damped, still = (
        mechanism(
            "Rod", links, [elements.Joint("j", "revolute", "ground", "rod", damping=damping)]
        )()
        for damping in (None, 0.2, 0.0)
    )
    assert kept.conserves_energy and still.conserves_energy
    assert not damped.conserves_energy and "dampers" in damped.why_not_conserved
    assert damped.changed(damping=[0.0]).conserves_energy
