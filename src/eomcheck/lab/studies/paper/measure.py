"""Measurements of the paper's simulations: the snake of 2 to 100 links by its seven formulations.

The paper states neither integrator nor tolerance, output step or end time, nor parameters for N ≠
7. Chosen instead: the snakes of `Snake.coil` (at N = 7 the paper's printed digits), from rest, 1 s,
101 output times, and three pairs of integrator and tolerance, the same for every formulation and N.

There are two kinds of cell, each one Record: "equations" is one state (systems solved, multipliers,
q̈, a wheel across its link), "motion" one integration (errors over time, CPU time).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from typing import Annotated, NamedTuple

import numpy as np

from eomcheck.deprecated import getattr_of
from eomcheck.evaluation.dynamics import acceleration, velocity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import violation
from eomcheck.formulations import FORMULATIONS, formulation_of
from eomcheck.lab.store.record_file import Record, Settings
from eomcheck.lab.study import CellWorker, Judged, motion_record, prepare_motion, slope
from eomcheck.motion.reference_solution import constraint_error, energy_error, error_norm
from eomcheck.motion.simulate import Motion, Trajectory
from eomcheck.numbers.linear import recording_solves
from eomcheck.scenes import Snake

STUDY = "paper"
PAPER = tuple(key for key, formulation in FORMULATIONS.items() if formulation.in_paper)
PAPER_LINKS = 7
"""Links of the robot in Figs. 2 to 4."""

END = 1.0
"""End of every motion, s; Fig. 2 goes to 0.8 s."""
OUTPUTS = 101
"""Number of output times, also of Eq. (32): dt = 0.01 s."""
ROLLING = (1.0, 0.5)
"""u = (s_1, ω_1) of the state of "equations" cells, m/s and rad/s; at rest B would be 0."""

LONG = 0.3
"""Run time above which a motion is timed only twice, s."""


class Solver(NamedTuple):
    """Integrator (a key) with its rtol = atol."""

    integrator: str
    tolerance: float

    def __str__(self):
        return f"{self.integrator} {self.tolerance:.0e}"


@dataclass(frozen=True)
class StudyPlan:
    """Coverage of a run of the study.

    Attributes:
        links: numbers of links.
        solvers: integrators with their tolerances.
        formulations: keys.
        runs: timed runs of a motion, the best of which counts.
    """

    links: tuple[int, ...]
    solvers: tuple[Solver, ...]
    formulations: tuple[str, ...] = PAPER
    runs: int = 10


FULL = StudyPlan(
    (2, 3, 4, 5, 6, 7, 10, 14, 20, 25, 30, 35, 40, 45, 50, 60, 70, 80, 90, 100),
    (Solver("RK45", 1e-3), Solver("RK45", 1e-6), Solver("DOP853", 1e-9)),
)
QUICK = StudyPlan((2, 7, 20, 40), (Solver("RK45", 1e-6),), runs=3)


def coil_of(links: int) -> Snake:
    """Return the coil of N links; at N = 7 with the paper's digits."""
    return Snake.paper() if links == PAPER_LINKS else Snake.coil(links)


Quick = Annotated[bool, "Four numbers of links and one tolerance only."]


def cells(*, quick: Quick = False) -> Iterator[Settings]:
    """Yield a cell for each state of each formulation, then for each motion."""
    planned = QUICK if quick else FULL
    for key in planned.formulations:
        for links in planned.links:
            yield {"cell": "equations", "links": links, "formulation": key, "across": 0}
        for wheel in range(1, PAPER_LINKS + 1):
            yield {"cell": "equations", "links": PAPER_LINKS, "formulation": key, "across": wheel}
    for links, key, solver in product(planned.links, planned.formulations, planned.solvers):
        motion = {"cell": "motion", "links": links, "formulation": key}
        yield motion | solver._asdict() | {"end": END, "outputs": OUTPUTS}


def worker(stored: Sequence[Record], *, quick: Quick = False) -> CellWorker:
    """Return the function that measures a cell."""
    runs = (QUICK if quick else FULL).runs
    prepared = cache(lambda links, key: prepare_motion(coil_of(links), key))

    def work(settings: Settings) -> Record:
        if settings["cell"] == "equations":
            return _equations(settings)
        return _simulate(settings, prepared(settings["links"], settings["formulation"]), runs)

    return work


# ---- One state -----------------------------------------------------------------------------------


def _equations(settings: Settings) -> Record:
    """Solve for the acceleration in one state; with a wheel across its link at rest.

    Raises:
        RefusedError: the formulation refuses.
    """
    scene, wheel = coil_of(settings["links"]), settings["across"]
    q, v = scene.initial_state()
    if wheel:
        angle = scene.wheel_angle.copy()
        angle[wheel - 1] = np.pi / 2
        scene = replace(scene, wheel_angle=angle)
    else:
        v = velocity(scene, q, ROLLING)
    formulation = formulation_of(settings["formulation"])
    at = Evaluation(scene, q, v)
    with recording_solves() as recorder:
        multipliers = at.solution(formulation).multipliers
    result = acceleration(scene, formulation.key, q, v)
    counts = {
        "n": scene.n,
        "r": scene.r,
        "degrees of freedom": scene.n - np.linalg.matrix_rank(at.terms.a),
        "multipliers": 0 if multipliers is None else multipliers.size,
        "final system": recorder.solves[-1].size,
    }
    return Record(
        STUDY,
        settings,
        counts=counts | {f"order of {solve.name}": solve.size for solve in recorder.solves},
        errors={"bound": result.error_bound},
        series={"vdot": result.vdot.tolist()},
    )


# ---- One motion ----------------------------------------------------------------------------------


def _simulate(settings: Settings, prepared: tuple[Motion, float], runs: int) -> Record:
    scene = prepared[0].scene

    def judge(trajectory: Trajectory) -> Judged:
        constraint, energy = constraint_error(trajectory), energy_error(trajectory)
        states = zip(trajectory.q, trajectory.v, strict=True)
        rounding = [violation(Evaluation(scene, q, v), v)[1] for q, v in states]
        errors = {
            "constraint": error_norm(constraint),
            "constraint allowed": error_norm(np.array(rounding)),
            "energy": error_norm(energy),
            "initial energy": trajectory.energy[0],
        }
        series = {"times": trajectory.times, "constraint": constraint, "energy": energy}
        if settings["links"] == PAPER_LINKS:
            series["q"] = trajectory.q
        return errors, {name: values.tolist() for name, values in series.items()}

    times, size = np.linspace(0.0, settings["end"], settings["outputs"]), prepared[0].y0.size
    how = {"runs": runs, "fewest": 2, "long": LONG}
    return motion_record(STUDY, settings, prepared, times, judge, {"state": size}, **how)


# ---- The Records, by cell ------------------------------------------------------------------------

QUANTITIES = {
    "constraint": "constraint error",
    "energy": "energy error",
    "cpu_seconds": "CPU time",
}
"""Norms of the errors over the output times (Eq. (33)), m/s and J; CPU time of the integration,
s.
"""


class PaperRecords:
    """Records of the study, indexed by their settings.

    Attributes:
        links: numbers of links.
        solvers: solvers, in the order of the plan.
        formulations: keys.
        equations: (links, key) -> Record of one state.
        across: (wheel, key) -> Record of one state with that wheel across its link.
        motions: (links, key, solver) -> Record of one motion.
    """

    def __init__(self, records: Iterable[Record]):
        self.equations: dict[tuple[int, str], Record] = {}
        self.across: dict[tuple[int, str], Record] = {}
        self.motions: dict[tuple[int, str, Solver], Record] = {}
        for record in records:
            settings = record.settings
            links, key = settings["links"], settings["formulation"]
            if settings["cell"] == "motion":
                solver = Solver(settings["integrator"], settings["tolerance"])
                self.motions[links, key, solver] = record
            elif settings["across"]:
                self.across[settings["across"], key] = record
            else:
                self.equations[links, key] = record
        self.links = sorted({links for links, _, _ in self.motions})
        self.solvers = list(dict.fromkeys(solver for _, _, solver in self.motions))
        self.formulations = list(dict.fromkeys(key for _, key, _ in self.motions))

    def finished(self, links: int, key: str, solver: Solver) -> Record | None:
        """Return the Record of a motion, None if it was not finished."""
        record = self.motions.get((links, key, solver))
        return record if record is not None and record.status == "done" else None

    def value(self, quantity: str, links: int, key: str, solver: Solver) -> float | None:
        """Return one of `QUANTITIES`, None if the motion was not finished."""
        record = self.finished(links, key, solver)
        if record is None:
            return None
        return record.cpu_seconds if quantity == "cpu_seconds" else record.errors[quantity]

    @property
    def solved(self) -> dict[tuple[int, str], Record]:
        """Entries of `equations` that were solved."""
        return {at: record for at, record in self.equations.items() if record.status == "done"}

    @property
    def unfinished(self) -> list[Record]:
        """Records that are not done, without those of a wheel across its link, which are meant to
        fail.
        """
        records = [*self.equations.values(), *self.motions.values()]
        return [record for record in records if record.status != "done"]


LARGE = 20
"""Number of links from which on the growth with N is fitted."""


def growth(records: PaperRecords, key: str) -> list[float]:
    """Return the slope of log(CPU time) over log(N) of a formulation, for each solver."""
    slopes = []
    for solver in records.solvers:
        times = [
            (n, records.value("cpu_seconds", n, key, solver)) for n in records.links if n >= LARGE
        ]
        points = [(n, seconds) for n, seconds in times if seconds is not None]
        if len(points) > 1:
            slopes.append(slope(points))
    return slopes


__getattr__ = getattr_of(__name__)
