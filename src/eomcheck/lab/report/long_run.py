"""The study of long runs: a table of growth laws, and the errors over time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from matplotlib.lines import Line2D
from rich.markup import escape

from eomcheck.console import console
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.show.figures import COLORS, FLOOR, MARKERS, plt, save
from eomcheck.lab.show.layout import numbers, table, words
from eomcheck.lab.store.records import Record
from eomcheck.lab.studies.long_run import FEEDBACK, INTERVAL, REMEDIES

TITLES = {
    "none": "nothing added",
    "feedback": f"feedback, {FEEDBACK:g}/s",
    "projection": f"projection every {INTERVAL:g} s",
}
ERRORS = {"constraint": "‖c‖ / (m/s)", "energy": "|E - E₀| / E₀"}


def print_long_run(records: Sequence[Record]) -> None:
    """Print the growth law and the end of both errors of every run, then why runs failed."""
    laws = (x for name in ERRORS for x in (f"{name} at the end", "exponent", "rate per s"))
    shown = table([*words("formulation", "remedy"), *numbers(*laws, "right-hand sides", "CPU s")])
    for r in records:
        cells = []
        for name in ERRORS:
            cells += [
                _number(r, f"{name}_end", ".1e"),
                _number(r, f"{name}_exponent", ".2f"),
                _number(r, f"{name}_rate", ".1e"),
            ]
        cpu = "" if r.cpu_seconds is None else f"{r.cpu_seconds:.3g}"
        where = r.settings["formulation"], r.settings["remedy"]
        shown.add_row(*where, *cells, f"{r.counts['right-hand sides']:,}", cpu)
    console.print(shown)
    for r in records:
        if r.status != "done":
            where = "{formulation}, {remedy}".format(**r.settings)
            console.print(escape(f"{where} {r.status}: {r.reason}"), soft_wrap=True)


def _number(record: Record, name: str, how: str) -> str:
    value = record.errors.get(name)
    return "" if value is None else format(value, how)


def draw_long_run(records: Sequence[Record], path: Path) -> None:
    """Draw both errors over time, a column a remedy."""
    figure, grid = plt.subplots(
        *(len(ERRORS), len(REMEDIES)),
        figsize=(10.4, 6.4),
        sharex=True,
        sharey="row",
        layout="constrained",
    )
    handles: dict[str, Line2D] = {}
    for row, (error, label) in zip(grid, ERRORS.items(), strict=True):
        row[0].set_ylabel(label)
        for axes, remedy in zip(row, REMEDIES, strict=True):
            for r in records:
                if r.settings["remedy"] != remedy:
                    continue
                key = r.settings["formulation"]
                place = list(FORMULATIONS).index(key)
                handles[key] = axes.plot(
                    r.series["times"],
                    [max(x, FLOOR) for x in r.series[error]],
                    color=COLORS[key],
                    marker=MARKERS[key],
                    markevery=(3 * place, 30),
                    ms=4,
                    lw=0.9,
                    label=key,
                )[0]
            axes.set_xscale("log")
            axes.set_yscale("log")
            axes.grid(alpha=0.25)
    for axes, remedy in zip(grid[0], REMEDIES, strict=True):
        axes.set_title(TITLES[remedy], fontsize=11)
    for axes in grid[-1]:
        axes.set_xlabel("t / s")
    order = [key for key in FORMULATIONS if key in handles]
    figure.legend(
        [handles[key] for key in order],
        order,
        loc="outside upper center",
        ncols=len(order),
        frameon=False,
    )
    save(figure, path)
