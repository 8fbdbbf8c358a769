"""Certified float64 errors of every formulation over random states.

Each float64 result is compared with a value certified by ball arithmetic, and its true error with
two predictions: κ ε scale, on which the constant C of the tolerances rests, and the error bound
that the public functions return.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from statistics import median
from typing import Annotated

import numpy as np

from eomcheck import strategies
from eomcheck.errors import RefusedError
from eomcheck.evaluation.certified import (
    Accuracy,
    Enclosure,
    accuracy,
    accuracy_at,
    relative_error,
    true_acceleration,
)
from eomcheck.evaluation.dynamics import speeds_of
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import UNDERFLOW, C, largest
from eomcheck.formulations import FORMULATIONS, Formulation, applicable
from eomcheck.lab.option_parsing import Examples, Links, Seed, check_count, parse_interval
from eomcheck.lab.show.chart import Axis, Chart, Line, Panel
from eomcheck.lab.show.table import ResultTable
from eomcheck.lab.store.record_file import Record, Settings, record_of_rows, rows_in
from eomcheck.lab.study import Study, cell_text, document_of, failed, unfinished
from eomcheck.motion.observables import as_integrated
from eomcheck.motion.right_hand_side import acceleration_in_machine_code
from eomcheck.safe_output import counted
from eomcheck.scenes import Snake
from eomcheck.strategies import draw_samples

FLOOR = 1e-3
"""Abscissa at which smaller ratios, exact results included, are drawn."""


@dataclass(frozen=True)
class Delivered:
    """Accuracy of one formulation at one state.

    Attributes:
        key: the formulation.
        links: number of links.
        refused: quantity that made the formulation refuse, or None.
        digits: decimal digits of v̇ that are certainly right.
        relative: largest error over largest true entry.
        ulps: largest error of an entry in units in the last place.
        condition: largest condition number of a matrix solved.
        kappa: amplification of relative input changes by the computation.
        ratio: observed error / (κ ε scale), NaN where no error is predicted or no digit can be
            lost.
        of_bound: error over the error bound of the public path; 0 where that is infinite.
        machine_of_bound: error of machine code over the same bound; NaN where its result is not
            finite.
        state: the state as code, where either exceeds 1.
    """

    key: str
    links: int
    refused: str | None
    digits: float = 0.0
    relative: float = float("inf")
    ulps: float = float("inf")
    condition: float = float("inf")
    kappa: float = float("inf")
    ratio: float = float("nan")
    of_bound: float = 0.0
    machine_of_bound: float = 0.0
    state: str = ""


def cells(
    *,
    links: Links = "1..30",
    examples: Examples = 200,
    seed: Seed = 0,
    hostile: Annotated[bool, "Draw snakes and states at the edge."] = False,
) -> Iterator[Settings]:
    """Yield a cell for each random state, ordinary or hostile.

    Raises:
        InputError: no such numbers of links, or no examples.
    """
    drawn = {"links": parse_interval(links), "examples": examples, "seed": seed, "hostile": hostile}
    check_count(examples=examples)
    for index in range(examples):
        yield drawn | {"state": index}


@lru_cache(1)
def _states(low: int, high: int, examples: int, seed: int, hostile: bool) -> list:
    if hostile:
        snakes = strategies.hostile_snakes(low, high)
        drawn = strategies.scene_states(snakes, strategies.hostile_states)
    else:
        drawn = strategies.scene_states(strategies.snakes(low, high))
    return draw_samples(drawn, examples, seed)


def _certified(settings: Settings) -> Record:
    """Certify every formulation at one state."""
    drawn = (settings[name] for name in ("examples", "seed", "hostile"))
    scene, (q, v, t) = _states(*settings["links"], *drawn)[settings["state"]]
    formulations = applicable(Snake).values()
    try:
        truth, at = true_acceleration(scene, q, speeds_of(scene, q, v, t), t)
    except RefusedError as refusal:
        rows = [Delivered(f.key, scene.r, refusal.what) for f in formulations]
    else:
        rows = [_delivered(f, truth, at) for f in formulations]
    return record_of_rows(STUDY.key, settings, rows)


def _delivered(formulation: Formulation, truth: Enclosure, at: Evaluation) -> Delivered:
    key, links = formulation.key, at.scene.r
    try:
        certified = accuracy_at(formulation, truth, at)
    except RefusedError as refusal:
        return Delivered(key, links, refusal.what)
    shares = certified.relative / _bound(certified), _of_machine_code(formulation, certified, at)
    return Delivered(
        key,
        links,
        None,
        certified.digits,
        certified.relative,
        float(certified.ulps.max()),
        max(certified.condition.values()),
        certified.kappa,
        certified.ratio,
        *shares,
        f"{at.scene!r}, q = {at.q.tolist()}, u = {at.u.tolist()}" if max(shares) > 1 else "",
    )


def _bound(result: Accuracy) -> float:
    """Return the error bound of the public path, over the largest true entry."""
    least = UNDERFLOW / max(largest(result.truth.doubles()), UNDERFLOW)
    return max(result.relative_bound, least)


def _of_machine_code(formulation: Formulation, by_float64: Accuracy, at: Evaluation) -> float:
    """Return the error of machine code over the bound of the public path for the same state."""
    same, y = as_integrated(at, formulation)
    if same is not at:
        try:
            by_float64 = accuracy(at.scene, formulation.key, at.q, t=at.t, v=same.v)
        except RefusedError:
            return float("nan")
    machine = acceleration_in_machine_code(same, formulation, y)
    if not np.isfinite(machine).all():
        return float("nan")
    return relative_error(machine, by_float64.truth) / _bound(by_float64)


# ---- Results -------------------------------------------------------------------------------------


def _known(records: Sequence[Record]) -> tuple[list[Delivered], list[Delivered]]:
    """Return all results, and the inexact ones; results at rest without forces are exact."""
    rows = rows_in(records, Delivered)
    return rows, [one for one in rows if one.refused is not None or one.relative != 0.0]


DIGITS = (
    ("certified digits: fewest", min, "digits", ".1f"),
    ("median", median, "digits", ".1f"),
    ("ulps: median", median, "ulps", ".2g"),
)
ERRORS = (
    ("condition: median", median, "condition", ".2g"),
    ("largest", max, "condition", ".2g"),
    ("error / (κ ε scale): median", median, "ratio", ".2g"),
    ("largest", max, "ratio", ".2g"),
    ("largest error / bound", max, "of_bound", ".2g"),
    ("in machine code", max, "machine_of_bound", ".2g"),
)
"""Columns of the tables: heading, reduction over the states solved, field, format."""


def tables(records: Sequence[Record]) -> Iterator[ResultTable]:
    """Yield, per formulation, the accuracy of float64, and the ratios on which the constant C
    rests.
    """
    digits, errors = [], []
    rows, moving = _known(records)
    for key in dict.fromkeys(one.key for one in rows):
        mine = [one for one in moving if one.key == key]
        solved = [one for one in mine if one.refused is None]
        without = {x: len(solved) - len(_numbers(solved, x)) for x in ("ratio", "machine_of_bound")}
        counts = len(solved), len(mine) - len(solved), without["ratio"]
        digits.append((key, *map(str, counts), *_reduced(solved, DIGITS)))
        errors.append((key, *_reduced(solved, ERRORS), str(without["machine_of_bound"])))
    columns = ("formulation", "solved", "refused", "κ infinite", *(head for head, *_ in DIGITS))
    yield ResultTable("digits", "What doubles deliver, against the enclosed truth", columns, digits)
    columns = ("formulation", *(head for head, *_ in ERRORS), "no number")
    yield ResultTable(
        "errors", "Errors beside what is foreseen, and beside bounds", columns, errors
    )


def _reduced(solved: list[Delivered], columns: Sequence[tuple]) -> Iterator[str]:
    """Yield the cells of some columns."""
    for _, reduction, name, how in columns:
        yield cell_text(reduction(known) if (known := _numbers(solved, name)) else None, how)


def _numbers(rows: Iterable[Delivered], name: str) -> list[float]:
    return [x for one in rows if not math.isnan(x := getattr(one, name))]


def remarks(records: Sequence[Record]) -> Iterator[str]:
    """Yield the basis of the tables, the largest ratio of all, and states beyond their bound."""
    yield from unfinished(records)
    rows, moving = _known(records)
    top = max(_numbers(moving, "ratio"), default=0.0)
    exact = counted(len(rows) - len(moving), "result")
    yield (
        f"{counted(len(records), 'state')}; errors against the enclosed truth. Left out: {exact} "
        "without error, as at rest without forces; where κ is infinite no error is foreseen. "
        f"Largest error / (κ ε scale): {top:.3g}; the constant C of the tolerances is {C:g}."
    )
    for one in rows:
        if one.state:
            yield f"beyond its bound: {one.key}, {one.state}"


def alarm(records: Sequence[Record]) -> bool:
    """Return whether a result was off by more than its error bound."""
    return failed(records) or any(one.state for one in rows_in(records, Delivered))


def charts(records: Sequence[Record]) -> Iterator[Chart]:
    """Yield the distributions of certified digits and of error / (κ ε scale)."""
    solved = [one for one in rows_in(records, Delivered) if one.refused is None]
    digits, shares = [], []
    for key in FORMULATIONS:
        mine = [one for one in solved if one.key == key]
        digits.append(_distribution(key, (one.digits for one in mine)))
        ratios = (max(ratio, FLOOR) for ratio in _numbers(mine, "ratio"))
        shares.append(_distribution(key, ratios))
    share = Axis("share of states", range=(0, 1.05))
    panels = {
        ("digits",): Panel(
            Axis("decimal digits of q̈ that are right"),
            share,
            digits,
            "Digits that float64 delivers, at most",
        ),
        ("share of states",): Panel(
            Axis("true error / (κ ε scale)", log=True),
            share,
            shares,
            f"Error over its prediction, at most (dotted: C = {C:g})",
            marks=(C,),
        ),
    }
    title = "Errors of float64 against ball arithmetic, over random states"
    grid = [[chosen] for chosen in panels]
    yield Chart("accuracy", title, ["diagram"], panels, grid, height=2.5)


def _distribution(key: str, numbers: Iterable[float]) -> Line:
    """Return the share of numbers up to each of them, as a line of steps."""
    ordered = sorted(numbers)
    steps = [k / max(len(ordered), 1) for k in range(len(ordered) + 1)]
    x, y = np.repeat(ordered, 2).tolist(), np.repeat(steps, 2)[1:-1].tolist()
    return Line(key, x, y, every=(len(x) // 2, max(len(x), 1)))


STUDY = Study(
    key="accuracy",
    cells=cells,
    label="certifying {state}",
    worker=lambda stored: _certified,
    tables=tables,
    charts=charts,
    alarm=alarm,
    remarks=remarks,
    document=document_of("accuracy", Delivered),
    reading="Beside the public path, which states a bound of its error, machine code is held "
    "against it.",
    small=True,
)
