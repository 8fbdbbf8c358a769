"""The sections of a report below its claims: one file each, present only where there is data."""

from __future__ import annotations

from eomcheck.lab.report.overview import Overview
from eomcheck.lab.report.sections import digits, operations, paper, stability, work_precision
from eomcheck.lab.report.sections.section import Section

SECTIONS = (digits, work_precision, stability, operations, paper)
"""In the order in which they stand."""


def sections_of(overview: Overview) -> list[Section]:
    """Return the sections for which there is data."""
    made = (module.section(overview) for module in SECTIONS)
    return [section for section in made if section is not None]


__all__ = ["SECTIONS", "Section", "sections_of"]
