"""Stability atlas: every formulation on families of increasingly severe states, certified.

A family is a sequence of states whose severity is one number; `FAMILIES` lists them all. Each cell,
one formulation at one state, is one Record: the true relative error against ball arithmetic, the
error bound and κ ε beside it, the condition number of each matrix solved, or the refusal and its
reason. Verdicts are derived from the Records, as are the tables, a heat map of all families, and
the digits lost in each family.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from enum import IntEnum
from functools import lru_cache
from typing import Annotated, NamedTuple

from eomcheck.errors import EomcheckError, InputError, RefusedError, at_least_one, registered
from eomcheck.evaluation.certified import (
    FLOAT64_DIGITS,
    REFERENCE_DIGITS,
    Enclosure,
    accuracy_at,
    certified_digits,
    enclose,
    relative_error,
    true_acceleration,
)
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import NOTICEABLE
from eomcheck.formulations import FORMULATIONS, applicable, formulation_of
from eomcheck.lab.show.chart import Axis, Box, Chart, Heat, Line, Panel, in_rows, spelled_out
from eomcheck.lab.show.table import ResultTable
from eomcheck.lab.store.record_file import Record, Settings, by_setting, group
from eomcheck.lab.studies.stability.families import FAMILIES, Family, Posed
from eomcheck.lab.study import Formulations, Study
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import EPS
from eomcheck.safe_output import counted
from eomcheck.scene_lookup import scene_classes_named
from eomcheck.scenes import Snake


def families_about(kinds: Iterable[type[Scene]]) -> tuple[Family, ...]:
    """Return the families shown under these scene classes."""
    keys = {kind.key for kind in kinds}
    return tuple(family for family in FAMILIES.values() if family.about in keys)


# ---- Cells and their outcomes --------------------------------------------------------------------

STATE = ("family", "variant", "severity")
"""Settings that identify a state of a family."""


class Method(NamedTuple):
    """Formulation, with the paper's partition or a pivoted one."""

    key: str
    pivoted: bool = False

    @property
    def name(self) -> str:
        """The key, and whether pivoted."""
        return f"{self.key}, pivoted" if self.pivoted else self.key


def methods_of(keys: Iterable[str]) -> Iterator[Method]:
    """Yield each formulation, and those with a partition once more with a pivoted one."""
    for key in keys:
        yield Method(key)
        if formulation_of(key).partitioned:
            yield Method(key, True)


def cells(
    *,
    scene: Annotated[str | None, "Kind of scene, or all of them. [default: snake]"] = None,
    family: Annotated[list[str] | None, "Family of states, or several: a,b. [default: all]"] = None,
    formulation: Formulations = None,
    quick: Annotated[bool, "A few severities of each family."] = False,
) -> Iterator[Settings]:
    """Yield a cell for each state of each family, and each method that applies to its scenes.

    The default families are those of the scene classes.

    Raises:
        InputError: none of these scene classes has a family.
        UnknownNameError: no such scene, family or formulation.
    """
    if scene is not None and family is not None:
        raise InputError("scene and family are both given: a family has its own scene")
    kinds = scene_classes_named(scene or "snake")
    about = [one.key for one in families_about(kinds)]
    if not about:
        keys = ", ".join(kind.key for kind in kinds)
        raise InputError(f"scene = {keys}: the atlas has no families of states for it")
    keys = at_least_one("family", about if family is None else family)
    families = [registered("family", key, FAMILIES) for key in keys]
    keys = at_least_one("formulation", FORMULATIONS if formulation is None else formulation)
    methods = list(methods_of(keys))
    for one in families:
        apply = applicable(one.scene)
        for variant in one.variants:
            for severity in one.quick if quick else one.values:
                for method in methods:
                    if method.key in apply:
                        yield settings_of(one.key, variant, severity, method)


def settings_of(family: str, variant: str, severity: float, method: Method) -> Settings:
    """Return the settings of a cell."""
    state = dict(zip(STATE, (family, variant, severity), strict=True))
    return state | {"formulation": method.key, "pivoted": method.pivoted}


State = tuple[Posed, Enclosure | None, Evaluation] | EomcheckError
"""Posed state, certified value (None: each method has its own) and float64 evaluation; or the error
that prevents them.
"""


# Consecutive cells are the methods at one state, in one process, and share it.
@lru_cache(maxsize=1)
def _state(family: str, variant: str, severity: float) -> State:
    posed = FAMILIES[family].pose(variant, severity)
    try:
        if posed.v is not None:
            return posed, None, Evaluation(posed.scene, posed.q, posed.v)
        return posed, *true_acceleration(posed.scene, posed.q, posed.u)
    except EomcheckError as error:
        return error


def _own_truth(posed: Posed, method: Method) -> Enclosure:
    key, pivoted = method
    return enclose(posed.scene, key, posed.q, digits=REFERENCE_DIGITS, v=posed.v, pivoted=pivoted)


def measure(settings: Settings) -> Record:
    """Return the Record of one method at one state."""
    method = Method(settings["formulation"], settings["pivoted"])
    state = _state(*(settings[name] for name in STATE))
    if isinstance(state, EomcheckError):
        return _unsolved(settings, state)
    posed, shared, at = state
    try:
        truth = _own_truth(posed, method) if shared is None else shared
        found = accuracy_at(formulation_of(method.key), truth, at, method.pivoted)
    except EomcheckError as error:
        return _unsolved(settings, error)
    errors = {
        "relative": found.relative,
        "bound": found.relative_bound,
        "predicted": found.kappa * EPS,
        "condition": max(found.condition.values()),
        **{f"condition {name}": value for name, value in found.condition.items()},
    }
    if shared is None:
        errors["question"] = relative_error(truth.doubles(), _own_truth(posed, Method("au")))
    return Record(STUDY.key, settings, errors=errors)


def _unsolved(settings: Settings, error: EomcheckError) -> Record:
    if isinstance(error, RefusedError):
        return Record(STUDY.key, settings, "refused", str(error), errors={"rcond": error.rcond})
    return Record(STUDY.key, settings, "failed", str(error))


# ---- Outcomes of Records -------------------------------------------------------------------------


class CellOutcome(IntEnum):
    """Outcome of a cell, from good to bad."""

    GOOD = 0
    """The true relative error is at most 1e-6."""
    REFUSED = 1
    """The formulation declines, with a reason."""
    REPORTED = 2
    """The error is larger, and the error bound reports it."""
    SILENT = 3
    """The error is larger, and nothing reports it."""


def outcome_of(record: Record) -> CellOutcome:
    """Return the outcome of one cell; a cell that failed counts as refused."""
    if record.status != "done":
        return CellOutcome.REFUSED
    relative = record.errors["relative"]
    if relative <= NOTICEABLE:
        return CellOutcome.GOOD
    return CellOutcome.REPORTED if relative <= record.errors["bound"] else CellOutcome.SILENT


def method_of(record: Record) -> Method:
    """Return the method of a cell."""
    return Method(record.settings["formulation"], record.settings["pivoted"])


def digits_lost(relative: float) -> float:
    """Return the decimal digits, of the `FLOAT64_DIGITS`, that a relative error destroys."""
    return FLOAT64_DIGITS - certified_digits(relative)


class Step(NamedTuple):
    """Cells of a method at one severity of a family, over all variants."""

    severity: float
    records: list[Record]

    @property
    def solved(self) -> list[Record]:
        """Cells with a result."""
        return [record for record in self.records if record.status == "done"]

    @property
    def worst(self) -> CellOutcome:
        """The worst outcome."""
        return max(map(outcome_of, self.records))

    @property
    def lost(self) -> float:
        """The most digits lost, NaN if nothing was solved."""
        return self._most("relative")

    @property
    def predicted(self) -> float:
        """The most digits lost by the prediction κ ε, NaN if nothing was solved or lost."""
        return self._most("predicted")

    @property
    def refused(self) -> float:
        """The share of refused cells."""
        return 1.0 - len(self.solved) / len(self.records)

    def _most(self, error: str) -> float:
        # An exact result, as at rest without forces, has no digits to lose.
        inexact = [r for r in self.solved if r.errors["relative"] > 0 or error == "relative"]
        return max((digits_lost(r.errors[error]) for r in inexact), default=math.nan)


Atlas = dict[str, dict[Method, list[Step]]]
"""Family -> method -> its steps, from mild to severe."""


def atlas_of(records: Iterable[Record]) -> Atlas:
    """Return the steps of every method through every family, in the order of `FAMILIES`."""
    of = by_setting(records, "family")
    return {
        family: {
            method: _steps(facts.values, mine)
            for method, mine in group(of[family], method_of).items()
        }
        for family, facts in FAMILIES.items()
        if family in of
    }


def _steps(severities: Sequence[float], records: list[Record]) -> list[Step]:
    at = by_setting(records, "severity")
    return [Step(severity, at[severity]) for severity in sorted(at, key=severities.index)]


class Break(NamedTuple):
    """First severity at which a method gives no good result."""

    severity: float
    outcome: CellOutcome
    record: Record
    """The worst cell there."""
    lost: float
    """The most digits lost before, NaN if nothing was solved."""


def lost_in(steps: Iterable[Step]) -> float:
    """Return the most digits lost in any of these steps, NaN if nothing was solved."""
    return max((step.lost for step in steps if not math.isnan(step.lost)), default=math.nan)


def break_of(steps: Sequence[Step]) -> Break | None:
    """Return the break of a method in a family, or None: it gives good results throughout."""
    for index, step in enumerate(steps):
        if step.worst is not CellOutcome.GOOD:
            worst = max(step.records, key=outcome_of)
            return Break(step.severity, step.worst, worst, lost_in(steps[:index]))
    return None


WORDS = {
    CellOutcome.REFUSED: "refused",
    CellOutcome.REPORTED: "bound tells",
    CellOutcome.SILENT: "SILENT",
}
LIMIT = digits_lost(NOTICEABLE)
"""Digits lost from which on a result is no longer good."""
CROSSES, STEP = FLOAT64_DIGITS + 1.0, 0.4
"""Ordinate of the first row of crosses for refusals, and distance of the rows, one a method."""
ALL = "all"
READING = (
    f"A result is good up to a true relative error of {NOTICEABLE:g}. Digits lost are those of the "
    "worst variant; crosses above are refusals."
)


def scenes_of(atlas: Atlas) -> list[str]:
    """Return the keys of the scenes of an atlas, in the order of the registry."""
    return list(dict.fromkeys(FAMILIES[family].about for family in atlas))


def methods_in(atlas: Atlas) -> list[Method]:
    """Return the methods in an atlas."""
    return list(dict.fromkeys(method for methods in atlas.values() for method in methods))


def wrong(record: Record) -> bool:
    """Return whether a cell failed, or is wrong without a report."""
    return record.status == "failed" or outcome_of(record) is CellOutcome.SILENT


def alarm(records: Sequence[Record]) -> bool:
    """Return whether any cell failed, or is wrong without a report."""
    return any(map(wrong, records))


def parts(atlas: Atlas) -> Iterator[tuple[str, Atlas]]:
    """Yield the parts of an atlas shown together, each with its name.

    The snake, or a single scene, has a part of its own; several other scenes share one.
    """
    scenes = scenes_of(atlas)
    alone = scenes if len(scenes) == 1 else [key for key in scenes if key == Snake.key]
    for keys in (alone, [key for key in scenes if key not in alone]):
        if keys:
            name = f"stability-{keys[0]}" if len(keys) == 1 else "stability-scenes"
            part = {key: atlas[key] for key in atlas if FAMILIES[key].about in keys}
            yield "stability" if keys == [Snake.key] else name, part


# ---- Tables --------------------------------------------------------------------------------------


def tables(records: Sequence[Record]) -> Iterator[ResultTable]:
    """Yield the breaks of each method in each family with reasons, a summary of them, and wrong
    cells.

    In the summary of several scenes, which have many families, a family is a line; of one it is a
    column.
    """
    atlas = atlas_of(records)
    for family, methods in atlas.items():
        facts = FAMILIES[family]
        rows = [(method.name, *_row(mine)) for method, mine in methods.items()]
        title, columns = f"{facts.title}: {facts.severity}", ("method", *BREAK)
        yield ResultTable(f"stability-{family}", title, columns, rows, detail=True)
    for name, part in parts(atlas):
        several = len(scenes_of(part)) > 1
        lines = [["family" if several else "method", *(FAMILIES[key].title for key in part)]]
        lines += [
            [method.name, *(_short(part[family].get(method)) for family in part)]
            for method in methods_in(part)
        ]
        if several:
            lines = [list(column) for column in zip(*lines, strict=True)]
        title = "Severity at which a method first fails to give a good result"
        note = "Empty: it never does; –: it does not apply."
        yield ResultTable(f"{name}-breaks", title, lines[0], lines[1:], note=note)
    if rows := [_wrong(record) for record in records if wrong(record)]:
        title = "What failed, or is wrong and nothing says so"
        columns = ("method", "outcome", "family", "variant", "severity", "what")
        yield ResultTable("stability-wrong", title, columns, rows)


BREAK = ("breaks at", "", "digits lost before", "why")
"""Headings of `_row`."""


def _row(mine: Sequence[Step]) -> tuple[str, ...]:
    first = break_of(mine)
    lost = lost_in(mine) if first is None else first.lost
    text = "" if math.isnan(lost) else f"{lost:.1f}"
    if first is None:
        return "", "", text, ""
    record = first.record
    why = record.reason if record.status != "done" else _large(record)
    return f"{first.severity:.3g}", WORDS[first.outcome], text, why


def _large(record: Record) -> str:
    names = (name for name in record.errors if name.startswith("condition "))
    matrix = max(names, key=record.errors.__getitem__)
    return (
        f"true error {record.errors['relative']:.0e}; condition number of "
        f"{matrix.removeprefix('condition ')} {record.errors[matrix]:.0e}"
    )


def _short(mine: Sequence[Step] | None) -> str:
    """Return the break of a method, such as "1e-08 refused"; a break reported by the error bound is
    only a severity.
    """
    if mine is None:
        return "–"
    first = break_of(mine)
    if first is None:
        return ""
    reported = first.outcome is CellOutcome.REPORTED
    return f"{first.severity:.3g}" if reported else f"{first.severity:.3g} {WORDS[first.outcome]}"


def _wrong(record: Record) -> tuple[str, ...]:
    s = record.settings
    where = s["family"], s["variant"], f"{s['severity']:g}"
    what = record.reason or ", ".join(f"{name} {x:.3g}" for name, x in record.errors.items())
    return method_of(record).name, record.status if record.reason else "SILENT", *where, what


def remarks(records: Sequence[Record]) -> Iterator[str]:
    """Yield the number of cells by outcome."""
    counts = Counter(outcome_of(r) for r in records if r.settings["family"] in FAMILIES)
    yield (
        f"{counted(counts.total(), 'cell')}: {counts[CellOutcome.GOOD]} good "
        f"(true relative error at most {NOTICEABLE:g}), {counts[CellOutcome.REFUSED]} refused, "
        f"{counts[CellOutcome.REPORTED]} worse as their error bound tells, "
        f"{counts[CellOutcome.SILENT]} silently wrong."
    )


# ---- Charts --------------------------------------------------------------------------------------


def charts(records: Sequence[Record]) -> Iterator[Chart]:
    """Yield the heat map of each part, and digits lost over severity: all methods, or one by its
    variants.

    A single scene has a figure per family, with a panel for methods that break alike.
    """
    atlas = atlas_of(records)
    if not atlas:
        return
    for name, part in parts(atlas):
        yield _heat_map(name, part)
    panels = {}
    for family, of in atlas.items():
        title = FAMILIES[family].title
        panels[title, ALL] = _panel(family, of)
        panels |= {(title, m.name): _panel(family, {m: mine}, m.name) for m, mine in of.items()}
    title = "Digits lost in the worst variant; crosses above are refusals"
    yield Chart("stability-families", title, ["family", "method"], panels, parts=[])
    _, alone = next(parts(atlas))
    if len(scenes_of(alone)) == 1:
        yield from (_breaks_of(family, of) for family, of in alone.items())


def _heat_map(name: str, part: Atlas) -> Chart:
    scenes = scenes_of(part)
    panels = {}
    for scene in scenes:
        families = {key: of for key, of in part.items() if FAMILIES[key].about == scene}
        order = {key: _severities(key, of) for key, of in families.items()}
        rows = {}
        for method in methods_in(families):
            boxes: list[Box | None] = []
            for key, of in families.items():
                mine = {step.severity: step for step in of.get(method, ())}
                boxes += [_box(method, mine.get(severity)) for severity in order[key]]
            rows[method.name] = method.key, boxes
        panels[(scene,)] = Heat(
            {FAMILIES[key].name: len(order[key]) for key in families},
            rows,
            Axis("digits lost, worst variant", range=(0.0, FLOAT64_DIGITS)),
            LIMIT,
            "refused",
            "silently wrong",
            scene if len(scenes) > 1 else "",
            f"error above {NOTICEABLE:g}, reported by the bound",
        )
    title = "Digits lost (tiles: 0 to 16), from mild states to severe ones"
    return Chart(name, title, ["scene"], panels, [[(scene,)] for scene in scenes])


def _severities(family: str, methods: dict[Method, list[Step]]) -> list[float]:
    measured = {step.severity for mine in methods.values() for step in mine}
    return [severity for severity in FAMILIES[family].values if severity in measured]


def _box(method: Method, step: Step | None) -> Box | None:
    if step is None:
        return None
    wrong = step.worst is CellOutcome.SILENT
    return Box(step.lost, step.refused > 0, wrong, _hover_text(method, step))


def _at(severity: float) -> str:
    return f"{severity:.3g}"


def _panel(family: str, methods: dict[Method, list[Step]], title: str = "") -> Panel:
    facts = FAMILIES[family]
    # Categories, not a logarithmic axis: severities include 0.
    x = Axis(facts.severity, categories=[*map(_at, facts.values)])
    top = CROSSES + STEP * len(methods) + 0.5
    y = Axis("digits lost", range=(-0.5, top), ticks=(0, 4, 8, 12, 16))
    lines = []
    for row, (method, mine) in enumerate(methods.items()):
        lines += _lines(method, mine, CROSSES + STEP * row, alone=bool(title))
    return Panel(x, y, lines, title, bad=(LIMIT, FLOAT64_DIGITS))


def _breaks_of(family: str, methods: dict[Method, list[Step]]) -> Chart:
    """Return the figure of a family: a panel for methods that break alike, the others are named;
    where none breaks, a panel for all.
    """
    breaking = [one for one, mine in methods.items() if break_of(mine) is not None]
    others = [one for one in methods if one not in breaking]
    alike = group(
        breaking or others, lambda one: tuple((x.worst, x.refused > 0) for x in methods[one])
    ).values()
    panels = {}
    for names in alike:
        mine = {method: methods[method] for method in names}
        title = "; ".join(method.name for method in names)
        lines = [*_predicted(mine), *_together(mine)]
        panels[(title,)] = replace(
            _panel(family, mine), lines=lines, title=title if len(alike) > 1 else ""
        )
    title = FAMILIES[family].title
    if others:
        worst = lost_in(step for method in others for step in methods[method])
        rest = "; ".join(method.name for method in others)
        title += f"\nflat, at most {worst:.1f} digits lost: {rest if breaking else 'all methods'}"
    grid = in_rows([*panels], 2)
    height = 1.9 if len(panels) > 1 else 2.4
    return Chart(f"stability-{family}", title, ["methods"], panels, grid, height, on_page=False)


def _together(methods: dict[Method, list[Step]]) -> Iterator[Line]:
    """Yield the worst variant of several methods; nothing where a variant is refused."""
    for row, (method, mine) in enumerate(methods.items()):
        for line in _lines(method, mine, CROSSES + STEP * row, alone=False):
            whole = [
                x if step.refused == 0 else math.nan for x, step in zip(line.y, mine, strict=False)
            ]
            pivoted = f"{spelled_out(method.key)}, pivoted" if method.pivoted else ""
            crosses = line.appearance == "crosses"
            yield line if crosses else line._replace(y=whole, label=pivoted, hollow=())
        yield from _silent(method, mine)


def _predicted(methods: dict[Method, list[Step]]) -> Iterator[Line]:
    """Yield the most digits lost by the prediction κ ε of any of the methods."""
    steps = zip(*methods.values(), strict=True)
    worst = [max(steps_at, key=lambda step: step.predicted) for steps_at in steps]
    y = [math.nan if step.refused else step.predicted for step in worst]
    x = [_at(step.severity) for step in worst]
    yield Line(next(iter(methods)).key, x, y, label="predicted by κ ε", appearance="dotted")


def _silent(method: Method, mine: list[Step]) -> Iterator[Line]:
    """Yield the rings around silently wrong results."""
    if wrong := [step for step in mine if step.worst is CellOutcome.SILENT]:
        at, y = [_at(step.severity) for step in wrong], [step.lost for step in wrong]
        yield Line(method.key, at, y, label="silently wrong", appearance="rings")


def _lines(method: Method, mine: list[Step], height: float, alone: bool) -> Iterator[Line]:
    """Yield the worst variant of a method and, if `alone`, the prediction by κ ε and each
    variant.
    """
    x = [_at(step.severity) for step in mine]
    hover = [_hover_text(method, step) for step in mine]
    key = method.key
    lost = [step.lost for step in mine]
    if alone:
        # Where some variant is refused, the worst of the others would seem a recovery.
        lost = [math.nan if step.refused else step.lost for step in mine]
        yield from _predicted({method: mine})
        for variant in dict.fromkeys(r.settings["variant"] for step in mine for r in step.records):
            y = [_lost_by(variant, step) for step in mine]
            yield Line(key, x, y, label="each variant", appearance="thin")
        yield from _silent(method, mine)
    partly = [step.refused > 0 for step in mine]
    yield Line(key, x, lost, hover, "worst variant", dashed=method.pivoted, hollow=partly)
    if any(partly):
        refused = [k for k, step in enumerate(mine) if step.refused > 0]
        yield Line(
            key,
            [x[k] for k in refused],
            [height] * len(refused),
            [hover[k] for k in refused],
            "refused (hollow: in part)",
            hollow=[mine[k].refused < 1 for k in refused],
            appearance="crosses",
        )


def _lost_by(variant: str, step: Step) -> float:
    mine = [r for r in step.solved if r.settings["variant"] == variant]
    return digits_lost(mine[0].errors["relative"]) if mine else math.nan


def _hover_text(method: Method, step: Step) -> list[str]:
    solved = len(step.solved)
    lines = [
        f"{method.name}, severity {step.severity:g}",
        f"{solved} of {len(step.records)} variants solved",
    ]
    if solved and not math.isnan(step.lost):
        lines.append(f"{step.lost:.1f} digits lost, {step.predicted:.1f} predicted by κ ε")
    if step.worst in WORDS:
        lines.append(WORDS[step.worst])
    reasons = dict.fromkeys(record.reason for record in step.records if record.reason)
    return [*lines, *list(reasons)[:1]]


STUDY = Study(
    key="stability",
    cells=cells,
    label="measuring formulations at {state}",
    worker=lambda stored: measure,
    parallel_by=STATE,
    tables=tables,
    charts=charts,
    remarks=remarks,
    alarm=alarm,
    reading=READING,
)
