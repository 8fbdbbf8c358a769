"""A scene and its formulations at one state, in float64.

An `Evaluation` computes each quantity (terms, generalized speeds, bodies, accelerations) once, on
first use, and caches it. The effect of rounding on a quantity is measured by perturbed samples of
the evaluation, see `eomcheck.evaluation.perturbed`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from scipy.linalg import qr

from eomcheck.errors import InputError, RefusedError
from eomcheck.evaluation.constraint_rank import independent_partition
from eomcheck.evaluation.scene_quantities import (
    Quantities,
    cached_quantity,
    number_of_values,
    values_and_rates,
)
from eomcheck.evaluation.tolerance import UNIT_ROUNDOFF, rounded, well_conditioned
from eomcheck.formulations import Formulation, Partition
from eomcheck.kernels.perturbed_trace import TraceRunner
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene, checked_scene
from eomcheck.numbers.batch_arrays import (
    BATCH_ARITHMETIC,
    BatchArray,
    as_float64,
    batch_data,
    batch_size,
    repeated,
)
from eomcheck.numbers.dual import Dual, ReplayArithmetic, duals
from eomcheck.numbers.generic import FLOAT64, Array, map_record
from eomcheck.numbers.linear import SolveRecord, SolveRecorder, recording_solves

T = TypeVar("T")

TRACES = TraceRunner()
"""The traces of functions of scenes and formulations, shared by all evaluations."""

Key = tuple[str, bool]
"""Key of a formulation, and whether its partition is by pivoted QR."""

SPEEDS: Key = ("speeds", False)
"""Key in `Evaluation.solves` of the matrices solved for generalized speeds by a partition."""


@dataclass(frozen=True)
class Acceleration:
    """The acceleration of one state by a formulation, with its error bound.

    Attributes:
        vdot: v̇ = q̈ (n,), m/s² and rad/s².
        multipliers: λ (r,) with M v̇ = F + aᵀλ, or None if the formulation has none.
        rcond: reciprocal condition number of each matrix solved, by name (columns scaled).
        error_bound: bound on the rounding error of every entry of `vdot`, absolute. Infinite if a
            matrix is so ill-conditioned that no bound can be measured.
    """

    vdot: Array
    multipliers: Array | None
    rcond: dict[str, float]
    error_bound: float


def _prepared_with_rates(
    prepare: Callable, clock: int, parameters: Any, made: tuple, *state: Array
) -> Any:
    """Return the precomputed values and their rates, from angles and roots, q, t (1,) and q̇."""
    q, t, qdot = state
    return values_and_rates(
        prepare(ReplayArithmetic(made), parameters, duals(q, qdot), Dual(t[0], clock))
    )


class Evaluation(Quantities):
    """The quantities of `scene` at (q, v, t), each computed on first use.

    Args:
        scene: the scene.
        q: coordinates (n,).
        v: velocities (n,).
        t: time, s.

    Attributes:
        speeds_rcond: reciprocal condition number of each matrix that generalized speeds by a
            partition solve, by name; empty until these speeds are computed.

    Raises:
        InputError: q, v or t has the wrong shape or is not finite.
    """

    states = 0
    """Number of states of a batch; 0 for a single state without a batch axis."""

    is_perturbed = False
    """Whether its numbers are perturbed."""

    unit_roundoff: float = UNIT_ROUNDOFF
    """Unit roundoff of the numbers in which the quantities are compared."""

    input_sizes: tuple[Array, Array] | None = None
    """Sizes of q (n,) and of v (n,) to which rounding is relative; None for their own."""

    def __init__(self, scene: Scene, q, v, t: float = 0.0):
        q, v = checked_scene(scene).check_state(q, v, t)
        self._begin(scene, q, t)
        self.v = v

    def _begin_batch(self, scene: Scene, q: Any, v: Any, t: Any) -> None:
        self._begin(scene, q, t)
        self.v, self.arithmetic = v, BATCH_ARITHMETIC

    def _begin(self, scene: Scene, q: Array, t: float) -> None:
        super().__init__(scene, FLOAT64, q, t)
        self.speeds_rcond: dict[str, float] = {}
        self.sensitivities: dict[tuple[str, str, bool], Any] = {}
        self._solutions_in: dict[tuple[str, bytes], Acceleration] = {}
        self._solutions: dict[tuple[str, bool], Acceleration | RefusedError] = {}
        self.solves: dict[Key, dict[str, SolveRecord]] = {}

    def call(self, function: Callable, *arguments) -> Any:
        """Call a generic function on float64 arrays."""
        with np.errstate(all="ignore"):
            return function(*arguments)

    def run(self, function: Callable, *arguments) -> Any:
        """Call a generic function on float64 arrays, in machine code if that is faster."""
        with np.errstate(all="ignore"):
            return TRACES.run_exact(function, *arguments)

    def prepared_and_rates(self, qdot: Array, clock: bool = True) -> tuple[Any, Any]:
        """Return the precomputed values and their rates, in float64; see `prepared_duals`."""
        return map_record(
            as_float64, self.run(_prepared_with_rates, *self._before_rates(clock), qdot)
        )

    def _before_rates(self, clock: bool) -> tuple:
        """Return the arguments of `_prepared_with_rates` without q̇."""
        self.prepared  # noqa: B018  (its angles and roots are needed)
        state = self.parameters, tuple(self._angles_and_roots), self.q, self.time
        return self.scene.prepare, int(clock), *state

    def rates_along(self, qdots: Array) -> tuple[Any, Any]:
        """Return the precomputed values and their rates along k velocities (k, n), stacked."""
        shared = self._before_rates(clock=False)
        return self.run_for_each("rates", _prepared_with_rates, shared, (qdots,))

    def run_for_each(self, key: str, function: Callable, shared: tuple, varied: tuple) -> Any:
        """Return the results of a generic function for k values, in one replay of its trace.

        See `Quantities`. Where it cannot be traced, refuses a matrix or is not finite, it is called
        for one value after the other.

        Raises:
            RefusedError: a matrix is singular to working precision.
        """
        if not self.states:
            with suppress(TypeError):
                result = self._in_lanes((key, False), function, shared, varied)
                if result is not None:
                    return result
        self.solves.pop((key, False), None)  # perturbed samples take their own pivots
        with self.recording_solves():
            return map_record(as_float64, super().run_for_each(key, function, shared, varied))

    def _in_lanes(self, key: Key, function: Callable, shared: tuple, varied: tuple) -> Any:
        """Return the results for k values as lanes of one batch; None if one has to be refused.

        Raises:
            TypeError: the function cannot be traced.
        """
        lanes = map_record(lambda x: BatchArray(np.asarray(x, np.float64)), varied)
        with self.recording_solves(key) as recorder, np.errstate(all="ignore"):
            result = TRACES.run(None, function, *shared, *lanes)
        count = batch_size(lanes)
        result = map_record(lambda x: batch_data(x, count), result)
        self.solves[key] = {solve.name: solve for solve in recorder.solves}
        finite: list[bool] = []
        map_record(lambda x: finite.append(bool(np.isfinite(x).all())), result)
        return None if recorder.refused_states(count).any() or not all(finite) else result

    @cached_quantity
    def parameters(self) -> Any:
        """The scene's parameters."""
        return self.scene.float64_parameters

    @property
    def time(self) -> Any:
        """The time (1,), as an argument of generic functions on float64 arrays."""
        return (self.t if isinstance(self.t, BatchArray) else np.full(1, self.t)).reshape(1)

    def call_solving(self, name: str, function: Callable, *arguments) -> tuple[Any, bool]:
        """Call a generic function that solves matrices; perturbed samples take the same pivots."""
        with self.recording_solves((name, False)) as recorder:
            result = self.call(function, *arguments)
        self.solves[name, False] = {solve.name: solve for solve in recorder.solves}
        return result, not recorder.rcond or bool(
            well_conditioned(recorder.rcond, self.unit_roundoff)
        )

    def recording_solves(self, key: Key | None = None) -> AbstractContextManager[SolveRecorder]:
        """Record the matrices that are solved inside the block, for the entry `key` of `solves`."""
        return recording_solves()

    @cached_quantity
    def kinematics(self) -> Any:
        """The intermediate values that speeds and bodies share.

        Raises:
            RefusedError: the scene has no generalized speeds at this state.
        """
        self.refuse_speeds()
        if self.scene.natural_speeds:
            return super().kinematics
        # A partition solves for velocities: in Python, where a singular matrix is refused.
        with self.recording_solves(SPEEDS) as recorder, np.errstate(all="ignore"):
            arguments = self.parameters, self.prepared, self.q, self.u
            kinematics = self.run(self.scene.kinematics, *arguments)
        self.speeds_solved(recorder)
        return kinematics

    def speeds_solved(self, watch: SolveRecorder) -> None:
        """Store the matrices that were solved for generalized speeds by a partition."""
        self.speeds_rcond = watch.rcond
        self.solves[SPEEDS] = {solve.name: solve for solve in watch.solves}

    def refuse_speeds(self) -> None:
        """Raise RefusedError if the scene has no generalized speeds at this state."""
        self.scene.refuse_speeds(self.q)

    @cached_quantity
    def pivoted_partition(self) -> Partition:
        """The partition by pivoted QR of a."""
        if self.terms.a is None:
            return self.partition
        order: Any = qr(self.terms.a, mode="r", pivoting=True)[-1]
        r = self.scene.r
        return Partition(np.sort(order[:r]), np.sort(order[r:]))

    @cached_quantity
    def independent_partition(self) -> Partition:
        """The partition into independent and redundant constraints.

        Raises:
            RefusedError: the rank of a is not clear, or another one in positions nearby.
        """
        return independent_partition(self)

    def elsewhere(self, q: Array) -> Evaluation:
        """Return the evaluation at other coordinates q (n,), at the same velocities and time."""
        return Evaluation(self.scene, q, self.v, self.t)

    def partition_for(self, formulation: Formulation, pivoted: bool) -> Partition:
        """Return the partition that `formulation` is to use.

        Raises:
            InputError: `pivoted`, and the formulation has none.
            RefusedError: the formulation needs the independent constraints, and their rank is not
                clear; or it needs more coordinates than there are.
        """
        if pivoted and not formulation.partitioned:
            raise InputError(f"pivoted = True: {formulation.key} has no partition to choose")
        if formulation.redundant:
            return self.independent_partition
        if formulation.partitioned:
            self.refuse_partition()
        return self.pivoted_partition if pivoted else self.partition

    def acceleration(self, formulation: Formulation, pivoted: bool = False) -> Acceleration:
        """Return the result of `formulation`, without an error bound (it is infinite).

        Raises:
            RefusedError: a matrix is singular to working precision, the generalized speeds do not
                exist, or the result overflows.
        """
        key = (formulation.key, pivoted)
        if key not in self._solutions:
            try:
                self._solutions[key] = self._solve(formulation, pivoted)
            except RefusedError as refusal:
                self._solutions[key] = refusal
        result = self._solutions[key]
        if isinstance(result, RefusedError):
            raise result
        return result

    def _solve(self, formulation: Formulation, pivoted: bool) -> Acceleration:
        partition = self.partition_for(formulation, pivoted)
        name = f"{formulation.key}, pivoted" if pivoted else formulation.key
        key = formulation.key, pivoted
        with (
            self.computing(name),
            self.recording_solves(key) as recorder,
            np.errstate(all="ignore"),
        ):
            vdot, multipliers = self.solution(formulation, partition)
        self.check_finite(vdot, multipliers, formulation)
        rcond = recorder.rcond
        if formulation.state == "q, u":
            rcond = self.speeds_rcond | rcond
        self.solves[key] = {solve.name: solve for solve in recorder.solves}
        return Acceleration(vdot, multipliers, rcond, float("inf"))

    def check_finite(
        self, vdot: Array, multipliers: Array | None, formulation: Formulation
    ) -> None:
        """Check that a result is finite.

        Raises:
            RefusedError: it overflows.
        """
        if not (
            np.isfinite(vdot).all() and (multipliers is None or np.isfinite(multipliers).all())
        ):
            message = f"the acceleration v̇ by {formulation.key} overflows: doubles cannot hold it"
            raise RefusedError("v̇", float("nan"), 0.0, message)

    def acceleration_in(self, formulation: Formulation, T: Array) -> Acceleration:
        """Return the result of a formulation in terms, computed in other coordinates x = T q.

        The value is the same, the matrices are those that an engine with coordinates x solves.

        Raises:
            RefusedError: as `acceleration`.
        """
        key = formulation.key, T.tobytes()
        if key not in self._solutions_in:
            self._solutions_in[key] = self._solve_in(formulation, T)
        return self._solutions_in[key]

    def _solve_in(self, formulation: Formulation, T: Array) -> Acceleration:
        M, _, _, a, gamma, _ = self.terms
        back = np.linalg.inv(T)
        with self.recording_solves() as recorder:
            xdd, multipliers = self.call(
                formulation.solution,
                back.T @ M @ back,
                back.T @ self.F,
                None if a is None else a @ back,
                gamma,
                T @ self.v,
                self.partition,
            )
        return Acceleration(back @ xdd, multipliers, recorder.rcond, float("inf"))


class RoundedEvaluation(Evaluation):
    """The quantities of a scene at a state that was rounded to numbers with fewer digits.

    They are computed in float64, as the reference of an engine that computes in such numbers. The
    velocities violate the constraints by as much as their rounding does.

    Args:
        scene: the scene; its parameters are not rounded, but perturbed with all other inputs.
        state: the state (q, v, t), which is rounded.
        unit_roundoff: u of the numbers.
        input_sizes: see `Evaluation`.
    """

    def __init__(
        self,
        scene: Scene,
        state: State,
        unit_roundoff: float,
        input_sizes: tuple[Array, Array] | None = None,
    ):
        q, v, t = (rounded(x, unit_roundoff) for x in state)
        super().__init__(scene, q, v, float(t))
        self.unit_roundoff, self.input_sizes = float(unit_roundoff), input_sizes


# ---- Batches of states ---------------------------------------------------------------------------


def lanes_of_each(shared: Any, varied: Any, elements: int, count: int) -> tuple[Any, Any]:
    """Return the arguments of a function for `count` values of each element of a batch, as lanes.

    Lane i is value i % count of element i // count.

    Args:
        shared: arguments that are the same for all values: arrays, or batches of `elements`.
        varied: arguments (k, ...) that vary: arrays, the same for all elements, or batches.
        elements: number of elements of the batch.
        count: number k of values.
    """

    def spread(x: Any) -> Any:
        x = as_float64(x) if isinstance(x, np.ndarray) and x.dtype == object else x
        return BatchArray(np.repeat(x.data, count, 0)) if isinstance(x, BatchArray) else x

    def lanes(x: Any) -> BatchArray:
        if isinstance(x, BatchArray):
            return BatchArray(x.data.reshape(-1, *x.data.shape[2:]))
        return BatchArray(repeated(np.asarray(x, np.float64), elements))

    return map_record(spread, shared), map_record(lanes, varied)


def values_of_each(result: Any, elements: int, count: int) -> Any:
    """Return a result in the lanes of `lanes_of_each` as batches of arrays (count, ...)."""
    data = map_record(lambda x: batch_data(x, elements * count), result)
    return map_record(lambda x: BatchArray(x.reshape(elements, count, *x.shape[1:])), data)


def stacked(records: Sequence[Any]) -> Any:
    """Return one record of a batch, stacked from records of arrays."""
    return map_record(
        lambda *parts: BatchArray(np.stack([np.asarray(x, np.float64) for x in parts])), *records
    )


class BatchEvaluation(Evaluation):
    """The quantities of scenes of one structure at states (q, v, t), each on first use.

    If a formulation refuses a state, its result is NaN there and `refused` is true. All scenes have
    generalized speeds at their states, or none has.

    Args:
        scenes: one for each state.
        states: the states (q, v, t).

    Attributes:
        states: number of states B.
        scenes: all of them; `scene` is the first, used for everything that they have in common.
        refused: by formulation, the states that it refuses, bool (B,).
        conditions: whether it refuses by condition numbers, or only results that overflow.
    """

    conditions = True

    def __init__(self, scenes: Sequence[Scene], states: Sequence[State]):
        q, v, t = (BatchArray(np.array(x, np.float64)) for x in zip(*states, strict=True))
        self._begin_batch(scenes[0], q, v, t if scenes[0].depends_on_time else 0.0)
        self.scenes, self.states = scenes, len(scenes)
        self.refused: dict[Key, Array] = {}

    @cached_quantity
    def parameters(self) -> Any:
        """The scenes' parameters, in a batch."""
        return self.finished(stacked([scene.float64_parameters for scene in self.scenes]))

    def call(self, function: Callable, *arguments) -> Any:
        """Call a generic function on batches.

        Raises:
            TypeError: it does more than rational operations.
        """
        return TRACES.run(None, function, *arguments)

    def run(self, function: Callable, *arguments) -> Any:
        """Call a generic function on batches: see `call`."""
        return self.call(function, *arguments)

    def run_for_each(self, key: str, function: Callable, shared: tuple, varied: tuple) -> Any:
        """Return the results for k values in all states, in one replay of a function's trace."""
        count = number_of_values(varied)
        self.solves.pop((key, False), None)  # perturbed samples take their own pivots
        with self.recording_solves(), np.errstate(all="ignore"):
            arguments = lanes_of_each(shared, varied, self.states, count)
            result = TRACES.run(None, function, *arguments[0], *arguments[1])
        return values_of_each(result, self.states, count)

    def recording_solves(self, key: Key | None = None) -> AbstractContextManager[SolveRecorder]:
        """Record the matrices that are solved inside the block."""
        return recording_solves(conditions=self.conditions)

    def speeds_solved(self, watch: SolveRecorder) -> None:
        """Store the matrices solved for generalized speeds by a partition; see `Evaluation`."""
        super().speeds_solved(watch)
        self.refused[SPEEDS] = watch.refused_states(self.states)

    def refuse_speeds(self) -> None:
        """Do nothing: either all states have speeds, or speeds are not used."""

    def partition_for(self, formulation: Formulation, pivoted: bool) -> Partition:
        """Return the paper's partition: others differ from state to state."""
        return self.partition

    def _solve(self, formulation: Formulation, pivoted: bool) -> Acceleration:
        key = formulation.key, pivoted
        with self.computing(formulation.key), self.recording_solves(key) as recorder:
            solution = self.solution(formulation, self.partition)
        refused = self.refused[key] = recorder.refused_states(self.states)
        results = [as_float64(x) for x in solution if x is not None]
        for x in results:
            refused |= ~np.isfinite(x.flattened()).all(axis=1)
        if formulation.in_speeds and SPEEDS in self.refused:
            refused |= self.refused[SPEEDS]
        self.solves[key] = {solve.name: solve for solve in recorder.solves}
        rcond = recorder.rcond
        if formulation.state == "q, u":
            rcond = self.speeds_rcond | rcond
        for x in results:
            x.data[refused] = np.nan
        return Acceleration(
            results[0], results[1] if len(results) > 1 else None, rcond, float("inf")
        )

    def alone(self, i: int) -> Evaluation:
        """Return the evaluation at state i."""
        return Evaluation(self.scenes[i], *self.state_of(i))

    def state_of(self, i: int) -> State:
        """Return (q, v, t) of state i."""
        q, v, t = (x.data[i] if isinstance(x, BatchArray) else x for x in (self.q, self.v, self.t))
        return State(q, v, float(t))
