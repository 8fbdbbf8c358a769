"""Findings on a robot by the library that reads the robot's file itself.

Both derivations of a robot are made of one description, so that no claim sees a misread file. The
library of the file takes part by default, and is a second reader, not one that is always right:
a difference is a failure of which either reading may be the cause, and quantities that the library
leaves out are skipped with the reason.
"""

from __future__ import annotations

from dataclasses import replace

from eomcheck.claims.case import Case
from eomcheck.claims.finding import Finding
from eomcheck.claims.registry import Claim
from eomcheck.claims.selection import Asked
from eomcheck.claims.trial import unseen

EITHER = "the file is read in two ways: either reading may be wrong"


def of_file(asked: Asked, case: Case, claim: Claim) -> list[Finding]:
    """Return the Findings of one claim; those by the file's library name no one to blame."""
    findings = [_neutral(asked, case, claim, one) for one in case.look(claim)]
    if asked.unread is not None and claim.asks == "mass_matrix":
        kind, why = asked.unread
        findings.append(unseen(case, kind, f"takes no part: {why}"))
    return findings


def _neutral(asked: Asked, case: Case, claim: Claim, finding: Finding) -> Finding:
    reader = asked.reader
    if reader is None or finding.engine is not type(reader) or finding.verdict != "failed":
        return finding
    if reason := reader.leaves_out(claim.asks):
        skipped = unseen(case, type(reader), reason)
        return replace(skipped, subject=finding.subject)
    return finding.because(EITHER)
