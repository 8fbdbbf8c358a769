"""Figures: they read Records and scenes and compute nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from eomcheck.evaluation.tolerance import C
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.show.by_matplotlib import plt, save
from eomcheck.lab.show.style import STYLES
from eomcheck.lab.studies.accuracy import Delivered
from eomcheck.lab.studies.agreement import REFERENCE, Agreement
from eomcheck.scenes import Snake

COLORS = {key: style.color for key, style in STYLES.items()}
MARKERS = {key: style.marker for key, style in STYLES.items()}
RATIO_FLOOR = 1e-3
"""Ratios below this, exact results included, are drawn here."""
FLOOR = 1e-18
"""Exact agreement is drawn here: a logarithm has no zero."""


def joints(length: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return the ends of the links of a snake (N + 1, 2), m, the head first."""
    theta = q[2:]
    steps = length[:, None] * np.column_stack((np.cos(theta), np.sin(theta)))
    return np.vstack((q[:2], q[:2] + np.cumsum(steps, axis=0)))


def draw_snake(axes: Axes, scene: Snake) -> None:
    """Draw the links, the head and the wheels of a snake in its initial pose."""
    q, _ = scene.initial_state()
    ends = joints(scene.length, q)
    axes.plot(*ends.T, "-o", color="0.25", lw=3, ms=5, solid_capstyle="round")
    axes.plot(*ends[0], "o", color="white", mec="0.25", ms=11, mew=2)
    centres = (ends[:-1] + ends[1:]) / 2
    phi = q[2:] + scene.wheel_angle
    wheel = 0.22 * np.column_stack((np.cos(phi), np.sin(phi)))
    for centre, half in zip(centres, wheel, strict=True):
        axes.plot(*np.column_stack((centre - half, centre + half)), color="#D55E00", lw=6)
    axes.set_aspect("equal")
    axes.set_xlabel("x / m")
    axes.set_ylabel("y / m")


def draw_agreement(records: list[Agreement], path: Path) -> None:
    """Draw how far each formulation is from the reference, beside the allowed and a fault."""
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(10.5, 4.4), width_ratios=(1, 2.1), layout="constrained"
    )
    draw_snake(left, Snake.paper())
    left.set_title("Seven-link snake on wheels", fontsize=11)

    states = {(r.links, r.faulty): r for r in records}.values()
    right.scatter(
        [r.links for r in states],
        [r.faulty for r in states],
        marker="x",
        color="#B00020",
        s=22,
        lw=1.2,
        label="one sign flipped",
    )
    right.scatter(
        [r.links for r in records],
        [r.allowed for r in records],
        marker="_",
        color="0.72",
        s=28,
        lw=1.4,
        label="allowed by rounding",
        zorder=1,
    )
    for key in dict.fromkeys(r.key for r in records):
        mine = [r for r in records if r.key == key]
        right.scatter(
            [r.links for r in mine],
            [max(r.observed, FLOOR) for r in mine],
            marker=MARKERS[key],
            color=COLORS[key],
            s=20,
            alpha=0.75,
            lw=0,
            label=key,
        )
    right.set_yscale("log")
    right.set_ylim(FLOOR / 3, 1e3)
    right.set_xlabel("number of links N")
    right.set_ylabel(f"distance from {REFERENCE}, relative to max |q̈|")
    right.set_title("All formulations on random snakes", fontsize=11)
    right.annotate(
        "lowest row: equal to the last bit",
        (0.99, 0.045),
        xycoords="axes fraction",
        ha="right",
        fontsize=8,
        color="0.35",
    )
    right.grid(alpha=0.25)
    right.legend(ncols=1, fontsize=9, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    save(figure, path)


def draw_accuracy(records: list[Delivered], path: Path) -> None:
    """Draw certified digits over the number of links, and what the constant C rests on."""
    solved = [r for r in records if r.refused is None]
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(12, 4.6), layout="constrained", sharey=False, width_ratios=(3, 2)
    )
    shift = dict(zip(FORMULATIONS, np.linspace(-0.3, 0.3, len(FORMULATIONS)), strict=True))
    for key in FORMULATIONS:
        mine = [r for r in solved if r.key == key]
        style = {"color": COLORS[key], "label": key}
        left.scatter(
            [r.links + shift[key] for r in mine],
            [r.digits for r in mine],
            marker=MARKERS[key],
            s=16,
            alpha=0.7,
            lw=0,
            **style,
        )
        ratios = np.sort([max(r.ratio, RATIO_FLOOR) for r in mine if not np.isnan(r.ratio)])
        right.step(ratios, np.arange(1, ratios.size + 1) / max(ratios.size, 1), lw=1.6, **style)
    left.set_xlabel("number of links N")
    left.set_ylabel("decimal digits of q̈ that are right")
    left.set_ylim(bottom=0)
    left.set_title("What doubles deliver, against the enclosed truth", fontsize=11)
    left.grid(alpha=0.25)
    left.legend(ncols=4, fontsize=9, loc="lower center", frameon=False)
    right.axvline(C, color="#B00020", lw=1.2, ls="--")
    right.annotate(
        f"C = {C:g}",
        (C, 0.04),
        xytext=(-4, 0),
        textcoords="offset points",
        ha="right",
        fontsize=9,
        color="#B00020",
    )
    right.set_xscale("log")
    right.set_xlabel("true error / (κ ε scale)")
    right.set_ylabel("share of states")
    right.set_title("How much of what κ ε predicts is really lost", fontsize=11)
    right.grid(alpha=0.25)
    save(figure, path)
