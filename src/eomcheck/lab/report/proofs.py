"""Proofs as a table of claims: what was proved, for what, with which probability of a mistake."""

from __future__ import annotations

from typing import Any

from rich.markup import escape
from rich.table import Table

from eomcheck.claims import CLAIMS
from eomcheck.console import console
from eomcheck.lab.proofs import Proofs
from eomcheck.lab.show.layout import numbers, table, words


def print_proofs(proofs: Proofs) -> None:
    """Print the table, the total failure probability, and every disproof."""
    rows = [row for found in proofs.findings.values() for row in found]
    if not rows:
        console.print("nothing was proved")
        return
    console.print(_table(rows))
    failed = [row for row in rows if row["verdict"] == "failed"]
    for row in _first_of_each(failed):
        console.print(
            f"{row['claim']} \\[{escape(row['subject'])}] {row['evidence']} on "
            f"{escape(row['structure'])}: "
            f"{escape(row['detail'])}",
            style="red",
            highlight=False,
            soft_wrap=True,
        )
    for row in _first_of_each([row for row in rows if row["verdict"] == "inconclusive"]):
        console.print(
            f"not looked at: {row['claim']} \\[{escape(row['subject'])}] on "
            f"{escape(row['structure'])}: {escape(row['detail'])}",
            highlight=False,
            soft_wrap=True,
        )
    if proofs.started_over:
        console.print("an unfinished file of other settings or sources was started over")
    proved = [row for row in rows if "proof" in row]
    total = sum(row["proof"]["failure_probability"] for row in proved)
    done, asked = len(proofs.findings), len(proofs.jobs.scenes)
    console.print(
        f"[bold {'red' if failed else 'green'}]{len(proved)} identities proved, "
        f"{len(failed)} disproved[/] on {done} of {asked} structures"
        + (f" ({proofs.taken_over} of them in an earlier run)" if proofs.taken_over else "")
    )
    console.print(
        f"Had any of them been false, all its points would have hidden it with a probability below "
        f"{total:.1e} ({proofs.jobs.points} random points and primes each, seed {proofs.seed})."
    )


def _table(rows: list[dict[str, Any]]) -> Table:
    counts = numbers("proved", "disproved", "not looked at", no_wrap=True)
    bounds = numbers("degree ≤", "height ≤", "failure probability <", no_wrap=True)
    made = table([*words("claim"), *words("statement", no_wrap=False), *counts, *bounds])
    for id in CLAIMS:
        found = [row for row in rows if row["claim"] == id]
        if not found:
            continue
        proved = [row["proof"] for row in found if "proof" in row]
        made.add_row(
            id,
            CLAIMS[id].statement,
            str(len(proved)),
            _count(found, "failed"),
            _count(found, "inconclusive"),
            str(max((p["degree"] for p in proved), default="")),
            f"{max(p['height'] for p in proved):.0f} bits" if proved else "",
            f"{max(p['failure_probability'] for p in proved):.1e}" if proved else "",
        )
    return made


def _count(rows: list[dict[str, Any]], verdict: str) -> str:
    count = sum(row["verdict"] == verdict for row in rows)
    return str(count) if count else ""


def _first_of_each(failed: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the first of each claim and subject."""
    first: dict[tuple[str, str], dict[str, Any]] = {}
    for row in failed:
        first.setdefault((row["claim"], row["subject"]), row)
    return list(first.values())
