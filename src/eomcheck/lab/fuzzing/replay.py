"""Finds looked at again: those that still fail."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from eomcheck.claims import CLAIMS, Finding
from eomcheck.lab.fuzzing.finds import FUNCTIONS, Find, find_of
from eomcheck.lab.fuzzing.judging import Fault, failures
from eomcheck.lab.fuzzing.motions import failures_of_motion
from eomcheck.testing.run import functions_at
from eomcheck.testing.subject import Functions


def replayed(
    finds: Iterable[Find], formulations: Sequence[str], looked_at: Callable[[], None] = lambda: None
) -> list[Find]:
    """Return those finds that still fail, with what is observed now."""
    still = []
    for one in finds:
        failed = _failures_again(one, formulations)
        told = Fault(one.whose, one.evidence) if one.t_end or one.whose == FUNCTIONS else None
        still += [find_of(x, one.scene, told) for x in failed[:1]]
        looked_at()
    return still


def _failures_again(one: Find, formulations: Sequence[str]) -> Sequence[Finding]:
    """Return what still fails of a find."""
    scene, state = one.case
    same = one.claim, one.subject
    if isinstance(scene, Functions):
        found = functions_at(scene, state, [one.claim])
    elif one.t_end:
        found = failures_of_motion((scene, state), formulations, one.t_end)
    else:
        return failures((scene, state), [one.claim] if one.claim else list(CLAIMS), formulations)
    return [x for x in found if x.verdict == "failed" and (x.claim, x.subject) == same]
