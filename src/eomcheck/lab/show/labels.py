"""Labels of a picture, put where they cover neither each other nor what is drawn."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise, product
from typing import Any, NamedTuple

import numpy as np

SIZE = 15
"""Of letters, pt."""
AWAY = (9, 16, 26, 40, 58, 80, 105)
"""Distances from what a label names at which it is tried, px."""
DIRECTIONS = 16
LEADER = 22
"""From this distance on, px, a thin line leads to what a label names."""
STEP = 4.0
"""Distance of the points of lines that labels keep off, px."""


class Label(NamedTuple):
    """What is to be written beside a point, if possible in the direction `away` from it."""

    text: str
    at: np.ndarray
    color: str
    away: np.ndarray | None = None


def symbol(name: str) -> str:
    """Return the name as it is written: what stands behind a _ is an index."""
    return re.sub(r"(\w+?)_(\w+)", r"$\\mathrm{\1}_{\\mathrm{\2}}$", name)


def place_labels(
    axes: Any, labels: Sequence[Label], strokes: Sequence[np.ndarray], faint: str
) -> list[Any]:
    """Write labels into axes whose limits are final; return the texts."""
    figure = axes.figure
    renderer = figure.canvas.get_renderer()
    seen = axes.transData.transform
    points = np.vstack([_sampled(seen(stroke)) for stroke in strokes])
    frame = axes.get_window_extent(renderer)
    taken: list[np.ndarray] = []
    texts = []
    # Those that can go least far first: short names of coordinates, then sentences.
    for label in sorted(labels, key=lambda one: len(one.text)):
        text = axes.text(
            *label.at, label.text, color=label.color, fontsize=SIZE, ha="center", va="center"
        )
        extent = text.get_window_extent(renderer)
        size, at = np.array([extent.width, extent.height]) + 4, seen(label.at)
        away = None if label.away is None else seen(label.at + label.away) - at
        best = _best(at, size, away, taken, points, frame)
        taken.append(np.array([best - size / 2, best + size / 2]))
        text.set_position(axes.transData.inverted().transform(best))
        leader = _leader(at, best, size)
        if leader is not None:
            axes.plot(*axes.transData.inverted().transform(leader).T, color=faint, lw=0.8)
            points = np.vstack((points, _sampled(leader)))
        texts.append(text)
    return texts


def _best(
    at: np.ndarray,
    size: np.ndarray,
    away: np.ndarray | None,
    taken: list[np.ndarray],
    points: np.ndarray,
    frame: Any,
) -> np.ndarray:
    """Return the centre (2,), px, of a label at its best place."""
    places = _places(at, size, away)
    costs = [against + _cost(place, size, taken, points, frame) for place, against in places]
    best, least = at, np.inf
    for k in np.argsort(costs, kind="stable"):
        if costs[k] >= least:
            break
        place = places[k][0]
        cost = costs[k] + _cost_of_leader(_leader(at, place, size), taken, points)
        if cost < least:
            best, least = place, cost
    return best


def _places(at: np.ndarray, size: np.ndarray, away: np.ndarray | None) -> list[Any]:
    """Return (centre of the label, what speaks against it), around a point."""
    found = []
    for gap, k in product(AWAY, range(DIRECTIONS)):
        turn = 2 * np.pi * k / DIRECTIONS
        unit = np.array([np.cos(turn), np.sin(turn)])
        against = 0.25 * gap
        if away is not None and np.hypot(*away) > 0:
            against += 5 * (1 - unit @ away / np.hypot(*away))
        found.append((at + unit * (gap + np.abs(unit) @ size / 2), against))
    return found


def _cost(
    center: np.ndarray, size: np.ndarray, taken: list[np.ndarray], points: np.ndarray, frame: Any
) -> float:
    low, high = center - size / 2, center + size / 2
    cost = 6.0 * np.count_nonzero(((points > low) & (points < high)).all(axis=1))
    for box in taken:
        if (np.minimum(high, box[1]) > np.maximum(low, box[0])).all():
            cost += 1e4
    outside = np.maximum([frame.x0, frame.y0] - low, 0) + np.maximum(high - [frame.x1, frame.y1], 0)
    return cost + 1e3 * float(outside.sum())


def _leader(at: np.ndarray, center: np.ndarray, size: np.ndarray) -> np.ndarray | None:
    """Return the line (2, 2) from a point to the edge of its label; None where they are close."""
    gap = np.maximum(np.abs(center - at) - size / 2, 0)
    if np.hypot(*gap) <= LEADER:
        return None
    reach = 1 - 1 / max(np.abs((center - at) / (size / 2)).max(), 1)
    return np.array([at, at + reach * (center - at)])


def _cost_of_leader(
    leader: np.ndarray | None, taken: list[np.ndarray], points: np.ndarray
) -> float:
    """Return what speaks against a line to a label: labels and lines that it crosses."""
    if leader is None:
        return 0.0
    along = _sampled(leader)
    along = along[np.hypot(*(along - leader[0]).T) > 8]
    through = sum(((along > box[0]) & (along < box[1])).all(axis=1).any() for box in taken)
    near = np.abs(along[:, None] - points).max(axis=2).min(axis=1, initial=np.inf) < STEP / 2
    return 500.0 * through + 3.0 * np.count_nonzero(near)


def _sampled(points: np.ndarray) -> np.ndarray:
    """Return points along a line (k, 2), px, close to each other."""
    parts = [points[-1:]]
    for start, end in pairwise(points):
        count = max(int(np.hypot(*(end - start)) / STEP), 1)
        parts.append(start + np.outer(np.arange(count) / count, end - start))
    return np.vstack(parts)
