"""Certified accelerations and derivatives by ball arithmetic, and certified digits of float64.

An enclosure is an acceleration, or its derivatives, in balls that provably contain the true values.
`enclose` and `enclose_derivatives` compute it by a formulation, with the precision doubled until
enough digits are certain; `accuracy` measures the true error of a float64 result against it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import flint
import numpy as np

from eomcheck.deprecated import old_attributes
from eomcheck.errors import InputError, RefusedError, whole_number
from eomcheck.evaluation.derivatives import (
    ARRAYS,
    Direction,
    arrays_by_name,
    solutions_along,
    unit_directions,
)
from eomcheck.evaluation.dynamics import representable
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import acceleration_sensitivity, solution_of
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.evaluation.tolerance import NOTICEABLE, allowed_error, largest
from eomcheck.formulations import Formulation, Partition, formulation_for
from eomcheck.mechanics.scene import Scene, checked_scene, finite_array
from eomcheck.numbers.ball import Balls, ball, midpoints, midpoints_or_zero, precision
from eomcheck.numbers.generic import EPS, Array, map_entries, map_record

# ---- Enclosures ----------------------------------------------------------------------------------

GUARD_BITS = 64
"""Extra bits, beyond those of the requested digits, of the first precision that is tried."""

MOST_BITS = 4096
"""Precision at and above which it is not doubled once more, bits.

Four times the first precision is such a limit too, where that is more.
"""

MOST_DIGITS = 1_000_000
"""Largest number of requested decimal digits: a ball then takes half a megabyte."""

VANISHING_SHARE = 2.0**-400
"""Share of the larger of max |v̇| and max |v|² below which an entry vanishes: without digits."""


@dataclass(frozen=True)
class Enclosure:
    """The acceleration of one state by a formulation, in balls that contain the true values.

    Attributes:
        vdot: v̇ (n,) of `flint.arb`, m/s² and rad/s².
        multipliers: λ (r,) of `flint.arb`, or None if the formulation has none.
        v: the velocity W u + offset (n,) of `flint.arb`.
        bits: working precision.
        digits: certain decimal digits of every entry of v̇; an entry that vanishes needs none.
    """

    vdot: Array
    multipliers: Array | None
    v: Array
    bits: int
    digits: float

    def __repr__(self) -> str:
        """Return the text with 15 digits of each ball, independent of the current precision."""
        vdot, v = (_shown(balls) for balls in (self.vdot, self.v))
        multipliers = None if self.multipliers is None else _shown(self.multipliers)
        return (
            f"Enclosure(vdot={vdot}, multipliers={multipliers}, v={v}, bits={self.bits}, "
            f"digits={self.digits})"
        )

    def doubles(self) -> Array:
        """Return v̇ (n,) in float64: the midpoints rounded, 0 where a ball contains 0."""
        return midpoints_or_zero(self.vdot)

    def overlaps(self, other: Enclosure) -> Array:
        """Return whether the balls of v̇ have a point in common, bool (n,), entry by entry."""
        return np.array([x.overlaps(y) for x, y in zip(self.vdot, other.vdot, strict=True)])


SHOWN = 15
"""Decimal digits of a ball in the text of an enclosure."""


def _shown(balls: Array) -> str:
    """Return the text of an array of balls."""
    return f"[{', '.join(ball.str(SHOWN) for ball in balls)}]"


def enclose(
    scene: Scene,
    key: str,
    q,
    u=None,
    t: float = 0.0,
    digits: int = 30,
    *,
    v=None,
    pivoted: bool = False,
) -> Enclosure:
    """Return the enclosure of the acceleration of `scene` by one formulation.

    From u the velocity v = W u + offset is computed in balls: one in float64 would never satisfy
    the constraints exactly, and the true accelerations of formulations would differ. From v, the
    enclosure is that of the result of this formulation for exactly these float64 numbers,
    consistent or not.

    Args:
        scene: the scene.
        key: the formulation, a key of `eomcheck.FORMULATIONS`.
        q: coordinates (n,).
        u: generalized speeds (p,), or
        v: velocities (n,); formulations in generalized speeds take the u of v.
        t: time, s.
        digits: decimal digits that must be certain in every entry of v̇.
        pivoted: for El and Em, choose the dependent coordinates by pivoted QR.

    Returns:
        v̇, λ and v in balls of `flint.arb`, with the precision and the certain digits.

    Raises:
        InputError: wrong shapes, values that are not finite, u and v both given or none, `digits`
            below 1 or above `MOST_DIGITS`, `pivoted` without a partition, a formulation that does
            not apply to the scene.
        UnknownNameError: no such formulation.
        RefusedError: a matrix cannot be shown to be invertible, or the digits stay uncertain.
    """
    formulation = formulation_for(checked_scene(scene), key)
    if (u is None) == (v is None):
        raise InputError("expected either u or v, not both")
    q, _ = scene.check_state(q, np.zeros(scene.n), t)
    start = (
        {"u": finite_array("u", u, (scene.p,))}
        if v is None
        else {"v": finite_array("v", v, (scene.n,))}
    )
    digits = whole_number("digits", digits, most=MOST_DIGITS)
    partition = Evaluation(scene, q, np.zeros(scene.n), t).partition_for(formulation, pivoted)
    return enclosure_at(scene, formulation, q, start, t, digits, partition)


def enclosure_at(
    scene: Scene,
    formulation: Formulation,
    q: Array,
    start: dict[str, Array],
    t: float,
    digits: int,
    partition: Partition,
    quantities_by_bits: dict[int, Quantities] | None = None,
) -> Enclosure:
    """Return the enclosure for checked arguments, see `enclose`; `start` is {"u": u} or {"v": v}.

    Formulations at one state share `quantities_by_bits`, their cache, filled here.
    """
    quantities = {} if quantities_by_bits is None else quantities_by_bits

    def with_bits(bits: int) -> Enclosure:
        if bits not in quantities:
            quantities[bits] = _ball_quantities(scene, q, start, t, bits)
        return _enclosure_of(quantities[bits], formulation, bits, partition)

    return _with_certain_digits(with_bits, digits, formulation, "v̇")


E = TypeVar("E", "Enclosure", "EnclosedDerivatives")


def _with_certain_digits(
    with_bits: Callable[[int], E], digits: int, formulation: Formulation, what: str
) -> E:
    """Return the first enclosure with enough certain digits; the precision is doubled until then.

    Raises:
        RefusedError: a matrix cannot be shown to be invertible, or the digits stay uncertain.
    """
    bits = math.ceil(digits * math.log2(10.0)) + GUARD_BITS
    enough = max(MOST_BITS, 4 * bits)
    while True:
        try:
            result = with_bits(bits)
        except RefusedError:
            if bits >= enough:
                raise
        else:
            if result.digits >= digits:
                return result
            if bits >= enough:
                raise RefusedError(
                    what,
                    0.0,
                    0.0,
                    f"{formulation.key}: with {bits} bits {max(result.digits, 0.0):.0f} digits of "
                    f"every entry of {what} are certain, asked for are {digits}",
                )
        bits *= 2


def _ball_quantities(
    scene: Scene, q: Array, start: dict[str, Array], t: float, bits: int
) -> Quantities:
    """Return the quantities of a state in balls; `start` has its u or its v, and any τ."""
    balls = Balls()
    with precision(bits):
        at = Quantities(scene, balls, balls.numbers(q), balls.numbers(np.array(t)).item())
        if "u" in start:
            at.u = balls.numbers(start["u"])
        if "v" in start:
            at.v = balls.numbers(start["v"])
        if "tau" in start:
            at.tau = balls.numbers(start["tau"])
    return at


def _enclosure_of(
    at: Quantities, formulation: Formulation, bits: int, partition: Partition
) -> Enclosure:
    """Return the enclosure with this precision, however few of its digits are certain."""
    with precision(bits):
        vdot, multipliers = at.solution(formulation, partition)
        vdot, v = (np.array([ball(x) for x in y], object) for y in (vdot, at.v))
        return Enclosure(vdot, multipliers, v, bits, _certain_digits(vdot, v))


def _certain_digits(vdot: Array, v: Array) -> float:
    """Return the certain decimal digits of the entry of v̇ that has the fewest, without a limit."""
    if not all(x.is_finite() for x in (*vdot, *v)):
        return -math.inf
    speed = max(x.abs_lower() for x in v)
    floor = max(max(x.abs_lower() for x in vdot), speed * speed) * flint.arb(VANISHING_SHARE)
    certain = math.inf
    for x in vdot:
        if x.rad() > 0:
            size = max(x.abs_lower(), floor)
            certain = min(certain, float((size / x.rad()).log_base(10))) if size > 0 else -math.inf
    return certain


# ---- Enclosures of derivatives -------------------------------------------------------------------


@dataclass(frozen=True)
class EnclosedDerivatives:
    """The derivatives of one state by a formulation, in balls that contain the true values.

    Attributes:
        q: ∂v̇/∂q (n, n) of `flint.arb`, and so on, as in `eomcheck.Derivatives`.
        v: ∂v̇/∂v (n, n).
        tau: ∂v̇/∂τ (n, n).
        multipliers_q: ∂λ/∂q (r, n), or None if the formulation has no multipliers.
        multipliers_v: ∂λ/∂v (r, n), or None.
        multipliers_tau: ∂λ/∂τ (r, n), or None.
        bits: working precision.
        digits: certain decimal digits of every entry of `q`, `v` and `tau`; an entry that vanishes
            needs none.
    """

    q: Array
    v: Array
    tau: Array
    multipliers_q: Array | None
    multipliers_v: Array | None
    multipliers_tau: Array | None
    bits: int
    digits: float

    def __repr__(self) -> str:
        """Return the text with 15 digits of each ball, independent of the current precision."""
        arrays = ((name, getattr(self, name)) for name in ARRAYS)
        shown = (f"{name}={None if x is None else _shown_rows(x)}" for name, x in arrays)
        return f"EnclosedDerivatives({', '.join(shown)}, bits={self.bits}, digits={self.digits})"


def _shown_rows(balls: Array) -> str:
    """Return the text of a matrix of balls."""
    return f"[{', '.join(map(_shown, balls))}]"


def enclose_derivatives(
    scene: Scene, key: str, q, v, tau=None, t: float = 0.0, digits: int = 30
) -> EnclosedDerivatives:
    """Return the enclosure of the derivatives of v̇ and λ by one formulation.

    It contains the derivatives of this formulation for exactly these float64 numbers, consistent or
    not; see `eomcheck.derivatives`.

    Args:
        scene: the scene.
        key: the formulation, a key of `eomcheck.FORMULATIONS`.
        q: coordinates (n,).
        v: velocities (n,); formulations in generalized speeds take the u of v.
        tau: generalized forces (n,) in addition to the scene's own; None for none.
        t: time, s.
        digits: decimal digits that must be certain in every entry of the derivatives of v̇.

    Raises:
        InputError: wrong shapes, values that are not finite, `digits` below 1 or above
            `MOST_DIGITS`, a formulation that does not apply to the scene.
        UnknownNameError: no such formulation.
        RefusedError: a matrix cannot be shown to be invertible, or the digits stay uncertain.
    """
    formulation = formulation_for(checked_scene(scene), key)
    q, v = scene.check_state(q, v, t)
    start = {"v": v, "tau": np.zeros(scene.n) if tau is None else finite_array("tau", tau, v.shape)}
    digits = whole_number("digits", digits, most=MOST_DIGITS)
    partition = Evaluation(scene, q, v, t).partition_for(formulation, pivoted=False)

    def with_bits(bits: int) -> EnclosedDerivatives:
        with precision(bits):
            at = _ball_quantities(scene, q, start, t, bits)
            directions = Direction(*map(Balls().numbers, unit_directions(scene.n)))
            both = solutions_along(at, formulation, directions, partition)
            rows = map_record(partial(map_entries, ball), both)
            arrays = arrays_by_name(rows, scene.n)
            fields: dict[str, Any] = dict.fromkeys(ARRAYS)
            fields |= {name: x.T for name, x in arrays.items()}
            certain = _certain_digits(np.ravel(rows[0]), at.v)
            return EnclosedDerivatives(**fields, bits=bits, digits=certain)

    return _with_certain_digits(with_bits, digits, formulation, "the derivatives of v̇")


# ---- Certified digits ----------------------------------------------------------------------------

REFERENCE = "kane"
"""Formulation of the certified reference value: O(N), and without large matrices."""

REFERENCE_WITHOUT_SPEEDS = "au"
"""Formulation of the reference value without generalized speeds; bounds allow for the rounded v."""

REFERENCE_DIGITS = 30
"""Certain digits of the reference value; twice those of float64 would suffice."""

FLOAT64_DIGITS = -math.log10(EPS / 2)
"""Decimal digits of a float64: those of half a unit in the last place of 1."""


@old_attributes
@dataclass(frozen=True)
class Accuracy:
    """The true error of a formulation in float64 at one state.

    Attributes:
        key: the formulation.
        vdot: its v̇ (n,) in float64.
        truth: the enclosure of the true v̇.
        error: |v̇ - true v̇| (n,), rounded up: an upper bound of the error.
        ulps: the error of each entry (n,) in units in the last place of its true value; infinite
            if that may be 0 and the result is not exact.
        relative: largest error over largest true entry, rounded up, also of numbers too small for
            float64; infinite if the largest true entry is 0 and the error is not.
        relative_bound: error bound that `eomcheck.acceleration` reports over largest true entry.
        condition: condition number of each matrix solved, by name.
        kappa: condition number κ of this computation, by which it amplifies relative changes
            (docs/explanation/tolerance.md); infinite if no bound is measured or the true v̇ is 0.
        ratio: observed error / (κ ε scale), which the constant C of the tolerances must exceed; NaN
            if κ is infinite or the true v̇ is 0.
    """

    key: str
    vdot: Array
    truth: Enclosure
    error: Array
    ulps: Array
    relative: float
    relative_bound: float
    condition: dict[str, float]
    kappa: float
    ratio: float

    @property
    def digits(self) -> float:
        """Correct decimal digits of v̇, relative to its largest entry."""
        return certified_digits(self.relative)

    @property
    def silently_wrong(self) -> bool:
        """Whether the result is wrong by more than its error bound reports."""
        return self.relative > max(NOTICEABLE, self.relative_bound)


def certified_digits(relative: float) -> float:
    """Return the correct decimal digits at a relative error, at most those of float64; 0 at NaN."""
    if not relative > 0:
        return FLOAT64_DIGITS if relative == 0 else 0.0
    return min(max(-math.log10(relative), 0.0), FLOAT64_DIGITS)


def true_acceleration(scene: Scene, q, u, t: float = 0.0) -> tuple[Enclosure, Evaluation]:
    """Return the true v̇ at (q, u, t), and the evaluation in float64 of the same state.

    Its velocity is the true one, W u + offset, rounded. A velocity computed in float64 would be
    that of other speeds, different by the rounding error times the largest entry of W.

    Raises:
        InputError: wrong shapes or values that are not finite.
        RefusedError: the true v̇ has no certain digits, or the velocity overflows.
    """
    truth = enclose(scene, REFERENCE, q, u, t, REFERENCE_DIGITS)
    at = Evaluation(scene, q, representable("v", midpoints_or_zero(truth.v)), t)
    at.u = np.array(u, dtype=np.float64)
    return truth, at


def true_error(vdot: Array, truth: Enclosure) -> Array:
    """Return |v̇ - true v̇| (n,), rounded up."""
    errors = _errors(vdot, truth)
    nearest = midpoints(np.array(errors, object))
    return np.where([error == 0 for error in errors], 0.0, np.nextafter(nearest, np.inf))


def _errors(vdot: Array, truth: Enclosure) -> list:
    """Return upper bounds of |v̇ - true v̇|, a `flint.arb` for each entry."""
    with precision(truth.bits):
        return [abs(ball(float(x)) - y).upper() for x, y in zip(vdot, truth.vdot, strict=True)]


def relative_error(vdot: Array, truth: Enclosure) -> float:
    """Return max |v̇ - true v̇| / max |true v̇|, rounded up."""
    error = max(_errors(vdot, truth))
    return math.nextafter(_relative_to_truth(error, truth), math.inf) if error > 0 else 0.0


def _relative_to_truth(error, truth: Enclosure) -> float:
    """Return an error over the largest true entry, either of which may be too small for float64."""
    with precision(truth.bits):
        size = max(y.abs_lower() for y in truth.vdot)
        if error == 0 or not size > 0:
            return 0.0 if error == 0 else math.inf
        return float((ball(error) / size).mid())


def accuracy(
    scene: Scene, key: str, q, u=None, t: float = 0.0, *, v=None, pivoted: bool = False
) -> Accuracy:
    """Return the true error of one formulation in float64, with the condition of its matrices.

    From u, formulations in Lagrange's terms compute with the true velocity W u + offset, rounded to
    float64, and those in generalized speeds with u. The true v̇ is the same for all. From v,
    consistent or not, each is compared with its own exact result for these float64 numbers.

    Args:
        scene: the scene.
        key: the formulation, a key of `eomcheck.FORMULATIONS`.
        q: coordinates (n,).
        u: generalized speeds (p,), or
        v: velocities (n,).
        t: time, s.
        pivoted: for El and Em, choose the dependent coordinates by pivoted QR.

    Returns:
        The result in float64, the enclosure of the true v̇, and the errors between them.

    Raises:
        InputError, UnknownNameError: as `eomcheck.enclose`.
        RefusedError: the formulation refuses the state in float64, or the true v̇ has no certain
            digits.
    """
    formulation = formulation_for(checked_scene(scene), key)
    if v is None:
        return accuracy_at(formulation, *true_acceleration(scene, q, u, t), pivoted)
    truth = enclose(scene, key, q, u, t, REFERENCE_DIGITS, v=v, pivoted=pivoted)
    return accuracy_at(formulation, truth, Evaluation(scene, q, v, t), pivoted)


def accuracy_at(
    formulation: Formulation,
    truth: Enclosure,
    at: Evaluation,
    pivoted: bool = False,
    sensitivity: float | None = None,
) -> Accuracy:
    """Return the `Accuracy` of `formulation` at a state with its true v̇, see `true_acceleration`.

    A formulation that leaves redundant rows out is compared with the true v̇ of the rows that it
    keeps: rows that are redundant within rounding are hardly ever redundant exactly, and all rows
    have another solution.

    Args:
        formulation: the formulation.
        truth: the enclosure of the true v̇.
        at: the evaluation in float64.
        pivoted: whether it chooses its partition by pivoted QR.
        sensitivity: the result of `acceleration_sensitivity` at `at`, if known.

    Raises:
        InputError: `pivoted`, and the formulation has no partition.
        RefusedError: the formulation refuses the state in float64, or its true v̇ has no certain
            digits.
    """
    result = solution_of(at, formulation, pivoted)
    if formulation.redundant and at.independent_partition.redundant is not None:
        truth = enclosure_at(
            at.scene,
            formulation,
            at.q,
            {"v": at.v},
            at.t,
            REFERENCE_DIGITS,
            at.independent_partition,
        )
    if sensitivity is None:
        sensitivity = float(acceleration_sensitivity(at, formulation, pivoted=pivoted))
    exact, error = truth.doubles(), true_error(result.vdot, truth)
    scale = largest(exact)
    nonzero = [not x.contains(0) for x in truth.vdot]
    with np.errstate(all="ignore"):
        ulps = np.where(nonzero, error / np.spacing(np.abs(exact)), np.inf)
    ulps[error == 0] = 0.0
    return Accuracy(
        formulation.key,
        result.vdot,
        truth,
        error,
        ulps,
        relative_error(result.vdot, truth),
        _relative_to_truth(allowed_error(sensitivity), truth),
        {name: 1.0 / rcond for name, rcond in result.rcond.items()},
        sensitivity / scale if scale > 0 else math.inf,
        _ratio(largest(error), sensitivity, scale),
    )


def _ratio(error: float, sensitivity: float, scale: float) -> float:
    """Return the error over that of a relative change ε, or NaN; see `Accuracy`."""
    if not math.isfinite(sensitivity) or scale == 0:
        return math.nan
    return error / (EPS * sensitivity)
