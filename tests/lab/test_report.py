"""`eomcheck report`: what it says of Records and findings, in HTML, Markdown and JUnit."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from tests import reports
from tests.cli.test_cli import run

from eomcheck import CLAIMS, check_state
from eomcheck.claims.finding import unresolved_detail
from eomcheck.engines.casadi import CasadiEngine
from eomcheck.errors import InputError
from eomcheck.lab.report import report_formats
from eomcheck.lab.report.overview import Overview, anchor, read_records
from eomcheck.lab.report.report_formats import (
    DARK,
    sections_of,
    write_junit,
    write_markdown,
    write_page,
)
from eomcheck.lab.show.chart import CONTRAST, STYLES, contrast, on_dark
from eomcheck.lab.show.pictures import sketch_of
from eomcheck.lab.show.table import ResultTable
from eomcheck.lab.store.record_file import Record, Records
from eomcheck.lab.store.validation_runs import (
    RUNS,
    STATES,
    pose_of,
    pose_text,
    stored_findings,
    stored_findings_in,
    validate_kinds,
)
from eomcheck.lab.studies.operations import counted_in
from eomcheck.mechanics.records import State
from eomcheck.mechanics.sketch import Sketch, Trail
from eomcheck.scenes import SCENES, Sleigh


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file with everything that a report can show, and no failure."""
    path = tmp_path_factory.mktemp("good") / "good.db"
    reports.validated(path)
    reports.proved(path)
    reports.counted(path)
    reports.studied(path)
    return path


@pytest.fixture(scope="module")
def bad(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file with a validation that fails."""
    path = tmp_path_factory.mktemp("bad") / "bad.db"
    reports.validated(path, reports.Heavy)
    return path


def page_of(path: Path, tmp_path: Path) -> str:
    write_page(Overview(read_records([path])), tmp_path / "report.html")
    return (tmp_path / "report.html").read_text(encoding="utf-8")


# ---- Findings in Records -------------------------------------------------------------------------


def test_every_finding_of_a_run_is_kept_as_it_was(tmp_path: Path):
    made = reports.validated(tmp_path / "r.db")
    with Records(tmp_path / "r.db") as records:
        kept = stored_findings_in(records.all())
        (of_run,) = records.all(RUNS)
    assert [(k.claim, k.subject, k.observed, k.allowed, k.verdict, k.digits) for k in kept] == [
        (f.claim, f.subject, f.observed, f.allowed, f.verdict, f.digits) for f in made.findings
    ]
    assert {k.case for k in kept} == set(range(made.cases))
    assert of_run.status == "done" and of_run.counts["states"] == made.cases


def test_findings_are_saved_state_by_state(tmp_path: Path):
    seen = []

    def look() -> None:
        with Records(tmp_path / "r.db", readonly=True) as other:
            seen.append((len(other.all(STATES)), other.all(RUNS)[0].status))
        if len(seen) == 2:
            raise KeyboardInterrupt

    selection = reports.RunSelection.of(["au"], [], ["kinetic-energy"], scenes=[reports.Sleigh])
    with Records(tmp_path / "r.db") as records, pytest.raises(KeyboardInterrupt):
        how = selection, (1, 1), 5, 0, look, records
        reports.validate_kind(reports.Sleigh, reports.ValidationRun(), *how)
    assert seen == [(1, "failed"), (2, "failed")]
    assert Overview(read_records([tmp_path / "r.db"])).verdict == "not finished"


@pytest.mark.night
def test_kinds_of_scenes_are_looked_at_alike_in_any_number_of_processes(tmp_path: Path):
    keys = ("sleigh", "rolling-disk", "chain-pendulum")
    kinds = [SCENES[key] for key in keys]
    selection = reports.RunSelection.of(None, [], ["kinetic-energy", "equivalence"], scenes=kinds)
    found, cases = [], []
    for count in (1, 2):
        runs = {key: reports.ValidationRun() for key in keys}
        how = selection, (1, 3), 4, 0, lambda: cases.append(1)
        with Records(tmp_path / f"{count}.db") as records:
            validate_kinds(runs, *how, records, f"local:{count}")
            kept = stored_findings_in(records.all())
        assert tuple(runs) == keys
        assert len(cases) == 3 * 6 * count == sum(run.cases for run in runs.values()) * count
        assert {(one.scene, one.case) for one in kept} == {
            (key, i) for key in keys for i in range(6)
        }
        found.append([[f.as_dict() for f in run.findings] for run in runs.values()])
    assert found[0] == found[1]


def test_a_file_keeps_the_last_validation_of_a_scene(tmp_path: Path):
    reports.validated(tmp_path / "r.db", examples=4)
    made = reports.validated(tmp_path / "r.db", examples=1)
    assert len(Overview(read_records([tmp_path / "r.db"])).rows) == len(made.findings)


def test_the_code_kept_with_a_failing_state_shows_the_failure(bad: Path):
    row = next(row for row in Overview(read_records([bad])).rows if row.claim == "kinetic-energy")
    assert row.verdict == "failed"
    found: dict = {}
    exec(row.python.split("for finding")[0], found)
    again = check_state(
        found["scene"], found["q"], found["v"], claims=["kinetic-energy"], engines=[]
    )
    assert [finding.verdict for finding in again] == ["failed"]
    assert again[0].observed == row.observed


def test_the_code_kept_with_a_state_asks_the_engines_that_were_on_trial_there():
    scene = reports.Sleigh.example()
    q, v = scene.initial_state()
    found = check_state(scene, q, v, claims=["mass-matrix"], engines=["casadi"])
    kept = stored_findings(found, "sleigh", 0)
    assert len(kept) == len(found) == 1 and found[0].engine is None
    assert "engines=" not in kept[0].python
    tried = [replace(one, engine=CasadiEngine) for one in found]
    (kept,) = stored_findings(tried, "sleigh", 0)
    assert "import CasadiEngine" in kept.python and "engines=[CasadiEngine]" in kept.python


def test_counts_come_back_from_records_as_they_were(tmp_path: Path):
    counted = reports.counted(tmp_path / "r.db")
    with Records(tmp_path / "r.db") as records:
        assert counted_in(records.all()) == counted


# ---- What is said --------------------------------------------------------------------------------


def test_the_verdict_is_that_of_the_findings(good: Path, bad: Path):
    passed, failed = Overview(read_records([good])), Overview(read_records([bad]))
    assert passed.verdict == "passed" and passed.headline.startswith("All ")
    assert failed.verdict == "failed" and "kinetic-energy" in failed.headline
    assert [one.claim.id for one in failed.failed] == ["mass-matrix", "kinetic-energy"]
    studies = Overview([record for record in passed.records if record.study != STATES])
    assert studies.verdict == "passed"  # the proofs
    assert Overview([Record("accuracy", {})]).verdict == "nothing checked"


def test_a_claim_that_nothing_could_be_checked_on_does_not_hold(good: Path):
    overview = Overview(read_records([good]))
    overview.rows = [
        replace(row, verdict="inconclusive") if row.claim == "kinetic-energy" else row
        for row in overview.rows
    ]
    assert "on the others nothing could be checked" in overview.headline
    assert (overview.verdict, overview.mark) == ("passed", "partly")


def test_a_state_that_failed_is_shown_in_its_pose_also_of_a_class_that_is_not_registered(
    bad: Path, tmp_path: Path
):
    overview = Overview(read_records([bad]))
    (row,) = {one.location: one for one in overview.failed[0].failed}.values()
    names, sketch = pose_of(row.pose)
    assert names == ["x", "y", "θ"]
    q = re.search(r"q = (\[.*\])", row.python)
    assert q is not None
    drawn = sketch_of(Sleigh.example(), np.array(json.loads(q[1])))
    assert {type(part) for part in sketch.parts} == {type(part) for part in drawn.parts}
    text = page_of(bad, tmp_path)
    state = text[text.index(f'<details id="{anchor(row)}"') :]
    assert state.index('class="viewer"') < state.index("<pre>") < state.index("</details>")
    assert "heavy" in text[text.index('id="mechanisms"') :]
    overview = Overview(read_records([bad]))
    overview.rows = [replace(one, pose="[1]") for one in overview.rows]
    write_page(overview, tmp_path / "old.html")
    assert 'class="viewer"' not in (tmp_path / "old.html").read_text(encoding="utf-8")


def test_a_pose_is_that_of_the_state_at_its_time():
    class Moved(Sleigh):
        key = "moved"

        def sketch(self, q, t=0.0) -> Any:
            return Sketch((Trail((q[0], t)),))

    state = State(np.array([1.0, 0.0, 0.0]), np.zeros(3), 2.0)
    _, sketch = pose_of(pose_text(Moved(), state))
    assert sketch.parts[0].at == [1.0, 2.0]


def test_each_scene_is_shown_in_a_pose_of_its_own_and_states_that_failed(bad: Path, monkeypatch):
    overview = Overview(read_records([bad]))
    row = overview.rows[0]
    verdicts = {"one": "passed", "two": "failed"}
    overview.rows = [replace(row, scene=x, pose=x, verdict=verdicts[x]) for x in verdicts]
    monkeypatch.setattr(report_formats, "_posed", lambda row: "" if row is None else row.pose)
    assert report_formats._viewers(overview) == {"one": "one", "two": "two"}
    assert [*report_formats._poses(overview).values()] == ["two"]


def test_a_scene_that_cannot_draw_a_state_has_no_pose_of_it():
    class Hidden(Sleigh):
        key = "hidden"

        def sketch(self, q, t=0.0) -> Any:
            return None if q[0] else 1 / 0

    state = State(np.zeros(3), np.zeros(3), 0.0)
    assert pose_text(Hidden(), state) == pose_text(Hidden(), state._replace(q=np.ones(3))) == ""
    assert pose_text(Sleigh(), None) == pose_text("functions", state) == ""


def test_only_if_nothing_is_undecided_the_mark_is_that_of_success(good: Path, bad: Path):
    assert Overview(read_records([good])).mark == "passed"
    assert Overview(read_records([bad])).mark == "failed"
    assert Overview([Record("accuracy", {})]).mark == "nothing-checked"
    overview = Overview(read_records([good]))
    (first, *others) = overview.rows
    overview.rows = [
        replace(first, verdict="inconclusive", detail=unresolved_detail(["M"], 2)),
        *others,
    ]
    assert overview.headline.startswith("All ") and overview.mark == "partly"


def test_of_a_cell_in_two_files_the_last_counts(tmp_path: Path):
    for name in ("a", "b"):
        with Records(tmp_path / name) as records:
            records.add(Record("s", {"x": 1}, errors={"e": float(ord(name))}))
    (found,) = read_records([tmp_path / "a", tmp_path / "b"])
    assert found.errors["e"] == ord("b")


def test_there_is_a_section_only_where_there_is_data(good: Path, tmp_path: Path):
    assert {one.id for one in sections_of(Overview(read_records([good])))} == {
        *("digits", "strata", "work-precision", "stability", "operations", "paper")
    }
    reports.counted(tmp_path / "r.db")
    assert [one.id for one in sections_of(Overview(read_records([tmp_path / "r.db"])))] == [
        "operations"
    ]
    text = page_of(tmp_path / "r.db", tmp_path)
    assert 'id="operations"' in text and 'id="claims"' not in text
    with Records(tmp_path / "s.db") as records:
        records.add(Record("own", {}))
    assert len(page_of(tmp_path / "s.db", tmp_path)) < 50_000  # no chart, no library for charts


# ---- HTML, Markdown, JUnit -----------------------------------------------------------------------


def test_every_link_of_the_page_leads_somewhere(good: Path, bad: Path, tmp_path: Path):
    for path in (good, bad):
        text = page_of(path, tmp_path).split("<script>")[0]
        links, ids = re.findall(r'href="#([^"]+)"', text), re.findall(r'\bid="([^"]+)"', text)
        assert links and set(links) <= set(ids)
        assert len(ids) == len(set(ids))


def test_a_failure_leads_to_its_claim_and_its_state(bad: Path, tmp_path: Path):
    text = page_of(bad, tmp_path)
    assert re.search(r'<h1 class="verdict failed">[^<]*kinetic-energy', text)
    section = text[text.index('id="failures"') : text.index('id="claims"')]
    (state, *_) = re.findall(r'kinetic-energy</a>.*?href="#(state-[^"]+)"', section, re.S)
    assert f'<details id="{state}">' in text


def test_the_page_loads_nothing(good: Path, tmp_path: Path):
    text = page_of(good, tmp_path)
    assert not re.findall(r'<(?:script|link|img)[^>]+(?:src|href)="(?!data:)', text)


def test_text_of_records_is_no_markup(good: Path, tmp_path: Path):
    text = page_of(good, tmp_path)
    assert "M_Kane: rcond <1e-17>" not in text
    assert "rcond &lt;1e-17&gt;" in text or "rcond \\u0026lt;1e-17" in text or "&lt;1e-17" in text


def test_markdown_has_every_claim_and_every_failure(good: Path, bad: Path, tmp_path: Path):
    for path in (good, bad):
        overview = Overview(read_records([path]))
        write_markdown(overview, tmp_path / "r.md")
        text = (tmp_path / "r.md").read_text(encoding="utf-8")
        assert text.startswith(f"# eomcheck: {overview.headline}\n")
        assert all(f"| `{judged.claim.id}` |" in text for judged in overview.claims)
        assert all(f"## {judged.claim.id} fails" in text for judged in overview.failed)
        assert "\n\n\n" not in text


def test_junit_counts_claims_and_carries_the_failing_state(good: Path, bad: Path, tmp_path: Path):
    for path in (good, bad):
        overview = Overview(read_records([path]))
        write_junit(overview, tmp_path / "r.xml")
        root = ElementTree.parse(tmp_path / "r.xml").getroot()
        assert int(root.get("tests", "")) == sum(len(one.scenes) for one in overview.claims)
        failing = [case.get("name") for case in root.iter("testcase") if case.find("failure")
                   is not None]  # fmt: skip
        assert failing == [judged.claim.id for judged in overview.failed]
        assert int(root.get("failures", "")) == len(failing)
        for failure in root.iter("failure"):
            assert "eomcheck.check_state(scene, q, v" in (failure.text or "")


HOSTILE = "a|b`c*\n# d\x1b[31m<e>"


def test_markdown_escapes_keys_and_control_characters(good: Path, tmp_path: Path):
    one = next(x for x in read_records([good]) if x.study == STATES)
    count = len(one.series["claim"])
    changed = {name: [HOSTILE] * count for name in ("claim", "subject", "evidence", "detail")}
    changed["verdict"] = ["failed"] * count
    settings = one.settings | {"scene": HOSTILE}
    overview = Overview([Record(STATES, settings, series=one.series | changed)])
    write_markdown(overview, tmp_path / "r.md")
    text = (tmp_path / "r.md").read_text(encoding="utf-8")
    assert "\x1b" not in text
    lines = text.splitlines()
    assert not [line for line in lines if line.startswith(("# d", "<e>"))]
    (first,) = [i for i, line in enumerate(lines) if line.startswith("| claim |")]
    table = lines[first : lines.index("", first)]
    assert len(table) == 3
    assert {len(re.findall(r"(?<!\\)\|", line)) for line in table} == {5}
    assert not re.findall(r"(?<!\\)<e", "\n".join(line for line in lines if "`" not in line))


def test_a_table_in_markdown_keeps_its_columns():
    text = ResultTable("name", "", ("a|b", "c"), [("1\n2", "|x|"), ("\x07", "")]).markdown()
    assert text.splitlines() == [
        "| a\\|b | c |",
        "| --- | --- |",
        "| 1 2 | \\|x\\| |",
        "| \ufffd |  |",
    ]


def test_junit_has_an_error_for_a_run_that_did_not_end(tmp_path: Path):
    with Records(tmp_path / "r.db") as records:
        series = {"claims": [], "seconds": [], "engine versions": []}
        records.add(Record(RUNS, {"scene": "sleigh"}, "failed", "not finished", series=series))
    write_junit(Overview(read_records([tmp_path / "r.db"])), tmp_path / "r.xml")
    assert ElementTree.parse(tmp_path / "r.xml").getroot().get("errors") == "1"


def test_colours_can_be_told_from_the_dark_page():
    colors = {style.color for style in STYLES.values()}
    assert len({on_dark(color) for color in colors}) == len(colors)
    for color in colors:
        assert contrast(on_dark(color), DARK) >= CONTRAST


# ---- The command ---------------------------------------------------------------------------------


def test_the_command_writes_what_it_is_asked_for(
    good: Path, bad: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    arguments = ["report", str(good), str(bad)]
    files = ["--html", "a.html", "--markdown", "a.md", "--junit", "a.xml"]
    assert run(*arguments, *files, monkeypatch=monkeypatch) == 1  # a claim fails
    assert {path.name for path in tmp_path.iterdir()} == {"a.html", "a.md", "a.xml"}
    assert run("report", str(good), monkeypatch=monkeypatch) == 0
    assert Path("report.html").exists()


def test_bad_input_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    Path("text.db").write_text("not a database", encoding="utf-8")
    Path("nothing.db").write_bytes(b"")
    Records("empty.db").close()
    for arguments, says in (
        (["none.db"], "no such file"),
        (["text.db"], "is not a file of records"),
        (["nothing.db"], "is not a file of records"),
        (["empty.db"], "no records in 'empty.db'"),
        (["empty.db", "--html", "empty.db"], "holds the records themselves"),
        (["empty.db", "--junit", "no/such/folder.xml"], "does not exist"),
    ):
        assert run("report", *arguments, monkeypatch=monkeypatch) == 2
        said = capsys.readouterr().err
        assert says in said and said.count("\n") == 1, said
    assert not Path("report.html").exists()


@pytest.mark.parametrize("there", [False, True])
def test_nothing_of_a_validation_is_written_over_its_records(
    there: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    Path("link.db").symlink_to("r.db")
    if there:
        Records("r.db").close()
    few = "--scene", "sleigh", "--examples", "1", "--engine", "none", "--formulation", "gw"
    for option, path in (("--report", "r.db"), ("--report", "link.db"), ("--json", "./r.db")):
        onto = "--records", "r.db", option, path
        assert run("validate", *few, *onto, monkeypatch=monkeypatch) == 2
        assert f"{str(Path(path))!r} holds the records themselves" in capsys.readouterr().err
    assert Path("r.db").exists() == there


def test_nothing_is_read_without_a_file():
    with pytest.raises(InputError, match="no records"):
        read_records([])


def test_every_claim_can_be_reported():
    assert set(CLAIMS)  # ids are anchors of the page
    assert all(re.fullmatch(r"[a-z-]+", key) for key in CLAIMS)


def test_validate_writes_the_page_itself_and_leaves_no_records(tmp_path, monkeypatch, capsys):
    page = tmp_path / "report.html"
    asked = "validate", "--scene", "sleigh", "--examples", "1", "--engine", "casadi"
    assert run(*asked, "--report", str(page), monkeypatch=monkeypatch) == 0
    assert f"written: {page}" in capsys.readouterr().out.replace("\n", "")
    assert "claims hold" in page.read_text(encoding="utf-8")
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]
    assert run(*asked, "--report", str(tmp_path), monkeypatch=monkeypatch) == 2
    assert "is a folder, expected a file" in capsys.readouterr().err


def test_a_report_draws_the_first_of_many_failing_states(monkeypatch):
    rows = [
        SimpleNamespace(verdict=x, name=str(k)) for k, x in enumerate(["passed", *["failed"] * 9])
    ]
    monkeypatch.setattr(report_formats, "MOST_POSES", 3)
    monkeypatch.setattr(report_formats, "_states", lambda overview: overview)
    monkeypatch.setattr(report_formats, "_posed", lambda row: f"<{row.name}>")
    monkeypatch.setattr(report_formats, "anchor", lambda row: row.name)
    assert report_formats._poses(rows) == {"1": "<1>", "2": "<2>", "3": "<3>"}
