"""Findings as JUnit XML: a suite per kind of scene, a test case per claim."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

from eomcheck.atomic_write import replacing
from eomcheck.lab.report.judged import Judged
from eomcheck.lab.report.overview import Overview
from eomcheck.safe_output import counted

FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML cannot hold."""


def write_junit(overview: Overview, path: Path) -> None:
    """Write every claim on every scene: failed, skipped where nothing could be checked, or passed.

    A run that did not come to its end is an error of its suite.
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
    of = {"classname": _clean(f"eomcheck.{scene}"), "name": name, "time": f"{seconds:.3f}"}
    return ElementTree.SubElement(suite, "testcase", of)


def _case(suite: ElementTree.Element, scene: str, judged: Judged, seconds: float) -> None:
    case = _test_case(suite, scene, judged.claim.id, seconds)
    if judged.kind == "open":
        ElementTree.SubElement(case, "skipped", message=_clean(_why_open(judged)))
    for row in judged.failed:
        failure = ElementTree.SubElement(case, "failure", message=_clean(str(row)))
        failure.text = _clean(row.python)
    out = ElementTree.SubElement(case, "system-out")
    said = (
        f"{judged.claim.statement} {judged.claim.equations}: "
        f"{counted(len(judged.rows), 'finding')}{judged.undecided}, "
        f"largest error {judged.text} of the error allowed"
    )
    out.text = _clean("\n".join([said, *(row.detail for row in judged.unresolved)]))


def _why_open(judged: Judged) -> str:
    """Return why nothing could be checked."""
    for row in judged.rows:
        if row.verdict == "not looked at":
            return f"not looked at: {row.detail}"
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
