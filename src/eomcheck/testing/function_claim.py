"""Claims about user-supplied functions, each registered by the generator of its outcomes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from eomcheck.claims.finding import Verdict
from eomcheck.claims.registry import Names, Skipped
from eomcheck.numbers.generic import Array
from eomcheck.testing.function_state import FunctionState
from eomcheck.testing.uncertain import UncertainArray


class UncertainComparison(NamedTuple):
    """found = expected, about `subject`.

    Attributes:
        subject: what is compared.
        actual: theirs.
        expected: what it should be, same shape.
        names: names along each axis.
        explain: says what `actual` looks like beside `expected`, of what is allowed and the worst
            entry, "" where that is nothing it knows; None for what is said of any two arrays.
    """

    subject: str
    actual: UncertainArray
    expected: UncertainArray
    names: Names
    explain: Callable[[Array, Array, float, tuple[int, ...]], str] | None = None


class Decision(NamedTuple):
    """What a claim has decided by itself; see `eomcheck.Finding`."""

    subject: str
    observed: float
    allowed: float
    verdict: Verdict
    detail: str = ""


class BlindSpot(NamedTuple):
    """What cannot be told of an input.

    Attributes:
        about: the input, a key of `eomcheck.testing.equations_of_motion.INPUTS`.
        what: what would not be noticed.
        revealed_by: inputs any one of which would tell; "against" is what one compares with, "x &
            y" is both together, "x|y" either.
        derived: whether it is so only where functions come out of one derivation.
    """

    about: str
    what: str
    revealed_by: tuple[str, ...]
    derived: bool = False

    def revealing_inputs(self, at: FunctionState) -> str:
        """Inputs that are missing and would tell, in words; "" where nothing is missing."""
        alternatives: list[str] = []
        for one in self.revealed_by:
            missing = [x for x in one.split(" & ") if not has_any(at, x)]
            if not missing:
                return ""
            alternatives.append(" with ".join(missing).replace("|", " or "))
        joined = ", ".join(alternatives[:-1])
        return f"{joined} or {alternatives[-1]}" if joined else alternatives[-1]


ClaimOutput = UncertainComparison | Decision | Skipped


def has_any(at: FunctionState, names: str) -> bool:
    """Return whether one of the quantities "x|y" is there."""
    return any(at.has(one) for one in names.split("|"))


@dataclass(frozen=True)
class FunctionClaim:
    """One statement about somebody's functions at a state.

    Attributes:
        id: short name.
        statement: what is claimed, in symbols.
        term: what is to blame when it fails.
        needs: names of quantities without which it is skipped; "T|M" is either.
        without: names of inputs with which it does not hold.
        natural: whether it holds only where T is quadratic in v, see `FunctionState.natural`.
        consistent: whether it is looked at where the constraints hold, see
            `FunctionState.consistent`.
        blind_spots: what cannot be told where what it needs is missing.
        evaluate: function of a `FunctionState`.
    """

    id: str
    statement: str
    term: str
    needs: tuple[str, ...]
    without: tuple[str, ...]
    natural: bool
    consistent: bool
    blind_spots: tuple[BlindSpot, ...]
    evaluate: Callable[[FunctionState], Iterator[ClaimOutput]] = field(repr=False)

    def applies(self, at: FunctionState) -> bool:
        """Return whether what it needs is there, and nothing with which it does not hold."""
        there = all(has_any(at, name) for name in self.needs)
        return there and not any(at.has(name) for name in self.without)


FUNCTION_CLAIMS: dict[str, FunctionClaim] = {}
"""Id -> claim, single functions before what ties them together: the first that fails is closest."""


def function_claim(
    id: str,
    statement: str,
    term: str,
    needs: tuple[str, ...] = (),
    *,
    without: tuple[str, ...] = (),
    natural: bool = False,
    consistent: bool = False,
    blind_spots: tuple[BlindSpot, ...] = (),
) -> Callable:
    """Register the decorated function of a `FunctionState`, which yields `ClaimOutput`s."""

    def register(look: Callable[[Any], Iterator[ClaimOutput]]) -> Callable:
        FUNCTION_CLAIMS[id] = FunctionClaim(
            id, statement, term, needs, without, natural, consistent, blind_spots, look
        )
        return look

    return register
