"""Conformance of libraries: each quantity of each engine, on robots from packages and on scenes.

A cell is one library and one robot (read by the library itself) or one scene (its tree built in the
library). Every quantity that the engine offers is compared by its claim at random states; the
digits that are true are counted against ball arithmetic, in the first few of them.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Annotated, NamedTuple, cast

from eomcheck import strategies
from eomcheck.atomic_write import read_as
from eomcheck.claims import CLAIMS
from eomcheck.claims.engine_quantities import (
    BY_DIFFERENCES,
    CONFORMANCE,
    SOLVED,
    acceleration_asked,
    by_differences,
    follow,
    frames_asked,
    point_at,
)
from eomcheck.claims.finding import Finding, Verdict, worst
from eomcheck.claims.run import RunSelection, SceneEngines, evaluate_state
from eomcheck.descriptions.mechanism_class import Mechanism
from eomcheck.engines import (
    Answers,
    Engine,
    EngineFault,
    engine_of,
    make_engine,
    plain_name,
    reader_of,
    represents,
    version_of,
)
from eomcheck.errors import (
    CallError,
    EngineError,
    EomcheckError,
    InputError,
    RefusedError,
    RemoteError,
    UnknownNameError,
)
from eomcheck.evaluation.conformance import QUANTITIES, Quantity, enclosed_quantity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import largest
from eomcheck.lab.deviations import READING, Observation, differs_by
from eomcheck.lab.option_parsing import Isolated, Seed, check_count
from eomcheck.lab.show.chart import Axis, Box, Chart, Heat
from eomcheck.lab.show.table import Cell, ResultTable, table_of_markdown
from eomcheck.lab.store.record_file import Record, Settings, group, record_of_rows, rows_in
from eomcheck.lab.studies.engines import study_engines
from eomcheck.lab.studies.robots import ROBOTS, chosen_robot, chosen_robots, robot_label
from eomcheck.lab.study import Study, failed, unfinished
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array
from eomcheck.safe_output import listed
from eomcheck.scenes import SCENES
from eomcheck.strategies import draw_samples

DIGIT_STATES = 2
"""Number of states in which true digits are counted, which takes ball arithmetic."""

REPEATS = 2
"""Number of repeated calls for each answer in the first state, at every link; some libraries are
slow, and are called once in each other state."""

LEAST_SHARE = 0.4
"""Value in the color scale of a quantity that differs on one robot of very many."""

MOST_DIGITS = -math.log10(2.0**-53)
"""Decimal digits of a float64 that is right but for its own rounding."""

TERMS = {
    "mass-matrix": "mass_matrix",
    "bias": "bias",
    "generalized-forces": "forces",
    "engine-acceleration": "acceleration",
}
"""Claims about the terms of all engines -> method, beside those of `QUANTITIES`."""


@dataclass(frozen=True)
class ConformanceRow:
    """Result of one quantity of one engine on one robot or scene.

    Attributes:
        engine: its key.
        version: name and version of its library.
        robot: name of the robot or the scene.
        quantity: name of the method.
        states: number of states in which it was compared.
        verdict: the worst verdict.
        digits: fewest true decimal digits of the largest entry; None if not counted.
        detail: what differs in the worst state.
        fault: whether there is a state in which it gave no answer.
    """

    engine: str
    version: str
    robot: str
    quantity: str
    states: int
    verdict: Verdict
    digits: float | None
    detail: str
    fault: bool = False


def cells(
    *,
    robot: Annotated[list[str] | None, "Robot by name, its file, or scene; repeat."] = None,
    free: Annotated[list[str] | None, "Robot whose base is free; repeat for more."] = None,
    engine: Annotated[list[str] | None, "Engine, or several: a,b. [default: all]"] = None,
    isolated: Isolated = False,
    states: Annotated[int, "Random states of a robot."] = 12,
    seed: Seed = 0,
) -> Iterator[Settings]:
    """Yield a cell for each robot and each library that reads it, or scene and engine.

    Raises:
        InputError, UnknownNameError: no such robot or engine, or no states.
        EngineError: the library of an engine that is named is not there.
    """
    check_count(states=states)
    names = study_engines(engine, isolated)
    for chosen in chosen_robots(robot, free, SCENES):
        for key in names:
            yield chosen | {"engine": key, "states": states, "seed": seed}


class SampledScene(NamedTuple):
    """A robot or scene with its random states; what they compute is shared by all engines."""

    scene: Scene
    states: tuple[Evaluation, ...]


@lru_cache(maxsize=1)
def _sampled_scene(robot: str, free: bool, states: int, seed: int) -> SampledScene:
    """Return the robot or scene of a cell, the same one for the cells of other engines.

    Raises:
        EngineError: the package of the robot is not installed.
    """
    named = robot in SCENES
    scene = SCENES[robot].example() if named else chosen_robot({"robot": robot, "free": free})
    drawn = draw_samples(strategies.states(scene), states, seed)
    return SampledScene(scene, tuple(Evaluation(scene, *state) for state in drawn))


def _engine_class(scene: Scene, settings: Settings) -> type[Engine]:
    """Return the class of the engine of a cell.

    Raises:
        EngineError: the library does not read the robot, or does not hold the scene.
    """
    key, robot = settings["engine"], cast(Mechanism, scene)
    try:
        kind = engine_of(key) if settings["robot"] in SCENES else reader_of(robot, key)
    except UnknownNameError:
        raise EngineError(f"{key} reads no {robot.source.format.upper()}") from None
    if not represents(kind, scene):
        raise EngineError(f"{kind.key} does not represent {scene.name}")
    return kind


def has_ended(fault: EngineFault) -> bool:
    """Return whether a library ended its process or gave no answer, and raised no exception."""
    cause = fault.__cause__
    return isinstance(cause, CallError) and not isinstance(cause, RemoteError)


def _check(settings: Settings) -> Record:
    """Compare all quantities of one engine on one robot."""
    name = robot_label(settings)
    label = f"{name}, {settings['engine']}"
    try:
        about_states = (settings[key] for key in ("robot", "free", "states", "seed"))
        scene, evaluations = _sampled_scene(*about_states)
        kind = _engine_class(scene, settings)
        version = version_of(kind)
    except EomcheckError as refusal:
        return Record(STUDY.key, settings, "refused", f"{label}: {refusal}")
    try:
        engine = make_engine(kind, scene)
    except (EngineFault, EngineError) as refusal:  # such as at a file that it cannot read
        reason = f"{label}: {refusal.__cause__ or refusal}"
        if isinstance(refusal, EngineFault) and has_ended(refusal):
            return Record(STUDY.key, settings, "failed", reason)
        return Record(STUDY.key, settings, "refused", reason, counts={"unread": 1})
    claims = [claim for claim in (*TERMS, *CONFORMANCE) if kind.offers(CLAIMS[claim].asks)]
    selection = RunSelection.of(["gw"], [kind], claims, scenes=[scene])
    scene_engines = SceneEngines(scene, (engine,), {})
    found: dict[str, list[Finding]] = {claim: [] for claim in claims}
    digits: dict[str, float] = {}
    for number, at in enumerate(evaluations):
        state, repeats = State(at.q, at.v, at.t), 0 if number else REPEATS
        for finding in evaluate_state(scene_engines, state, selection, repeats, at).findings:
            if finding.claim in found and finding.verdict != "skipped":
                found[finding.claim].append(finding)
        if number < DIGIT_STATES:
            for method, count in true_digits(at, Answers(engine), kind):
                digits[method] = min(count, digits.get(method, MOST_DIGITS))
    rows = []
    for claim, findings in found.items():
        method = CLAIMS[claim].asks
        if findings:
            one = worst(findings)
            about = plain_name(settings["engine"]), version, name, method, len(findings)
            detail = one.detail if one.verdict == "failed" else ""
            fault = any(x.verdict == "failed" and math.isinf(x.observed) for x in findings)
            rows.append(ConformanceRow(*about, one.verdict, digits.get(method), detail, fault))
        elif method in digits and by_differences(kind, method):
            about = plain_name(settings["engine"]), version, name, method, DIGIT_STATES
            rows.append(ConformanceRow(*about, "skipped", digits[method], BY_DIFFERENCES))
    if not rows:
        return Record(STUDY.key, settings, "refused", f"{label} offers nothing")
    return record_of_rows(STUDY.key, settings, rows)


def true_digits(
    at: Evaluation, answers: Answers, kind: type[Engine]
) -> Iterator[tuple[str, float]]:
    """Yield the quantities that an engine offers, each with the true digits of its answer.

    They are those of the largest entry, at one link for a quantity of frames.
    """
    vdot = acceleration_asked(at)
    point = point_at(at, vdot)
    for one in QUANTITIES.values():
        if not kind.offers(one.name) or one.lacks(point):
            continue
        if one.mapping in SOLVED and follow(answers.engine, at):
            continue
        frame = frames_asked(at, point, answers.has_frame)[0] if one.of_frame else ""
        tau = point.torques if "tau" in one.arguments else None
        try:
            truth = _truth(at, one, frame, vdot, tau)
            third = vdot if tau is None else tau
            theirs = answers.ask(one.name, at.q, at.v, third, frame, at.t)
        except (RefusedError, EngineFault):
            continue
        size = largest(truth)
        if size > 0:
            error = max(largest(theirs - truth) / size, 2.0**-53)
            yield one.name, max(-math.log10(error), 0.0)


def _truth(at: Evaluation, one: Quantity, frame: str, vdot: Array, tau: Array | None) -> Array:
    """Return the true value of a quantity, rounded once; of U the difference from that at q = 0."""
    truths = at.cached(_truths)
    if (one.name, frame) not in truths:
        truths[one.name, frame] = one.up_to_constant(
            lambda q: enclosed_quantity(at.elsewhere(q), one, frame, vdot, tau), at.q
        )
    return truths[one.name, frame]


def _truths(at: Evaluation) -> dict[tuple[str, str], Array]:
    """Return the true values at a state that are kept, by quantity and link."""
    return {}


# ---- Results -------------------------------------------------------------------------------------


def tables(records: Sequence[Record]) -> Iterator[ResultTable]:
    """Yield the table of quantities by engine over all robots, one by robot, and differences."""
    rows = rows_in(records, ConformanceRow)
    engines = list(group(rows, lambda one: one.engine))
    methods = [*TERMS.values(), *QUANTITIES]
    by_quantity, by_robot = [], []
    for method in methods:
        mine = [one for one in rows if one.quantity == method]
        cells_of = (_cell([one for one in mine if one.engine == key]) for key in engines)
        by_quantity.append((Cell(method, "name"), *cells_of))
    for robot, mine in group(rows, lambda one: one.robot).items():
        cells_of = (_count([one for one in mine if one.engine == key]) for key in engines)
        by_robot.append((Cell(robot, "name"), *cells_of))
    title = "Each quantity of each library: robots on which it differs, and fewest true digits"
    yield ResultTable("conformance", title, ("quantity", *engines), by_quantity)
    title = "Each robot: number of quantities that agree, of those that are offered"
    yield ResultTable("conformance-by-robot", title, ("robot", *engines), by_robot)
    title = "Each library: what it was asked"
    columns = "library", "version", "quantities", "robots and scenes", "states"
    columns += ("quantities that differ",)
    yield ResultTable("conformance-libraries", title, columns, _libraries(records))
    title = "Each quantity that differs, and on which robots"
    columns = "library", "quantity", "differs on"
    yield ResultTable("conformance-differences", title, columns, _differences(rows))


def charts(records: Sequence[Record]) -> Iterator[Chart]:
    """Yield the heat map of quantities by engine: number of robots on which each differs."""
    return _charts_of({table.name: table for table in tables(records)})


def _charts_of(named: Mapping[str, ResultTable]) -> Iterator[Chart]:
    """Yield the heat map of tables, by name."""
    by_quantity, differences = named["conformance"], named["conformance-differences"]
    engines = by_quantity.columns[1:]
    wrong = {(key, one): robots.count("; ") + 1 for key, one, robots in differences.rows}
    boxes = {}
    for quantity, *cells_of in by_quantity.rows:
        row = [
            _box(text, wrong.get((key, quantity), 0))
            for key, text in zip(engines, cells_of, strict=True)
        ]
        if any(row):
            boxes[str(quantity)] = ("", row)
    if boxes:
        colors = Axis("share of robots on which it differs", range=(0.0, 1.0))
        heads = dict.fromkeys(engines, 1)
        heat = Heat(heads, boxes, colors, 1.0, "not judged", "differs", steep=True)
        title = "Robots on which it differs; no number: agrees on all; no box: not computed"
        yield Chart("conformance", title, ["figure"], {("all",): heat})


def _box(cell: str, wrong: int) -> Box | None:
    """Return the box of one quantity of one engine; None if it does not compute it.

    Args:
        cell: cell of the table, see `_cell`.
        wrong: number of robots on which it differs.
    """
    if cell == "-":
        return None
    if cell.endswith(("inconclusive", "by differences")):
        return Box(math.nan, True, False, ("inconclusive or by differences",))
    share = wrong / int(cell.rpartition(" ")[2]) if wrong else 0.0
    value = LEAST_SHARE + (1.0 - LEAST_SHARE) * share if wrong else 0.0
    return Box(value, False, bool(wrong), (cell,), str(wrong or ""))


# ---- Tables of an earlier run --------------------------------------------------------------------

BY_QUANTITY, BY_ROBOT = BY_ENGINE = "conformance", "conformance-by-robot"
"""Names of the tables with a column for each engine; others have rows for each."""

LIBRARIES, DIFFERENCES = "conformance-libraries", "conformance-differences"
"""Names of the tables with rows for each engine."""

OF_FILES = "forces", "acceleration"
"""Quantities that the engines of trees do not have of scenes."""

NO_ANSWER = "no answer"
"""Beginning of the cell of a quantity that a library does not answer on some robots."""


def extends(
    records: Sequence[Record], folder: Path
) -> tuple[Sequence[ResultTable], Iterator[Chart]]:
    """Return tables and charts of Records and of what earlier tables have beside them.

    Engines that are not in the Records keep their columns and rows. An engine that is in both is
    replaced if it was asked on all its earlier robots again; otherwise it is extended by the other
    robots, and its results on earlier ones have to be those of the tables.

    Raises:
        InputError: a table is not in the folder, cannot be read, or has other columns; or an engine
            was asked again on some of its earlier robots only, with another result.
    """
    tables_now, printed = {table.name: table for table in tables(records)}, {}
    for name, table in tables_now.items():
        path, read = folder / f"{name}.md", partial(table_of_markdown, name)
        # Where nothing differs there is no table of differences.
        empty = name == DIFFERENCES and not path.exists()
        printed[name] = (
            table._replace(rows=[]) if empty else read_as(path, "a table in Markdown", read)
        )
    engines = {one.engine for one in rows_in(records, ConformanceRow)}
    repeated = {
        (key, robot)
        for key in engines
        for robot in _repeated(key, printed[BY_ROBOT], tables_now[BY_ROBOT], folder)
    }
    more = [
        record
        for record in records
        if (plain_name(record.settings["engine"]), robot_label(record.settings)) not in repeated
    ]
    counts = Counter((one.engine, one.quantity) for one in rows_in(more, ConformanceRow))
    # An engine of which every robot is repeated has nothing to add.
    engines = {key for key, _ in counts}
    tables_more = {table.name: table for table in tables(more)}
    added = set()
    for key in engines:
        old, new = (_column(one[BY_ROBOT], key).keys() for one in (printed, tables_more))
        if old and not old & new:
            added.add(key)
    named = {name: _extended(table, printed[name], engines) for name, table in tables_more.items()}
    for key in added:
        _add_to_columns(named, printed, key, counts)
    if added:
        _add_to_rows(named, printed, added)
    return [*named.values()], _charts_of(named)


def _repeated(key: str, printed: ResultTable, table: ResultTable, folder: Path) -> set[str]:
    """Return the earlier robots on which an engine was asked again, if not on all of them.

    Raises:
        InputError: a result is another one than that of the earlier table.
    """
    old, new = _column(printed, key), _column(table, key)
    again = old.keys() & new.keys()
    if again == old.keys():
        return set()
    if different := sorted(name for name in again if old[name] != new[name]):
        raise InputError(
            f"{key} has another result on {listed(different, 3)} than in {folder}, expected it to "
            f"be asked on all {len(old)} robots there again"
        )
    return again


def _column(table: ResultTable, key: str) -> dict[str, str]:
    """Return the cells of an engine in a table with a column for each, by the name of the row.

    Dashes are left out.
    """
    if key not in table.columns:
        return {}
    at = [*table.columns].index(key)
    return {str(row[0]): str(row[at]) for row in table.rows if str(row[at]) != "-"}


def _add_to_columns(
    named: dict[str, ResultTable],
    printed: Mapping[str, ResultTable],
    key: str,
    counts: Mapping[tuple[str, str], int],
) -> None:
    """Change the cells of an engine in tables to those of earlier robots and new ones together.

    Args:
        named: the tables, by name.
        printed: the earlier ones.
        key: the engine.
        counts: engine and quantity -> number of new robots.
    """
    old_robots = _column(printed[BY_ROBOT], key)
    old_cells = _column(printed[BY_QUANTITY], key)
    for name, merged in (
        (BY_ROBOT, lambda robot, cell: old_robots.get(robot, "-") if cell == "-" else cell),
        (
            BY_QUANTITY,
            lambda quantity, cell: _merged_cell(
                old_cells.get(quantity, "-"),
                cell,
                _robots_with(quantity, len(old_cells), old_robots),
                counts.get((key, quantity), 0),
            ),
        ),
    ):
        at, rows = [*named[name].columns].index(key), []
        for row in named[name].rows:
            cells_of = [*row]
            cells_of[at] = merged(str(row[0]), str(row[at]))
            rows.append(cells_of)
        named[name] = named[name]._replace(rows=rows)


def _robots_with(quantity: str, everything: int, robots: Mapping[str, str]) -> int:
    """Return the number of robots on which an engine was asked for a quantity; 0 if unknown.

    A cell "agrees" has no number of robots: it is that of all, if each answered everything.

    Args:
        quantity: name of the quantity.
        everything: number of quantities that the engine has.
        robots: cells of the engine by robot.
    """
    count = 0
    for robot, cell in robots.items():
        missing = everything - int(cell.rpartition(" ")[2])
        if missing and not (robot in SCENES and missing == len(OF_FILES)):
            return 0
        count += not (missing and quantity in OF_FILES)
    return count


def _merged_cell(old: str, new: str, old_robots: int, new_robots: int) -> str:
    """Return the cell of a quantity over earlier robots and new ones, see `_cell`.

    Args:
        old, new: the cells.
        old_robots: number of earlier robots if the cell has none, 0 if unknown.
        new_robots: number of new robots.

    Raises:
        InputError: the number of earlier robots is needed, and unknown.
    """
    if "-" in (old, new):
        return new if old == "-" else old
    parts = [cell.rpartition(" on ")[::2] for cell in (old, new)]
    if any(word for word, _ in parts):
        word = NO_ANSWER if any(x == NO_ANSWER for x, _ in parts) else "differs"
        wrong, total = 0, 0
        for (kind, share_of), robots in zip(parts, (old_robots, new_robots), strict=True):
            some, _, of = share_of.partition(" of ") if kind else ("0", "", str(robots))
            if of == "0":
                raise InputError(
                    f"{old!r} of the earlier tables has no number of robots, expected the library "
                    "to be asked on all robots again"
                )
            wrong, total = wrong + int(some) * (kind == word), total + int(of)
        return f"{word} on {wrong} of {total}"
    digits = [cell for cell in (old, new) if cell[0].isdigit()]
    if digits:
        return min(digits, key=lambda cell: int(cell.partition(" ")[0]))
    return "agrees" if "agrees" in (old, new) else new


def _add_to_rows(
    named: dict[str, ResultTable], printed: Mapping[str, ResultTable], added: Collection[str]
) -> None:
    """Change the rows of engines in tables to those of earlier robots and new ones together.

    Args:
        named: the tables, by name.
        printed: the earlier ones.
        added: the engines.
    """
    names = {
        (str(key), str(quantity)): [str(robots)]
        for key, quantity, robots in printed[DIFFERENCES].rows
        if key in added
    }
    for key, quantity, robots in named[DIFFERENCES].rows:
        names.setdefault((str(key), str(quantity)), []).append(str(robots))
    rows = [
        (Cell(key, "name"), Cell(quantity, "name"), "; ".join(robots))
        for (key, quantity), robots in names.items()
    ]
    named[DIFFERENCES] = named[DIFFERENCES]._replace(rows=rows)
    old = {str(row[0]): row for row in printed[LIBRARIES].rows}
    rows = []
    for row in named[LIBRARIES].rows:
        key, version, quantities, robots, states, wrong = map(str, row)
        if key in added:
            quantities = str(len(_column(named[BY_QUANTITY], key)))
            robots, states = (str(int(str(old[key][k])) + int(str(row[k]))) for k in (3, 4))
            wrong = str(sum(name == key for name, _ in names))
        rows.append((Cell(key, "name"), version, quantities, robots, states, wrong))
    order = [*old, *(key for key, *_ in rows if key not in old)]
    rows.sort(key=lambda one: order.index(one[0]))
    named[LIBRARIES] = named[LIBRARIES]._replace(rows=rows)


def _extended(table: ResultTable, printed: ResultTable, engines: set[str]) -> ResultTable:
    """Return a table of some engines with all that is about others in an earlier one.

    Raises:
        InputError: the earlier one has other columns.
    """
    if table.name not in BY_ENGINE:
        if [*table.columns] != [*printed.columns]:
            raise InputError(f"{table.name}.md has other columns, expected {table.columns}")
        others = [row for row in printed.rows if row[0] not in engines]
        return table._replace(rows=[*others, *table.rows])
    old, new = (
        {row[0]: dict(zip(one.columns, row, strict=True)) for row in one.rows}
        for one in (printed, table)
    )
    columns = [*dict.fromkeys((*printed.columns, *table.columns))]
    rows = []
    for name in dict.fromkeys((*old, *new)):
        cells_of = ((new if x in table.columns else old).get(name, {}) for x in columns[1:])
        rows.append(
            [name, *(x.get(key, "-") for x, key in zip(cells_of, columns[1:], strict=True))]
        )
    return table._replace(columns=columns, rows=rows)


# ---- Rows of the tables --------------------------------------------------------------------------


def _libraries(records: Sequence[Record]) -> list[tuple[str, ...]]:
    """Return a row for each engine: its library and the numbers of what it was asked."""
    table, rows = [], rows_in(records, ConformanceRow)
    done = group(_done(records), lambda one: plain_name(one["engine"]))
    for engine, mine in group(rows, lambda one: one.engine).items():
        wrong = {one.quantity for one in mine if one.verdict == "failed"}
        states = sum(one["states"] for one in done.get(engine, ()))
        asked = len({x.quantity for x in mine}), len({x.robot for x in mine})
        counts = *asked, states, len(wrong)
        table.append((Cell(engine, "name"), mine[0].version, *map(str, counts)))
    return table


def _differences(rows: Sequence[ConformanceRow]) -> list[tuple[str, ...]]:
    """Return a row for each quantity of each engine that differs: the names of the robots."""
    table = []
    for (engine, quantity), mine in group(rows, lambda one: (one.engine, one.quantity)).items():
        robots = [one.robot for one in mine if one.verdict == "failed"]
        if robots:
            table.append((Cell(engine, "name"), Cell(quantity, "name"), "; ".join(robots)))
    return table


def _cell(rows: Sequence[ConformanceRow]) -> Cell:
    """Return the cell of one quantity of one engine."""
    if not rows:
        return Cell("-", "none")
    counted = [one.digits for one in rows if one.digits is not None]
    digits = f"{min(counted):.0f} digits" if counted else ""
    wrong = [one for one in rows if one.verdict == "failed"]
    if faulty := sum(one.fault for one in rows):
        return Cell(f"{NO_ANSWER} on {faulty} of {len(rows)}", "failed")
    if wrong:
        return Cell(f"differs on {len(wrong)} of {len(rows)}", "failed")
    if all(one.verdict == "skipped" for one in rows):
        return Cell(f"{digits} by differences", "open")
    if all(one.verdict == "inconclusive" for one in rows):
        return Cell("inconclusive", "open")
    return Cell(digits or "agrees", "passed")


def _count(rows: Sequence[ConformanceRow]) -> Cell:
    """Return the cell of one robot and one engine."""
    rows = [one for one in rows if one.verdict != "skipped"]
    if not rows:
        return Cell("-", "none")
    wrong = sum(one.verdict == "failed" for one in rows)
    kind = "failed" if wrong else "passed"
    return Cell(f"{len(rows) - wrong} of {len(rows)}", kind)


def remarks(records: Sequence[Record]) -> Iterator[str]:
    """Yield the number of states, the quantities that differ, each with what differs, and the
    robots left out.
    """
    yield states_compared(records)
    for one in rows_in(records, ConformanceRow):
        if one.verdict == "failed":
            yield f"{one.robot}, {one.version}, {one.quantity}: {one.detail}"
    yield from unfinished(records, "refused")


def states_compared(records: Sequence[Record]) -> str:
    """Return the sentence with the numbers of states, of pairs and of robots compared."""
    done = _done(records)
    states = sum(settings["states"] for settings in done)
    engines = {plain_name(settings["engine"]) for settings in done}
    robots = {robot_label(settings) for settings in done}
    return (
        f"{states} states compared, in {len(done)} pairs of one of {len(engines)} libraries and "
        f"one of {len(robots)} robots and scenes"
    )


def _done(records: Sequence[Record]) -> list[Settings]:
    """Return the settings of the cells in which something was compared."""
    return [record.settings for record in records if record.status == "done"]


def alarm(records: Sequence[Record]) -> bool:
    """Return whether a cell failed or a library gave no answer; that it differs is a result."""
    faulty = any(one.fault for one in rows_in(records, ConformanceRow))
    return faulty or failed(records)


def observations(records: Sequence[Record]) -> Iterator[Observation]:
    """Yield the observations: each quantity of each engine on each robot, and unread robots."""
    for one in rows_in(records, ConformanceRow):
        differs = differs_by(one.verdict)
        yield Observation(one.engine, one.quantity, _short(one.robot), differs, one.detail)
    for record in records:
        unread = "unread" in record.counts
        if record.settings["robot"] not in SCENES and (unread or record.status == "done"):
            name = _short(robot_label(record.settings))
            yield Observation(
                plain_name(record.settings["engine"]), READING, name, unread, record.reason
            )


def _short(robot: str) -> str:
    """Return the name of a robot; of one that is given by its file, that without the ending."""
    file, comma, free = robot.partition(", free")
    return robot if file in ROBOTS else Path(file).stem + comma + free


STUDY = Study(
    key="conformance",
    cells=cells,
    worker=lambda stored: _check,
    tables=tables,
    charts=charts,
    remarks=remarks,
    label="comparing {robot} with {engine}",
    alarm=alarm,
    observations=observations,
    reading="A dash: the library does not compute it, or does not read the robot.",
    small=True,
    extends=extends,
    parallel_by=("robot", "free", "engine"),
)
