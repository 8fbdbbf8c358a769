"""What a claim of the paper is, and how it is judged."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal, NamedTuple

from eomcheck.formulations import kane, ml
from eomcheck.lab.store.record import Record
from eomcheck.lab.studies.paper.measure import Found

Verdict = Literal["holds", "holds partly", "does not hold here", "not measured"]

CLEAR = 2.0
UNFORESEEN = "Not foreseen: no reason is known."
NOTHING = "Nothing to compare."

KANE, ML = kane.KANE.key, ml.ML.key


class Evidence(NamedTuple):
    """Comparisons that are as the paper says, all comparisons, and a sentence of numbers."""

    good: int
    of: int
    measured: str


@dataclass(frozen=True)
class PaperClaim:
    """One claim of the paper.

    Attributes:
        place: where.
        says: what, in our words.
        look: what the Records say.
        true: why it holds, where it does.
        false: why not, where it does not or only in part.
    """

    place: str
    says: str
    look: Callable[[Found], Evidence]
    true: str
    false: str


class Judgement(NamedTuple):
    """A claim, the numbers measured, the verdict, and why it is so."""

    claim: PaperClaim
    measured: str
    verdict: Verdict
    why: str


PAPER_CLAIMS: list[PaperClaim] = []
"""Equations first, then errors, then CPU time."""


def verdict_of(evidence: Evidence) -> Verdict:
    """Return what the comparisons amount to."""
    if evidence.of == 0:
        return "not measured"
    if evidence.good == evidence.of:
        return "holds"
    return "holds partly" if 2 * evidence.good >= evidence.of else "does not hold here"


def judge(claim: PaperClaim, found: Found) -> Judgement:
    """Return what the Records say to one claim."""
    evidence = claim.look(found)
    verdict = verdict_of(evidence)
    why = {"holds": claim.true, "not measured": "These Records do not show it."}
    return Judgement(claim, evidence.measured, verdict, why.get(verdict, claim.false))


def judgements(records: Iterable[Record]) -> list[Judgement]:
    """Return what the Records say to every claim."""
    found = Found(records)
    return [judge(claim, found) for claim in PAPER_CLAIMS]


def claim(place: str, says: str, true: str = UNFORESEEN, false: str = UNFORESEEN) -> Callable:
    """Register the decorated function as the `look` of a claim."""

    def register(look: Callable[[Found], Evidence]) -> Callable:
        PAPER_CLAIMS.append(PaperClaim(place, says, look, true, false))
        return look

    return register
