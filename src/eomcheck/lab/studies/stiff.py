"""Stiff joints: the work of explicit and implicit integrators to the same error.

Two families of the paper's robot, released from rest, k from 5e3 to 1e10 N m/rad:

- "undamped": springs alone. k only sets the unit of time: q(t) at k is q(t √(k/5000)) at k = 5000,
  so that the stored reference solution, rescaled in time, is the true motion at every k.
- "damped": dampers d = τ k with the retardation time τ = 10 ms (Kelvin and Voigt). Joints creep
  with τ at any k, while their disagreements decay at rates that grow with k. The reference motion
  is integrated twice, by the banded formulation and Radau IIA, and by Kane's and an explicit
  method, above k = 1e9, where that would take 10 million steps, by Radau IIA with other steps; the
  difference is its uncertainty.

Errors are relative: the largest error of (q, v T) at the end over its largest entry, T the unit of
time of the family.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from scipy.integrate import solve_ivp

from eomcheck.errors import EomcheckError, InputError
from eomcheck.formulations import formulation_of, formulations_for
from eomcheck.lab.references import stored_reference
from eomcheck.lab.show.chart import Axis, Chart, Panel
from eomcheck.lab.show.table import ResultTable, table_of
from eomcheck.lab.store.record_file import Record, Settings, group, select, values
from eomcheck.lab.study import (
    REFERENCES,
    CellWorker,
    Quick,
    References,
    Study,
    line_of,
    prepare_motion,
    run_time,
    solver_options,
    was_contended,
)
from eomcheck.motion.integrators import INTEGRATORS
from eomcheck.motion.right_hand_side import exact_jacobian
from eomcheck.motion.simulate import Motion
from eomcheck.numbers.generic import EPS, Array
from eomcheck.safe_output import counted
from eomcheck.scenes import Snake

# ---- Cells and measurements ----------------------------------------------------------------------

KEY, TRUTH = "stiff", "stiff-truth"
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
"""Implicit integrators; LSODA is neither, as it uses Adams' methods where nothing is stiff."""
IN_SCIPY = IMPLICIT
JACOBIANS = ("differences", "exact")
MOST_STEPS = 200_000
EXPLICIT_UP_TO = 1e9
"""Largest stiffness at which a reference motion is integrated by an explicit method, N m/rad."""
RUNS = 5


DECADES = (SOFTEST, *(10.0**e for e in range(5, 11)))
TOLERANCES, IN_SCIPY_AT = (1e-3, 1e-5, 1e-7, 1e-9), (1e-4, 1e-7)
QUICK = ((SOFTEST, 1e6, 1e7), (1e-3, 1e-6, 1e-9), (1e-5,))
"""Quick run: stiffnesses, tolerances of CyRK's integrators and of SciPy's."""

Stiffnesses = Annotated[list[float] | None, "Joint stiffness, N m/rad, or several: 1e4,1e5."]


def stiffnesses_of(quick: bool, stiffness: Sequence[float] | None) -> tuple[float, ...]:
    """Return the stiffnesses of a run, N m/rad.

    Raises:
        InputError: one is not positive.
    """
    for k in stiffness or ():
        if not (k > 0 and math.isfinite(k)):
            raise InputError(f"stiffness = {k!r}, expected a positive number, N m/rad")
    return tuple(stiffness or (QUICK[0] if quick else DECADES))


def truth_cells(*, quick: Quick = False, stiffness: Stiffnesses = None) -> Iterator[Settings]:
    """Yield a cell for each stiffness of a damped reference motion."""
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
        InputError: a stiffness that is not positive, or the undamped reference is not stored.
        UnknownNameError: no such formulation.
    """
    stored_reference(REFERENCE, references)  # raises before hours are spent on cells that need it
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


def stiff_robot(problem: str, stiffness: float) -> Snake:
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


# ---- Reference motions ---------------------------------------------------------------------------


@dataclass(frozen=True)
class Truth:
    """Reference state at the end of a motion.

    Attributes:
        state: (q, v T) (2n,).
        uncertainty: relative.
    """

    state: Array
    uncertainty: float


def damped_truth(settings: dict[str, Any]) -> Record:
    """Return the Record of a damped motion's end state, integrated twice."""
    scene = stiff_robot("damped", settings["stiffness"])
    first = _end_state(scene, "banded", "Radau", 1e-12)
    explicit = settings["stiffness"] <= EXPLICIT_UP_TO
    second = _end_state(scene, "kane", *(("DOP853", 1e-13) if explicit else ("Radau", 1e-11)))
    errors = {"uncertainty": _relative(second, first) + 2 * EPS}
    series = {"state": (second if explicit else first).tolist()}
    return Record(TRUTH, settings, errors=errors, series=series)


def _relative(state: Array, true: Array) -> float:
    return float(np.abs(state - true).max() / np.abs(true).max())


def _end_state(scene: Snake, key: str, integrator: str, tolerance: float) -> Array:
    motion = Motion(scene, formulation_of(key), *scene.initial_state())
    end = np.array([DAMPED_END])
    options = {"rtol": tolerance, "atol": tolerance, "output_times": end, "max_steps": 0}
    steps = motion.solve(DAMPED_END, integrator=integrator, **options)
    if not steps.success:
        raise EomcheckError(f"{key} with {integrator} fails: {steps.message}")
    return np.concatenate(motion.split(steps.y[-1]))


def scaled_truth(folder: Path) -> Truth:
    """Return the reference end state of every undamped motion, in units of its own time."""
    reference = stored_reference(REFERENCE, folder)
    q, v = reference.q[-1], reference.v[-1]
    state = np.concatenate((q, v))
    # √(5000/k) is rounded twice, and the end time with it.
    end_rounding = 2 * EPS * float(np.abs(v).max())
    uncertainty = reference.uncertainty + reference.rounding + end_rounding
    return Truth(state, uncertainty / float(np.abs(state).max()))


# ---- One cell ------------------------------------------------------------------------------------


def worker(truths: Sequence[Record], *, references: References = REFERENCES) -> CellWorker:
    """Return the function that integrates a motion and compares its end with the reference.

    Args:
        truths: Records of the damped reference motions.
        references: folder of the stored references, for the undamped ones.
    """
    damped = {r.settings["stiffness"]: r for r in truths}
    prepared = cache(lambda problem, k, key: prepare_motion(stiff_robot(problem, k), key))
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
        by = _by_cyrk if settings["jacobian"] is None else _in_scipy
        solve = partial(by, motion, end_of(problem, k), settings)
        found = solve()
        counts = {"right-hand sides": motion.rates.calls, **found.counts}
        if found.state is None:
            return Record(KEY, settings, "failed", found.reason, counts=counts)
        q, v = motion.split(found.state)
        state = np.concatenate((q, v * unit_of_time(problem, k)))
        errors = {"final": _relative(state, truth.state), "floor": truth.uncertainty}
        timing = run_time(solve, runs=RUNS).recorded()
        timing["compile_seconds"] = compile_seconds
        return Record(KEY, settings, counts=counts, errors=errors, **timing)

    return work


@dataclass(frozen=True)
class _Found:
    state: Array | None
    reason: str
    counts: dict[str, int]


def _by_cyrk(motion: Motion, end: float, settings: dict[str, Any]) -> _Found:
    options = solver_options(settings, np.array([end]))
    found = motion.solve(end, max_steps=MOST_STEPS, **options)
    state = found.y[-1] if found.success and np.isfinite(found.y).all() else None
    return _Found(state, found.message, {"steps": found.steps})


def _in_scipy(motion: Motion, end: float, settings: dict[str, Any]) -> _Found:
    """Integrate by SciPy with the same right-hand side."""
    motion.rates.reset()
    exact = settings["jacobian"] == "exact"
    # Its finite differences enlarge the step of a variable without effect until it overflows.
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
"""Jacobian of one scene and formulation, compiled once."""


# ---- Tables and charts: costs, crossovers, savings by exact Jacobians ----------------------------

TARGETS = (1e-3, 1e-6)
"""Relative errors for which costs are compared."""
RATES = "right-hand sides"
COSTS = {"seconds": "CPU time / s", RATES: RATES}
STIFFNESS = Axis("joint stiffness k / (N m/rad)", log=True)


def cheapest(
    records: Iterable[Record], target: float, integrators: Sequence[str], what: str = "seconds"
) -> Record | None:
    """Return the cheapest run with an error of at most `target`; None if there is none.

    Args:
        records: runs.
        target: largest relative error.
        integrators: keys of the integrators compared.
        what: "seconds" or "right-hand sides".
    """
    good = [
        r
        for r in select(records, KEY, jacobian=None)
        if r.settings["integrator"] in integrators and r.errors["final"] <= target
    ]
    return min(good, key=lambda r: run_cost(r, what), default=None)


def run_cost(record: Record, what: str = "seconds") -> float:
    """Return the cost of a run: CPU time of the best run, s, or a count.

    CPU time is compared, not run time, as it does not depend on other load of the machine.
    """
    return (record.cpu_seconds or 0.0) if what == "seconds" else float(record.counts[what])


def crossover(
    records: Iterable[Record], target: float, problem: str, key: str, what: str = "seconds"
) -> float | None:
    """Return the stiffness from which on implicit integrators are the cheaper ones, N m/rad.

    Interpolated in logarithms between the two stiffnesses where the ratio of the best of both kinds
    passes 1; None where explicit ones remain cheaper up to the largest. Where none of the explicit
    ones reaches the error, the implicit ones count as cheaper.
    """
    mine = select(records, KEY, problem=problem, formulation=key)
    ratios: list[tuple[float, float]] = []
    for k in sorted({r.settings["stiffness"] for r in mine}):
        at_k = [r for r in mine if r.settings["stiffness"] == k]
        explicit, implicit = (cheapest(at_k, target, kind, what) for kind in (EXPLICIT, IMPLICIT))
        if implicit is None:
            continue
        ratio = (
            math.inf if explicit is None else run_cost(explicit, what) / run_cost(implicit, what)
        )
        ratios.append((k, ratio))
    for i, (k, ratio) in enumerate(ratios):
        if ratio > 1 and all(later > 1 for _, later in ratios[i:]):
            if i == 0 or math.isinf(ratio):
                return k
            before_k, before = ratios[i - 1]
            share = math.log(1 / before) / math.log(ratio / before)
            return before_k * (k / before_k) ** share
    return None


# ---- Tables --------------------------------------------------------------------------------------


def tables(records: Sequence[Record]) -> Iterator[ResultTable]:
    """Yield the uncertainty of the references, costs, crossovers, and savings by exact
    Jacobians.
    """
    yield _truths(records)
    for problem, key, target in product(PROBLEMS, values(records, "formulation"), TARGETS):
        yield _costs(records, problem, key, target)
    yield _crossovers(records)
    yield _jacobians(records)
    yield _failures(records)


def remarks(records: Sequence[Record]) -> Iterator[str]:
    """Yield the number of runs with contended timing."""
    shared = sum(map(was_contended, records))
    yield f"{shared} of {counted(len(select(records, KEY)), 'best run')} had to share a core."


def _truths(records: Sequence[Record]) -> ResultTable:
    columns = (
        ("k / (N m/rad)", lambda r: f"{r.settings['stiffness']:.0e}"),
        (
            "uncertainty",
            lambda r: f"{r.errors['uncertainty']:.1e}" if r.status == "done" else r.reason,
        ),
    )
    title = "How well the damped motions are known, relative"
    return table_of("stiff-truth", title, (r for r in records if r.study == TRUTH), columns)


def _costs(records: Sequence[Record], problem: str, key: str, target: float) -> ResultTable:
    stiffnesses = values(records, "stiffness")
    rows = []
    for integrator in COMPILED:
        best = (_cheapest_at(records, problem, key, k, target, integrator) for k in stiffnesses)
        cells = (
            "" if b is None else f"{1e3 * run_cost(b):.3g}  {run_cost(b, RATES):.0f}" for b in best
        )
        rows.append((integrator, *cells))
    title = f"{problem}, {key}: CPU time in ms, and right-hand sides, to an error of {target:.0e}"
    columns = "integrator", *(f"{k:.0e}" for k in stiffnesses)
    return ResultTable(f"stiff-cost-{problem}-{key}-{target:.0e}", title, columns, rows)


def _cheapest_at(
    records: Sequence[Record],
    problem: str,
    key: str,
    k: float,
    target: float,
    integrator: str,
    *what,
) -> Record | None:
    mine = select(records, KEY, problem=problem, formulation=key, stiffness=k)
    return cheapest(mine, target, (integrator,), *what)


def _crossovers(records: Sequence[Record]) -> ResultTable:
    rows = []
    for problem, target, key in product(PROBLEMS, TARGETS, values(records, "formulation")):
        crossovers = (crossover(records, target, problem, key, x) for x in ("seconds", RATES))
        cells = ("never" if k is None else f"{k:.1e}" for k in crossovers)
        rows.append((problem, f"{target:.0e}", key, *cells))
    return ResultTable(
        "stiff-crossover",
        "Implicit integrators are the cheaper ones from this k on, N m/rad",
        ("joints", "error", "formulation", "by CPU time", "by right-hand sides"),
        rows,
    )


def _jacobians(records: Sequence[Record]) -> ResultTable:
    rows = []
    for integrator, tolerance, k, pair in _pairs(records):
        cells = []
        for what, factor in ((RATES, 1.0), ("seconds", 1e3)):
            plain, exact = (factor * run_cost(r, what) for r in pair)
            cells += [f"{plain:.4g}", f"{exact:.4g}", f"{1 - exact / plain:.0%}"]
        errors = (f"{r.errors['final']:.0e}" for r in pair)
        rows.append((integrator, f"{tolerance:.0e}", f"{k:.0e}", *cells, *errors))
    heads = "right-hand sides", "exact", "saved", "CPU ms", "exact", "saved", "error", "exact"
    title = "SciPy, kane, damped: exact Jacobian beside finite differences"
    columns = "integrator", "rtol", "k / (N m/rad)", *heads
    return ResultTable("stiff-jacobians", title, columns, rows)


def _pairs(records: Sequence[Record]) -> Iterator[tuple[str, float, float, list[Record]]]:
    """Yield integrator, tolerance, stiffness, and the runs by finite differences and by exact
    Jacobian.
    """
    tolerances, stiffnesses = (values(records, name) for name in ("tolerance", "stiffness"))
    for integrator, tolerance, k in product(IN_SCIPY, tolerances, stiffnesses):
        mine = select(records, KEY, integrator=integrator, tolerance=tolerance, stiffness=k)
        pair = [run for way in JACOBIANS for run in select(mine, jacobian=way)]
        if len(pair) == 2:
            yield integrator, tolerance, k, pair


def _failures(records: Sequence[Record]) -> ResultTable:
    what = "problem", "formulation", "integrator"
    failed = [r for r in records if r.study == KEY and r.status != "done"]
    alike = group(failed, lambda r: (*(r.settings[name] for name in what), r.reason))
    where = "{stiffness:.0e} at {tolerance:.0e}"
    rows = [
        (*key, "; ".join(where.format(**r.settings) for r in mine)) for key, mine in alike.items()
    ]
    columns = ("joints", *what[1:], "reason", "k at rtol")
    title = "Runs that failed" if rows else "No run failed."
    return ResultTable("stiff-failed", title, columns, rows, widths=(2, 2, 2, 6, 6))


# ---- Charts --------------------------------------------------------------------------------------


def charts(records: Sequence[Record]) -> Iterator[Chart]:
    """Yield work-precision, cost over stiffness, and savings by exact Jacobians."""
    yield _work_precision(records)
    yield _cost_over_stiffness(records)
    yield _saved(records)


def _work_precision(records: Sequence[Record]) -> Chart:
    """Return error against CPU time of Kane's formulation; grey: below the uncertainty of the
    reference.
    """
    panels = {}
    stiffnesses = values(records, "stiffness")
    for problem, k in product(PROBLEMS, stiffnesses):
        mine = select(records, KEY, problem=problem, stiffness=k, formulation="kane", jacobian=None)
        if not mine:
            continue
        mine.sort(key=lambda r: -r.settings["tolerance"])
        lines = [
            line_of(
                integrator,
                select(mine, integrator=integrator),
                run_cost,
                lambda r: max(r.errors["final"], r.errors["floor"]),
                _hover_text,
            )
            for integrator in COMPILED
            if integrator in values(mine, "integrator")
        ]
        x = Axis("CPU time / s", log=True)
        y = Axis("relative error", log=True, range=(1e-13, 3.0))
        title = f"{problem}, k = {k:.0e} N m/rad"
        panels[problem, f"{k:.0e}"] = Panel(x, y, lines, title, mine[0].errors["floor"])
    shown = stiffnesses[:: max(1, (len(stiffnesses) - 1) // 3)][:4]
    return Chart(
        "stiff-work-precision",
        "Error against CPU time, Kane's formulation",
        ["joints", "k / (N m/rad)"],
        panels,
        [[(problem, f"{k:.0e}") for problem in PROBLEMS] for k in shown],
        height=2.0,
    )


def _hover_text(record: Record) -> list[str]:
    how = "{integrator}, tolerance {tolerance:.0e}".format(**record.settings)
    return [
        how,
        f"{1e3 * run_cost(record):.3g} ms, {counted(record.counts[RATES], 'right-hand side')}",
    ]


def _cost_over_stiffness(records: Sequence[Record]) -> Chart:
    target, stiffnesses = TARGETS[0], values(records, "stiffness")
    panels = {}
    for (what, label), problem in product(COSTS.items(), PROBLEMS):
        lines = []
        for integrator in COMPILED:
            where = ((problem, "kane", k, target, integrator, what) for k in stiffnesses)
            if best := [run for one in where if (run := _cheapest_at(records, *one))]:
                cost = partial(run_cost, what=what)
                lines.append(line_of(integrator, best, lambda r: r.settings["stiffness"], cost))
        stiffness = crossover(records, target, problem, "kane", what)
        panels[label, problem] = Panel(
            STIFFNESS,
            Axis(label, log=True),
            lines,
            f"{problem}, to an error of {target:.0e}",
            marks=[] if stiffness is None else [stiffness],
        )
    title = "Cost over stiffness, Kane's formulation; dotted: implicit integrators are cheaper on"
    return Chart("stiff-cost", title, ["cost", "joints"], panels)


def _saved(records: Sequence[Record]) -> Chart:
    """Return the cost with exact Jacobians over that with finite differences: right-hand sides and
    time.
    """
    panels, pairs = {}, group(_pairs(records), lambda one: one[:2])
    tolerances = sorted({tolerance for _, tolerance in pairs}, reverse=True)
    for (what, label), tolerance in product({RATES: RATES, "seconds": "time"}.items(), tolerances):
        lines = [
            line_of(
                integrator,
                line,
                lambda one: one[2],
                lambda one: run_cost(one[3][1], what) / run_cost(one[3][0], what),  # noqa: B023
            )
            for (integrator, rtol), line in pairs.items()
            if rtol == tolerance
        ]
        y = Axis(f"ratio of {label}", range=(0, None))
        at = f"rtol {tolerance:.0e}"
        panels[label, at] = Panel(STIFFNESS, y, lines, at, level=1.0)
    title = "Exact Jacobians: cost over that with finite differences (SciPy, damped)"
    return Chart("stiff-jacobians", title, ["cost", "tolerance"], panels, height=2.0)


TRUTHS = Study(
    key=TRUTH,
    cells=truth_cells,
    worker=lambda stored: damped_truth,
    tables=lambda records: (),
    label="integrating {true motion}",
)
STUDY = Study(
    key=KEY,
    before=(TRUTHS,),
    cells=cells,
    worker=worker,
    tables=tables,
    charts=charts,
    remarks=remarks,
    label="integrating {motion}",
)
