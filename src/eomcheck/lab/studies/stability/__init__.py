"""Stability atlas: every formulation on families of increasingly severe states, certified.

Its tables, a heat map of all families, and the digits lost in each family.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence

from eomcheck.evaluation.certified import FLOAT64_DIGITS
from eomcheck.evaluation.tolerance import NOTICEABLE
from eomcheck.lab.show.chart import Axis, Box, Chart, File, Heat, Line, Panel, in_rows
from eomcheck.lab.show.table import ResultTable
from eomcheck.lab.store.record_file import Record
from eomcheck.lab.studies.stability import measure
from eomcheck.lab.studies.stability.families import FAMILIES
from eomcheck.lab.studies.stability.measure import (
    Atlas,
    CellOutcome,
    Method,
    Step,
    atlas_of,
    break_of,
    digits_lost,
    lost_in,
    method_of,
    outcome_of,
)
from eomcheck.lab.study import Study
from eomcheck.safe_output import counted
from eomcheck.scenes import Snake

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

    A single scene has a figure per family, with a panel per method.
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
    _, alone = next(parts(atlas))
    files = [
        File(
            f"stability-{family}",
            title := FAMILIES[family].title,
            in_rows([(title, method.name) for method in of], (len(of) + 1) // 2),
        )
        for family, of in alone.items()
        if len(scenes_of(alone)) == 1
    ]
    title = "Digits lost in the worst variant; crosses above are refusals"
    lists = ["family", "method"]
    yield Chart("stability-families", title, lists, panels, size=(2.4, 2.3), parts=files)


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
        )
    most = max(len(heat.columns) for heat in panels.values())
    tall = max(len(heat.rows) for heat in panels.values())
    box = (1.1, 0.42) if len(scenes) == 1 else (1.0, 0.26)
    return Chart(
        name,
        "Boxes from mild to severe, darker where more digits are lost; none: does not apply",
        ["scene"],
        panels,
        in_rows([(scene,) for scene in scenes], 2),
        size=(box[0] * most + 1.0, box[1] * tall + 1.1),
    )


def _severities(family: str, methods: dict[Method, list[Step]]) -> list[float]:
    measured = {step.severity for mine in methods.values() for step in mine}
    return [severity for severity in FAMILIES[family].values if severity in measured]


def _box(method: Method, step: Step | None) -> Box | None:
    if step is None:
        return None
    wrong = step.worst is CellOutcome.SILENT
    return Box(step.lost, step.refused > 0, wrong, _hover_text(method, step))


def _at(severity: float) -> str:
    return f"{severity:.4g}"


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
        predicted = [math.nan if step.refused else step.predicted for step in mine]
        yield Line(key, x, predicted, label="foreseen by κ ε", appearance="dotted")
        for variant in dict.fromkeys(r.settings["variant"] for step in mine for r in step.records):
            y = [_lost_by(variant, step) for step in mine]
            yield Line(key, x, y, label="each variant", appearance="thin")
        if wrong := [step for step in mine if step.worst is CellOutcome.SILENT]:
            at, y = [_at(step.severity) for step in wrong], [step.lost for step in wrong]
            yield Line(key, at, y, label="silently wrong", appearance="rings")
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
        lines.append(f"{step.lost:.1f} digits lost, {step.predicted:.1f} foreseen by κ ε")
    if step.worst in WORDS:
        lines.append(WORDS[step.worst])
    reasons = dict.fromkeys(record.reason for record in step.records if record.reason)
    return [*lines, *list(reasons)[:1]]


STUDY = Study(
    key=measure.STUDY,
    cells=measure.cells,
    label="measuring formulations at {state}",
    worker=lambda stored: measure.measure,
    parallel_by=measure.STATE,
    tables=tables,
    charts=charts,
    remarks=remarks,
    alarm=alarm,
    reading=READING,
)
