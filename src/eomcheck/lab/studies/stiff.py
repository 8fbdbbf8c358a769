"""Stiff joints: what explicit and implicit integrators take to the same error.

Two families of the paper's robot, released from rest, k from 5e3 to 1e10 N m/rad:

- "undamped": springs alone. k only sets the unit of time: q(t) at k is q(t √(k/5000)) at k = 5000,
  so that the stored reference solution, read on another clock, is the true motion at every k.
- "damped": dampers d = τ k with the retardation time τ = 10 ms (Kelvin and Voigt). Joints creep
  with τ at any k, while what they do not agree with dies away at rates that grow with k. Here the
  truth is integrated twice, by the banded formulation and Radau IIA, and by Kane's and an explicit
  method, above k = 1e9, where that would take 10 million steps, by Radau IIA with other steps; what
  they differ by is its uncertainty.

Errors are relative: the largest error of (q, v T) at the end over its largest entry, T the unit of
time of the family.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from eomcheck.errors import EomcheckError, InputError
from eomcheck.formulations import formulation_of, formulations_for
from eomcheck.lab.run_time import run_time
from eomcheck.lab.store.records import Record, Records, run_cells
from eomcheck.motion.integrators import INTEGRATORS
from eomcheck.motion.right_hand_side import exact_jacobian
from eomcheck.motion.simulate import Motion
from eomcheck.motion.stored import load_reference
from eomcheck.numbers.contract import Array
from eomcheck.numbers.pivots import EPS
from eomcheck.scenes import Snake

STUDY, TRUTH = "stiff", "stiff-truth"
REFERENCE = "paper-rest"
SOFTEST = 5e3
"""Stiffness of the paper's robot, N m/rad."""
RETARDATION = 0.01
"""τ of the damped family, s."""
DAMPED_END = 0.02
"""End of the damped motions, s."""
PROBLEMS = ("undamped", "damped")
COMPILED = ("DOP853", "Tsit5", "Radau", "BDF", "LSODA")
EXPLICIT = tuple(key for key in COMPILED if not INTEGRATORS[key].implicit)
IMPLICIT = ("Radau", "BDF")
"""LSODA is neither one nor the other: where nothing is stiff it uses Adams' methods."""
IN_SCIPY = IMPLICIT
JACOBIANS = ("differences", "exact")
MOST_STEPS = 200_000
EXPLICIT_UP_TO = 1e9
"""Largest stiffness at which a true motion is integrated by an explicit method, N m/rad."""
RUNS = 5


@dataclass(frozen=True)
class Plan:
    """What a run of the study covers.

    Attributes:
        stiffnesses: k, N m/rad.
        tolerances: rtol = atol of CyRK's integrators.
        in_scipy: those of SciPy's, with and without exact Jacobians.
        formulations: keys.
    """

    stiffnesses: tuple[float, ...]
    tolerances: tuple[float, ...]
    in_scipy: tuple[float, ...]
    formulations: tuple[str, ...]


DECADES = (SOFTEST, *(10.0**e for e in range(5, 11)))
FULL = Plan(DECADES, (1e-3, 1e-5, 1e-7, 1e-9), (1e-4, 1e-7), ("kane",))
QUICK = Plan((SOFTEST, 1e6, 1e7), (1e-3, 1e-6, 1e-9), (1e-5,), ("kane",))


def plan(
    quick: bool = False,
    stiffnesses: Iterable[float] | None = None,
    formulations: Iterable[str] | None = None,
) -> Plan:
    """Return the full or quick plan with other stiffnesses or formulations.

    Raises:
        InputError: a stiffness that is not positive.
        UnknownNameError: no such formulation.
    """
    chosen = QUICK if quick else FULL
    if stiffnesses:
        for k in stiffnesses:
            if not (k > 0 and math.isfinite(k)):
                raise InputError(f"stiffness = {k!r}, expected a positive number, N m/rad")
        chosen = replace(chosen, stiffnesses=tuple(stiffnesses))
    if formulations:
        keys = tuple(f.key for f in formulations_for(Snake, formulations))
        chosen = replace(chosen, formulations=keys)
    return chosen


def scene_of(problem: str, stiffness: float) -> Snake:
    """Return the paper's robot with joints of this stiffness, damped or not."""
    joints = np.full(6, stiffness)
    damping = RETARDATION * joints if problem == "damped" else None
    return replace(Snake.paper(), stiffness=joints, damping=damping)


def unit_of_time(problem: str, stiffness: float) -> float:
    """Return T, s: √(5000/k) of the undamped family, otherwise 1."""
    return math.sqrt(SOFTEST / stiffness) if problem == "undamped" else 1.0


def end_of(problem: str, stiffness: float) -> float:
    """Return the end of the motion, s."""
    return unit_of_time(problem, stiffness) if problem == "undamped" else DAMPED_END


def measure(planned: Plan, records: Records, folder: Path, fresh: bool = False) -> list[Record]:
    """Measure every cell that is not in `records` yet, truths first; return the Records of all.

    Args:
        planned: what to cover.
        records: where they are kept.
        folder: of the reference solutions.
        fresh: measure everything anew.
    """
    cells = [{"stiffness": k} for k in planned.stiffnesses]
    truths = run_cells(records, TRUTH, cells, _damped_truth, fresh=fresh, label="true motions")
    work = _Worker(truths, folder)
    found = run_cells(records, STUDY, list(_cells(planned)), work, fresh=fresh, label="integrating")
    return [*truths, *found]


def _cells(planned: Plan) -> Iterator[dict[str, Any]]:
    for problem, key, k in product(PROBLEMS, planned.formulations, planned.stiffnesses):
        shared = {"problem": problem, "formulation": key, "stiffness": k}
        for integrator, tolerance in product(COMPILED, planned.tolerances):
            yield shared | {"integrator": integrator, "jacobian": None, "tolerance": tolerance}
        if problem == "damped" and key == "kane":
            for integrator, jacobian, tolerance in product(IN_SCIPY, JACOBIANS, planned.in_scipy):
                how = {"integrator": integrator, "jacobian": jacobian, "tolerance": tolerance}
                yield shared | how


# ---- The truth -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Truth:
    """The state at the end.

    Attributes:
        state: (q, v T) (2n,).
        uncertainty: relative.
    """

    state: Array
    uncertainty: float


def _damped_truth(settings: dict[str, Any]) -> Record:
    """Integrate a damped motion twice."""
    scene = scene_of("damped", settings["stiffness"])
    first = _end_state(scene, "banded", "Radau", 1e-12)
    explicit = settings["stiffness"] <= EXPLICIT_UP_TO
    second = _end_state(scene, "kane", *(("DOP853", 1e-13) if explicit else ("Radau", 1e-11)))
    apart = float(np.abs(first - second).max() / np.abs(first).max())
    return Record(
        TRUTH,
        settings,
        errors={"uncertainty": apart + 2 * EPS},
        series={"state": (second if explicit else first).tolist()},
    )


def _end_state(scene: Snake, key: str, integrator: str, tolerance: float) -> Array:
    motion = Motion(scene, formulation_of(key), *scene.initial_state())
    end = np.array([DAMPED_END])
    options = {"rtol": tolerance, "atol": tolerance, "output_times": end, "max_steps": 0}
    found = motion.solve(DAMPED_END, integrator=integrator, **options)
    if not found.success:
        raise EomcheckError(f"{key} with {integrator} fails: {found.message}")
    return np.concatenate(motion.split(found.y[-1]))


def scaled_truth(folder: Path) -> Truth:
    """Return the true end of every undamped motion, in units of its own time."""
    reference = load_reference(folder / f"{REFERENCE}.json")
    q, v = reference.q[-1], reference.v[-1]
    state = np.concatenate((q, v))
    # √(5000/k) is rounded twice, and with it the end.
    moved = 2 * EPS * float(np.abs(v).max())
    known = reference.uncertainty + reference.rounding + moved
    return Truth(state, known / float(np.abs(state).max()))


# ---- One cell ------------------------------------------------------------------------------------


class _Worker:
    def __init__(self, truths: Sequence[Record], folder: Path):
        self._damped = {r.settings["stiffness"]: r for r in truths}
        self._folder = folder
        self._motion = cache(self._prepared)
        self._scaled = cache(scaled_truth)

    def _prepared(self, problem: str, stiffness: float, key: str) -> tuple[Motion, float]:
        start = time.perf_counter()
        scene = scene_of(problem, stiffness)
        motion = Motion(scene, formulation_of(key), *scene.initial_state())
        return motion, time.perf_counter() - start

    def _truth(self, problem: str, stiffness: float) -> Truth:
        if problem == "undamped":
            return self._scaled(self._folder)
        record = self._damped[stiffness]
        if record.status != "done":
            raise EomcheckError(f"the true motion is not known: {record.reason}")
        return Truth(np.array(record.series["state"]), record.errors["uncertainty"])

    def __call__(self, settings: dict[str, Any]) -> Record:
        problem, k = settings["problem"], settings["stiffness"]
        motion, compile_seconds = self._motion(problem, k, settings["formulation"])
        truth = self._truth(problem, k)
        solve = _by_cyrk if settings["jacobian"] is None else _in_scipy
        found = solve(motion, end_of(problem, k), settings)
        counts = {"right-hand sides": motion.rates.calls, **found.counts}
        if found.state is None:
            return Record(STUDY, settings, "failed", found.reason, counts=counts)
        q, v = motion.split(found.state)
        state = np.concatenate((q, v * unit_of_time(problem, k)))
        error = float(np.abs(state - truth.state).max() / np.abs(truth.state).max())
        taken = run_time(lambda: solve(motion, end_of(problem, k), settings), runs=RUNS)
        return Record(
            STUDY,
            settings,
            **taken.recorded(),
            compile_seconds=compile_seconds,
            counts=counts,
            errors={"final": error, "floor": truth.uncertainty},
        )


@dataclass(frozen=True)
class _Found:
    state: Array | None
    reason: str
    counts: dict[str, int]


def _by_cyrk(motion: Motion, end: float, settings: dict[str, Any]) -> _Found:
    tolerance = settings["tolerance"]
    found = motion.solve(
        end,
        integrator=settings["integrator"],
        rtol=tolerance,
        atol=tolerance,
        output_times=np.array([end]),
        max_steps=MOST_STEPS,
    )
    state = found.y[-1] if found.success and np.isfinite(found.y).all() else None
    return _Found(state, found.message, {"steps": found.steps})


def _in_scipy(motion: Motion, end: float, settings: dict[str, Any]) -> _Found:
    """Integrate by SciPy, whose right-hand side is the same."""
    motion.rates.reset()
    exact = settings["jacobian"] == "exact"
    # Its differences for the Jacobian try larger and larger changes of what does not matter.
    with np.errstate(over="ignore"):
        found = solve_ivp(
            motion.rates,
            (0.0, end),
            motion.y0,
            settings["integrator"],
            t_eval=[end],
            rtol=settings["tolerance"],
            atol=settings["tolerance"],
            jac=_jacobian_of(motion.scene, motion.formulation) if exact else None,
        )
    counts = {"jacobians": found.njev, "factorizations": found.nlu}
    return _Found(found.y[:, -1] if found.success else None, found.message, counts)


_jacobian_of = cache(exact_jacobian)
"""Of one scene and formulation, made once."""


# ---- What follows from the Records ---------------------------------------------------------------


def runs_of(records: Iterable[Record], **settings: Any) -> list[Record]:
    """Return the finished runs of the study with these settings."""
    return [
        r
        for r in records
        if r.study == STUDY and r.seconds is not None and settings.items() <= r.settings.items()
    ]


def cheapest(
    records: Iterable[Record], target: float, integrators: Sequence[str], what: str = "seconds"
) -> Record | None:
    """Return the run whose error is at most `target` that is cheapest; None if there is none.

    Args:
        records: runs.
        target: largest relative error.
        integrators: keys that are looked at.
        what: "seconds" or "right-hand sides".
    """
    good = [
        r
        for r in runs_of(records, jacobian=None)
        if r.settings["integrator"] in integrators and r.errors["final"] <= target
    ]
    return min(good, key=lambda r: cost(r, what), default=None)


def cost(record: Record, what: str = "seconds") -> float:
    """Return what a run took: CPU time of the best run, s, or a count.

    CPU time is compared, not run time, for it does not tell what else ran on the machine.
    """
    return (record.cpu_seconds or 0.0) if what == "seconds" else float(record.counts[what])


def crossover(
    records: Iterable[Record], target: float, problem: str, key: str, what: str = "seconds"
) -> float | None:
    """Return the stiffness from which on implicit integrators are the cheaper ones, N m/rad.

    Interpolated in logarithms between the two stiffnesses where the ratio of the best of both kinds
    passes 1; None where explicit ones remain cheaper up to the largest. Where none of the explicit
    ones gets there, the implicit ones count as cheaper.
    """
    mine = runs_of(records, problem=problem, formulation=key)
    ratios: list[tuple[float, float]] = []
    for k in sorted({r.settings["stiffness"] for r in mine}):
        here = [r for r in mine if r.settings["stiffness"] == k]
        explicit, implicit = (cheapest(here, target, kind, what) for kind in (EXPLICIT, IMPLICIT))
        if implicit is None:
            continue
        ratio = math.inf if explicit is None else cost(explicit, what) / cost(implicit, what)
        ratios.append((k, ratio))
    for place, (k, ratio) in enumerate(ratios):
        if ratio > 1 and all(later > 1 for _, later in ratios[place:]):
            if place == 0 or math.isinf(ratio):
                return k
            before_k, before = ratios[place - 1]
            share = math.log(1 / before) / math.log(ratio / before)
            return before_k * (k / before_k) ** share
    return None
