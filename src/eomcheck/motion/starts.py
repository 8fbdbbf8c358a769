"""Initial state vectors of many motions, in lanes; one by one only where a start is in doubt.

A start is in doubt where a velocity keeps the constraints hardly, or where the digits of one that
generalized speeds give may be lost: where moving all that it is made of moves it too far; and where
constraints nearly depend on each other, or on the independent velocities alone. Such a start is
then checked as that of a single motion is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from eomcheck.errors import EomcheckError, InputError, named
from eomcheck.evaluation.point import Quantities
from eomcheck.evaluation.tolerance import NOTICEABLE, allowed_error
from eomcheck.formulations import Formulation
from eomcheck.kernels.kernel import Kernel
from eomcheck.mechanics.parameters import settable
from eomcheck.mechanics.scene import Scene, finite_array
from eomcheck.motion.crossing import solves_partition
from eomcheck.motion.motion import Motion
from eomcheck.motion.simulate import initial
from eomcheck.motion.state import number_of_speeds, state_size
from eomcheck.motion.trace import Traced, parameter_arrays, quantities_on, traced_kernel
from eomcheck.numbers.contract import Array
from eomcheck.numbers.entries import each
from eomcheck.numbers.float64 import FLOAT64
from eomcheck.numbers.noise import SAMPLES, STEP, Noise
from eomcheck.numbers.pivots import EPS
from eomcheck.numbers.tape import Tape

MARGIN = 100.0
"""Of digits lost, for numbers are moved where they come in only."""


class Start(NamedTuple):
    """What a motion starts from: coordinates (n,), and velocities (n,) or speeds (p,)."""

    scene: Scene
    q: Array
    speeds: Array


def starts_of(scene: Scene, q0, v0, u0, parameters: dict[str, Any]) -> list[Start]:
    """Return what motions start from; see `simulate_many`.

    Raises:
        InputError: what is given is not valid, or nothing tells how many motions there are.
        UnknownNameError: the scene has no such parameter.
    """
    if v0 is not None and u0 is not None:
        raise InputError("v0 and u0 are both given, expected at most one of them")
    known = settable(scene)
    for name in parameters:
        named("parameter", name, known)
    given = {"q0": q0, "v0": v0, "u0": u0, **parameters}
    shapes = {name: _shape(name, x) for name, x in given.items() if x is not None}
    if not shapes:
        raise InputError("none of q0, v0, u0 and parameters tells how many motions there are")
    (first, (m, *_)), *others = shapes.items()
    for name, shape in others:
        if shape[0] != m:
            raise InputError(f"{name} is given for {shape[0]} motions, {first} for {m}")
    values = {name: finite_array(name, x, shapes[name]) for name, x in parameters.items()}
    scenes = [_scene(scene, values, i) for i in range(m)] if values else [scene] * m
    q, v = (np.array(x) for x in zip(*(one.initial_state() for one in scenes), strict=True))
    if q0 is not None:
        q, v = finite_array("q0", q0, q.shape), np.zeros_like(q)
    if u0 is not None:
        v = finite_array("u0", u0, (m, scene.p))
    elif v0 is not None:
        v = finite_array("v0", v0, v.shape)
    return [Start(*one) for one in zip(scenes, q, v, strict=True)]


def _shape(name: str, x: Any) -> tuple[int, ...]:
    try:
        shape = np.shape(x)
    except ValueError:  # lists of different lengths
        shape = ()
    if not shape or shape[0] == 0:
        raise InputError(f"{name} = {x!r}, expected an array with an entry for each motion")
    return shape


def _scene(scene: Any, values: dict[str, Array], i: int) -> Scene:
    """Return the scene of motion i."""
    try:
        other = replace(scene, **{name: x[i] for name, x in values.items()})
    except InputError as error:
        raise InputError(f"motion {i}: {error}") from None
    shapes = [{k: x.shape for k, x in parameter_arrays(s).items()} for s in (scene, other)]
    if shapes[0] != shapes[1] or (other.n, other.r) != (scene.n, scene.r):
        raise InputError(f"motion {i}: {other.structure} has other terms or sizes than the scene")
    return other


def starts_on(scene: Scene, formulation: Formulation, by_speeds: bool) -> Traced:
    """Put on a tape what follows from (q, u) `by_speeds`, or (q, v).

    Its outputs are `v` (n,), the `speeds` of the state vector, and, where there are constraints,
    a v + b as `residual` (r,), |a| |v| + |b| as `size` (r,), and what is solved of a as `solved`
    (`_solved`).
    """
    tape, n = Tape(), scene.n
    y = tape.inputs("y", (n + (scene.p if by_speeds else n),))
    at = quantities_on(tape, scene, y[:n])
    if by_speeds:
        at.u = y[n:]
    else:
        at.v = y[n:]
    speeds = at.speeds_read(formulation)
    if formulation.state == "q, v2":
        speeds = speeds[at.partition.independent]
    found = {"v": at.v, "speeds": speeds}
    if scene.r > 0:
        a, b = scene.constraints(at.parameters, at.prepared, at.q)
        parts = [a * at.v] if b is None else [a * at.v, b[:, None]]
        terms = np.concatenate([tape.numbers(part) for part in parts], axis=1)
        found["residual"] = terms.sum(axis=1)
        found["size"] = each(lambda x: (x * x).sqrt(), terms).sum(axis=1)
        found["solved"] = a[:, _solved(at, formulation)].ravel()
    outputs = {name: [tape.number(x).place for x in values] for name, values in found.items()}
    return Traced(tape, at, y, outputs)


def _solved(at: Quantities, formulation: Formulation) -> Array:
    """Return the columns of a without which no start is in doubt: where they are dependent."""
    if formulation.linear or formulation.redundant:
        return np.empty(0, int)
    if solves_partition(at.scene, formulation):
        return at.partition.dependent
    return np.arange(at.scene.n)


def lanes_of(count: int, width: int) -> list[Array]:
    """Return the numbers (width,) of motions, group by group; the last one fills its group."""
    groups = range(0, count, width)
    return [np.minimum(np.arange(first, first + width), count - 1) for first in groups]


def in_lanes(scenes: Sequence[Scene]) -> dict[str, Array]:
    """Return the parameters of scenes (size, lanes), by name; (size, 1) if all are one scene."""
    one = all(scene is scenes[0] for scene in scenes)
    arrays = [parameter_arrays(scene) for scene in (scenes[:1] if one else scenes)]
    return {name: np.array([np.ravel(x[name]) for x in arrays]).T for name in arrays[0]}


def state_vectors(
    starts: Sequence[Start], by_speeds: bool, formulation: Formulation, width: int
) -> tuple[Array, list[str]]:
    """Return the initial state vectors (m, size), NaN where refused, and why (m,), "" if not.

    Args:
        starts: of scenes with the same terms and sizes.
        by_speeds: whether they have generalized speeds, not velocities.
        formulation: the formulation.
        width: lanes.
    """
    scene = starts[0].scene
    outputs = {"v": scene.n, "speeds": number_of_speeds(scene, formulation)}
    if scene.r > 0:
        columns = len(_solved(Quantities(scene, FLOAT64, starts[0].q), formulation))
        outputs |= {"residual": scene.r, "size": scene.r, "solved": scene.r * columns}
    kernel = traced_kernel(starts_on, scene, formulation, outputs, width, by_speeds=by_speeds)
    out = np.zeros((len(starts), state_size(scene, formulation)))
    reasons = [""] * len(starts)
    given = np.array([np.concatenate((one.q, one.speeds)) for one in starts])
    out[:, : scene.n] = given[:, : scene.n]
    for lanes in lanes_of(len(starts), width):
        parameters = in_lanes([starts[i].scene for i in lanes])
        speeds, sound = _examined(kernel, parameters, given[lanes].T, by_speeds)
        for speed, fine, i in zip(speeds.T, sound, lanes, strict=True):
            scene, q, asked = starts[i]
            out[i, scene.n : scene.n + len(speed)] = speed
            try:
                if by_speeds or formulation.in_speeds:
                    scene.refuse_speeds(q)
                if not fine:
                    both = (None, asked) if by_speeds else (asked, None)
                    motion = Motion(scene, formulation, *initial(scene, q, *both))
                    out[i] = motion.y0
                    if (here := motion.evaluation(motion.y0, 0.0)) is not None:
                        here.acceleration(formulation)
            except EomcheckError as error:
                out[i], reasons[i] = np.nan, str(error)
    return out, reasons


def _examined(
    kernel: Kernel, parameters: dict[str, Array], y: Array, by_speeds: bool
) -> tuple[Array, Array]:
    """Return the speeds (_, lanes) of state vectors, and which of them (lanes,) are in no doubt."""

    def at(parameters: dict[str, Array], y: Array) -> dict[str, Array]:
        found = kernel.rows(kernel.block(parameters), np.zeros((1, kernel.width)), y[None])
        return {name: x[0] for name, x in found.items()}

    with np.errstate(all="ignore"):
        here = at(parameters, y)
        v, speeds = here["v"], here["speeds"]
        sound = np.isfinite(np.concatenate((v, speeds))).all(axis=0)
        if "size" in here:
            allowed = allowed_error(1.0) * here["size"]
            sound = sound & (np.abs(here["residual"]) <= allowed / 4).all(axis=0)
            sound = sound & _independent(here["solved"].T.reshape(kernel.width, len(allowed), -1))
        size = np.abs(v).max(axis=0)
        for seed in range(SAMPLES if by_speeds and size.any() else 0):
            noise = Noise(seed)
            moved = {name: x + x * noise.changes((len(x), 1)) for name, x in parameters.items()}
            there = at(moved, y + y * noise.changes((len(y), 1)))["v"]
            spread = size + np.abs(there - v).max(axis=0) / STEP
            sound = sound & (MARGIN * allowed_error(1.0) * spread <= NOTICEABLE * size)
    return speeds, np.asarray(sound)


def _independent(a: Array) -> Array:
    """Return of which matrices (lanes, r, columns) the rows are independent beyond doubt.

    Columns are not scaled: from one that is small follow velocities that are large, and what they
    are projected on is singular in its turn.
    """
    lanes, r, columns = a.shape
    if columns == 0:
        return np.ones(lanes, bool)
    with np.errstate(all="ignore"):
        a = a / np.abs(a).max(axis=2, keepdims=True)
    usable = np.asarray(np.isfinite(a).all(axis=(1, 2)))
    values = np.linalg.svd(np.where(usable[:, None, None], a, 0.0), compute_uv=False)
    return usable & (values[:, -1] > MARGIN * r * EPS * values[:, 0])
