"""Claims about user-supplied functions: statements such as M = Mᵀ that are checked at a state.

A claim is a generator that the decorator `function_claim` registers in `FUNCTION_CLAIMS`. From a
`FunctionState` it yields outcomes: comparisons of two uncertain arrays, decisions of its own, or
reasons why something was skipped.
"""

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
    """Comparison actual = expected of two arrays with errors.

    Attributes:
        subject: name of the compared quantity.
        actual: value from the functions under test.
        expected: expected value, same shape.
        names: names along each axis.
        explain: function (actual, expected, allowed error, index of the worst entry) -> diagnosis,
            "" where it has none; None for the diagnosis of any two arrays.
    """

    subject: str
    actual: UncertainArray
    expected: UncertainArray
    names: Names
    explain: Callable[[Array, Array, float, tuple[int, ...]], str] | None = None


class Decision(NamedTuple):
    """Verdict that a claim has reached by itself; attributes as in `eomcheck.Finding`."""

    subject: str
    observed: float
    allowed: float
    verdict: Verdict
    detail: str = ""


class BlindSpot(NamedTuple):
    """Fault of an input that cannot be detected while other inputs are missing.

    Attributes:
        about: the input, a key of `eomcheck.testing.equations_of_motion.INPUTS`.
        what: description of the fault.
        revealed_by: inputs any one of which would reveal it; "against" is the reference, "x & y"
            both together, "x|y" either.
        derived: whether this holds only where all functions result from one derivation.
    """

    about: str
    what: str
    revealed_by: tuple[str, ...]
    derived: bool = False

    def revealing_inputs(self, at: FunctionState) -> str:
        """Return the missing inputs that would reveal it, as text; "" where none is missing."""
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
    """Return whether one of the quantities "x|y" is available."""
    return any(at.has(one) for one in names.split("|"))


@dataclass(frozen=True)
class FunctionClaim:
    """Statement about user-supplied functions at a state.

    Attributes:
        id: short name.
        statement: the statement, in symbols.
        term: term to blame when it fails.
        needs: names of quantities without which it is skipped; "T|M" is either.
        without: names of inputs with which it does not hold.
        natural: whether it holds only where T is quadratic in v, see `FunctionState.natural`.
        consistent: whether it is checked where the constraints hold, see
            `FunctionState.consistent`.
        blind_spots: faults that cannot be detected while inputs it needs are missing.
        evaluate: function of a `FunctionState` that yields the outcomes.
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
        """Return whether all it needs is available, and no input with which it does not hold."""
        there = all(has_any(at, name) for name in self.needs)
        return there and not any(at.has(name) for name in self.without)


FUNCTION_CLAIMS: dict[str, FunctionClaim] = {}
"""Id -> claim, single functions before relations between them: the first failure is closest to its
cause."""


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
    """Register the decorated function of a `FunctionState`, which yields `ClaimOutput`s.

    Args:
        id, statement, term, needs, without, natural, consistent, blind_spots: attributes of the
            `FunctionClaim`.
    """

    def register(evaluate: Callable[[Any], Iterator[ClaimOutput]]) -> Callable:
        FUNCTION_CLAIMS[id] = FunctionClaim(
            id, statement, term, needs, without, natural, consistent, blind_spots, evaluate
        )
        return evaluate

    return register
