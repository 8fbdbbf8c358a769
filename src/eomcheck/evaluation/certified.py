"""Certified accelerations by ball arithmetic, and the certified digits of a float64 result.

`enclose` returns the acceleration of a formulation in balls that provably contain the true values.
`accuracy` measures the true error of a float64 result against such an enclosure.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import flint
import numpy as np

from eomcheck.errors import InputError, RefusedError, whole_number
from eomcheck.evaluation.dynamics import representable, solution_of
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import acceleration_sensitivity
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.evaluation.tolerance import NOTICEABLE, allowed_error, largest
from eomcheck.formulations import Formulation, Partition, formulation_for
from eomcheck.mechanics.scene import Scene, checked_scene, finite_array
from eomcheck.numbers.ball import Balls, ball, midpoints, midpoints_or_zero, precision
from eomcheck.numbers.generic import Array
from eomcheck.numbers.pivots import EPS

# ---- Enclosures ----------------------------------------------------------------------------------

GUARD_BITS = 64
"""Bits beyond the digits asked for with which the search for the precision starts."""

MOST_BITS = 4096
"""Precision at which the search gives up, unless the digits asked for need more than a quarter."""

MOST_DIGITS = 1_000_000
"""Decimal digits that may be asked for: a ball then takes half a megabyte."""

ZERO = 2.0**-400
"""An entry below this share of the larger of |v̇| and |v|² passes for zero, which has no digits."""


@dataclass(frozen=True)
class Enclosure:
    """What a formulation says about one state, in balls that contain the true values.

    Attributes:
        vdot: v̇ (n,) of `flint.arb`, m/s² and rad/s².
        multipliers: λ (r,) of `flint.arb`, or None where the formulation has none.
        v: the velocity W u + offset (n,) of `flint.arb`.
        bits: working precision that it took.
        digits: decimal digits that are certain of every entry of v̇; one that vanishes needs none.
    """

    vdot: Array
    multipliers: Array | None
    v: Array
    bits: int
    digits: float

    def __repr__(self) -> str:
        """Return 15 digits of each ball, whatever precision another thread computes with."""
        vdot, v = (_shown(balls) for balls in (self.vdot, self.v))
        multipliers = None if self.multipliers is None else _shown(self.multipliers)
        return (
            f"Enclosure(vdot={vdot}, multipliers={multipliers}, v={v}, bits={self.bits}, "
            f"digits={self.digits})"
        )

    def doubles(self) -> Array:
        """Return v̇ (n,), the midpoints rounded to doubles, 0 where it may vanish."""
        return midpoints_or_zero(self.vdot)

    def overlaps(self, other: Enclosure) -> Array:
        """Return (n,), whether the balls of v̇ have a point in common, entry by entry."""
        return np.array([x.overlaps(y) for x, y in zip(self.vdot, other.vdot, strict=True)])


SHOWN = 15
"""Digits of a ball in the text of an enclosure."""


def _shown(balls: Array) -> str:
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
    """Return the acceleration of `scene` by one formulation, enclosed.

    From u the velocity v = W u + offset is formed in balls: one in doubles would never satisfy the
    constraints exactly, and formulations would be asked different questions. With v given instead,
    the answer is that of this formulation to exactly these doubles, be they consistent or not.

    Args:
        scene: the scene.
        key: the formulation, a key of `eomcheck.FORMULATIONS`.
        q: coordinates (n,).
        u: generalized speeds (p,), or
        v: velocities (n,); those in generalized speeds take the u of v.
        t: time, s.
        digits: decimal digits that must be certain of every entry of v̇.
        pivoted: for El and Em, choose the dependent coordinates by pivoted QR.

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
    return enclosure(scene, formulation, q, start, t, digits, partition)


def enclosure(
    scene: Scene,
    formulation: Formulation,
    q: Array,
    start: dict[str, Array],
    t: float,
    digits: int,
    partition: Partition,
    known: dict[int, Quantities] | None = None,
) -> Enclosure:
    """Return what `enclose` returns, of arguments that were checked; `start` is {"u": u} or v.

    Formulations at one state share what they read of it in `known`, by the bits it was found with.
    """
    known = {} if known is None else known
    bits = math.ceil(digits * math.log2(10.0)) + GUARD_BITS
    most = max(MOST_BITS, 4 * bits)
    while True:
        try:
            if bits not in known:
                known[bits] = _in_balls(scene, q, start, t, bits)
            found = _with_bits(known[bits], formulation, bits, partition)
        except RefusedError:
            if bits >= most:
                raise
        else:
            if found.digits >= digits:
                return found
            if bits >= most:
                raise RefusedError(
                    "v̇",
                    0.0,
                    0.0,
                    f"{formulation.key}: with {bits} bits {max(found.digits, 0.0):.0f} digits of "
                    f"every entry of v̇ are certain, asked for are {digits}",
                )
        bits *= 2


def _in_balls(scene: Scene, q: Array, start: dict[str, Array], t: float, bits: int) -> Quantities:
    balls = Balls()
    with precision(bits):
        at = Quantities(scene, balls, balls.numbers(q), balls.numbers(np.array(t)).item())
        for name, value in start.items():
            setattr(at, name, balls.numbers(value))
    return at


def _with_bits(
    at: Quantities, formulation: Formulation, bits: int, partition: Partition
) -> Enclosure:
    with precision(bits):
        vdot, multipliers = at.solution(formulation, partition)
        vdot, v = (np.array([ball(x) for x in y], object) for y in (vdot, at.v))
        return Enclosure(vdot, multipliers, v, bits, _certain_digits(vdot, v))


def _certain_digits(vdot: Array, v: Array) -> float:
    if not all(x.is_finite() for x in (*vdot, *v)):
        return -math.inf
    speed = max(x.abs_lower() for x in v)
    floor = max(max(x.abs_lower() for x in vdot), speed * speed) * flint.arb(ZERO)
    certain = math.inf
    for x in vdot:
        if x.rad() > 0:
            size = max(x.abs_lower(), floor)
            certain = min(certain, float((size / x.rad()).log_base(10))) if size > 0 else -math.inf
    return certain


# ---- Certified digits ----------------------------------------------------------------------------

REFERENCE = "kane"
"""The formulation whose enclosure is taken for the truth: O(N), and without large matrices."""

REFERENCE_WITHOUT_SPEEDS = "au"
"""And where there are no generalized speeds; of v as it is, which bounds allow for."""

REFERENCE_DIGITS = 30
"""Digits of the truth; twice those of doubles would do."""

FLOAT64_DIGITS = -math.log10(EPS / 2)


@dataclass(frozen=True)
class Accuracy:
    """What a formulation delivers in doubles at one state.

    Attributes:
        key: the formulation.
        vdot: its v̇ (n,) in doubles.
        truth: the enclosed v̇.
        error: |v̇ - true v̇| (n,), rounded up: nowhere is the error larger.
        ulps: the error of each entry (n,) in units in the last place of its true value; infinite
            where that may be 0 and the result is not exact.
        relative: largest error over largest true entry, rounded up, of numbers too small for
            doubles as well; infinite if the largest true entry is 0 and the error not.
        relative_bound: error bound that `eomcheck.acceleration` reports over largest true entry.
        condition: condition number of each matrix solved, by name.
        kappa: how strongly this computation amplifies relative changes (docs/tolerance.md);
            infinite where no bound can be measured or the truth is 0.
        ratio: observed error / (κ ε scale): what the constant C of the tolerances must exceed; NaN
            where nothing is foreseen, because κ is infinite or there is nothing to lose.
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
        """Decimal digits of v̇ that are right, relative to its largest entry."""
        return certified_digits(self.relative)

    @property
    def silent(self) -> bool:
        """Whether the result is wrong and does not say so."""
        return self.relative > max(NOTICEABLE, self.relative_bound)


def certified_digits(relative: float) -> float:
    """Return the decimal digits that a relative error leaves, at most those that doubles have."""
    if not relative > 0:
        return FLOAT64_DIGITS if relative == 0 else 0.0
    return min(max(-math.log10(relative), 0.0), FLOAT64_DIGITS)


def true_state(scene: Scene, q, u, t: float = 0.0) -> tuple[Enclosure, Evaluation]:
    """Return the true v̇ at (q, u, t), and the evaluation in doubles of the same state.

    Its velocity is the true one, W u + offset, rounded. One that was found in doubles would be that
    of other speeds, by rounding times the largest entry of W.

    Raises:
        InputError: wrong shapes or values that are not finite.
        RefusedError: the truth has no digits here, or the velocity overflows.
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
    with precision(truth.bits):
        return [abs(ball(float(x)) - y).upper() for x, y in zip(vdot, truth.vdot, strict=True)]


def relative_error(vdot: Array, truth: Enclosure) -> float:
    """Return max |v̇ - true v̇| / max |true v̇|, rounded up."""
    error = max(_errors(vdot, truth))
    return math.nextafter(_over(error, truth), math.inf) if error > 0 else 0.0


def _over(error, truth: Enclosure) -> float:
    """Return an error over the largest true entry, which may be too small for doubles."""
    with precision(truth.bits):
        size = max(y.abs_lower() for y in truth.vdot)
        if error == 0 or not size > 0:
            return 0.0 if error == 0 else math.inf
        return float((ball(error) / size).mid())


def accuracy(
    scene: Scene, key: str, q, u=None, t: float = 0.0, *, v=None, pivoted: bool = False
) -> Accuracy:
    """Return the true error of one formulation in doubles, with what it solved on the way.

    From u, formulations in Lagrange's terms are given the true velocity W u + offset, rounded to
    doubles; those in generalized speeds are given u. The truth is the same for all. With v given
    instead, consistent or not, each is compared with its own exact answer to these doubles.

    Args:
        scene: the scene.
        key: the formulation, a key of `eomcheck.FORMULATIONS`.
        q: coordinates (n,).
        u: generalized speeds (p,), or
        v: velocities (n,).
        t: time, s.
        pivoted: for El and Em, choose the dependent coordinates by pivoted QR.

    Raises:
        InputError, UnknownNameError: as `eomcheck.enclose`.
        RefusedError: the formulation refuses the state in doubles, or the truth has no digits.
    """
    formulation = formulation_for(checked_scene(scene), key)
    if v is None:
        return certify(formulation, *true_state(scene, q, u, t), pivoted)
    truth = enclose(scene, key, q, u, t, REFERENCE_DIGITS, v=v, pivoted=pivoted)
    return certify(formulation, truth, Evaluation(scene, q, v, t), pivoted)


def certify(
    formulation: Formulation,
    truth: Enclosure,
    at: Evaluation,
    pivoted: bool = False,
    sensitivity: float | None = None,
) -> Accuracy:
    """Return the `Accuracy` of `formulation` at what `true_state` returned.

    One that leaves redundant rows out is compared with the truth of those that it keeps: what is
    redundant to rounding hardly ever is to the last digit, and all rows have another answer.

    Args:
        formulation: the formulation.
        truth: the true v̇.
        at: the evaluation in doubles.
        pivoted: whether it chooses its partition by pivoted QR.
        sensitivity: what `acceleration_sensitivity` says here, if that is known.

    Raises:
        InputError: `pivoted`, and the formulation has no partition.
        RefusedError: the formulation refuses the state in doubles, or its truth has no digits.
    """
    result = solution_of(at, formulation, pivoted)
    if formulation.redundant and at.independent_partition.redundant is not None:
        how = {"v": at.v}, at.t, REFERENCE_DIGITS, at.independent_partition
        truth = enclosure(at.scene, formulation, at.q, *how)
    if sensitivity is None:
        sensitivity = acceleration_sensitivity(at, formulation, pivoted=pivoted)
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
        _over(allowed_error(sensitivity), truth),
        {name: 1.0 / rcond for name, rcond in result.rcond.items()},
        sensitivity / scale if scale > 0 else math.inf,
        _ratio(largest(error), sensitivity, scale),
    )


def _ratio(error: float, sensitivity: float, scale: float) -> float:
    if not math.isfinite(sensitivity) or scale == 0:
        return math.nan
    return error / (EPS * sensitivity)
