"""Failures made small, and those of one cause at another case."""

from __future__ import annotations

from collections.abc import Sequence

from eomcheck.claims import CLAIMS, Finding
from eomcheck.claims.run import Selection, no_larger, smallest_failure
from eomcheck.lab.fuzzing.families import Case
from eomcheck.lab.fuzzing.finds import cause_of
from eomcheck.lab.fuzzing.judging import about, failures
from eomcheck.lab.fuzzing.rounding import rounded
from eomcheck.mechanics.scene import Scene


def shrunk(finding: Finding, formulations: Sequence[str], seed: int = 0) -> Finding:
    """Return a failure of the same claim about the same formulations, smaller and rounder.

    Smaller ones are looked for by hypothesis, then each number is tried at 0, at 1 and with fewer
    digits. What an engine says is left as it is: each try would make the engine again.
    """
    scene = finding.scene
    assert isinstance(scene, Scene)
    selection = Selection.of(formulations, [], [finding.claim], scenes=[type(scene)])
    if not CLAIMS[finding.claim].asks:
        links = (1, getattr(scene, "links", 1))
        smaller = smallest_failure(finding, no_larger(scene, links), selection, seed)
        finding = smaller if about(smaller) == about(finding) else finding

        def look(case: Case) -> list[Finding]:
            return failures(case, [finding.claim], formulations)

        finding = rounded(finding, look)
    return finding


def alike(failed: Finding, case: Case, formulations: Sequence[str]) -> list[Finding]:
    """Return the failures at another case of the same claim, and of the same cause."""
    if CLAIMS[failed.claim].asks:
        return []
    found = failures(case, [failed.claim], formulations)
    return [one for one in found if cause_of(one) == cause_of(failed)]
