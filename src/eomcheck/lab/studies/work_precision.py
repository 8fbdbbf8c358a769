"""Error against run time: formulations × integrators × tolerances × scenes, data first.

Each cell is one Record. Errors are those against a stored reference solution at its output times;
run times are those of the integration alone, in machine code and warm.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

from eomcheck.errors import InputError
from eomcheck.evaluation.dynamics import velocity
from eomcheck.formulations import FORMULATIONS, applicable, formulation_of, formulations_for
from eomcheck.lab.run_time import RUNS, run_time
from eomcheck.lab.store.records import Record, Records, run_cells
from eomcheck.motion.errors import constraint_drift, energy_drift, errors_of
from eomcheck.motion.integrators import INTEGRATORS, integrator_of
from eomcheck.motion.motion import Motion
from eomcheck.motion.simulate import simulate
from eomcheck.motion.stored import Reference, load_reference
from eomcheck.motion.trajectory import Trajectory

STUDY = "work-precision"
TOLERANCES = tuple(10.0**-k for k in range(3, 14, 2))
TARGETS = (1e-3, 1e-6, 1e-9)
"""Errors of the end state whose run times are compared."""


@dataclass(frozen=True)
class Plan:
    """What a run of the study covers.

    Attributes:
        references: files of reference solutions, which name scene, start and output times.
        formulations: keys.
        integrators: keys.
        tolerances: rtol = atol.
    """

    references: tuple[Path, ...]
    formulations: tuple[str, ...]
    integrators: tuple[str, ...]
    tolerances: tuple[float, ...]


def plan(
    folder: Path,
    references: Iterable[str] | None = None,
    formulations: Iterable[str] | None = None,
    integrators: Iterable[str] | None = None,
    tolerances: Iterable[float] | None = None,
) -> Plan:
    """Return a plan; what is None is taken whole, of references the paper's robot at rest.

    Raises:
        InputError: no such reference, a formulation that does not apply to its scene, a tolerance
            that is not in (0, 1).
        UnknownNameError: no such formulation or integrator.
    """
    names = ("paper-rest",) if references is None else tuple(references)
    files = tuple(folder / f"{name}.json" for name in names)
    keys = tuple(formulations) if formulations else None
    for file in files:
        formulations_for(load_reference(file).scene, keys)
    chosen = TOLERANCES if tolerances is None else tuple(tolerances)
    for tolerance in chosen:
        if not 0 < tolerance < 1:
            raise InputError(f"tolerance = {tolerance!r}, expected a number between 0 and 1")
    return Plan(
        files,
        tuple(dict.fromkeys(keys or FORMULATIONS)),
        tuple(integrator_of(key).key for key in (integrators or INTEGRATORS)),
        chosen,
    )


def measure(planned: Plan, records: Records, fresh: bool = False) -> list[Record]:
    """Measure every cell that is not in `records` yet, and return the Records of all."""
    return run_cells(
        records, STUDY, list(_cells(planned)), _Worker(planned), fresh=fresh, label="measuring"
    )


def _cells(planned: Plan) -> Iterator[dict[str, Any]]:
    # Tolerances innermost: the code made for the first one serves the others.
    for file in planned.references:
        known = applicable(load_reference(file).scene)
        keys = (key for key in planned.formulations if key in known)
        for key, integrator, tolerance in product(keys, planned.integrators, planned.tolerances):
            yield {
                "reference": file.stem,
                "formulation": key,
                "integrator": integrator,
                "tolerance": tolerance,
            }


class _Worker:
    def __init__(self, planned: Plan):
        self._files = {file.stem: file for file in planned.references}
        self._motion = cache(self._prepared)

    def _prepared(self, name: str, key: str) -> tuple[Reference, Motion, float]:
        """Return the reference, the motion and the seconds that making its code took."""
        reference = load_reference(self._files[name])
        start = time.perf_counter()
        scene, q0, u0 = reference.scene, reference.q0, reference.u0
        motion = Motion(scene, formulation_of(key), q0, velocity(scene, q0, u0), u0)
        return reference, motion, time.perf_counter() - start

    def __call__(self, settings: dict[str, Any]) -> Record:
        name, key = settings["reference"], settings["formulation"]
        reference, motion, compile_seconds = self._motion(name, key)
        end, tolerance = float(reference.times[-1]), settings["tolerance"]
        options = {
            "integrator": settings["integrator"],
            "rtol": tolerance,
            "atol": tolerance,
        }
        found = simulate(
            reference.scene,
            key,
            end,
            q0=reference.q0,
            u0=reference.u0,
            output_times=reference.times,
            **options,
        )
        counts = {"right-hand sides": found.right_hand_sides, "steps": found.steps}
        if found.status != "finished":
            return Record(STUDY, settings, "failed", found.reason, counts=counts)
        taken = run_time(
            lambda: motion.solve(end, output_times=reference.times, **options), runs=RUNS
        )
        return Record(
            STUDY,
            settings,
            **taken.recorded(),
            compile_seconds=compile_seconds,
            counts=counts,
            errors=asdict(errors_of(found, reference)) | _drifts(found),
        )


def _drifts(found: Trajectory) -> dict[str, float]:
    drifts = {"constraint": constraint_drift(found), "energy": energy_drift(found)}
    errors: dict[str, float] = {}
    for name, drift in drifts.items():
        if drift is not None:
            errors |= {f"{name}_drift": drift.rate, f"{name}_exponent": drift.exponent}
    return errors


# ---- What follows from the Records ---------------------------------------------------------------


def finished(records: Iterable[Record]) -> list[Record]:
    """Return the Records that have a run time."""
    return [record for record in records if record.seconds is not None]


def fastest_to(records: Iterable[Record], target: float) -> dict[tuple[str, str], Record]:
    """Return, per (formulation, integrator), the fastest Record whose final error is <= target."""
    best: dict[tuple[str, str], Record] = {}
    for record in finished(records):
        key = record.settings["formulation"], record.settings["integrator"]
        if record.errors["final"] <= target and _faster(record, best.get(key)):
            best[key] = record
    return best


def _faster(record: Record, than: Record | None) -> bool:
    return than is None or (record.seconds or 0.0) < (than.seconds or 0.0)


def most_accurate(records: Iterable[Record]) -> dict[str, Record]:
    """Return, per formulation, the Record with the smallest final error."""
    best: dict[str, Record] = {}
    for record in finished(records):
        than = best.get(record.settings["formulation"])
        if than is None or record.errors["final"] < than.errors["final"]:
            best[record.settings["formulation"]] = record
    return best


def pareto_front(records: Iterable[Record]) -> list[Record]:
    """Return the Records than which no other is both faster and more accurate, fastest first."""
    front: list[Record] = []
    for record in sorted(finished(records), key=lambda r: (r.seconds, r.errors["final"])):
        if not front or record.errors["final"] < front[-1].errors["final"]:
            front.append(record)
    return front


def summary(records: Iterable[Record]) -> str:
    """Return one paragraph made from the numbers of one scene."""
    records = list(records)
    done = finished(records)
    sentences = [f"{len(done)} of {len(records)} runs finished."]
    for target in TARGETS:
        best = fastest_to(records, target)
        if not best:
            sentences.append(f"None reaches an error of {target:.0e}.")
            continue
        (key, integrator), first = min(best.items(), key=lambda item: item[1].seconds or 0.0)
        by_formulation: dict[str, float] = {}
        for (formulation, _), record in best.items():
            seconds = record.seconds or 0.0
            by_formulation[formulation] = min(by_formulation.get(formulation, seconds), seconds)
        said = (
            f"An error of {target:.0e} is reached first by {key} with {integrator} in "
            f"{1e3 * (first.seconds or 0.0):.3g} ms"
        )
        slowest = max(by_formulation, key=by_formulation.__getitem__)
        if slowest != key:
            ratio = by_formulation[slowest] / (first.seconds or 1.0)
            said += (
                f"; the slowest formulation, {slowest}, takes {ratio:.3g} times as long with its "
                "best integrator"
            )
        sentences.append(said + ".")
    return " ".join(sentences)
