"""Long runs: by which laws the errors of constraints and energy grow, and what stops them.

The paper's robot, released from rest, for 1 000 s by every formulation; by those that can leave the
constraints also with Baumgarte's feedback and with projection. Each error is fitted by
rate · T (t/T)^exponent (`eomcheck.motion.errors.drift_of`): exponent 0 levels off, 1/2 is a random
walk, 1 a steady drift.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eomcheck.errors import InputError
from eomcheck.evaluation.doubles import Evaluation
from eomcheck.formulations import formulation_of, formulations_for
from eomcheck.lab.store.records import Record, Records, run_cells
from eomcheck.mechanics.scene import Scene
from eomcheck.motion.errors import constraint_error, drift_of
from eomcheck.motion.simulate import simulate
from eomcheck.numbers.contract import Array
from eomcheck.scenes import Snake

STUDY = "long-run"
FEEDBACK = 10.0
"""Rate of Baumgarte's feedback, 1/s."""
INTERVAL = 1.0
"""Interval of projection, s."""
REMEDIES: dict[str, dict[str, Any]] = {
    "none": {},
    "feedback": {"baumgarte": FEEDBACK},
    "projection": {"projection": INTERVAL},
}
"""Name -> options of `simulate`."""
TOLERANCE = 1e-6
INTEGRATOR = "DOP853"
TIMES = 200
"""Output times, evenly apart in logarithms."""


@dataclass(frozen=True)
class Plan:
    """What a run of the study covers.

    Attributes:
        t_end: end, s.
        tolerance: rtol = atol.
        formulations: keys.
    """

    t_end: float
    tolerance: float
    formulations: tuple[str, ...]


FULL = Plan(1000.0, TOLERANCE, tuple(f.key for f in formulations_for(Snake)))
QUICK = Plan(30.0, TOLERANCE, ("au", "kane"))


def plan(
    quick: bool = False,
    t_end: float | None = None,
    tolerance: float | None = None,
    formulations: Iterable[str] | None = None,
) -> Plan:
    """Return the full or quick plan with what is given changed.

    Raises:
        InputError: an end of 2 s or less, or a tolerance that is not in (0, 1).
        UnknownNameError: no such formulation.
    """
    chosen = QUICK if quick else FULL
    if t_end is not None:
        if not 2 < t_end < np.inf:
            raise InputError(f"t_end = {t_end!r}, expected more than 2 s")
        chosen = replace(chosen, t_end=t_end)
    if tolerance is not None:
        if not 0 < tolerance < 1:
            raise InputError(f"tolerance = {tolerance!r}, expected a number between 0 and 1")
        chosen = replace(chosen, tolerance=tolerance)
    if formulations:
        keys = tuple(f.key for f in formulations_for(Snake, formulations))
        chosen = replace(chosen, formulations=keys)
    return chosen


def measure(planned: Plan, records: Records, fresh: bool = False) -> list[Record]:
    """Measure every cell that is not in `records` yet, and return the Records of all."""
    cells = list(_cells(planned))
    return run_cells(records, STUDY, cells, _long_run, fresh=fresh, label="integrating")


def _cells(planned: Plan) -> Iterator[dict[str, Any]]:
    for remedy in REMEDIES:
        for key in planned.formulations:
            if remedy == "none" or formulation_of(key).level == "acceleration":
                yield {
                    "formulation": key,
                    "remedy": remedy,
                    "t_end": planned.t_end,
                    "tolerance": planned.tolerance,
                }


def output_times(t_end: float) -> Array:
    """Return times from 0.5 s to half an interval of projection before the end, s.

    The velocity has just been projected at whole intervals: there an error is not seen.
    """
    return np.geomspace(0.5, t_end - INTERVAL / 2, TIMES)


def _long_run(settings: dict[str, Any]) -> Record:
    t_end, tolerance = settings["t_end"], settings["tolerance"]
    start = time.thread_time()
    found = simulate(
        Snake.paper(),
        settings["formulation"],
        t_end,
        rtol=tolerance,
        atol=tolerance,
        integrator=INTEGRATOR,
        output_times=output_times(t_end),
        **REMEDIES[settings["remedy"]],
    )
    used = time.thread_time() - start
    times, constraint = found.times, constraint_error(found)
    start_energy = _start_energy(found.scene)
    energy = np.abs(found.energy - start_energy) / start_energy
    errors: dict[str, float] = {}
    for name, error in (("constraint", constraint), ("energy", energy)):
        law = drift_of(times, error) if times.size else None
        if law is not None:
            errors |= {f"{name}_exponent": law.exponent, f"{name}_rate": law.rate}
        if times.size:
            errors |= {f"{name}_end": error[-1], f"{name}_largest": error.max()}
    return Record(
        STUDY,
        settings,
        "done" if found.status == "finished" else "failed",
        found.reason,
        seconds=found.seconds,
        cpu_seconds=min(used, found.seconds),
        runs=1,
        counts={"right-hand sides": found.right_hand_sides, "steps": found.steps},
        errors=errors,
        series={
            "times": times.tolist(),
            "constraint": constraint.tolist(),
            "energy": energy.tolist(),
        },
    )


def _start_energy(scene: Scene) -> float:
    """Return E_0, J: the first output time comes later."""
    at = Evaluation(scene, *scene.initial_state())
    T, U = at.call(scene.energies, at.parameters, at.prepared, at.q, at.v)
    return float(T if U is None else T + U)


def record_of(records: Iterable[Record], key: str, remedy: str) -> Record | None:
    """Return the Record of one formulation and remedy, or None."""
    wanted = {"formulation": key, "remedy": remedy}
    return next((r for r in records if wanted.items() <= r.settings.items()), None)
