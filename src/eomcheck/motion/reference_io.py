"""Reference solutions on disk: one JSON file each, with all digits of both integrations.

A `ReferenceRun` is the result of one integration, in more digits than float64 holds; a `Reference`
is two of them, whose difference is its uncertainty.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields
from decimal import Decimal, InvalidOperation, localcontext
from pathlib import Path
from typing import Any

import numpy as np

from eomcheck.atomic_write import read_text, write_text
from eomcheck.deprecated import getattr_of
from eomcheck.errors import InputError
from eomcheck.mechanics.scene import Scene
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


def save_reference(reference: Reference, path: Path, **more: Any) -> None:
    """Write `reference` to `path`; the entries `more` are added for human readers.

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
            "kind": scene.key,
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


def load_reference(path: Path | str) -> Reference:
    """Return the reference solution stored in `path`.

    The uncertainty is computed from the two integrations in the file, not read.

    Raises:
        InputError: the file cannot be read or is no reference solution; the message names it.
    """
    try:
        document = json.loads(read_text(Path(path)))
    except OSError as error:
        raise InputError(f"{str(path)!r} cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{str(path)!r} is not JSON: {error}") from None
    try:
        return _reference(document)
    except KeyError as error:
        raise InputError(f"{str(path)!r} is no reference solution: {error} is missing") from None
    except (ArithmeticError, AttributeError, TypeError, ValueError) as error:
        raise InputError(f"{str(path)!r} is no reference solution: {error}") from None


def _reference(document: dict[str, Any]) -> Reference:
    described = document["scene"]
    if described["kind"] not in SCENES:
        raise ValueError(f"no scene of the kind {described['kind']!r}")
    scene = SCENES[described["kind"]](**described["parameters"])
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
    given = np.array(strings, object)
    if given.shape != shape:
        raise ValueError(f"an array of shape {given.shape}, expected {shape}")
    return decimals(given)


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


__getattr__ = getattr_of(__name__)
