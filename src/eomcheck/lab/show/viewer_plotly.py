"""Mechanisms as plotly figures in space, which a page lets its reader turn by hand.

A `Drawing` of a `Sketch` on a `Space` has the same strokes, dots and labels as a picture, not yet
projected; they are gathered into one trace per group, color and width. Colors are not in the
figures but their roles (fields of `Colors`): the script `viewer.js` of the page colors them, draws,
and moves them from pose to pose.

Velocities are those of centres of mass and of traced points. The force of a constraint by the
ground is drawn at its mark, along the directions in which a coordinate shifts all bodies: its
component there is the entry of aᵀλ for this coordinate. Where a loop closes, the force f acts on
one body and -f on the other: Jᵀ f = aᵀλ with the derivatives J of the distance of their points.
"""

from __future__ import annotations

import json
import re
from base64 import b64encode
from collections.abc import Collection, Iterator, Sequence
from html import escape
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from eomcheck.atomic_write import write_text
from eomcheck.evaluation.dynamics import acceleration
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.show.chart_matplotlib import save_figure
from eomcheck.lab.show.chart_plotly import go, plotly_js
from eomcheck.lab.show.pictures import (
    SAME,
    motion_to_draw,
    moving_state,
    scene_figure,
    sketch_of,
)
from eomcheck.lab.show.sketch_drawing import DARK, LIGHT, ROLES, Drawing, Space, Stroke
from eomcheck.lab.show.table import render
from eomcheck.mechanics import sketch as s
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array

# ---- Velocities and forces -----------------------------------------------------------------------

LONGEST = 0.22
"""Length of the longest arrow of a velocity or force, relative to the mechanism."""
STEP = 1e-6
"""Step of a central difference of points of a sketch along the motion, s."""


class ShownState(NamedTuple):
    """State to show: t, s; q (n,), v (n,) and the multipliers λ (r,), or None without."""

    t: float
    q: Array
    v: Array
    multipliers: Array | None


def state_with_multipliers(scene: Scene, q: Array, v: Array, t: float = 0.0) -> ShownState:
    """Return the state q (n,), v (n,) with its multipliers by the formulation `au`."""
    # A computed motion violates its constraints slightly.
    found = acceleration(scene, "au", q, v, t, consistent=False)
    return ShownState(t, q, v, found.multipliers)


def shown_state(scene: Scene, q: Array) -> ShownState:
    """Return the state in the closed pose next to q (n,) that moves in every coordinate it can.

    Raises:
        RefusedError: there is no such pose.
    """
    _, _, q, v = moving_state(scene, q, FORMULATIONS["au"])
    return state_with_multipliers(scene, q, v)


def states_of_motion(
    scene: Scene, formulation: str, end: float, frames: int, u0: Sequence[float] | None = None
) -> list[ShownState]:
    """Return the states of a motion at equal time steps, from the initial state or from u0 (p,).

    Raises:
        InputError: fewer than two frames, an end that is no positive time, or no such formulation.
        EomcheckError: the motion does not reach its end.
    """
    motion = motion_to_draw(scene, formulation, end, frames, u0=u0)
    moving = zip(motion.q, motion.v, motion.times.tolist(), strict=True)
    return [state_with_multipliers(scene, *one) for one in moving]


class Scale(NamedTuple):
    """Largest speed, m/s, and force, N, whose arrows are `LONGEST`."""

    speed: float
    force: float


def sketches_with_arrows(
    scene: Scene, states: Sequence[ShownState]
) -> tuple[list[s.Sketch], Scale]:
    """Return the sketch of each state with its velocities and constraint forces, to one scale.

    Raises:
        InputError: the scene has no sketch.
    """
    sketches = [sketch_of(scene, state.q, state.t) for state in states]
    ways = _translations(scene, states[0])
    speeds = [_velocities(scene, one) for one in states]
    forces = [
        _forces(scene, one, sketch, ways) for one, sketch in zip(states, sketches, strict=True)
    ]
    size = _size(sketches[0])
    scale = Scale(_largest(speeds), _largest(forces))
    return [
        sketch._replace(
            parts=(
                *sketch.parts,
                *_arrows(s.Velocity, velocities, LONGEST * size, scale.speed),
                *_arrows(s.Force, constraint_forces, LONGEST * size, scale.force),
            )
        )
        for sketch, velocities, constraint_forces in zip(sketches, speeds, forces, strict=True)
    ], scale


AT_REST = Scale(0.0, 0.0)
"""Scale of sketches without arrows."""


Vectors = list[tuple[Array, Array]]
"""Points and vectors there."""


def _size(sketch: s.Sketch) -> float:
    return Drawing(sketch, ROLES, view=Space(sketch)).size


def _largest(found: Sequence[Vectors]) -> float:
    lengths = (float(np.linalg.norm(along)) for one in found for _, along in one)
    return max(lengths, default=0.0)


def _arrows(part: Any, vectors: Vectors, longest: float, largest: float) -> Iterator[Any]:
    """Yield the arrows of vectors, without those that vanish beside the largest."""
    for at, along in vectors:
        if np.linalg.norm(along) > SAME * largest:
            yield part(np.asarray(at, float), longest / largest * along)


def _points(sketch: s.Sketch, kinds: Any) -> list[Array]:
    """Return a point of each part of some kinds."""
    parts = (part._asdict() for part in sketch.parts if isinstance(part, kinds))
    points = (x["points"][0] if "points" in x else x.get("at", x.get("center")) for x in parts)
    return [np.asarray(point, float) for point in points]


def _velocities(scene: Scene, state: ShownState) -> Vectors:
    """Return the velocities of the centres of mass and of the traced points, by differences."""
    kinds = s.Center, s.Trail
    at, behind, ahead = (
        _points(sketch_of(scene, state.q + h * state.v, state.t + h), kinds)
        for h in (0.0, -STEP, STEP)
    )
    return [(p, (b - a) / (2 * STEP)) for p, a, b in zip(at, behind, ahead, strict=True)]


def _translations(scene: Scene, state: ShownState) -> list[tuple[int, Array]]:
    """Return the coordinates that shift all bodies, each with the shift by its unit."""
    # Bodies of some poses have no lines, where their joints coincide.
    kinds = s.Disk, s.Wheel, s.Center, s.ConstraintMark
    points = np.array(_points(sketch_of(scene, state.q, state.t), kinds))
    if not len(points):
        return []
    found = []
    for k, unit in enumerate(np.eye(scene.n)):
        shifted = np.array(_points(sketch_of(scene, state.q + unit, state.t), kinds)) - points
        if np.abs(shifted - shifted[0]).max() <= SAME and shifted[0].any():
            found.append((k, shifted[0]))
    return found


def _forces(
    scene: Scene, state: ShownState, sketch: s.Sketch, ways: Sequence[tuple[int, Array]]
) -> Vectors:
    """Return the force at each mark of constraints, along the shifts of coordinates, and where
    loops close.
    """
    a, multipliers = Evaluation(scene, state.q, state.v, state.t).terms.a, state.multipliers
    if a is None or multipliers is None:
        return []

    def generalized(rows: Collection[int]) -> Array:
        return a[list(rows)].T @ multipliers[list(rows)]

    closings = _parts_of(sketch, s.Closing)
    forces = _closing_forces(scene, state, [generalized(closing.rows) for closing in closings])
    closed = {row for closing in closings for row in closing.rows}
    for mark in _parts_of(sketch, s.ConstraintMark) if ways else ():
        q_forces = generalized([row for row in mark.rows if row not in closed])
        force = sum(q_forces[k] * shift for k, shift in ways)
        forces.append((np.asarray(mark.at, float), np.asarray(force)))
    return forces


def _parts_of(sketch: s.Sketch, kind: Any) -> list[Any]:
    return [part for part in sketch.parts if isinstance(part, kind)]


EXACT = 1e-4
"""Largest part of aᵀλ, relative to it, that the force at a closing point may leave out."""


def _closing_forces(scene: Scene, state: ShownState, generalized: Sequence[Array]) -> Vectors:
    """Return the force where each loop closes whose generalized forces (n,) it explains.

    Of redundant components the force of least norm is drawn.
    """
    if not generalized:
        return []

    def closings(q: Array) -> list[s.Closing]:
        return _parts_of(sketch_of(scene, q, state.t), s.Closing)

    def gaps(q: Array) -> Array:
        return np.array([np.subtract(x.at, x.other) for x in closings(q)], float)

    steps = STEP * np.eye(scene.n)
    rates = [(gaps(state.q + step) - gaps(state.q - step)) / (2 * STEP) for step in steps]
    forces = []
    for closing, jacobian, expected in zip(
        closings(state.q), np.moveaxis(np.array(rates), 0, 1), generalized, strict=True
    ):
        force = np.linalg.lstsq(jacobian, expected, rcond=EXACT)[0]
        if np.linalg.norm(jacobian @ force - expected) <= EXACT * np.linalg.norm(expected):
            forces.append((np.asarray(closing.at, float), force))
    return forces


# ---- Figures -------------------------------------------------------------------------------------

HEAD = 0.025
"""Length of an arrow's head, relative to the mechanism."""
GROUPS = {s.Velocity: "velocity", s.Force: "force"} | dict.fromkeys(
    (s.Angle, s.Distance, s.Arrow), "names"
)
"""Kind of part -> group of traces that a reader shows or hides; others are the mechanism."""
DIGITS = 4
"""Decimal digits of coordinates, relative to the mechanism."""


Key = tuple[Any, ...]


PLACES = tuple(
    f"{y} {x}" for x in ("right", "left", "center") for y in ("top", "bottom", "middle")
)[:-1]
"""Positions of a label beside its point that are tried in this order."""
LETTER, LINE = 0.024, 0.055
"""Width of a letter and height of a line of labels on a telephone, relative to the diagonal of the
axes."""


def _label_places(drawing: Drawing) -> list[str]:
    """Return the position of each label beside its point: the one that, as first seen, covers the
    smallest area of the labels before it.
    """
    taken: list[Array] = []
    places = []
    low, high = _limits([drawing])
    diagonal = float(np.linalg.norm(high - low))
    for label in drawing.labels:
        width = LETTER * (len(re.sub("<.*?>", "", label.text)) + 1)
        half = diagonal * np.array([width, LINE]) / 2
        boxes = [drawing.see.page @ label.at + half * _side(place) for place in PLACES]
        covered = [
            sum(
                np.clip(half + other[1] - np.abs(box - other[0]), 0.0, None).prod()
                for other in taken
            )
            for box in boxes
        ]
        best = int(np.argmin(covered))
        taken.append(np.array([boxes[best], half]))
        places.append(PLACES[best])
    return places


def _side(place: str) -> Array:
    """Return the side (2,) of a point, to the right and upwards, on which a label is."""
    y, x = place.split()
    sides = {"right": 1.0, "left": -1.0, "top": 1.0, "bottom": -1.0}
    return np.array([sides.get(x, 0.0), sides.get(y, 0.0)])


class _TracePoints:
    """Points (k, 3) of one trace, None between its lines, and texts with positions or triangles."""

    def __init__(self) -> None:
        self.points: list[Any] = []
        self.more: list[Any] = []


def _traces(drawing: Drawing) -> dict[Key, _TracePoints]:
    """Return the strokes, dots and labels of a drawing by group, kind and appearance."""
    traces: dict[Key, _TracePoints] = {}
    for stroke, part in zip(drawing.strokes, drawing.drawn, strict=True):
        group = GROUPS.get(part, "mechanism")
        dash = "solid" if stroke.style == "-" else "dot"
        if stroke.fill:
            fill = traces.setdefault((group, "fill", stroke.fill), _TracePoints())
            first, count = len(fill.points), len(stroke.points)
            fill.points += [*stroke.points]
            fill.more += [(first, first + k, first + k + 1) for k in range(1, count - 1)]
        line = traces.setdefault((group, "line", stroke.color, stroke.width, dash), _TracePoints())
        line.points += [*stroke.points, None]
        if stroke.head:
            head = traces.setdefault(
                (group, "line", stroke.color, stroke.width, "solid"), _TracePoints()
            )
            head.points += _head(stroke, drawing)
    for at, color, size, fill in drawing.dots:
        traces.setdefault(("mechanism", "dots", color, fill, size), _TracePoints()).points.append(
            at
        )
    for label, place in zip(drawing.labels, _label_places(drawing), strict=True):
        text = traces.setdefault(("names", "text", label.color), _TracePoints())
        text.points.append(label.at)
        text.more.append((label.text, place))
    return traces


def _head(stroke: Stroke, drawing: Drawing) -> list[Any]:
    """Return the lines of an arrow's head, in two planes at right angles."""
    tip, step = stroke.points[-1], stroke.points[-1] - stroke.points[-2]
    if not step.any():
        return []
    along = step / np.linalg.norm(step)
    first = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
    sides = [first / np.linalg.norm(first)]
    sides += [-sides[0], np.cross(along, sides[0]), -np.cross(along, sides[0])]
    barbs = [tip - HEAD * drawing.size * (along - 0.4 * side) for side in sides]
    return [point for barb in barbs for point in (barb, tip, None)]


def _axes_of(trace: _TracePoints, digits: int) -> list[list[float | None]]:
    """Return the coordinates x, y and z of the points of a trace."""
    rows = [None if p is None else [round(float(x), digits) for x in p] for p in trace.points]
    return [[None if row is None else row[k] for row in rows] for k in range(3)]


def _added(figure: Any, key: Key, trace: _TracePoints, digits: int) -> None:
    """Add a trace to a figure; its meta has the group and the roles of its colors."""
    group, kind, color, *look = key
    x, y, z = _axes_of(trace, digits)
    options: dict[str, Any] = {"x": x, "y": y, "z": z, "hoverinfo": "skip"}
    meta = {"group": group, "color": color}
    if kind == "fill":
        i, j, k = zip(*trace.more, strict=True)
        figure.add_mesh3d(i=i, j=j, k=k, opacity=0.15, meta=meta, **options)
    elif kind == "line":
        line = {"width": 1.6 * look[0], "dash": look[1]}
        figure.add_scatter3d(mode="lines", line=line, meta=meta, **options)
    elif kind == "dots":
        marker = {"size": 0.7 * look[1], "line": {"width": 2}}
        meta["fill"] = look[0]
        figure.add_scatter3d(mode="markers", marker=marker, meta=meta, **options)
    else:
        texts, places = map(list, zip(*trace.more, strict=True)) if trace.more else ([], [])
        where = {"textposition": places, "textfont": {"size": 14}}
        figure.add_scatter3d(mode="text", text=texts, meta=meta, **where, **options)


def viewer_json(
    scene: Scene, states: Sequence[ShownState], coordinates: Collection[str] | None = None
) -> str:
    """Return a mechanism in one or more states as JSON for `viewer.js`.

    Args:
        scene: the scene, which has a sketch.
        states: states of a motion, or one.
        coordinates: names of the coordinates, by default those of the scene.

    Raises:
        InputError: the scene has no sketch.

    Returns:
        `figure`: the first state as a plotly figure; `poses`: x, y and z of its traces in each
        state; `times`, s; `colors`: the roles' colors on light and on dark ground; `scale`: speed
        and force of the longest arrows.
    """
    names = scene.coordinate_names if coordinates is None else coordinates
    sketches, scale = sketches_with_arrows(scene, states)
    return sketches_json(sketches, names, [state.t for state in states], scale)


def sketches_json(
    sketches: Sequence[s.Sketch],
    names: Collection[str],
    times: Sequence[float] = (0.0,),
    scale: Scale = AT_REST,
) -> str:
    """Return the JSON of `viewer_json` of sketches at some times.

    Args:
        sketches: the mechanism in each pose.
        names: names of the coordinates.
        times: times of the poses, s.
        scale: speed and force of the longest arrows.
    """
    drawings = [Drawing(sketch, ROLES, names, Space(sketch)) for sketch in sketches]
    poses = [_traces(drawing) for drawing in drawings]
    digits = DIGITS - int(np.floor(np.log10(drawings[0].size)))
    paths = _TracePoints()
    for trail in np.array([drawing.trails for drawing in drawings]).swapaxes(0, 1):
        paths.points += [*trail, None]
    for pose in poses if len(poses) > 1 else ():
        pose["mechanism", "line", ROLES.coordinate, 1.2, "solid"] = paths
    keys = dict.fromkeys(key for pose in poses for key in pose)
    figure = go.Figure(layout=_layout(drawings))
    for key in keys:
        _added(figure, key, poses[0].get(key, _TracePoints()), digits)
    moves = [[_axes_of(pose.get(key, _TracePoints()), digits) for key in keys] for pose in poses]
    content = {
        "figure": json.loads(figure.to_json() or "{}"),
        "poses": moves if len(poses) > 1 else [],
        "times": list(times),
        "colors": {"light": LIGHT._asdict(), "dark": DARK._asdict()},
        "scale": {"velocity": scale.speed, "force": scale.force},
    }
    return json.dumps(content, ensure_ascii=False, allow_nan=False).replace("<", "\\u003c")


FILLED = 2.7
"""Diagonal of the axes, in plotly's units, of which the page shows about as many."""


def _triple(x: Array) -> dict[str, float]:
    return dict(zip("xyz", map(float, x), strict=True))


def _limits(drawings: Sequence[Drawing]) -> tuple[Array, Array]:
    """Return the least and the largest coordinates (3,) of axes that hold all poses, m."""
    bounds = np.array([drawing.bounds for drawing in drawings])
    low, high = bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)
    margin = 0.1 * float((high - low).max())
    return low - margin, high + margin


def _layout(drawings: Sequence[Drawing]) -> dict[str, Any]:
    """Return the layout of a figure: the viewpoint of the first, and axes that hold every pose."""
    low, high = _limits(drawings)
    extent = high - low
    hidden = {"visible": False, "showspikes": False}
    axes = {
        f"{name}axis": hidden | {"range": [float(low[k]), float(high[k])]}
        for k, name in enumerate("xyz")
    }
    eye, share = drawings[0].see.towards, FILLED * extent / np.linalg.norm(extent)
    camera = {"projection": {"type": "orthographic"}, "eye": _triple(eye)}
    return {
        "template": go.layout.Template(),
        "showlegend": False,
        "margin": dict.fromkeys("lrtb", 0),
        "scene": {
            **axes,
            "camera": camera,
            "aspectmode": "manual",
            "aspectratio": _triple(share),
            "dragmode": "turntable",
        },
    }


def viewer_script() -> str:
    """Return the source of `viewer.js`, which draws what `viewer_json` returns."""
    return render("viewer.js")


def viewer_style() -> str:
    """Return the style sheet of the elements that `viewer.js` draws into."""
    return render("viewer.css")


def viewer_figure(content: str, caption: str = "", still: str = "") -> str:
    """Return the HTML element of a mechanism.

    Args:
        content: JSON by `viewer_json`.
        caption: text below it.
        still: HTML that is shown where no script runs, or no WebGL.
    """
    return render("viewer.html.j2", content=content, caption=caption, still=still)


def write_viewer(scene: Scene, states: Sequence[ShownState], path: Path) -> None:
    """Write a page with a mechanism that can be turned by hand.

    Raises:
        InputError: the scene has no sketch.
        EngineError: jinja2 is not installed.
    """
    figure = viewer_figure(viewer_json(scene, states), still=picture_html(scene, states[0]))
    page = render(
        "mechanism.html.j2", scene=scene, figure=figure, plotly=plotly_js(), ground=DARK.ground
    )
    write_text(path, page)


def picture_html(scene: Scene, state: ShownState) -> str:
    """Return the picture of a state as HTML with its SVG, for light and for dark pages."""
    return sketch_html(sketch_of(scene, state.q, state.t), scene.coordinate_names, scene.name)


def sketch_html(sketch: s.Sketch, names: Collection[str], title: str) -> str:
    """Return the picture of a sketch as HTML, see `picture_html`.

    Args:
        sketch: the mechanism in a pose.
        names: names of the coordinates.
        title: its content, as plain text.
    """

    def address(dark: bool) -> str:
        file = BytesIO()
        save_figure(scene_figure(sketch, names, dark)[0], file, "svg")
        return f"data:image/svg+xml;base64,{b64encode(file.getvalue()).decode()}"

    return (
        f'<picture><source media="(prefers-color-scheme: dark)" srcset="{address(True)}">'
        f'<img src="{address(False)}" alt="{escape(title)}"></picture>'
    )
