"""Operation counts of one right-hand side, over the number of links."""

from __future__ import annotations

from collections.abc import Iterator

from eomcheck.lab.report.operations import grouped, polynomial_text
from eomcheck.lab.report.overview import Overview
from eomcheck.lab.report.sections.section import Section, Sheet
from eomcheck.lab.studies.operations import (
    KINDS,
    STUDY,
    Operations,
    by_formulation,
    fit,
    operations_of,
)

ALL = "all operations"


def section(overview: Overview) -> Section | None:
    """Return the counts as polynomials in N and as a diagram."""
    counted = [operations_of(record) for record in overview.of(STUDY)]
    if not counted:
        return None
    rows = [
        (one.formulation, *(polynomial_text(one.polynomials[kind]) for kind in KINDS))
        for one in fit(counted)
    ]
    sizes = sorted({one.links for one in counted})
    return Section(
        "operations",
        "Operations",
        f"Additions, multiplications and divisions of one right-hand side of the snake, counted "
        f"one by one for N = {sizes[0]} to {sizes[-1]}; linear systems by LU of their orders.",
        [
            Sheet(
                "operations",
                "Polynomials in N that go through every count",
                ("formulation", *KINDS),
                rows,
            )
        ],
        lambda: list(_charts(counted)),
    )


def _charts(counted: list[Operations]) -> Iterator:
    from eomcheck.lab.show.charts import LINKS, Axis, Chart

    kinds = {
        ALL: lambda one: one.outside_solves + one.elimination,
        "outside of solves": KINDS["outside of solves"],
        "solves, by LU": KINDS["solves, by LU"],
    }
    chart = Chart("operations", "Operations over the number of links", {"count": list(kinds)})
    for kind, value in kinds.items():
        panel = chart.panel((kind,), LINKS, Axis(kind, log=True))
        for key, rows in by_formulation(counted).items():
            some = [row for row in rows if value(row) > 0]
            said = [
                [
                    f"{key}, N = {row.links}",
                    f"{grouped(row.additions)} additions",
                    f"{grouped(row.multiplications)} multiplications",
                    f"{grouped(row.divisions)} divisions",
                    f"{grouped(row.trigonometric_pairs)} pairs of sin and cos",
                    f"{grouped(row.elimination)} in solves",
                ]
                for row in some
            ]
            panel.line(key, [row.links for row in some], [value(row) for row in some], said)
    yield chart
