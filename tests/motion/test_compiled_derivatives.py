"""Derivatives in machine code against those of the public path, and what they refuse."""

from __future__ import annotations

import pickle
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.evaluation.test_derivatives import bound_along, directions, loads, snake, usual_state
from tests.evaluation.test_redundant import RING
from tests.mechanics.descriptions import Driven, Free

import eomcheck
from eomcheck import compile_derivatives, derivatives
from eomcheck.errors import InputError, UnknownNameError
from eomcheck.evaluation.derivatives import ARRAYS, Direction
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import allowed_error
from eomcheck.formulations import FORMULATIONS, Formulation
from eomcheck.mechanics.scene import Scene
from eomcheck.motion import compiled_derivatives
from eomcheck.motion.compiled_derivatives import CompiledResult, trace_derivatives
from eomcheck.numbers.tape import FACTORS, live_entries
from eomcheck.scenes import SCENES, ChainPendulum


def assert_compiled(scene: Scene, key: str, q, v, t: float = 0.0) -> None:
    """Check v̇, λ and their derivatives in machine code at a state."""
    tau = loads(scene)
    compiled, public = compile_derivatives(scene, key), derivatives(scene, key, q, v, tau, t)
    result = compiled(q, v, tau, t)
    for name in ARRAYS:
        actual, expected = getattr(result, name), getattr(public, name)
        assert (actual is None) == (expected is None), name
        if expected is not None:
            assert actual.shape == expected.shape
            # Sensitivities are the same, elimination is not: each side has its own rounding.
            assert np.abs(actual - expected).max() <= 2 * public.error_bounds[name], name
    at = Evaluation(scene, q, v, t)
    at.tau = tau
    solved = at.acceleration(FORMULATIONS[key])
    bound = eomcheck.acceleration(scene, key, q, v, t, consistent=False, tau=tau).error_bound
    assert np.abs(result.vdot - solved.vdot).max() <= 2 * bound
    assert (result.multipliers is None) == (public.multipliers_q is None)
    if result.multipliers is not None:
        assert result.multipliers.shape == (scene.r,)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("key", FORMULATIONS)
def test_the_papers_robot_by_every_formulation(key):
    scene, (q, v, _) = snake(3)
    assert_compiled(scene, key, q, v)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("key", ["au", "kane"])
@pytest.mark.parametrize(
    "kind",
    [*(SCENES[key] for key in ("chain-pendulum", "turntable-ball", "sleigh")), Driven, Free],
    ids=lambda kind: kind.key,
)
def test_other_scenes(kind, key):
    scene = kind.example()
    assert_compiled(scene, key, *usual_state(scene))


@pytest.mark.night
def test_redundant_rows_are_those_of_the_initial_state_or_of_another():
    q, v = RING.closed_state(0.5, 0.7)
    public = derivatives(RING, "uk", q, v)
    compiled = compile_derivatives(RING, "uk", q)(q, v)
    for name in ARRAYS:
        error = np.abs(getattr(compiled, name) - getattr(public, name)).max()
        assert error <= 2 * public.error_bounds[name], name
    # Other rows may be redundant there: the derivatives along tangents are the same.
    initial = compile_derivatives(RING, "uk")(q, v)
    for direction in directions(Evaluation(RING, q, v)):
        parts = tuple(zip(Direction._fields, direction, strict=True))
        one, other = (sum(getattr(x, name) @ y for name, y in parts) for x in (initial, public))
        assert np.abs(one - other).max() <= 2 * bound_along(public, direction)
    assert np.isnan(compile_derivatives(RING, "au")(q, v).q).any()


@pytest.mark.parametrize("key", ["im", "au", "kane", "ml"])
def test_each_matrix_is_factored_once(key):
    scene, _ = snake(3)
    traced = trace_derivatives(scene, FORMULATIONS[key], None)
    roots = [index for indices in traced.outputs.values() for index in indices]
    groups = [traced.tape.groups[number] for number in live_entries(traced.tape, roots)[1]]
    names = [group.name for group in groups if group.kind == FACTORS]
    assert len(names) == len(set(names)) >= 1


def test_many_states_are_differentiated_as_each_alone():
    scene, (q, v, _) = snake(2)
    compiled, rng = compile_derivatives(scene, "au"), np.random.default_rng(0)
    q, v, tau = (x + 0.1 * rng.normal(size=(5, scene.n)) for x in (q, v, loads(scene)))
    together = compiled(q, v, tau)
    assert together.q.shape == (5, scene.n, scene.n)
    assert np.shape(together.multipliers_tau) == (5, scene.r, scene.n)
    for i in range(5):
        alone = compiled(q[i], v[i], tau[i])
        for x, y in zip(together, alone, strict=True):
            assert x is not None and (x[i] == y).all()
    assert (compiled(q, v).vdot == compiled(q, v, np.zeros_like(q)).vdot).all()


def test_without_constraints_there_are_no_multipliers_in_machine_code():
    scene = ChainPendulum.example()
    result = compile_derivatives(scene, "au")(np.zeros(3), np.zeros(3))
    assert result.multipliers is result.multipliers_q is result.multipliers_tau is None
    M = Evaluation(scene, np.zeros(3), np.zeros(3)).terms.M
    inverse = np.linalg.inv(M)
    size = np.linalg.cond(M) * np.abs(inverse).max()
    assert np.abs(result.tau - inverse).max() <= allowed_error(size)


def test_parameters_are_read_from_memory():
    one, (q, v, _) = snake(3)
    other = replace(one, mass=2.0 * one.mass, inertia=2.0 * one.inertia)
    first, second = (compile_derivatives(scene, "au") for scene in (one, other))
    assert first.kernel is second.kernel
    assert (first(q, v).tau == 2.0 * second(q, v).tau).all()


def test_the_time_counts():
    scene = SCENES["turntable-ball"].example()
    q, v, _ = usual_state(scene)
    compiled = compile_derivatives(scene, "au")
    for t in (0.0, 1.0):
        public = derivatives(scene, "au", q, v, t=t)
        assert np.abs(compiled(q, v, t=t).q - public.q).max() <= 2 * public.error_bounds["q"]
    assert (compiled(q, v, t=0.0).q != compiled(q, v, t=1.0).q).any()
    both = compiled(np.array([q, q]), np.array([v, v]), t=1.0)
    np.testing.assert_allclose(both.q[1], compiled(q, v, t=1.0).q, rtol=1e-12)


def test_wrong_shapes_are_named():
    scene, (q, v, _) = snake(2)
    compiled = compile_derivatives(scene, "au")
    with pytest.raises(InputError, match=r"q has shape \(3,\), expected \(4,\) or \(k, 4\)"):
        compiled(q[:3], v)
    with pytest.raises(InputError, match="v"):
        compiled(q, v[:3])
    with pytest.raises(InputError, match="tau"):
        compiled(q, v, np.zeros(3))
    with pytest.raises(InputError, match="v"):
        compiled(np.array([q, q]), v)
    with pytest.raises(InputError, match="t"):
        compiled(q, v, t=np.nan)
    with pytest.raises(UnknownNameError, match="kan"):
        compile_derivatives(scene, "kan")
    with pytest.raises(InputError, match="banded does not apply"):
        compile_derivatives(ChainPendulum.example(), "banded")


@pytest.mark.parametrize("key", ["au", "uk"])
@pytest.mark.parametrize("q", [[1], [np.nan] * 6])
def test_coordinates_are_checked_for_every_formulation(key: str, q: list[float]):
    with pytest.raises(InputError, match=r"^q"):
        compile_derivatives(RING, key, q)


# ---- One state per call --------------------------------------------------------------------------


def assert_same(one: CompiledResult, other: CompiledResult) -> None:
    for x, y in zip(one, other, strict=True):
        assert (x is None) == (y is None)
        assert x is None or y is None or np.array_equal(x, y)


@pytest.mark.parametrize("key", ["au", "kane"])
def test_a_state_of_arrays_is_that_of_lists_and_its_result_is_kept(key):
    scene, (q, v, _) = snake(3)
    compiled, tau = compile_derivatives(scene, key), loads(scene)
    for forces in (tau, None, 2 * tau):
        listed = None if forces is None else forces.tolist()
        expected = compiled(q.tolist(), v.tolist(), listed, 0.5)
        result = compiled(q, v, forces, 0.5)
        compiled(v, q, tau)
        assert_same(result, expected)
    for bad in (np.full_like(v, np.nan), np.full_like(v, np.inf)):
        with pytest.raises(InputError, match="expected a finite number"):
            compiled(q, bad)


def test_a_pickled_function_is_compiled_again():
    scene, (q, v, _) = snake(3)
    compiled = compile_derivatives(scene, "au")
    assert_same(pickle.loads(pickle.dumps(compiled))(q, v), compiled(q, v))


def test_a_pickled_function_has_the_same_redundant_rows(monkeypatch):
    """They are those of the state that was given, not those of the initial one."""
    choices = []

    def kernel(scene: Scene, formulation: Formulation, choice: Any = None) -> SimpleNamespace:
        choices.append(repr(choice))
        return SimpleNamespace(size=0, outputs={}, bound=lambda *_: None)

    monkeypatch.setattr(compiled_derivatives, "derivatives_kernel", kernel)
    monkeypatch.setattr(compiled_derivatives, "block_of", lambda *_: None)
    one = compile_derivatives(RING, "uk", RING.closed_state(0.5, 0.7)[0])
    pickle.loads(pickle.dumps(one))
    compile_derivatives(RING, "uk")
    given, again, initial = choices
    assert given == again != initial


def test_redundant_rows_are_those_of_the_time_that_is_given(monkeypatch):
    states = []

    def chosen(at: Evaluation, formulation: Formulation) -> None:
        states.append((at.q.tolist(), at.t))

    monkeypatch.setattr(compiled_derivatives, "choice_for", chosen)
    monkeypatch.setattr(compiled_derivatives, "CompiledDerivatives", lambda *_: None)
    q = RING.closed_state(0.5, 0.7)[0]
    compile_derivatives(RING, "uk", q, 0.25)
    compile_derivatives(RING, "uk")
    assert states == [(q.tolist(), 0.25), (RING.initial_state()[0].tolist(), 0.0)]


def test_compiling_for_long_is_announced(monkeypatch):
    announced = []

    def notice(what: str) -> AbstractContextManager[None]:
        announced.append(what)
        return nullcontext()

    monkeypatch.setattr("eomcheck.motion.compiled_derivatives.slow_work_notice", notice)
    compile_derivatives(ChainPendulum.example(), "au")
    assert announced == ["compiling the derivatives of chain-pendulum[3] by au"]
