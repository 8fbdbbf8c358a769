"""A scene and its formulations at one state, in float64.

An `Evaluation` computes each quantity (terms, generalized speeds, bodies, accelerations) once, on
first use, and caches it. The effect of rounding on a quantity is measured by perturbed samples of
the evaluation, see `eomcheck.evaluation.perturbed`.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from scipy.linalg import qr

from eomcheck.errors import InputError, RefusedError
from eomcheck.evaluation.constraint_rank import independent_partition
from eomcheck.evaluation.scene_quantities import Quantities, quantity, values_and_rates
from eomcheck.evaluation.tolerance import well_conditioned
from eomcheck.formulations import Formulation, Partition
from eomcheck.kernels.perturbed_trace import TraceRunner
from eomcheck.mechanics.scene import Scene, checked_scene
from eomcheck.numbers.dual import Dual, ReplayArithmetic, duals
from eomcheck.numbers.generic import FLOAT64, Array, map_record
from eomcheck.numbers.lanes import as_float64, lanes_in
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
    """Return the precomputed values and their rates, from angles and roots, q, q̇ and t (1,)."""
    q, qdot, t = state
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

    lanes = 0
    """Number of states on the batch axis; 0 for a single state without a batch axis."""

    is_perturbed = False
    """Whether its numbers are perturbed."""

    def __init__(self, scene: Scene, q, v, t: float = 0.0):
        q, v = checked_scene(scene).check_state(q, v, t)
        self._begin(scene, q, t)
        self.v = v

    def _begin(self, scene: Scene, q: Array, t: float) -> None:
        super().__init__(scene, FLOAT64, q, t)
        self.speeds_rcond: dict[str, float] = {}
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
        self.prepared  # noqa: B018  (its angles and roots are needed)
        state = self.parameters, tuple(self._angles_and_roots), self.q, qdot, self.time
        return map_record(
            as_float64, self.run(_prepared_with_rates, self.scene.prepare, int(clock), *state)
        )

    @property
    def time(self) -> Array:
        """The time (1,), as an argument of generic functions on float64 arrays."""
        return (self.t if lanes_in(self.t) else np.full(1, self.t)).reshape(1)

    def call_solving(self, name: str, function: Callable, *arguments) -> tuple[Any, bool]:
        """Call a generic function that solves matrices; perturbed samples take the same pivots."""
        with self.recording_solves((name, False)) as recorder:
            result = self.call(function, *arguments)
        self.solves[name, False] = {solve.name: solve for solve in recorder.solves}
        return result, not recorder.rcond or bool(well_conditioned(recorder.rcond))

    def recording_solves(self, key: Key | None = None) -> AbstractContextManager[SolveRecorder]:
        """Record the matrices that are solved inside the block, for the entry `key` of `solves`."""
        return recording_solves()

    @quantity
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

    @quantity
    def pivoted_partition(self) -> Partition:
        """The partition by pivoted QR of a."""
        if self.terms.a is None:
            return self.partition
        order: Any = qr(self.terms.a, mode="r", pivoting=True)[-1]
        r = self.scene.r
        return Partition(np.sort(order[:r]), np.sort(order[r:]))

    @quantity
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
                self.mapped(back.T, self.F),
                None if a is None else a @ back,
                gamma,
                self.mapped(T, self.v),
                self.partition,
            )
        return Acceleration(self.mapped(back, xdd), multipliers, recorder.rcond, float("inf"))

    def mapped(self, matrix: Array, x: Array) -> Array:
        """Return the product `matrix` x."""
        return matrix @ x
