"""Errors of a trajectory: against a reference solution, in energy and in the constraints."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from eomcheck.deprecated import getattr_of
from eomcheck.errors import InputError
from eomcheck.formulations import formulation_of
from eomcheck.mechanics.scene import Scene
from eomcheck.motion.reference_io import Reference
from eomcheck.motion.simulate import Trajectory
from eomcheck.numbers.generic import Array


def constraint_error(trajectory: Trajectory) -> Array:
    """Return ‖c‖₂ at each time (k,), m/s (Eq. (30)); 0 without constraints."""
    residual = trajectory.constraint_residual
    return np.zeros(len(trajectory.times)) if residual is None else np.linalg.norm(residual, axis=1)


def energy_error(trajectory: Trajectory) -> Array:
    """Return the energy error T + U - E_0 at each time (k,), J (Eq. (31)).

    Raises:
        InputError: the scene does not conserve its energy, so that this is no error.
    """
    if not trajectory.scene.conserves_energy:
        raise InputError(f"{trajectory.scene.name} has no energy error: {_loss(trajectory.scene)}")
    return trajectory.energy - trajectory.energy[0]


def error_norm(errors: Array) -> float:
    """Return the Euclidean norm of errors at several times (Eqs. (32)-(33))."""
    return float(np.sqrt((np.asarray(errors) ** 2).sum()))


@dataclass(frozen=True)
class Drift:
    """A law of growth of an error with time t, up to the end T: |error| ≈ rate T (t/T)^exponent.

    Attributes:
        rate: value of the law at the end over T, unit of the error per s.
        exponent: 1 grows in proportion to time, less than 1 levels off, more grows ever faster.
    """

    rate: float
    exponent: float


FEWEST = 4
"""Least number of errors that a law is fitted to."""


def drift_of(times: Array, errors: Array) -> Drift | None:
    """Return the law of growth of errors (k,) over times (k,), s; None for fewer than `FEWEST`.

    The exponent is the median slope between any two points in logarithms (Theil and Sen), the rate
    that of the line with the median residual. Least squares would be dominated by single times with
    a bad interpolation between two steps, and by the earliest times, which are outliers in
    logarithms. Times and errors that are 0 have no logarithm and are left out.
    """
    times, errors = np.asarray(times), np.abs(errors)
    seen = (times > 0) & (errors > 0)
    if np.count_nonzero(seen) < FEWEST:
        return None
    x, y = np.log(times[seen] / times[-1]), np.log(errors[seen])
    i, j = np.triu_indices(x.size, 1)
    exponent = np.median((y[j] - y[i]) / (x[j] - x[i]))
    at_end = np.median(y - exponent * x)
    return Drift(float(np.exp(at_end) / times[-1]), float(exponent))


def constraint_error_drift(trajectory: Trajectory) -> Drift | None:
    """Return the law of growth of ‖c‖₂, m/s per s; None if the motion cannot leave a v + b = 0.

    Formulations whose constraints enter at acceleration level drift: they only enforce that the
    rate of c is 0, so that every error of a step persists. The others cannot leave the constraints
    by more than rounding.
    """
    if formulation_of(trajectory.key).level == "velocity":
        return None
    return drift_of(trajectory.times, constraint_error(trajectory))


def energy_error_drift(trajectory: Trajectory) -> Drift | None:
    """Return the law of growth of |T + U - E_0| over the largest |T + U|, per s.

    None if the energy is not conserved.
    """
    if not trajectory.scene.conserves_energy:
        return None
    scale = np.abs(trajectory.energy).max()
    return drift_of(trajectory.times, energy_error(trajectory) / (scale if scale > 0 else 1.0))


@dataclass(frozen=True)
class Errors:
    """Errors of a trajectory. Norms of a state (q, v) are its largest entry, SI units.

    Attributes:
        final: error of the state at the end.
        largest: largest error of the state over the output times.
        final_relative: `final` over the largest entry of the true state at the end.
        largest_relative: `largest` over the largest entry of the true states.
        mescd: mixed-error significant correct digits at the end,
            -log10 max |error_i| / (atol/rtol + |true_i|).
        energy: largest |T + U - E_0| over the largest |T + U|; NaN where energy is not conserved.
        constraint: largest ‖c‖₂, m/s; NaN without constraints.
        floor: sum of the reference's float64 rounding error and its uncertainty: smaller errors
            are not significant.
    """

    final: float
    largest: float
    final_relative: float
    largest_relative: float
    mescd: float
    energy: float
    constraint: float
    floor: float


def errors_of(trajectory: Trajectory, reference: Reference) -> Errors:
    """Return the errors of a trajectory whose output times are those of the reference.

    Raises:
        InputError: the trajectory did not reach its end, or has other times.
    """
    if trajectory.status != "finished":
        raise InputError(f"the trajectory ended at {_end(trajectory)}: {trajectory.reason}")
    if not np.array_equal(trajectory.times, reference.times):
        raise InputError(f"output times {trajectory.times}, expected those of {reference.name}")
    true = np.hstack((reference.q, reference.v))
    error = np.abs(np.hstack((trajectory.q, trajectory.v)) - true)
    with np.errstate(divide="ignore", invalid="ignore"):
        mixed = error[-1] / (trajectory.atol / trajectory.rtol + np.abs(true[-1]))
        mixed[error[-1] == 0.0] = 0.0
        digits = float(-np.log10(mixed.max()))
    return Errors(
        float(error[-1].max()),
        float(error.max()),
        _relative(error[-1].max(), np.abs(true[-1]).max()),
        _relative(error.max(), np.abs(true).max()),
        digits,
        _largest_energy_error(trajectory),
        float(constraint_error(trajectory).max()) if trajectory.scene.r else math.nan,
        reference.uncertainty + reference.rounding,
    )


def _largest_energy_error(trajectory: Trajectory) -> float:
    if not trajectory.scene.conserves_energy:
        return math.nan
    return _relative(np.abs(energy_error(trajectory)).max(), np.abs(trajectory.energy).max())


def _relative(error: float, top: float) -> float:
    """Return the error over the largest true number; 0 or infinite where all are 0."""
    return float(error / top) if top > 0 else (0.0 if error == 0 else math.inf)


def _loss(scene: Scene) -> str:
    return scene.why_not_conserved or "its energy changes"


def _end(trajectory: Trajectory) -> str:
    return f"t = {trajectory.times[-1]:g} s" if len(trajectory.times) else "its start"


__getattr__ = getattr_of(__name__)
