"""Work-precision as tables and diagrams."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from eomcheck.console import console
from eomcheck.report.benchmarks import seconds_text
from eomcheck.report.figures import COLORS, MARKERS, plt
from eomcheck.studies.records import Record
from eomcheck.studies.work_precision import (
    TARGETS,
    fastest_to,
    finished,
    pareto_front,
    summary,
)

ERRORS = {
    "final": "error of the end state",
    "energy": "energy error, relative",
    "constraint": "constraint error, m/s",
}
AGAINST = {"seconds": "run time, s", "right-hand sides": "right-hand sides"}
NOTHING = 1e-17
"""Errors that are exactly 0 are drawn here."""


def print_work_precision(records: Sequence[Record]) -> None:
    """Print, scene by scene, times to reach an error, the Pareto front, failures and a summary."""
    for name in dict.fromkeys(record.settings["reference"] for record in records):
        mine = [record for record in records if record.settings["reference"] == name]
        console.print(f"\n[bold]{name}[/]: best time of a run whose end state is right to ...")
        console.print(_targets(mine))
        console.print("None is both faster and more accurate than these:")
        console.print(_front(mine))
        for record in mine:
            if record.seconds is None:
                what = "{formulation}, {integrator}, {tolerance:.0e}".format(**record.settings)
                console.print(escape(f"{record.status}: {what}: {record.reason}"), soft_wrap=True)
        console.print(summary(mine))


def _targets(records: Sequence[Record]) -> Table:
    table = Table(header_style="bold")
    table.add_column("formulation", no_wrap=True)
    best = {target: fastest_to(records, target) for target in TARGETS}
    for target in TARGETS:
        table.add_column(f"{target:.0e}", justify="right", no_wrap=True)
        table.add_column("with", no_wrap=True)
        table.add_column("ratio", justify="right", no_wrap=True)
    for key in dict.fromkeys(record.settings["formulation"] for record in records):
        cells = []
        for target in TARGETS:
            times = {i: r.seconds or 0.0 for (f, i), r in best[target].items() if f == key}
            if not times:
                cells += ["", "", ""]
                continue
            integrator = min(times, key=times.__getitem__)
            first = min(record.seconds or 0.0 for record in best[target].values())
            ratio = times[integrator] / first
            cells += [seconds_text(times[integrator]), integrator, f"{ratio:.3g}"]
        table.add_row(key, *cells)
    return table


def _front(records: Sequence[Record]) -> Table:
    table = Table(header_style="bold")
    for name in ("formulation", "integrator", "tolerance", "time", "error of the end state"):
        table.add_column(name, justify="left" if name in ("formulation", "integrator") else "right")
    for record in pareto_front(records):
        settings = record.settings
        table.add_row(
            settings["formulation"],
            settings["integrator"],
            f"{settings['tolerance']:.0e}",
            seconds_text(record.seconds or 0.0),
            f"{record.errors['final']:.1e}",
        )
    return table


def draw_work_precision(records: Sequence[Record], path: Path, against: str = "seconds") -> None:
    """Draw the errors of one scene against run time or right-hand sides, a column an integrator."""
    done = finished(records)
    integrators = list(dict.fromkeys(record.settings["integrator"] for record in done))
    figure, grid = plt.subplots(
        len(ERRORS),
        len(integrators),
        figsize=(2.6 * len(integrators) + 1.4, 8.2),
        sharex="col" if against == "seconds" else "all",
        sharey="row",
        squeeze=False,
        layout="constrained",
    )
    for row, (error, label) in zip(grid, ERRORS.items(), strict=True):
        row[0].set_ylabel(label)
        for axes, integrator in zip(row, integrators, strict=True):
            for key in dict.fromkeys(record.settings["formulation"] for record in done):
                _line(axes, done, key, integrator, error, against)
            axes.set_xscale("log")
            axes.set_yscale("log")
            axes.grid(alpha=0.25)
            if error == "final":
                axes.set_title(integrator, fontsize=11)
                floor = max(record.errors["floor"] for record in done)
                axes.axhspan(1e-18, floor, color="0.9", lw=0)
            if error == "constraint":
                axes.set_xlabel(AGAINST[against])
    grid[0, 0].set_ylim(bottom=1e-14)
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), frameon=False)
    figure.savefig(path, dpi=150)
    plt.close(figure)


def _line(axes, records: Sequence[Record], key: str, integrator: str, error: str, against: str):
    mine = [
        record
        for record in records
        if (record.settings["formulation"], record.settings["integrator"]) == (key, integrator)
    ]
    mine.sort(key=lambda record: -record.settings["tolerance"])
    x = [r.seconds if against == "seconds" else r.counts["right-hand sides"] for r in mine]
    y = [max(record.errors[error], NOTHING) for record in mine]
    axes.plot(x, y, "-", marker=MARKERS[key], color=COLORS[key], ms=4, lw=1.1, label=key)
