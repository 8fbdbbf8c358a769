"""Scenes of a user's own: without constraints, and with constraints that do not vanish at rest."""

from __future__ import annotations

from inspect import unwrap
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given

from eomcheck import (
    acceleration,
    accuracy,
    check_state,
    enclose,
    prove,
    simulate,
    speeds_of,
    strategies,
    validate,
    velocity,
)
from eomcheck.claims.user_scenes import scene_function_that_raised
from eomcheck.engines import ALWAYS, ENGINES, Answers, EngineAcceleration
from eomcheck.errors import EngineError, InconsistentVelocityError, InputError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import acceleration_sensitivity
from eomcheck.evaluation.tolerance import allowed_error
from eomcheck.formulations import FORMULATIONS, applicable, formulations_for
from eomcheck.mechanics.records import Bodies, Speeds, Terms
from eomcheck.mechanics.scene import Scene
from eomcheck.motion.right_hand_side import RightHandSide
from eomcheck.numbers.generic import NotRationalError, generic
from eomcheck.scenes import Sleigh, Snake


class Masses(NamedTuple):
    mass: Any
    inertia: Any
    stiffness: Any
    belt: Any


class Pulled(NamedTuple):
    force: Any


def spring_force(parameters, x):
    return -parameters.stiffness * x


class Point(Scene):
    """Two coordinates of one point mass on springs; whatever differs is below."""

    conserves_energy = False
    angle_coordinates = slice(0, 0)
    n = 2
    coordinate_names = ("x", "y")

    def __init__(self, mass: float = 2.0, stiffness: tuple = (3.0, 5.0), belt: float = 0.75):
        self._values = ([mass], np.zeros(0), stiffness, [belt])

    def parameters(self, arithmetic):
        return Masses(*(arithmetic.numbers(np.asarray(x)) for x in self._values))

    @staticmethod
    def velocities(parameters, angles, q, v):
        return v.reshape(1, 2), v[:0].reshape(1, 0)

    @staticmethod
    def energies(parameters, angles, q, v):
        k = parameters.stiffness
        T = parameters.mass[0] * (v[0] * v[0] + v[1] * v[1]) / 2
        return T, (k[0] * q[0] * q[0] + k[1] * q[1] * q[1]) / 2


class Free(Point):
    """On springs in both directions, without a constraint."""

    key = "free"
    name = "free point"
    conserves_energy = True
    r = 0
    constraint_names = ()

    def initial_state(self):
        return np.array([1.0, 2.0]), np.array([0.5, 0.0])

    @staticmethod
    def terms(parameters, angles, q, v):
        M = parameters.mass[0] * np.eye(2)
        return Terms(M, spring_force(parameters, q), None, None, None, None)

    @staticmethod
    def kinematics(parameters, angles, q, u):
        return Pulled(spring_force(parameters, q))

    @staticmethod
    def speeds(parameters, angles, kinematics):
        return Speeds(np.eye(2), np.zeros(2), None)

    @staticmethod
    def bodies(parameters, angles, kinematics):
        return Bodies(
            np.eye(2).reshape(1, 2, 2),
            np.zeros((1, 0, 2)),
            np.zeros((1, 2)),
            np.zeros((1, 0)),
            parameters.mass,
            np.zeros((1, 0, 0)),
            None,
            kinematics.force,
        )

    @staticmethod
    def speeds_of(parameters, angles, q, v):
        return v.copy()

    @staticmethod
    def constraint(parameters, angles, q, v):
        return None

    @staticmethod
    def constraints(parameters, angles, q):
        return None, None


class OnBelt(Point):
    """On a spring in x, while a belt takes it along in y at a given velocity."""

    key = "on-belt"
    name = "point on a belt"
    r = 1
    constraint_names = ("belt",)

    def initial_state(self):
        return np.array([1.0, 2.0]), np.array([0.5, self._values[3][0]])

    @staticmethod
    def terms(parameters, angles, q, v):
        M = parameters.mass[0] * np.eye(2)
        a = np.array([[0.0, 1.0]])
        return Terms(M, spring_force(parameters, q), None, a, np.zeros(1), -parameters.belt)

    @staticmethod
    def kinematics(parameters, angles, q, u):
        return Pulled(spring_force(parameters, q)[:1])

    @staticmethod
    def speeds(parameters, angles, kinematics):
        offset = np.array([0.0, parameters.belt[0]])
        return Speeds(np.array([[1.0], [0.0]]), np.zeros(2), offset)

    @staticmethod
    def bodies(parameters, angles, kinematics):
        return Bodies(
            np.array([[[1.0], [0.0]]]),
            np.zeros((1, 0, 1)),
            np.zeros((1, 2)),
            np.zeros((1, 0)),
            parameters.mass,
            np.zeros((1, 0, 0)),
            None,
            kinematics.force,
        )

    @staticmethod
    def speeds_of(parameters, angles, q, v):
        return v[:1]

    @staticmethod
    def constraint(parameters, angles, q, v):
        return v[1:] - parameters.belt


@generic
def free_terms(parameters, angles, q, v):
    """Return the terms of the free point."""
    M = np.zeros((2, 2), q.dtype)
    M[0, 0] = M[1, 1] = parameters.mass[0]
    return Terms(M, -parameters.stiffness * q, None, None, None, None)


@generic
def free_kinematics(parameters, angles, q, u):
    """Return the force."""
    return Pulled(-parameters.stiffness * q)


@generic
def free_speeds(parameters, angles, kinematics):
    """Return u = v."""
    W = np.zeros((2, 2), kinematics.force.dtype)
    W[0, 0] = W[1, 1] = 1
    return Speeds(W, np.zeros(2, W.dtype), None)


@generic
def free_bodies(parameters, angles, kinematics):
    """Return one body that does not turn."""
    partial = np.zeros((1, 2, 2), kinematics.force.dtype)
    partial[0, 0, 0] = partial[0, 1, 1] = 1
    none = np.zeros((1, 0, 2), partial.dtype)
    rest = np.zeros((1, 2), partial.dtype)
    inertia = np.zeros((1, 1, 1), partial.dtype)
    return Bodies(
        partial,
        none,
        rest,
        rest[:, :0],
        parameters.mass,
        inertia[:, :0, :0],
        None,
        kinematics.force,
    )


@generic
def free_speeds_of(parameters, angles, q, v):
    """Return u = v."""
    return v + 0


class MarkedFree(Free):
    """The free point, of functions marked as generic."""

    key = "marked-free"
    angle_coordinates = slice(0, 0)
    terms = staticmethod(free_terms)
    kinematics = staticmethod(free_kinematics)
    speeds = staticmethod(free_speeds)
    bodies = staticmethod(free_bodies)
    speeds_of = staticmethod(free_speeds_of)


def test_functions_are_taken_by_name_and_those_of_the_class_body_stay():
    def own(parameters, prepared, q, v):
        return None

    named = {"terms": free_terms, "bodies": free_bodies, "tree": own, "no_function": own}

    class Named(Free, functions=named):
        terms = staticmethod(own)

    assert unwrap(Named.terms) is own  # calls of somebody's functions are guarded
    assert unwrap(Named.bodies) is free_bodies
    assert Named.speeds is Free.speeds
    assert Named.tree is Free.tree
    assert not hasattr(Named, "no_function")


def test_a_scene_of_a_namespace_without_a_name_is_somebodys_own():
    space = {"Free": Free, "terms": free_terms}
    exec("class Nameless(Free):\n    def terms(*x): return Free.terms(*x)", space)
    nameless = space["Nameless"]
    assert isinstance(nameless, type)
    assert nameless.terms is not unwrap(nameless.terms)


def as_it_is(key: str) -> bool:
    """Return whether a formulation puts no number into an array that a scene made for doubles."""
    return key != "kane"


@pytest.mark.parametrize(
    ("kind", "key"),
    [
        (kind, key)
        for kind in (Free, MarkedFree)
        for key in applicable(kind)
        if kind is MarkedFree or as_it_is(key)
    ],
)
def test_a_scene_without_constraints_moves_freely_in_machine_code(kind, key):
    scene, y = kind(), np.array([1.0, 2.0, 0.5, -0.5])
    result = acceleration(scene, key, y[:2], y[2:])
    assert result.vdot.tolist() == [-1.5, -5.0]
    assert result.multipliers is None
    rates = RightHandSide(scene, FORMULATIONS[key])(0.0, y)
    assert rates.tolist() == [0.5, -0.5, -1.5, -5.0]
    found = simulate(scene, key, 1.0, rtol=1e-12, atol=1e-12, q0=y[:2], v0=y[2:])
    swing = np.sqrt([1.5, 2.5])
    expected = y[:2] * np.cos(swing) + y[2:] / swing * np.sin(swing)
    assert np.abs(found.q[-1] - expected).max() < 1e-10


def test_a_scene_that_makes_arrays_of_doubles_hears_what_machine_code_needs():
    with pytest.raises(NotRationalError, match="array of doubles: give it their dtype"):
        simulate(Free(), "kane", 1.0)


@pytest.mark.parametrize(
    "key", [f.key for f in applicable(OnBelt).values() if not f.partitioned and as_it_is(f.key)]
)
def test_a_scene_whose_functions_nobody_marked_moves_in_machine_code(key):
    found = simulate(OnBelt(), key, 1.0, rtol=1e-12, atol=1e-12)
    assert found.status == "finished"
    assert found.v[:, 1] == pytest.approx(0.75, abs=1e-14)
    swing = np.sqrt(1.5)
    expected = np.cos(swing) + 0.5 / swing * np.sin(swing)
    assert found.q[-1] == pytest.approx([expected, 2.75], abs=1e-10)


SCENES = [Free(), OnBelt()]
scenes = pytest.mark.parametrize("scene", SCENES, ids=lambda s: s.key)
every_formulation = pytest.mark.parametrize("key", applicable(OnBelt))
every_engine = pytest.mark.parametrize("engine", ALWAYS)


def test_every_formulation_finds_the_free_motion_and_no_multipliers():
    for key in applicable(Free):
        result = acceleration(Free(), key, [1.0, 2.0], [0.5, -0.5])
        assert result.vdot.tolist() == [-1.5, -5.0], key
        assert result.multipliers is None, key
        assert 0 < result.error_bound < 1e-12, key


@pytest.mark.parametrize("key", [f.key for f in applicable(OnBelt).values() if not f.partitioned])
def test_every_formulation_finds_the_motion_on_the_belt_and_the_force_that_it_takes(key):
    result = acceleration(OnBelt(), key, [1.0, 2.0], [0.5, 0.75])
    assert result.vdot.tolist() == [-1.5, 0.0]
    # 2 kg · 0 m/s² = -5 N/m · 2 m + λ
    assert result.multipliers is None or result.multipliers.tolist() == [10.0]


@pytest.mark.parametrize("key", [f.key for f in applicable(OnBelt).values() if f.partitioned])
def test_a_pivoted_partition_finds_the_column_that_the_belt_constrains(key):
    result = acceleration(OnBelt(), key, [1.0, 2.0], [0.5, 0.75], pivoted=True)
    assert result.vdot.tolist() == [-1.5, 0.0]
    assert acceleration(Free(), key, [1.0, 2.0], [0.0, 0.0], pivoted=True).multipliers is None


@every_formulation
def test_rest_is_inconsistent_on_a_belt_that_moves(key):
    with pytest.raises(InconsistentVelocityError, match="belt"):
        acceleration(OnBelt(), key, [1.0, 2.0], [0.5, 0.0])


@every_formulation
def test_without_constraints_every_velocity_is_consistent(key):
    assert acceleration(Free(), key, [0.0, 0.0], [1e9, -1e-9]).vdot.tolist() == [0.0, 0.0]


def test_velocities_and_speeds_of_scenes_with_and_without_an_offset_are_inverse():
    assert velocity(Free(), [0.0, 0.0], [3.0, 4.0]).tolist() == [3.0, 4.0]
    assert velocity(OnBelt(), [0.0, 0.0], [3.0]).tolist() == [3.0, 0.75]
    assert speeds_of(Free(), [0.0, 0.0], [3.0, 4.0]).tolist() == [3.0, 4.0]
    assert speeds_of(OnBelt(), [0.0, 0.0], [3.0, 0.75]).tolist() == [3.0]


@scenes
def test_states_of_a_scene_of_ones_own_can_be_drawn_and_are_consistent(scene):
    @given(strategies.states(scene))
    def solved(state):
        results = [
            acceleration(scene, f.key, state.q, state.v, pivoted=f.partitioned)
            for f in applicable(scene).values()
        ]
        for first, second in combinations(results, 2):
            allowed = first.error_bound + second.error_bound
            assert np.abs(first.vdot - second.vdot).max() <= allowed

    solved()


@scenes
@every_engine
def test_engines_have_the_acceleration_of_a_scene_of_ones_own_or_say_that_they_cannot(
    scene, engine
):
    q, v = scene.initial_state()
    if not ENGINES[engine].represents(scene):
        with pytest.raises(EngineError, match=scene.name):
            ENGINES[engine](scene)
        return
    at = Evaluation(scene, q, v)
    found: EngineAcceleration = Answers(ENGINES[engine](scene)).acceleration(
        q, v, at.terms.Q, at.terms.a, at.terms.gamma
    )
    expected = at.acceleration(FORMULATIONS["au"])
    allowed = allowed_error(acceleration_sensitivity(at, FORMULATIONS["au"], coordinates=True))
    assert np.abs(found.vdot - expected.vdot).max() <= allowed
    assert (found.multipliers is None) == (expected.multipliers is None)


@pytest.mark.night
@scenes
def test_a_right_scene_of_ones_own_passes_every_claim(scene):
    findings = validate(scene, examples=10)
    assert [str(f) for f in findings if f.verdict == "failed"] == []
    passed = {f.claim for f in findings if f.verdict == "passed"}
    assert {"mass-matrix", "equivalence", "engine-acceleration"} <= passed


REST = [1.0, 2.0], [0.0, 0.75]
ASKED = {
    "acceleration": lambda: acceleration(OnBelt(), "banded", *REST),
    "enclose": lambda: enclose(OnBelt(), "banded", REST[0], [0.0]),
    "accuracy": lambda: accuracy(OnBelt(), "banded", REST[0], [0.0]),
    "check": lambda: check_state(OnBelt(), *REST, formulations=["banded"]),
    "validate": lambda: validate(OnBelt(), examples=1, formulations=["banded"]),
    "prove": lambda: prove(OnBelt(), formulations=["banded"]),
    "simulate": lambda: simulate(OnBelt(), "banded", 1.0),
}


@pytest.mark.parametrize("asked", ASKED)
def test_a_scene_that_is_no_chain_says_so_wherever_banded_is_asked_of_it(asked):
    with pytest.raises(InputError, match="banded does not apply to the scene on-belt") as caught:
        ASKED[asked]()
    assert "gives no chain; those that apply: im, au, " in str(caught.value)


def test_every_formulation_but_banded_applies_to_a_scene_that_is_no_chain():
    assert FORMULATIONS.keys() - applicable(OnBelt) == {"banded"}
    assert formulations_for(OnBelt()) == tuple(applicable(OnBelt()).values())


class WrongMass(Free):
    """M is half of what the kinetic energy says."""

    @staticmethod
    def terms(parameters, angles, q, v):
        terms = Free.terms(parameters, angles, q, v)
        return terms._replace(M=terms.M / 2)


def test_a_wrong_term_of_a_scene_of_ones_own_is_found_by_name():
    q, v = WrongMass().initial_state()
    failed = {f.claim for f in check_state(WrongMass(), q, v) if f.verdict == "failed"}
    assert {"mass-matrix", "kinetic-energy"} <= failed


def test_a_scene_that_lacks_a_part_of_the_contract_cannot_be_made():
    class Half(Scene):
        key = "half"

    with pytest.raises(TypeError, match="abstract"):
        Half()


def test_of_functions_of_a_scene_that_call_each_other_the_one_that_raises_is_named():
    class Own(Sleigh):
        @staticmethod
        def helper():
            raise ValueError("no number")

        @staticmethod
        def constraint(parameters, prepared, q, v):
            return Own.helper()

    with pytest.raises(ValueError, match="no number") as raised:
        Own.constraint(None, None, None, None)
    said = scene_function_that_raised(Own.example(), raised.value)
    assert said.startswith("Own.helper raised ValueError: no number (test_own_scene.py, line ")


class WithoutQ(Snake):
    """A snake whose terms leave its forces out, and whose bodies do not."""

    @staticmethod
    def terms(*state):
        return Snake.terms(*state)._replace(Q=None)


class WithoutActive(Snake):
    """A snake whose bodies leave their active forces out, and whose terms do not."""

    @staticmethod
    def bodies(*state):
        return Snake.bodies(*state)._replace(force=None)


@pytest.mark.parametrize("kind", [WithoutQ, WithoutActive])
def test_forces_that_one_of_two_derivations_leaves_out_fail_by_name(kind):
    scene = kind.example()
    q, v = scene.initial_state()[:2]
    claims = ["generalized-forces", "active-forces"]
    found = check_state(scene, q, v, engines=["casadi"], claims=claims)
    failed = [(one.claim, one.subject) for one in found if one.verdict == "failed"]
    expected = [("active-forces", "kane")]
    if kind is WithoutQ:
        expected.insert(0, ("generalized-forces", "casadi"))
    assert failed == expected


def test_forces_that_nobody_has_are_not_compared():
    state = Sleigh().initial_state()
    (skipped,) = check_state(Sleigh(), *state, claims=["generalized-forces"])
    assert skipped.detail == "needs forces, and an engine that offers forces"
