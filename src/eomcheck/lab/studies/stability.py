"""The stability atlas: every formulation through families of growing severity, certified.

Each cell, one formulation at one state, is one Record: the true relative error against ball
arithmetic, what the error bound and κ ε foresaw, the condition number of each matrix solved, or the
refusal and its reason. Verdicts are read off the Records.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

from eomcheck.console import progress
from eomcheck.errors import EomcheckError, InputError, RefusedError, distinct
from eomcheck.evaluation.certified import (
    DIGITS_OF_DOUBLES,
    TRUE_DIGITS,
    certified_digits,
    certify,
    relative_error,
    true_state,
)
from eomcheck.evaluation.doubles import Evaluation
from eomcheck.evaluation.enclosure import Enclosure, enclose
from eomcheck.evaluation.tolerance import NOTICEABLE
from eomcheck.formulations import FORMULATIONS, applicable, formulation_of
from eomcheck.lab.store.records import Record, Records
from eomcheck.lab.store.workers import spread
from eomcheck.lab.studies.families import FAMILIES, Posed, families_about, family_of
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.pivots import EPS
from eomcheck.scenes import Snake

STUDY = "stability"


class Method(NamedTuple):
    """A formulation, with the paper's partition or a pivoted one."""

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


class Place(NamedTuple):
    """A state of a family."""

    family: str
    variant: str
    severity: float

    def settings(self, method: Method) -> dict:
        """Return the settings of a cell."""
        return self._asdict() | {"formulation": method.key, "pivoted": method.pivoted}


@dataclass(frozen=True)
class Plan:
    """What a run covers: families and formulations by key, all severities or the quick ones."""

    families: tuple[str, ...]
    formulations: tuple[str, ...]
    quick: bool = False

    def methods(self, family: str) -> tuple[Method, ...]:
        """Return the formulations that apply to the scenes of a family, with both partitions."""
        apply = applicable(FAMILIES[family].scene)
        return tuple(methods_of(key for key in self.formulations if key in apply))

    def places(self) -> Iterator[Place]:
        """Yield every state."""
        for key in self.families:
            family = FAMILIES[key]
            for variant in family.variants:
                for severity in family.quick if self.quick else family.values:
                    yield Place(key, variant, severity)


def plan(
    families: Iterable[str] | None = None,
    formulations: Iterable[str] | None = None,
    quick: bool = False,
    kinds: Iterable[type[Scene]] = (Snake,),
) -> Plan:
    """Return a plan; what is None is taken whole, of families those about `kinds`.

    Raises:
        InputError: there is no family about any of `kinds`.
        UnknownNameError: no such family or formulation.
    """
    about = [family.key for family in families_about(kinds)]
    if not about:
        keys = ", ".join(kind.key for kind in kinds)
        raise InputError(f"scene = {keys}: the atlas has no families of states for it")
    chosen = distinct("family", about if families is None else families)
    keys = distinct("formulation", FORMULATIONS if formulations is None else formulations)
    return Plan(
        tuple(family_of(key).key for key in chosen),
        tuple(formulation_of(key).key for key in keys),
        quick,
    )


def measure(
    planned: Plan, records: Records, where: str | None = None, fresh: bool = False
) -> list[Record]:
    """Measure every cell that is not in `records` yet, and return the Records of all.

    The cells of one state share its truth and go to one process; they are committed together.

    Args:
        planned: what to cover.
        records: where they are kept.
        where: see `eomcheck.lab.store.workers.executor`.
        fresh: forget what is known of these cells first.
    """
    cells = {place: planned.methods(place.family) for place in planned.places()}
    every = [place.settings(method) for place in cells for method in cells[place]]
    if fresh:
        records.forget(STUDY, every)
    left = [
        (place, missing)
        for place, methods in cells.items()
        if (missing := [m for m in methods if records.find(STUDY, place.settings(m)) is None])
    ]
    with progress("measuring", len(left)) as advance:
        for _, found in spread(where, measure_state, left):
            for record in found:
                records.add(record)
            advance()
    return [record for cell in every if (record := records.find(STUDY, cell)) is not None]


def measure_state(item: tuple[Place, list[Method]]) -> list[Record]:
    """Return the Record of each method at one state."""
    place, methods = item
    posed = FAMILIES[place.family].pose(place.variant, place.severity)
    return [_record(place, posed, method, state) for method, state in _states(posed, methods)]


State = tuple[Enclosure, Evaluation] | EomcheckError
"""The truth and the evaluation in doubles, or why there is none."""


def _states(posed: Posed, methods: list[Method]) -> Iterator[tuple[Method, State]]:
    """Yield, per method, the truth that it is compared with."""
    if posed.v is None:
        state = _attempt(lambda: true_state(posed.scene, posed.q, posed.u))
        yield from ((method, state) for method in methods)
        return
    at = Evaluation(posed.scene, posed.q, posed.v)
    for method in methods:
        yield method, _attempt(lambda m=method: (_own_truth(posed, m), at))


def _attempt(find) -> State:
    try:
        return find()
    except EomcheckError as error:
        return error


def _own_truth(posed: Posed, method: Method) -> Enclosure:
    key, pivoted = method
    return enclose(posed.scene, key, posed.q, digits=TRUE_DIGITS, v=posed.v, pivoted=pivoted)


def _record(place: Place, posed: Posed, method: Method, state: State) -> Record:
    settings = place.settings(method)
    try:
        if isinstance(state, EomcheckError):
            raise state
        truth, at = state
        found = certify(formulation_of(method.key), truth, at, method.pivoted)
    except RefusedError as refusal:
        return Record(STUDY, settings, "refused", str(refusal), errors={"rcond": refusal.rcond})
    except EomcheckError as error:
        return Record(STUDY, settings, "failed", str(error))
    errors = {
        "relative": found.relative,
        "bound": found.relative_bound,
        "predicted": found.kappa * EPS,
        "condition": max(found.condition.values()),
    }
    errors |= {f"condition {name}": value for name, value in found.condition.items()}
    if posed.v is not None:
        other = _own_truth(posed, Method("au"))
        errors["question"] = relative_error(truth.doubles(), other)
    return Record(STUDY, settings, errors=errors)


# ---- What follows from the Records ---------------------------------------------------------------


class Outcome(IntEnum):
    """What a cell came to, from good to bad."""

    GOOD = 0
    """The true relative error is at most 1e-6."""
    REFUSED = 1
    """The formulation declines, and says why."""
    TOLD = 2
    """It is larger, and the error bound says so."""
    SILENT = 3
    """It is larger, and nothing says so."""


def outcome(record: Record) -> Outcome:
    """Return what one cell came to; a cell that failed counts as refused."""
    if record.status != "done":
        return Outcome.REFUSED
    if record.errors["relative"] <= NOTICEABLE:
        return Outcome.GOOD
    told = record.errors["relative"] <= record.errors["bound"]
    return Outcome.TOLD if told else Outcome.SILENT


def method_of(record: Record) -> Method:
    """Return the method of a cell."""
    return Method(record.settings["formulation"], record.settings["pivoted"])


def digits_lost(relative: float) -> float:
    """Return the decimal digits, of those that doubles have, that a relative error takes."""
    return DIGITS_OF_DOUBLES - certified_digits(relative)


class Step(NamedTuple):
    """What a method came to at one severity of a family, over all variants."""

    severity: float
    records: list[Record]

    @property
    def solved(self) -> list[Record]:
        """The cells with a result."""
        return [record for record in self.records if record.status == "done"]

    @property
    def worst(self) -> Outcome:
        """The worst outcome."""
        return max(map(outcome, self.records))

    @property
    def lost(self) -> float:
        """The most digits lost, NaN where nothing was solved."""
        return self._most("relative")

    @property
    def foreseen(self) -> float:
        """The most digits that κ ε foresaw to be lost, NaN where nothing was solved or lost."""
        return self._most("predicted")

    @property
    def refused(self) -> float:
        """The share of cells that were refused."""
        return 1.0 - len(self.solved) / len(self.records)

    def _most(self, error: str) -> float:
        # What is exact, as at rest without forces, has no digits to lose.
        inexact = [r for r in self.solved if r.errors["relative"] > 0 or error == "relative"]
        return max((digits_lost(r.errors[error]) for r in inexact), default=math.nan)


def steps(records: Iterable[Record], family: str, method: Method) -> list[Step]:
    """Return the steps of one method through one family, from mild to severe."""
    mine: dict[float, list[Record]] = {}
    for record in records:
        if record.settings["family"] == family and method_of(record) == method:
            mine.setdefault(record.settings["severity"], []).append(record)
    order = FAMILIES[family].values
    return [Step(severity, mine[severity]) for severity in sorted(mine, key=order.index)]


class Break(NamedTuple):
    """Where a method first fails to give a good result."""

    severity: float
    outcome: Outcome
    record: Record
    """The worst cell there."""


def breaks_at(records: Iterable[Record], family: str, method: Method) -> Break | None:
    """Return where a method breaks, or None: it gives good results throughout."""
    for step in steps(records, family, method):
        if step.worst is not Outcome.GOOD:
            worst = max(step.records, key=outcome)
            return Break(step.severity, step.worst, worst)
    return None
