"""Work-precision diagrams: formulations × integrators × tolerances × scenes.

Each cell is one Record. Errors are those against a stored reference solution at its output times;
run times are those of the integration alone, in machine code and warm.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from functools import cache, partial
from itertools import product
from math import isnan
from typing import Annotated

from eomcheck.evaluation.dynamics import velocity
from eomcheck.formulations import formulations_for
from eomcheck.lab.references import REFERENCE_CASES, reference_name, stored_reference
from eomcheck.lab.show.chart import Axis, Chart, File, Line, Panel
from eomcheck.lab.show.table import ResultTable, seconds_text
from eomcheck.lab.store.record_file import Record, Settings, by_setting, group, select, values
from eomcheck.lab.study import (
    REFERENCES,
    RUNS,
    CellWorker,
    Formulations,
    Judged,
    References,
    Study,
    cell_text,
    check_tolerances,
    line_of,
    motion_record,
    prepare_motion,
    was_contended,
)
from eomcheck.motion.integrators import INTEGRATORS, integrator_of
from eomcheck.motion.reference_solution import (
    Reference,
    constraint_error_drift,
    energy_error_drift,
    errors_of,
)
from eomcheck.motion.simulate import Motion, Trajectory
from eomcheck.safe_output import counted
from eomcheck.scene_lookup import scene_named

TOLERANCES = tuple(10.0**-k for k in range(3, 14, 2))
TARGETS = (1e-3, 1e-6, 1e-9)
"""Errors of the end state for which run times are compared."""


ERRORS = {
    "final": "error of the end state",
    "energy": "energy error, relative",
    "constraint": "constraint error, m/s",
}
AGAINST = {
    "seconds": Axis("run time", log=True, unit="s"),
    "right-hand sides": Axis("right-hand sides", log=True),
}
MARGIN = 1.3
"""Factor by which an abscissa reaches beyond the cheapest and the dearest run."""

NOTHING = 1e-17
"""Ordinate at which errors of exactly 0 are drawn."""


def cells(
    *,
    scene: Annotated[
        str | None,
        "Scene of your own, or robot, whose reference `eomcheck reference --scene` wrote.",
    ] = None,
    reference: Annotated[
        list[str] | None, "Reference solution; repeat for more. [paper-rest, or that of --scene]"
    ] = None,
    formulation: Formulations = None,
    integrator: Annotated[list[str] | None, "Integrator, or several: a,b. [default: all]"] = None,
    tolerance: Annotated[
        list[float] | None, "rtol = atol; repeat for more. [1e-3 .. 1e-13]"
    ] = None,
    references: References = REFERENCES,
) -> Iterator[Settings]:
    """Yield a cell for each reference, formulation that applies to it, integrator and tolerance.

    Raises:
        InputError: no such reference, a formulation that does not apply to its scene, a tolerance
            that is not in (0, 1).
        UnknownNameError: no such formulation or integrator.
    """
    integrators = [integrator_of(key).key for key in (integrator or INTEGRATORS)]
    check_tolerances(tolerance or ())
    # Tolerances innermost: the code compiled for the first one serves the others.
    default = "paper-rest" if scene is None else reference_name(scene_named(scene))
    for name in reference or (default,):
        about = stored_reference(name, references, scene).scene
        keys = [f.key for f in formulations_for(about, formulation or None)]
        for key, how, rtol in product(keys, integrators, tolerance or TOLERANCES):
            yield {"reference": name, "formulation": key, "integrator": how, "tolerance": rtol}


def worker(
    stored: Sequence[Record], *, references: References = REFERENCES, scene: str | None = None
) -> CellWorker:
    """Return the function that integrates a motion, compares it with its reference, and times
    it.
    """

    @cache
    def prepared(name: str, key: str) -> tuple[Reference, tuple[Motion, float]]:
        reference = stored_reference(name, references, scene)
        about, q0, u0 = reference.scene, reference.q0, reference.u0
        return reference, prepare_motion(about, key, q0, velocity(about, q0, u0), u0)

    def work(settings: Settings) -> Record:
        reference, motion = prepared(settings["reference"], settings["formulation"])

        def judge(trajectory: Trajectory) -> Judged:
            return asdict(errors_of(trajectory, reference)) | _drifts(trajectory), {}

        return motion_record(STUDY.key, settings, motion, reference.times, judge, runs=RUNS)

    return work


DRIFTS = {"constraint": constraint_error_drift, "energy": energy_error_drift}
LAWS = {"drift": ".1e", "exponent": ".1f"}
"""Number of a drift in a Record, behind the name of the error -> its format."""


def _drifts(trajectory: Trajectory) -> dict[str, float]:
    errors: dict[str, float] = {}
    for name, drift_in in DRIFTS.items():
        if (drift := drift_in(trajectory)) is not None:
            errors |= {f"{name}_drift": drift.rate, f"{name}_exponent": drift.exponent}
    return errors


# ---- Rankings of Records -------------------------------------------------------------------------


def fastest_to(records: Iterable[Record], target: float) -> dict[tuple[str, str], Record]:
    """Return, per (formulation, integrator), the fastest Record whose final error is <= target.

    The fastest of all comes first.
    """
    good = [record for record in select(records) if record.errors["final"] <= target]
    of = group(sorted(good, key=_seconds), lambda record: _run(record)[:2])
    return {how: best for how, (best, *_) in of.items()}


def _best(records: Iterable[Record], target: float) -> dict[str, Record]:
    """Return the fastest Record per formulation, with any integrator."""
    of = by_setting(fastest_to(records, target).values(), "formulation")
    return {key: best for key, (best, *_) in of.items()}


def _seconds(record: Record) -> float:
    return record.seconds or 0.0


def most_accurate(records: Iterable[Record]) -> dict[str, Record]:
    """Return, per formulation, the Record with the smallest final error."""
    of = by_setting(select(records), "formulation")
    return {key: min(mine, key=lambda one: one.errors["final"]) for key, mine in of.items()}


def pareto_front(records: Iterable[Record]) -> list[Record]:
    """Return the Pareto-optimal Records, fastest first: none is both slower and less accurate than
    another.
    """
    front: list[Record] = []
    for record in sorted(select(records), key=lambda r: (r.seconds, r.errors["final"])):
        if not front or record.errors["final"] < front[-1].errors["final"]:
            front.append(record)
    return front


def summary(records: Sequence[Record]) -> str:
    """Return a one-paragraph summary of the numbers of one scene."""
    sentences = [f"{len(select(records))} of {counted(len(records), 'run')} finished."]
    for target in TARGETS:
        best = _best(records, target)
        if not best:
            sentences.append(f"None reaches an error of {target:.0e}.")
            continue
        key, *_, slowest = [*best] * 2
        first, last = best[key], best[slowest]
        sentence = (
            f"An error of {target:.0e} is reached first by {key} with "
            f"{first.settings['integrator']} in {1e3 * _seconds(first):.3g} ms"
        )
        if slowest != key:
            sentence += (
                f"; the slowest formulation, {slowest}, takes "
                f"{_seconds(last) / _seconds(first):.3g} times as long with its best integrator"
            )
        sentences.append(sentence + ".")
    return " ".join(sentences)


# ---- Tables --------------------------------------------------------------------------------------


def tables(records: Sequence[Record]) -> Iterator[ResultTable]:
    """Yield times to reach an error, the Pareto front and drift of each scene, and failures."""
    for name, mine in by_setting(records, "reference").items():
        yield _targets(name, mine)
        yield _front(name, mine)
        yield _drift_laws(name, mine)
    rows = [
        (r.settings["reference"], *_run(r), r.status, r.reason)
        for r in records
        if r.seconds is None
    ]
    title = "Runs that did not finish" if rows else "All runs finished."
    columns = "reference", *RUN, "status", "reason"
    yield ResultTable("work-precision-unfinished", title, columns, rows)


def remarks(records: Sequence[Record]) -> Iterator[str]:
    """Yield a paragraph on each scene."""
    for name, mine in by_setting(records, "reference").items():
        yield f"{name}: {summary(mine)}"


RUN = ("formulation", "integrator", "tolerance")
"""Headings of `_run`."""


def _run(record: Record) -> tuple[str, ...]:
    """Return formulation, integrator and tolerance as text."""
    settings = record.settings
    return settings["formulation"], settings["integrator"], f"{settings['tolerance']:.0e}"


def _targets(name: str, records: Sequence[Record]) -> ResultTable:
    rows: dict[str, tuple[str, ...]] = {key: (key,) for key in values(records, "formulation")}
    for target in TARGETS:
        best = _best(records, target)
        for key in rows:
            rows[key] += _beside_fastest(best[key], best) if key in best else ("", "", "")
    heads = (head for target in TARGETS for head in (f"{target:.0e}", "with", "ratio"))
    title = f"{name}: best time of a run whose end state is right to ..."
    columns = "formulation", *heads
    return ResultTable(f"work-precision-targets-{name}", title, columns, [*rows.values()])


def _beside_fastest(record: Record, best: dict[str, Record]) -> tuple[str, str, str]:
    """Return run time, integrator, and the ratio to the fastest formulation, which comes first."""
    seconds, fastest = _seconds(record), _seconds(next(iter(best.values())))
    return seconds_text(seconds), record.settings["integrator"], f"{seconds / fastest:.3g}"


def _front(name: str, records: Sequence[Record]) -> ResultTable:
    shared = "; ".join(", ".join(_run(r)) for r in records if was_contended(r))
    return ResultTable(
        f"work-precision-front-{name}",
        f"{name}: no run is both faster and more accurate than these",
        (*RUN, "run time", "error of the end state"),
        [
            (*_run(r), seconds_text(_seconds(r)), f"{r.errors['final']:.1e}")
            for r in pareto_front(records)
        ],
        note=f"Disturbed, even the best run had to share its core: {shared}." if shared else "",
    )


def _drift_laws(name: str, records: Sequence[Record]) -> ResultTable:
    rows = []
    for record in most_accurate(records).values():
        laws = [record.errors.get(f"{error}_{law}") for error, law in product(DRIFTS, LAWS)]
        formats = (*LAWS.values(), *LAWS.values())
        rows.append((*_run(record), *map(cell_text, laws, formats)))
    heads = ("constraints, m/s per s", "t^", "energy, relative, per s", "t^")
    return ResultTable(
        f"work-precision-drift-{name}",
        f"{name}: drift in the most accurate run of each, and the power of time it goes with",
        (*RUN, *heads),
        rows,
    )


# ---- Charts --------------------------------------------------------------------------------------


def errors_shown(records: Sequence[Record]) -> dict[str, str]:
    """Return the errors defined for the scene of these Records, with their labels; all without
    Records.
    """
    return {
        error: label
        for error, label in ERRORS.items()
        if not records or any(not isnan(record.errors[error]) for record in records)
    }


def _absent(name: str, errors: Iterable[str]) -> str:
    """Return the reasons why errors have no panel, or ""."""
    case = REFERENCE_CASES.get(name)
    reason = case.scene().why_not_conserved if case else ""
    missing = []
    if "energy" not in errors:
        missing.append("energy is not conserved" + (f": {reason}" if reason else ""))
    if "constraint" not in errors:
        missing.append("no constraints")
    return "; ".join(missing)


def charts(records: Sequence[Record]) -> Iterator[Chart]:
    """Yield the errors of each scene against run time and right-hand sides."""
    integrators = values(records, "integrator")
    several = len(values(records, "reference")) > 1
    for name, mine in by_setting(records, "reference").items():
        done = select(mine)
        errors = errors_shown(done)
        floor = max((r.errors["floor"] for r in done), default=NOTHING)
        lowest = max(NOTHING, min((r.errors["final"] for r in done), default=NOTHING)) / 5
        axes = {key: _axis_of(done, key) for key in AGAINST}
        panels = {}
        for (error, label), against, integrator in product(errors.items(), AGAINST, integrators):
            final = error == "final"
            panels[integrator, label, AGAINST[against].title] = Panel(
                axes[against],
                Axis(label, log=True, range=(lowest, None) if final else None),
                _lines(select(done, integrator=integrator), error, against),
                integrator,
                unknown=floor if final else None,
            )
        missing = _absent(name, errors)
        what = f"{name}: one line a formulation, one point a tolerance"
        yield Chart(
            f"work-precision-{name}",
            f"{what}; {missing}" if missing else what,
            ["integrator", "error", "against"],
            panels,
            height=2.0,
            hollow="disturbed",
            parts=[
                File(
                    f"work-precision{f'-{name}' if several else ''}{end}",
                    f"{name}\n{missing}" if missing else name,
                    [[(i, label, axis.title) for i in integrators] for label in errors.values()],
                )
                for axis, end in zip(AGAINST.values(), ("", "-rhs"), strict=True)
            ],
        )


def _axis_of(records: Sequence[Record], against: str) -> Axis:
    """Return the abscissa that the panels of all integrators share."""
    axis, x = AGAINST[against], [_cost(record, against) for record in records]
    return axis._replace(range=(min(x) / MARGIN, max(x) * MARGIN)) if x else axis


def _cost(record: Record, against: str) -> float:
    return _seconds(record) if against == "seconds" else record.counts[against]


def _lines(records: Sequence[Record], error: str, against: str) -> list[Line]:
    timed, lines = against == "seconds", []
    for key, found in by_setting(select(records), "formulation").items():
        mine = sorted(found, key=lambda r: -r.settings["tolerance"])
        hollow = [timed and was_contended(r) for r in mine]
        x = partial(_cost, against=against)
        y = lambda r: max(r.errors[error], NOTHING)  # noqa: E731
        lines.append(line_of(key, mine, x, y, _hover_text, hollow=hollow))
    return lines


def _hover_text(record: Record) -> list[str]:
    key, integrator, tolerance = _run(record)
    counts = record.counts
    status = "disturbed: shared its core" if was_contended(record) else record.status
    return [
        f"{key}, {integrator}",
        f"tolerance {tolerance}",
        f"run time {seconds_text(_seconds(record))}, {status}",
        ", ".join(counted(counts[f"{what}s"], what) for what in ("right-hand side", "step")),
        *(f"{label} {record.errors[error]:.2e}" for error, label in errors_shown([record]).items()),
    ]


STUDY = Study(
    key="work-precision",
    cells=cells,
    label="integrating {motion}",
    worker=worker,
    tables=tables,
    charts=charts,
    remarks=remarks,
    reading="Error against run time over all tolerances; lower and further left is better.",
)
