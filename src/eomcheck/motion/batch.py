"""Batches of motions: `simulate_many` integrates motions of one scene class in SIMD lanes.

Each motion has one lane of a SIMD vector, and its own step sizes (`eomcheck.kernels.dop853`).

Initial state vectors are computed and checked in lanes too; one by one only if a start is in
doubt. It is in doubt if a velocity hardly satisfies the constraints, if the digits of a velocity
computed from generalized speeds may be lost (perturbing its inputs changes it too much), or if
constraints nearly depend on each other, or on the independent velocities alone. Such a start is
then checked in the same way as that of a single motion.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from eomcheck.console import progress
from eomcheck.errors import EomcheckError, InputError, RefusedError, registered
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.evaluation.tolerance import NOTICEABLE, allowed_error
from eomcheck.formulations import Formulation, formulation_for
from eomcheck.formulations.formulation import Choice
from eomcheck.kernels import dop853
from eomcheck.kernels.kernel import Kernel
from eomcheck.kernels.llvm import aligned_zeros
from eomcheck.mechanics.parameters import settable
from eomcheck.mechanics.scene import Scene, checked_scene, finite_array
from eomcheck.motion.integrators import MOST_STEPS
from eomcheck.motion.observables import (
    crossing_refusal,
    observer_of,
    singular_crossings,
    solves_partition,
)
from eomcheck.motion.right_hand_side import (
    Traced,
    choice_for,
    kernel_of,
    number_of_speeds,
    parameter_arrays,
    quantities_on,
    state_size,
    traced_kernel,
)
from eomcheck.motion.simulate import (
    Motion,
    Trajectory,
    check_options,
    checked_times,
    initial_values,
)
from eomcheck.numbers.generic import EPS, FLOAT64, Array, map_entries
from eomcheck.numbers.noise import SAMPLES, STEP, Noise
from eomcheck.numbers.tape import Tape
from eomcheck.safe_output import counted

# ---- Initial states ------------------------------------------------------------------------------

MARGIN = 100.0
"""Safety factor of lost digits, because only the inputs are perturbed."""


class Start(NamedTuple):
    """Initial values of a motion: coordinates (n,), and velocities (n,) or speeds (p,)."""

    scene: Scene
    q: Array
    speeds: Array


def starts_of(scene: Scene, q0, v0, u0, parameters: dict[str, Any]) -> list[Start]:
    """Return the initial values of all motions; see `simulate_many`.

    Raises:
        InputError: the values are not valid, or none of them determines the number of motions.
        UnknownNameError: the scene has no such parameter.
    """
    if v0 is not None and u0 is not None:
        raise InputError("v0 and u0 are both given, expected at most one of them")
    known = settable(scene)
    for name in parameters:
        registered("parameter", name, known)
    inputs = {"q0": q0, "v0": v0, "u0": u0, **parameters}
    shapes = {name: _shape(name, x) for name, x in inputs.items() if x is not None}
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
    except ValueError:  # nested lists of different lengths
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


def trace_starts(scene: Scene, formulation: Formulation, by_speeds: bool) -> Traced:
    """Trace the start of a motion from (q, u) if `by_speeds`, or (q, v).

    Outputs of the trace are `v` (n,), the `speeds` of the state vector, and, with constraints,
    a v + b as `residual` (r,), |a| |v| + |b| as `size` (r,), and the solved columns of a as
    `solved` (`_solved`).
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
    traced = {"v": at.v, "speeds": speeds}
    if scene.r > 0:
        a, b = scene.constraints(at.parameters, at.prepared, at.q)
        parts = [a * at.v] if b is None else [a * at.v, b[:, None]]
        terms = np.concatenate([tape.numbers(part) for part in parts], axis=1)
        traced["residual"] = terms.sum(axis=1)
        traced["size"] = map_entries(lambda x: (x * x).sqrt(), terms).sum(axis=1)
        traced["solved"] = a[:, _solved(at, formulation)].ravel()
    outputs = {name: [tape.number(x).index for x in values] for name, values in traced.items()}
    return Traced(tape, at, y, outputs)


def _solved(at: Quantities, formulation: Formulation) -> Array:
    """Return the indices of the columns of a that must be independent for a start beyond doubt."""
    if formulation.linear or formulation.redundant:
        return np.empty(0, int)
    if solves_partition(at.scene, formulation):
        return at.partition.dependent
    return np.arange(at.scene.n)


def lane_groups(count: int, width: int) -> list[Array]:
    """Return the indices (width,) of motions, group by group; the last group is padded."""
    groups = range(0, count, width)
    return [np.minimum(np.arange(first, first + width), count - 1) for first in groups]


def lane_parameters(scenes: Sequence[Scene]) -> dict[str, Array]:
    """Return the parameters of scenes (size, lanes), by name; (size, 1) if all are one scene."""
    one = all(scene is scenes[0] for scene in scenes)
    arrays = [parameter_arrays(scene) for scene in (scenes[:1] if one else scenes)]
    return {name: np.array([np.ravel(x[name]) for x in arrays]).T for name in arrays[0]}


def state_vectors(
    starts: Sequence[Start], by_speeds: bool, formulation: Formulation, width: int
) -> tuple[Array, list[str]]:
    """Return the initial state vectors (m, size), NaN if refused, and the reasons (m,), "" if not.

    Args:
        starts: initial values of scenes with the same terms and sizes.
        by_speeds: whether they have generalized speeds instead of velocities.
        formulation: the formulation.
        width: number of SIMD lanes.
    """
    scene = starts[0].scene
    outputs = {"v": scene.n, "speeds": number_of_speeds(scene, formulation)}
    if scene.r > 0:
        columns = len(_solved(Quantities(scene, FLOAT64, starts[0].q), formulation))
        outputs |= {"residual": scene.r, "size": scene.r, "solved": scene.r * columns}
    kernel = traced_kernel(trace_starts, scene, formulation, outputs, width, by_speeds=by_speeds)
    out = np.zeros((len(starts), state_size(scene, formulation)))
    reasons = [""] * len(starts)
    initial = np.array([np.concatenate((one.q, one.speeds)) for one in starts])
    out[:, : scene.n] = initial[:, : scene.n]
    for lanes in lane_groups(len(starts), width):
        parameters = lane_parameters([starts[i].scene for i in lanes])
        speeds, sound = _checked_speeds(kernel, parameters, initial[lanes].T, by_speeds)
        for speed, fine, i in zip(speeds.T, sound, lanes, strict=True):
            scene, q, velocities = starts[i]
            out[i, scene.n : scene.n + len(speed)] = speed
            try:
                if by_speeds or formulation.in_speeds:
                    scene.refuse_speeds(q)
                if not fine:
                    both = (None, velocities) if by_speeds else (velocities, None)
                    motion = Motion(scene, formulation, *initial_values(scene, q, *both))
                    out[i] = motion.y0
                    if (at := motion.evaluation(motion.y0, 0.0)) is not None:
                        at.acceleration(formulation)
            except EomcheckError as error:
                out[i], reasons[i] = np.nan, str(error)
    return out, reasons


def _checked_speeds(
    kernel: Kernel, parameters: dict[str, Array], y: Array, by_speeds: bool
) -> tuple[Array, Array]:
    """Return the speeds (_, lanes) of state vectors, and a mask (lanes,) of those beyond doubt."""

    def at(parameters: dict[str, Array], y: Array) -> dict[str, Array]:
        outputs = kernel.rows(kernel.block(parameters), np.zeros((1, kernel.width)), y[None])
        return {name: x[0] for name, x in outputs.items()}

    with np.errstate(all="ignore"):
        exact = at(parameters, y)
        v, speeds = exact["v"], exact["speeds"]
        sound = np.isfinite(np.concatenate((v, speeds))).all(axis=0)
        if "size" in exact:
            allowed = allowed_error(1.0) * exact["size"]
            sound = sound & (np.abs(exact["residual"]) <= allowed / 4).all(axis=0)
            sound = sound & _independent(exact["solved"].T.reshape(kernel.width, len(allowed), -1))
        size = np.abs(v).max(axis=0)
        for seed in range(SAMPLES if by_speeds and size.any() else 0):
            noise = Noise(seed)
            perturbed = {name: x + x * noise.changes((len(x), 1)) for name, x in parameters.items()}
            perturbed_v = at(perturbed, y + y * noise.changes((len(y), 1)))["v"]
            spread = size + np.abs(perturbed_v - v).max(axis=0) / STEP
            sound = sound & (MARGIN * allowed_error(1.0) * spread <= NOTICEABLE * size)
    return speeds, np.asarray(sound)


def _independent(a: Array) -> Array:
    """Return a mask (lanes,) of the matrices (lanes, r, columns) with clearly independent rows.

    Columns are not scaled: a small column makes large velocities, and the matrix onto which they
    are projected is singular in its turn.
    """
    lanes, r, columns = a.shape
    if columns == 0:
        return np.ones(lanes, bool)
    with np.errstate(all="ignore"):
        a = a / np.abs(a).max(axis=2, keepdims=True)
    usable = np.asarray(np.isfinite(a).all(axis=(1, 2)))
    values = np.linalg.svd(np.where(usable[:, None, None], a, 0.0), compute_uv=False)
    return usable & (values[:, -1] > MARGIN * r * EPS * values[:, 0])


# ---- Trajectories --------------------------------------------------------------------------------

OUTPUTS = 101
"""Default number of output times."""

GROUPS = 8
"""Groups of lanes in one task of an executor."""
PIECES = 32
"""Least number of tasks for an executor, if there are so many groups."""


@dataclass(frozen=True)
class Trajectories:
    """A batch of m trajectories by one formulation and DOP853, at k times.

    Entries that a motion did not reach are NaN, all of them if it was refused.

    Attributes:
        scenes: the scene of each motion (m,).
        key: the formulation.
        rtol: relative tolerance.
        atol: absolute tolerance.
        t: times (k,), s.
        q: coordinates (m, k, n).
        v: velocities (m, k, n).
        u: generalized speeds (m, k, p).
        energy: T + U (m, k), J.
        constraint_residual: |a v + b| (m, k, r), m/s, or None without constraints.
        right_hand_sides: right-hand sides evaluated (m,).
        steps: steps taken (m,).
        status: "finished", "failed" if the end was not reached, or "refused" at the start (m,).
        reason: reason why it was not finished (m,), "" if it was.
        seconds: time of the integration of all, s, summed over processes.
    """

    scenes: tuple[Scene, ...]
    key: str
    rtol: float
    atol: float
    t: Array
    q: Array
    v: Array
    u: Array
    energy: Array
    constraint_residual: Array | None
    right_hand_sides: Array
    steps: Array
    status: Array
    reason: Array
    seconds: float

    def __len__(self) -> int:
        return len(self.scenes)

    def __getitem__(self, i: int) -> Trajectory:
        """Return the trajectory of motion i up to its last state.

        Its `seconds` are an equal share of the total; its multipliers are None.
        """
        kept = np.isfinite(self.q[i]).all(axis=1)
        residual = self.constraint_residual
        return Trajectory(
            self.scenes[i],
            self.key,
            "DOP853",
            self.rtol,
            self.atol,
            self.t[kept],
            self.q[i, kept],
            self.v[i, kept],
            None,
            self.energy[i, kept],
            None if residual is None else residual[i, kept],
            int(self.right_hand_sides[i]),
            int(self.steps[i]),
            "finished" if self.status[i] == "finished" else "failed",
            str(self.reason[i]),
            self.seconds / len(self),
        )


def simulate_many(
    scene: Scene,
    key: str,
    t_end: float,
    *,
    q0=None,
    u0=None,
    v0=None,
    parameters: Mapping[str, Any] | None = None,
    rtol: float = 1e-9,
    atol: float = 1e-9,
    output_times=None,
    max_steps: int = MOST_STEPS,
    executor: Any = None,
    lanes: int = 8,
) -> Trajectories:
    """Integrate m motions of `scene` from t = 0 to `t_end` by DOP853, several at a time.

    Each motion has its own step sizes and error estimates. Its results are bitwise identical for
    every m, `lanes` and executor. A start where constraints nearly depend on each other is refused
    as by `simulate`; later no condition number is checked: a matrix that is singular to rounding
    goes unnoticed. A pose that a partition cannot cross is detected if it is crossed once between
    two output times.

    Args:
        scene: the scene.
        key: the formulation, a key of `eomcheck.FORMULATIONS`.
        t_end: end, s.
        q0: initial coordinates (m, n), by default the scene's own state.
        u0: initial generalized speeds (m, p), or
        v0: initial velocities (m, n); by default the scene's own, at rest if q0 is given.
        parameters: arguments of the scene by name that differ between motions: arrays whose
            first axis is m. At least one of q0, u0, v0 and these is given.
        rtol: relative tolerance of a step.
        atol: absolute tolerance of a step, SI units.
        output_times: times (k,) in [0, t_end] of the output, rising; by default 101 equally
            spaced ones from 0 to t_end.
        max_steps: give up after so many steps; 0 for no limit.
        executor: runs the tasks in parallel: a `concurrent.futures.Executor`, a dask client, any
            object with a `submit`. By default they run in this process.
        lanes: number of motions in one SIMD vector: 1, 2, 4 or 8.

    Returns:
        The trajectories. A motion that cannot start or continue has a `status` and a `reason`.

    Raises:
        InputError: values that are not valid, a formulation that does not apply to the scene.
        UnknownNameError: no such formulation or parameter.
    """
    formulation = formulation_for(checked_scene(scene), key)
    check_options(max_steps, t_end=t_end, rtol=rtol, atol=atol)
    if lanes not in (1, 2, 4, 8):
        raise InputError(f"lanes = {lanes!r}, expected 1, 2, 4 or 8")
    if not (executor is None or hasattr(executor, "submit")):
        raise InputError(f"executor = {executor!r}, expected one that has a method submit")
    times = np.linspace(0.0, t_end, OUTPUTS) if output_times is None else output_times
    times = checked_times(times, t_end)
    starts = starts_of(scene, q0, v0, u0, dict(parameters or {}))
    options = _Options(formulation.key, u0 is not None, t_end, rtol, atol, times, max_steps, lanes)
    size = lanes * GROUPS
    if executor is not None:
        size = lanes * max(1, min(GROUPS, len(starts) // (PIECES * lanes)))
    pieces = [starts[first : first + size] for first in range(0, len(starts), size)]
    work = partial(_integrated, options)
    submitted = None if executor is None else [executor.submit(work, piece) for piece in pieces]
    results = []
    with progress(
        f"integrating {counted(len(starts), 'motion')} of {scene.key}", len(pieces)
    ) as advance:
        for i, piece in enumerate(pieces):
            results.append(work(piece) if submitted is None else submitted[i].result())
            advance()
    arrays: dict[str, Any] = {
        name: np.concatenate([x[name] for x in results]) for name in results[0]
    }
    seconds = float(arrays.pop("seconds").sum())
    arrays.setdefault("constraint_residual", None)
    scenes = tuple(start.scene for start in starts)
    return Trajectories(scenes, formulation.key, rtol, atol, times, seconds=seconds, **arrays)


class _Options(NamedTuple):
    key: str
    by_speeds: bool
    t_end: float
    rtol: float
    atol: float
    times: Array
    max_steps: int
    width: int


def _integrated(options: _Options, starts: list[Start]) -> dict[str, Any]:
    """Return the integrated fields of `Trajectories` for these motions, by name."""
    scene, width = starts[0].scene, options.width
    formulation = formulation_for(scene, options.key)
    y0, reasons = state_vectors(starts, options.by_speeds, formulation, width)
    choices = _choices(starts, formulation, reasons)
    observer = observer_of(scene, formulation, width)
    m, count = len(starts), len(options.times)
    # The last entry, behind the outputs, is the final state of a motion.
    y = np.full((m, count + 1, y0.shape[1]), np.nan)
    observed = {name: np.full((m, count + 1, k), np.nan) for name, k in observer.outputs.items()}
    records = np.zeros((m, dop853.FIELDS))
    good = np.array([i for i, why in enumerate(reasons) if not why], int)
    seconds = 0.0
    for lanes, choice in _groups_by_choice(good, choices, width):
        kernel = kernel_of(scene, formulation, width=width, choice=choice)
        parameters = lane_parameters([starts[i].scene for i in lanes])
        before = time.perf_counter()
        out, record = _integrated_lanes(kernel, kernel.block(parameters), y0[lanes].T, options)
        seconds += time.perf_counter() - before
        t = np.vstack((np.tile(options.times[:, None], width), record[dop853.T]))
        observables = observer.rows(observer.block(parameters), t, out)
        y[lanes], records[lanes] = out.transpose(2, 0, 1), record.T
        for name, x in observables.items():
            observed[name][lanes] = x.transpose(2, 0, 1)
        if solves_partition(scene, formulation):
            t, out = np.vstack((np.zeros(width), t)), np.concatenate((y0[lanes].T[None], out))
            crossings = singular_crossings(scene, formulation, parameters, t, out)
            for lane, (i, place) in enumerate(zip(lanes, crossings, strict=True)):
                if place is not None:
                    reasons[i] = str(crossing_refusal(*t[place, lane]))
                    for x in (y, *observed.values()):
                        x[i, place[1] - 1 :] = np.nan
    reached = np.isfinite(y[:, :-1]).all(axis=2)
    known = np.concatenate(list(observed.values()), axis=2)[:, :-1]
    overflows = np.any(reached & ~np.isfinite(known).all(axis=2), axis=1)
    for i in good:
        if reasons[i]:
            continue
        if records[i, dop853.STATUS] != dop853.FINISHED:
            state = starts[i].scene, formulation, y[i, -1, : scene.n], observed["v"][i, -1]
            reasons[i] = _reason(*state, records[i], options.max_steps)
        elif overflows[i]:
            reasons[i] = "the energy overflows"
    started = np.isin(np.arange(m), good)
    status = np.where(started, "failed", "refused")
    status = np.where(np.array(reasons) == "", "finished", status)
    residual = observed.get("constraint")
    constraint = {} if residual is None else {"constraint_residual": np.abs(residual[:, :-1])}
    return {
        "q": y[:, :-1, : scene.n],
        "v": observed["v"][:, :-1],
        "u": observed["u"][:, :-1],
        "energy": observed["energy"][:, :-1, 0],
        **constraint,
        "right_hand_sides": records[:, dop853.CALLS].astype(int),
        "steps": records[:, dop853.STEPS].astype(int),
        "status": status,
        "reason": np.array(reasons),
        "seconds": np.array([seconds]),
    }


def _choices(
    starts: list[Start], formulation: Formulation, reasons: list[str]
) -> list[Choice | None]:
    """Return the independent constraints of each motion; add a reason where they are not clear."""
    choices: list[Choice | None] = [None] * len(starts)
    for i, start in enumerate(starts if formulation.redundant and starts[0].scene.r else ()):
        try:
            at = Evaluation(start.scene, start.q, np.zeros(start.scene.n))
            choices[i] = choice_for(at, formulation)
        except RefusedError as refusal:
            reasons[i] = reasons[i] or str(refusal)
    return choices


def _groups_by_choice(
    motions: Array, choices: list[Choice | None], width: int
) -> Iterator[tuple[Array, Choice | None]]:
    """Yield groups (width,) of motions with the same independent constraints, and those."""
    for choice in dict.fromkeys(choices[i] for i in motions):
        same = np.array([i for i in motions if choices[i] == choice])
        for group in lane_groups(same.size, width):
            yield same[group], choice


def _integrated_lanes(
    kernel: Kernel, block: Array, y0: Array, options: _Options
) -> tuple[Array, Array]:
    """Return the states at the output times and the end (k + 1, size, lanes), and the record."""
    size, width = y0.shape
    count, times = len(options.times), np.append(options.times, np.inf)
    shapes = (size, width), (dop853.FIELDS, width), (dop853.ROWS, size, width)
    y, record, room = (aligned_zeros(int(np.prod(shape))).reshape(shape) for shape in shapes)
    out = np.full((count + 1, size, width), np.nan)
    y[:] = y0
    if times[0] == 0.0:
        out[0], record[dop853.NEXT] = y0, 1.0
    record[dop853.DUE] = times[int(record[dop853.NEXT, 0])]
    last = kernel.last_argument(block)
    most = float(options.max_steps or np.inf)
    dop853.dop853(width)(
        *(kernel.address, last.ctypes.data, size, y.ctypes.data, record.ctypes.data),
        *(options.t_end, options.rtol, options.atol, most),
        *(times.ctypes.data, out.ctypes.data, room.ctypes.data),
    )
    out[-1] = y
    return out, record


def _reason(
    scene: Scene, formulation: Formulation, q: Array, v: Array, record: Array, max_steps: int
) -> str:
    """Return the reason why an integration ended before its end, in this last state."""
    status, t = record[dop853.STATUS], record[dop853.T]
    if status == dop853.TOO_MANY:
        return f"{max_steps} steps do not reach the end, only t = {t:.9g} s"
    what = "the right-hand side is not finite"
    if status == dop853.TOO_SMALL:
        what = f"no step is small enough, or {what},"
    why = "it overflows, or a matrix is singular there"
    try:
        Evaluation(scene, q, np.nan_to_num(v), t).acceleration(formulation)
    except RefusedError as refusal:
        why = str(refusal)
    return f"{what} at t = {t:.9g} s: {why}"
