"""Long runs: growth laws of constraint and energy errors, with and without stabilization.

The paper's robot, released from rest, for 1 000 s by every formulation; by those at acceleration
level, which drift off the constraints, also with Baumgarte's feedback and with projection. Each
error is fitted by rate · T (t/T)^exponent (`eomcheck.motion.reference_solution.drift_of`): exponent
0 levels off, 1/2 is a random walk, 1 a steady drift.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from itertools import product
from typing import Annotated, Any

import numpy as np

from eomcheck.errors import InputError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import FORMULATIONS, formulations_for
from eomcheck.lab.show.chart import Axis, Chart, Line, Panel
from eomcheck.lab.show.table import ResultTable
from eomcheck.lab.store.record_file import Record, Settings
from eomcheck.lab.study import Formulations, Study, cell_text, check_tolerances, solver_options
from eomcheck.mechanics.scene import Scene
from eomcheck.motion.reference_solution import constraint_error, drift_of
from eomcheck.motion.simulate import simulate
from eomcheck.numbers.generic import Array
from eomcheck.scenes import Snake

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
"""Number of output times, evenly spaced in logarithms."""


QUICK_END, QUICK_KEYS = 30.0, ("au", "kane")
TITLES = {
    "none": "nothing added",
    "feedback": f"feedback, {FEEDBACK:g}/s",
    "projection": f"projection every {INTERVAL:g} s",
}
LAWS = {"end": ".1e", "exponent": ".2f", "rate": ".1e"}
ERRORS = {"constraint": "‖c‖ / (m/s)", "energy": "|E - E₀| / E₀"}
SO_FAR = "largest {} up to t"
"""Ordinate of a chart: errors come and go, and their lines would cover each other."""
FLOOR = 1e-18
"""Ordinate at which errors of exactly 0 are drawn, since a logarithm has no zero."""


def cells(
    *,
    formulation: Formulations = None,
    end: Annotated[float | None, "End of the motion, s. [1000]"] = None,
    tolerance: Annotated[float | None, "rtol = atol. [1e-6]"] = None,
    quick: Annotated[bool, "30 s by two formulations only."] = False,
) -> Iterator[Settings]:
    """Yield a cell for each formulation, and for each remedy if it is at acceleration level.

    Raises:
        InputError: an end of 2 s or less, or a tolerance that is not in (0, 1).
        UnknownNameError: no such formulation.
    """
    end = end if end is not None else QUICK_END if quick else 1000.0
    if not 2 < end < np.inf:
        raise InputError(f"end = {end!r}, expected more than 2 s")
    how = {"t_end": end, "tolerance": TOLERANCE if tolerance is None else tolerance}
    check_tolerances([how["tolerance"]])
    formulations = formulations_for(Snake, formulation or (QUICK_KEYS if quick else None))
    for remedy, f in product(REMEDIES, formulations):
        if remedy == "none" or f.level == "acceleration":
            yield {"formulation": f.key, "remedy": remedy} | how


def output_times(t_end: float) -> Array:
    """Return times from 0.5 s to half an interval of projection before the end, s.

    Whole multiples of the interval are avoided: the velocity has just been projected there, and its
    error would be invisible.
    """
    return np.geomspace(0.5, t_end - INTERVAL / 2, TIMES)


def _long_run(settings: dict[str, Any]) -> Record:
    t_end, remedy = settings["t_end"], REMEDIES[settings["remedy"]]
    options = solver_options(settings | {"integrator": INTEGRATOR}, output_times(t_end))
    start = time.thread_time()
    trajectory = simulate(Snake.paper(), settings["formulation"], t_end, **options, **remedy)
    used = time.thread_time() - start
    start_energy = _start_energy(trajectory.scene)
    series = {
        "constraint": constraint_error(trajectory),
        "energy": np.abs(trajectory.energy - start_energy) / start_energy,
    }
    errors: dict[str, float] = {}
    for name, error in series.items() if trajectory.times.size else ():
        if (law := drift_of(trajectory.times, error)) is not None:
            errors |= {f"{name}_exponent": law.exponent, f"{name}_rate": law.rate}
        errors |= {f"{name}_end": error[-1], f"{name}_largest": error.max()}
    return Record(
        STUDY.key,
        settings,
        "done" if trajectory.status == "finished" else "failed",
        trajectory.reason,
        seconds=trajectory.seconds,
        cpu_seconds=min(used, trajectory.seconds),
        runs=1,
        counts={"right-hand sides": trajectory.right_hand_sides, "steps": trajectory.steps},
        errors=errors,
        series={name: x.tolist() for name, x in ({"times": trajectory.times} | series).items()},
    )


def _start_energy(scene: Scene) -> float:
    """Return the initial energy E_0, J; the first output time comes later."""
    at = Evaluation(scene, *scene.initial_state())
    T, U = at.call(scene.energies, at.parameters, at.prepared, at.q, at.v)
    return float(T if U is None else T + U)


def find_run(records: Iterable[Record], key: str, remedy: str) -> Record | None:
    """Return the Record of one formulation and remedy, or None."""
    wanted = {"formulation": key, "remedy": remedy}
    return next((r for r in records if wanted.items() <= r.settings.items()), None)


def tables(records: Sequence[Record]) -> Iterator[ResultTable]:
    """Yield the growth law and the final value of both errors of every run."""
    laws = {f"{error}_{law}": how for error in ERRORS for law, how in LAWS.items()}
    rows = []
    for r in records:
        numbers = (cell_text(r.errors.get(x), how) for x, how in laws.items())
        calls = f"{r.counts.get('right-hand sides', 0):,}"
        where = r.settings["formulation"], r.settings["remedy"]
        rows.append((*where, *numbers, calls, cell_text(r.cpu_seconds, ".3g")))
    heads = (x for name in ERRORS for x in (f"{name} at the end", "exponent", "rate per s"))
    columns = ("formulation", "remedy", *heads, "right-hand sides", "CPU s")
    yield ResultTable("long-run", "Laws of growth: rate · T (t/T)^exponent", columns, rows)


def remarks(records: Sequence[Record]) -> Iterator[str]:
    """Yield the reasons of failed runs."""
    for r in records:
        if r.status != "done":
            yield "{formulation}, {remedy} ".format(**r.settings) + f"{r.status}: {r.reason}"


def charts(records: Sequence[Record]) -> Iterator[Chart]:
    """Yield the largest values of both errors up to each time, a row per remedy."""
    panels = {}
    for (error, label), remedy in product(ERRORS.items(), REMEDIES):
        lines = [
            Line(
                key,
                r.series["times"],
                np.maximum.accumulate([FLOOR, *r.series[error]])[1:].tolist(),
                every=(3 * i, 30),
            )
            for i, key in enumerate(FORMULATIONS)
            if (r := find_run(records, key, remedy)) is not None and r.series
        ]
        panels[label, remedy] = Panel(
            Axis("t / s", log=True), Axis(SO_FAR.format(label), log=True), lines, TITLES[remedy]
        )
    grid = [[(label, remedy) for label in ERRORS.values()] for remedy in REMEDIES]
    title = "Errors of the paper's robot over 1 000 s"
    yield Chart("long-run", title, ["error", "remedy"], panels, grid, height=2.2)


STUDY = Study(
    key="long-run",
    cells=cells,
    worker=lambda stored: _long_run,
    tables=tables,
    charts=charts,
    remarks=remarks,
    label="integrating {motion}",
)
