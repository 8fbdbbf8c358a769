"""Stiff joints: costs, crossovers and what Jacobians save, as tables and charts."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import product

from eomcheck.lab.run_time import disturbed
from eomcheck.lab.show.chart import Chart
from eomcheck.lab.show.panel import Axis, Line, Panel
from eomcheck.lab.show.sheet import Sheet
from eomcheck.lab.store.groups import group, select, values
from eomcheck.lab.store.record import Record
from eomcheck.lab.studies.stiff.measure import (
    COMPILED,
    EXPLICIT,
    IMPLICIT,
    IN_SCIPY,
    JACOBIANS,
    PROBLEMS,
    STUDY,
    TRUTH,
)
from eomcheck.output import counted

TARGETS = (1e-3, 1e-6)
"""Relative errors whose costs are compared."""
RATES = "right-hand sides"
COSTS = {"seconds": "CPU time / s", RATES: RATES}
STIFFNESS = Axis("joint stiffness k / (N m/rad)", log=True)


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
        for r in select(records, STUDY, jacobian=None)
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
    mine = select(records, STUDY, problem=problem, formulation=key)
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


# ---- Tables --------------------------------------------------------------------------------------


def sheets(found: Sequence[Record]) -> Iterator[Sheet]:
    """Yield how well the truth is known, costs, crossovers, and what Jacobians save."""
    yield _truths(found)
    for problem, key, target in product(PROBLEMS, values(found, "formulation"), TARGETS):
        yield _costs(found, problem, key, target)
    yield _crossovers(found)
    yield _jacobians(found)
    yield _failures(found)


def said(found: Sequence[Record]) -> Iterator[str]:
    """Yield how many runs were disturbed."""
    shared = sum(map(disturbed, found))
    yield f"{shared} of {counted(len(select(found, STUDY)), 'best run')} had to share a core."


def _truths(found: Sequence[Record]) -> Sheet:
    rows = [
        (
            f"{r.settings['stiffness']:.0e}",
            f"{r.errors['uncertainty']:.1e}" if r.status == "done" else r.reason,
        )
        for r in found
        if r.study == TRUTH
    ]
    title = "How well the damped motions are known, relative"
    return Sheet("stiff-truth", title, ("k / (N m/rad)", "uncertainty"), rows)


def _costs(found: Sequence[Record], problem: str, key: str, target: float) -> Sheet:
    stiffnesses = values(found, "stiffness")
    rows = []
    for integrator in COMPILED:
        best = (
            cheapest(
                select(found, STUDY, problem=problem, formulation=key, stiffness=k),
                target,
                (integrator,),
            )
            for k in stiffnesses
        )
        cells = ("" if b is None else f"{1e3 * cost(b):.3g}  {cost(b, RATES):.0f}" for b in best)
        rows.append((integrator, *cells))
    return Sheet(
        f"stiff-cost-{problem}-{key}-{target:.0e}",
        f"{problem}, {key}: CPU time in ms, and right-hand sides, to an error of {target:.0e}",
        ("integrator", *(f"{k:.0e}" for k in stiffnesses)),
        rows,
    )


def _crossovers(found: Sequence[Record]) -> Sheet:
    rows = []
    for problem, target, key in product(PROBLEMS, TARGETS, values(found, "formulation")):
        places = (crossover(found, target, problem, key, what) for what in ("seconds", RATES))
        cells = ("never" if k is None else f"{k:.1e}" for k in places)
        rows.append((problem, f"{target:.0e}", key, *cells))
    return Sheet(
        "stiff-crossover",
        "Implicit integrators are the cheaper ones from this k on, N m/rad",
        ("joints", "error", "formulation", "by CPU time", "by right-hand sides"),
        rows,
    )


def _jacobians(found: Sequence[Record]) -> Sheet:
    rows = []
    for integrator, tolerance, k, pair in _pairs(found):
        cells = []
        for what, factor in ((RATES, 1.0), ("seconds", 1e3)):
            plain, exact = (factor * cost(r, what) for r in pair)
            cells += [f"{plain:.4g}", f"{exact:.4g}", f"{1 - exact / plain:.0%}"]
        errors = (f"{r.errors['final']:.0e}" for r in pair)
        rows.append((integrator, f"{tolerance:.0e}", f"{k:.0e}", *cells, *errors))
    return Sheet(
        "stiff-jacobians",
        "SciPy, kane, damped: exact Jacobian beside finite differences",
        (
            *("integrator", "rtol", "k / (N m/rad)", "right-hand sides", "exact", "saved"),
            *("CPU ms", "exact", "saved", "error", "exact"),
        ),
        rows,
    )


def _pairs(found: Sequence[Record]) -> Iterator[tuple[str, float, float, list[Record]]]:
    """Yield integrator, tolerance, stiffness, and the runs by differences and by exact Jacobian."""
    for integrator in IN_SCIPY:
        for tolerance, k in product(values(found, "tolerance"), values(found, "stiffness")):
            how = {"integrator": integrator, "tolerance": tolerance, "stiffness": k}
            pair = [run for way in JACOBIANS for run in select(found, STUDY, jacobian=way, **how)]
            if len(pair) == 2:
                yield integrator, tolerance, k, pair


def _failures(found: Sequence[Record]) -> Sheet:
    what = "problem", "formulation", "integrator"
    failed = (r for r in found if r.study == STUDY and r.status != "done")
    alike = group(failed, lambda r: (*(r.settings[name] for name in what), r.reason))
    where = "{stiffness:.0e} at {tolerance:.0e}"
    rows = [
        (*told, "; ".join(where.format(**r.settings) for r in mine)) for told, mine in alike.items()
    ]
    columns = ("joints", "formulation", "integrator", "reason", "k at rtol")
    title = "Runs that failed" if rows else "No run failed."
    return Sheet("stiff-failed", title, columns, rows, widths=(2, 2, 2, 6, 6))


# ---- Charts --------------------------------------------------------------------------------------


def charts(found: Sequence[Record]) -> Iterator[Chart]:
    """Yield work-precision, cost over stiffness, and what exact Jacobians save."""
    yield _work_precision(found)
    yield _cost_over_stiffness(found)
    yield _saved(found)


def _work_precision(found: Sequence[Record]) -> Chart:
    """Error against CPU time of Kane's formulation; in the grey the truth is not known."""
    panels = {}
    stiffnesses = values(found, "stiffness")
    for problem, k in product(PROBLEMS, stiffnesses):
        mine = select(found, STUDY, problem=problem, stiffness=k, formulation="kane", jacobian=None)
        if not mine:
            continue
        mine.sort(key=lambda r: -r.settings["tolerance"])
        lines = [
            Line(
                integrator,
                [cost(r) for r in line],
                [max(r.errors["final"], r.errors["floor"]) for r in line],
                [_told(r) for r in line],
            )
            for integrator in COMPILED
            if (line := [r for r in mine if r.settings["integrator"] == integrator])
        ]
        x = Axis("CPU time / s", log=True)
        y = Axis(f"{problem}\nrelative error", log=True, range=(1e-13, 3.0))
        title = f"k = {k:.0e} N m/rad"
        panels[problem, f"{k:.0e}"] = Panel(x, y, lines, title, mine[0].errors["floor"])
    shown = stiffnesses[:: max(1, (len(stiffnesses) - 1) // 3)][:4]
    return Chart(
        "stiff-work-precision",
        "Error against CPU time, Kane's formulation",
        ["joints", "k / (N m/rad)"],
        panels,
        [[(problem, f"{k:.0e}") for k in shown] for problem in PROBLEMS],
        size=(2.9, 3.1),
    )


def _told(record: Record) -> list[str]:
    how = "{integrator}, tolerance {tolerance:.0e}".format(**record.settings)
    return [how, f"{1e3 * cost(record):.3g} ms, {counted(record.counts[RATES], 'right-hand side')}"]


def _cost_over_stiffness(found: Sequence[Record]) -> Chart:
    target = TARGETS[0]
    panels = {}
    for (what, label), problem in product(COSTS.items(), PROBLEMS):
        lines = []
        for integrator in COMPILED:
            points = [
                (k, cost(best, what))
                for k in values(found, "stiffness")
                if (best := _cheapest_at(found, problem, k, target, integrator, what))
            ]
            if points:
                lines.append(Line(integrator, [k for k, _ in points], [y for _, y in points]))
        place = crossover(found, target, problem, "kane", what)
        panels[label, problem] = Panel(
            STIFFNESS,
            Axis(label, log=True),
            lines,
            f"{problem}: to a relative error of {target:.0e}",
            marks=[] if place is None else [place],
        )
    title = "Cost over stiffness, Kane's formulation; dotted: implicit integrators are cheaper on"
    return Chart("stiff-cost", title, ["cost", "joints"], panels, size=(4.4, 3.2))


def _cheapest_at(
    found: Sequence[Record], problem: str, k: float, target: float, integrator: str, what: str
) -> Record | None:
    mine = select(found, STUDY, problem=problem, stiffness=k, formulation="kane")
    return cheapest(mine, target, (integrator,), what)


def _saved(found: Sequence[Record]) -> Chart:
    """The shares of right-hand sides and time that exact Jacobians leave."""
    panels, pairs = {}, group(_pairs(found), lambda one: one[:2])
    for what, label in {RATES: RATES, "seconds": "CPU time"}.items():
        lines = [
            Line(
                integrator,
                [k for _, _, k, _ in line],
                [cost(exact, what) / cost(plain, what) for *_, (plain, exact) in line],
                label=f"{integrator}, rtol {tolerance:.0e}",
                dashed=tolerance == max(t for _, t in pairs),
            )
            for (integrator, tolerance), line in pairs.items()
        ]
        y = Axis("exact Jacobian over differences", range=(0, None))
        panels[(label,)] = Panel(STIFFNESS, y, lines, label, level=1.0)
    title = "What exact Jacobians leave of the cost of finite differences (SciPy, damped)"
    return Chart("stiff-jacobians", title, ["cost"], panels, size=(4.1, 3.4))
