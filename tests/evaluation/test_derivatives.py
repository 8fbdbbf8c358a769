"""Derivatives of accelerations and multipliers: by every formulation, enclosed, by differences."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from tests.evaluation.test_redundant import CHAIN, RING
from tests.mechanics.descriptions import (
    GROUND,
    Ball,
    Branched,
    Driven,
    Free,
    Geared,
    Lifted,
    Marble,
    bent,
    turning,
)
from tests.robots import arm

import eomcheck
from eomcheck import Derivatives, acceleration, derivatives, enclose_derivatives, strategies
from eomcheck.claims.registry import GenericPoint
from eomcheck.descriptions.build import mechanism
from eomcheck.engines.pinocchio import PinocchioEngine
from eomcheck.errors import InconsistentVelocityError, InputError, RefusedError, UnknownNameError
from eomcheck.evaluation.certified import EnclosedDerivatives
from eomcheck.evaluation.derivatives import (
    ARRAYS,
    Direction,
    _sensitivities,
    inverse_dynamics_derivatives,
    solution_along,
    tangent_direction,
)
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import NOISES, acceleration_sensitivity, perturbed_samples
from eomcheck.evaluation.tolerance import allowed_error
from eomcheck.formulations import FORMULATIONS, applicable
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.ball import ball, precision
from eomcheck.numbers.batch_arrays import BatchArray, as_float64
from eomcheck.numbers.finite_field import FiniteField, random_prime
from eomcheck.numbers.linear import solve
from eomcheck.scenes import SCENES, ChainPendulum, Sleigh, Snake, from_urdf
from eomcheck.strategies import draw_samples

ON_CONSISTENT_STATES = [key for key, f in FORMULATIONS.items() if f.uses != "terms"]
every_scene = pytest.mark.parametrize("kind", SCENES.values(), ids=lambda kind: kind.key)


def usual_state(scene: Scene, seed: int = 0) -> State:
    """Return an ordinary state of a scene, in motion."""
    states = strategies.states(scene).map(lambda state: (state,))
    drawn = [state for (state,) in draw_samples(states, 8, seed)]
    return next((state for state in drawn if state.v.any()), drawn[0])


def snake(links: int) -> tuple[Snake, State]:
    """Return a snake of the paper's kind, coiled, in motion."""
    one, k = np.ones(links), np.arange(links)
    scene = Snake(one, one, one / 12, 10.0 * one[1:], 0.2 * np.cos(k))
    q = np.concatenate(([0.3, -0.2], np.radians(44.0) * (k + 1)))
    return scene, State(q, eomcheck.velocity(scene, q, [1.0, 0.3]))


def loads(scene: Scene, seed: int = 1) -> np.ndarray:
    """Return random generalized forces (n,)."""
    return np.random.default_rng(seed).normal(size=scene.n)


def directions(at: Evaluation, count: int = 3) -> list[Direction]:
    """Return random directions that keep the constraints at a state to first order."""
    rng, n = np.random.default_rng(2), at.scene.n
    partition = at.independent_partition if at.scene.r else None
    drawn = [Direction(*rng.normal(size=(3, n))) for _ in range(count)]
    return [tangent_direction(at, direction, partition) for direction in drawn]


def along(found: Derivatives, direction: Direction, prefix: str = "") -> np.ndarray:
    """Return the derivative of v̇, or with the prefix "multipliers_" of λ, along a direction."""
    parts = zip(Direction._fields, direction, strict=True)
    return np.sum([getattr(found, prefix + name) @ x for name, x in parts], axis=0)


def bound_along(found: Derivatives, direction: Direction, prefix: str = "") -> float:
    """Return the error bound of `along`."""
    parts = zip(Direction._fields, direction, strict=True)
    return sum(found.error_bounds[prefix + name] * np.abs(x).sum() for name, x in parts)


def assert_equal(x: Derivatives, y: Derivatives) -> None:
    for name in ARRAYS:
        one, other = getattr(x, name), getattr(y, name)
        if one is not None and other is not None:
            assert np.abs(one - other).max() <= x.error_bounds[name] + y.error_bounds[name], name


def assert_equal_along(x: Derivatives, y: Derivatives, direction: Direction) -> None:
    for prefix in ("", "multipliers_"):
        if prefix and (x.multipliers_q is None or y.multipliers_q is None):
            continue
        allowed = bound_along(x, direction, prefix) + bound_along(y, direction, prefix)
        assert np.abs(along(x, direction, prefix) - along(y, direction, prefix)).max() <= allowed


def assert_enclosed(found: Derivatives, truth: EnclosedDerivatives) -> None:
    with precision(truth.bits):
        for name, bound in found.error_bounds.items():
            pairs = zip(np.ravel(getattr(found, name)), np.ravel(getattr(truth, name)), strict=True)
            errors = [float(abs(ball(float(x)) - y).upper()) for x, y in pairs]
            assert max(errors) <= bound, name


# ---- Formulations --------------------------------------------------------------------------------


robots = pytest.mark.parametrize(
    ("links", "keys"),
    [
        (2, tuple(FORMULATIONS)),
        (7, tuple(FORMULATIONS)),
        (20, ("au", "em", "kane", "banded")),
        pytest.param(20, tuple(FORMULATIONS), marks=pytest.mark.night),
    ],
    ids=["2", "7", "20", "20, all"],
)


@robots
def test_all_formulations_agree_on_the_papers_robot_within_their_bounds(links, keys):
    scene, (q, v, _) = snake(links)
    found = {key: derivatives(scene, key, q, v, loads(scene)) for key in keys}
    reference = found["au"]
    tangent = directions(Evaluation(scene, q, v))
    for key, one in found.items():
        assert one.error_bound < 1e-6 * np.abs(one.q).max(), key
        if key not in ON_CONSISTENT_STATES:
            assert_equal(one, reference)
        for direction in tangent:
            assert_equal_along(one, reference, direction)


@robots
@pytest.mark.sampled(3)
def test_enclosures_contain_the_derivatives_of_the_papers_robot(links, keys):
    scene, (q, v, _) = snake(links)
    for key in keys:
        truth = enclose_derivatives(scene, key, q, v, loads(scene))
        assert truth.digits >= 30
        assert_enclosed(derivatives(scene, key, q, v, loads(scene)), truth)


@pytest.mark.sampled(3)
@every_scene
def test_all_formulations_agree_on_every_scene_within_their_bounds(kind):
    scene = kind.example()
    q, v, t = usual_state(scene)
    tau = loads(scene)
    at = Evaluation(scene, q, v, t)
    reference = derivatives(scene, "au", q, v, tau, t)
    assert_enclosed(reference, enclose_derivatives(scene, "au", q, v, tau, t))
    for key in applicable(scene):
        one = derivatives(scene, key, q, v, tau, t)
        if key not in ON_CONSISTENT_STATES:
            assert_equal(one, reference)
        for direction in directions(at):
            assert_equal_along(one, reference, direction)


@every_scene
def test_along_a_random_tangent_direction_all_formulations_agree_exactly(kind):
    source = random.Random(kind.key)
    field = FiniteField(random_prime(source), source)
    at = GenericPoint(kind.example(), field)
    at.tau = field.vector(at.scene.n)
    free = Direction(*(field.vector(at.scene.n) for _ in range(3)))
    tangent = tangent_direction(at, free)
    for direction, keys in ((tangent, applicable(kind)), (free, ("im", "el", "gw", "em", "uk"))):
        expected, forces = solution_along(at, FORMULATIONS["au"], direction)
        for key in keys:
            vdot, multipliers = solution_along(at, FORMULATIONS[key], direction)
            assert (vdot == expected).all(), key
            if multipliers is not None and forces is not None:
                assert (multipliers == forces).all(), key


@pytest.mark.parametrize("key", FORMULATIONS)
def test_additional_forces_act_as_their_derivative_says(key):
    scene, (q, v, _) = snake(5)
    tau, formulation = loads(scene), FORMULATIONS[key]
    found = derivatives(scene, key, q, v)
    without, acting = Evaluation(scene, q, v), Evaluation(scene, q, v)
    acting.tau = tau
    for part, slope in (("vdot", "tau"), ("multipliers", "multipliers_tau")):
        if slope not in found.error_bounds:
            continue
        one, other = (getattr(at.acceleration(formulation), part) for at in (without, acting))
        allowed = found.error_bounds[slope] * np.abs(tau).sum()
        for at in (without, acting):
            allowed += allowed_error(acceleration_sensitivity(at, formulation, part))
        assert np.abs(other - one - getattr(found, slope) @ tau).max() <= allowed
    public = acceleration(scene, key, q, v, tau=tau)
    assert (public.vdot == acting.acceleration(formulation).vdot).all()
    assert np.isfinite(public.error_bound)


# ---- Several values at once ----------------------------------------------------------------------


def solved(M: Any, force: Any, factor: Any) -> Any:
    """Return M⁻¹ (factor² force), after some operations."""
    return solve(M, factor * factor * force, "M")


def untraceable(M: Any, force: Any, factor: Any) -> Any:
    """Return the same by more than rational operations."""
    return solved(M, force, factor * float(np.sign(factor)))


def one_after_the_other(at: Evaluation, function: Callable, shared: tuple, factors: Any) -> Any:
    results, key = [], ("alone", False)
    for x in factors:
        with at.computing("quantity"), at.recording_solves(key) as recorder:
            results.append(as_float64(at.run(function, *shared, np.array(x))))
    at.solves[key] = {solve.name: solve for solve in recorder.solves}
    return np.stack(results)


@pytest.mark.parametrize("function", [solved, untraceable])
def test_values_at_once_are_those_of_one_after_the_other(function):
    scene, (q, v, _) = snake(3)
    at = Evaluation(scene, q, v)
    M, factors = at.terms.M, np.array([1.0, 2.0, 3.0])
    shared = M, at.F
    alone = one_after_the_other(at, function, shared, factors)
    assert np.allclose(at.run_for_each("x", function, shared, (factors,)), alone, 1e-12, 0.0)
    samples = perturbed_samples(at)
    with samples.computing("quantity"):
        several = samples.run_for_each("x", function, (samples.terms.M, samples.F), (factors,))
    alone = one_after_the_other(samples, function, (samples.terms.M, samples.F), factors)
    changes = np.abs(alone.data - alone.data.mean(axis=0)).max(axis=0)
    assert (changes > 0.0).all()
    share = 1e-3 if function is solved else 100.0  # the noise of one value after the other goes on
    assert (np.abs(several.data - alone.data).max(axis=0) <= share * changes).all()
    singular = 0.0 * M, at.F
    with pytest.raises(RefusedError, match="singular"):
        at.run_for_each("x", function, singular, (factors,))


# ---- Differences ---------------------------------------------------------------------------------

STEP = 2.0**-11


def difference(function: Callable[[float], np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return the derivative of a function at 0, extrapolated, and the error of the steps."""
    coarse, fine = ((function(h) - function(-h)) / (2 * h) for h in (STEP, STEP / 2))
    return (4 * fine - coarse) / 3, np.abs(fine - coarse)


DIFFERENT = {
    "a free base": (Free.example(), ("au", "kane")),
    "balls": (Ball.example(), ("au",)),
    "springs and dampers": (snake(3)[0], ("au", "em", "kane", "banded")),
    "a drive": (Driven.example(), ("au", "kane")),
    "a lift": (Lifted.example(), ("au", "ml")),
    "gears": (Geared.example(), ("au",)),
    "rolling on a table that turns": (Marble.example(), ("gw",)),
    "a turntable": (SCENES["turntable-ball"].example(), ("au", "kane")),
    "a bicycle": (SCENES["bicycle"].example(), ("im",)),
    "a ring": (SCENES["bricard"].example(), ("uk",)),
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", DIFFERENT)
def test_they_are_the_limits_of_differences_of_accelerations(name):
    scene, keys = DIFFERENT[name]
    q, v, t = usual_state(scene)
    tau = loads(scene)
    for key in keys:
        found = derivatives(scene, key, q, v, tau, t)
        rng, bound = np.random.default_rng(5), acceleration(scene, key, q, v, t).error_bound
        for part in Direction._fields:
            unit = rng.normal(size=scene.n)
            change = {x: unit if x == part else np.zeros(scene.n) for x in Direction._fields}

            def vdot(h, key=key, change=change):
                at = q + h * change["q"], v + h * change["v"], t
                more = {"consistent": False, "tau": tau + h * change["tau"]}
                return acceleration(scene, key, *at, **more).vdot

            expected, error = difference(vdot)
            allowed = error.max() + bound / STEP * 8 + bound_along(found, Direction(**change))
            actual = getattr(found, part) @ unit
            assert np.abs(actual - expected).max() <= allowed, (key, part)
            assert allowed < 0.01 * max(np.abs(actual).max(), 1.0), "steps decide nothing"


# ---- Redundant constraints -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("scene", "once", "state"),
    [
        (RING, replace(RING, redundant=None), RING.closed_state(0.5, 0.7)),
        (CHAIN, replace(CHAIN, repeated=None), CHAIN.initial_state()),
    ],
    ids=["ring", "four-bar"],
)
def test_redundant_rows_change_neither_the_motion_nor_the_forces_along_tangents(scene, once, state):
    q, v = state
    tau = loads(scene)
    found, expected = derivatives(scene, "uk", q, v, tau), derivatives(once, "au", q, v, tau)
    at, other = Evaluation(scene, q, v), Evaluation(once, q, v)
    at.tau = other.tau = tau
    solutions = at.acceleration(FORMULATIONS["uk"]), other.acceleration(FORMULATIONS["au"])
    for direction in directions(at):
        allowed = bound_along(found, direction) + bound_along(expected, direction)
        assert np.abs(along(found, direction) - along(expected, direction)).max() <= allowed

        def moved_rows(h: float, e: Evaluation, dq=direction.q) -> np.ndarray:
            return Evaluation(e.scene, e.q + h * dq, e.v).terms.a

        forces, error = [], 0.0
        for e, x, y in zip((at, other), solutions, (found, expected), strict=True):
            (change, inexact), lambda_ = difference(partial(moved_rows, e=e)), x.multipliers
            rate = along(y, direction, "multipliers_")
            forces.append(change.T @ lambda_ + e.terms.a.T @ rate)
            error += (inexact.T @ np.abs(lambda_)).max()
            error += bound_along(y, direction, "multipliers_") * np.abs(e.terms.a).sum()
            error += allowed_error(float((np.abs(e.terms.a.T) @ np.abs(lambda_)).max())) / STEP
        assert np.abs(forces[0] - forces[1]).max() <= error


# ---- Libraries -----------------------------------------------------------------------------------


Rotors = mechanism(
    "Rotors",
    [GROUND, bent("a"), bent("b")],
    [
        turning("α", "ground", "a", axis=(0.0, 1.0, 0.0), armature=0.3),
        turning("β", "a", "b", (1.0, 0.0, 0.0), axis=(1.0, 2.0, 0.0), armature=0.2),
    ],
)


def trees(path) -> dict[str, Any]:
    """Return scenes that are trees under gravity alone."""
    return {
        "arm.urdf": from_urdf(arm(path / "arm.urdf")),
        "Free": Free.example(),
        "Ball": Ball.example(),
        "Branched": Branched.example(),
        "with rotors": Rotors.example(),
    }


def test_pinocchio_has_the_same_derivatives_of_forward_and_inverse_dynamics(tmp_path):
    pin = pytest.importorskip("pinocchio")
    for name, scene in trees(tmp_path).items():
        q, v, _ = usual_state(scene)
        engine, tau = PinocchioEngine(scene), loads(scene)
        T = engine.coordinates
        back = np.linalg.inv(T)
        engine.model.gravity.linear = np.asarray(scene.gravity)
        x, xd = T @ q + engine.shift, T @ v
        pin.computeABADerivatives(engine.model, engine.data, x, xd, back.T @ tau)
        data = engine.data
        found = derivatives(scene, "au", q, v, tau)
        sizes = np.abs(back).sum(axis=1).max() * np.abs(T).sum(axis=1).max()
        for part, theirs in (
            ("q", back @ data.ddq_dq @ T),
            ("v", back @ data.ddq_dv @ T),
            ("tau", back @ (np.triu(data.Minv) + np.triu(data.Minv, 1).T) @ back.T),
        ):
            allowed = 2 * sizes * found.error_bounds[part]
            assert np.abs(getattr(found, part) - theirs).max() <= allowed, (name, part)
        vdot = loads(scene, 3)
        pin.computeRNEADerivatives(engine.model, engine.data, x, xd, T @ vdot)
        inverse = inverse_dynamics_derivatives(scene, q, v, vdot)
        for part, theirs in (("q", data.dtau_dq), ("v", data.dtau_dv)):
            allowed = 2 * sizes * inverse.error_bound
            assert np.abs(getattr(inverse, part) - T.T @ theirs @ T).max() <= allowed, (name, part)


@every_scene
def test_without_constraints_forward_derivatives_are_inverse_ones_through_the_mass(kind):
    scene = kind.example()
    q, v, t = usual_state(scene)
    if scene.r:
        return
    tau = loads(scene)
    found, at = derivatives(scene, "au", q, v, tau, t), Evaluation(scene, q, v, t)
    at.tau = tau
    vdot = at.acceleration(FORMULATIONS["au"]).vdot
    inverse = inverse_dynamics_derivatives(scene, q, v, vdot, t)
    M = at.terms.M
    weight = np.abs(M).sum(axis=1).max()
    for part in ("q", "v"):
        allowed = inverse.error_bound + weight * found.error_bounds[part]
        error = M @ getattr(found, part) + getattr(inverse, part)
        assert np.abs(error).max() <= allowed
    assert np.abs(M @ found.tau - np.eye(scene.n)).max() <= weight * found.error_bounds["tau"]


# ---- Arguments, refusals -------------------------------------------------------------------------


def test_without_constraints_there_are_no_multipliers():
    scene = ChainPendulum.example()
    q, v, _ = usual_state(scene)
    for key in applicable(scene):
        found = derivatives(scene, key, q, v)
        assert found.multipliers_q is found.multipliers_v is found.multipliers_tau is None
        assert found.error_bounds.keys() == {"q", "v", "tau"}
        assert found.error_bound == max(found.error_bounds.values())
        truth = enclose_derivatives(scene, key, q, v)
        assert truth.multipliers_q is None
        assert "multipliers_q=None" in repr(truth)


@pytest.mark.parametrize(
    ("part", "scene", "v"),
    [
        ("q", ChainPendulum.rods(2), (0.1, 0.2)),
        ("v", ChainPendulum([1e6, 2e6], [1.0, 1.0], [1e5, 1e5], gravity=None), (0.1, 0.2)),
        ("tau", ChainPendulum([1e-3, 2e-3], [1.0, 1.0], [1e-4, 1e-4], gravity=None), (0.1, 0.2)),
    ],
)
def test_the_bound_of_all_arrays_is_the_largest_of_their_own(part: str, scene: Scene, v: Any):
    found = derivatives(scene, "au", [0.3, -0.8], v)
    assert found.error_bound == max(found.error_bounds.values()) == found.error_bounds[part]


@pytest.mark.parametrize(
    ("part", "scene"),
    [("q", ChainPendulum.rods(2)), ("v", ChainPendulum([1.0, 1.0], [1.0, 1.0], [0.1, 0.1], None))],
)
def test_the_bound_of_inverse_dynamics_is_the_larger_one_of_both_arrays(part: str, scene: Scene):
    """Slow and without weight, derivatives by v are larger by 1 / v than those by q."""
    found = inverse_dynamics_derivatives(scene, [0.3, -0.8], [1e-3, 2e-3], [0.0, 0.0])
    assert found.error_bound == max(found.error_bounds.values()) == found.error_bounds[part]
    assert found.error_bounds["q"] != found.error_bounds["v"]


@pytest.mark.parametrize("call", [0, 1])
def test_changes_by_inputs_with_and_without_operations_both_count(call: int):
    """Perturbations of inputs and of operations may cancel: the larger change is the size."""
    at, exact = Evaluation(ChainPendulum.rods(2), [0.3, -0.8], [0.1, 0.2]), np.eye(2)
    calls: list[Evaluation] = []

    def rows(samples: Evaluation) -> dict[str, Any]:
        sizes = np.array([noise.step for noise in NOISES]) * (len(calls) == call)
        calls.append(samples)
        return {"q": BatchArray(exact + 10.0 * sizes[:, None, None])}

    sizes = _sensitivities(at, {"q": exact}, rows)
    assert len(calls) == 2 and sizes["q"] == pytest.approx(10.0, rel=0.2)


@pytest.mark.parametrize("function", [derivatives, enclose_derivatives])
def test_wrong_arguments_are_named(function):
    scene, (q, v, _) = snake(3)
    with pytest.raises(InputError, match=r"tau .*\(5,\)"):
        function(scene, "au", q, v, np.zeros(4))
    with pytest.raises(InputError, match="tau"):
        function(scene, "au", q, v, [0.0, np.nan, 0.0, 0.0, 0.0])
    with pytest.raises(InputError, match="q"):
        function(scene, "au", np.full(5, np.inf), v)
    with pytest.raises(UnknownNameError, match="kan"):
        function(scene, "kan", q, v)
    with pytest.raises(InputError, match="banded does not apply"):
        function(ChainPendulum.example(), "banded", np.zeros(3), np.zeros(3))
    with pytest.raises(InputError, match="vdot"):
        inverse_dynamics_derivatives(scene, q, v, np.zeros(4))


@pytest.mark.parametrize("key", ["kane", "ml"])
@pytest.mark.parametrize("angle", [np.pi / 2, -np.pi / 2])
def test_wheels_across_their_links_are_refused_by_formulations_in_speeds(key, angle):
    scene, (q, _, _) = snake(3)
    across = replace(scene, wheel_angle=np.array([0.1, angle, -0.2]))
    with pytest.raises(RefusedError, match="cos"):
        derivatives(across, key, q, np.zeros(5))
    assert np.isfinite(derivatives(across, "banded", q, np.zeros(5)).error_bound)


@pytest.mark.parametrize("key", FORMULATIONS)
def test_a_velocity_that_violates_constraints_is_refused_where_it_would_be_changed(key):
    scene, (q, v, _) = snake(3)
    wrong = v + np.array([0.0, 0.1, 0.0, 0.0, 0.0])
    if key in ON_CONSISTENT_STATES:
        with pytest.raises(InconsistentVelocityError, match="au and others"):
            derivatives(scene, key, q, wrong)
    else:
        truth = enclose_derivatives(scene, "au", q, wrong)
        assert_enclosed(derivatives(scene, "au", q, wrong), truth)
        assert_equal(derivatives(scene, key, q, wrong), derivatives(scene, "au", q, wrong))


def test_redundant_rows_are_named_where_a_formulation_cannot_have_them():
    with pytest.raises(RefusedError, match="redundant"):
        derivatives(RING, "au", *RING.closed_state(0.5, 0.7))


class Bare(Snake):
    """A snake whose chain takes no forces but its own."""

    chain_load = None


def test_a_chain_that_takes_no_forces_says_so():
    scene, (q, v, _) = snake(3)
    bare = Bare(scene.mass, scene.length, scene.inertia, scene.stiffness, scene.wheel_angle)
    with pytest.raises(InputError, match="chain_load"):
        derivatives(bare, "banded", q, v)
    assert derivatives(bare, "au", q, v).q.shape == (5, 5)


class Sticky(ChainPendulum):
    """A pendulum with forces that are not rational, which no trace can hold."""

    @staticmethod
    def forces(parameters, prepared, q, v):
        """Return Q (n,): sines of the velocities."""
        return -np.sin(v) * np.exp(q)


def test_functions_that_are_not_rational_are_differentiated_as_well():
    plain = ChainPendulum.example()
    scene = Sticky(*(getattr(plain, name) for name in ("mass", "length", "inertia")))
    q, v = np.array([0.3, -0.2, 0.5])[: scene.n], np.array([0.4, 0.1, -0.7])[: scene.n]
    found = derivatives(scene, "au", q, v)
    unit = loads(scene)
    for part in ("q", "v"):

        def vdot(h: float, part=part) -> np.ndarray:
            at = (q + h * unit, v) if part == "q" else (q, v + h * unit)
            return acceleration(scene, "au", *at).vdot

        expected, error = difference(vdot)
        rounding = acceleration(scene, "au", q, v).error_bound / STEP
        assert np.abs(getattr(found, part) @ unit - expected).max() <= error.max() + 8 * rounding


class Weighed(Sleigh):
    """A sleigh whose mass matrix is float64 at every state: it does not depend on any."""

    @staticmethod
    def terms(parameters, angle, q, v):
        """Return the terms with the mass matrix of a body about its centre."""
        M = np.diag([2.0, 2.0, 0.5])
        return Sleigh.terms(parameters, angle, q, v)._replace(M=M)


def test_constant_terms_may_be_float64():
    scene, q, v = Weighed(), np.array([0.1, 0.2, 0.3]), np.array([0.4, 0.1, -0.7])
    found = derivatives(scene, "au", q, v)
    at = Evaluation(scene, q, v)
    M, _, _, a, *_ = at.terms
    projected = np.linalg.inv(M)
    projected = projected - projected @ a.T @ np.linalg.solve(a @ projected @ a.T, a @ projected)
    assert np.abs(found.tau - projected).max() <= found.error_bounds["tau"]
