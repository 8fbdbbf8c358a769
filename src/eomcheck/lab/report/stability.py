"""The stability atlas as tables, one figure a family and one heat map of all."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from rich.markup import escape

from eomcheck.console import console
from eomcheck.evaluation.certified import DIGITS_OF_DOUBLES
from eomcheck.evaluation.tolerance import NOTICEABLE
from eomcheck.lab.show.by_matplotlib import plt, save
from eomcheck.lab.show.figures import COLORS, MARKERS
from eomcheck.lab.show.layout import table, words, write_markdown_table
from eomcheck.lab.store.records import Record
from eomcheck.lab.studies.families import FAMILIES
from eomcheck.lab.studies.stability import (
    Method,
    Outcome,
    Step,
    breaks_at,
    digits_lost,
    method_of,
    outcome,
    steps,
)
from eomcheck.scenes import Snake

WORDS = {
    Outcome.REFUSED: "refused",
    Outcome.TOLD: "bound tells",
    Outcome.SILENT: "SILENT",
}
LIMIT = digits_lost(NOTICEABLE)
"""Digits lost at which a result is no longer good."""


def families_of(records: Sequence[Record]) -> list[str]:
    """Return the families among the Records, in the order of the registry."""
    found = {record.settings["family"] for record in records}
    return [key for key in FAMILIES if key in found]


def scenes_of(records: Sequence[Record]) -> list[str]:
    """Return the keys of the scenes that the Records are about, in the order of the registry."""
    return list(dict.fromkeys(FAMILIES[family].about for family in families_of(records)))


def methods_of_records(records: Sequence[Record]) -> list[Method]:
    """Return the methods among the Records, in the order in which they were measured first."""
    return list(dict.fromkeys(method_of(record) for record in records))


# ---- Tables --------------------------------------------------------------------------------------


def breaks_text(records: Sequence[Record], family: str, method: Method) -> str:
    """Return where a method breaks, such as "1e-08 refused", "–" where it does not apply."""
    if not steps(records, family, method):
        return "–"
    found = breaks_at(records, family, method)
    if found is None or found.outcome is Outcome.TOLD:
        return "" if found is None else f"{found.severity:.3g}"
    return f"{found.severity:.3g} {WORDS[found.outcome]}"


def write_breaks(records: Sequence[Record], path: Path) -> None:
    """Write where each method breaks in each family as a table in Markdown.

    Of several scenes, which have many families, a family is a line; of one it is a column.
    """
    families, methods = families_of(records), methods_of_records(records)
    lines = [["", *(FAMILIES[key].title for key in families)]]
    for method in methods:
        breaks = (breaks_text(records, key, method) for key in families)
        lines.append([f"`{method.key}`{', pivoted' if method.pivoted else ''}", *breaks])
    if len(scenes_of(records)) > 1:
        lines = [list(column) for column in zip(*lines, strict=True)]
    write_markdown_table(path, lines)


def print_stability(records: Sequence[Record]) -> None:
    """Print where each method breaks in each family, why, and whatever is silent."""
    methods = methods_of_records(records)
    for family in families_of(records):
        facts = FAMILIES[family]
        found = words("method", "breaks at", "", "digits lost before")
        rows = [
            (method.name, *_row(mine, records, family, method))
            for method in methods
            if (mine := steps(records, family, method))
        ]
        console.print(f"\n[bold]{facts.title}[/]: {facts.severity}")
        console.print(table([*found, *words("why", no_wrap=False)], rows))
    counts = {one: sum(outcome(record) is one for record in records) for one in Outcome}
    console.print(
        f"{len(records)} cells: {counts[Outcome.GOOD]} good (true relative error at most "
        f"{NOTICEABLE:g}), {counts[Outcome.REFUSED]} refused, {counts[Outcome.TOLD]} worse as "
        f"their error bound tells, {counts[Outcome.SILENT]} silently wrong."
    )
    for record in records:
        if outcome(record) is Outcome.SILENT or record.status == "failed":
            what = f"{record.settings}: {record.reason or record.errors}"
            console.print(escape(f"{outcome(record).name}: {what}"), soft_wrap=True)


def _row(mine: list[Step], records: Sequence[Record], family: str, method: Method) -> list[str]:
    found = breaks_at(records, family, method)
    place = len(mine) if found is None else [s.severity for s in mine].index(found.severity)
    before = [step.lost for step in mine[:place] if not np.isnan(step.lost)]
    lost = f"{max(before):.1f}" if before else ""
    if found is None:
        return ["", "", lost, ""]
    record = found.record
    if record.status != "done":
        why = record.reason
    else:
        matrix = max(
            (name for name in record.errors if name.startswith("condition ")),
            key=record.errors.__getitem__,
        )
        why = (
            f"true error {record.errors['relative']:.0e}; condition number of "
            f"{matrix.removeprefix('condition ')} {record.errors[matrix]:.0e}"
        )
    return [f"{found.severity:.3g}", WORDS[found.outcome], lost, escape(why)]


# ---- One figure a family -------------------------------------------------------------------------


def draw_family(records: Sequence[Record], family: str, path: Path) -> None:
    """Draw digits lost against severity, a panel a method, with what κ ε foresaw beside it."""
    facts = FAMILIES[family]
    methods = [m for m in methods_of_records(records) if steps(records, family, m)]
    columns = min(5, len(methods))
    rows = -(-len(methods) // columns)
    figure, grid = plt.subplots(
        rows,
        columns,
        figsize=(2.5 * columns + 0.3, 2.4 * rows + 0.9),
        sharex=True,
        sharey=True,
        squeeze=False,
        layout="constrained",
    )
    axis = _Axis(sorted({s.severity for m in methods for s in steps(records, family, m)}), facts)
    for panel, method in zip(grid.flat, methods, strict=False):
        _panel(panel, steps(records, family, method), method, axis)
    for panel in grid.flat[len(methods) :]:
        panel.set_axis_off()
    for place in range(columns):
        last = [k for k in range(len(methods)) if k % columns == place][-1]
        grid.flat[last].set_xlabel(facts.severity if place == columns // 2 else "")
        grid.flat[last].tick_params(labelbottom=True)
    for row in grid:
        row[0].set_ylabel("digits lost")
    figure.suptitle(facts.title, fontsize=12)
    figure.legend(handles=_keys(), loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    save(figure, path, dpi=130)


class _Axis:
    """Where severities are drawn: by their logarithm, 0 one step beyond its neighbour."""

    def __init__(self, severities: list[float], facts):
        order = [x for x in facts.values if x in severities]
        positive = [x for x in order if x > 0]
        step = abs(np.log10(positive[-1] / positive[0])) / max(len(positive) - 1, 1) or 1.0
        self.inverted = len(positive) > 1 and positive[-1] < positive[0]
        self.places = {x: float(np.log10(x)) for x in positive}
        if 0.0 in order:
            self.places[0.0] = min(self.places.values()) - max(step, 0.5)
        self.whole = all(x == round(x) and x <= 1000 for x in positive)

    def set_up(self, axes: Axes) -> None:
        """Set limits and ticks."""
        low, high = min(self.places.values()), max(self.places.values())
        margin = 0.03 * (high - low)
        axes.set_xlim(low - margin, high + margin)
        if self.inverted:
            axes.invert_xaxis()
        start = low if 0.0 not in self.places else min(x for s, x in self.places.items() if s > 0)
        step = max(1, int(np.ceil((high - start) / 4)))
        ticks = np.arange(np.ceil(start), np.floor(high) + 0.5, step)
        labels = [f"{10**t:.0f}" if self.whole else f"$10^{{{t:.0f}}}$" for t in ticks]
        places = dict(zip(ticks, labels, strict=True))
        if 0.0 in self.places:
            zero = self.places[0.0]
            places = {t: name for t, name in places.items() if t - zero > 0.12 * (high - low)}
            places[zero] = "0"
        axes.set_xticks(list(places), list(places.values()))


def _panel(axes: Axes, mine: list[Step], method: Method, axis: _Axis) -> None:
    color = COLORS[method.key]
    top = DIGITS_OF_DOUBLES
    x = np.array([axis.places[step.severity] for step in mine])
    axes.axhspan(LIMIT, top, color="0.93", lw=0)
    foreseen = [step.foreseen if step.refused == 0 else np.nan for step in mine]
    axes.plot(x, foreseen, ":", color="0.35", lw=1.6)
    for variant in dict.fromkeys(r.settings["variant"] for step in mine for r in step.records):
        y = [
            next((digits_lost(r.errors["relative"]) for r in s.solved if _is(r, variant)), np.nan)
            for s in mine
        ]
        axes.plot(x, y, "-", color=color, lw=0.6, alpha=0.45)
    # Where some variant is refused, the worst of the others would look like a recovery.
    worst = [step.lost if step.refused == 0 else np.nan for step in mine]
    axes.plot(x, worst, "-", marker=MARKERS[method.key], color=color, ms=4, lw=1.5)
    for at, step in zip(x, mine, strict=True):
        if step.refused > 0:
            axes.plot(
                at, top + 1.0, "X", ms=6, color=color, mfc=color if step.refused == 1 else "w"
            )
        if step.worst is Outcome.SILENT:
            axes.plot(at, step.lost, "o", ms=13, mfc="none", mec="#B00020", mew=1.8)
    axes.set_ylim(-0.5, top + 2.2)
    axes.set_yticks([0, 4, 8, 12, 16])
    axes.set_title(method.name, fontsize=10, loc="left", color="0.15")
    axes.grid(alpha=0.25)
    axis.set_up(axes)


def _is(record: Record, variant: str) -> bool:
    return record.settings["variant"] == variant


def _keys() -> list:
    line = {"color": "0.15", "lw": 1.5}
    return [
        Line2D([], [], marker="o", ms=4, label="worst variant", **line),
        Line2D([], [], color="0.35", lw=0.6, label="each variant"),
        Line2D([], [], color="0.35", lw=1.4, ls=":", label="foreseen by κ ε"),
        Line2D([], [], marker="X", ls="", color="0.15", label="refused (hollow: in part)"),
    ]


def draw_all(records: Sequence[Record], folder: Path) -> list[Path]:
    """Draw heat maps, write tables of breaks, and return the files.

    The snake, or a scene that is alone, gets a figure a family as well; several others share one
    heat map, a panel each, and one table.
    """
    scenes = scenes_of(records)
    alone = scenes if len(scenes) == 1 else [key for key in scenes if key == Snake.key]
    others = [key for key in scenes if key not in alone]
    paths: list[Path] = []
    for keys in (alone, others):
        mine = [record for record in records if _about(record) in keys]
        if not mine:
            continue
        name = "stability" if keys == [Snake.key] else "stability-scenes"
        if len(keys) == 1 and keys != [Snake.key]:
            name = f"stability-{keys[0]}"
        paths += [folder / f"{name}.png", folder / f"{name}-breaks.md"]
        draw_atlas(mine, paths[-2])
        write_breaks(mine, paths[-1])
        for family in families_of(mine) if keys is alone else ():
            paths.append(folder / f"stability-{family}.png")
            draw_family(mine, family, paths[-1])
    return paths


def _about(record: Record) -> str:
    return FAMILIES[record.settings["family"]].about


# ---- The heat map --------------------------------------------------------------------------------


def draw_atlas(records: Sequence[Record], path: Path) -> None:
    """Draw every method through every family, a panel a scene: darker is worse, hatched refused."""
    about = scenes_of(records)
    parts = [[f for f in families_of(records) if FAMILIES[f].about == key] for key in about]
    methods = methods_of_records(records)
    columns = min(2, len(about))
    rows = -(-len(about) // columns)
    most = max(map(len, parts))
    figure, grid = plt.subplots(
        rows,
        columns,
        figsize=_size(rows, columns, most, len(methods)),
        squeeze=False,
        layout="constrained",
    )
    colors, scale = plt.get_cmap("YlOrRd"), Normalize(0.0, DIGITS_OF_DOUBLES)
    for axes, key, families in zip(grid.flat, about, parts, strict=False):
        here = [m for m in methods if any(steps(records, family, m) for family in families)]
        for column, family in enumerate(families):
            for row, method in enumerate(here):
                mine = steps(records, family, method)
                for place, step in enumerate(mine):
                    width = 0.92 / len(mine)
                    box = (column + 0.04 + place * width, row + 0.1), width, 0.8
                    _cell(axes, step, box, colors, scale)
        names = [FAMILIES[family].name.replace(" ", "\n", 1) for family in families]
        axes.set_xlim(0, most)
        axes.set_ylim(len(here), 0)
        axes.set_xticks(np.arange(len(families)) + 0.5, names, fontsize=9)
        axes.set_yticks(np.arange(len(here)) + 0.5, [m.name for m in here])
        axes.xaxis.tick_top()
        axes.tick_params(length=0)
        axes.spines[:].set_visible(False)
        if len(about) > 1:
            axes.set_title(key, loc="left", fontsize=12, fontweight="bold")
    for axes in grid.flat[len(about) :]:
        axes.set_axis_off()
    bar = figure.colorbar(
        plt.cm.ScalarMappable(scale, colors), ax=grid, pad=0.015, fraction=0.025, aspect=24
    )
    bar.set_label("digits lost, worst variant")
    bar.ax.axhline(LIMIT, color="black", lw=1.2)
    handles = [
        Patch(fc="none", ec="none", label="boxes: from mild to severe; none: does not apply"),
        Patch(fc="0.97", ec="0.45", hatch="////", label="refused"),
        Patch(fc=colors(0.1), ec="0.45", hatch="////", label="refused in part"),
    ]
    if any(outcome(record) is Outcome.SILENT for record in records):
        handles.append(Patch(fc="white", ec="#0033CC", lw=2, label="silently wrong"))
    figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False)
    save(figure, path, dpi=130)


def _size(rows: int, columns: int, families: int, methods: int) -> tuple[float, float]:
    """Return width and height, in; panels are smaller where there are several."""
    box = (1.1, 0.42) if columns == 1 else (1.0, 0.26)
    return (box[0] * families + 1.0) * columns + 0.9, (box[1] * methods + 1.1) * rows + 0.8


def _cell(axes: Axes, step: Step, box: tuple, colors, scale: Normalize) -> None:
    face = "0.97" if np.isnan(step.lost) else colors(scale(step.lost))
    axes.add_patch(Rectangle(*box, fc=face, ec="none", lw=0))
    if step.refused > 0:
        axes.add_patch(Rectangle(*box, fc="none", ec="0.45", lw=0, hatch="//////"))
    if step.worst is Outcome.SILENT:
        axes.add_patch(Rectangle(*box, fc="none", ec="#0033CC", lw=2))
