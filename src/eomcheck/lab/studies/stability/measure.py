"""Measurements of the stability atlas: every formulation on families of increasingly severe states.

A family is a sequence of states whose severity is one number; `FAMILIES` lists them all. Each cell,
one formulation at one state, is one Record: the true relative error against ball arithmetic, the
error bound and κ ε beside it, the condition number of each matrix solved, or the refusal and its
reason. Verdicts are derived from the Records.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
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
from eomcheck.lab.store.record_file import Record, Settings, by_setting, group
from eomcheck.lab.studies.stability.families import FAMILIES, Family, Posed
from eomcheck.lab.study import Formulations
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import EPS
from eomcheck.scene_lookup import scene_classes_named


def families_about(kinds: Iterable[type[Scene]]) -> tuple[Family, ...]:
    """Return the families shown under these scene classes."""
    keys = {kind.key for kind in kinds}
    return tuple(family for family in FAMILIES.values() if family.about in keys)


# ---- Cells and their outcomes --------------------------------------------------------------------

STUDY = "stability"
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
    return Record(STUDY, settings, errors=errors)


def _unsolved(settings: Settings, error: EomcheckError) -> Record:
    if isinstance(error, RefusedError):
        return Record(STUDY, settings, "refused", str(error), errors={"rcond": error.rcond})
    return Record(STUDY, settings, "failed", str(error))


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
