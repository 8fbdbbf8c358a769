"""Conformance quantities of all kinds of trees: against Pinocchio, and in every scalar type."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from fractions import Fraction
from functools import cache
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from tests import robots
from tests.machine_code import MachineCode, leaves
from tests.samples import random_state

import eomcheck
from eomcheck.claims.engine_quantities import CONFORMANCE, acceleration_asked, point_at
from eomcheck.claims.proof import prove_structure
from eomcheck.descriptions.build import mechanism
from eomcheck.descriptions.elements import Joint, Link
from eomcheck.descriptions.random_mechanisms import RandomMechanism, RandomTree
from eomcheck.descriptions.tree_model import MAKERS, summed_angles, tree_model
from eomcheck.engines import PinocchioFile
from eomcheck.errors import InputError, RefusedError
from eomcheck.evaluation.conformance import (
    ARGUMENTS,
    QUANTITIES,
    ConformancePoint,
    Quantity,
    enclosed_quantity,
)
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import NOISES, perturbed_samples, sensitivity_of
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.evaluation.tolerance import allowed_error, largest
from eomcheck.lab.studies.robots import ROBOTS, WALKING, robot_path
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.ball import Balls, ball, precision
from eomcheck.numbers.counting import Counting
from eomcheck.numbers.generic import Angles, Array
from eomcheck.scenes import SCENES, ChainPendulum, Sleigh, Snake, from_urdf

WITH_TREE = [key for key, kind in SCENES.items() if kind.example().tree() is not None]

Following = mechanism(
    "Following",
    [
        Link("ground"),
        Link("upper", 2.0, (0.1, 0.2, -0.1), (0.3, 0.2, 0.25), (0.01, -0.02, 0.03)),
        Link("fore", 1.0, (0.0, 0.3, 0.1), (0.1, 0.2, 0.15), (0.02, 0.01, -0.01)),
        Link("finger", 0.5, (0.05, 0.0, 0.1), (0.02, 0.03, 0.01)),
        Link("thumb", 0.4, (0.0, 0.1, 0.0), (0.03, 0.01, 0.02)),
    ],
    [
        Joint("shoulder", "revolute", "ground", "upper", (0.0, 0.1, 0.5), armature=0.7),
        Joint("slide", "prismatic", "upper", "fore", (0.2, 0.0, 0.1), axis=(1.0, 2.0, 2.0)),
        Joint(
            *("grip", "revolute", "fore", "finger", (0.0, 0.1, 0.3), (0.8, 0.2, -0.5, 0.1)),
            axis=(0.0, 1.0, 0.0),
            armature=0.2,
        ),
        Joint(
            *("counter", "revolute", "fore", "thumb", (0.1, 0.0, 0.3)),
            axis=(0.6, 0.0, 0.8),
            armature=0.3,
            mimics=("grip", -1.5, 0.2),
        ),
    ],
)
"""A hand on an arm: one finger follows the other, joints have rotors, links are turned."""

TILTED = Link("ground"), Link("wing", 1.0, (0.2, 0.1, 0.0), (0.4, 0.5, 0.6), (0.0, 0.1, 0.2))
TURN = [Joint("turn", "revolute", "ground", "wing")]
Tilted = mechanism("Tilted", [*TILTED], TURN)
"""A body that turns about z and has momentum about x and y."""

TIP = robots.LINK.format(
    **{"name": "tip", "at": "0.1 0 0", "turn": "0 1 0", "mass": 0.3}, xx=0.1, yy=0.1, zz=0.15
)
BASE = robots.LINK.format(
    **{"name": "base", "at": "0 0.1 0.1", "turn": "0 0 1", "mass": 4.0}, xx=0.3, yy=0.4, zz=0.5
)
TOOL = "".join(
    [
        '<link name="tool"/>',
        TIP,
        robots.joint("flange", "hand", "tool", "fixed", "0 0 1"),
        robots.joint("mount", "tool", "tip", "fixed", "0 0 1"),
    ]
)
"""Links fixed to the hand of an arm, turned against it; the second one has a mass."""

OTHERS = {
    "following": Following,
    "arm": lambda: arm(False),
    "free-arm": lambda: arm(True),
    "ur5": lambda: from_urdf(robot_path("ur5")),
    "free-solo12": lambda: from_urdf(robot_path("solo12"), floating=True),
}
LARGE = {"free-solo12"}
RANDOM = [f"{kind.key}-{links}" for links in range(1, 13) for kind in (RandomTree, RandomMechanism)]


FOLDER = TemporaryDirectory()
"""Folder of a robot's file, while tests run: libraries read it again."""


def arm(floating: bool) -> Scene:
    """Return an arm with links fixed to its hand, on a base that has a mass."""
    path = robots.arm(Path(FOLDER.name) / "arm.urdf", more=TOOL)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace('<link name="base"/>', BASE), encoding="utf-8")
    return from_urdf(path, floating=floating)


@cache
def subject(name: str) -> tuple[Scene, State]:
    """Return a scene and a state of it in motion."""
    if name in SCENES:
        scene = SCENES[name].example()
    elif name in OTHERS:
        scene = OTHERS[name]()
    else:
        key, _, links = name.rpartition("-")
        kind = RandomTree if key == RandomTree.key else RandomMechanism
        scene = next(kind.structures(int(links)))
    random = np.random.default_rng(3)
    while True:
        with suppress(RefusedError):  # no closed position is near
            state = random_state(scene, random)
            assert 2 * np.count_nonzero(state.v) > scene.n
            return scene, state


def evaluation(name: str) -> Evaluation:
    """Return a new evaluation of a subject."""
    scene, state = subject(name)
    return Evaluation(scene, *state)


LARGE_RANDOM = [pytest.param(x, marks=pytest.mark.night) for x in RANDOM[16:]]
subjects = pytest.mark.parametrize("name", [*WITH_TREE, *OTHERS, *RANDOM[:16], *LARGE_RANDOM])
few_subjects = pytest.mark.parametrize(
    "name", [x for x in (*WITH_TREE, *OTHERS) if x not in LARGE] + RANDOM[:10]
)


# ---- Pinocchio -----------------------------------------------------------------------------------


SOLVED = {
    "engine-forward-dynamics",
    "engine-inverse-mass-matrix",
    "engine-forward-dynamics-derivatives",
}
"""Claims about what a library computes by a solve, in which no joint of it follows others."""

UNCOMPARED = {"engine-constraint-force-derivatives"}
"""Claims about what Pinocchio does not offer by rows of constraints."""


@subjects
@pytest.mark.sampled(4)
def test_every_quantity_of_a_tree_is_that_of_pinocchio(name: str):
    scene, state = subject(name)
    findings = eomcheck.check_state(scene, *state, engines=["pinocchio"], claims=CONFORMANCE)
    assert [str(one) for one in findings if one.verdict == "failed"] == []
    passed = {one.claim for one in findings if one.verdict == "passed"}
    if len(scene.tree().joint) > scene.n:
        skipped = {one.claim: one.detail for one in findings if one.verdict == "skipped"}
        skipped = {claim: why for claim, why in skipped.items() if claim not in UNCOMPARED}
        reason = "its joints that follow others are independent there"
        assert skipped == dict.fromkeys(SOLVED, reason)
        assert passed == set(CONFORMANCE) - SOLVED - UNCOMPARED
    else:
        assert passed == set(CONFORMANCE) - UNCOMPARED


@subjects
@pytest.mark.sampled(4)
def test_every_derivative_is_that_of_casadi(name: str):
    scene, state = subject(name)
    claims = [claim for claim in CONFORMANCE if claim.endswith("-derivatives")]
    findings = eomcheck.check_state(scene, *state, engines=["casadi"], claims=claims)
    compared = [one for one in findings if one.subject.startswith("casadi")]
    assert {one.verdict for one in compared} == {"passed"}
    without = set() if scene.r else UNCOMPARED
    assert {one.claim for one in compared} == set(claims) - without


@pytest.mark.parametrize("name", ["arm", "free-arm", "ur5", "free-solo12"])
@pytest.mark.sampled(2)
def test_every_quantity_of_a_file_is_that_of_pinocchio_s_own_reading(name: str):
    scene, state = subject(name)
    findings = eomcheck.check_state(scene, *state, engines=[PinocchioFile], claims=CONFORMANCE)
    assert [str(one) for one in findings if one.verdict == "failed"] == []
    passed = {one.claim for one in findings if one.verdict == "passed"}
    assert passed == set(CONFORMANCE) - UNCOMPARED


MOMENTUM = "momentum", "momentum_matrix", "momentum_rate"


@pytest.mark.parametrize("name", MOMENTUM)
def test_in_the_plane_the_momentum_of_tilted_bodies_is_skipped_and_not_wrong(name: str):
    """It has parts about x and y, whose products of inertia a planar scene leaves out."""
    q, v = np.zeros(1), np.ones(1)
    turned = [one._replace(products=(0.2, 0.0, 0.0)) if one.mass else one for one in TILTED]
    state = {"v": v, "vdot": v}
    state = {one: x for one, x in state.items() if one in QUANTITIES[name].arguments}
    assert eomcheck.quantity(mechanism("Flat", turned, TURN)(), name, q, **state).any()
    assert Tilted().source.topology.planar
    with pytest.raises(InputError, match="Tilted is planar, and its products of inertia leave"):
        eomcheck.quantity(Tilted(), name, q, **state)
    claims = [f"engine-{name.replace('_', '-')}"]
    findings = eomcheck.check_state(Tilted(), q, v, engines=["pinocchio"], claims=claims)
    assert {one.verdict for one in findings} <= {"skipped"}


def test_frames_of_fixed_links_are_turned_against_their_joint():
    scene, _ = subject("arm")
    frames = {frame.name: frame for frame in scene.tree().frames}
    assert [*frames] == ["base", "upper", "fore", "hand", "tool", "tip"]
    assert frames["hand"].joint == frames["tool"].joint == frames["tip"].joint == 2
    assert frames["base"].joint == -1
    for one in ("tool", "tip"):
        R = frames[one].R
        assert largest(R - np.eye(3)) > 0.1 and largest(R @ R.T - np.eye(3)) < 1e-15
    assert tree_model(scene).bodies == ("upper", "fore", "hand")


@pytest.mark.parametrize(
    ("one", "other", "heavier"),
    [
        (ChainPendulum.rods(2), ChainPendulum.rods(2), ChainPendulum.rods(3)),
        (Snake.coil(3), Snake.coil(3), Snake.coil(4)),
    ],
    ids=["described", "by its own tree"],
)
def test_trees_are_read_once_per_scene_and_equal_ones_have_the_same_functions(
    one: Scene, other: Scene, heavier: Scene
):
    model, same, more = (tree_model(scene) for scene in (one, other, heavier))
    assert model is not None and same is not None and more is not None
    assert tree_model(one) is model and same is not model
    for name in MAKERS:
        assert same.function(name) is model.function(name) is not more.function(name)


def test_inverse_dynamics_take_operations_in_proportion_to_the_links():
    def operations(links: int) -> int:
        counting = Counting()
        at = Quantities(ChainPendulum.rods(links), counting, counting.vector(links), 0.0)
        at.v = counting.vector(links)
        point = ConformancePoint(at, counting.vector(links))
        arguments = point._numbers, point._prepared, at.v, point.vdot
        before = counting.tally.multiplications
        point.model.function("inverse_dynamics")(*arguments)
        return counting.tally.multiplications - before

    few, more, many = map(operations, (8, 16, 32))
    assert 0 < few < more
    assert many - more == 2 * (more - few)


# ---- Scalar types --------------------------------------------------------------------------------


def each_quantity(at: Evaluation, point: ConformancePoint) -> Iterator[tuple[Quantity, str]]:
    """Yield the quantities, those of frames for the first and the last link that moves."""
    model = point.model
    names = [x for x, joint in zip(model.links, model.joints, strict=True) if joint >= 0]
    for one in QUANTITIES.values():
        if "r" in one.shape and not at.scene.r:
            continue
        for frame in dict.fromkeys((names[0], names[-1])) if one.of_frame else ("",):
            yield one, frame


@few_subjects
@pytest.mark.sampled(3)
def test_values_in_float64_are_as_near_to_the_true_ones_as_their_sensitivity_allows(name: str):
    at = evaluation(name)
    vdot = acceleration_asked(at)
    forces = ConformancePoint(at, 1.0 - vdot).torques  # of another acceleration
    for one, frame in each_quantity(at, ConformancePoint(at, vdot)):
        tau = forces if "tau" in one.arguments else None

        def value(e: Evaluation, one: Quantity = one, frame: str = frame, tau: Any = tau) -> Any:
            return one.compared(point_at(e, vdot, tau), frame)

        true = enclosed_quantity(at, one, frame, vdot, tau)
        allowed = allowed_error(1.0) * sensitivity_of(at, value, coordinates=True)
        error = largest(np.asarray(value(at), np.float64) - true)
        assert error <= allowed, (one.name, frame, error, allowed)
        assert allowed <= 1e-6 * max(largest(true), 1.0), (one.name, allowed)


@few_subjects
@pytest.mark.sampled(3)
def test_balls_of_any_precision_contain_one_value(name: str):
    at = evaluation(name)
    results: list[list[Any]] = []
    for bits in (60, 200):
        balls = Balls()
        with precision(bits):
            t = balls.numbers(np.array(at.t)).item()
            exact = Quantities(at.scene, balls, balls.numbers(at.q), t)
            exact.v = balls.numbers(at.v)
            point = ConformancePoint(exact, balls.numbers(acceleration_asked(at)))
            results.append([x for key in MAKERS for x in leaves(point.result(key))])
    wide, narrow = (np.concatenate([np.ravel(x) for x in one]) for one in results)
    assert len(wide) == len(narrow) > 0
    for x, y in zip(wide, narrow, strict=True):
        if hasattr(x, "contains"):
            assert x.contains(y) or x.overlaps(y)


@pytest.mark.sampled(7)
@few_subjects
def test_machine_code_computes_the_same_numbers(name: str):
    at = evaluation(name)
    point = ConformancePoint(at, acceleration_asked(at))
    v, vdot = point._mapped(at.v), point._mapped(point.vdot)
    for key in MAKERS:
        function = point.model.function(key)
        arguments = point._numbers, point._prepared, v, *ARGUMENTS[key](point, vdot)
        ours, theirs = function(*arguments), MachineCode(function, *arguments)(*arguments)
        for x, y in zip(leaves(ours), leaves(theirs), strict=True):
            assert np.array_equal(np.asarray(x, np.float64), y), key


SOLVING = "inverse_mass_matrix", "forward_dynamics", "forward_dynamics_derivatives"


@pytest.mark.parametrize("name", [*SOLVING, "constraint_force_derivatives"])
def test_matrices_that_a_quantity_solves_are_perturbed_as_elimination_does(
    name: str, monkeypatch: pytest.MonkeyPatch
):
    samples = perturbed_samples(evaluation("snake"))
    recording, solved = samples.recording_solves, []

    @contextmanager
    def noted(*key: Any) -> Iterator[Any]:
        with recording(*key) as recorder:
            yield recorder
        solved.extend(solve.name for solve in recorder.solves)

    monkeypatch.setattr(samples, "recording_solves", noted)
    with np.errstate(all="ignore"):
        QUANTITIES[name].value(ConformancePoint(samples), "")
    assert solved


@few_subjects
@pytest.mark.sampled(3)
def test_perturbed_samples_are_near_and_differ(name: str):
    at = evaluation(name)
    vdot = acceleration_asked(at)
    samples = perturbed_samples(at)
    with samples.computing("sides"):
        for key in MAKERS:
            value = ConformancePoint(at, vdot).result(key)
            noisy = ConformancePoint(samples, vdot).result(key)
            size = apart = 0.0
            for x, y in zip(leaves(value), leaves(noisy), strict=True):
                exact, batch = np.asarray(x, np.float64), as_batch(y)
                assert batch.shape == (len(NOISES), *exact.shape)
                difference = largest(batch - exact)
                assert difference <= 1e-9 * max(largest(exact), 1.0), key
                size, apart = max(size, largest(exact)), max(apart, difference)
            assert apart >= 1e-18 * size, key


def as_batch(x: Any) -> Array:
    """Return the numbers of a perturbed result, the samples along its first axis."""
    return np.asarray(x.data if hasattr(x, "data") else x, np.float64)


# ---- Proofs --------------------------------------------------------------------------------------

IDENTITIES = {
    "center-of-mass-rates",
    "momentum-rates",
    "frame-rates",
    "weight-gradient",
    "coriolis-identities",
    "regressor-identity",
}


def check_proofs(scene: Scene) -> None:
    """Assert that all identities of the tree of bodies are proved for the structure of a scene."""
    findings = [one for one in prove_structure(scene, (), 1, 0) if one.claim in IDENTITIES]
    assert [str(one) for one in findings if one.verdict != "passed"] == []
    assert {one.claim for one in findings} == IDENTITIES


@pytest.mark.parametrize("links", range(1, 13))
@pytest.mark.parametrize("kind", [RandomTree, RandomMechanism], ids=lambda kind: kind.key)
@pytest.mark.sampled(6)
def test_identities_are_proved_for_random_mechanisms(kind: type[Scene], links: int, sized):
    for scene in islice(kind.structures(links), sized(3, 1)):
        check_proofs(scene)


@pytest.mark.parametrize("scene", [Sleigh(), Snake.coil(1), Snake.coil(3)], ids=str)
def test_identities_are_proved_for_trees_that_their_scenes_give_in_any_numbers(scene: Scene):
    """Of these two, terms and tree share no formula: M of the tree is that of the scene."""
    check_proofs(scene)


class FloatTree(Sleigh):
    """A sleigh with a tree in float64 alone."""

    def tree(self):
        return super().tree()


def test_a_tree_in_float64_alone_is_not_proved_against_its_terms():
    findings = [one for one in prove_structure(FloatTree(), (), 1, 0) if one.claim in IDENTITIES]
    assert {one.verdict for one in findings} == {"passed"}
    assert IDENTITIES - {one.claim for one in findings} == {
        "coriolis-identities",
        "regressor-identity",
    }


POINTS = ((3, 5), (5, 13)), ((4, 5), (-12, 13))
"""Cosines and sines of two angles, as fractions."""


@pytest.mark.parametrize(
    ("row", "shift", "known"),
    [
        ((0, 1, 2), 0, True),
        ((0, 0, 1), Fraction(1, 2), False),  # a point of the circle that is not known
        ((0, 0, 1), 0.0, False),
        ((0, 0, Fraction(1, 2)), 0, False),
        ((1, 0, 1), 0, False),  # no angle is known of the first coordinate
    ],
)
def test_exact_angles_of_joints_are_whole_sums_of_known_ones_without_a_shift(row, shift, known):
    model = tree_model(Sleigh())
    assert model is not None and model.plan.hinges == (2,)
    q = np.array([Fraction(k, 7) for k in (1, 2, 3)], object)
    cos, sin = (np.array([Fraction(x, y) for x, y in parts], object) for parts in POINTS)
    T = np.array([(1, 0, 0), (0, 1, 0), row], object)
    shifts = np.array([0, 0, shift], object)
    angles = summed_angles(model, T, shifts, q, [Angles(q[1:], cos, sin)])
    if not known:
        assert angles is None
        return
    point = (complex(float(c), float(s)) for c, s in zip(cos, sin, strict=True))
    first, second = point
    expected = first * second**2
    assert complex(float(angles.cos[0]), float(angles.sin[0])) == pytest.approx(expected)


class OwnTree(ChainPendulum):
    """A chain in the plane whose class has a tree of its own, of relative angles."""

    def tree(self):
        return super().tree()


def test_derivatives_of_weight_are_along_the_coordinates_of_the_scene():
    state = np.array([0.3, -0.8, 1.1]), np.array([0.5, 0.2, -0.9])
    scenes = ChainPendulum.rods(3), OwnTree.rods(3)
    model = tree_model(scenes[1])
    assert model is not None and model.tree is not None
    assert not np.array_equal(model.tree.coordinates, np.eye(3))
    points = [ConformancePoint(Evaluation(scene, *state), state[1]) for scene in scenes]
    one, other = (x.torque_derivatives for x in points)
    np.testing.assert_allclose(other, one, rtol=0.0, atol=1e-12)
    assert np.abs(one[:, :3]).max() > 1.0


class Geared(OwnTree):
    """The same with rotors at its joints."""

    def tree(self):
        tree = super().tree()
        return tree and tree._replace(armature=np.array([0.7, 0.2, 0.3]))


def test_torques_of_rotors_are_along_the_coordinates_of_the_scene():
    scene, vdot = Geared.rods(3), np.array([0.5, 0.2, -0.9])
    tree, model = scene.tree(), tree_model(scene)
    assert tree is not None and model is not None and model.tree is not None
    point = ConformancePoint(Evaluation(scene, [0.3, -0.8, 1.1], np.zeros(3)), vdot)
    expected = tree.coordinates.T @ (tree.armature * (tree.coordinates @ vdot))
    np.testing.assert_allclose(point.regressor.rotors, expected, rtol=1e-14)


@pytest.mark.parametrize("name", ["forward_dynamics", "forward_dynamics_derivatives"])
def test_accelerations_and_their_derivatives_are_those_under_the_forces_that_are_given(name: str):
    """Another function of ours, which has no quantities of a tree, says the same."""
    q, v, tau = np.array([[0.3, -0.8, 1.1], [0.5, 0.2, -0.9], [4.0, -7.0, 2.0]])
    scene = ChainPendulum.rods(3)
    point = ConformancePoint(Evaluation(scene, q, v), 1.0 - v, tau=tau)
    expected = eomcheck.quantity(scene, name, q, v, tau=tau)
    np.testing.assert_allclose(QUANTITIES[name].value(point, ""), expected, rtol=1e-11)


@pytest.mark.parametrize("key", WITH_TREE)
def test_a_tree_is_in_the_numbers_of_the_parameters(key: str):
    scene, balls = SCENES[key].example(), Balls()
    tree = scene.tree()
    exact = scene.tree(scene.parameters(balls))
    assert exact.mass.dtype == exact.center.dtype == exact.inertia.dtype == object
    for name in ("mass", "center", "inertia", "offset", "coordinates", "shift", "gravity"):
        numbers = [float(ball(x).mid()) for x in np.ravel(getattr(exact, name))]
        assert numbers == pytest.approx(np.ravel(getattr(tree, name)).tolist(), rel=1e-15), name
    assert [x.name for x in exact.frames] == [x.name for x in tree.frames]


@pytest.mark.night
@pytest.mark.parametrize(
    ("name", "free"), [*((x, False) for x in ROBOTS), *((x, True) for x in WALKING)]
)
def test_identities_are_proved_for_every_robot(name: str, free: bool):
    from eomcheck.scene_lookup import robot_named

    file = str(robot_path(name))
    check_proofs(robot_named(f"{file}:floating" if free else file)())


@pytest.mark.parametrize("name", ["following", "free-arm", "bicycle"])
def test_identities_are_proved_where_joints_follow_others_float_or_carry_wheels(name: str):
    check_proofs(subject(name)[0])


def test_identities_are_proved_where_angles_are_absolute():
    check_proofs(subject("chain-pendulum")[0])


@pytest.mark.parametrize("claim", ["regressor-identity", "coriolis-identities"])
@pytest.mark.parametrize("angle", [-3e8, 2.0**40, 1.7])
def test_joint_angles_are_known_to_the_rounding_of_the_angles_that_they_are_differences_of(
    claim: str, angle: float
):
    """Found by fuzzing: a difference of 3e8 rad has 8 digits, and its error was taken for wrong."""
    links = 7
    ones = np.ones(links)
    scene = Snake(ones, ones, 0.0 * ones, 0.0 * ones[1:], 0.0 * ones)
    q = np.array([*np.zeros(6), 1.7, angle, 0.0])
    v = np.array([-0.03, *(0.05 * np.array([0.5, -1.0, 1.0, -1.0, 1.0, -1.0, -0.7, 0.1]))])
    findings = eomcheck.check_state(scene, q, v, consistent=False, claims=[claim])
    assert {x.verdict for x in findings} == {"passed"}
    allowed = max(x.allowed for x in findings if x.subject in ("τ", "C v"))
    assert 1e-17 * abs(angle) < allowed < 1e-11 + 1e-13 * abs(angle)
