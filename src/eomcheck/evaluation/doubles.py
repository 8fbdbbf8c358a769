"""A scene and its formulations at one state, in doubles.

`Evaluation` computes each quantity once, when it is first asked for. Its `moved` siblings compute
the same with every number changed a little, which measures how far rounding can go.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import qr, solve_triangular

from eomcheck.errors import InputError, RefusedError
from eomcheck.evaluation.point import Quantities
from eomcheck.evaluation.tolerance import INCONCLUSIVE, UNDERFLOW, allowed_error, largest
from eomcheck.formulations import Formulation, Partition
from eomcheck.kernels.moved import Moves
from eomcheck.mechanics.records import Terms
from eomcheck.mechanics.scene import Scene, checked_scene
from eomcheck.numbers.contract import Arithmetic, Array
from eomcheck.numbers.float64 import FLOAT64
from eomcheck.numbers.linear import Solve, watching
from eomcheck.numbers.noise import SAMPLES, STEP, STRETCH, Noise, Noisy

LOST = 2.0**-12
"""A change by this share of the quantity, at so small a noise, asks whether it is lost."""


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


class Evaluation(Quantities):
    """The quantities of `scene` at (q, v, t), each computed on first use.

    Args:
        scene: the scene.
        q: coordinates (n,).
        v: velocities (n,).
        t: time, s.

    Raises:
        InputError: q, v or t has the wrong shape or is not finite.
    """

    def __init__(self, scene: Scene, q, v, t: float = 0.0):
        q, v = checked_scene(scene).check_state(q, v, t)
        super().__init__(scene, FLOAT64, q, t)
        self.v = v
        self._noise: Noise | None = None
        self._origin, self._moves = self, Moves()
        self._speeds_rcond: dict[str, float] = {}
        self._solutions: dict[tuple[str, bool], Acceleration | RefusedError] = {}
        self._solves: dict[tuple[str, bool], dict[str, Solve]] = {}

    def call(self, function: Callable, *arguments) -> Any:
        """Call a generic function on doubles.

        A sibling moves each operation; where a function does more than rational operations, only
        what it reads and returns is moved.
        """
        with np.errstate(all="ignore"):
            if self._noise is not None:
                with suppress(TypeError):
                    return self._origin._moves.run(self._noise, function, *arguments)
            return function(*arguments)

    def keep(self, record: Any) -> Any:
        """Return `record`, moved in a sibling."""
        return record if self._noise is None else self._noise.record(record)

    @property
    def preparing(self) -> Arithmetic:
        """What prepares; in a sibling, cosines, sines and roots are moved as well."""
        return FLOAT64 if self._noise is None else Noisy(FLOAT64, self._noise)

    @cached_property
    def terms(self) -> Terms:
        """M, Q, B, a, gamma, b; in a sibling, bodies' Jacobians that they are made of are moved."""
        scene = self.scene
        if self._noise is None or "terms" not in scene.composed:
            return super().terms
        # Where inertia forces cancel in B, only this shows what rounding has done to them.
        here = self.parameters, self.prepared, self.q, self.v
        jacobians = self.keep(self.call(scene.jacobians, *here))
        return self.keep(self.call(scene.assemble, *here, jacobians))

    @cached_property
    def kinematics(self) -> Any:
        """What speeds and bodies share.

        Raises:
            RefusedError: the scene has no generalized speeds here.
        """
        self.scene.refuse_speeds(self.q)
        if self.scene.natural_speeds:
            return super().kinematics
        # A partition solves for velocities: in Python, where a singular matrix is refused.
        with watching(self._noise) as watch, np.errstate(all="ignore"):
            found = self.scene.kinematics(self.parameters, self.prepared, self.q, self.u)
        self._speeds_rcond = watch.rcond
        return found

    @cached_property
    def pivoted_partition(self) -> Partition:
        """The partition by pivoted QR of a."""
        if self.terms.a is None:
            return self.partition
        order: Any = qr(self.terms.a, mode="r", pivoting=True)[-1]
        r = self.scene.r
        return Partition(np.sort(order[:r]), np.sort(order[r:]))

    def partition_for(self, formulation: Formulation, pivoted: bool) -> Partition:
        """Return the partition that `formulation` is to use.

        Raises:
            InputError: `pivoted`, and the formulation has none.
        """
        if pivoted and not formulation.partitioned:
            raise InputError(f"pivoted = True: {formulation.key} has no partition to choose")
        return self._origin.pivoted_partition if pivoted else self.partition

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
        with watching(self._noise) as watch, np.errstate(all="ignore"):
            vdot, multipliers = self.solution(formulation, partition)
        finite = np.isfinite(vdot).all() and (multipliers is None or np.isfinite(multipliers).all())
        if self._noise is None and not finite:
            raise RefusedError(
                "v̇",
                float("nan"),
                0.0,
                f"the acceleration v̇ by {formulation.key} overflows: doubles cannot hold it",
            )
        rcond = watch.rcond
        if formulation.state == "q, u":
            rcond = self._speeds_rcond | rcond
        self._solves[formulation.key, pivoted] = {solve.name: solve for solve in watch.solves}
        return Acceleration(vdot, multipliers, rcond, float("inf"))

    def moved(self, coordinates: bool = False) -> tuple[Evaluation, ...]:
        """Return siblings in which every number is moved, on request the coordinates as well.

        There are `SAMPLES` by `STEP`, and the first once more by `STRETCH` times as much.

        Our own formulations read one and the same q, so that its rounding is no error of theirs;
        an outside engine forms its own angles from q and rounds them again.
        """
        return self._moved_everywhere if coordinates else self._moved_numbers

    @cached_property
    def _moved_numbers(self) -> tuple[Evaluation, ...]:
        return self._siblings(coordinates=False)

    @cached_property
    def _moved_everywhere(self) -> tuple[Evaluation, ...]:
        return self._siblings(coordinates=True)

    def _siblings(self, coordinates: bool) -> tuple[Evaluation, ...]:
        noises = [Noise(seed) for seed in range(SAMPLES)]
        return tuple(
            self._sibling(noise, coordinates) for noise in (*noises, Noise(0, STRETCH * STEP))
        )

    def _sibling(self, noise: Noise, coordinates: bool) -> Evaluation:
        q = noise.entries(self.q) if coordinates else self.q
        sibling = Evaluation(self.scene, q, self.v + self._velocity_noise(noise), self.t)
        sibling._noise, sibling._origin = noise, self
        return sibling

    def _velocity_noise(self, noise: Noise) -> Array:
        """Return changes of v: of its entries, and within what `check_consistent` lets pass."""
        change = noise.entries(self.v) - self.v
        if self.terms.a is None:
            return change
        residual = violation(self, self.v)[1] / allowed_error(1.0) * noise.changes((self.scene.r,))
        Q, R = self._constraint_factors
        with np.errstate(all="ignore"):
            try:
                slip = Q @ solve_triangular(R, residual, trans=1, check_finite=False)
            except np.linalg.LinAlgError:  # dependent constraints
                return change
        return change + slip if np.isfinite(slip).all() else change

    @cached_property
    def _constraint_factors(self) -> tuple[Any, ...]:
        """Q (n, r) and R (r, r) with aᵀ = Q R."""
        return qr(self.terms.a.T, mode="economic", check_finite=False)

    def spread(
        self,
        quantity: Callable[[Evaluation], Any],
        coordinates: bool = False,
        can_be_lost: bool = False,
    ) -> float:
        """Return κ · scale of `quantity`: its largest entry, and how far that moves, per step.

        Infinite where a moved evaluation cannot be finished. For a quantity that `can_be_lost`, the
        result of a solve, also where the change does not grow with the noise: it is lost already.
        """
        here = np.asarray(quantity(self))
        size = largest(here)
        with np.errstate(all="ignore"):
            try:
                changes = [largest(np.asarray(quantity(e)) - here) for e in self.moved(coordinates)]
            except (RefusedError, np.linalg.LinAlgError):
                return float("inf")
        *changes, stretched = changes
        if np.isinf(stretched):
            return stretched
        # What underflows moves in steps of its own, whatever the noise.
        seen = can_be_lost and changes[0] > max(LOST * size, UNDERFLOW)
        if seen and stretched < STRETCH / 2 * changes[0]:
            return float("inf")
        return size + max(changes) / STEP

    def acceleration_in(self, formulation: Formulation, T: Array) -> Acceleration:
        """Return the result of a formulation in terms, found in other coordinates x = T q.

        Same value, other matrices: what an engine with coordinates of its own really solves.

        Raises:
            RefusedError: as `acceleration`.
        """
        M, _, _, a, gamma, _ = self.terms
        back = np.linalg.inv(T)
        with watching(self._noise) as watch:
            xdd, multipliers = formulation.solution(
                back.T @ M @ back,
                back.T @ self.F,
                None if a is None else a @ back,
                gamma,
                T @ self.v,
                self.partition,
            )
        return Acceleration(back @ xdd, multipliers, watch.rcond, float("inf"))

    def acceleration_spread(
        self,
        formulation: Formulation,
        part: str = "vdot",
        *,
        coordinates: bool = False,
        pivoted: bool = False,
    ) -> float:
        """Return κ · scale of a part ("vdot", "multipliers") of the result of `formulation`.

        Infinite where C κ ε exceeds `INCONCLUSIVE` for a matrix that was solved, be it by its
        condition number or because its determinant depends so strongly on what it was made of:
        noise may then lose the same digits as rounding, and measures nothing.

        Raises:
            RefusedError: as `acceleration`.
        """
        rcond = self.acceleration(formulation, pivoted).rcond
        if rcond and allowed_error(1.0 / min(rcond.values())) > INCONCLUSIVE:
            return float("inf")
        spread = self.spread(
            lambda e: getattr(e.acceleration(formulation, pivoted), part),
            coordinates,
            can_be_lost=True,
        )
        if np.isinf(spread) or self._determined(formulation, coordinates, pivoted):
            return spread
        return float("inf")

    def _determined(self, formulation: Formulation, coordinates: bool, pivoted: bool) -> bool:
        """Return whether the matrices solved are more than the rounding of what made them.

        They are not where a determinant changes its sign, or jumps because other pivots were taken.
        A right-hand side of zeros has the same solution in every sibling, and would not tell.
        """
        key = (formulation.key, pivoted)
        here = self._solves[key]
        for sibling in self.moved(coordinates)[:SAMPLES]:
            for name, solve in sibling._solves[key].items():
                moved = abs(solve.log_determinant - here[name].log_determinant) * np.log(2.0)
                if solve.sign != here[name].sign or not allowed_error(moved / STEP) <= INCONCLUSIVE:
                    return False
        return True


def violation(at: Evaluation, v: Array) -> tuple[Array, Array]:
    """Return (a v + b, what rounding allows of it), each (r,), m/s; `at` has constraints."""
    a, b = at.terms.a, at.terms.b
    with np.errstate(all="ignore"):
        residual = a @ v if b is None else a @ v + b
        size = np.abs(a) @ np.abs(v) + (0.0 if b is None else np.abs(b))
        return residual, allowed_error(1.0) * size
