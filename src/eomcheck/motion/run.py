"""What one integration gives in more digits than doubles hold, and how far two are apart."""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal, InvalidOperation, localcontext
from typing import Any

import numpy as np

from eomcheck.errors import InputError
from eomcheck.numbers.contract import Array

DIGITS = 36
"""Significant decimal digits that are kept: as many as quad precision has."""


@dataclass(frozen=True)
class Run:
    """One integration; its numbers are of the type `decimal.Decimal`.

    Attributes:
        times: output times (k,), s, doubles.
        q: coordinates (k, n).
        v: velocities (k, n).
        energy: T + U (k,), J; None if the scene does not keep it.
        drift: largest |E - E_0| / |E_0| over all steps, not only at the output times; None
            without energy.
        facts: method, library, precision, orders, steps, seconds.
    """

    times: list[float]
    q: Array
    v: Array
    energy: Array | None
    drift: float | None
    facts: dict[str, Any]


def decimals(x: Array) -> Array:
    """Return the strings of digits x as finite `decimal.Decimal`s, same shape.

    Raises:
        ValueError: one is no finite number.
    """
    out = np.empty(x.shape, object)
    with localcontext(prec=DIGITS):
        try:
            out.ravel()[:] = [+Decimal(y) for y in x.ravel()]
        except (InvalidOperation, TypeError):
            raise ValueError("not all numbers are strings of digits") from None
    if not all(y.is_finite() for y in out.ravel()):
        raise ValueError("not all numbers are finite")
    return out


def difference(one: Run, other: Run) -> list[float]:
    """Return the largest |difference| over q and v at each time, in their own units.

    Raises:
        InputError: the runs are of different times or sizes.
    """
    if one.times != other.times or one.q.shape != other.q.shape:
        raise InputError("the two runs differ in their times or in their number of coordinates")
    with localcontext(prec=DIGITS + 5):
        apart = np.abs(np.hstack((one.q - other.q, one.v - other.v)))
    return [float(row.max()) for row in apart]
