"""Report formats: HTML, Markdown and JUnit XML of an `Overview`.

The HTML file needs no network: style, scripts and data are embedded. Markdown is for the summary
page of a CI system. JUnit XML has a suite per scene class and a test case per claim.
"""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

from eomcheck import __version__
from eomcheck.atomic_write import replacing, write_text
from eomcheck.engines import ENGINES
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.report.claim_summary import (
    ClaimSummary,
    anchor,
    evidence_table,
    participant_table,
    scene_table,
)
from eomcheck.lab.report.overview import Overview, sections_of
from eomcheck.lab.show.chart import STYLES, Chart, keys_of
from eomcheck.lab.show.document_text import environment, render
from eomcheck.lab.store.validation_runs import StoredFinding
from eomcheck.safe_output import counted

# ---- HTML ----------------------------------------------------------------------------------------

LIGHT, DARK = "#ffffff", "#15181c"
"""Backgrounds of the page."""
CONTRAST = 4.0
"""Least contrast ratio of a formulation's colour with the background (WCAG asks 3 of graphics)."""


def check_installed() -> None:
    """Raise EngineError if jinja2 or plotly is not installed."""
    from eomcheck.lab.show.chart_plotly import plotly_js

    environment()
    plotly_js()


def write_page(overview: Overview, path: Path) -> None:
    """Write the HTML report.

    Raises:
        EngineError: jinja2 or plotly is not installed.
    """
    from eomcheck.lab.show.chart_plotly import chart_json, plotly_js

    sections = [(s, s.charts()) for s in sections_of(overview)]
    charts = [chart for _, charts in sections for chart in charts]
    page = render(
        "page.html.j2",
        overview=overview,
        version=__version__,
        sections=sections,
        charts=charts,
        json_of=chart_json,
        states=_states(overview),
        anchor=anchor,
        claims=participant_table(overview.claims, overview.columns),
        evidence=evidence_table,
        lit={*STYLES, *ENGINES, *overview.columns},
        formulations=[FORMULATIONS[key] for key in overview_formulations(overview, charts)],
        light={key: style.color for key, style in STYLES.items()},
        dark={key: on_dark(style.color) for key, style in STYLES.items()},
        plotly=plotly_js() if charts else "",
    )
    write_text(path, page)


def overview_formulations(overview: Overview, charts: list[Chart]) -> list[str]:
    """Return the keys of all formulations shown in the report, in the order of the registry."""
    drawn = keys_of(charts)
    return [key for key in FORMULATIONS if key in drawn or key in overview.columns]


def _states(overview: Overview) -> list[StoredFinding]:
    """Return one Finding of each state linked from the page: failures, and the worst of each
    claim.
    """
    pointed = [row for judged in overview.claims for row in _linked_findings(judged)]
    pointed.sort(key=lambda row: row.verdict != "failed")
    return list({anchor(row): row for row in reversed(pointed)}.values())[::-1]


def _linked_findings(judged: ClaimSummary) -> list[StoredFinding]:
    """Return the failed findings of a claim, and the worst of each scene and level."""
    groups = judged.by(lambda row: (row.scene, row.level)).values()
    return [*judged.failed, *(s.worst for s in groups if s.worst is not None)]


# ---- Colours in the dark -------------------------------------------------------------------------


def on_dark(color: str) -> str:
    """Return a colour for the dark page: white for black, others lightened up to `CONTRAST`."""
    rgb = _rgb(color)
    if rgb == (0.0, 0.0, 0.0):
        return "#ffffff"
    white = 0.0
    while contrast(_hex(_mixed(rgb, white)), DARK) < CONTRAST:
        white += 0.05
    return _hex(_mixed(rgb, white))


def contrast(first: str, second: str) -> float:
    """Return the contrast ratio of two colours "#rrggbb", 1 to 21 (WCAG 2)."""
    high, low = sorted((_luminance(first), _luminance(second)), reverse=True)
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


# ---- Markdown ------------------------------------------------------------------------------------


def write_markdown(overview: Overview, path: Path) -> None:
    """Write verdict, failures, claims by scene, and the tables of the studies as Markdown.

    Raises:
        EngineError: jinja2 is not installed.
    """
    claims = scene_table(overview.claims, overview.scenes)
    sections = sections_of(overview)
    text = render("report.md.j2", overview=overview, claims=claims, sections=sections)
    write_text(path, text)


# ---- JUnit XML -----------------------------------------------------------------------------------

FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML cannot contain."""


def write_junit(overview: Overview, path: Path) -> None:
    """Write every claim on every scene as a test case: failed, skipped (nothing could be checked)
    or passed.

    An unfinished run is an error of its suite.
    """
    root = ElementTree.Element("testsuites", name="eomcheck")
    seconds = _seconds(overview)
    unfinished = {run.settings["scene"] for run in overview.runs if run.status != "done"}
    for scene in dict.fromkeys([*overview.scenes, *unfinished]):
        suite = ElementTree.SubElement(root, "testsuite", name=_clean(scene))
        for judged in overview.claims:
            if scene in judged.scenes:
                took = seconds.get((scene, judged.claim.id), 0.0)
                _case(suite, scene, judged.scenes[scene], took)
        if scene in unfinished:
            case = _test_case(suite, scene, "run", 0.0)
            ElementTree.SubElement(case, "error", message="the run did not come to its end")
        _count(suite)
    _count(root)
    ElementTree.indent(root)
    with replacing(path) as beside:
        ElementTree.ElementTree(root).write(beside, encoding="utf-8", xml_declaration=True)


def _seconds(overview: Overview) -> dict[tuple[str, str], float]:
    return {
        (run.settings["scene"], claim): seconds
        for run in overview.runs
        for claim, seconds in zip(run.series["claims"], run.series["seconds"], strict=True)
    }


def _test_case(suite: ElementTree.Element, scene: str, name: str, seconds: float):
    attributes = {"classname": _clean(f"eomcheck.{scene}"), "name": name, "time": f"{seconds:.3f}"}
    return ElementTree.SubElement(suite, "testcase", attributes)


def _case(suite: ElementTree.Element, scene: str, judged: ClaimSummary, seconds: float) -> None:
    case = _test_case(suite, scene, judged.claim.id, seconds)
    if judged.kind == "open":
        ElementTree.SubElement(case, "skipped", message=_clean(_why_open(judged)))
    for row in judged.failed:
        failure = ElementTree.SubElement(case, "failure", message=_clean(str(row)))
        failure.text = _clean(row.python)
    out = ElementTree.SubElement(case, "system-out")
    summary = (
        f"{judged.claim.statement} {judged.claim.equations}: "
        f"{counted(len(judged.rows), 'finding')}{judged.undecided}, "
        f"largest error {judged.text} of the error allowed"
    )
    out.text = _clean("\n".join([summary, *(row.detail for row in judged.unresolved)]))


def _why_open(judged: ClaimSummary) -> str:
    """Return the reason why nothing could be checked."""
    for row in judged.rows:
        if row.verdict == "skipped":
            return f"skipped: {row.detail}"
    return "inconclusive: nothing could be checked"


def _clean(text: str) -> str:
    return FORBIDDEN.sub("?", text)


def _count(element: ElementTree.Element) -> None:
    for name, tag in (
        ("tests", "testcase"),
        ("failures", "testcase[failure]"),
        ("errors", "testcase[error]"),
        ("skipped", "testcase[skipped]"),
    ):
        element.set(name, str(len(element.findall(f".//{tag}"))))
    total = sum(float(case.get("time", 0)) for case in element.iter("testcase"))
    element.set("time", f"{total:.3f}")
