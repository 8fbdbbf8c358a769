"""Poses (the paper's Fig. 2) and an animation of its robot, drawn from Records by matplotlib."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.animation import PillowWriter
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from eomcheck.lab.show.chart_matplotlib import plt, save_chart
from eomcheck.lab.show.sketch_drawing import link_ends
from eomcheck.lab.store.record_file import Record
from eomcheck.lab.studies.paper import POSES
from eomcheck.lab.studies.paper.measure import PAPER_LINKS, coil_of

FRAMES_PER_SECOND = 10
EVERY = 2
"""Number of output times per frame."""
GREYS = ("0.78", "0.62", "0.46", "0.3", "0.0")
"""Greys of the poses of Fig. 2, the last one darkest."""


def write_robot(record: Record | None, folder: Path) -> list[Path]:
    """Draw the poses and the animation of a motion, if there is one; return the files."""
    if record is None:
        return []
    poses, moving = folder / "paper-fig2.png", folder / "paper-fig2.gif"
    _draw_poses(record, poses)
    _animate(record, moving)
    return [poses, moving]


def _links(record: Record) -> np.ndarray:
    """Return the ends of the links at all output times (k, N + 1, 2), m."""
    length = coil_of(PAPER_LINKS).length
    return np.array([link_ends(length, np.array(q)) for q in record.series["q"]])


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


def _draw_poses(record: Record, path: Path) -> None:
    figure, axes = plt.subplots(figsize=(7.7, 6.0), layout="constrained")
    ends, times = _links(record), np.array(record.series["times"])
    for time, color in zip(POSES, GREYS, strict=True):
        _snake(axes, ends[int(np.abs(times - time).argmin())], color)
        axes.plot([], [], color=color, lw=4, label=f"t = {time:g} s")
    axes.plot(*ends[:, 0].T, "--", color="#D55E00", lw=1.4, label="path of the head")
    _label_plane(axes)
    figure.legend(loc="outside right upper", frameon=False)
    save_chart(figure, path, dpi=110)


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
