"""The report as Markdown, for the summary page of a CI system."""

from __future__ import annotations

from pathlib import Path

from eomcheck.atomic_write import write_text
from eomcheck.lab.report.claims import scene_sheet
from eomcheck.lab.report.overview import Overview
from eomcheck.lab.report.sections import sections_of
from eomcheck.lab.show.document_text import render


def write_markdown(overview: Overview, path: Path) -> None:
    """Write verdict, failures, claims by scene, and the tables of the studies.

    Raises:
        EngineError: jinja2 is not installed.
    """
    claims = scene_sheet(overview.claims, overview.scenes)
    sections = sections_of(overview)
    text = render("report.md.j2", overview=overview, claims=claims, sections=sections)
    write_text(path, text)
