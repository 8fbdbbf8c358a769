"""The paper's table, figures and claims, over again."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

from eomcheck.lab.report.benchmarks import seconds_text
from eomcheck.lab.report.overview import Overview
from eomcheck.lab.report.paper import sheets
from eomcheck.lab.report.sections.section import Section
from eomcheck.lab.store.records import Record
from eomcheck.lab.studies.paper import QUANTITIES, STUDY, Found

UNITS = {"constraint": "m/s", "energy": "J", "cpu_seconds": "s"}
NOTHING = 1e-18
"""Errors that are exactly 0 are drawn here."""


def section(overview: Overview) -> Section | None:
    """Return Figs. 5 to 7 as a diagram, and every table of the study."""
    records = overview.of(STUDY)
    if not records:
        return None
    return Section(
        "paper",
        "The paper's simulations",
        "The snake of growing length by the paper's seven formulations, from rest over 1 s: norms "
        "of the errors over the output times (Eqs. (32) and (33)), and CPU time.",
        sheets(records),
        lambda: list(_charts(Found(records))),
    )


def _charts(found: Found) -> Iterator:
    from eomcheck.lab.show.charts import LINKS, Axis, Chart

    solvers = {str(solver): solver for solver in found.solvers}
    chart = Chart(
        "paper",
        "Figs. 5 to 7: one line a formulation, one point a number of links",
        {"quantity": list(QUANTITIES.values()), "solver": list(solvers)},
    )
    for (quantity, label), (name, solver) in product(QUANTITIES.items(), solvers.items()):
        panel = chart.panel(
            (label, name),
            LINKS,
            Axis(f"{label}, {UNITS[quantity]}", log=True),
        )
        for key in found.formulations:
            of = [found.motions.get((links, key, solver)) for links in found.links]
            done = [one for one in of if one is not None and one.status == "done"]
            panel.line(
                key,
                [one.settings["links"] for one in done],
                [max(_value(one, quantity), NOTHING) for one in done],
                [_said(one) for one in done],
            )
    yield chart


def _value(record: Record, quantity: str) -> float:
    return (record.cpu_seconds or 0.0) if quantity == "cpu_seconds" else record.errors[quantity]


def _said(record: Record) -> list[str]:
    settings = record.settings
    return [
        f"{settings['formulation']}, N = {settings['links']}",
        f"{settings['integrator']}, tolerance {settings['tolerance']:.0e}, {record.status}",
        f"CPU time {seconds_text(record.cpu_seconds or 0.0)}",
        f"constraint error {record.errors['constraint']:.2e} m/s",
        f"energy error {record.errors['energy']:.2e} J",
        ", ".join(f"{value} {name}" for name, value in record.counts.items()),
    ]
