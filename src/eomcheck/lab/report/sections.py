"""The sections of a report below its claims, each present only where there is data."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple, TypeVar

from eomcheck.claims.finding import DECIDED
from eomcheck.errors import EomcheckError, described_error
from eomcheck.lab.report.overview import Overview
from eomcheck.lab.report.states import digits_sheet, strata_sheet
from eomcheck.lab.show.chart import Chart
from eomcheck.lab.show.table import Sheet
from eomcheck.lab.store.record import Record
from eomcheck.lab.studies import STUDIES, study_of

T = TypeVar("T")
WRONG = AttributeError, TypeError, ValueError


class Section(NamedTuple):
    """A section of a report.

    Attributes:
        id: its anchor.
        title: its heading.
        text: what it shows and how to read it.
        tables: its tables.
        charts: makes its charts, of which only HTML has any.
    """

    id: str
    title: str
    text: str
    tables: Sequence[Sheet]
    charts: Callable[[], Sequence[Chart]] = tuple


def sections_of(overview: Overview) -> list[Section]:
    """Return the sections for which there is data."""
    drawn = [one for one in (_digits(overview), _strata(overview)) if one.tables[0].rows]
    studies = (_of_study(key, overview) for key in STUDIES if overview.of(key))
    return [*drawn, *(one for one in studies if one is not None)]


def _of_study(key: str, overview: Overview) -> Section | None:
    """Return the section of a study, None if its Records cannot be shown."""
    study = study_of(key)
    found = study.of(overview.records)

    def read(what: Callable[[Sequence[Record]], Iterable[T]]) -> list[T] | None:
        # They may be of another eomcheck: of formulations, scenes or fields that this one lacks.
        try:
            return list(what(found))
        except (EomcheckError, ArithmeticError, LookupError, *WRONG) as error:
            why = described_error(error)
            overview.unread.append(f"the records of {key!r} cannot be shown: {why}")
            return None

    said, sheets = read(study.said), read(study.sheets)
    if said is None or sheets is None:
        return None
    text = " ".join((STUDIES[key], study.reading, *said))
    tables = [sheet for sheet in sheets if sheet.rows and not sheet.detail]
    return Section(key, key.capitalize(), text, tables, lambda: read(study.charts) or [])


def _digits(overview: Overview) -> Section:
    """Return the certified digits of each formulation on each scene."""
    # Where an acceleration is nothing but rounding it has no digits to be right.
    sheet = digits_sheet(row for row in overview.rows if row.verdict in DECIDED)
    return Section(
        "digits",
        "Certified digits",
        "Decimal digits of q̈ in doubles that are certainly right, against the true value in ball "
        "arithmetic: the worst state, and in brackets the median. States whose acceleration is no "
        "larger than its rounding error are left out.",
        [sheet],
    )


def _strata(overview: Overview) -> Section:
    """Return the states in each stratum of each scene."""
    strata: dict[str, dict[str, dict[str, int]]] = {}
    for run in overview.runs:
        names = ("strata", "ways", "states in them")
        for name, way, states in zip(*(run.series.get(x, ()) for x in names), strict=True):
            of = strata.setdefault(run.settings["scene"], {})
            of.setdefault(name, {})[way] = states
    return Section(
        "strata",
        "States drawn",
        "How many of the states drawn at random are of which kind. Every pair of kinds is drawn at "
        "least once where there are draws enough; a kind with no state was not looked at.",
        [strata_sheet(strata)],
    )
