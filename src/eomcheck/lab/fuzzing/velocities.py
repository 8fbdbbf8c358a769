"""Velocities that keep the constraints, of many states at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from eomcheck.errors import EomcheckError, RefusedError
from eomcheck.evaluation.batched_evaluation import LaneEvaluation
from eomcheck.evaluation.dynamics import check_consistent, consistent_velocity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import allowed_error
from eomcheck.lab.fuzzing.families import Case
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array
from eomcheck.numbers.lanes import LaneArray
from eomcheck.numbers.linear import least_squares

SAFE = 1 / 4
"""Share of what rounding allows that a velocity violates constraints by at most."""


def consistent(
    scenes: Sequence[Scene], states: Sequence[State], velocities: Callable[[LaneEvaluation], Array]
) -> tuple[list[Case], list[int]]:
    """Return cases with velocities that keep the constraints, and which they are of those given.

    Args:
        scenes: scenes of one structure.
        states: where they are; velocities do not matter.
        velocities: wished for (L, n), by the evaluation at these states.
    """
    if not scenes:
        return [], []
    at = _terms_of(scenes, states)
    with np.errstate(all="ignore"):
        finite = np.isfinite(at.q.data).all(axis=0)  # type: ignore[attr-defined]
        for term in (at.terms.a, at.terms.b):
            if term is not None:
                finite &= np.isfinite(term.data).reshape(-1, at.lanes).all(axis=0)
    if not finite.all():
        kept = np.flatnonzero(finite).tolist()
        picked = [scenes[i] for i in kept], [states[i] for i in kept]

        def some(of: LaneEvaluation) -> Array:
            return velocities(at)[kept]

        cases, places = consistent(*picked, some)
        return cases, [kept[i] for i in places]
    with np.errstate(all="ignore"):
        v = LaneArray(np.ascontiguousarray(velocities(at).T))
        good: Any = np.isfinite(v.data).all(axis=0)
        if at.terms.a is not None:
            v.data[:, ~good] = 0.0
            for _ in range(2):
                v = v - least_squares(at.terms.a, _residual(at, v))
            good &= _is_consistent(at, v)
    cases, places = [], []
    for i, (scene, state) in enumerate(zip(scenes, states, strict=True)):
        here = v.data[:, i].copy()
        if not good[i] and not (np.isfinite(here).all() and _mended(scene, state, here)):
            continue
        cases.append((scene, State(state.q, here, state.t)))
        places.append(i)
    return cases, places


class _Stacked(NamedTuple):
    """What of lanes velocities follow from, where terms were found state by state."""

    q: Any
    lanes: int
    terms: Any


def _terms_of(scenes: Sequence[Scene], states: Sequence[State]) -> Any:
    """Return the evaluation in lanes, or of functions that no lanes can run what stands for it."""
    at = LaneEvaluation(scenes, states)
    try:
        at.terms  # noqa: B018
    except TypeError:
        return _Stacked(at.q, at.lanes, _stacked_terms(scenes, states))
    return at


def _stacked_terms(scenes: Sequence[Scene], states: Sequence[State]) -> Any:
    """Return a and b in lanes, found state by state: NaN where a function of the scene raises."""
    found: list[Any] = []
    for scene, state in zip(scenes, states, strict=True):
        terms = None
        with suppress(Exception):  # somebody's functions; `check` tells which
            terms = Evaluation(scene, *state).terms
        found.append(terms)
    whole = next((terms for terms in found if terms is not None), None)
    parts: dict[str, Any] = {"a": None, "b": None}
    for name in parts:
        like = None if whole is None else getattr(whole, name)
        if like is not None:
            lost = np.full(like.shape, np.nan)
            each = [lost if terms is None else getattr(terms, name) for terms in found]
            parts[name] = LaneArray(np.stack(each, axis=-1))
    return SimpleNamespace(**parts)


def _residual(at: LaneEvaluation, v: LaneArray) -> LaneArray:
    a, b = at.terms.a, at.terms.b
    return a @ v if b is None else a @ v + b


def _is_consistent(at: LaneEvaluation, v: LaneArray) -> Array:
    a, b = at.terms.a, at.terms.b
    size = np.abs(a) @ np.abs(v) + (0.0 if b is None else np.abs(b))
    violation = np.abs(_residual(at, v)).data
    return (violation <= SAFE * allowed_error(1.0) * size.data).all(axis=0)


def _mended(scene: Scene, state: State, v: Array) -> bool:
    """Make v (n,) consistent in place, as the single path does; return whether it is."""
    try:
        with np.errstate(all="ignore"):
            found = consistent_velocity(Evaluation(scene, state.q, v, state.t), v)
            check_consistent(Evaluation(scene, state.q, found, state.t))
    except (EomcheckError, RefusedError, np.linalg.LinAlgError):
        return False
    v[:] = found
    return True
