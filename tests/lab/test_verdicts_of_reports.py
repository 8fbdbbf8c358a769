"""What a report says of findings: a failure is told whatever stands beside it."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest
from rich.console import Console
from tests.cli.test_cli import run
from tests.lab.test_kept_findings import FAILED, OPEN, PASSED

from eomcheck.claims.run import Run, Selection
from eomcheck.lab import proofs as module
from eomcheck.lab.proofs import Proofs, proof_jobs
from eomcheck.lab.report import findings as printed
from eomcheck.lab.report import proofs as printed_proofs
from eomcheck.lab.report.findings import (
    findings_table,
    parties,
    percent,
    print_run,
    worst,
    write_json,
)
from eomcheck.lab.report.junit import write_junit
from eomcheck.lab.report.overview import Cell, Overview
from eomcheck.lab.store.findings import PROOFS, RUNS, STATES, record_of
from eomcheck.lab.store.records import Record, Records

CLOSE = replace(PASSED, observed=9e-14)
SLIGHT = replace(FAILED, observed=1.1e-13)
LOST = replace(FAILED, observed=math.nan)


def kept(*findings, scene: str = "snake", case: int = 0) -> Record:
    """Return the Record of a state in which this was found."""
    rows = [one.as_dict() | {"observed": one.observed, "allowed": one.allowed} for one in findings]
    return record_of(STATES, {"scene": scene, "links": None, "case": case}, rows, "code")


def ran(scene: str = "snake", status="done") -> Record:
    series = {"claims": [], "seconds": [], "engine versions": []}
    return Record(RUNS, {"scene": scene}, status, counts={"states": 1}, series=series)


# ---- The worst of several ------------------------------------------------------------------------


@pytest.mark.parametrize("failed", [FAILED, SLIGHT, LOST])
def test_a_failure_is_worse_than_any_ratio(failed):
    huge = replace(OPEN, observed=1.0, allowed=1e-300)
    for findings in ([failed, CLOSE, huge], [huge, CLOSE, failed], [CLOSE, failed, huge]):
        assert worst(findings) is failed
        assert Cell.of(findings).kind == "failed"
    assert worst([PASSED, CLOSE, huge]) is CLOSE
    assert worst([OPEN]) is OPEN
    assert worst([]) is None


def test_a_ratio_is_written_as_it_is():
    assert [percent(x) for x in (0.0, 1e-9, 0.5, 1.0, 30.0)] == ["0", "<1%", "50%", "100%", "3000%"]


def test_a_finding_is_about_both_that_it_compares():
    assert parties(replace(PASSED, subject="au ~ kane")) == {"au", "kane"}


# ---- Tables and documents ------------------------------------------------------------------------


def found(*findings) -> Run:
    made = Run()
    made.findings, made.ends = list(findings), [len(findings)]
    made.minimal = next((one for one in findings if one.verdict == "failed"), None)
    return made


SELECTION = Selection.of(["au", "el"], ["casadi"], ["bias"])


def text_of(run: Run, monkeypatch: pytest.MonkeyPatch) -> str:
    console = Console(width=140, record=True, force_terminal=False)
    monkeypatch.setattr(printed, "console", console)
    print_run(run, SELECTION)
    return console.export_text()


def test_a_table_says_fail_open_or_percent():
    table = findings_table(found(CLOSE, FAILED, OPEN), SELECTION)
    cells = [next(iter(column.cells)) for column in table.columns]
    # all, au, el, casadi
    assert [str(cell) for cell in cells[1:5]] == [
        *("[bold red]FAIL[/]", "[bold red]FAIL[/]", "[yellow]?[/]", "[green]90%[/]")
    ]


def test_a_run_that_fails_is_not_said_to_have_passed(monkeypatch, capsys):
    failing = text_of(found(PASSED, FAILED), monkeypatch)
    assert "bias [au] failed" in failing and "eomcheck.check(scene" in failing
    assert "0 failed" not in failing
    assert "1 findings passed, 1 inconclusive, 0 failed" in text_of(
        found(PASSED, OPEN), monkeypatch
    )


def test_the_document_has_every_finding_and_the_smallest_failure(tmp_path: Path):
    elsewhere = replace(PASSED, state=PASSED.state._replace(q=PASSED.state.q + 1.0))
    write_json(tmp_path / "f.json", [found(PASSED, FAILED, OPEN, elsewhere)], SELECTION)
    document = json.loads((tmp_path / "f.json").read_text(encoding="utf-8"))
    verdicts = [row["verdict"] for row in document["findings"]]
    assert verdicts == ["passed", "failed", "inconclusive", "passed"]
    assert [row["case"] for row in document["findings"]] == [0, 0, 0, 1]
    assert [case["q"] for case in document["cases"]] == [
        PASSED.state.q.tolist(),
        elsewhere.state.q.tolist(),
    ]
    assert document["minimal"] == FAILED.as_python()


# ---- Verdict of a report -------------------------------------------------------------------------


def test_one_failure_among_passes_fails():
    records = [ran(), *(kept(CLOSE, case=i) for i in range(9)), kept(SLIGHT, case=9)]
    overview = Overview(records)
    assert overview.verdict == "failed"
    assert [judged.claim.id for judged in overview.failed] == ["bias"]


def test_a_report_of_a_run_that_did_not_end_says_so():
    assert Overview([ran(status="failed"), kept(PASSED)]).verdict == "not finished"
    assert Overview([ran(status="failed"), kept(FAILED)]).verdict == "failed"
    assert Overview([ran(), kept(PASSED)]).verdict == "passed"


def test_where_everything_is_open_nothing_was_checked():
    assert Overview([ran(), kept(OPEN)]).verdict == "nothing checked"


def test_a_claim_of_another_version_is_told_all_the_same():
    overview = Overview([ran(), kept(PASSED, replace(FAILED, claim="of-old"))])
    assert overview.verdict == "failed"
    assert [judged.claim.id for judged in overview.failed] == ["of-old"]


def test_states_of_different_scenes_are_different_states():
    overview = Overview([kept(PASSED), kept(PASSED, scene="sleigh"), kept(PASSED, case=1)])
    assert overview.claims[0].whole.states == 3


def proved(subject: str, chance: float, verdict: str = "passed") -> dict:
    proof = {"degree": 3, "height": 2.0, "primes": [7], "draws": 1, "failure_probability": chance}
    evidence = "proved: 1 point" if verdict == "passed" else "disproved: 1 point"
    made = PASSED.as_dict() | {"subject": subject, "verdict": verdict, "evidence": evidence}
    made |= {"structure": "snake[2]", "detail": "" if verdict == "passed" else "bias, row x"}
    return made | ({"proof": proof} if verdict == "passed" else {})


def test_probabilities_of_mistakes_are_added():
    rows = [proved("a", 1e-40), proved("b", 3e-40)]
    (judged,) = Overview([record_of(PROOFS, {"scene": "snake", "links": 2}, rows, "c")]).claims
    assert judged.failure_probability == pytest.approx(4e-40, abs=0.0)


def test_proofs_are_printed_with_every_disproof_and_the_sum_of_probabilities(monkeypatch):
    proofs = Proofs(proof_jobs("snake", [2], 1, 0, None))
    proofs.findings = {
        "snake[2]": [proved("a", 1e-40), proved("b", 3e-40), proved("c", 0.0, "failed")]
    }
    assert proofs.failed
    console = Console(width=200, record=True, force_terminal=False)
    monkeypatch.setattr(printed_proofs, "console", console)
    printed_proofs.print_proofs(proofs)
    text = console.export_text()
    assert "probability below 4.0e-40" in text
    assert "bias [c] disproved: 1 point on snake[2]: bias, row x" in text
    assert "2 identities proved, 1 disproved" in text


# ---- JUnit ---------------------------------------------------------------------------------------


def junit(tmp_path: Path, *records: Record) -> ElementTree.Element:
    write_junit(Overview(list(records)), tmp_path / "r.xml")
    return ElementTree.parse(tmp_path / "r.xml").getroot()


def test_junit_tells_failed_skipped_and_unfinished(tmp_path: Path):
    root = junit(
        tmp_path,
        ran(status="failed"),
        kept(PASSED, FAILED, replace(OPEN, claim="mass-matrix"), replace(CLOSE, claim="power")),
    )
    counts = [root.get(name) for name in ("tests", "failures", "skipped", "errors")]
    assert counts == ["4", "1", "1", "1"]
    (failure,) = root.iter("failure")
    assert "[au] compared: casadi 3: observed inf" in (failure.get("message") or "")


def test_junit_has_a_failure_in_its_own_scene_only(tmp_path: Path):
    root = junit(tmp_path, kept(FAILED), kept(PASSED, scene="sleigh"))
    failing = [suite.get("name") for suite in root if suite.find(".//failure") is not None]
    assert failing == ["snake"]


def test_junit_can_be_read_whatever_a_finding_says(tmp_path: Path):
    root = junit(tmp_path, kept(replace(FAILED, detail="row \x00 \x1b[31m <θ> & \ud800")))
    (failure,) = root.iter("failure")
    assert "<θ> &" in (failure.get("message") or "")


# ---- Exit codes ----------------------------------------------------------------------------------


def test_commands_that_find_a_failure_exit_with_1(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(module, "_prove", lambda *how: [proved("c", 0.0, "failed")])
    assert run("prove", "--links", "2", "--points", "1", monkeypatch=monkeypatch) == 1
    with Records("r.db") as records:
        for record in (ran(), kept(FAILED)):
            records.add(record)
    assert run("report", "r.db", "--junit", "r.xml", monkeypatch=monkeypatch) == 1
