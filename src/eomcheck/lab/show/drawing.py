"""A sketch as strokes and labels."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np

from eomcheck.lab.show.colors import Colors
from eomcheck.lab.show.labels import Label, symbol
from eomcheck.lab.show.view import Stroke, View
from eomcheck.mechanics import sketch as s

SENSE = 0.7
"""Arc that tells the sense of an angle too small to be seen, rad."""
SMALL = 0.15
"""Angles below this are, rad."""


class Drawing:
    """Strokes and labels of a sketch, in the order in which they are drawn."""

    def __init__(
        self, sketch: s.Sketch, colors: Colors, coordinates: Collection[str] | None = None
    ):
        """Collect the strokes; without the names of `coordinates`, of what moves alone."""
        self.see, self.colors, self.named = View(sketch), colors, coordinates is not None
        self.coordinates = coordinates or ()
        self.strokes: list[Stroke] = []
        self.dots: list[tuple[np.ndarray, str, float, str]] = []
        self.labels: list[Label] = []
        self.kinds: set[str] = set()
        self.trails: list[np.ndarray] = []
        points = [p for part in sketch.parts for p in _points_of(part)]
        seen = np.vstack([self.see(p) for p in points])
        self.size = float(np.ptp(seen, axis=0).max())
        ranks = [s.Plane, s.Disk, s.Spring, s.Body, s.Wheel, s.Distance, s.Arrow, s.Angle]
        ranked = {kind: rank for rank, kind in enumerate(ranks)}
        for part in sorted(sketch.parts, key=lambda part: ranked.get(type(part), len(ranks))):
            getattr(self, f"_{type(part).__name__.lower()}")(part)

    def _line(self, points: Any, color: str, width: float, **look: Any) -> np.ndarray:
        seen = self.see(points)
        self.strokes.append(Stroke(seen, color, width, **look))
        return seen

    def _label(self, text: str, at: np.ndarray, color: str, away: np.ndarray | None = None) -> None:
        if text and self.named:
            self.labels.append(Label(symbol(text), at, color, away))

    def _plane(self, one: s.Plane) -> None:
        if not self.named:
            return
        corners = [*one.points, one.points[0]]
        self._line(corners, self.colors.faint, 0.6, fill=self.colors.faint)

    def _body(self, one: s.Body) -> None:
        points = [*one.points, one.points[0]] if one.closed else [*one.points]
        fill = self.colors.body if one.closed else ""
        seen = self._line(points, self.colors.body, 3.0, fill=fill)
        step = seen[1] - seen[0]
        self._label(
            one.name, (seen[0] + 2 * seen[1]) / 3, self.colors.ink, np.array([-step[1], step[0]])
        )

    def _disk(self, one: s.Disk) -> None:
        turn = np.linspace(0.0, 2 * np.pi, 73)
        if one.ball:
            center = self.see(one.center)[0]
            rim = center + one.radius * np.column_stack((np.cos(turn), np.sin(turn)))
            self.strokes.append(Stroke(rim, self.colors.body, 2.0, fill=self.colors.body))
        else:
            axis = np.asarray(one.axis) / np.linalg.norm(one.axis)
            first = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
            first /= np.linalg.norm(first)
            second = np.cross(axis, first)
            circle = np.outer(np.cos(turn), first) + np.outer(np.sin(turn), second)
            rim = self._line(
                one.center + one.radius * circle, self.colors.body, 2.5, fill=self.colors.body
            )
        low = rim[int(np.argmin(rim @ np.array([1.0, 0.6])))]
        self._label(one.name, low, self.colors.ink, low - rim.mean(axis=0))

    def _joint(self, one: s.Joint) -> None:
        at = self.see(one.at)[0]
        if one.axis is not None:
            along = 0.05 * self.size * np.asarray(one.axis)
            self._line((one.at - along, one.at + along), self.colors.axis, 4.0)
        if one.ground:
            self._hatching(at)
        self.dots.append((at, self.colors.body, 8.0, self.colors.ground))
        self._label(one.name, at, self.colors.ink)

    def _hatching(self, at: np.ndarray) -> None:
        """Draw what a pin stands on."""
        size = 0.022 * self.size
        foot = at + size * np.array([[-1.0, -1.6], [0.0, 0.0], [1.0, -1.6], [-1.0, -1.6]])
        self.strokes.append(Stroke(foot, self.colors.body, 1.5))
        for shift in (-0.9, -0.2, 0.5):
            tooth = at + size * np.array([[shift + 0.4, -1.6], [shift, -2.3]])
            self.strokes.append(Stroke(tooth, self.colors.body, 1.2))

    def _wheel(self, one: s.Wheel) -> None:
        half = one.length / 2 * np.asarray(one.along) / np.linalg.norm(one.along)
        self._line(
            (one.at - half, one.at + half), self.colors.constraint, 7.0 if not one.edge else 4.0
        )
        if self.named:
            self._line((one.at + half, one.at + 1.9 * half), self.colors.constraint, 1.2, head=True)
        self.kinds.add("constraint")

    def _center(self, one: s.Center) -> None:
        at = self.see(one.at)[0]
        if self.named:
            self.dots.append((at, self.colors.ink, 6.0, self.colors.ink))
            self.kinds.add("center")
        self._label(one.name, at, self.colors.ink)

    def _spring(self, one: s.Spring) -> None:
        start, end = (np.asarray(p, dtype=float) for p in (one.start, one.end))
        seen = self.see((start, end))
        along = seen[1] - seen[0]
        across = np.array([-along[1], along[0]]) / max(float(np.hypot(*along)), 1e-300)
        share = np.array([0.0, 0.2, *np.linspace(0.24, 0.76, 14), 0.8, 1.0])
        sway = np.array([0.0, 0.0, *np.tile([1.0, -1.0], 7), 0.0, 0.0])
        points = seen[0] + np.outer(share, along) + 0.018 * self.size * np.outer(sway, across)
        self.strokes.append(Stroke(points, self.colors.spring, 1.5))
        self._label(one.name, seen.mean(axis=0), self.colors.spring, across)

    def _measure(self, name: str) -> str:
        """Return the colour of a coordinate, or of a length or angle that is none."""
        if name not in self.coordinates:
            return self.colors.ink
        self.kinds.add("coordinate")
        return self.colors.coordinate

    def _angle(self, one: s.Angle) -> None:
        if not self.named:
            return
        color = self._measure(one.name)
        first, second = np.asarray(one.first, float), np.asarray(one.second, float)
        small = abs(one.angle) < SMALL
        turn = np.linspace(0.0, SENSE if small else one.angle, 41)[:, None]
        arc = one.at + one.radius * (np.cos(turn) * first + np.sin(turn) * second)
        reference = (one.at, one.at + 1.12 * one.radius * first)
        self._line(reference, self.colors.faint, 1.0, style=(0, (4, 3)))
        seen = self._line(arc, color, 1.8, head=True, style=(0, (1, 1.5)) if small else "-")
        middle = seen[len(seen) // 2]
        self._label(one.name, middle, color, middle - self.see(one.at)[0])

    def _distance(self, one: s.Distance) -> None:
        if not self.named:
            return
        color = self._measure(one.name) if one.name else self.colors.faint
        look: dict[str, Any] = {"head": True} if one.name else {"style": (0, (4, 3))}
        seen = self._line((one.start, one.end), color, 1.5, **look)
        step = seen[1] - seen[0]
        self._label(one.name, seen.mean(axis=0), color, np.array([-step[1], step[0]]))

    def _arrow(self, one: s.Arrow) -> None:
        if not self.named:
            return
        end = np.asarray(one.at, float) + np.asarray(one.along, float)
        if not one.name:
            self._line((one.at, end), self.colors.faint, 1.0, style=(0, (4, 3)))
            return
        color = self.colors.axis if one.frame else self.colors.ink
        seen = self._line((one.at, end), color, 1.6 if one.frame else 2.4, head=True)
        self._label(one.name.removesuffix(" axis"), seen[1], color, seen[1] - seen[0])
        self.kinds.add("axis" if one.frame else "")

    def _constraint(self, one: s.Constraint) -> None:
        self._label(one.name, self.see(one.at)[0], self.colors.constraint)
        self.kinds.add("constraint")

    def _trail(self, one: s.Trail) -> None:
        self.trails.append(self.see(one.at)[0])

    @property
    def bounds(self) -> np.ndarray:
        """Least and largest of what is drawn (2, 2), m."""
        points = np.vstack(
            [*(stroke.points for stroke in self.strokes), *(d[0] for d in self.dots)]
        )
        return np.array([points.min(axis=0), points.max(axis=0)])


def _points_of(part: s.Part) -> list[Any]:
    named = part._asdict()
    return (
        [*named["points"]]
        if "points" in named
        else [named[x] for x in ("at", "center", "start", "end") if x in named]
    )
