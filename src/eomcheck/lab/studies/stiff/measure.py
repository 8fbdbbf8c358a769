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
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from scipy.integrate import solve_ivp

from eomcheck.errors import EomcheckError, InputError
from eomcheck.formulations import formulation_of, formulations_for
from eomcheck.lab.references import stored
from eomcheck.lab.run_time import ready, run_time
from eomcheck.lab.store.record import Record
from eomcheck.lab.store.settings import Settings
from eomcheck.lab.study import REFERENCES, Quick, References, Work
from eomcheck.motion.integrators import INTEGRATORS
from eomcheck.motion.right_hand_side import exact_jacobian
from eomcheck.motion.simulate import Motion
from eomcheck.numbers.generic import Array
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


DECADES = (SOFTEST, *(10.0**e for e in range(5, 11)))
TOLERANCES, IN_SCIPY_AT = (1e-3, 1e-5, 1e-7, 1e-9), (1e-4, 1e-7)
QUICK = ((SOFTEST, 1e6, 1e7), (1e-3, 1e-6, 1e-9), (1e-5,))
"""Stiffnesses, tolerances of CyRK's integrators and of SciPy's."""

Stiffnesses = Annotated[list[float] | None, "Joint stiffness, N m/rad, or several: 1e4,1e5."]


def stiffnesses_of(quick: bool, stiffness: Sequence[float] | None) -> tuple[float, ...]:
    """Return the stiffnesses to look at, N m/rad.

    Raises:
        InputError: one is not positive.
    """
    for k in stiffness or ():
        if not (k > 0 and math.isfinite(k)):
            raise InputError(f"stiffness = {k!r}, expected a positive number, N m/rad")
    return tuple(stiffness or (QUICK[0] if quick else DECADES))


def truth_cells(*, quick: Quick = False, stiffness: Stiffnesses = None) -> Iterator[Settings]:
    """Yield a cell for each stiffness whose damped motion is to be known."""
    yield from ({"stiffness": k} for k in stiffnesses_of(quick, stiffness))


def cells(
    *,
    quick: Quick = False,
    stiffness: Stiffnesses = None,
    formulation: Annotated[list[str] | None, "Formulation, or several: a,b. [kane]"] = None,
    references: References = REFERENCES,
) -> Iterator[Settings]:
    """Yield a cell for each integrator, tolerance, stiffness, formulation and problem.

    Raises:
        InputError: a stiffness that is not positive, or the true undamped motion is not stored.
        UnknownNameError: no such formulation.
    """
    stored(REFERENCE, references)  # before hours are spent on what needs it
    keys = [f.key for f in formulations_for(Snake, formulation or ["kane"])]
    _, tolerances, in_scipy = QUICK if quick else (DECADES, TOLERANCES, IN_SCIPY_AT)
    for problem, key, k in product(PROBLEMS, keys, stiffnesses_of(quick, stiffness)):
        shared = {"problem": problem, "formulation": key, "stiffness": k}
        for integrator, tolerance in product(COMPILED, tolerances):
            yield shared | {"integrator": integrator, "jacobian": None, "tolerance": tolerance}
        if problem == "damped" and key == "kane":
            for integrator, jacobian, tolerance in product(IN_SCIPY, JACOBIANS, in_scipy):
                how = {"integrator": integrator, "jacobian": jacobian, "tolerance": tolerance}
                yield shared | how


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


def damped_truth(settings: dict[str, Any]) -> Record:
    """Return the end of a damped motion, integrated twice."""
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
    reference = stored(REFERENCE, folder)
    q, v = reference.q[-1], reference.v[-1]
    state = np.concatenate((q, v))
    # √(5000/k) is rounded twice, and with it the end.
    moved = 2 * EPS * float(np.abs(v).max())
    known = reference.uncertainty + reference.rounding + moved
    return Truth(state, known / float(np.abs(state).max()))


# ---- One cell ------------------------------------------------------------------------------------


def worker(truths: Sequence[Record], *, references: References = REFERENCES) -> Work:
    """Return what integrates a motion and compares its end with the truth; `truths` are damped."""
    damped = {r.settings["stiffness"]: r for r in truths}
    prepared = cache(lambda problem, k, key: ready(scene_of(problem, k), key))
    scaled = cache(scaled_truth)

    def truth_of(problem: str, stiffness: float) -> Truth:
        if problem == "undamped":
            return scaled(references)
        record = damped[stiffness]
        if record.status != "done":
            raise EomcheckError(f"the true motion is not known: {record.reason}")
        return Truth(np.array(record.series["state"]), record.errors["uncertainty"])

    def work(settings: Settings) -> Record:
        problem, k = settings["problem"], settings["stiffness"]
        motion, compile_seconds = prepared(problem, k, settings["formulation"])
        truth = truth_of(problem, k)
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

    return work


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
