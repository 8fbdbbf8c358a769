"""The sections of a report below its claims: one file each, present only where there is data."""

from __future__ import annotations

from eomcheck.lab.report.overview import Overview
from eomcheck.lab.report.sections import digits
from eomcheck.lab.report.sections.section import Section
from eomcheck.lab.studies import STUDIES, study_of

SECTIONS = (digits,)
"""In the order in which they stand."""


def sections_of(overview: Overview) -> list[Section]:
    """Return the sections for which there is data."""
    made = [module.section(overview) for module in SECTIONS]
    made += [_section(key, overview) for key in STUDIES if overview.of(key)]
    return [section for section in made if section is not None]


def _section(key: str, overview: Overview) -> Section:
    """Return the section of a study."""
    study = study_of(key)
    found = study.of(overview.records)
    text = " ".join((STUDIES[key], study.reading, *study.said(found)))
    tables = [sheet for sheet in study.sheets(found) if sheet.rows and not sheet.detail]
    return Section(key, key.capitalize(), text, tables, lambda: list(study.charts(found)))


__all__ = ["SECTIONS", "Section", "sections_of"]
