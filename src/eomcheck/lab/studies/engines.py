"""Differences between each engine and the scenes' own equations, and the quantities that each
engine offers.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from eomcheck.claims import CLAIMS
from eomcheck.claims.finding import DECIDED
from eomcheck.claims.run import RunSelection, ValidationRun
from eomcheck.draws.pairwise_design import scene_cases
from eomcheck.engines import (
    ENGINES,
    Answers,
    Engine,
    asked_by_default,
    engine_of,
    isolated_names,
    plain_name,
    version_of,
)
from eomcheck.errors import EngineError, RefusedError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import largest
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.option_parsing import Isolated, Seed, check_count, parse_interval
from eomcheck.lab.show.table import Cell, ResultTable
from eomcheck.lab.store.record_file import Record, Settings, group, record_of_rows, rows_in
from eomcheck.lab.study import Study, failed, unfinished
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array
from eomcheck.scenes import SCENES

QUANTITIES = {
    "mass-matrix": "M",
    "bias": "B",
    "generalized-forces": "Q",
    "constraint-jacobian": "a",
    "constraint-drift": "γ",
    "engine-acceleration": "q̈",
    "engine-multipliers": "λ",
}
"""Claims that call engines -> the quantity compared."""
SHOWN = ("mass-matrix", "bias", "engine-acceleration", "engine-multipliers")
"""Claims with columns in the tables; the other quantities cancel in many poses, and are judged
only.
"""

CONSTRAINED = ("engine-acceleration", "engine-multipliers")
"""Claims whose quantities change if constraints are compliant."""

REFERENCE = "au"


@dataclass(frozen=True)
class EngineDifference:
    """Difference of one quantity between an engine and scenes of one class, over all states.

    `relative` is the largest difference from the scene's own value, divided by its largest entry,
    or by that of the quantities that cancel in it: B with one velocity of the other sign, the
    unconstrained acceleration. `share` is the largest observed / allowed of the decided Findings.
    Either is None if there is none. `gives_way` is whether the engine declares its constraints
    compliant, and the scenes have some: the difference is then one of model.
    """

    engine: str
    version: str
    scene: str
    claim: str
    states: int
    failed: int
    relative: float | None
    share: float | None
    gives_way: bool


def cells(
    *,
    engine: Annotated[list[str] | None, "Engine, or several: a,b. [default: all]"] = None,
    links: Annotated[str, "Number of links of the random scenes, N or N..M."] = "1..12",
    states: Annotated[int, "Random scenes of a kind, each in one state."] = 50,
    isolated: Isolated = False,
    seed: Seed = 0,
) -> Iterator[Settings]:
    """Yield a cell for each engine and each scene class that it represents.

    Raises:
        InputError, UnknownNameError: no such engine, no such numbers of links, or no states.
        EngineError: the library of an engine that is named is not there.
    """
    check_count(states=states)
    numbers = parse_interval(links)
    for key in study_engines(engine, isolated):
        kind = engine_of(key)
        for scene in SCENES.values():
            if kind.represents(scene.example()):
                where = {"engine": key, "scene": scene.key}
                yield where | {"links": numbers, "states": states, "seed": seed}


def study_engines(names: list[str] | None, isolated: bool) -> list[str]:
    """Return the names of the engines of a study, by default those of `asked_by_default`.

    Args:
        names: names that are given, None by default.
        isolated: whether optional libraries run in processes and environments of their own.

    Raises:
        InputError, UnknownNameError: see `engine_of`.
        EngineError: the library of an engine that is named is not there.
    """
    chosen = list(asked_by_default(ENGINES)) if names is None else names
    chosen = isolated_names(chosen) if isolated else chosen
    for kind in map(engine_of, chosen):
        if names is not None:
            version_of(kind)
    return chosen


def _compare(settings: Settings) -> Record:
    """Compare all states of one scene class that the engine represents."""
    key, kind = settings["engine"], SCENES[settings["scene"]]
    try:
        version = engine_of(key).version()
    except EngineError as missing:
        return Record(STUDY.key, settings, "refused", str(missing))
    selection = RunSelection.of([REFERENCE], [key], list(QUANTITIES), scenes=[kind])
    run, differences, states, held = ValidationRun(), dict[str, float](), 0, False
    for scene, state in scene_cases(kind, *(settings[x] for x in ("links", "states", "seed"))):
        if not engine_of(key).represents(scene):
            continue  # some libraries accept only physical inertias, sampled scenes have any
        engine, states, held = engine_of(key)(scene), states + 1, held or scene.r > 0
        allowed = {one.claim: one.allowed for one in run.check_state(scene, state, selection)}
        for claim, difference, size in _differences(engine, scene, state):
            # A quantity that is nothing but rounding has no size to be relative to.
            if size > allowed.get(claim, 0.0):
                differences[claim] = max(difference / size, differences.get(claim, 0.0))
    rows, compliant = [], held and engine_of(key).compliant
    for claim in CLAIMS:
        mine = [one for one in run.findings if one.claim == claim]
        ratios = [one.ratio for one in mine if one.verdict in DECIDED]
        if ratios or claim in differences:
            failures = sum(one.verdict == "failed" for one in mine)
            share, gives_way = max(ratios, default=None), compliant and claim in CONSTRAINED
            who = plain_name(key), version, kind.key, claim, states
            rows.append(EngineDifference(*who, failures, differences.get(claim), share, gives_way))
    if not rows:
        return Record(STUDY.key, settings, "refused", f"{key} takes no {kind.key} that is drawn")
    return record_of_rows(STUDY.key, settings, rows)


def _differences(engine: Engine, scene: Scene, state: State) -> Iterator[tuple[str, float, float]]:
    """Yield claim, largest difference, and its divisor for `EngineDifference.relative`."""
    at, answers = Evaluation(scene, *state), Answers(engine)
    turned = [Evaluation(scene, at.q, at.v * sign, at.t) for sign in 1 - 2 * np.eye(scene.n)]
    sizes = {
        "bias": max(largest(one.terms.B) for one in turned),
        "engine-acceleration": largest(np.linalg.solve(at.terms.M, at.F)),
    }
    terms, pairs = at.terms, dict[str, tuple[Array | None, Array | None]]()
    for claim in (CLAIMS[key] for key in QUANTITIES):
        built_in = getattr(terms, claim.against) if claim.against else None
        if built_in is not None and engine.offers(claim.asks):
            pairs[claim.id] = built_in, answers.ask(claim.asks, *state)
    if engine.offers("acceleration"):
        Q = np.zeros(scene.n) if terms.Q is None else terms.Q
        with suppress(RefusedError):
            built_in = at.acceleration(FORMULATIONS[REFERENCE])
            answer = answers.acceleration(at.q, at.v, Q, terms.a, terms.gamma, at.t)
            pairs["engine-acceleration"] = built_in.vdot, answer.vdot
            pairs["engine-multipliers"] = built_in.multipliers, answer.multipliers
    for claim, (built_in, answer) in pairs.items():
        if built_in is not None and answer is not None:
            yield claim, largest(built_in - answer), max(largest(built_in), sizes.get(claim, 0.0))


# ---- Results -------------------------------------------------------------------------------------


def tables(records: Sequence[Record]) -> Iterator[ResultTable]:
    """Yield the table of engines (quantities offered, largest differences), and the same by
    scenes.
    """
    rows = rows_in(records, EngineDifference)
    by_engine, by_scene = [], []
    for key, mine in group(rows, lambda one: one.engine).items():
        scenes = group(mine, lambda one: one.scene)
        states = str(sum(on_scene[0].states for on_scene in scenes.values()))
        failures = str(sum(one.failed for one in mine))
        offered = {one.claim for one in mine}.difference(SHOWN)
        also = ", ".join(name for claim, name in QUANTITIES.items() if claim in offered) or "-"
        name = Cell(mine[0].version, "name")
        by_engine.append((name, str(len(scenes)), states, failures, *_cells(mine), also))
        by_scene += [(Cell(key, "name"), x, *_cells(on_scene)) for x, on_scene in scenes.items()]
    shown = [QUANTITIES[claim] for claim in SHOWN]
    columns = ("engine", "scenes", "states", "failures", *shown, "also says")
    yield ResultTable(
        "engines", "Largest relative difference from the scene's own", columns, by_engine
    )
    columns = ("engine", "scene", *shown)
    yield ResultTable("engines-by-scene", "The same, scene by scene", columns, by_scene)


def _cells(rows: Sequence[EngineDifference]) -> list[Cell]:
    """Return the cells of the quantities that are shown."""
    return [_cell([one for one in rows if one.claim == claim]) for claim in SHOWN]


def _cell(rows: Sequence[EngineDifference]) -> Cell:
    errors = [row.relative for row in rows if row.relative is not None]
    if any(row.failed for row in rows):
        # A failure in a quantity too small for a relative difference has no number.
        return Cell(f"{max(errors):.0e} FAIL" if errors else "FAIL", "failed")
    if not errors:
        return Cell("-", "none")
    of_kinds: dict[str, list[float]] = {"": [], " inconclusive": [], " soft": []}
    for row in rows:
        if row.relative is not None:
            judged = "" if row.share is not None else " inconclusive"
            of_kinds[" soft" if row.gives_way else judged].append(row.relative)
    return Cell(", ".join(f"{max(those):.0e}{kind}" for kind, those in of_kinds.items() if those))


def remarks(records: Sequence[Record]) -> Iterator[str]:
    """Yield the libraries that are not installed, and the largest observed / allowed."""
    missing = {record.reason: None for record in records if record.status == "refused"}
    yield from missing
    yield from unfinished(records, "refused")
    rows = rows_in(records, EngineDifference)
    shares = [one.share for one in rows if one.share is not None]
    if shares:
        yield (
            f"Largest error: {max(shares):.1%} of what rounding allows. `soft`: constraints give "
            "way, so that the difference is one of model and not judged."
        )
    if any(one.share is None and not one.gives_way for one in rows):
        yield "`inconclusive`: rounding allows so much that nothing was decided."


def alarm(records: Sequence[Record]) -> bool:
    """Return whether an engine and a scene differ by more than rounding."""
    return failed(records) or any(one.failed for one in rows_in(records, EngineDifference))


STUDY = Study(
    key="engines",
    cells=cells,
    worker=lambda stored: _compare,
    tables=tables,
    remarks=remarks,
    label="comparing {pair} of engine and scene",
    alarm=alarm,
    reading="A dash: the engine does not say it, or no scene of the kind has it.",
    small=True,
    parallel_by=("engine", "scene"),
)
