"""Proofs as a table, and on a terminal."""

from __future__ import annotations

from collections.abc import Iterable

from eomcheck.console import console
from eomcheck.lab.proofs import Proofs
from eomcheck.lab.report.claims import name_of
from eomcheck.lab.report.findings import print_unseen
from eomcheck.lab.report.judged import Judged, by_claim
from eomcheck.lab.show.table import Sheet, print_sheets
from eomcheck.lab.store.groups import group
from eomcheck.safe_output import counted


def proof_sheet(claims: Iterable[Judged]) -> Sheet:
    """Return what was proved of each claim, and how surely."""
    counts = {"proved": "passed", "disproved": "failed", "not looked at": "not looked at"}
    bounds = "degree ≤", "height ≤", "failure probability <"
    rows = []
    for one in claims:
        of = group(one.rows, lambda row: row.verdict)
        proofs = [row.proof for row in one.rows if row.proof is not None]
        rows.append(
            [
                name_of(one),
                one.claim.statement,
                *(str(len(of[verdict])) if verdict in of else "" for verdict in counts.values()),
                str(max((p.degree for p in proofs), default="")),
                f"{max(p.height for p in proofs):.0f} bits" if proofs else "",
                f"{max(p.failure_probability for p in proofs):.1e}" if proofs else "",
            ]
        )
    return Sheet("proofs", "", ["claim", "statement", *counts, *bounds], rows)


def print_proofs(proofs: Proofs) -> None:
    """Print the table, the total failure probability, and every disproof."""
    rows = [one for found in proofs.findings.values() for one in found]
    claims = by_claim(rows)
    if not claims:
        console.print("nothing was proved")
        return
    print_sheets([proof_sheet(claims)])
    print_unseen(claims)
    if proofs.started_over:
        console.print("an unfinished file of other settings or sources was started over")
    of = group(rows, lambda row: row.verdict)
    done, asked, failed = len(proofs.findings), len(proofs.jobs.scenes), len(of.get("failed", []))
    earlier = f" ({proofs.taken_over} of them in an earlier run)" if proofs.taken_over else ""
    console.print(
        f"[bold {'red' if failed else 'green'}]"
        f"{counted(len(of.get('passed', [])), 'identity')} proved, "
        f"{failed} disproved[/] on {done} of {counted(asked, 'structure')}{earlier}"
    )
    if "passed" not in of:
        return
    console.print(
        f"Had any of them been false, all its points would have hidden it with a probability below "
        f"{sum(one.failure_probability or 0.0 for one in claims):.1e} ({proofs.jobs.points} random "
        f"points and primes each, seed {proofs.seed})."
    )
