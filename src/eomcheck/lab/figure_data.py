"""Data of the figures of one scene: its pose, its motion, and the matrices of a formulation.

A pose or a motion becomes a `Sketch`. A `Structure` holds the matrices that a formulation reads and
solves in one state, with their blocks named: the formulation runs on floats of a class of their
own, which `solve` recognizes and records, and each block is compared with the matrices it may equal
(M, a, -aᵀ, Wᵀ M W, ...).
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
"""Points of a path from one frame to the next."""


def scene_to_draw(
    name: str, links: int | None = None, given: Mapping[str, Sequence[float] | None] | None = None
) -> tuple[Scene, np.ndarray]:
    """Return the scene that is called `name`, and the pose q (n,) that pictures show.

    Args:
        name: its name.
        links: number of links, for kinds that have one.
        given: parameters that are other than usual.

    Raises:
        UnknownNameError, InputError: see `eomcheck.scene_lookup.scene_named`.
    """
    if name in ROBOTS:
        scene = scene_named(name, links, given)
        return scene, scene.initial_state()[0]
    scene, q = scene_and_pose(scene_class_named(name), links)
    return with_parameters(scene, given or {}), q


def sketch_of(scene: Scene, q: np.ndarray, t: float = 0.0) -> Sketch:
    """Return what a picture of `scene` in the pose q (n,) is made of.

    Raises:
        InputError: the scene does not say.
    """
    sketch = scene.sketch(q, t)
    if sketch is None:
        raise InputError(f"{scene.name} does not say what it looks like: it has no `sketch`")
    return sketch


def scene_and_pose(kind: type[Scene], links: int | None = None) -> tuple[Scene, np.ndarray]:
    """Return the scene of a kind and the pose q (n,) that pictures show.

    Raises:
        InputError: it has no such number of links.
    """
    if links is not None:
        next(kind.structures(links))  # refuses a number of links that there cannot be
    return kind.sketched(links)


def posed_sketch(scene: Scene, q: np.ndarray) -> tuple[Sketch, tuple[str, ...]]:
    """Return the sketch of a scene in the closed pose next to q (n,), and its coordinates' names.

    Raises:
        InputError: it does not say what it looks like.
        RefusedError: there is no such pose.
    """
    return sketch_of(scene, assembled_position(scene, q)), scene.coordinate_names


def sketches_of_motion(
    scene: Scene, formulation: str, end: float, frames: int
) -> tuple[list[Sketch], np.ndarray, int]:
    """Return sketches of a motion at equal times, these times, s, and how many make a frame.

    It starts from the initial state.

    Raises:
        InputError: fewer than two frames, an end that is no positive time, no such formulation, or
            a scene that does not say what it looks like.
        EomcheckError: the motion does not come to its end.
    """
    from eomcheck.motion.simulate import simulate

    if frames < 2:
        raise InputError(f"frames = {frames}, expected at least 2")
    times = np.linspace(0.0, end, BETWEEN * (frames - 1) + 1)
    found = simulate(scene, formulation, end, output_times=times)
    if found.status != "finished":
        raise InputError(
            f"the motion of {scene.name} by {formulation} {found.status}: {found.reason}"
        )
    return [sketch_of(scene, q, t) for q, t in zip(found.q, times, strict=True)], times, BETWEEN


def moving_state(
    scene: Scene, q: np.ndarray, formulation: Formulation
) -> tuple[Scene, Formulation, np.ndarray, np.ndarray]:
    """Return a scene in motion: it, the formulation, q (n,) and a consistent v (n,).

    In the closed pose next to q (n,); the components of v along a basis of what the constraints
    allow are 1, 1/2, 1/3 ..., so that no entry vanishes by chance of the state.
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
"""Blocks are the same that differ by less than this, relative to their largest entry."""


Known = tuple[str, Array]
"""Something that a block may be, and its name."""


Columns = tuple[tuple[str, int], ...]


class Block(NamedTuple):
    """A part of a matrix, and what it is: "" where nothing is known that it equals."""

    name: str
    rows: slice
    columns: slice


class Matrix(NamedTuple):
    """A matrix (k, l), and the blocks that it is made of."""

    name: str
    entries: Array
    blocks: tuple[Block, ...]
    columns: Columns
    """Unknowns: their names, and how many columns they have."""


class Structure(NamedTuple):
    """What a formulation reads, and what it solves, in this order."""

    read: tuple[Matrix, ...]
    solved: tuple[Matrix, ...]
    """Without those that are read already."""


# ---- Matrices as they are solved -----------------------------------------------------------------


class RecordingFloat(float):
    """A double that remains one in arrays of objects, so that `solve` asks here."""


def _staying(name: str) -> Callable:
    of_floats = getattr(float, name)

    def operation(*numbers: Any) -> Any:
        found = of_floats(*map(float, numbers))
        return RecordingFloat(found)

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
    """Return arrays of doubles as arrays of such numbers; all else, such as indices, as it is."""
    if isinstance(x, np.ndarray) and x.dtype == float:
        return np.array([RecordingFloat(entry) for entry in x.flat], dtype=object).reshape(x.shape)
    return x


class _RecordingEvaluation(Evaluation):
    """Quantities in doubles; formulations run on numbers whose matrices are seen."""

    def solved_by(self, formulation: Formulation) -> list[tuple[str, Array]]:
        """Return name and entries of each matrix that a formulation solves, in its order."""
        found: list[tuple[str, Array]] = []
        token = _solved.set(found)
        try:
            self.rates(formulation)
        finally:
            _solved.reset(token)
        return found

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
    read = dict(_read(at, formulation))  # in doubles, before numbers change
    known = _known(at, formulation)
    found = at.solved_by(formulation)
    solved = []
    for k, (name, A) in enumerate(found):
        columns = _unknowns(at, formulation, len(A), final=k == len(found) - 1)
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
        at.chain  # noqa: B018  is found in doubles
    at.F  # noqa: B018  likewise


def _known(at: Evaluation, formulation: Formulation) -> list[Known]:
    """Return what a block may equal."""
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
    """Return the unknowns of a system: their names and how many they are."""
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
    """Return the heights of the blocks of a square matrix: as the unknowns, or as Eq. (11)."""
    sizes = [size for _, size in columns]
    if sizes == [at.scene.n] and at.scene.r:
        return [at.scene.p, at.scene.r]  # what is left of the motion, then the constraints
    return sizes


def _blocked(name: str, A: Array, rows: list[int], columns: Columns, known: list[Known]) -> Matrix:
    blocks = []
    for top, bottom in pairwise(accumulate(rows, initial=0)):
        for left, right in pairwise(accumulate((size for name, size in columns), initial=0)):
            part = A[top:bottom, left:right]
            same = (said for said, other in known if _equal(part, other))
            blocks.append(Block(next(same, ""), slice(top, bottom), slice(left, right)))
    return Matrix(name, A, tuple(blocks), columns)


def _equal(A: Array, B: Array) -> bool:
    return A.shape == B.shape and bool(np.abs(A - B).max() <= SAME * np.abs(B).max())
