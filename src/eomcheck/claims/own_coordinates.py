"""Diagnoses of engines with coordinates of their own: wrong maps, and wrong derivatives.

An engine has velocities w = S v (`Engine.velocity_map`), such as those of a free base along its own
axes. An answer that is wrong in the scene's coordinates may come from the map: Ṡ v and the
derivatives of S v are compared with differences of S v, to the error that two steps show. Or it is
wrong itself: then it is mapped back, because a confusion of a library's convention (other axes,
other variables that are constant) is a simple one in the library's coordinates alone.

Nothing is judged here: all of it explains failures.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import product

import numpy as np

from eomcheck.claims.confusions import (
    ConfusionContext,
    agree_everywhere,
    agreement_within,
    locate,
    recognize,
)
from eomcheck.descriptions.joint_tree import Topology
from eomcheck.engines import Answers, Engine
from eomcheck.engines.answers import DIFFERENCE, DerivativeMap, mass_size
from eomcheck.evaluation.conformance import ConformancePoint, Quantity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import C, allowed_error, largest
from eomcheck.numbers.generic import Array

# ---- The map -------------------------------------------------------------------------------------


def map_fault(engine: Engine, at: Evaluation) -> str:
    """Return the part of the map of an engine that is wrong, as text; "" if none is known to be.

    Args:
        engine: the engine.
        at: the state; the map is compared at its velocity and at one that is not 0.
    """
    if not engine.offers("velocity_map"):
        return ""
    answers, moving = Answers(engine), np.cos(1.0 + np.arange(at.scene.n))
    faults = (_map_fault_at(answers, at, v) for v in (at.v, moving))
    return next(filter(None, faults), "")


def _map_fault_at(answers: Answers, at: Evaluation, v: Array) -> str:
    """Return the part of a map that is wrong at a velocity, as text; see `map_fault`."""
    q = at.q

    def own_velocity(position: Array) -> Array:
        return answers.velocity_map(position, v).S @ v

    def rate(position: Array) -> Array:
        return answers.velocity_map(position, v).rest

    u = at.unit_roundoff
    expected = _difference(own_velocity, q, v, u)
    if what := _unlike(rate(q), *expected):
        return f"velocity_map: Ṡ v is not the rate of S v: {what}"
    if what := _other_axes(answers, at):
        return f"velocity_map: S is right with {what}"
    if not answers.engine.offers("velocity_map_derivatives"):
        return ""
    along, more = answers.map_derivatives(q, v)
    parts = {"∂(S v)/∂q": (along, own_velocity), "∂(Ṡ v)/∂q": (more, rate)}
    for name, (array, function) in parts.items():
        columns = [_difference(function, q, unit, u) for unit in np.eye(len(q))]
        expected = np.column_stack([x for x, _ in columns]), max(error for _, error in columns)
        if what := _unlike(array, *expected):
            return f"velocity_map_derivatives: {name} is not that of velocity_map: {what}"
    return ""


def _other_axes(answers: Answers, at: Evaluation) -> str:
    """Return the rows of a free base in S by which M is right once they are turned; "" if none."""
    point = ConformancePoint(at)
    R = _base_axes(point) if point.has_tree else None
    if R is None:
        return ""
    (_, S, _), M_x, _ = answers.own_terms(at.q, np.zeros_like(at.v), at.t)
    allowed = allowed_error(mass_size(at, S) + largest(at.terms.M), at.unit_roundoff)

    def is_right(S: Array) -> bool:
        return largest(S.T @ M_x @ S - at.terms.M) <= allowed

    if is_right(S):
        return ""
    turned = ((text, W @ S) for text, W in _turns(len(S), R))
    return next((f"rows of the {text}" for text, wrong in turned if is_right(wrong)), "")


def _difference(
    function: Callable[[Array], Array], q: Array, along: Array, unit_roundoff: float
) -> tuple[Array, float]:
    """Return the derivative of a function along a direction, by differences, and its error.

    Of central differences by two steps, extrapolated; the error is the change from one to the other
    and that by rounding of the function.
    """
    step = DIFFERENCE / max(1.0, largest(along))
    wide, narrow = (
        (function(q + h * along) - function(q - h * along)) / (2 * h) for h in (step, step / 2)
    )
    rounding = C * unit_roundoff * largest(function(q)) / step
    return (4 * narrow - wide) / 3, largest(wide - narrow) + rounding


def _unlike(actual: Array, expected: Array, error: float) -> str:
    """Return how an array differs from differences with an error, as text; "" if it does not."""
    if actual.shape != expected.shape:
        return f"it has shape {actual.shape}, expected {expected.shape}"
    if largest(actual - expected) <= error:
        return ""
    names = tuple(tuple(f"{k}" for k in range(size)) for size in actual.shape)
    difference = locate(actual, expected, names, error)
    return recognize(actual, expected, error) or f"{difference.where}: {difference.text}"


# ---- Inverse of M --------------------------------------------------------------------------------


def inverse_fault(
    engine: Engine, q: Array, v: Array, arrays: tuple[Array, Array], allowed: float
) -> str:
    """Return the confusion in a wrong M⁻¹ that is one in the engine's own coordinates alone.

    Args:
        engine: the engine.
        q: coordinates (n,).
        v: velocities (n,).
        arrays: its answer and the expected one, in the coordinates of the scene.
        allowed: bound on the error there.
    """
    S = Answers(engine).velocity_map(q, v).S
    if len(S) != len(q) or np.array_equal(S, np.eye(len(q))) or recognize(*arrays, allowed):
        return ""
    actual, expected = (S @ x @ S.T for x in arrays)
    size = float(np.linalg.norm(S, np.inf) * np.linalg.norm(S.T, np.inf))
    text = recognize(actual, expected, allowed * size)
    return f"in its own coordinates, {text}" if text else ""


# ---- Derivatives ---------------------------------------------------------------------------------

FREE_BASE = "p", "p", "p", "r", "r", "r"
"""First letters of the kinds of the scalar joints of a free base."""

PARTS = {"": (0, 6), "linear part of ": (0, 3), "angular part of ": (3, 6)}
"""Part of the velocity of a free base -> its first entry, and that after its last one."""


def derivatives_fault(
    engine: Engine,
    one: Quantity,
    point: ConformancePoint,
    arguments: tuple[Array, Array, Array, str, float],
    arrays: tuple[Array, Array],
    block: int,
    allowed: float,
) -> str:
    """Return the confusion in wrong derivatives, in the engine's own coordinates; "" for none.

    Args:
        engine: the engine.
        one: derivatives of inverse or forward dynamics.
        point: the point.
        arguments: those with which the engine was asked.
        arrays: its answer and the expected one, in the coordinates of the scene, all blocks.
        block: index of the wrong block, by q, by v or by τ.
        allowed: bound on the error in the coordinates of the scene.
    """
    q, v, third, _, t = arguments
    of_map = Answers(engine).derivative_map(one, q, v, third, t)
    n = len(q)
    if len(of_map.S) != n or np.array_equal(of_map.S, np.eye(n)):
        return ""
    actual, expected = (of_map.to_engine(x) for x in arrays)
    back, symbols = np.linalg.inv(of_map.S), one.symbol.split(", ")
    size = max(float(np.linalg.norm(x, np.inf)) for x in (back, back.T, of_map.S, of_map.S.T))
    # By the rounding of the map too: at rest derivatives by v vanish, and so does their bound.
    rounding = allowed_error(largest(actual), type(engine).unit_roundoff)
    own = actual, expected, max(allowed * size**2, rounding)
    if text := _own_block_fault(of_map, one, point, own, block):
        return f"in its own coordinates, {text}"
    columns = np.s_[:, block * n : (block + 1) * n]
    if not agree_everywhere(actual[columns], expected[columns], agreement_within(own[2])):
        return ""
    for other in set(range(len(symbols))) - {block}:
        if text := _own_block_fault(of_map, one, point, own, other):
            wrong = f"{symbols[other]}, by which it is mapped, is wrong: {text}"
            return f"in its own coordinates it is right, and {wrong}"
    return ""


def _own_block_fault(
    of_map: DerivativeMap,
    one: Quantity,
    point: ConformancePoint,
    own: tuple[Array, Array, float],
    block: int,
) -> str:
    """Return place and confusion of a wrong block in the engine's own coordinates; "" for none.

    Args:
        of_map: the map.
        one: derivatives of inverse or forward dynamics.
        point: the point.
        own: the answer and the expected one in own coordinates, all blocks, and the allowed error.
        block: index of the block.
    """
    n, (actual, expected, allowed) = len(of_map.S), own
    columns = np.s_[:, block * n : (block + 1) * n]
    if agree_everywhere(actual[columns], expected[columns], agreement_within(allowed)):
        return ""
    along = ("x", "w", "force")[block]
    names = tuple(f"w[{k}]" for k in range(n)), tuple(f"by {along}[{k}]" for k in range(n))
    alternatives = dict(_conventions(of_map, expected, one, block, _base_axes(point)))
    context = ConfusionContext(alternatives=alternatives)
    difference = locate(actual[columns], expected[columns], names, allowed, context)
    return f"{difference.where}: {difference.what}" if difference.what else ""


def _base_axes(point: ConformancePoint) -> Array | None:
    """Return the axes of a free base as columns (3, 3); None for a base that is not free."""
    topology: Topology = point.model.plan.topology
    if tuple(x.kind[0] for x in topology.joints[: len(FREE_BASE)]) != FREE_BASE:
        return None
    base = [name for name, joint in zip(point.model.links, point.model.joints, strict=True)
            if joint == len(FREE_BASE) - 1]  # fmt: skip
    return point.link(base[0]).R if base else None


def _conventions(
    of_map: DerivativeMap, expected: Array, one: Quantity, block: int, R: Array | None
) -> Iterator[tuple[str, Array]]:
    """Yield derivatives in own coordinates by other conventions, each with its text.

    Args:
        of_map: the map.
        expected: the expected derivatives in own coordinates, all blocks.
        one: the quantity.
        block: index of the block.
        R: axes of a free base as columns (3, 3), or None.
    """
    n, back = len(of_map.S), np.linalg.inv(of_map.S)
    symbols = one.symbol.split(", ")
    arrays = [expected[:, k * n : (k + 1) * n] for k in range(len(symbols))]
    right = arrays[block]
    for k, symbol in enumerate(symbols):
        if k != block:
            yield f"{symbol} in place of {symbols[block]}", arrays[k]
    if block == 0:
        at_constant_v = right + arrays[1] @ of_map.along @ back
        yield "at constant v of the scene, expected at constant w", at_constant_v
        if of_map.mass_matrix is not None:
            scenes = right + back.T @ of_map.turned @ back
            yield "of the forces Sᵀ τ of the scene, expected of its own", scenes
    for text, W in () if R is None else _turns(n, R):
        yield f"rows of the {text}", W @ right
        yield f"columns of the {text}", right @ W.T
        yield f"rows and columns of the {text}", W @ right @ W.T


def _turns(m: int, R: Array) -> Iterator[tuple[str, Array]]:
    """Yield rotations W (m, m) of the velocity of a free base, or a part of it, each with a text.

    Args:
        m: number of velocities.
        R: axes of the base as columns (3, 3).
    """
    for (part, (first, last)), (axes, turn) in product(PARTS.items(), (("R", R), ("Rᵀ", R.T))):
        W = np.eye(m)
        for k in range(first, last, 3):
            W[k : k + 3, k : k + 3] = turn
        yield f"{part}free base turned by {axes}, R its axes", W
