"""The true acceleration, with a radius that is proved: formulations in ball arithmetic."""

from __future__ import annotations

import math
from dataclasses import dataclass

import flint
import numpy as np

from eomcheck.errors import InputError, RefusedError, whole_number
from eomcheck.evaluation.doubles import Evaluation
from eomcheck.evaluation.point import Quantities
from eomcheck.formulations import Formulation, Partition, formulation_for
from eomcheck.mechanics.scene import Scene, checked_scene, finite_array
from eomcheck.numbers.ball import Balls, as_doubles, ball, precision
from eomcheck.numbers.contract import Array

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
        return as_doubles(self.vdot)

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
