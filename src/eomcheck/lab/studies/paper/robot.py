"""The paper's Figs. 2 to 7, and its robot in motion: drawn from Records."""

from __future__ import annotations

from collections.abc import Callable
from io import BytesIO
from pathlib import Path

import numpy as np
from matplotlib.animation import PillowWriter
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image

from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.report.paper import POSES, robot
from eomcheck.lab.show.by_matplotlib import legend_above, plt, save
from eomcheck.lab.show.figures import COLORS, MARKERS, joints
from eomcheck.lab.store.records import Record
from eomcheck.lab.studies.paper import PAPER_LINKS, Found, Solver, growth, scene_of

FRAMES_PER_SECOND = 10
EVERY = 2
"""Of so many output times, one is a frame."""
GREYS = ("0.78", "0.62", "0.46", "0.3", "0.0")
"""Of the poses of Fig. 2, the last one darkest."""


def draw_paper(found: Found, folder: Path) -> list[Path]:
    """Draw everything that the Records show into `folder`, and return the files."""
    drawings: dict[str, Callable[[], Figure]] = {
        "paper-fig3.png": lambda: _over_time(found, "constraint"),
        "paper-fig4.png": lambda: _over_time(found, "energy"),
        "paper-fig5.png": lambda: _over_links(found, "constraint"),
        "paper-fig6.png": lambda: _over_links(found, "energy"),
        "paper-fig7.png": lambda: _over_links(found, "cpu_seconds"),
    }
    if not any(links == PAPER_LINKS for links in found.links):
        del drawings["paper-fig3.png"], drawings["paper-fig4.png"]
    record = robot(found)
    written = []
    if record is not None:
        drawings = {"paper-fig2.png": lambda: _poses(record)} | drawings
        written.append(folder / "paper-fig2.gif")
        _animate(record, written[0])
    for name, draw in drawings.items():
        written.append(folder / name)
        _save(draw(), written[-1])
    return sorted(written)


def _save(figure: Figure, path: Path) -> None:
    """Save a figure with a palette: half the size, and it is kept in a repository."""
    drawn = BytesIO()
    save(figure, drawn, dpi=110)
    picture = Image.open(drawn).convert("RGB")
    picture.quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)


# ---- Fig. 2 --------------------------------------------------------------------------------------


def _links(record: Record) -> np.ndarray:
    """Return the ends of the links at all output times (k, N + 1, 2), m."""
    length = scene_of(PAPER_LINKS).length
    return np.array([joints(length, np.array(q)) for q in record.series["q"]])


def _snake(axes: Axes, ends: np.ndarray, color: str) -> list[Line2D]:
    """Draw one pose: links that grow thinner towards the tail, and the head as a ring."""
    drawn = []
    for i, width in enumerate(np.linspace(5.5, 1.8, len(ends) - 1)):
        drawn += axes.plot(*ends[i : i + 2].T, color=color, lw=width, solid_capstyle="round")
    return drawn + axes.plot(*ends[:1].T, "o", color="white", mec=color, mew=2, ms=9)


def _label_plane(axes: Axes) -> None:
    axes.set_aspect("equal")
    axes.set_xlabel("x / m")
    axes.set_ylabel("y / m")
    axes.grid(alpha=0.25)


def _poses(record: Record) -> Figure:
    figure, axes = plt.subplots(figsize=(7.7, 6.0), layout="constrained")
    ends, times = _links(record), np.array(record.series["times"])
    for time, color in zip(POSES, GREYS, strict=True):
        _snake(axes, ends[int(np.abs(times - time).argmin())], color)
        axes.plot([], [], color=color, lw=4, label=f"t = {time:g} s")
    axes.plot(*ends[:, 0].T, "--", color="#D55E00", lw=1.4, label="path of the head")
    _label_plane(axes)
    figure.legend(loc="outside right upper", frameon=False)
    return figure


def _animate(record: Record, path: Path) -> None:
    ends, times = _links(record)[::EVERY], record.series["times"][::EVERY]
    figure, axes = plt.subplots(figsize=(3.7, 4.2))
    figure.subplots_adjust(left=0.16, right=0.98, bottom=0.1, top=0.94)
    _label_plane(axes)
    (head_path,) = axes.plot([], [], "--", color="#D55E00", lw=1.2)
    *links, head = _snake(axes, ends[0], "black")
    low, high = ends.min(axis=(0, 1)) - 0.3, ends.max(axis=(0, 1)) + 0.3
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    writer = PillowWriter(fps=FRAMES_PER_SECOND)
    with writer.saving(figure, path, dpi=80):
        for k, time in enumerate(times):
            head_path.set_data(*ends[: k + 1, 0].T)
            for i, link in enumerate(links):
                link.set_data(*ends[k, i : i + 2].T)
            head.set_data(*ends[k, :1].T)
            axes.set_title(f"t = {time:.2f} s", fontsize=10)
            writer.grab_frame()
    plt.close(figure)


# ---- Figs. 3 and 4 -------------------------------------------------------------------------------

OVER_TIME = {
    "constraint": ("constraint error ‖c‖ / (m/s)", "enlarged / (m/s)"),
    "energy": ("energy error |T + U - E₀| / J", "enlarged: (T + U - E₀) / J"),
}


def _over_time(found: Found, quantity: str) -> Figure:
    """Draw all formulations above, below enlarged those at velocity level; a solver a column."""
    figure, grid = _grid(found, 2, sharey="none")
    for column, solver in zip(grid.T, found.solvers, strict=True):
        for i, key in enumerate(found.formulations):
            record = found.motions.get((PAPER_LINKS, key, solver))
            if record is None or record.status != "done":
                continue
            times, error = (np.array(record.series[name]) for name in ("times", quantity))
            column[0].plot(times[1:], np.abs(error[1:]), label=key, **_style(key, i))
            if FORMULATIONS[key].level == "velocity":
                column[1].plot(times, error, **_style(key, i))
        column[0].set_yscale("log")
        column[0].set_title(str(solver), fontsize=11)
        column[1].set_xlabel("t / s")
        column[1].ticklabel_format(axis="y", scilimits=(0, 0))
    for axes, label in zip(grid[:, 0], OVER_TIME[quantity], strict=True):
        axes.set_ylabel(label)
    legend_above(figure, grid[0, 0])
    return figure


def _style(key: str, i: int) -> dict:
    """Return how a formulation is drawn: where lines coincide, markers are set apart."""
    return {
        "color": COLORS[key],
        "marker": MARKERS[key],
        "ms": 5,
        "lw": 1.2,
        "markevery": (3 * i, 3 * len(FORMULATIONS)),
    }


# ---- Figs. 5 to 7 --------------------------------------------------------------------------------

OVER_LINKS = {
    "constraint": "norm of the constraint error / (m/s)",
    "energy": "norm of the energy error / J",
    "cpu_seconds": "CPU time of a motion / s",
}
TICKS = (2, 5, 10, 20, 50, 100)


def _over_links(found: Found, quantity: str) -> Figure:
    """Draw a norm or the time over the number of links, a solver a column."""
    figure, grid = _grid(found, 1, sharey="row")
    for i, (axes, solver) in enumerate(zip(grid[0], found.solvers, strict=True)):
        for key in found.formulations:
            _line(axes, found, key, quantity, i, solver)
        if any(record.settings["cell"] == "motion" for record in found.unfinished):
            axes.plot([], [], "x", color="0.4", label="not finished")
        axes.set_yscale("log")
        if quantity == "cpu_seconds":
            axes.set_xscale("log")
            axes.set_xticks(TICKS, map(str, TICKS))
            axes.minorticks_off()
            axes.legend(fontsize=8, frameon=False)
        axes.set_title(str(solver), fontsize=11)
        axes.set_xlabel("number of links N")
    grid[0, 0].set_ylabel(OVER_LINKS[quantity])
    if quantity != "cpu_seconds":
        legend_above(figure, grid[0, 0])
    return figure


def _line(axes: Axes, found: Found, key: str, quantity: str, i: int, solver: Solver) -> None:
    values = {links: found.value(quantity, links, key, solver) for links in found.links}
    done = {links: value for links, value in values.items() if value is not None}
    failed = [links for links, value in values.items() if value is None]
    label = key
    if quantity == "cpu_seconds":
        powers = growth(found, key)
        label += f" ~ N$^{{{powers[i]:.2f}}}$" if len(powers) == len(found.solvers) else ""
    style = {"color": COLORS[key], "marker": MARKERS[key], "ms": 4.5, "lw": 1.1}
    axes.plot(list(done), list(done.values()), label=label, **style)
    # A motion that was not finished: a cross at the upper edge.
    axes.plot(
        failed,
        [0.98] * len(failed),
        "x",
        color=COLORS[key],
        transform=axes.get_xaxis_transform(),
    )


def _grid(found: Found, rows: int, sharey) -> tuple[Figure, np.ndarray]:
    columns = len(found.solvers)
    figure, grid = plt.subplots(
        rows,
        columns,
        figsize=(max(3.4 * columns, 5.4) + 1.0, 2.7 * rows + 1.2),
        sharex=True,
        sharey=sharey,
        squeeze=False,
        layout="constrained",
    )
    for axes in grid.flat:
        axes.grid(alpha=0.25)
    return figure, grid
