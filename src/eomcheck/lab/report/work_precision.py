"""Work-precision as tables and diagrams."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import SubFigure
from matplotlib.lines import Line2D
from matplotlib.ticker import EngFormatter, LogLocator, MaxNLocator, NullFormatter
from rich.markup import escape
from rich.table import Table

from eomcheck.console import console
from eomcheck.lab.references import CASES
from eomcheck.lab.report.benchmarks import seconds_text
from eomcheck.lab.run_time import disturbed
from eomcheck.lab.show.by_matplotlib import plt, save
from eomcheck.lab.show.figures import COLORS, MARKERS
from eomcheck.lab.show.layout import numbers, table, words
from eomcheck.lab.store.records import Record
from eomcheck.lab.studies.work_precision import (
    TARGETS,
    fastest_to,
    finished,
    most_accurate,
    pareto_front,
    summary,
)

ERRORS = {
    "final": "error of the end state",
    "energy": "energy error, relative",
    "constraint": "constraint error, m/s",
}
AGAINST = {"seconds": ("run time", "s"), "right-hand sides": ("right-hand sides", "")}
NOTHING = 1e-17
"""Errors that are exactly 0 are drawn here."""


def print_work_precision(records: Sequence[Record]) -> None:
    """Print, scene by scene, times to reach an error, the Pareto front, drift, and what failed."""
    for name in _names(records, "reference"):
        mine = [record for record in records if record.settings["reference"] == name]
        console.print(f"\n[bold]{name}[/]: best time of a run whose end state is right to ...")
        console.print(_targets(mine))
        console.print("None is both faster and more accurate than these:")
        console.print(_front(mine))
        console.print("Drift in the most accurate run of each, and the power of time it goes with:")
        console.print(_drifts(mine))
        for record in mine:
            if record.seconds is None:
                said = f"{record.status}: {_cell(record)}: {record.reason}"
                console.print(escape(said), soft_wrap=True)
        shared = [_cell(record) for record in mine if disturbed(record)]
        if shared:
            console.print(
                f"Disturbed, even the best run had to share its core: {'; '.join(shared)}.",
                soft_wrap=True,
            )
        console.print(summary(mine))


def _cell(record: Record) -> str:
    return "{formulation}, {integrator}, {tolerance:.0e}".format(**record.settings)


def _targets(records: Sequence[Record]) -> Table:
    columns = words("formulation")
    best = {target: fastest_to(records, target) for target in TARGETS}
    for target in TARGETS:
        columns += numbers(f"{target:.0e}", no_wrap=True) + words("with")
        columns += numbers("ratio", no_wrap=True)
    shown = table(columns)
    for key in _names(records, "formulation"):
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
        shown.add_row(key, *cells)
    return shown


def _front(records: Sequence[Record]) -> Table:
    measured = numbers("tolerance", "time", "error of the end state")
    return table([*words("formulation", "integrator", no_wrap=False), *measured], front(records))


def front(records: Sequence[Record]) -> list[tuple[str, ...]]:
    """Return formulation, integrator, tolerance, time and error of each run on the Pareto front."""
    return [
        (
            record.settings["formulation"],
            record.settings["integrator"],
            f"{record.settings['tolerance']:.0e}",
            seconds_text(record.seconds or 0.0),
            f"{record.errors['final']:.1e}",
        )
        for record in pareto_front(records)
    ]


def _drifts(records: Sequence[Record]) -> Table:
    laws = numbers("tolerance", "constraints, m/s per s", "t^", "energy, relative, per s", "t^")
    shown = table([*words("formulation", "integrator", no_wrap=False), *laws])
    for key, record in most_accurate(records).items():
        cells = [f"{record.settings['tolerance']:.0e}"]
        for kind in ("constraint", "energy"):
            drift, exponent = (record.errors.get(f"{kind}_{x}") for x in ("drift", "exponent"))
            cells += [
                "" if drift is None else f"{drift:.1e}",
                "" if exponent is None else f"{exponent:.1f}",
            ]
        shown.add_row(key, record.settings["integrator"], *cells)
    return shown


def draw_work_precision(records: Sequence[Record], path: Path, against: str = "seconds") -> None:
    """Draw errors against run time or right-hand sides: a block per scene, a column an integrator.

    Hollow markers are disturbed run times; in the grey the reference knows no better.
    """
    scenes, integrators = _names(records, "reference"), _names(records, "integrator")
    ended = {s: [r for r in finished(records) if r.settings["reference"] == s] for s in scenes}
    # Narrow blocks stand side by side.
    columns = min(len(scenes), max(1, 4 // len(integrators)))
    width = 2.6 * len(integrators) + 1.4
    rows = [scenes[k : k + columns] for k in range(0, len(scenes), columns)]
    heights = [max(len(errors_shown(ended[s])) for s in row) * 2.5 + 0.5 for row in rows]
    figure = plt.figure(figsize=(width * columns, sum(heights) + 0.4), layout="constrained")
    blocks = figure.subfigures(len(rows), columns, squeeze=False, height_ratios=heights)
    handles: dict[str, Line2D] = {}
    for block, scene in zip(blocks.flat, scenes, strict=False):
        if len(scenes) > 1:
            block.suptitle("\n".join((scene, *_absent(scene, ended[scene]))), fontsize=11)
        handles |= _draw_scene(block, ended[scene], integrators, against)
    if any(_hollow(records, against)):
        hollow = Line2D([], [], ls="", marker="o", color="0.4", mfc="white", mew=0.7, ms=4)
        handles["disturbed"] = hollow
    figure.legend(
        handles.values(),
        handles,
        loc="outside upper center",
        ncols=9 if len(integrators) * columns > 2 else 4,
        frameon=False,
    )
    save(figure, path, dpi=150 if len(scenes) == 1 else 80)


def errors_shown(records: Sequence[Record]) -> dict[str, str]:
    """Return the errors that the scene of these Records has, and their labels; all, of none."""
    return {
        error: label
        for error, label in ERRORS.items()
        if not records or any(not isnan(record.errors[error]) for record in records)
    }


def _absent(name: str, records: Sequence[Record]) -> list[str]:
    """Return why there is no panel for an error, if so."""
    errors, case = errors_shown(records), CASES.get(name)
    reason = case.scene().why_not_conserved if case else ""
    missing = []
    if "energy" not in errors:
        missing.append("energy is not conserved" + (f": {reason}" if reason else ""))
    if "constraint" not in errors:
        missing.append("no constraints")
    return ["; ".join(missing)] if missing else []


def _names(records: Sequence[Record], what: str) -> list[str]:
    return list(dict.fromkeys(record.settings[what] for record in records))


def _draw_scene(
    block: SubFigure, records: Sequence[Record], integrators: Sequence[str], against: str
) -> dict[str, Line2D]:
    """Draw finished runs of one scene and return a line of each formulation."""
    lines: dict[str, Line2D] = {}
    errors = errors_shown(records)
    grid = block.subplots(
        len(errors),
        len(integrators),
        sharex="col" if against == "seconds" else "all",
        sharey="row",
        squeeze=False,
    )
    for row, (error, label) in zip(grid, errors.items(), strict=True):
        row[0].set_ylabel(label)
        for axes, integrator in zip(row, integrators, strict=True):
            for key in _names(records, "formulation"):
                wanted = {"formulation": key, "integrator": integrator}
                mine = [r for r in records if wanted.items() <= r.settings.items()]
                lines[key] = _line(axes, mine, key, error, against)
            axes.set_xscale("log")
            axes.set_yscale("log")
            axes.grid(alpha=0.25)
            if error == "final":
                axes.set_title(integrator, fontsize=11)
                floor = max((record.errors["floor"] for record in records), default=NOTHING)
                axes.axhspan(1e-18, floor, color="0.9", lw=0)
            if axes in grid[-1]:
                _label_abscissa(axes, *AGAINST[against])
    lowest = min((record.errors["final"] for record in records), default=NOTHING)
    grid[0, 0].set_ylim(bottom=max(lowest, NOTHING) / 5)
    return lines


def _label_abscissa(axes: Axes, label: str, unit: str) -> None:
    """Label an axis in logarithms so that the numbers of a narrow panel do not overlap."""
    low, high = axes.get_xlim()
    ticks = (1.0, 2.0, 5.0) if high < 10 * low else (1.0, 3.0) if high < 100 * low else (1.0,)
    narrow = high < 4 * low  # where LogLocator would take as many ticks as it likes
    axes.xaxis.set_major_locator(MaxNLocator(3) if narrow else LogLocator(subs=ticks))
    axes.xaxis.set_major_formatter(EngFormatter(unit))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel(label)


def _line(axes: Axes, records: Sequence[Record], key: str, error: str, against: str) -> Line2D:
    def draw(records: Sequence[Record], **style: Any) -> Line2D:
        x = [abscissa(record, against) for record in records]
        y = [max(record.errors[error], NOTHING) for record in records]
        return axes.plot(x, y, marker=MARKERS[key], color=COLORS[key], ms=4, lw=1.1, **style)[0]

    line = draw(sorted(records, key=lambda record: -record.settings["tolerance"]))
    draw(_hollow(records, against), ls="", mfc="white", mew=0.7)
    return line


def _hollow(records: Sequence[Record], against: str) -> list[Record]:
    """Return the Records whose run times are not to be trusted, where run times are drawn."""
    return [record for record in records if against == "seconds" and disturbed(record)]


def abscissa(record: Record, against: str) -> float:
    """Return the time in s or the right-hand sides that a run took, as `AGAINST` says."""
    return (record.seconds or 0.0) if against == "seconds" else record.counts[against]
