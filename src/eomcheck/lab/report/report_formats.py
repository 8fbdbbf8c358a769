"""Report of an `Overview`: its sections, its formats, and the page of verified equivalences.

The content of sections is decided once; HTML, Markdown and JUnit XML only lay it out. A section is
present only if there is data for it.

The HTML file needs no network: style, scripts and data are embedded. Markdown is for the summary
page of a CI system. JUnit XML has a suite per scene class and a test case per claim.

The page of verified equivalences has every claim, its evidence, and the tests that verify it. It is
generated from Records of `validate` and `prove` and from the sources of the validation suite, never
by hand. A test belongs to the claims that its source names. A parameter of a scene is independently
covered if an engine derives it from the scene's `tree()` instead of `parameters()`.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, TypeVar
from xml.etree import ElementTree

import numpy as np

from eomcheck import __version__
from eomcheck.atomic_write import replacing, write_text
from eomcheck.claims import CLAIMS
from eomcheck.claims.finding import DECIDED
from eomcheck.draws.pairwise_design import link_count
from eomcheck.engines import ENGINES
from eomcheck.errors import EomcheckError, InputError, described_error
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.report.overview import (
    LEVELS,
    ClaimSummary,
    Overview,
    anchor,
    digits_table,
    evidence_table,
    factor_table,
    origin_of,
    participant_table,
    scene_table,
)
from eomcheck.lab.show.chart import DARK_GROUND, STYLES, Chart, keys_of, on_dark
from eomcheck.lab.show.table import ResultTable, environment, ranges, render
from eomcheck.lab.store.record_file import Record, group
from eomcheck.lab.store.validation_runs import PROOFS, RUNS, STATES, StoredFinding, pose_of
from eomcheck.lab.studies import STUDIES, study_of
from eomcheck.safe_output import counted
from eomcheck.scenes import SCENES

# ---- Sections ------------------------------------------------------------------------------------

T = TypeVar("T")
WRONG = AttributeError, TypeError, ValueError


class Section(NamedTuple):
    """Section of a report.

    Attributes:
        id: its anchor.
        title: its heading.
        text: its content, and how to read it.
        tables: its tables.
        charts: function that makes its charts, which only HTML shows.
    """

    id: str
    title: str
    text: str
    tables: Sequence[ResultTable]
    charts: Callable[[], Sequence[Chart]] = tuple


def sections_of(overview: Overview) -> list[Section]:
    """Return the sections with data."""
    drawn = [s for s in (_digits_section(overview), _strata(overview)) if s.tables[0].rows]
    studies = (_study_section(key, overview) for key in STUDIES if overview.of(key))
    return [*drawn, *(s for s in studies if s is not None)]


def _study_section(key: str, overview: Overview) -> Section | None:
    """Return the section of a study, None if its Records cannot be shown."""
    study = study_of(key)
    records = study.of(overview.records)

    def read(derive: Callable[[Sequence[Record]], Iterable[T]]) -> list[T] | None:
        # Records of another version may have formulations, scenes or fields that this one lacks.
        try:
            return list(derive(records))
        except (EomcheckError, ArithmeticError, LookupError, *WRONG) as error:
            why = described_error(error)
            overview.unread.append(f"the records of {key!r} cannot be shown: {why}")
            return None

    remarks, sheets = read(study.remarks), read(study.tables)
    if remarks is None or sheets is None:
        return None
    text = " ".join((STUDIES[key], study.reading, *remarks))
    tables = [sheet for sheet in sheets if sheet.rows and not sheet.detail]
    return Section(key, key.capitalize(), text, tables, lambda: read(study.charts) or [])


def _digits_section(overview: Overview) -> Section:
    """Return the section of certified digits by formulation and scene."""
    # An acceleration that is nothing but rounding error has no correct digits.
    sheet = digits_table(row for row in overview.rows if row.verdict in DECIDED)
    return Section(
        "digits",
        "Certified digits",
        "Decimal digits of q̈ in doubles that are certainly right, against the true value in ball "
        "arithmetic: the worst state, and in brackets the median. States whose acceleration is no "
        "larger than its rounding error are left out.",
        [sheet],
    )


def _strata(overview: Overview) -> Section:
    """Return the section of states by factor of the pairwise design and by scene."""
    strata: dict[str, dict[str, dict[str, int]]] = {}
    for run in overview.runs:
        names = ("strata", "ways", "states in them")
        for name, way, states in zip(*(run.series.get(x, ()) for x in names), strict=True):
            factors = strata.setdefault(run.settings["scene"], {})
            factors.setdefault(name, {})[way] = states
    return Section(
        "strata",
        "States drawn",
        "How many of the states drawn at random are of which kind. Every pair of kinds is drawn at "
        "least once where there are draws enough; a scene class with no state was not checked.",
        [factor_table(strata)],
    )


# ---- HTML ----------------------------------------------------------------------------------------

LIGHT, DARK = "#ffffff", DARK_GROUND
"""Backgrounds of the page."""


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

    sections = [(s, [x for x in s.charts() if x.on_page]) for s in sections_of(overview)]
    charts = [chart for _, charts in sections for chart in charts]
    viewers, poses = _viewers(overview), _poses(overview)
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
        viewers=viewers,
        poses=poses,
        plotly=plotly_js() if charts or viewers or poses else "",
    )
    write_text(path, page)


def _viewers(overview: Overview) -> dict[str, str]:
    """Return the HTML of the mechanism of each scene of the report, by its key: of registered ones
    in a state with velocities and forces, of others in the stored pose of their first state.
    """
    from eomcheck.lab.show.pictures import scene_and_pose
    from eomcheck.lab.show.viewer_plotly import (
        picture_html,
        shown_state,
        viewer_figure,
        viewer_json,
    )

    viewers = {}
    for key in overview.scenes:
        if key in SCENES:
            scene, q = scene_and_pose(SCENES[key])
            state = shown_state(scene, q)
            still = picture_html(scene, state)
            viewers[key] = viewer_figure(viewer_json(scene, [state]), still=still)
        else:
            first = (row for row in overview.rows if row.scene == key and row.pose)
            if html := _posed(next(first, None)):
                viewers[key] = html
    return viewers


MOST_POSES = 40
"""Number of failing states that a report draws: each is a picture and a viewer."""


def _poses(overview: Overview) -> dict[str, str]:
    """Return the HTML of the mechanism in the first failing states of the report, by anchor."""
    failed = [row for row in _states(overview) if row.verdict == "failed"]
    return {anchor(row): html for row in failed[:MOST_POSES] if (html := _posed(row))}


def _posed(row: StoredFinding | None) -> str:
    """Return the HTML of the mechanism in the stored pose of a finding, "" without one."""
    from eomcheck.lab.show.viewer_plotly import sketch_html, sketches_json, viewer_figure

    if row is None or not row.pose:
        return ""
    try:
        names, sketch = pose_of(row.pose)
        still = sketch_html(sketch, names, row.location)
        return viewer_figure(sketches_json([sketch], names), still=still)
    except (ArithmeticError, LookupError, *WRONG):  # stored by another version
        return ""


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


# ---- Page of verified equivalences: tests by claim -----------------------------------------------

PROVED = LEVELS[0]


def named_tests(suite: Path) -> dict[str, tuple[str, ...]]:
    """Return the tests of each claim: those that name it, or are parametrized by it.

    Tests that prove are under "proved".

    Raises:
        InputError: there is no such folder, or no test in it.

    Returns:
        Id of a claim, or "proved" -> test names `folder/file.py::test`.
    """
    files = sorted(suite.glob("test_*.py"))
    if not files:
        raise InputError(f"{str(suite)!r} holds no validation suite")
    tests: dict[str, tuple[str, ...]] = {}
    for file in files:
        for test in ast.parse(file.read_text(encoding="utf-8")).body:
            if isinstance(test, ast.FunctionDef) and test.name.startswith("test_"):
                chosen = {x for d in test.decorator_list for x in _constants(d)}
                for key in sorted(_claims_in(test)):
                    name = f"{test.name}[{key}]" if key in chosen else test.name
                    tests[key] = (*tests.get(key, ()), f"{suite.name}/{file.name}::{name}")
    return tests


def _constants(tree: ast.AST) -> set[Any]:
    return {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)}


def _claims_in(test: ast.FunctionDef) -> set[str]:
    calls = {
        node.func.attr
        for node in ast.walk(test)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)
    }
    return (CLAIMS.keys() & _constants(test)) | ({PROVED} if "prove" in calls else set())


# ---- Page of verified equivalences: independent parameters ---------------------------------------


class IndependentParameters(NamedTuple):
    """Parameters of a scene class, split by whether an engine verifies them independently."""

    scene: str
    covered: str
    """Parameters that an engine reads from another source than `parameters()`, and the engine."""
    common: str
    """Parameters that both derivations read from `parameters()`."""


def independent_parameters(overview: Overview) -> Iterator[IndependentParameters]:
    """Yield, per validated scene, its parameters that an engine obtains independently.

    Those are the parameters that change the scene's `tree()`, if an engine built from the tree took
    part.
    """
    for run in overview.runs:
        if (kind := SCENES.get(run.settings["scene"])) is None:
            continue
        scene: Any = kind.example()
        names = list(kind.ranges(link_count(scene)))
        built_in = [key for key in run.series["engines"] if key in ENGINES]
        keys = [key for key in built_in if not ENGINES[key].reads_parameters]
        in_tree = [name for name in names if keys and _in_tree(scene, name)]
        common = ", ".join(name for name in names if name not in in_tree)
        covered = f"{', '.join(in_tree)} ({', '.join(keys)}, from the tree)" if in_tree else "-"
        uncovered = f"common mode not covered: {common}" if common else "-"
        yield IndependentParameters(kind.key, covered, uncovered)


def _in_tree(scene: Any, name: str) -> bool:
    value, tree = getattr(scene, name), scene.tree()
    if tree is None or value is None:
        return False
    changed = replace(scene, **{name: 1.5 * value + 0.1}).tree()
    return not _equal(tree, changed)


def _equal(x: Any, y: Any) -> bool:
    """Return whether two records of arrays are equal."""
    if isinstance(x, tuple) and isinstance(y, tuple):
        return len(x) == len(y) and all(map(_equal, x, y))
    return np.array_equal(x, y)


# ---- Page of verified equivalences: the page -----------------------------------------------------

RUN = "## The run"
"""Heading of the section about one run alone."""

SHARED = "## Shared parameters"
"""Heading of the section about parameters that both derivations of a scene read."""


def write_equivalences(overview: Overview, path: Path, suite: Path) -> None:
    """Write the page of verified equivalences.

    Args:
        overview: Records of a finished validation, and of proofs.
        path: file to write.
        suite: folder of the validation suite.

    Raises:
        InputError: the Records contain no finished validation, or one in which a claim fails; there
            is no suite; a claim has no test in it.
        EngineError: jinja2 is not installed.
    """
    if not overview.runs or overview.verdict in ("not finished", "nothing checked"):
        raise InputError(f"no finished validation in the records: {overview.headline}")
    if overview.failed:
        raise InputError(f"not all claims hold: {overview.headline}")
    of_run = [r for r in overview.records if r.study in (STATES, RUNS, PROOFS)]
    text = render(
        "equivalences.md.j2",
        overview=overview,
        entries=list(claim_entries(overview, suite)),
        evidence=evidence_table,
        version=__version__,
        heading=RUN,
        shared=SHARED,
        other_data=list(independent_parameters(overview)),
        commands=list(dict.fromkeys(commands(overview))),
        provenance=list(dict.fromkeys(origin_of(r) for r in of_run)),
        versions={name: version for r in of_run for name, version in r.versions.items()},
    )
    write_text(path, text)


def commands(overview: Overview) -> Iterator[str]:
    """Yield the commands that reproduce the Records; of `prove`, one for each scene class."""
    counts_by_scene = {run.settings["scene"]: run.counts for run in overview.runs}
    same = len({tuple(counts.items()) for counts in map(_options, counts_by_scene.values())}) == 1
    whole = same and counts_by_scene.keys() == SCENES.keys()
    for scene, counts in counts_by_scene.items():
        options = "".join(f" --{name} {value}" for name, value in _options(counts).items())
        yield f"eomcheck validate --scene {'all' if whole else scene}{options}"
    proofs = group(overview.of(PROOFS), lambda r: r.settings["scene"])
    links = {r.settings["links"] for r in overview.of(PROOFS)} - {None}
    every = proofs.keys() == SCENES.keys()
    for scene, records in proofs.items():
        link_counts = links if every else {r.settings["links"] for r in records} - {None}
        links_option = f" --links {ranges(link_counts, '..', ',')}" if link_counts else ""
        yield f"eomcheck prove --scene {'all' if every else scene}{links_option}"


def _options(counts: dict[str, int]) -> dict[str, int | str]:
    links = f"{counts['first links']}..{counts['last links']}"
    return {"examples": counts["examples"], "links": links, "seed": counts["seed"]}


def claim_entries(
    overview: Overview, suite: Path
) -> Iterator[tuple[ClaimSummary, tuple[str, ...]]]:
    """Yield every claim with its evidence, and its tests.

    Raises:
        InputError: see `write_equivalences`.
    """
    tests = named_tests(suite)
    for judged in overview.claims:
        key = judged.claim.id
        evidence = [row for row in judged.rows if row.level in LEVELS]
        evidence.sort(key=lambda row: overview.scenes.index(row.scene))
        shown = tests.get(key, ())
        if any(row.level == PROVED for row in evidence):
            shown += tests.get(PROVED, ())
        if not shown:
            raise InputError(f"claim {key!r} has no test in {str(suite)!r}")
        yield ClaimSummary(tuple(evidence)), shown
