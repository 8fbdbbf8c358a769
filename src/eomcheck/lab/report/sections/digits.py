"""Certified digits: what doubles deliver, against the enclosed truth."""

from __future__ import annotations

from statistics import median

from eomcheck.lab.report.findings import group
from eomcheck.lab.report.overview import Overview
from eomcheck.lab.report.sections.section import Section, Sheet


def section(overview: Overview) -> Section | None:
    """Return the digits of each formulation on each scene."""
    # Where an acceleration is nothing but rounding it has no digits to be right.
    checked = (row for row in overview.rows if row.verdict != "inconclusive")
    certified = [row for row in checked if row.digits is not None]
    if not certified:
        return None
    by_subject = group(certified, lambda row: row.subject)
    scenes = list(group(certified, lambda row: row.scene))
    rows = []
    for key in (name for name in overview.columns if name in by_subject):
        on = group(by_subject[key], lambda row: row.scene)
        rows.append((key, *(_cell([row.digits or 0.0 for row in on.get(s, [])]) for s in scenes)))
    return Section(
        "digits",
        "Certified digits",
        "Decimal digits of q̈ in doubles that are certainly right, against the true value in ball "
        "arithmetic: the worst state, and in brackets the median. States whose acceleration is no "
        "larger than its rounding error are left out.",
        [Sheet("digits", "Decimal digits of q̈ that are right", ("formulation", *scenes), rows)],
    )


def _cell(digits: list[float]) -> str:
    return f"{min(digits):.1f} ({median(digits):.1f})" if digits else "·"
