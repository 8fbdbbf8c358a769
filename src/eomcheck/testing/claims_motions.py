"""Claims about accelerations, and the comparison of every quantity with a reference.

Accelerations q̈ satisfy the equations of motion, and energy is balanced. The reference is a scene,
an engine or other functions: each quantity that both have, or that follows in one of them from its
other functions, is compared.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from eomcheck.claims.confusions import term_multiple
from eomcheck.claims.registry import (
    BlindSpot,
    Comparison,
    Decision,
    Skipped,
    function_claim,
    has_any,
)
from eomcheck.errors import InputError
from eomcheck.evaluation.tolerance import C
from eomcheck.numbers.generic import EPS, Array
from eomcheck.testing.claims_answers import axis_names
from eomcheck.testing.claims_terms import (
    compare,
    kinetic_rate,
    proportional,
    row_names,
)
from eomcheck.testing.equations_of_motion import (
    INPUTS,
    BrokenError,
    EquationsOfMotion,
    FunctionCaller,
)
from eomcheck.testing.function_state import (
    FunctionState,
    inertia,
    supplied_or_derived_bias,
    supplied_or_derived_drift,
    why_no_bias,
)
from eomcheck.testing.uncertain import UncertainArray, exact

# ---- Accelerations -------------------------------------------------------------------------------

HOW = {
    -1.0: "it is not in q̈, or it is in two of the other functions",
    1.0: "it is twice in q̈",
    -2.0: "its sign is another one in q̈",
}
"""Multiple of a force by which M q̈ + B is too large -> description of that fault."""

FORCES = "no force is given: gravity, U, R or Q would tell"
DAMPER = "odd in v, and linear: a damper? R or Q would tell"
DRAG = "odd in v, and not linear: drag and friction would be in R or Q"


def is_nonzero(x: UncertainArray) -> Array:
    """Return whether each entry is certainly not 0."""
    return np.abs(x.value) > C * x.error


@function_claim(
    "motion",
    "M q̈ + B + g + ∂R/∂v = Q + aᵀλ",
    "equations of motion",
    ("M|T", "qdd"),
    consistent=True,
    blind_spots=(
        BlindSpot("qdd", "whether q̈ belongs to the terms", ("M|T", "against")),
        BlindSpot("R", "damping of wrong sign or size", ("qdd & M|T", "against")),
        BlindSpot("Q", "applied forces of wrong sign or size", ("qdd & M|T", "against")),
    ),
)
def motion(at: FunctionState) -> Iterator[Comparison | Decision | Skipped]:
    """Compare M q̈ + B with the forces, in the directions the constraints leave.

    M and B are those given, else those that follow from T, C or M. Where no force is given at all,
    gravity and dampers may be in q̈: the part of M q̈ + B that is quadratic in v has to vanish, and
    other parts are reported as inconclusive.
    """
    subject, B = "M q̈ + B ~ forces", supplied_or_derived_bias(at)
    if B is None:
        yield Skipped(subject, why_no_bias(at))
        return
    inertial, forces = inertia(at) @ at.quantity("qdd") + B, at.forces()
    names, free = row_names(at), exact(np.eye(len(at.v)))
    if at.has("a"):
        free = exact(at.free().T)
        names = tuple(f"free direction {i}" for i in range(free.shape[0]))
        inertial, forces = free @ inertial, free @ forces
    if not at.parts() and is_nonzero(inertial).any():
        if at.has("b"):
            yield Skipped(subject, FORCES)
            return
        states = [at.with_velocity(-at.v), at.with_velocity(np.zeros(len(at.v)))]
        biases = [supplied_or_derived_bias(state) for state in states]
        back, at_rest = (
            free @ (inertia(state) @ state.quantity("qdd") + B)
            for state, B in zip(states, biases, strict=True)
            if B is not None
        )
        odd, along = inertial - back, exact(free.value @ at.v)
        if not at.natural() and is_nonzero(odd).any() and not is_nonzero(along @ odd):
            # Dampers do work; terms of T that are linear in v do none.
            yield Comparison(subject, odd, exact(np.zeros(odd.shape)), (names,))
            return
        yield Comparison(subject, inertial + back, 2.0 * at_rest, (names,))
        worst = float(np.abs(inertial.value).max())
        yield Decision("forces", worst, 0.0, "inconclusive", f"M q̈ + B is not 0, and {FORCES}")
        return

    def explain(actual: Array, expected: Array, allowed: float, worst: tuple[int, ...]) -> str:
        for name, part in at.parts().items():
            force = free @ part
            multiple = term_multiple(actual - expected, force.value, allowed, C * force.error)
            if multiple is not None:
                return f"off by {name}: {HOW[multiple]}"
        return ""

    yield Comparison(subject, inertial, forces, (names,), explain=explain)


@function_claim(
    "power-balance",
    "d(T + U)/dt = v·Q - v·∂R/∂v",
    "power balance",
    ("qdd", "T|M"),
    without=("b",),
    consistent=True,
    natural=True,
)
def power_balance(at: FunctionState) -> Iterator[Comparison | Skipped]:
    """Compare the rate of the kinetic energy with the power of forces; constraints do no work."""
    qdd, forces, v = at.quantity("qdd"), at.forces(), exact(at.v)
    rate = kinetic_rate(at, qdd)
    if not at.parts() and is_nonzero(rate).any():
        yield Skipped("Ṫ ~ v·forces", FORCES)
        return
    yield compare(at, "Ṫ ~ v·forces", rate, v @ forces + violation_power(at, qdd, forces))


def violation_power(
    at: FunctionState, qdd: UncertainArray, forces: UncertainArray
) -> UncertainArray:
    """Return the power of constraint forces: 0, with an error as v keeps constraints to rounding.

    v violates them by the remaining a v, and by the rounding error of that.
    """
    if not at.has("a"):
        return exact(0.0)
    a, speed = at.quantity("a").value, np.abs(at.v)
    remaining = np.abs(a @ at.v) + EPS * np.abs(a) @ speed
    violation = np.abs(np.linalg.pinv(a)) @ remaining + EPS * speed
    size = (inertia(at) @ qdd).size + forces.size
    return UncertainArray(np.zeros(()), np.asarray(size @ violation), np.zeros(()))


@function_claim(
    "acceleration-even",
    "q̈(q, -v) = q̈(q, v)",
    "acceleration",
    ("qdd",),
    without=("R", "Q", "b"),
    natural=True,
    consistent=True,
)
def acceleration_even(at: FunctionState) -> Iterator[Comparison | Decision]:
    """Compare q̈ at -v and v: without damping a motion can run backwards.

    Rows with an odd part that is linear in v, which may be a damper, are inconclusive.
    """
    damped, odd = _damped_rows(at), _odd_part(at)
    if damped.any():
        rows_ = ", ".join(name for name, x in zip(row_names(at), damped, strict=True) if x)
        largest = float(np.abs(odd.value[damped]).max())
        yield Decision(
            "q̈ odd in v", largest, 0.0, "inconclusive", f"acceleration, row {rows_}: {DAMPER}"
        )
    if damped.all():
        return

    def explain(actual: Array, expected: Array, allowed: float, worst: tuple[int, ...]) -> str:
        return DRAG

    none = exact(np.zeros(len(at.v)))
    back = _select_entries(damped, none, at.with_velocity(-at.v).quantity("qdd"))
    yield compare(at, "q̈", back, _select_entries(damped, none, at.quantity("qdd")), explain)


def _odd_part(at: FunctionState) -> UncertainArray:
    """Return twice the part of q̈ (p,) that is odd in v."""
    return at.quantity("qdd") - at.with_velocity(-at.v).quantity("qdd")


def _damped_rows(at: FunctionState) -> Array:
    """Return whether each row of q̈ (p,) has a part that is odd in v, and linear in it."""

    def damped() -> Array:
        once = _odd_part(at)
        if not is_nonzero(once).any():
            return np.zeros(once.shape, bool)
        return is_nonzero(once) & ~is_nonzero(_odd_part(at.with_velocity(2.0 * at.v)) - 2.0 * once)

    return at.cached("damped", damped)


def _select_entries(chosen: Array, x: UncertainArray, y: UncertainArray) -> UncertainArray:
    """Return the entries of x where `chosen`, of y elsewhere."""
    pairs = (x.value, y.value), (x.error, y.error), (x.size, y.size)
    return UncertainArray(*(np.where(chosen, *pair) for pair in pairs))


@function_claim(
    "acceleration-quadratic",
    "q̈(2v) - q̈(0) = 4 (q̈(v) - q̈(0))",
    "acceleration",
    ("qdd",),
    without=("R", "Q", "b"),
    natural=True,
    consistent=True,
)
def acceleration_quadratic(at: FunctionState) -> Iterator[Comparison]:
    """Compare q̈(2v) - q̈(0) with 4 (q̈(v) - q̈(0)), without damping.

    In rows with a linear damper the mean of both directions of v is compared.
    """
    at_rest = at.with_velocity(np.zeros(len(at.v))).quantity("qdd")
    twice = at.with_velocity(2.0 * at.v)
    once, far, damped = at.quantity("qdd"), twice.quantity("qdd"), _damped_rows(at)
    if damped.any():
        once = _select_entries(damped, once - 0.5 * _odd_part(at), once)
        far = _select_entries(damped, far - 0.5 * _odd_part(twice), far)
    yield compare(at, "q̈", far - at_rest, 4.0 * (once - at_rest))


# ---- Reference -----------------------------------------------------------------------------------

FORCE_TERMS = ("Q", "gravity", "U", "R")
"""Functions that forces are summed from."""

QUANTITIES: dict[str, tuple[str, Callable[[FunctionState], UncertainArray | None]]] = {
    "M": ("M", inertia),
    "bias": ("bias", supplied_or_derived_bias),
    "forces": ("Q", lambda at: at.forces()),
    "T": ("T", lambda at: at.quantity("T")),
    "a": ("a", lambda at: at.quantity("a")),
    "gamma": ("gamma", supplied_or_derived_drift),
    "qdd": ("qdd", lambda at: at.quantity("qdd")),
}
"""Name -> (function with the same shape, function of a `FunctionState` that returns it).

U is not compared, as it is known up to a constant only: it is compared by its forces.
"""

for _name in [*INPUTS][[*INPUTS].index("qdot") + 1 :]:
    QUANTITIES[_name] = _name, partial(FunctionState.quantity, name=_name)

FOLLOWS = {"M": "T", "bias": "C|M|T", "gamma": "a"}
"""Name -> functions from which it follows where it is not given."""


def _is_provided(at: FunctionState, name: str) -> bool:
    """Return whether a function, or for "forces" any of `FORCE_TERMS`, is supplied."""
    if name == "forces":
        return any(at.has(term) for term in FORCE_TERMS)
    return at.has(name)


def _is_comparable(at: FunctionState, reference: FunctionState, name: str) -> bool:
    """Return whether a quantity is given by both, or by one of them and follows in the other.

    Where both give the function that it follows from, that is compared, and this would repeat it.
    """
    provided = _is_provided(at, name), _is_provided(reference, name)
    if all(provided) or not any(provided) or name not in FOLLOWS:
        return all(provided)
    sources = FOLLOWS[name]
    derived = reference if provided[0] else at
    source_compared = any(at.has(source) and reference.has(source) for source in sources.split("|"))
    return has_any(derived, sources) and not source_compared


def _reference_at(at: FunctionState) -> FunctionState:
    """Return the reference at the same state, under the same loads."""
    assert at.reference is not None
    reference = _with_frames_of(at.functions, at.reference)
    state = FunctionState(FunctionCaller(reference), at.q, at.v, at.seed)
    state.loads_of = at
    return state


def _with_frames_of(
    functions: EquationsOfMotion, reference: EquationsOfMotion
) -> EquationsOfMotion:
    """Return a reference with the frames that the functions have, in their order."""
    chosen: dict[str, Any] = {}
    for name in reference.given:
        own, theirs = functions.function(name), reference.function(name)
        if isinstance(own, Mapping) and isinstance(theirs, Mapping) and own.keys() <= theirs.keys():
            chosen[name] = {frame: theirs[frame] for frame in own}
    return replace(reference, **chosen) if chosen else reference


def check_reference(points: list[FunctionState]) -> None:
    """Raise InputError if the reference has no value of any compared quantity at any state.

    Values at some states, or of some quantities, are compared, and others reported as skipped. But
    a run without any comparison does not pass.
    """
    broken: BrokenError | None = None
    for at in points:
        reference = _reference_at(at)
        for name, (_, quantity_of) in QUANTITIES.items():
            if not _is_comparable(at, reference, name):
                continue
            try:
                quantity_of(reference)
            except BrokenError as error:
                broken = broken or error
            else:
                return
    if broken is not None:
        assert points[0].reference is not None
        text = f"against = {points[0].reference.name}: it does not answer in any state"
        raise InputError(f"{text}: {broken}")


@function_claim(
    "reference",
    "each quantity is that of the reference",
    "",
    ("against",),
    blind_spots=(
        BlindSpot(
            "", "a number that all functions share, such as a mass, a length or g", ("against",)
        ),
        BlindSpot(
            "", "a velocity or a load of wrong sign in the derivation", ("against",), derived=True
        ),
        BlindSpot("com", "a constant added to the center of mass", ("against",)),
        BlindSpot("com", "a factor of the center of mass, and of 1/m", ("against",)),
        BlindSpot("momentum", "the size of the angular momentum, and its point", ("against",)),
        BlindSpot("momentum_matrix", "the size and the point of its angular rows", ("against",)),
        BlindSpot("frame_placement", "another frame that is fixed to the same link", ("against",)),
    ),
)
def reference(at: FunctionState) -> Iterator[Comparison | Skipped]:
    """Compare each quantity with that of the reference."""
    assert at.reference is not None
    for name, (shaped, quantity_of) in QUANTITIES.items():
        point, other_point = at, _reference_at(at)
        if not _is_comparable(at, other_point, name):
            continue
        subject = f"{name} ~ {at.reference.name}"
        if name == "qdd":
            consistent = at.consistent()
            if consistent is None:
                yield Skipped(subject, "no consistent state is found nearby")
                continue
            point = consistent
            other_point = FunctionState(other_point.caller, point.q, point.v, at.seed)
        try:
            expected = quantity_of(other_point)
        except BrokenError as broken:
            yield Skipped(subject, f"the reference breaks: {broken}")
            continue
        actual = quantity_of(point)
        if actual is None or expected is None:
            yield Skipped(subject, why_no_bias(point if actual is None else other_point))
            continue
        if actual.shape != expected.shape:
            yield Skipped(subject, f"the reference has shape {expected.shape}, not {actual.shape}")
            continue
        names = axis_names(at, shaped)
        yield Comparison(subject, actual, expected, names, explain=proportional)
