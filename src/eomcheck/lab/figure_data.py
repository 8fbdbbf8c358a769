"""Data of the figures of one scene: its pose, its motion, and the matrices of a formulation.

A pose or a motion becomes a `Sketch`. A `Structure` holds the matrices that a formulation reads and
solves in one state, with their blocks named: the formulation runs on `RecordingFloat` numbers,
whose systems of equations `solve` records, and each block is compared with the matrices it may
equal (M, a, -aᵀ, Wᵀ M W, ...).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextvars import ContextVar
from itertools import accumulate, pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import null_space

from eomcheck.errors import InputError
from eomcheck.evaluation.dynamics import assembled_position, consistent_velocity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import Formulation, em
from eomcheck.mechanics.parameters import with_parameters
from eomcheck.mechanics.scene import Scene
from eomcheck.mechanics.sketch import Sketch
from eomcheck.numbers.generic import Array
from eomcheck.numbers.linear import SOLVERS
from eomcheck.scene_lookup import ROBOTS, scene_class_named, scene_named

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
    scene: Scene, formulation: str, end: float, frames: int
) -> tuple[list[Sketch], np.ndarray, int]:
    """Return sketches of a motion at equal time steps, these times, s, and their number per frame.

    The motion starts from the initial state.

    Raises:
        InputError: fewer than two frames, an end that is no positive time, no such formulation, or
            a scene without a sketch.
        EomcheckError: the motion does not reach its end.
    """
    from eomcheck.motion.simulate import simulate

    if frames < 2:
        raise InputError(f"frames = {frames}, expected at least 2")
    times = np.linspace(0.0, end, BETWEEN * (frames - 1) + 1)
    motion = simulate(scene, formulation, end, output_times=times)
    if motion.status != "finished":
        raise InputError(
            f"the motion of {scene.name} by {formulation} {motion.status}: {motion.reason}"
        )
    return [sketch_of(scene, q, t) for q, t in zip(motion.q, times, strict=True)], times, BETWEEN


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
