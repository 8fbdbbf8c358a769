"""The study of stiff joints: tables and figures, read from its Records."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter
from rich.markup import escape
from rich.table import Table

from eomcheck.console import console
from eomcheck.lab.show.figures import COLORS, legend_above, plt, save
from eomcheck.lab.show.layout import numbers, table, words
from eomcheck.lab.store.records import Record
from eomcheck.lab.studies.stiff import (
    COMPILED,
    EXPLICIT,
    IN_SCIPY,
    JACOBIANS,
    PROBLEMS,
    STUDY,
    TRUTH,
    cheapest,
    cost,
    crossover,
    runs_of,
)
from eomcheck.lab.studies.work_precision import disturbed

TARGETS = (1e-3, 1e-6)
"""Relative errors whose costs are compared."""

_PALETTE = list(COLORS.values())
STYLES = {
    key: {"color": _PALETTE[place], "marker": marker, "ls": "-" if key in EXPLICIT else "--"}
    for place, (key, marker) in enumerate(zip(COMPILED, "os^vD", strict=True), 1)
}
"""Integrator -> how it is drawn: explicit ones solid, implicit ones dashed."""


def print_stiff(records: Sequence[Record]) -> None:
    """Print how well the truth is known, costs, crossovers, what Jacobians save, and failures."""
    _print_truths(records)
    for problem in PROBLEMS:
        for key in _values(records, "formulation"):
            _print_costs(records, problem, key)
    _print_crossovers(records)
    _print_jacobians(records)
    _print_failures(records)
    shared = sum(map(disturbed, records))
    done = len(runs_of(records))
    console.print(f"{shared} of {done} best runs had to share their core.")


def _values(records: Sequence[Record], name: str) -> list[Any]:
    return list(dict.fromkeys(r.settings[name] for r in records if r.study == STUDY))


def _table(*columns: str) -> Table:
    left = columns[:1] if columns[0] in ("", "integrator") else ()
    return table([*words(*left, no_wrap=False), *numbers(*columns[len(left) :])])


def _print_truths(records: Sequence[Record]) -> None:
    console.print("[bold]How well the damped motions are known[/], relative:")
    shown = _table("k / (N m/rad)", "uncertainty")
    for r in records:
        if r.study == TRUTH:
            said = f"{r.errors['uncertainty']:.1e}" if r.status == "done" else escape(r.reason)
            shown.add_row(f"{r.settings['stiffness']:.0e}", said)
    console.print(shown)


def _print_costs(records: Sequence[Record], problem: str, key: str) -> None:
    for target in TARGETS:
        console.print(
            f"\n[bold]{problem}, {key}[/]: CPU time in ms, and right-hand sides, to an error of "
            f"{target:.0e}"
        )
        stiffnesses = _values(records, "stiffness")
        shown = _table("integrator", *(f"{k:.0e}" for k in stiffnesses))
        for integrator in COMPILED:
            row = []
            for k in stiffnesses:
                mine = runs_of(records, problem=problem, formulation=key, stiffness=k)
                best = cheapest(mine, target, (integrator,))
                row.append(
                    ""
                    if best is None
                    else f"{1e3 * cost(best):.3g}  {best.counts['right-hand sides']}"
                )
            shown.add_row(integrator, *row)
        console.print(shown)


def _print_crossovers(records: Sequence[Record]) -> None:
    console.print("\n[bold]Implicit integrators are the cheaper ones from this k on[/], N m/rad:")
    shown = _table("", "error", "formulation", "by CPU time", "by right-hand sides")
    for problem in PROBLEMS:
        for target in TARGETS:
            for key in _values(records, "formulation"):
                found = [
                    crossover(records, target, problem, key, what)
                    for what in ("seconds", "right-hand sides")
                ]
                said = ["never" if k is None else f"{k:.1e}" for k in found]
                shown.add_row(problem, f"{target:.0e}", key, *said)
    console.print(shown)


def _print_jacobians(records: Sequence[Record]) -> None:
    console.print("\n[bold]SciPy, kane, damped[/]: exact Jacobian beside finite differences")
    shown = _table(
        *("integrator", "rtol", "k / (N m/rad)"),
        *("right-hand sides", "exact", "saved", "CPU ms", "exact", "saved", "error", "exact"),
    )
    for integrator in IN_SCIPY:
        for tolerance in _values(records, "tolerance"):
            for k in _values(records, "stiffness"):
                pair = _pair(records, integrator, tolerance, k)
                if pair is None:
                    continue
                cells = []
                for what, factor in (("right-hand sides", 1.0), ("seconds", 1e3)):
                    plain, exact = (factor * cost(r, what) for r in pair)
                    cells += [f"{plain:.4g}", f"{exact:.4g}", f"{1 - exact / plain:.0%}"]
                errors = [f"{r.errors['final']:.0e}" for r in pair]
                shown.add_row(integrator, f"{tolerance:.0e}", f"{k:.0e}", *cells, *errors)
    console.print(shown)


def _pair(
    records: Sequence[Record], integrator: str, tolerance: float, k: float
) -> tuple[Record, Record] | None:
    found = [
        runs_of(records, integrator=integrator, tolerance=tolerance, stiffness=k, jacobian=how)
        for how in JACOBIANS
    ]
    return (found[0][0], found[1][0]) if all(found) else None


def _print_failures(records: Sequence[Record]) -> None:
    reasons: dict[tuple[str, ...], list[str]] = {}
    for r in records:
        if r.study == STUDY and r.status != "done":
            s = r.settings
            what = (s["problem"], s["formulation"], s["integrator"], r.reason)
            reasons.setdefault(what, []).append(f"{s['stiffness']:.0e} at {s['tolerance']:.0e}")
    console.print("\n[bold]Runs that failed[/]" if reasons else "\nNo run failed.")
    for (*where, reason), cells in reasons.items():
        said = f"{', '.join(where)}: {reason} (k: {'; '.join(cells)})"
        console.print(escape(said), soft_wrap=True)


# ---- Figures -------------------------------------------------------------------------------------


def draw_stiff(records: Sequence[Record], folder: Path) -> list[Path]:
    """Draw work-precision, cost over stiffness, and what exact Jacobians save; return the files."""
    paths = [folder / f"stiff-{name}.png" for name in ("work-precision", "cost", "jacobians")]
    _draw_work_precision(records, paths[0])
    _draw_cost(records, paths[1])
    _draw_jacobians(records, paths[2])
    return paths


def _draw_work_precision(records: Sequence[Record], path: Path) -> None:
    """Error against run time of Kane's formulation; in the grey the truth is not known."""
    stiffnesses = _values(records, "stiffness")
    shown = stiffnesses[:: max(1, (len(stiffnesses) - 1) // 3)][:4]
    figure, grid = plt.subplots(
        2,
        len(shown),
        figsize=(2.9 * len(shown) + 0.6, 6.4),
        sharey="row",
        squeeze=False,
        layout="constrained",
    )
    for row, problem in zip(grid, PROBLEMS, strict=True):
        row[0].set_ylabel(f"{problem}\nrelative error")
        for axes, k in zip(row, shown, strict=True):
            mine = runs_of(records, problem=problem, stiffness=k, formulation="kane", jacobian=None)
            for integrator in COMPILED:
                line = [r for r in mine if r.settings["integrator"] == integrator]
                line.sort(key=lambda r: -r.settings["tolerance"])
                axes.plot(
                    [cost(r) for r in line],
                    [max(r.errors["final"], r.errors["floor"]) for r in line],
                    ms=4,
                    lw=1.2,
                    label=integrator,
                    **STYLES[integrator],
                )
            if mine:
                axes.axhspan(1e-18, mine[0].errors["floor"], color="0.88", lw=0)
            _logarithmic(axes)
            axes.set_ylim(1e-13, 3.0)
            axes.set_title(f"k = {k:.0e} N m/rad", fontsize=10)
            axes.set_xlabel("CPU time / s")
    legend_above(figure, grid[0, 0], 5)
    save(figure, path)


def _draw_cost(records: Sequence[Record], path: Path) -> None:
    """Draw the time and right-hand sides to an error over stiffness, Kane's formulation."""
    target = TARGETS[0]
    figure, grid = plt.subplots(
        2, 2, figsize=(9.2, 6.6), sharex=True, sharey="row", layout="constrained"
    )
    labels = {"seconds": "CPU time / s", "right-hand sides": "right-hand sides"}
    for column, problem in enumerate(PROBLEMS):
        for row, (what, label) in enumerate(labels.items()):
            axes = grid[row, column]
            for integrator in COMPILED:
                points = []
                for k in _values(records, "stiffness"):
                    mine = runs_of(records, problem=problem, stiffness=k, formulation="kane")
                    best = cheapest(mine, target, (integrator,), what)
                    if best is not None:
                        points.append((k, cost(best, what)))
                if points:
                    axes.plot(
                        *zip(*points, strict=True), ms=5, label=integrator, **STYLES[integrator]
                    )
            place = crossover(records, target, problem, "kane", what)
            if place is not None:
                axes.axvline(place, color="0.5", lw=1, ls=":")
            _logarithmic(axes)
            if column == 0:
                axes.set_ylabel(label)
        grid[0, column].set_title(f"{problem}: to a relative error of {target:.0e}", fontsize=11)
        grid[1, column].set_xlabel("joint stiffness k / (N m/rad)")
    legend_above(figure, grid[0, 0], 5)
    save(figure, path)


def _draw_jacobians(records: Sequence[Record], path: Path) -> None:
    """Draw the shares of right-hand sides and time that exact Jacobians leave."""
    figure, panels = plt.subplots(1, 2, figsize=(8.6, 3.8), sharey=True, layout="constrained")
    tolerances = sorted({r.settings["tolerance"] for r in runs_of(records, jacobian="exact")})
    for axes, what in zip(panels, ("right-hand sides", "seconds"), strict=True):
        for integrator in IN_SCIPY:
            for tolerance, style in zip(tolerances, ("--", "-"), strict=False):
                points = []
                for k in _values(records, "stiffness"):
                    pair = _pair(records, integrator, tolerance, k)
                    if pair is not None:
                        points.append((k, cost(pair[1], what) / cost(pair[0], what)))
                if points:
                    axes.plot(
                        *zip(*points, strict=True),
                        **{**STYLES[integrator], "ls": style},
                        label=f"{integrator}, rtol {tolerance:.0e}",
                    )
        axes.axhline(1.0, color="0.5", lw=0.8)
        axes.set_xscale("log")
        axes.grid(alpha=0.25)
        axes.set_xlabel("joint stiffness k / (N m/rad)")
        axes.set_title("CPU time" if what == "seconds" else what, fontsize=11)
    panels[0].set_ylim(bottom=0)
    panels[0].set_ylabel("exact Jacobian over differences")
    legend_above(figure, panels[0], 4)
    save(figure, path)


def _logarithmic(axes: Axes) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.xaxis.set_major_locator(LogLocator(numticks=5))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.grid(alpha=0.25)
