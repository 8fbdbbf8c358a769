"""The stability atlas: digits lost against severity, and where each method breaks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from eomcheck.evaluation.certified import DIGITS_OF_DOUBLES
from eomcheck.evaluation.tolerance import NOTICEABLE
from eomcheck.lab.report.overview import Overview
from eomcheck.lab.report.sections.section import Section, Sheet
from eomcheck.lab.report.stability import WORDS, breaks_text, families_of, methods_of_records
from eomcheck.lab.store.records import Record
from eomcheck.lab.studies.families import FAMILIES
from eomcheck.lab.studies.stability import STUDY, Outcome, Step, outcome, steps

CROSSES, STEP = DIGITS_OF_DOUBLES + 1.0, 0.4
"""Where refusals are drawn, one row a method."""


def section(overview: Overview) -> Section | None:
    """Return a diagram a family, and the severity at which each method breaks."""
    records = [one for one in overview.of(STUDY) if one.settings["family"] in FAMILIES]
    if not records:
        return None
    families, methods = families_of(records), methods_of_records(records)
    rows = [
        (method.name, *(breaks_text(records, family, method) or "·" for family in families))
        for method in methods
    ]
    counts = {one: sum(outcome(record) is one for record in records) for one in Outcome}
    return Section(
        "stability",
        "Stability atlas",
        f"Every formulation at states of growing severity, against the enclosed truth. Of "
        f"{len(records)} cells {counts[Outcome.GOOD]} are good (true relative error at most "
        f"{NOTICEABLE:g}), {counts[Outcome.REFUSED]} refused, {counts[Outcome.TOLD]} worse as "
        f"their error bound tells, {counts[Outcome.SILENT]} silently wrong.",
        [
            Sheet(
                "stability-breaks",
                "Severity at which a method first fails to give a good result (·: it never does)",
                ("method", *(FAMILIES[family].title for family in families)),
                rows,
            )
        ],
        lambda: list(_charts(records)),
    )


def _charts(records: Sequence[Record]) -> Iterator:
    from eomcheck.lab.show.charts import Axis, Chart

    families = families_of(records)
    chart = Chart(
        "stability",
        "Digits lost in the worst variant; crosses above are refusals",
        {"family": [FAMILIES[family].title for family in families]},
    )
    methods = methods_of_records(records)
    step = STEP * len(methods)
    for family in families:
        facts = FAMILIES[family]
        # A category an entry: severities include 0, which a logarithm has no place for.
        order = [f"{value:g}" for value in facts.values]
        panel = chart.panel(
            (facts.title,),
            Axis(facts.severity, categories=order),
            Axis(f"digits lost, of {DIGITS_OF_DOUBLES:.0f}", range=(-0.5, CROSSES + step + 0.5)),
        )
        for row, method in enumerate(methods):
            mine = steps(records, family, method)
            x = [f"{step.severity:g}" for step in mine]
            said = [_said(method.name, step) for step in mine]
            panel.line(
                method.key,
                x,
                [None if np.isnan(step.lost) else step.lost for step in mine],
                said,
                dashed=method.pivoted,
                hollow=[step.refused > 0 for step in mine],
            )
            refused = [k for k, step in enumerate(mine) if step.refused > 0]
            height = CROSSES + STEP * row
            panel.crosses(method.key, [x[k] for k in refused], height, [said[k] for k in refused])
    yield chart


def _said(name: str, step: Step) -> list[str]:
    solved = len(step.solved)
    lines = [
        f"{name}, severity {step.severity:g}",
        f"{solved} of {len(step.records)} variants solved",
    ]
    if solved and not np.isnan(step.lost):
        lines.append(f"{step.lost:.1f} digits lost, {step.foreseen:.1f} foreseen by κ ε")
    if step.worst in WORDS:
        lines.append(WORDS[step.worst])
    reasons = dict.fromkeys(record.reason for record in step.records if record.reason)
    return [*lines, *list(reasons)[:1]]
