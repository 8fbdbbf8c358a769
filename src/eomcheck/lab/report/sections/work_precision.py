"""Work-precision: error against run time, every run a point."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

from eomcheck.lab.report.benchmarks import seconds_text
from eomcheck.lab.report.overview import Overview
from eomcheck.lab.report.sections.section import Section, Sheet
from eomcheck.lab.report.work_precision import (
    AGAINST,
    ERRORS,
    NOTHING,
    abscissa,
    errors_shown,
    front,
)
from eomcheck.lab.run_time import disturbed
from eomcheck.lab.store.records import Record
from eomcheck.lab.studies.work_precision import STUDY, finished, summary


def section(overview: Overview) -> Section | None:
    """Return a diagram, the Pareto front of each reference, and the runs that did not finish."""
    records = overview.of(STUDY)
    if not records:
        return None
    names = list(dict.fromkeys(record.settings["reference"] for record in records))
    by_name = {n: [r for r in records if r.settings["reference"] == n] for n in names}
    tables = [_front(name, mine) for name, mine in by_name.items()]
    tables.append(_unfinished(records))
    text = " ".join(f"{name}: {summary(mine)}" for name, mine in by_name.items())
    return Section(
        "work-precision",
        "Work-precision",
        "Error against run time over all tolerances; lower and further left is better. " + text,
        [table for table in tables if table.rows],
        lambda: list(_charts(by_name)),
    )


def _front(name: str, records: Sequence[Record]) -> Sheet:
    columns = ("formulation", "integrator", "tolerance", "run time", "error of the end state")
    title = f"{name}: no run is both faster and more accurate than these"
    return Sheet("work-precision-front", title, columns, front(records))


def _unfinished(records: Sequence[Record]) -> Sheet:
    rows = [
        (
            record.settings["reference"],
            record.settings["formulation"],
            record.settings["integrator"],
            f"{record.settings['tolerance']:.0e}",
            record.status,
            record.reason,
        )
        for record in records
        if record.seconds is None
    ]
    columns = ("reference", "formulation", "integrator", "tolerance", "status", "reason")
    return Sheet("work-precision-unfinished", "Runs that did not finish", columns, rows)


def _charts(by_name: dict[str, list[Record]]):
    from eomcheck.lab.show.charts import Axis, Chart

    for name, records in by_name.items():
        done = finished(records)
        integrators = list(dict.fromkeys(record.settings["integrator"] for record in done))
        if not done:
            continue
        errors = errors_shown(done)
        chart = Chart(
            f"work-precision-{name}",
            f"{name}: one line a formulation, one point a tolerance",
            {
                "integrator": integrators,
                "error": list(errors.values()),
                "against": [label for label, _ in AGAINST.values()],
            },
        )
        for integrator, error, against in product(integrators, errors, AGAINST):
            label, unit = AGAINST[against]
            panel = chart.panel(
                (integrator, ERRORS[error], label),
                Axis(f"{label}, {unit}" if unit else label, log=True),
                Axis(ERRORS[error], log=True),
            )
            of = [record for record in done if record.settings["integrator"] == integrator]
            for key in dict.fromkeys(record.settings["formulation"] for record in of):
                mine = [record for record in of if record.settings["formulation"] == key]
                mine.sort(key=lambda record: -record.settings["tolerance"])
                panel.line(
                    key,
                    [abscissa(record, against) for record in mine],
                    [max(record.errors[error], NOTHING) for record in mine],
                    [_said(record) for record in mine],
                    hollow=[against == "seconds" and disturbed(record) for record in mine],
                )
        yield chart


def _said(record: Record) -> list[str]:
    settings, counts = record.settings, record.counts
    status = "disturbed: shared its core" if disturbed(record) else record.status
    return [
        f"{settings['formulation']}, {settings['integrator']}",
        f"tolerance {settings['tolerance']:.0e}",
        f"run time {seconds_text(record.seconds or 0.0)}, {status}",
        f"{counts['right-hand sides']} right-hand sides, {counts['steps']} steps",
        *(f"{label} {record.errors[error]:.2e}" for error, label in errors_shown([record]).items()),
    ]
