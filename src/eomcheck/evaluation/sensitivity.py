"""How far rounding can go: copies of an evaluation in which every number is perturbed.

A perturbed copy computes the same quantities, but each number that is read and the result of each
operation is changed by a random share of a small step. What comes of that, per step, is κ · scale:
how strongly rounding can change a quantity (`eomcheck.evaluation.tolerance`).
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from typing import Any

import numpy as np
from scipy.linalg import qr, solve_triangular

from eomcheck.errors import RefusedError
from eomcheck.evaluation.doubles import Evaluation, Key, violation
from eomcheck.evaluation.point import quantity
from eomcheck.evaluation.tolerance import INCONCLUSIVE, UNDERFLOW, allowed_error, largest
from eomcheck.formulations import Formulation, Partition
from eomcheck.kernels.moved import Moves
from eomcheck.mechanics.records import Terms
from eomcheck.numbers.contract import Arithmetic, Array
from eomcheck.numbers.float64 import FLOAT64
from eomcheck.numbers.linear import Watch, watching
from eomcheck.numbers.noise import SAMPLES, STEP, STRETCH, Noise, Noisy

NOISY = 2.0**-12
"""A change by this share of a solution, at so small a step, asks whether anything is left of it."""

MOVES = Moves()
"""What has been listed of functions of scenes and formulations."""

SLIP = 4.0
"""Steps by which v violates each constraint: changes may be half a step and cancel between rows,
where the v that is looked at violates all by what is allowed, and with the worst signs."""


class Perturbed(Evaluation):
    """A copy of an evaluation in which every number is perturbed.

    Args:
        original: the evaluation.
        noise: what its numbers are changed by.
        coordinates: whether the coordinates are perturbed too.
    """

    def __init__(self, original: Evaluation, noise: Noise, coordinates: bool):
        with noise.stream("state"):
            q = noise.entries(original.q) if coordinates else original.q
            v = original.v + _change_of_velocity(original, noise)
        super().__init__(original.scene, q, v, original.t)
        self._original, self._noise = original, noise

    def computing(self, name: str) -> AbstractContextManager:
        """Return the context in which noise is that of what is called `name`, from its start."""
        return self._noise.stream(name)

    def call(self, function: Callable, *arguments) -> Any:
        """Call a generic function, each of its operations perturbed.

        Where it does more than rational operations, only what it reads and returns is perturbed.
        """
        with np.errstate(all="ignore"):
            with suppress(TypeError):
                return MOVES.run(self._noise, function, *arguments)
            return function(*arguments)

    def keep(self, record: Any) -> Any:
        """Return `record`, perturbed."""
        return self._noise.record(record)

    @property
    def preparing(self) -> Arithmetic:
        """What prepares: cosines, sines and roots are perturbed as well."""
        return Noisy(FLOAT64, self._noise)

    @quantity
    def terms(self) -> Terms:
        """M, Q, B, a, gamma, b; body Jacobians that they are composed of are perturbed too."""
        scene = self.scene
        if "terms" not in scene.composed:
            return super().terms
        # Where inertia forces cancel in B, only this shows what rounding has done to them.
        here = self.parameters, self.prepared, self.q, self.v
        jacobians = self.keep(self.call(scene.jacobians, *here))
        return self.keep(self.call(scene.assemble, *here, jacobians))

    def watched(self, key: Key | None = None) -> AbstractContextManager[Watch]:
        """Watch the matrices that are solved, and perturb them; pivots stay the original's."""
        return watching(self._noise, self._original.solves.get(key) if key else None)

    @quantity
    def pivoted_partition(self) -> Partition:
        """That of the original."""
        return self._original.pivoted_partition

    def check_finite(
        self, vdot: Array, multipliers: Array | None, formulation: Formulation
    ) -> None:
        """Let everything pass: what is not finite makes a sensitivity infinite."""


def _change_of_velocity(at: Evaluation, noise: Noise) -> Array:
    """Return changes of v: of its entries, and within what `check_consistent` lets pass."""
    change = noise.entries(at.v) - at.v
    if at.terms.a is None:
        return change
    allowed = at.kept(allowed_violation)
    residual = allowed / allowed_error(1.0) * SLIP * noise.changes((at.scene.r,))
    Q, R = at.kept(_constraint_factors)
    with np.errstate(all="ignore"):
        try:
            slip = Q @ solve_triangular(R, residual, trans=1, check_finite=False)
        except np.linalg.LinAlgError:  # dependent constraints
            return change
    return change + slip if np.isfinite(slip).all() else change


def allowed_violation(at: Evaluation) -> Array:
    """Return how large |a v + b| (r,) may be by rounding alone, m/s, at an `at` with constraints.

    C ε (|a| |v| + |b|), and where that does not explain it, with the largest change of a and b
    besides that rounding the coordinates makes: a row of nothing but cos(π/2) has no size itself.
    """
    residual, allowed = violation(at, at.v)
    if (np.abs(residual) <= allowed).all():
        return allowed
    (_, _, _, a, _, b), changes = at.terms, [np.zeros_like(allowed)]
    for seed in range(SAMPLES):
        q = Noise(seed).entries(at.q)
        near = Evaluation(at.scene, q, at.v, at.t).terms
        change = np.abs(near.a - a) @ np.abs(at.v)
        changes.append(change if b is None else change + np.abs(near.b - b))
    return allowed + allowed_error(1.0) * np.max(changes, axis=0) / STEP


def _constraint_factors(at: Evaluation) -> Any:
    """Return Q (n, r) and R (r, r) with aᵀ = Q R."""
    return qr(at.terms.a.T, mode="economic", check_finite=False)


def _copies(at: Evaluation) -> tuple[Perturbed, ...]:
    return _perturbed(at, coordinates=False)


def _copies_everywhere(at: Evaluation) -> tuple[Perturbed, ...]:
    return _perturbed(at, coordinates=True)


def _perturbed(at: Evaluation, coordinates: bool) -> tuple[Perturbed, ...]:
    noises = (*(Noise(seed) for seed in range(SAMPLES)), Noise(0, STRETCH * STEP))
    return tuple(Perturbed(at, noise, coordinates) for noise in noises)


def perturbed_copies(at: Evaluation, coordinates: bool = False) -> tuple[Perturbed, ...]:
    """Return copies of `at` with every number perturbed, on request the coordinates as well.

    There are `SAMPLES` by `STEP`, and the first once more by `STRETCH` times as much.

    Our own formulations read one and the same q, so that its rounding is no error of theirs; an
    outside engine forms its own angles from q and rounds them again.
    """
    return at.kept(_copies_everywhere if coordinates else _copies)


def sensitivity_of(
    at: Evaluation,
    quantity: Callable[[Evaluation], Any],
    coordinates: bool = False,
    solved: bool = False,
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
    """
    here = np.asarray(quantity(at))
    size = largest(here)
    with np.errstate(all="ignore"):
        try:
            copies = perturbed_copies(at, coordinates)
            changes = [largest(np.asarray(_of(copy, quantity)) - here) for copy in copies]
        except (RefusedError, np.linalg.LinAlgError):
            return float("inf")
    *changes, stretched = changes
    if np.isinf(stretched):
        return stretched
    # What underflows changes in steps of its own, whatever the noise.
    seen = solved and changes[0] > max(NOISY * size, UNDERFLOW)
    if seen and stretched < STRETCH / 2 * changes[0]:
        return float("inf")
    return size + max(changes) / STEP


def _of(copy: Perturbed, quantity: Callable[[Evaluation], Any]) -> Any:
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
    if rcond and allowed_error(1.0 / min(rcond.values())) > INCONCLUSIVE:
        return float("inf")
    found = sensitivity_of(
        at,
        lambda e: getattr(e.acceleration(formulation, pivoted), part),
        coordinates,
        solved=True,
    )
    if np.isinf(found) or _determined(at, formulation, coordinates, pivoted):
        return found
    return float("inf")


def _determined(at: Evaluation, formulation: Formulation, coordinates: bool, pivoted: bool) -> bool:
    """Return whether the matrices solved are more than the rounding of what made them.

    They are not where a determinant changes its sign, or jumps because other pivots were taken.
    A right-hand side of zeros has the same solution in every copy, and would not tell.
    """
    key = (formulation.key, pivoted)
    here = at.solves[key]
    for copy in perturbed_copies(at, coordinates)[:SAMPLES]:
        for name, solve in copy.solves[key].items():
            change = abs(solve.log_determinant - here[name].log_determinant) * np.log(2.0)
            if solve.sign != here[name].sign or not allowed_error(change / STEP) <= INCONCLUSIVE:
                return False
    return True
