"""The report as one HTML file that needs no network: style, scripts and data are in it."""

from __future__ import annotations

from pathlib import Path

from eomcheck import __version__
from eomcheck.atomic_write import write_text
from eomcheck.engines import ENGINES
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.report.claims import party_sheet
from eomcheck.lab.report.evidence import evidence_sheet
from eomcheck.lab.report.judged import Judged, anchor
from eomcheck.lab.report.overview import Overview
from eomcheck.lab.report.sections import sections_of
from eomcheck.lab.show.chart import STYLES, Chart, keys_of
from eomcheck.lab.show.document_text import environment, render
from eomcheck.lab.store.kept import Kept

LIGHT, DARK = "#ffffff", "#15181c"
"""Backgrounds of the page."""
CONTRAST = 4.0
"""Least contrast of a formulation's colour with the background (WCAG asks 3 of graphics)."""


def check_installed() -> None:
    """Raise EngineError if jinja2 or plotly is not installed."""
    from eomcheck.lab.show.chart_plotly import plotly_js

    environment()
    plotly_js()


def write_page(overview: Overview, path: Path) -> None:
    """Write the report.

    Raises:
        EngineError: jinja2 or plotly is not installed.
    """
    from eomcheck.lab.show.chart_plotly import json_of, plotly_js

    sections = [(one, one.charts()) for one in sections_of(overview)]
    charts = [chart for _, charts in sections for chart in charts]
    page = render(
        "page.html.j2",
        overview=overview,
        version=__version__,
        sections=sections,
        charts=charts,
        json_of=json_of,
        states=_states(overview),
        anchor=anchor,
        claims=party_sheet(overview.claims, overview.columns),
        evidence=evidence_sheet,
        lit={*STYLES, *ENGINES, *overview.columns},
        formulations=[FORMULATIONS[key] for key in overview_formulations(overview, charts)],
        light={key: style.color for key, style in STYLES.items()},
        dark={key: on_dark(style.color) for key, style in STYLES.items()},
        plotly=plotly_js() if charts else "",
    )
    write_text(path, page)


def overview_formulations(overview: Overview, charts: list[Chart]) -> list[str]:
    """Return the formulations that the report shows anywhere, in the order of the registry."""
    drawn = keys_of(charts)
    return [key for key in FORMULATIONS if key in drawn or key in overview.columns]


def _states(overview: Overview) -> list[Kept]:
    """Return one Finding of each state that the page points at: failures, and the worst of all."""
    pointed = [row for judged in overview.claims for row in _pointed(judged)]
    # Failures first.
    pointed.sort(key=lambda row: row.verdict != "failed")
    return list({anchor(row): row for row in reversed(pointed)}.values())[::-1]


def _pointed(judged: Judged) -> list[Kept]:
    found = judged.by(lambda row: (row.scene, row.level)).values()
    return [*judged.failed, *(one.worst for one in found if one.worst is not None)]


# ---- Colours in the dark -------------------------------------------------------------------------


def on_dark(color: str) -> str:
    """Return a colour for the dark page: black is white, others as light as they must be."""
    rgb = _rgb(color)
    if rgb == (0.0, 0.0, 0.0):
        return "#ffffff"
    white = 0.0
    while contrast(_hex(_mixed(rgb, white)), DARK) < CONTRAST:
        white += 0.05
    return _hex(_mixed(rgb, white))


def contrast(one: str, other: str) -> float:
    """Return the contrast of two colours, 1 to 21 (WCAG 2)."""
    high, low = sorted((_luminance(one), _luminance(other)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def _rgb(color: str) -> tuple[float, ...]:
    return tuple(int(color[i : i + 2], 16) / 255 for i in (1, 3, 5))


def _hex(rgb: tuple[float, ...]) -> str:
    return "#" + "".join(f"{round(255 * x):02x}" for x in rgb)


def _mixed(rgb: tuple[float, ...], white: float) -> tuple[float, ...]:
    return tuple((1 - white) * x + white for x in rgb)


def _luminance(color: str) -> float:
    linear = [x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4 for x in _rgb(color)]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
