"""Reference solutions, one JSON file each, and errors of trajectories against them.

A `ReferenceRun` is the result of one integration, in more digits than float64 holds; a `Reference`
is two of them, whose difference is its uncertainty. `Errors` of a trajectory are those against a
reference, in energy and in the constraints.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from decimal import Decimal, InvalidOperation, localcontext
from pathlib import Path
from typing import Any

import numpy as np

from eomcheck.atomic_write import read_as, write_text
from eomcheck.deprecated import getattr_of
from eomcheck.errors import InputError
from eomcheck.formulations import formulation_of
from eomcheck.mechanics.scene import Scene
from eomcheck.motion.simulate import Trajectory
from eomcheck.numbers.generic import Array
from eomcheck.scenes import SCENES

# ---- Integrations in many digits -----------------------------------------------------------------

DIGITS = 36
"""Number of stored significant decimal digits, that of quad precision."""


@dataclass(frozen=True)
class ReferenceRun:
    """The result of one integration; its numbers are of the type `finite_number.Decimal`.

    Attributes:
        times: output times (k,), s, float64.
        q: coordinates (k, n).
        v: velocities (k, n).
        energy: T + U (k,), J; None if the scene does not conserve it.
        drift: largest |E - E_0| / |E_0| over all steps, not only at the output times; None
            without energy.
        facts: method, library, precision, orders, steps, seconds.
    """

    times: list[float]
    q: Array
    v: Array
    energy: Array | None
    drift: float | None
    facts: dict[str, Any]


def decimals(x: Array) -> Array:
    """Return decimal strings x as finite `finite_number.Decimal`s, same shape.

    Raises:
        ValueError: one is no finite number.
    """
    out = np.empty(x.shape, object)
    with localcontext(prec=DIGITS):
        try:
            out.ravel()[:] = [+Decimal(y) for y in x.ravel()]
        except (InvalidOperation, TypeError):
            raise ValueError("not all numbers are strings of digits") from None
    if not all(y.is_finite() for y in out.ravel()):
        raise ValueError("not all numbers are finite")
    return out


def difference(one: ReferenceRun, other: ReferenceRun) -> list[float]:
    """Return the largest |difference| over q and v at each time, in their own units.

    Raises:
        InputError: the runs are of different times or sizes.
    """
    if one.times != other.times or one.q.shape != other.q.shape:
        raise InputError("the two runs differ in their times or in their number of coordinates")
    with localcontext(prec=DIGITS + 5):
        apart = np.abs(np.hstack((one.q - other.q, one.v - other.v)))
    return [float(row.max()) for row in apart]


# ---- References ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Reference:
    """A motion known to more digits than float64 holds, with its uncertainty.

    Attributes:
        name: its name, that of its file.
        description: scene and start, as text.
        scene: the scene.
        q0: coordinates at times[0] (n,), m and rad.
        u0: generalized speeds at times[0] (p,).
        times: output times (k,), s.
        q: coordinates (k, n), rounded to float64.
        v: velocities (k, n), rounded to float64.
        differences: largest |difference| of the two integrations over q and v, at each time (k,).
        runs: the integrations, all digits: Taylor series first, from which q and v are taken.
        check: the Taylor series again, with shorter steps, and the resulting change.
    """

    name: str
    description: str
    scene: Scene
    q0: Array
    u0: Array
    times: Array
    q: Array
    v: Array
    differences: Array
    runs: tuple[ReferenceRun, ReferenceRun]
    check: Mapping[str, Any]

    @property
    def uncertainty(self) -> float:
        """The largest of `differences`; smaller errors against this reference mean nothing."""
        return float(self.differences.max())

    @property
    def rounding(self) -> float:
        """Bound on the rounding error of q and v in float64."""
        return float(max(np.spacing(np.abs(x)).max() for x in (self.q, self.v)) / 2)


def reference_from_runs(
    name: str,
    description: str,
    scene: Scene,
    q0,
    u0,
    runs: tuple[ReferenceRun, ReferenceRun],
    check: dict,
) -> Reference:
    """Return the `Reference` of two integrations.

    Raises:
        InputError: they have different times or sizes.
    """
    first = runs[0]
    return Reference(
        name,
        description,
        scene,
        np.array(q0, float),
        np.array(u0, float),
        np.array(first.times),
        first.q.astype(float),
        first.v.astype(float),
        np.array(difference(*runs)),
        runs,
        check,
    )


def save_reference(reference: Reference, path: Path, kind: str = "", **more: Any) -> None:
    """Write `reference` to `path`; the entries `more` are added for human readers.

    Args:
        reference: the reference.
        path: the file.
        kind: name of its scene class, by default its key.
        more: further entries.

    Raises:
        InputError: the file cannot be written.
    """
    scene = reference.scene
    parameters = {field.name: getattr(scene, field.name) for field in fields(scene)}  # type: ignore[arg-type]
    document = {
        "name": reference.name,
        "description": reference.description,
        **more,
        "scene": {
            "kind": kind or scene.key,
            "python": repr(scene),
            "parameters": {k: None if x is None else x.tolist() for k, x in parameters.items()},
        },
        "q0": reference.q0.tolist(),
        "u0": reference.u0.tolist(),
        "times": reference.times.tolist(),
        "uncertainty": reference.uncertainty,
        "differences": reference.differences.tolist(),
        "check": dict(reference.check),
        "runs": [
            {
                **run.facts,
                "energy_drift": run.drift,
                "energy": None if run.energy is None else _strings(run.energy),
                "q": _strings(run.q),
                "v": _strings(run.v),
            }
            for run in reference.runs
        ],
    }
    write_text(path, _text(document) + "\n")


def load_reference(path: Path | str, kind: type[Scene] | None = None) -> Reference:
    """Return the reference solution stored in `path`.

    The uncertainty is computed from the two integrations in the file, not read.

    Args:
        path: the file.
        kind: scene class of a file about one that is not built in. None is imported by its name.

    Raises:
        InputError: the file cannot be read or is no reference solution, or of another scene class;
            the message names it.
    """
    document = read_as(Path(path), "JSON", json.loads)
    try:
        return _reference(document, kind)
    except KeyError as error:
        raise InputError(f"{str(path)!r} is no reference solution: {error} is missing") from None
    except (ArithmeticError, AttributeError, TypeError, ValueError) as error:
        raise InputError(f"{str(path)!r} is no reference solution: {error}") from None


def _reference(document: dict[str, Any], kind: type[Scene] | None) -> Reference:
    described = document["scene"]
    name, own = described["kind"], kind
    if name in SCENES:
        own = SCENES[name]
    elif own is None:
        raise ValueError(f"no scene of the kind {name!r} is built in: name it by --scene {name}")
    elif {*described["parameters"]} != {field.name for field in fields(own)}:  # type: ignore[arg-type]
        raise ValueError(f"its parameters are those of {name!r}, not of {own.key}")
    scene = own(**described["parameters"])
    q0, u0, times = (np.array(document[name], float) for name in ("q0", "u0", "times"))
    if q0.shape != (scene.n,) or u0.shape != (scene.p,):
        raise ValueError(f"q0 and u0 have shapes {q0.shape} and {u0.shape}")
    if times.ndim != 1 or times.size < 2 or not (np.diff(times) > 0.0).all():
        raise ValueError(f"times = {times.tolist()!r}, expected at least two times that rise")
    first, second = (_run(run, times, scene) for run in document["runs"])
    reference = reference_from_runs(
        str(document["name"]),
        str(document["description"]),
        scene,
        q0,
        u0,
        (first, second),
        dict(document["check"]),
    )
    if (reference.q[0] != q0).any():
        raise ValueError("its first coordinates are not q0")
    if not np.isclose(reference.uncertainty, document["uncertainty"], rtol=1e-9, atol=0.0):
        raise ValueError(
            f"its uncertainty is given as {document['uncertainty']!r}, but its runs differ by "
            f"{reference.uncertainty!r}"
        )
    return reference


def _run(stored: dict[str, Any], times: Array, scene: Scene) -> ReferenceRun:
    stored = dict(stored)
    shape = (times.size, scene.n)
    q, v = (_numbers(stored.pop(name), shape) for name in ("q", "v"))
    energy, drift = stored.pop("energy"), stored.pop("energy_drift")
    if energy is not None:
        energy, drift = _numbers(energy, shape[:1]), float(drift)
    return ReferenceRun(times.tolist(), q, v, energy, drift, stored)


def _strings(x: Array) -> list:
    return np.vectorize(str, otypes=[object])(x).tolist()


def _numbers(strings: list, shape: tuple[int, ...]) -> Array:
    entries = np.array(strings, object)
    if entries.shape != shape:
        raise ValueError(f"an array of shape {entries.shape}, expected {shape}")
    return decimals(entries)


def _text(document: Any, depth: int = 4) -> str:
    """Return JSON with a line for each entry down to `depth`, and for each row of an array."""
    flat = not isinstance(document, dict | list) or not any(
        isinstance(x, dict | list)
        for x in (document.values() if isinstance(document, dict) else document)
    )
    if flat or depth == 0:
        return json.dumps(document, ensure_ascii=False)
    if isinstance(document, dict):
        inside = [f"{json.dumps(k)}: {_text(x, depth - 1)}" for k, x in document.items()]
        return "{\n" + ",\n".join(inside) + "\n}"
    return "[\n" + ",\n".join(_text(x, depth - 1) for x in document) + "\n]"


# ---- Errors of trajectories ----------------------------------------------------------------------


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
    positive = (times > 0) & (errors > 0)
    if np.count_nonzero(positive) < FEWEST:
        return None
    x, y = np.log(times[positive] / times[-1]), np.log(errors[positive])
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
