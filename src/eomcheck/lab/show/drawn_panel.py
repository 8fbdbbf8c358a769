"""Panels of lines and bands drawn by matplotlib."""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes

from eomcheck.lab.show.figures import HOLLOW, handles_of
from eomcheck.lab.show.panel import Axis, Line, Panel
from eomcheck.lab.show.style import STYLES, WRONG


def draw_panel(axes: Axes, panel: Panel) -> None:
    """Draw one panel into axes."""
    for place, band in enumerate(panel.bands):
        look = {"color": STYLES[band.key].color, "alpha": 0.25 + 0.3 * place, "lw": 0}
        axes.fill_between(band.x, band.low, band.high, label=band.label, **look)
    places: dict[Any, int] = {name: place for place, name in enumerate(panel.x.categories)}
    for line in panel.lines:
        draw_line(axes, line._replace(x=[places[x] for x in line.x]) if places else line)
    for x in panel.marks:
        axes.axvline(x, color="0.5", lw=1, ls=":")
    if panel.level is not None:
        axes.axhline(panel.level, color="0.5", lw=0.8)
    if panel.bad is not None:
        axes.axhspan(*panel.bad, color="0.93", lw=0)
    _set_up(axes, "x", panel.x)
    _set_up(axes, "y", panel.y)
    if panel.equal:
        axes.set_aspect("equal")
    if panel.unknown is not None:
        limits = axes.get_ylim()
        axes.axhspan(1e-300 if panel.y.log else -1e300, panel.unknown, color="0.88", lw=0)
        axes.set_ylim(limits)
    axes.set_title(panel.title, fontsize=10)
    axes.grid(alpha=0.25)
    if panel.legend:
        handles = handles_of([axes])
        axes.legend(
            handles.values(), handles, fontsize=8, frameon=False, ncols=2, columnspacing=1.0
        )


LOOKS: dict[str, dict[str, Any]] = {
    "line": {},
    "thin": {"marker": "", "lw": 0.6, "alpha": 0.5},
    "dotted": {"marker": "", "ls": ":", "color": "0.35", "lw": 1.6},
    "crosses": {"marker": "X", "ls": "", "ms": 6},
    "rings": {"marker": "o", "ls": "", "ms": 13, "mfc": "none", "mec": WRONG, "mew": 1.8},
}


def draw_line(axes: Axes, line: Line) -> None:
    """Draw one line into axes."""
    style = STYLES[line.key]
    dashes = "--" if line.dashed or style.dashed else "-"
    look = {
        "color": style.color,
        "marker": style.marker,
        "ls": dashes if line.joined else "",
        "ms": 4,
        "lw": style.width,
    } | LOOKS[line.look]
    axes.plot(line.x, line.y, markevery=line.every, label=line.label or line.key, **look)
    empty = {"marker": look["marker"], "ms": look["ms"], "mfc": "white", "mec": style.color}
    for x, y in ((x, y) for x, y, flag in zip(line.x, line.y, line.hollow, strict=False) if flag):
        axes.plot(x, y, mew=0.7, gid=HOLLOW, **empty)


def _set_up(axes: Axes, which: str, axis: Axis) -> None:
    getattr(axes, f"set_{which}label")(axis.title)
    if axis.log:
        getattr(axes, f"set_{which}scale")("log")
    if axis.range is not None:
        getattr(axes, f"set_{which}lim")(*axis.range)
    if axis.categories:
        getattr(axes, f"set_{which}lim")(-0.5, len(axis.categories) - 0.5)
