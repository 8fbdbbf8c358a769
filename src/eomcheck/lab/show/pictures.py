"""Pictures of one scene by matplotlib, and their data: poses, motions (GIF), matrix structures.

A pose or a motion becomes a `Sketch`. A `Structure` holds the matrices that a formulation reads and
solves in one state, with their blocks named: the formulation runs on `RecordingFloat` numbers,
whose systems of equations `solve` records, and each block is compared with the matrices it may
equal (M, a, -aᵀ, Wᵀ M W, ...).

`draw_scene` paints a `Drawing` with all names and a legend, `draw_motion` paints every k-th sketch
of a motion as a frame, `draw_structure` shows the nonzero entries of a formulation's matrices and
the names of their blocks. SVG files have a transparent background and reproducible bytes.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextvars import ContextVar
from itertools import accumulate, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from PIL import Image
from scipy.linalg import null_space

from eomcheck.atomic_write import replacing
from eomcheck.errors import InputError
from eomcheck.evaluation.dynamics import assembled_position, consistent_velocity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import Formulation, em
from eomcheck.lab.show.chart_matplotlib import plt, save_picture
from eomcheck.lab.show.sketch_drawing import DARK, LIGHT, Colors, Drawing, place_labels
from eomcheck.mechanics import sketch as s
from eomcheck.mechanics.parameters import with_parameters
from eomcheck.mechanics.scene import Scene
from eomcheck.mechanics.sketch import Sketch
from eomcheck.numbers.generic import Array
from eomcheck.numbers.linear import SOLVERS
from eomcheck.scene_lookup import ROBOTS, scene_class_named, scene_named

if TYPE_CHECKING:
    from eomcheck.motion.simulate import Trajectory

# ---- Poses and motions ---------------------------------------------------------------------------

BETWEEN = 6
"""Number of points of a path from one frame to the next."""


def scene_to_draw(
    name: str, links: int | None = None, given: Mapping[str, Sequence[float] | None] | None = None
) -> tuple[Scene, np.ndarray]:
    """Return the scene called `name`, and the pose q (n,) that figures show.

    Args:
        name: name of the scene.
        links: number of links, for classes with links.
        given: parameters that differ from the default.

    Raises:
        UnknownNameError, InputError: see `eomcheck.scene_lookup.scene_named`.
    """
    if name in ROBOTS:
        scene = scene_named(name, links, given)
        return scene, scene.initial_state()[0]
    scene, q = scene_and_pose(scene_class_named(name), links)
    return with_parameters(scene, given or {}), q


def sketch_of(scene: Scene, q: np.ndarray, t: float = 0.0) -> Sketch:
    """Return the sketch of `scene` in the pose q (n,) at time t, s.

    Raises:
        InputError: the scene has no sketch.
    """
    sketch = scene.sketch(q, t)
    if sketch is None:
        raise InputError(f"{scene.name} does not say what it looks like: it has no `sketch`")
    return sketch


def scene_and_pose(kind: type[Scene], links: int | None = None) -> tuple[Scene, np.ndarray]:
    """Return the example of a scene class and the pose q (n,) that figures show.

    Raises:
        InputError: it has no such number of links.
    """
    if links is not None:
        next(kind.structures(links))  # raises for an impossible number of links
    return kind.sketched(links)


def posed_sketch(scene: Scene, q: np.ndarray) -> tuple[Sketch, tuple[str, ...]]:
    """Return the sketch of a scene in the closed pose next to q (n,), and its coordinates' names.

    Raises:
        InputError: the scene has no sketch.
        RefusedError: there is no such pose.
    """
    return sketch_of(scene, assembled_position(scene, q)), scene.coordinate_names


def sketches_of_motion(
    scene: Scene, formulation: str, end: float, frames: int, u0: Sequence[float] | None = None
) -> tuple[list[Sketch], np.ndarray, int]:
    """Return sketches of a motion at equal time steps, these times, s, and their number per frame.

    The motion starts from the initial state, with the generalized speeds u0 (p,) if they are given.

    Raises:
        InputError: fewer than two frames, an end that is no positive time, no such formulation, or
            a scene without a sketch.
        EomcheckError: the motion does not reach its end.
    """
    motion = motion_to_draw(scene, formulation, end, frames, BETWEEN, u0)
    states = zip(motion.q, motion.times, strict=True)
    return [sketch_of(scene, q, t) for q, t in states], motion.times, BETWEEN


def motion_to_draw(
    scene: Scene,
    formulation: str,
    end: float,
    frames: int,
    per_frame: int = 1,
    u0: Sequence[float] | None = None,
) -> Trajectory:
    """Return a motion from the initial state, or from u0 (p,), at the times of frames.

    Raises:
        InputError: fewer than two frames, an end that is no positive time, or no such formulation.
        EomcheckError: the motion does not reach its end.
    """
    from eomcheck.motion.simulate import simulate

    if frames < 2:
        raise InputError(f"frames = {frames}, expected at least 2")
    times = np.linspace(0.0, end, per_frame * (frames - 1) + 1)
    motion = simulate(scene, formulation, end, output_times=times, u0=u0)
    if motion.status != "finished":
        raise InputError(
            f"the motion of {scene.name} by {formulation} {motion.status}: {motion.reason}"
        )
    return motion


def moving_state(
    scene: Scene, q: np.ndarray, formulation: Formulation
) -> tuple[Scene, Formulation, np.ndarray, np.ndarray]:
    """Return the scene, the formulation, a closed q (n,) and a consistent nonzero v (n,).

    The pose is the closed one next to the q (n,) given; the components of v along a null-space
    basis of the constraints are 1, 1/2, 1/3 ..., so that no entry of a matrix vanishes by chance.
    """
    q = assembled_position(scene, q)
    at = Evaluation(scene, q, np.zeros(scene.n))
    if at.terms.a is None:
        return scene, formulation, q, 1 / np.arange(1.0, scene.n + 1)
    basis = null_space(at.terms.a)
    v = basis @ (1 / np.arange(1.0, basis.shape[1] + 1))
    return scene, formulation, q, consistent_velocity(at, v)


# ---- Matrices of a formulation -------------------------------------------------------------------

SAME = 1e-9
"""Difference, relative to the largest entry, up to which blocks count as equal."""


Known = tuple[str, Array]
"""Name and entries of a matrix that a block may equal."""


Columns = tuple[tuple[str, int], ...]


class Block(NamedTuple):
    """A block of a matrix, with the name of the matrix it equals, "" where none is known."""

    name: str
    rows: slice
    columns: slice


class Matrix(NamedTuple):
    """A matrix (k, l) and its blocks."""

    name: str
    entries: Array
    blocks: tuple[Block, ...]
    columns: Columns
    """Names of the unknowns, each with its number of columns."""


class Structure(NamedTuple):
    """The matrices that a formulation reads and those that it solves, in order."""

    read: tuple[Matrix, ...]
    solved: tuple[Matrix, ...]
    """Matrices solved, without those that are also read."""


# ---- Matrices as they are solved -----------------------------------------------------------------


class RecordingFloat(float):
    """A float64 that keeps its class in object arrays, so that `solve` calls `_solve` for it."""


def _staying(name: str) -> Callable:
    of_floats = getattr(float, name)

    def operation(*numbers: Any) -> Any:
        result = of_floats(*map(float, numbers))
        return RecordingFloat(result)

    return operation


for _name in ("add", "radd", "sub", "rsub", "mul", "rmul", "truediv", "rtruediv", "neg"):
    setattr(RecordingFloat, f"__{_name}__", _staying(f"__{_name}__"))

_solved: ContextVar[list[tuple[str, Array]]] = ContextVar("solved")


def _solve(A: Array, b: Array, name: str) -> Array:
    matrix = A.astype(float)
    _solved.get().append((name, matrix))
    return _as_recording(np.linalg.solve(matrix, b.astype(float)))


SOLVERS[RecordingFloat] = _solve


def _as_recording(x: Any) -> Any:
    """Return a float64 array as one of `RecordingFloat`; others, such as indices, as they are."""
    if isinstance(x, np.ndarray) and x.dtype == float:
        return np.array([RecordingFloat(entry) for entry in x.flat], dtype=object).reshape(x.shape)
    return x


class _RecordingEvaluation(Evaluation):
    """An evaluation in float64 whose formulations run on `RecordingFloat` numbers."""

    def solved_by(self, formulation: Formulation) -> list[tuple[str, Array]]:
        """Return name and entries of each matrix that a formulation solves, in its order."""
        systems: list[tuple[str, Array]] = []
        token = _solved.set(systems)
        try:
            self.rates(formulation)
        finally:
            _solved.reset(token)
        return systems

    def call(self, function: Callable, *arguments: Any) -> Any:
        if _solved.get(None) is None:
            return super().call(function, *arguments)
        return function(*map(_as_recording, arguments))


# ---- Blocks --------------------------------------------------------------------------------------


def structure_of(scene: Scene, formulation: Formulation, q: Array, v: Array) -> Structure:
    """Return the matrices of a formulation in one state of a scene.

    Args:
        scene: the scene.
        formulation: the formulation.
        q: coordinates (n,).
        v: consistent velocities (n,).

    Raises:
        InputError: the formulation does not apply to the scene.
        RefusedError: the scene has no generalized speeds here.
    """
    if not formulation.applies_to(scene):
        raise InputError(f"{formulation.key} does not apply to {scene.name}")
    at = _RecordingEvaluation(scene, q, v)
    read = dict(_read(at, formulation))  # in float64, before numbers are `RecordingFloat`
    known = _known(at, formulation)
    systems = at.solved_by(formulation)
    solved = []
    for k, (name, A) in enumerate(systems):
        columns = _unknowns(at, formulation, len(A), final=k == len(systems) - 1)
        if not any(_equal(A, other) for other in read.values()):
            solved.append(_blocked(name, A, _rows(at, columns), columns, known))
    own = (_blocked(name, A, [len(A)], (("", A.shape[1]),), []) for name, A in read.items())
    return Structure(tuple(own), tuple(solved))


def _read(at: Evaluation, formulation: Formulation) -> Iterator[tuple[str, Array]]:
    if formulation.uses in ("terms", "speeds"):
        yield "M", at.terms.M
    if formulation.uses == "terms" and at.terms.a is not None:
        yield "a", at.terms.a
    if formulation.uses == "speeds" and at.speeds.W is not None:
        yield "W", at.speeds.W
    if formulation.uses == "bodies":
        for name, partial in zip(("∂V/∂u", "∂ω/∂u"), at.bodies[:2], strict=True):
            yield name, partial.reshape(-1, partial.shape[2])
    if formulation.uses == "chain":
        at.chain  # noqa: B018  cached in float64
    at.F  # noqa: B018  likewise


def _known(at: Evaluation, formulation: Formulation) -> list[Known]:
    """Return the matrices that a block may equal, with their names."""
    M, _, _, a, gamma, _ = at.terms
    known = [("I", np.eye(len(M))), ("M", M)]
    if a is not None:
        first = at.partition.dependent
        known += [("a", a), ("-a", -a), ("-aᵀ", -a.T), ("a M⁻¹ aᵀ", a @ np.linalg.solve(M, a.T))]
        known += [("a₁", a[:, first]), ("a′ᵀ", a[:, first].T)]
        if formulation.partitioned:
            w, _ = em.partition_embedding(a, gamma, at.partition)
            known += [("wᵀ M", w.T @ M), ("wᵀ M w", w.T @ M @ w)]
    if formulation.uses == "chain":
        chain = at.chain
        known += [("D", np.diag(part)) for part in chain.mass.reshape(-1, 2)]
        for name, parts in (("A", chain.before), ("C", chain.after)):
            known += [(f"-{name}", -part) for part in parts]
            known += [(f"-{name}ᵀ", -part.T) for part in parts]
    elif formulation.in_speeds and at.speeds.W is not None:
        W = at.speeds.W
        known.append(("Wᵀ M W", W.T @ M @ W))
    return known


def _unknowns(at: Evaluation, formulation: Formulation, size: int, final: bool) -> Columns:
    """Return the unknowns of a system: names and numbers of columns."""
    n, r = at.scene.n, at.scene.r
    if not final:
        return (("", size),)
    if formulation.uses == "chain":
        count = (size + 2) // 4
        return (("ẋ1", 2), *((f"{x}{k}", 2) for k in range(2, count + 1) for x in "ρẋ"))
    times, multipliers = formulation.order[:2]
    if multipliers > 0 and r:
        rates = ("q̇", "v̇") if times == 2 else ("v̇",)
        return (*((name, n) for name in rates), ("λ", r))
    if size == n:
        return (("v̇", n),)
    return (("u̇" if formulation.in_speeds else "v̇₂", size),)


def _rows(at: Evaluation, columns: Columns) -> list[int]:
    """Return the rows of each block of a square matrix: those of the unknowns, or of Eq. (11)."""
    sizes = [size for _, size in columns]
    if sizes == [at.scene.n] and at.scene.r:
        return [at.scene.p, at.scene.r]  # the projected equations of motion, then the constraints
    return sizes


def _blocked(name: str, A: Array, rows: list[int], columns: Columns, known: list[Known]) -> Matrix:
    blocks = []
    for top, bottom in pairwise(accumulate(rows, initial=0)):
        for left, right in pairwise(accumulate((size for name, size in columns), initial=0)):
            part = A[top:bottom, left:right]
            names = (label for label, other in known if _equal(part, other))
            blocks.append(Block(next(names, ""), slice(top, bottom), slice(left, right)))
    return Matrix(name, A, tuple(blocks), columns)


def _equal(A: Array, B: Array) -> bool:
    return A.shape == B.shape and bool(np.abs(A - B).max() <= SAME * np.abs(B).max())


# ---- Axes, strokes and files ---------------------------------------------------------------------

WIDTH = 7.0
"""Width of a picture, in: 700 px."""
MARGIN = 0.09
"""Margin around the drawing, as a share of its larger side."""


def canvas(bounds: np.ndarray, colors: Colors, width: float, below: float = 0.0) -> Any:
    """Return axes that show the points within bounds, m, `width` in wide, with `below` in left free
    under them.
    """
    margin = MARGIN * np.ptp(bounds, axis=0).max()
    low, high = bounds[0] - margin, bounds[1] + margin
    height = width * (high[1] - low[1]) / (high[0] - low[0])
    if height > 0.8 * width:
        wider = (high[1] - low[1]) / 0.8
        middle = (low[0] + high[0]) / 2
        low[0], high[0], height = middle - wider / 2, middle + wider / 2, 0.8 * width
    if height < 0.4 * width:
        taller, middle = 0.4 * (high[0] - low[0]), (low[1] + high[1]) / 2
        low[1], high[1], height = middle - taller / 2, middle + taller / 2, 0.4 * width
    figure = plt.figure(figsize=(width, height + below), dpi=100, facecolor=colors.ground)
    axes = figure.add_axes((0.0, below / (height + below), 1.0, height / (height + below)))
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    axes.set_axis_off()
    return axes


def paint(axes: Any, drawing: Drawing) -> None:
    """Add the strokes and dots of a drawing to axes."""
    for stroke in drawing.strokes:
        x, y = stroke.points.T
        if stroke.fill:
            axes.fill(x, y, color=stroke.fill, alpha=0.12, lw=0)
        axes.plot(
            x, y, color=stroke.color, lw=stroke.width, ls=stroke.style, solid_capstyle="round"
        )
        if stroke.head:
            # The last segment of the line gives the direction of the arrow's head.
            arrow = {"arrowstyle": "-|>", "color": stroke.color, "lw": stroke.width}
            arrow |= {"shrinkA": 0, "shrinkB": 0, "mutation_scale": 12}
            axes.annotate("", stroke.points[-1], stroke.points[-2], arrowprops=arrow)
    for at, color, size, fill in drawing.dots:
        axes.plot(*at, "o", color=color, ms=size, mfc=fill, mew=1.5)


# ---- Mechanisms ----------------------------------------------------------------------------------

LEGEND = {"coordinate": "coordinate", "constraint": "constraint", "axis": "axis of a frame"}


def draw_scene(sketch: s.Sketch, coordinates: Collection[str], path: Path, dark: bool) -> None:
    """Draw a sketch with all names into a file, .svg (transparent), .png or .pdf."""
    figure = scene_figure(sketch, coordinates, dark)[0]
    save_picture(figure, path)


def scene_figure(
    sketch: s.Sketch, coordinates: Collection[str], dark: bool = False
) -> tuple[Any, list[Any]]:
    """Return the figure of a sketch, and the text artists of its labels.

    Angles and distances with the name of a coordinate have the coordinates' color.
    """
    colors = DARK if dark else LIGHT
    drawing = Drawing(sketch, colors, coordinates)
    axes = canvas(drawing.bounds, colors, WIDTH, below=0.35)
    paint(axes, drawing)
    strokes = [stroke.points for stroke in drawing.strokes]
    texts = place_labels(axes, drawing.labels, strokes, colors.faint)
    lines = [
        Line2D([], [], color=getattr(colors, kind), lw=2.5, label=text)
        for kind, text in LEGEND.items()
        if kind in drawing.kinds
    ]
    if "center" in drawing.kinds:
        style = {"ls": "", "marker": "o", "ms": 6, "color": colors.ink}
        lines.append(Line2D([], [], label="centre of mass", **style))
    layout = {"loc": "lower center", "ncols": len(lines), "frameon": False, "fontsize": 11}
    axes.figure.legend(handles=lines, labelcolor=colors.ink, **layout)
    return axes.figure, texts


# ---- Motions -------------------------------------------------------------------------------------


BESIDE_TRAILS = 1.3
"""Width of the ground beside traced points, in radii of the largest disk on it."""


def on_wide_ground(sketches: Sequence[s.Sketch]) -> list[s.Sketch]:
    """Return sketches of a motion whose ground reaches beyond all traced points, if it has one."""
    parts = [part for sketch in sketches for part in sketch.parts]
    trails = [part.at for part in parts if isinstance(part, s.Trail)]
    if not trails or not any(isinstance(part, s.Plane) for part in parts):
        return [*sketches]
    radii = (x.radius for x in parts if isinstance(x, s.Disk))
    beside = BESIDE_TRAILS * max(radii, default=0.0)
    (west, south, _), (east, north, _) = np.min(trails, 0) - beside, np.max(trails, 0) + beside
    corners = (west, south), (east, south), (east, north), (west, north)
    ground = s.Plane([np.array([x, y, 0.0]) for x, y in corners])
    return [
        x._replace(parts=tuple(ground if isinstance(y, s.Plane) else y for y in x.parts))
        for x in sketches
    ]


def draw_motion(
    sketches: Sequence[s.Sketch], times: Sequence[float], path: Path, every: int
) -> None:
    """Draw a motion into a GIF: one frame per `every` sketches, with the paths of traced points."""
    drawings = [Drawing(sketch, LIGHT) for sketch in on_wide_ground(sketches)]
    bounds = np.array([d.bounds for d in drawings])
    extent = np.array([bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)])
    frames: list[Any] = []
    digits = max(0, 2 - int(np.floor(np.log10(times[-1]))))
    for k in range(0, len(drawings), every):
        drawing = drawings[k]
        axes = canvas(extent, LIGHT, 5.6)
        for trail in np.array([e.trails for e in drawings[: k + 1]]).transpose(1, 2, 0):
            axes.plot(*trail, color=LIGHT.coordinate, lw=1.2)
        paint(axes, drawing)
        axes.text(0.02, 0.03, f"t = {times[k]:.{digits}f} s", transform=axes.transAxes, fontsize=12)
        axes.figure.canvas.draw()
        frame = Image.fromarray(np.asarray(axes.figure.canvas.buffer_rgba())[..., :3])
        frames.append(frame.quantize(24, dither=Image.Dither.NONE))
        plt.close(axes.figure)
    look = {"save_all": True, "append_images": frames[1:], "loop": 0, "optimize": True}
    with replacing(path) as beside:
        frames[0].save(beside, format="GIF", duration=[80] * (len(frames) - 1) + [1200], **look)


# ---- Matrices ------------------------------------------------------------------------------------

LARGEST = 0.21
"""Largest side of a matrix entry, in; smaller in large matrices."""
GAP = 3.0
"""Distance between matrices, in entries."""
BESIDE = 38
"""Largest total width, in entries, up to which all matrices stand side by side."""


def draw_structure(structure: Structure, path: Path, dark: bool) -> None:
    """Draw the matrices of a formulation into a file: inputs on the left, systems solved on the
    right.
    """
    save_picture(structure_figure(structure, dark), path)


def structure_figure(structure: Structure, dark: bool = False) -> Any:
    """Return the figure of the matrices of a formulation."""
    colors = DARK if dark else LIGHT
    apart = [[matrix] for matrix in (*structure.read, *structure.solved)]
    columns = [c for c in ([*structure.read], *([m] for m in structure.solved)) if c]
    if sum(matrix.entries.shape[1] + GAP for (matrix,) in apart) + GAP <= BESIDE:
        columns = apart
    across = [max(matrix.entries.shape[1] for matrix in column) for column in columns]
    down = [sum(len(matrix.entries) + GAP for matrix in column) for column in columns]
    wide, high = sum(across) + GAP * (len(across) + 1), max(down) + 1.0
    side = min(LARGEST, WIDTH / wide)
    wide = WIDTH / side
    figure = plt.figure(figsize=(WIDTH, high * side), dpi=100, facecolor=colors.ground)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0.0, wide), ylim=(high, 0.0))
    axes.set_axis_off()
    free = (wide - sum(across)) / (len(columns) + 1)
    starts = accumulate(across, lambda x, size: x + size + free, initial=free)
    for x, column in zip(starts, columns, strict=False):
        y = GAP
        for matrix in column:
            _draw(axes, matrix, x, y, colors, 72 * side)
            y += len(matrix.entries) + GAP
    return figure


def _draw(axes: Any, matrix: Matrix, x: float, y: float, colors: Colors, points: float) -> None:
    """Draw a matrix with its first entry at (x, y); an entry is `points` pt wide."""
    rows, columns = matrix.entries.shape
    palette = dict.fromkeys("MD", colors.coordinate) | dict.fromkeys("aAC", colors.constraint)
    palette["I"] = colors.faint
    for block in matrix.blocks:
        base = block.name.lstrip("-") or matrix.name
        plain = base.rstrip("0123456789ᵀ₁′") if len(base) < 5 else base
        color = palette.get(plain, colors.axis)
        part = matrix.entries[block.rows, block.columns]
        for i, j in np.argwhere(part != 0):
            at = x + block.columns.start + j + 0.06, y + block.rows.start + i + 0.06
            axes.add_patch(Rectangle(at, 0.88, 0.88, color=color, lw=0))
        corner = x + block.columns.start, y + block.rows.start
        if len(matrix.blocks) > 1:
            axes.add_patch(
                Rectangle(corner, *part.shape[::-1], fill=False, ec=colors.faint, lw=0.8)
            )
        name = block.name if part.any() else "0"
        if len(matrix.blocks) > 1 and block.name and part.shape[0] <= 2 < part.shape[1]:
            look = {"color": colors.ink, "fontsize": 12, "ha": "left", "va": "center"}
            axes.text(x + columns + 0.3, corner[1] + part.shape[0] / 2, name, **look)
        elif len(matrix.blocks) > 1 and min(part.shape) > 2:
            middle = corner[0] + part.shape[1] / 2, corner[1] + part.shape[0] / 2
            box = {"boxstyle": "round,pad=0.2", "fc": colors.ground, "ec": "none", "alpha": 0.85}
            size = 15 if name != "0" else 12
            look = {"color": colors.ink, "fontsize": size, "ha": "center", "va": "center"}
            axes.text(*middle, name, bbox=box if name != "0" else None, **look)
    axes.add_patch(Rectangle((x, y), columns, rows, fill=False, ec=colors.ink, lw=1.2))
    named = [name for name, _ in matrix.columns if name]
    look = {"color": colors.ink, "ha": "center", "va": "bottom"}
    if named:
        start = x
        for name, size in matrix.columns:
            letters = min(13.0, 0.55 * points * size)
            axes.text(start + size / 2, y - 0.15, name, fontsize=letters, **look)
            start += size
    above = y - 0.25 - (16.0 / points if named else 0.0)
    title = f"{_title(matrix)}   {rows} × {columns}"
    axes.text(x + columns / 2, above, title, fontsize=12, **look)


def _title(matrix: Matrix) -> str:
    """Return the title of a matrix: its name, its only block, or an equation of both."""
    base, _, index = matrix.name.partition("_")
    name = rf"$\mathrm{{{base}}}_\mathrm{{{index}}}$" if index.isalnum() else matrix.name
    whole = matrix.blocks[0].name if len(matrix.blocks) == 1 else ""
    return f"{name} = {whole}" if whole and index.isalpha() else whole or name
