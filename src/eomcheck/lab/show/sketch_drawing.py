"""Drawings of mechanisms: a `Sketch` turned into strokes, dots and labels on the page.

A `Sketch` (`eomcheck.mechanics.sketch`) lists the parts of a mechanism in one pose, in m. A `View`
projects their points: planar ones unchanged, spatial ones orthographically; a `Space` keeps them in
space for a viewer. A `Drawing` turns each part into strokes, dots and labels in the colors of a
light or a dark background. `place_labels`
puts each label where it covers neither another label nor a stroke: it tries 16 directions and 7
distances around the named point and takes the position of least cost; a label far from its point
gets a leader line. Only the labels need matplotlib (`eomcheck.lab.show.pictures` paints).
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from itertools import pairwise, product
from typing import Any, NamedTuple

import numpy as np

from eomcheck.mechanics import sketch as s

# ---- Colors --------------------------------------------------------------------------------------


class Colors(NamedTuple):
    """Color scheme: Okabe and Ito's colors, or darker ones of the same hue, for legible text."""

    ground: str
    ink: str
    body: str
    faint: str
    coordinate: str
    constraint: str
    axis: str
    spring: str


LIGHT = Colors(
    *("#ffffff", "#1a1a1a", "#333333", "#8a8a8a"), *("#0072B2", "#B34F00"), "#00785A", "#A8527F"
)
DARK = Colors(
    *("#131416", "#f0f0f0", "#d8d8d8", "#8a8a8a"), *("#56B4E9", "#F0A030"), "#3CC9A0", "#E08FBB"
)
ROLES = Colors(*Colors._fields)
"""Names of the colors in place of colors, for a page that has a light and a dark scheme."""


# ---- Projection ----------------------------------------------------------------------------------


class Stroke(NamedTuple):
    """Polyline on the page, in projected m."""

    points: np.ndarray
    color: str
    width: float
    style: Any = "-"
    fill: str = ""
    head: bool = False
    """Whether it ends in an arrow's head."""


class View:
    """Projection of a sketch's points: identity in the plane, orthographic in space."""

    def __init__(self, sketch: s.Sketch):
        up = np.eye(3)[sketch.up]
        east, north = (np.eye(3)[(sketch.up + k) % 3] for k in (1, 2))
        ahead = np.cos(sketch.azimuth) * east + np.sin(sketch.azimuth) * north
        towards = np.cos(sketch.elevation) * ahead + np.sin(sketch.elevation) * up
        right = np.cross(up, ahead)
        self.axes = np.array([right, np.cross(towards, right)])
        self.towards = towards
        self.page = np.eye(2)
        """Directions to the right and upwards on the page, in projected coordinates (2, 2)."""
        self.circles = (self.page,)
        """Pairs of directions that span the circles by which a ball is drawn."""

    def __call__(self, points: Any) -> np.ndarray:
        """Return points (k, d), or one (d,), projected to the page (k, 2)."""
        array = np.atleast_2d(np.asarray(points, dtype=float))
        return array if array.shape[1] == 2 else array @ self.axes.T

    def across(self, along: np.ndarray) -> np.ndarray:
        """Return a direction of the page (2,) turned to the left by 90°."""
        return np.array([-along[1], along[0]])

    def wheel(self, wheel: s.Wheel, half: np.ndarray) -> Any:
        """Return the line of a wheel (2, d) seen from above, which goes `half` (d,) both ways."""
        return wheel.at - half, wheel.at + half

    def text(self, name: str) -> str:
        """Return a name as the text of a label."""
        return symbol(name)


class Space(View):
    """Points in space for a viewer, not projected; planar ones are in the plane z = 0.

    The axes are permuted so that the last one points up.
    """

    def __init__(self, sketch: s.Sketch):
        super().__init__(sketch)
        self.order = [(sketch.up + k) % 3 for k in (1, 2, 3)]
        self.axes, self.towards = self.axes[:, self.order], self.towards[self.order]
        self.page = self.axes
        self.circles = tuple(np.eye(3)[[k, (k + 1) % 3]] for k in range(3))

    def __call__(self, points: Any) -> np.ndarray:
        """Return points (k, 2 or 3), or one of them, in space (k, 3)."""
        array = np.atleast_2d(np.asarray(points, dtype=float))
        return np.pad(array, ((0, 0), (0, 3 - array.shape[1])))[:, self.order]

    def across(self, along: np.ndarray) -> np.ndarray:
        """Return a direction (3,) at right angles to `along`, to its left as first seen."""
        return np.cross(self.towards, along)

    def wheel(self, wheel: s.Wheel, half: np.ndarray) -> Any:
        """Return the rim of a wheel (k, 3) that stands upright with its hub in the plane."""
        line = np.asarray(super().wheel(wheel, half))
        if wheel.edge or line.shape[1] == 3:
            return line
        turn = np.linspace(0.0, 2 * np.pi, 37)[:, None]
        rim = line.mean(axis=0) + np.cos(turn) * half
        return np.hstack((rim, wheel.length / 2 * np.sin(turn)))

    def text(self, name: str) -> str:
        """Return a name as HTML; the part after "_" is a subscript."""
        return re.sub(r"(\w+?)_(\w+)", r"\1<sub>\2</sub>", name)


# ---- Parts as strokes ----------------------------------------------------------------------------

SENSE = 0.7
"""Arc drawn for an angle too small to be visible, to show its sense, rad."""
SMALL = 0.15
"""Angles below this are too small to be visible, rad."""
NAMED_ONLY = s.Angle, s.Distance, s.Arrow
"""Parts that are drawn only beside names."""


class Drawing:
    """Strokes, dots and labels of a sketch, in drawing order."""

    def __init__(
        self,
        sketch: s.Sketch,
        colors: Colors,
        coordinates: Collection[str] | None = None,
        view: View | None = None,
    ):
        """Collect the strokes; without names of `coordinates`, no labels, measures and arrows. The
        `view` is by default that of the sketch, onto a page.
        """
        self.see = View(sketch) if view is None else view
        self.colors, self.named = colors, coordinates is not None
        self.coordinates = coordinates or ()
        self.strokes: list[Stroke] = []
        self.drawn: list[type[s.Part]] = []
        """Kind of the part of each stroke."""
        self.dots: list[tuple[np.ndarray, str, float, str]] = []
        self.labels: list[Label] = []
        self.kinds: set[str] = set()
        self.trails: list[np.ndarray] = []
        points = [p for part in sketch.parts for p in _points_of(part)]
        projected = np.vstack([self.see(p) for p in points])
        self.size = float(np.ptp(projected, axis=0).max())
        ranks = [s.Plane, s.Disk, s.SpringMark, s.Body, s.Wheel, s.Distance, s.Arrow, s.Angle]
        ranks += [s.Velocity, s.Force]
        ranked = {kind: rank for rank, kind in enumerate(ranks)}
        for part in sorted(sketch.parts, key=lambda part: ranked.get(type(part), len(ranks))):
            if not self.named and isinstance(part, NAMED_ONLY):
                continue
            getattr(self, f"_{type(part).__name__.lower()}")(part)
            self.drawn += [type(part)] * (len(self.strokes) - len(self.drawn))

    def _line(self, points: Any, color: str, width: float, **look: Any) -> np.ndarray:
        line = self.see(points)
        self.strokes.append(Stroke(line, color, width, **look))
        return line

    def _label(self, text: str, at: np.ndarray, color: str, away: np.ndarray | None = None) -> None:
        if text and self.named:
            self.labels.append(Label(self.see.text(text), at, color, away))

    def _plane(self, plane: s.Plane) -> None:
        corners = [*plane.points, plane.points[0]]
        self._line(corners, self.colors.faint, 0.6, fill=self.colors.faint)

    def _body(self, body: s.Body) -> None:
        points = [*body.points, body.points[0]] if body.closed else [*body.points]
        fill = self.colors.body if body.closed else ""
        line = self._line(points, self.colors.body, 1.2 if body.thin else 3.0, fill=fill)
        across = self.see.across(line[1] - line[0])
        self._label(body.name, (line[0] + 2 * line[1]) / 3, self.colors.ink, across)

    def _disk(self, disk: s.Disk) -> None:
        turn = np.linspace(0.0, 2 * np.pi, 73)
        if disk.ball:
            center = self.see(disk.center)[0]
            circle = disk.radius * np.column_stack((np.cos(turn), np.sin(turn)))
            rims = [center + circle @ axes for axes in self.see.circles]
            body = self.colors.body
            self.strokes += [Stroke(rim, body, 2.0, fill=body) for rim in rims]
            rim = rims[0]
        else:
            axis = np.asarray(disk.axis) / np.linalg.norm(disk.axis)
            first = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
            first /= np.linalg.norm(first)
            second = np.cross(axis, first)
            circle = np.outer(np.cos(turn), first) + np.outer(np.sin(turn), second)
            rim = self._line(
                disk.center + disk.radius * circle, self.colors.body, 2.5, fill=self.colors.body
            )
        low = rim[int(np.argmin(rim @ (np.array([1.0, 0.6]) @ self.see.page)))]
        self._label(disk.name, low, self.colors.ink, low - rim.mean(axis=0))

    def _jointmark(self, mark: s.JointMark) -> None:
        at = self.see(mark.at)[0]
        if mark.axis is not None:
            along = 0.05 * self.size * np.asarray(mark.axis)
            self._line((mark.at - along, mark.at + along), self.colors.axis, 4.0)
        if mark.ground:
            self._hatching(at)
        self.dots.append((at, self.colors.body, 8.0, self.colors.ground))
        self._label(mark.name, at, self.colors.ink)

    def _hatching(self, at: np.ndarray) -> None:
        """Draw the ground below a pin joint."""
        size, page = 0.022 * self.size, self.see.page
        foot = at + size * (np.array([[-1.0, -1.6], [0.0, 0.0], [1.0, -1.6], [-1.0, -1.6]]) @ page)
        self.strokes.append(Stroke(foot, self.colors.body, 1.5))
        for shift in (-0.9, -0.2, 0.5):
            tooth = at + size * (np.array([[shift + 0.4, -1.6], [shift, -2.3]]) @ page)
            self.strokes.append(Stroke(tooth, self.colors.body, 1.2))

    def _wheel(self, wheel: s.Wheel) -> None:
        half = wheel.length / 2 * np.asarray(wheel.along) / np.linalg.norm(wheel.along)
        self._line(
            self.see.wheel(wheel, half),
            self.colors.constraint,
            7.0 if not wheel.edge else 4.0,
        )
        if self.named:
            self._line(
                (wheel.at + half, wheel.at + 1.9 * half), self.colors.constraint, 1.2, head=True
            )
        self.kinds.add("constraint")

    def _center(self, center: s.Center) -> None:
        at = self.see(center.at)[0]
        if self.named:
            self.dots.append((at, self.colors.ink, 6.0, self.colors.ink))
            self.kinds.add("center")
        self._label(center.name, at, self.colors.ink)

    def _springmark(self, spring: s.SpringMark) -> None:
        start, end = (np.asarray(p, dtype=float) for p in (spring.start, spring.end))
        ends = self.see((start, end))
        along = ends[1] - ends[0]
        across = self.see.across(along) / max(float(np.linalg.norm(along)), 1e-300)
        share = np.array([0.0, 0.2, *np.linspace(0.24, 0.76, 14), 0.8, 1.0])
        sway = np.array([0.0, 0.0, *np.tile([1.0, -1.0], 7), 0.0, 0.0])
        points = ends[0] + np.outer(share, along) + 0.018 * self.size * np.outer(sway, across)
        self.strokes.append(Stroke(points, self.colors.spring, 1.5))
        self._label(spring.name, ends.mean(axis=0), self.colors.spring, across)

    def _measure(self, name: str) -> str:
        """Return the color of an angle or length: a coordinate's, or ink."""
        if name not in self.coordinates:
            return self.colors.ink
        self.kinds.add("coordinate")
        return self.colors.coordinate

    def _angle(self, angle: s.Angle) -> None:
        color = self._measure(angle.name)
        first, second = np.asarray(angle.first, float), np.asarray(angle.second, float)
        small = abs(angle.angle) < SMALL
        turn = np.linspace(0.0, SENSE if small else angle.angle, 41)[:, None]
        arc = angle.at + angle.radius * (np.cos(turn) * first + np.sin(turn) * second)
        reference = (angle.at, angle.at + 1.12 * angle.radius * first)
        self._line(reference, self.colors.faint, 1.0, style=(0, (4, 3)))
        line = self._line(arc, color, 1.8, head=True, style=(0, (1, 1.5)) if small else "-")
        middle = line[len(line) // 2]
        self._label(angle.name, middle, color, middle - self.see(angle.at)[0])

    def _distance(self, distance: s.Distance) -> None:
        color = self._measure(distance.name) if distance.name else self.colors.faint
        look: dict[str, Any] = {"head": True} if distance.name else {"style": (0, (4, 3))}
        line = self._line((distance.start, distance.end), color, 1.5, **look)
        across = self.see.across(line[1] - line[0])
        self._label(distance.name, line.mean(axis=0), color, across)

    def _arrow(self, arrow: s.Arrow) -> None:
        end = np.asarray(arrow.at, float) + np.asarray(arrow.along, float)
        if not arrow.name:
            self._line((arrow.at, end), self.colors.faint, 1.0, style=(0, (4, 3)))
            return
        color = self.colors.axis if arrow.frame else self.colors.ink
        line = self._line((arrow.at, end), color, 1.6 if arrow.frame else 2.4, head=True)
        self._label(arrow.name.removesuffix(" axis"), line[1], color, line[1] - line[0])
        self.kinds.add("axis" if arrow.frame else "")

    def _velocity(self, arrow: s.Velocity) -> None:
        self._line((arrow.at, arrow.at + arrow.along), self.colors.coordinate, 2.0, head=True)

    def _force(self, arrow: s.Force) -> None:
        self._line((arrow.at, arrow.at + arrow.along), self.colors.constraint, 2.4, head=True)

    def _constraintmark(self, mark: s.ConstraintMark) -> None:
        self._label(mark.name, self.see(mark.at)[0], self.colors.constraint)
        self.kinds.add("constraint")

    def _ground(self, ground: s.Ground) -> None:
        self._hatching(self.see(ground.at)[0])

    def _closing(self, closing: s.Closing) -> None:
        """Draw nothing: the body's line ends there, and a `ConstraintMark` names the rows."""

    def _trail(self, trail: s.Trail) -> None:
        self.trails.append(self.see(trail.at)[0])

    @property
    def bounds(self) -> np.ndarray:
        """Least and largest coordinates of the drawing (2, 2), m."""
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


# ---- Placement of labels -------------------------------------------------------------------------

SIZE = 15
"""Font size of labels, pt."""
AWAY = (9, 16, 26, 40, 58, 80, 105)
"""Distances from the named point that are tried for a label, px."""
DIRECTIONS = 16
LEADER = 22
"""Distance of a label from its point from which on it has a leader line, px."""
STEP = 4.0
"""Distance of the sample points on lines that labels avoid, px."""


class Label(NamedTuple):
    """Text to be written beside a point, preferably in the direction `away` from it."""

    text: str
    at: np.ndarray
    color: str
    away: np.ndarray | None = None


def symbol(name: str) -> str:
    """Return a name in mathtext; the part after "_" is a subscript."""
    return re.sub(r"(\w+?)_(\w+)", r"$\\mathrm{\1}_{\\mathrm{\2}}$", name)


def place_labels(
    axes: Any, labels: Sequence[Label], strokes: Sequence[np.ndarray], faint: str
) -> list[Any]:
    """Write labels into axes whose limits are final; return the text artists."""
    figure = axes.figure
    renderer = figure.canvas.get_renderer()
    to_pixels = axes.transData.transform
    points = np.vstack([_sampled(to_pixels(stroke)) for stroke in strokes])
    frame = axes.get_window_extent(renderer)
    taken: list[np.ndarray] = []
    texts = []
    # Short names of coordinates first: they must stay close to their points, sentences need not.
    for label in sorted(labels, key=lambda label: len(label.text)):
        text = axes.text(
            *label.at, label.text, color=label.color, fontsize=SIZE, ha="center", va="center"
        )
        extent = text.get_window_extent(renderer)
        size, at = np.array([extent.width, extent.height]) + 4, to_pixels(label.at)
        away = None if label.away is None else to_pixels(label.at + label.away) - at
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
    """Return the centre (2,), px, of a label at the position of least cost."""
    positions = _positions(at, size, away)
    costs = [base + _cost(center, size, taken, points, frame) for center, base in positions]
    best, least = at, np.inf
    for k in np.argsort(costs, kind="stable"):
        if costs[k] >= least:
            break
        center = positions[k][0]
        cost = costs[k] + _cost_of_leader(_leader(at, center, size), taken, points)
        if cost < least:
            best, least = center, cost
    return best


def _positions(at: np.ndarray, size: np.ndarray, away: np.ndarray | None) -> list[Any]:
    """Return candidates (centre of the label, cost of its distance and direction) around a
    point.
    """
    candidates = []
    for gap, k in product(AWAY, range(DIRECTIONS)):
        turn = 2 * np.pi * k / DIRECTIONS
        unit = np.array([np.cos(turn), np.sin(turn)])
        cost = 0.25 * gap
        if away is not None and np.hypot(*away) > 0:
            cost += 5 * (1 - unit @ away / np.hypot(*away))
        candidates.append((at + unit * (gap + np.abs(unit) @ size / 2), cost))
    return candidates


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
    """Return the cost of a leader line: labels and lines that it crosses."""
    if leader is None:
        return 0.0
    along = _sampled(leader)
    along = along[np.hypot(*(along - leader[0]).T) > 8]
    through = sum(((along > box[0]) & (along < box[1])).all(axis=1).any() for box in taken)
    near = np.abs(along[:, None] - points).max(axis=2).min(axis=1, initial=np.inf) < STEP / 2
    return 500.0 * through + 3.0 * np.count_nonzero(near)


def _sampled(points: np.ndarray) -> np.ndarray:
    """Return closely spaced points along a line (k, 2), px."""
    parts = [points[-1:]]
    for start, end in pairwise(points):
        count = max(int(np.hypot(*(end - start)) / STEP), 1)
        parts.append(start + np.outer(np.arange(count) / count, end - start))
    return np.vstack(parts)


# ---- Joints of a snake ---------------------------------------------------------------------------


def link_ends(length: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return the ends of the links of a snake (N + 1, 2), m, the head first."""
    theta = q[2:]
    steps = length[:, None] * np.column_stack((np.cos(theta), np.sin(theta)))
    return np.vstack((q[:2], q[:2] + np.cumsum(steps, axis=0)))
