"""A scene and its formulations at one state, in float64.

`Evaluation` computes each quantity once, on first use. The effect of rounding on it is measured by
perturbed samples, see `eomcheck.evaluation.perturbed`.
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
"""What has been listed of functions of scenes and formulations."""

Key = tuple[str, bool]
"""A formulation, and whether its partition is a pivoted one."""

SPEEDS: Key = ("speeds", False)
"""Under which generalized speeds by a partition keep what they solve."""


@dataclass(frozen=True)
class Acceleration:
    """What a formulation says about one state.

    Attributes:
        vdot: v̇ = q̈ (n,), m/s² and rad/s².
        multipliers: λ (r,) with M v̇ = F + aᵀλ, or None where the formulation has none.
        rcond: reciprocal condition number of each matrix solved, by name (columns scaled).
        error_bound: bound on the rounding error of every entry of `vdot`, absolute. Infinite where
            a matrix is so ill-conditioned that no bound can be measured.
    """

    vdot: Array
    multipliers: Array | None
    rcond: dict[str, float]
    error_bound: float


def _prepared_with_rates(
    prepare: Callable, clock: int, parameters: Any, made: tuple, *state: Array
) -> Any:
    """Return what is prepared, and how fast it changes, of angles and roots, q, q̇ and t (1,)."""
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
            partition solve, by name; empty until they are asked for.

    Raises:
        InputError: q, v or t has the wrong shape or is not finite.
    """

    lanes = 0
    """Number of states side by side; 0 where there is one, and no axis for it."""

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
        """Call a generic function on doubles."""
        with np.errstate(all="ignore"):
            return function(*arguments)

    def run(self, function: Callable, *arguments) -> Any:
        """Call a generic function on doubles, in machine code where that is faster."""
        with np.errstate(all="ignore"):
            return TRACES.run_exact(function, *arguments)

    def prepared_and_rates(self, qdot: Array, clock: bool = True) -> tuple[Any, Any]:
        """Return what is prepared, and how fast it changes, in doubles; see `prepared_duals`."""
        self.prepared  # noqa: B018  (what it is made of is needed)
        here = self.parameters, tuple(self._angles_and_roots), self.q, qdot, self.time
        return map_record(
            as_float64, self.run(_prepared_with_rates, self.scene.prepare, int(clock), *here)
        )

    @property
    def time(self) -> Array:
        """The time (1,), as generic functions of doubles read it."""
        return (self.t if lanes_in(self.t) else np.full(1, self.t)).reshape(1)

    def call_solving(self, name: str, function: Callable, *arguments) -> tuple[Any, bool]:
        """Call a generic function that solves matrices of its own; copies round as it does here."""
        with self.recording_solves((name, False)) as watch:
            found = self.call(function, *arguments)
        self.solves[name, False] = {solve.name: solve for solve in watch.solves}
        return found, not watch.rcond or bool(well_conditioned(watch.rcond))

    def recording_solves(self, key: Key | None = None) -> AbstractContextManager[SolveRecorder]:
        """Watch the matrices that are solved for what `solves` has under `key`."""
        return recording_solves()

    @quantity
    def kinematics(self) -> Any:
        """What speeds and bodies share.

        Raises:
            RefusedError: the scene has no generalized speeds here.
        """
        self.refuse_speeds()
        if self.scene.natural_speeds:
            return super().kinematics
        # A partition solves for velocities: in Python, where a singular matrix is refused.
        with self.recording_solves(SPEEDS) as watch, np.errstate(all="ignore"):
            here = self.parameters, self.prepared, self.q, self.u
            found = self.run(self.scene.kinematics, *here)
        self.speeds_solved(watch)
        return found

    def speeds_solved(self, watch: SolveRecorder) -> None:
        """Note what was solved for generalized speeds by a partition."""
        self.speeds_rcond = watch.rcond
        self.solves[SPEEDS] = {solve.name: solve for solve in watch.solves}

    def refuse_speeds(self) -> None:
        """Raise RefusedError where the scene has no generalized speeds."""
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
        """The constraints that are independent, and which columns tell.

        Raises:
            RefusedError: the rank of a is not clear, or another one in positions nearby.
        """
        return independent_partition(self)

    def elsewhere(self, q: Array) -> Evaluation:
        """Return the scene at other coordinates q (n,), at the same velocities and time."""
        return Evaluation(self.scene, q, self.v, self.t)

    def partition_for(self, formulation: Formulation, pivoted: bool) -> Partition:
        """Return the partition that `formulation` is to use.

        Raises:
            InputError: `pivoted`, and the formulation has none.
            RefusedError: it tells which constraints are independent, and their rank is not clear;
                or it needs more coordinates than there are.
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
        with self.computing(name), self.recording_solves(key) as watch, np.errstate(all="ignore"):
            vdot, multipliers = self.solution(formulation, partition)
        self.check_finite(vdot, multipliers, formulation)
        rcond = watch.rcond
        if formulation.state == "q, u":
            rcond = self.speeds_rcond | rcond
        self.solves[key] = {solve.name: solve for solve in watch.solves}
        return Acceleration(vdot, multipliers, rcond, float("inf"))

    def check_finite(
        self, vdot: Array, multipliers: Array | None, formulation: Formulation
    ) -> None:
        """Check that a result is made of numbers.

        Raises:
            RefusedError: it overflows.
        """
        if not (
            np.isfinite(vdot).all() and (multipliers is None or np.isfinite(multipliers).all())
        ):
            what = f"the acceleration v̇ by {formulation.key} overflows: doubles cannot hold it"
            raise RefusedError("v̇", float("nan"), 0.0, what)

    def acceleration_in(self, formulation: Formulation, T: Array) -> Acceleration:
        """Return the result of a formulation in terms, found in other coordinates x = T q.

        Same value, other matrices: what an engine with coordinates of its own really solves.

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
        with self.recording_solves() as watch:
            xdd, multipliers = self.call(
                formulation.solution,
                back.T @ M @ back,
                self.mapped(back.T, self.F),
                None if a is None else a @ back,
                gamma,
                self.mapped(T, self.v),
                self.partition,
            )
        return Acceleration(self.mapped(back, xdd), multipliers, watch.rcond, float("inf"))

    def mapped(self, matrix: Array, x: Array) -> Array:
        """Return `matrix` x."""
        return matrix @ x
