"""Perturbed samples of an evaluation, and the sensitivity to rounding that they measure.

A perturbed sample computes the same quantities, but each number that is read and the result of each
operation is perturbed by a random share of a small step (Monte Carlo arithmetic). All samples of an
evaluation are computed as one batch, whose first axis is the sample: one by one, Python would take
most of the time.

The change of a quantity, per step by which all numbers are perturbed, is κ · scale, its
sensitivity: how strongly rounding can change it (`eomcheck.evaluation.tolerance`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, suppress
from functools import cached_property
from typing import Any

import numpy as np

from eomcheck.errors import RefusedError
from eomcheck.evaluation.evaluation import TRACES, Acceleration, Evaluation, Key
from eomcheck.evaluation.scene_quantities import Solution, quantity
from eomcheck.evaluation.tolerance import (
    INCONCLUSIVE,
    UNDERFLOW,
    allowed_error,
    largest,
    largest_of_each,
    well_conditioned,
)
from eomcheck.evaluation.violations import velocity_perturbation
from eomcheck.formulations import Formulation, Partition
from eomcheck.kernels.perturbed_trace import traceable_prepare
from eomcheck.mechanics.records import Terms
from eomcheck.numbers.generic import FLOAT64, Arithmetic, Array, map_record
from eomcheck.numbers.linear import SolveRecorder, for_each_noise, recording_solves
from eomcheck.numbers.noise import (
    SAMPLES,
    STEP,
    STRETCH,
    Noise,
    NoiseBatch,
    NoisyArithmetic,
    PerturbedArray,
)

# ---- Perturbed samples ---------------------------------------------------------------------------


def _call_perturbed(noise: Noise, function: Callable, *arguments: Any) -> Any:
    """Call a generic function, each of its operations perturbed.

    Raises:
        TypeError: it does more than rational operations.
    """
    with np.errstate(all="ignore"):
        return TRACES.run(noise, function, *arguments)


class PerturbedEvaluation(Evaluation):
    """What all copies have in common whose numbers are perturbed, in lanes or not.

    Attributes:
        noise: what every number is changed by.
    """

    is_perturbed = True
    noise: Noise
    _original: Evaluation

    def computing(self, name: str) -> AbstractContextManager:
        """Return the context in which noise is that of what is called `name`, from its start."""
        return self.noise.stream(name)

    def finished(self, record: Any) -> Any:
        """Return `record`, perturbed."""
        return self.noise.perturb_record(record)

    def run(self, function: Callable, *arguments) -> Any:
        """Call a generic function, each operation perturbed: see `call`."""
        return self.call(function, *arguments)

    def recording_solves(self, key: Key | None = None) -> AbstractContextManager[SolveRecorder]:
        """Watch the matrices that are solved, and perturb them; pivots stay the original's."""
        return recording_solves(self.noise, self._original.solves.get(key) if key else None)

    def speeds_solved(self, watch: SolveRecorder) -> None:
        """Note what was solved for generalized speeds; of moved matrices no condition is known."""
        super().speeds_solved(watch)
        self.speeds_rcond = {}

    @quantity
    def terms(self) -> Terms:
        """M, Q, B, a, gamma, b; body Jacobians that they are composed of are perturbed too."""
        scene = self.scene
        if "terms" not in scene.derived_functions:
            return super().terms
        # Where inertia forces cancel in B, only this shows what rounding has done to them.
        here = self.parameters, self.prepared, self.q, self.v
        jacobians = self.finished(self.call(scene.jacobians, *here))
        return self.finished(self.call(scene.assemble, *here, jacobians))


class _SampleOrBatch(PerturbedEvaluation):
    """What a copy and all copies together have in common."""

    @quantity
    def pivoted_partition(self) -> Partition:
        """That of the original."""
        return self._original.pivoted_partition

    @quantity
    def independent_partition(self) -> Partition:
        """That of the original."""
        return self._original.independent_partition

    def check_finite(
        self, vdot: Array, multipliers: Array | None, formulation: Formulation
    ) -> None:
        """Let everything pass: what is not finite makes a sensitivity infinite."""


def _batch_property(name: str) -> Any:
    """Return the property of a copy whose values all copies find together."""

    def part(copy: PerturbedSample) -> Any:
        return copy.batch.part(copy.index, getattr(copy.batch, name))

    return cached_property(part)


class PerturbedSample(_SampleOrBatch):
    """A copy of an evaluation in which every number is perturbed.

    Args:
        original: the evaluation.
        noise: what its numbers are changed by.
        coordinates: whether the coordinates are perturbed too.

    Attributes:
        batch: all copies side by side.
        index: which of them this is.
    """

    batch: PerturbedBatch
    index: int

    def __init__(self, original: Evaluation, noise: Noise, coordinates: bool):
        with noise.stream("state"):
            q = noise.perturb(original.q) if coordinates else original.q
            v = original.v + velocity_perturbation(original, noise)
        super().__init__(original.scene, q, v, original.t)
        self._original, self.noise = original, noise

    parameters = _batch_property("parameters")
    terms = _batch_property("terms")
    F = _batch_property("F")
    u = _batch_property("u")
    kinematics = _batch_property("kinematics")
    speeds = _batch_property("speeds")
    bodies = _batch_property("bodies")
    x = _batch_property("x")
    chain = _batch_property("chain")

    def call(self, function: Callable, *arguments) -> Any:
        """Call a generic function, each of its operations perturbed.

        Where it does more than rational operations, only what it reads and returns is perturbed.
        """
        with suppress(TypeError):
            return _call_perturbed(self.noise, function, *arguments)
        return super().call(function, *arguments)

    def prepare(self) -> tuple[Any, Sequence[Any]]:
        """Return what is prepared, and the angles and roots made for it; see `Quantities`."""
        found = self.batch.traced_preparation
        return super().prepare() if found is None else self.batch.part(self.index, found)

    @property
    def prepare_arithmetic(self) -> Arithmetic:
        """What prepares where not all is rational besides: cosines, sines and roots are moved."""
        return NoisyArithmetic(FLOAT64, self.noise)

    def acceleration(self, formulation: Formulation, pivoted: bool = False) -> Acceleration:
        """Return the result of `formulation`; see `Evaluation`. Nothing is refused but speeds."""
        key = formulation.key, pivoted
        found = self._solutions.get(key)
        if not isinstance(found, Acceleration):
            found = self._mine(self.batch.acceleration(formulation, pivoted))
            self._solutions[key] = found
            self.solves[key] = {
                name: solve._replace(
                    sign=solve.sign[self.index], log_determinant=solve.log_determinant[self.index]
                )
                for name, solve in self.batch.solves[key].items()
            }
        return found

    def acceleration_in(self, formulation: Formulation, T: Array) -> Acceleration:
        """Return the result of a formulation in other coordinates, see `Evaluation`."""
        return self._mine(self.batch.acceleration_in(formulation, T))

    def _mine(self, found: Acceleration) -> Acceleration:
        vdot, multipliers = self.batch.part(self.index, (found.vdot, found.multipliers))
        return Acceleration(vdot, multipliers, found.rcond, float("inf"))


class PerturbedBatch(_SampleOrBatch):
    """All copies of an evaluation side by side: the first axis of every array is theirs.

    Each is moved as it would be alone.

    Args:
        original: the evaluation.
        copies: its copies.
    """

    def __init__(self, original: Evaluation, copies: Sequence[PerturbedSample]):
        self._begin(original.scene, np.stack([copy.q for copy in copies]), original.t)
        self._original, self._samples = original, copies
        self.noise = self._noises = NoiseBatch([copy.noise for copy in copies])
        self._read: dict[Key, Solution] = {}

    def solution_without_noise(self, formulation: Formulation, pivoted: bool) -> Solution:
        """Return what `formulation` makes of the copies' numbers, rounding as doubles do."""
        partition, key = self.partition_for(formulation, pivoted), (formulation.key, pivoted)
        if key not in self._read:
            with self._noises.disabled(), self.recording_solves(key), np.errstate(all="ignore"):
                self._read[key] = self.solution(formulation, partition)
        return self._read[key]

    def part(self, place: int, record: Any) -> Any:
        """Return what a record holds of the copy at `place`."""
        return _sample_part(record, place, self._samples[place].noise)

    def call(self, function: Callable, *arguments) -> Any:
        """Call a generic function, each of its operations perturbed.

        Where it does more than rational operations, only what it reads and returns is perturbed.
        """
        with suppress(TypeError):
            return _call_perturbed(self.noise, function, *arguments)
        with np.errstate(all="ignore"):
            alone = for_each_noise(
                self._noises, lambda i, one: function(*_sample_part(arguments, i, one))
            )
            return self._stacked(alone)

    def _stacked(self, records: Sequence[Any]) -> Any:
        """Return the records of all copies as one; what are no doubles are the same in all."""
        first = records[0]
        if isinstance(first, tuple):
            parts = [self._stacked(each) for each in zip(*records, strict=True)]
            return type(first)(*parts) if hasattr(first, "_fields") else tuple(parts)
        if isinstance(first, float) or (
            isinstance(first, np.ndarray) and first.dtype == np.float64
        ):
            stack = np.stack([np.asarray(x) for x in records])
            return self.noise.as_perturbed(stack) if isinstance(first, PerturbedArray) else stack
        return first

    # ---- What is read ----------------------------------------------------------------------------

    @quantity
    def parameters(self) -> Any:
        """The scene's parameters."""
        front, still = self.noise.shape, self._original.parameters
        return self.finished(map_record(lambda x: np.broadcast_to(x, front + np.shape(x)), still))

    @cached_property
    def traced_preparation(self) -> tuple[Any, Sequence[Any]] | None:
        """What is prepared, and how, with every operation perturbed; None if not all is told."""
        with suppress(TypeError), self.computing("prepared"):
            here = self.parameters, self.q, self.time
            prepared, made = _call_perturbed(
                self.noise, traceable_prepare(self.scene.prepare), *here
            )
            return map_record(self.noise.as_perturbed, prepared), made
        return None

    @property
    def time(self) -> Array:
        """The time (k, 1), as generic functions of doubles read it."""
        return np.full((*self.noise.shape, 1), self.t)

    @quantity
    def prepared(self) -> Any:
        """What is not rational in q and t: of each copy for itself if need be."""
        if self.traced_preparation is not None:
            found, self._angles_and_roots = self.traced_preparation
            return found
        found = self._stacked([copy.prepared for copy in self._samples])
        self._angles_and_roots = self._stacked(
            [tuple(copy._angles_and_roots) for copy in self._samples]
        )
        return found

    @quantity
    def v(self) -> Array:
        """Velocities: those that the copies have."""
        return np.stack([copy.v for copy in self._samples])

    @quantity
    def u(self) -> Array:
        """Generalized speeds: those that the copies were given, or those of v."""
        if all("u" in vars(copy) for copy in self._samples):
            return np.stack([copy.u for copy in self._samples])
        return super().u

    # ---- What follows ----------------------------------------------------------------------------

    def refuse_speeds(self) -> None:
        """Raise RefusedError where the scene has no generalized speeds in one of the copies."""
        for q in self.q:
            self.scene.refuse_speeds(q)

    @quantity
    def partition(self) -> Partition:
        """That of the original."""
        return self._original.partition

    def _solve_in(self, formulation: Formulation, T: Array) -> Acceleration:
        with self.computing("quantity"):
            return super()._solve_in(formulation, T)

    def rate_of_velocity(self, udot: Array) -> Array:
        """Return v̇ of u̇."""
        W, rest, _ = self.speeds
        return udot if W is None else self.mapped(W, udot) + rest

    def mapped(self, matrix: Array, x: Array) -> Array:
        """Return `matrix` x of all copies."""
        return (matrix @ x[..., None])[..., 0]


def _sample_part(record: Any, place: int, noise: Noise) -> Any:
    """Return what a record of all copies holds of the one at `place`, which `noise` moves."""

    def of_copy(x: Any) -> Any:
        if not (isinstance(x, np.ndarray) and x.dtype == np.float64):
            return x
        mine = x[(place, ...)]
        if isinstance(mine, PerturbedArray):
            mine.noise = noise
        return mine

    return map_record(of_copy, record)


def _samples(at: Evaluation) -> tuple[PerturbedSample, ...]:
    return _new_samples(at, coordinates=False)


def _samples_everywhere(at: Evaluation) -> tuple[PerturbedSample, ...]:
    return _new_samples(at, coordinates=True)


def _new_samples(at: Evaluation, coordinates: bool) -> tuple[PerturbedSample, ...]:
    noises = (*(Noise(seed) for seed in range(SAMPLES)), Noise(0, STRETCH * STEP))
    copies = tuple(PerturbedSample(at, noise, coordinates) for noise in noises)
    together = PerturbedBatch(at, copies)
    for place, copy in enumerate(copies):
        copy.batch, copy.index = together, place
    return copies


def perturbed_samples(at: Evaluation, coordinates: bool = False) -> tuple[Any, ...]:
    """Return copies of `at` with every number perturbed, on request the coordinates as well.

    There are `SAMPLES` by `STEP`, and the first once more by `STRETCH` times as much.

    Our own formulations read one and the same q, so that its rounding is no error of theirs; an
    outside engine forms its own angles from q and rounds them again.
    """
    if at.lanes:
        return at.perturbed(coordinates)  # type: ignore[attr-defined]
    return at.cached(_samples_everywhere if coordinates else _samples)


# ---- Sensitivities -------------------------------------------------------------------------------

NOISY = 2.0**-12
"""A change by this share of a solution, at so small a step, asks whether anything is left of it."""


def sensitivity_of(
    at: Evaluation,
    quantity: Callable[[Evaluation], Any],
    coordinates: bool = False,
    solved: bool = False,
    batched: bool = False,
) -> float:
    """Return how strongly rounding can change a quantity, κ · scale.

    Its size plus its largest change under perturbation, divided by the step. Infinite where a
    perturbed copy cannot be finished. For a quantity that is `solved`, the result of a solve, also
    where the change does not grow with the step: nothing is left of it then.

    Args:
        at: the evaluation.
        quantity: what is looked at, of `at` and of its copies.
        coordinates: whether the coordinates are perturbed too.
        solved: whether it is the result of a solve.
        batched: whether the copies have it side by side, with an axis for them in front.
    """
    here = np.asarray(quantity(at))
    size = largest(here)
    with np.errstate(all="ignore"):
        try:
            copies = perturbed_samples(at, coordinates)
            if batched:
                changes = largest_of_each(np.asarray(_evaluated(copies[0].batch, quantity)) - here)
            else:
                changes = [
                    largest(np.asarray(_evaluated(copy, quantity)) - here) for copy in copies
                ]
        except (RefusedError, np.linalg.LinAlgError):
            return float("inf")
    return float(amplification(size, np.array(changes), solved))


def entry_sensitivity_of(at: Evaluation, quantity: Callable[[Evaluation], Any]) -> Array:
    """Return how strongly rounding can change each entry of a quantity, of its shape.

    The coordinates are perturbed too. Where a perturbed copy cannot be finished it is the size.
    """
    here = np.asarray(quantity(at))
    with np.errstate(all="ignore"):
        try:
            copies = perturbed_samples(at, True)[:SAMPLES]
            changes = [np.abs(np.asarray(_evaluated(copy, quantity)) - here) for copy in copies]
        except (RefusedError, np.linalg.LinAlgError):
            return np.abs(here)
        return np.abs(here) + np.max(changes, axis=0) / STEP


def amplification(size: Any, changes: Any, solved: bool) -> Any:
    """Return how strongly rounding can change what is of this size, of one state or of several.

    Args:
        size: the size (...,).
        changes: largest changes (k, ...) by noise, the last by noise that is stretched.
        solved: see `sensitivity_of`.
    """
    changes, stretched = changes[:-1], changes[-1]
    with np.errstate(all="ignore"):
        found = size + changes.max(axis=0) / STEP
        lost = np.isinf(stretched)
        if solved:
            # What underflows changes in steps of its own, whatever the noise.
            seen = changes[0] > np.maximum(NOISY * size, UNDERFLOW)
            lost = lost | (seen & (stretched < STRETCH / 2 * changes[0]))
    return np.where(lost, np.inf, found)


def _evaluated(copy: PerturbedEvaluation, quantity: Callable[[Evaluation], Any]) -> Any:
    with copy.computing("quantity"):
        return quantity(copy)


def acceleration_sensitivity(
    at: Evaluation,
    formulation: Formulation,
    part: str = "vdot",
    *,
    coordinates: bool = False,
    pivoted: bool = False,
) -> float:
    """Return κ · scale of a part ("vdot", "multipliers") of the result of `formulation`.

    Infinite where C κ ε exceeds `INCONCLUSIVE` for a matrix that was solved, be it by its
    condition number or because its determinant depends so strongly on what it was made of:
    perturbation may then lose the same digits as rounding, and measures nothing.

    Raises:
        RefusedError: as `Evaluation.acceleration`.
    """
    rcond = at.acceleration(formulation, pivoted).rcond
    if rcond and not well_conditioned(rcond):
        return float("inf")
    found = sensitivity_of(
        at,
        lambda e: getattr(e.acceleration(formulation, pivoted), part),
        coordinates,
        solved=True,
        batched=True,
    )
    if np.isinf(found) or not _matrices_resolved(at, formulation, coordinates, pivoted):
        return float("inf")
    return max(found, _input_sensitivity(at, formulation, part, coordinates, pivoted))


def _input_sensitivity(
    at: Evaluation, formulation: Formulation, part: str, coordinates: bool, pivoted: bool
) -> float:
    """Return κ · scale of what rounding does to the numbers that `formulation` reads, by itself.

    Next to what it does in the formulation it may have the other sign, in all copies by chance;
    who climbs to a small error bound comes to where it has.
    """
    here = getattr(at.acceleration(formulation, pivoted), part)
    together = perturbed_samples(at, coordinates)[0].batch
    moved = getattr(together.solution_without_noise(formulation, pivoted), part)
    with np.errstate(all="ignore"):
        return largest(here) + largest(np.asarray(moved)[:SAMPLES] - here) / STEP


def speeds_resolved(at: Evaluation) -> bool:
    """Return whether W of generalized speeds by a partition is more than rounding.

    Where a_1 is singular but for rounding, ẇ′ found in two ways is two different numbers, and
    copies, perturbed by more than rounding, are nearer to each other than these.
    """
    rcond = at.speeds_rcond
    return not rcond or bool(
        well_conditioned(rcond)
        and np.isfinite(sensitivity_of(at, lambda e: e.speeds.W, solved=True))
    )


def _matrices_resolved(
    at: Evaluation, formulation: Formulation, coordinates: bool, pivoted: bool
) -> bool:
    """Return whether the matrices solved are more than the rounding of what made them.

    They are not where a determinant changes its sign, or jumps because other pivots were taken.
    A right-hand side of zeros has the same solution in every copy, and would not tell.
    """
    key = (formulation.key, pivoted)
    here = at.solves[key]
    for name, solve in perturbed_samples(at, coordinates)[0].batch.solves[key].items():
        signs, logs = solve.sign[:SAMPLES], solve.log_determinant[:SAMPLES]
        changes = np.abs(logs - here[name].log_determinant) * np.log(2.0)
        told = (signs == here[name].sign) & (allowed_error(changes / STEP) <= INCONCLUSIVE)
        if not told.all():
            return False
    return True
