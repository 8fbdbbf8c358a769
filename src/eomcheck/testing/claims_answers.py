"""Claims about calls of functions: valid results, float64 precision, repeatable, no side effects.

Functions are black boxes, so that each property is measured by calls: single precision by the noise
of the results and by changes of the arguments that have no effect, and a result that depends on
earlier calls (a cache, a state) by calls at other states in between.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from eomcheck.claims.registry import Comparison, Decision, function_claim
from eomcheck.descriptions.tree_quantities import PER_BODY
from eomcheck.evaluation.conformance import names_of_parameters
from eomcheck.evaluation.tolerance import largest
from eomcheck.numbers.generic import EPS, Array
from eomcheck.testing.equations_of_motion import (
    INPUTS,
    BrokenError,
    EquationsOfMotion,
    FunctionCaller,
    equations_from,
)
from eomcheck.testing.function_state import FunctionState
from eomcheck.testing.uncertain import UncertainArray

NOISE = 2.0**-32
"""Noise per size of a function, above which there may be single-precision numbers in it.

Rounding to float64 leaves 2^-53, more where terms cancel; to single precision 2^-24.
"""

NOTHING = 2.0**-12
"""Noise per size above which the function may be 0, and all of it rounding of terms that cancel."""

FAST = 4096.0
"""Factor of v at which terms are checked again that cancel at v."""

UNFELT, FELT, FELT_BY = 2.0**-36, 2.0**-16, 2.0**-26
"""Changes of an argument, per half width of its range: if the larger one changes a function by more
than `FELT_BY` of its size, the smaller one changes it in float64, and not in float32."""

INVERSES = "qdd", "qdd_q", "qdd_v", "qdd_tau", "inverse_mass_matrix"
"""Functions that are noisy where M is nearly singular, which is no fault of theirs."""

BESIDE = 2.0**-8
"""Distance, per half width of the ranges, at which a jump no longer adds to the measured noise."""


def working_functions(at: FunctionState) -> Iterator[str]:
    """Yield the names of the functions that have a value at this state."""
    for name in at.functions.given:
        try:
            at.call(name)
        except BrokenError:
            continue
        yield name


def axis_names(at: FunctionState, name: str) -> tuple[tuple[str, ...], ...]:
    """Return the names along each axis of the result of a function."""
    f, sizes = at.functions, at.caller.sizes
    rows = tuple(f"{i}" for i in range(sizes.get("r", 0)))
    names_by_symbol = {"n": f.coordinate_names, "p": f.velocity_names, "r": rows}
    names_by_symbol |= {"k": parameter_names(sizes.get("k", 0)), "f": f.frames(name)}
    return tuple((names_by_symbol | FIXED_AXES)[symbol] for symbol in INPUTS[name].shape)


FIXED_AXES = {
    "3": ("x", "y", "z"),
    "4": ("x", "y", "z", "p"),
    "6": ("x", "y", "z", "ω_x", "ω_y", "ω_z"),
}
"""Number of entries of an axis -> names along it, of points, of placements and of 6-vectors."""


def parameter_names(count: int) -> tuple[str, ...]:
    """Return the names of the parameters of a regressor, ten a body."""
    bodies = tuple(f"body {b}" for b in range(-(-count // PER_BODY)))
    return names_of_parameters(bodies)[:count]


@function_claim("answers", "each function answers with finite numbers of the right shape", "")
def answers(at: FunctionState) -> Iterator[Decision]:
    """Decide for each function: no exception, finite numbers, the right shape."""
    for name in at.functions.given:
        try:
            at.call(name)
        except BrokenError as broken:
            at.caller.reported.add(name)
            singular = isinstance(broken.__cause__, np.linalg.LinAlgError)
            why = broken.clause + (at.repeated_constraints() if singular else "")
            yield Decision(name, float("inf"), 0.0, "failed", f"{name}{why}")
        else:
            yield Decision(name, 0.0, 0.0, "passed")


@function_claim(
    "arguments-unchanged", "what a function is handed is the same afterwards", "arguments"
)
def arguments_unchanged(at: FunctionState) -> Iterator[Decision]:
    """Decide for each function: it never wrote into q or v, whether it returned or raised."""
    works = set(working_functions(at))
    for name in at.functions.given:
        if name in at.caller.writing:
            yield Decision(name, float("inf"), 0.0, "failed", f"{name} writes into its arguments")
        elif name in works:
            yield Decision(name, 0.0, 0.0, "passed")


@function_claim("same-answer", "f(x) after f(y) is f(x)", "")
def same_answer(at: FunctionState) -> Iterator[Comparison]:
    """Compare the result of each function before and after calls at another state."""
    # Each coordinate by another amount: a chain of links is the same turned as a whole.
    width_q, width_v = (x * np.linspace(1.0, 1.3, len(x)) for x in (at.width_q, at.width_v))
    # All functions at this state before any call at another one.
    for name, first in [(name, at.quantity(name)) for name in working_functions(at)]:
        for name_between in working_functions(at):
            # As in a simulation: every function at another state in between.
            at.raw(name_between)(at.q - 0.3 * width_q, at.v + 0.7 * width_v)
        again = at.call(name)
        yield _compare_repeated(at, name, again, first)


AGAIN, AT_FIRST, AWAY = 24, 54, 3
"""Numbers of repeated calls of each function: at a state on average, at the first state; and number
of states near it that are called in between, in random order. A function that returns the previous
result every nth time is detected for every n up to `AT_FIRST`, wherever it begins; with as many
calls at each state, a longer period could fall on the same call of each, so their number is drawn.
"""

KEPT, COARSE_BY = 2.0**-26, 2.0**-18
"""Change, per half width of the range, that has no effect through a cache by six digits; it must
have one if `FELT` changes a function in proportion and by more than `COARSE_BY` of its size."""

CACHED = (2.0**-6, 2.0**-16, 2.0**-12), (2.0**-9, 2.0**-19, 2.0**-12)
"""Long and short changes of all coordinates together, per half width, and least change of a
function per size: through a cache by three to five digits the long ones have an effect, and none of
the short ones, which would have one in float32."""

CACHED_DOUBLES = (*CACHED, (2.0**-21, 2.0**-31, 2.0**-24))
"""`CACHED` for functions with float64 precision, also for a cache by seven or eight digits."""


@function_claim("answers-repeat", "f(x) is the same in every call of a run", "")
def answers_repeat(at: FunctionState) -> Iterator[Comparison | Decision]:
    """Compare results at earlier states, called again after all other claims, to rounding.

    Each call is at another state than the one before, so that a repeated previous result differs;
    and no result may be cached for states that differ in few digits. Functions in single precision
    fail `double-precision` instead.
    """
    n, x = len(at.q), np.concatenate((at.q, at.v))
    width = np.concatenate((at.width_q, at.width_v))
    rng = np.random.default_rng(at.seed)
    order = (AWAY + np.cumsum(rng.integers(1, AWAY + 1, AT_FIRST))) % (AWAY + 1)  # after the last
    count = int(rng.integers(1, 2 * AGAIN))
    # Each coordinate by another amount: a chain of links is the same turned as a whole.
    along = width * rng.uniform(0.5, 1.0, len(x)) * rng.choice((-1.0, 1.0), len(x))
    where = [x] + [x + (0.1 + 0.2 * k) * along for k in range(AWAY)]
    for name in working_functions(at):
        f, first = at.raw(name), at.quantity(name)
        values = [first.value, *(f(y[:n], y[n:]) for y in where[1:])]
        worst, error = first.value, np.zeros(first.shape)
        for k in order[: count if name in at.caller.repeated else AT_FIRST]:
            away = np.abs(f(where[k][:n], where[k][n:]) - values[k])
            # NaN twice is the same result.
            if largest(np.nan_to_num(away, nan=0.0)) > largest(error):
                error, worst = away, first.value + away
        at.caller.repeated.add(name)
        rounding = EPS * np.maximum(first.size, np.fmax.reduce(np.abs(values)))
        first_with_rounding = UncertainArray(first.value, rounding, first.size)
        double = name not in at.caller.single_precision and _relative_error(first) <= NOISE
        unfelt = _unfelt_input(at, name, KEPT, COARSE_BY) if double else ""
        cached = name not in at.caller.single_precision and _is_cached(at, name, double)
        if unfelt or cached:
            text = f"{name}, does not feel small changes of {unfelt or 'q'}: cached?"
            yield Decision(name, KEPT, 0.0, "failed", text)
            continue
        yield _compare_repeated(at, name, worst, first_with_rounding)


@function_claim("fresh-answer", "f(x) of a fresh instance is f(x)", "", ("factory",))
def fresh_answer(at: FunctionState) -> Iterator[Comparison | Decision]:
    """Compare the result of each function with that of a fresh instance without earlier calls."""
    fresh = FunctionCaller(fresh_functions(at.functions))
    for name in working_functions(at):
        if fresh.functions.function(name) is None:
            yield Decision(name, 0.0, 0.0, "skipped", f"the factory makes no {name}")
            continue
        first = at.quantity(name)
        try:
            anew = fresh(name, at.q, at.v, **at.loads(name))
        except BrokenError as broken:
            yield Decision(
                name, float("inf"), 0.0, "failed", f"{name} of the factory{broken.clause}"
            )
            continue
        yield _compare_repeated(at, name, anew, first)


def _compare_repeated(
    at: FunctionState, name: str, again: Array, first: UncertainArray
) -> Comparison:
    """Return the comparison of a repeated result with the first one, to rounding at most."""

    def explain(*_: object) -> str:
        return "another one after other calls: something is kept from an earlier call"

    error = np.where(again == first.value, 0.0, first.error)
    actual, none = UncertainArray(again, error, first.size), np.zeros(first.shape)
    expected = UncertainArray(first.value, none, first.size)
    return Comparison(name, actual, expected, axis_names(at, name), explain=explain)


def fresh_functions(functions: EquationsOfMotion) -> EquationsOfMotion:
    """Return the functions that the factory makes."""
    assert functions.factory is not None
    instance = functions.factory()
    if isinstance(instance, EquationsOfMotion):
        return instance
    functions_by_name = (
        instance if isinstance(instance, dict) else {x: getattr(instance, x, None) for x in INPUTS}
    )
    options = {"speeds": functions.speeds, "qdot": functions.qdot, "array": functions.array}
    return equations_from(functions.n, options | functions_by_name)


@function_claim("double-precision", "functions compute in doubles", "precision")
def double_precision(at: FunctionState) -> Iterator[Decision]:
    """Decide for each function: no single precision inside, whatever dtype its result has."""
    for name in working_functions(at):
        quantity = at.quantity(name)
        blur = _relative_error(quantity)
        unfelt = _unfelt_input(at, name) if NOISE < blur < NOTHING else ""
        if unfelt and "v" in at.caller.reads(name):
            # A difference of larger terms has steps too, but not where v has made it large.
            unfelt = _unfelt_input(at.with_velocity(FAST * at.v), name)
        share = _relative_error(quantity, _neighbouring_size(at, name))
        if name in at.caller.single_precision:
            text = f"answers in {at.caller.single_precision[name]}"
        elif unfelt:
            text = f"does not feel small changes of {unfelt}: float32 arithmetic"
        elif NOISE < share < NOTHING and name not in INVERSES:
            text = f"noise of {share:.1g} of its size: float32 arithmetic, or terms that cancel"
            if max(_neighbouring_noise(at, name)) <= NOISE:
                text = "jumps or has a kink at this state: its noise is not measured there"
            yield Decision(name, share, NOISE, "inconclusive", f"{name}, {text}")
            continue
        else:
            yield Decision(name, share if share <= NOISE else 0.0, NOISE, "passed")
            continue
        yield Decision(name, max(blur, 2.0**-24), NOISE, "failed", f"{name}, {text}")


def _neighbouring_size(at: FunctionState, name: str) -> float:
    """Return the size of a function half a width of the ranges away, on both sides of the state.

    A plain formula may vanish at the state, as 1 - cos q does: the terms that round in it are of
    this size.
    """
    half_q, half_v, f = 0.5 * at.width_q, 0.5 * at.width_v, at.raw(name)
    values = [f(at.q + sign * half_q, at.v + sign * half_v) for sign in (1.0, -1.0)]
    return largest(np.nan_to_num(values, nan=0.0, posinf=0.0, neginf=0.0))


def _neighbouring_noise(at: FunctionState, name: str) -> list[float]:
    """Return the noise per size of a function `BESIDE` away on both sides, beyond any jump."""
    shares = []
    for shift in (-BESIDE, BESIDE):
        q, v = at.q + shift * at.width_q, at.v + shift * at.width_v
        try:
            side = FunctionState(at.caller, q, v, at.seed)
            shares.append(_relative_error(side.quantity(name), _neighbouring_size(side, name)))
        except BrokenError:
            shares.append(np.inf)
    return shares


def _relative_error(array: UncertainArray, beside: float = 0.0) -> float:
    """Return the largest error of an entry per largest size, the latter `beside` or more."""
    size = max(largest(array.size), beside)
    return largest(array.error) / size if size > 0.0 and np.isfinite(size) else 0.0


def _unfelt_input(
    at: FunctionState, name: str, small: float = UNFELT, share_felt: float = FELT_BY
) -> str:
    """Return the first entry of q and v of which only large changes have an effect, "" for none.

    A smooth function that the large change changes by `by` of its size changes by a fixed part of
    that for the small one, which is still many roundings in float64.
    """
    f, value, n = at.raw(name), at.quantity(name), len(at.q)
    names = [f"q[{k}]" for k in range(n)] + [f"v[{k}]" for k in range(len(at.v))]
    reads = at.caller.reads(name)
    for k, width in enumerate(np.concatenate((at.width_q, at.width_v))):
        if ("q" if k < n else "v") not in reads:
            continue

        def change_over(share: float, k: int = k, width: float = float(width)) -> Array:
            x = np.concatenate((at.q, at.v))
            x[k] += share * width
            return np.abs(f(x[:n], x[n:]) - value.value)

        if _is_coarse(change_over, FELT, small, share_felt * largest(value.size)):
            return names[k]
    return ""


def _is_cached(at: FunctionState, name: str, double: bool) -> bool:
    """Return whether long changes of all coordinates together have an effect and no short ones."""
    f, value = at.raw(name), at.quantity(name)
    if "q" not in at.caller.reads(name):
        return False
    rng = np.random.default_rng(at.seed)
    along = rng.uniform(0.5, 1.0, len(at.q)) * rng.choice((-1.0, 1.0), len(at.q)) * at.width_q

    def changed(share: float) -> Array:
        return np.abs(f(at.q + share * along, at.v) - value.value)

    steps, size = CACHED_DOUBLES if double else CACHED, largest(value.size)
    return any(
        _is_coarse(changed, long, short, share_felt * size) for long, short, share_felt in steps
    )


def _is_coarse(changed: Callable[[float], Array], long: float, short: float, least: float) -> bool:
    """Return whether an entry changes over long steps only.

    It changes by more than `least` and in proportion over one, two and three long steps, and not at
    all over as many short ones. In proportion, and not small beside other entries: an entry that is
    nothing but rounding may be 0 at one step and not at another.
    """
    once, *more = (changed(j * long) for j in (1, 2, 3))
    straight = [np.abs(change - j * once) <= 0.1 * once for j, change in enumerate(more, 2)]
    coarse = (once > least) & np.logical_and.reduce(straight)
    if not coarse.any():
        return False
    return not any((changed(j * short) > 0.0)[coarse].any() for j in (1, 2, 3))
