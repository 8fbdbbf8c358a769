"""What is printed and written of runs: each number, name and branch, of runs told by hand."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from tests.lab.test_tables import kept, run_of, shown, table
from tests.reports import running_differences

from eomcheck import __version__
from eomcheck.claims import CLAIMS
from eomcheck.claims.finding import Finding, Unresolved
from eomcheck.claims.numerical_accuracy import SampledState
from eomcheck.claims.run import RunSelection, ValidationRun
from eomcheck.engines import version_of
from eomcheck.engines.casadi import CasadiEngine
from eomcheck.engines.pinocchio import PinocchioEngine
from eomcheck.lab import library_comparison
from eomcheck.lab.discrepancy import Explanation
from eomcheck.lab.fuzzing.failures import FailureRecord, ReplayResult
from eomcheck.lab.library_comparison import LibraryComparison, LibraryResult
from eomcheck.lab.report import (
    equations_output,
    finding_output,
    motion_tables,
    registries,
    report_formats,
)
from eomcheck.lab.report.finding_output import write_findings
from eomcheck.lab.report.overview import (
    ClaimSummary,
    Overview,
    by_claim,
    evidence_table,
    origin_of,
    worst_table,
)
from eomcheck.lab.report.report_formats import named_tests, sections_of, write_junit
from eomcheck.lab.show.chart import Axis, Chart, Line, Panel
from eomcheck.lab.store.record_file import Record
from eomcheck.lab.store.validation_runs import PROOFS, RUNS
from eomcheck.mechanics.records import State
from eomcheck.scenes import SCENES, Bricard, FourBarChain, Sleigh, Snake

SLEIGH, CHAIN = Sleigh.example(), FourBarChain.example()


def at(scene: Any, number: int) -> State:
    """Return a state of its own, known by its time."""
    return State(*scene.initial_state(), float(number))


def finding(state: State, verdict: Any = "passed", scene: Any = SLEIGH, **change: Any) -> Finding:
    """Return a Finding on mass-matrix [casadi] unless told otherwise."""
    usual = Finding("mass-matrix", "casadi", scene, state, 0.5, 1.0, verdict, "compared: x", "")
    return replace(usual, **change)


def said_of(capsys: pytest.CaptureFixture[str], runs: dict[str, ValidationRun], **how: Any) -> str:
    """Return what is printed of runs, in one line."""
    asked = {"engines": ["casadi"], "claims": ["mass-matrix"], "scenes": [SLEIGH, CHAIN]} | how
    wide = asked.pop("wide", False)
    finding_output.print_runs(runs, RunSelection.of(**asked), wide)
    return " ".join(capsys.readouterr().out.split())


# ---- Runs on a terminal --------------------------------------------------------------------------


def test_states_and_failures_of_all_scenes_are_counted(capsys):
    states = [at(SLEIGH, k) for k in range(4)]
    first = ValidationRun(
        [finding(x, "failed", observed=2.0 + i) for i, x in enumerate(states[:3])]
    )
    first.ends = [1, 2, 3]
    other = ValidationRun([finding(x, "passed", CHAIN) for x in states[2:]], ends=[1, 2])
    said = said_of(capsys, {"sleigh": first, "four-bar-chain": other})
    start = f"eomcheck {__version__}, 2 scenes, {version_of(CasadiEngine)}, 5 states, 5 findings "
    # Of one claim and subject on one scene the first failure stands for all.
    failure = "FAIL mass-matrix (casadi) on sleigh, state 0 error 2, rounding allows 1 "
    assert said.startswith(f"{start}1 of 1 claim failed: mass-matrix {failure}")


def test_the_smallest_failing_state_is_that_of_the_run_and_never_that_of_coverage(capsys):
    states = [at(SLEIGH, k) for k in range(4)]
    rows = [
        finding(states[0]),
        finding(states[1], "failed", claim="coverage", subject="all", detail="2 of 3 refused"),
        finding(states[2], "failed"),
    ]
    run = ValidationRun(rows, ends=[1, 2, 3], sampled=[SampledState(SLEIGH, states[0], ())])
    said = said_of(capsys, {"sleigh": run})
    assert " ".join(rows[2].as_python().split()) in said
    assert " ".join(rows[1].as_python().split()) not in said
    run.minimal = finding(states[3], "failed")
    said = said_of(capsys, {"sleigh": run})
    assert " ".join(run.minimal.as_python().split()) in said
    assert " ".join(rows[2].as_python().split()) not in said


def test_a_run_that_stopped_at_a_failure_says_so(capsys):
    states = [at(SLEIGH, k) for k in range(2)]
    run = ValidationRun([finding(states[0]), finding(states[1], "failed")], ends=[1, 2])
    run.sampled = [SampledState(SLEIGH, state, ()) for state in states]
    stopped = "sleigh: no further states were drawn after this failure: 2 states checked"
    assert stopped not in said_of(capsys, {"sleigh": run})
    run.minimal = run.findings[1]
    assert stopped in said_of(capsys, {"sleigh": run})


@pytest.mark.parametrize(
    ("verdicts", "style"),
    [
        ({"bias": "passed", "mass-matrix": "passed"}, "bold green"),
        ({"bias": "passed", "mass-matrix": "inconclusive"}, "bold yellow"),
        ({"bias": "passed", "mass-matrix": "skipped"}, "bold yellow"),
        ({"bias": "failed", "mass-matrix": "skipped"}, "bold red"),
        ({"bias": "skipped", "mass-matrix": "inconclusive"}, ""),
    ],
)
def test_a_verdict_is_green_only_if_every_claim_is_decided(monkeypatch, verdicts, style: str):
    styles = []
    monkeypatch.setattr(equations_output, "say", lambda text, style: styles.append(style))
    rows = [kept(claim, verdict=verdict) for claim, verdict in verdicts.items()]
    equations_output.print_verdict(rows)
    assert styles == [style]


def test_a_block_of_failures_names_the_formulations_of_all_of_them_alone(capsys):
    """Claims and those who fail them: one of a pair only, an engine too, one in every pair."""
    failing = {
        "active-forces": ["kane ~ ml"],
        "bias": ["kane"],
        "equivalence": ["ml"],
        "multipliers": ["kane", "kane ~ casadi"],
        "power-balance": ["em ~ gw", "em ~ uk"],
        "mass-matrix": ["gw"],
    }
    finding_output.print_failures(
        ClaimSummary(tuple(kept(claim, subject=x, verdict="failed") for x in subjects))
        for claim, subjects in failing.items()
    )
    said = capsys.readouterr().out
    assert said.count("FAIL ") == 5 and said.count(" too: ") == 1
    assert "by kane too: bias\n" in said


def test_claims_that_fail_by_one_formulation_are_one_block(capsys):
    failing = [
        kept("active-forces", subject="kane", verdict="failed"),
        kept("kane-ml-force", subject="kane ~ ml", verdict="failed"),
        kept("equivalence", subject="au ~ kane", verdict="failed"),
        kept("equivalence", subject="kane ~ gw", verdict="failed"),
        kept("power-balance", subject="em", verdict="failed"),
        kept("mass-matrix", subject="casadi", verdict="failed"),
        kept("bias", subject="casadi", verdict="failed"),
        kept("multipliers", subject="kane", verdict="failed", scene="sleigh"),
    ]
    finding_output.print_failures(ClaimSummary((row,)) for row in failing[:2])
    assert capsys.readouterr().out.endswith("     by kane too: kane-ml-force\n")
    finding_output.print_failures(by_claim(failing))
    said = capsys.readouterr().out
    heads = [line.split()[1] for line in said.splitlines() if line.startswith("FAIL")]
    assert len(heads) == 5 and said.count("by kane too: ") == 1
    assert {"power-balance", "mass-matrix", "bias", "multipliers"} < {*heads}
    (too,) = [line for line in said.splitlines() if "by kane too" in line]
    (first,) = {*heads} - {"power-balance", "mass-matrix", "bias", "multipliers"}
    assert {first, *too.partition(": ")[2].split(", ")} == {
        *("active-forces", "kane-ml-force", "equivalence")
    }


def test_coverage_is_said_of_one_scene_whatever_its_verdict(capsys):
    state = at(SLEIGH, 0)
    of = {"claim": "coverage", "subject": "all", "detail": "1 of 9 drawn states was refused"}
    run = ValidationRun([finding(state), finding(state, **of)], ends=[1])
    run.sampled = [SampledState(SLEIGH, state, ())]
    said = said_of(capsys, {"sleigh": run})
    assert "coverage: 1 of 9 drawn states was refused" in said
    two = said_of(capsys, {"sleigh": run, "four-bar-chain": ValidationRun()})
    assert "coverage:" not in two


def test_tables_of_claims_and_states_are_printed_where_they_are_asked_for(capsys):
    run = ValidationRun([finding(at(SLEIGH, 0))], ends=[1])
    run.sampled = [SampledState(SLEIGH, at(SLEIGH, 0), ())]
    for runs in ({"sleigh": run}, {"sleigh": run, "four-bar-chain": ValidationRun()}):
        assert "┃" not in said_of(capsys, runs).partition("Checked states by scene")[0]
        said = said_of(capsys, runs, wide=True)
        assert "┃ claim ┃ worst ┃ by ┃ on ┃" in said and "┃ factor ┃" in said


def test_each_subject_that_was_not_looked_at_is_said_with_its_first_reason(capsys):
    how: dict[str, Any] = {"verdict": "skipped"}
    rows = [
        kept(subject="au", detail="no speeds", case=1, **how),
        kept(subject="au", detail="another", case=2, **how),
        kept(subject="el", detail="no a′", case=3, scene="sleigh", links=None, **how),
        kept(detail="passed"),
    ]
    finding_output.print_skipped(by_claim(rows))
    assert capsys.readouterr().out.splitlines() == [
        "skipped: bias [au] on snake, N = 3, state 1: no speeds",
        "skipped: bias [el] on sleigh, state 3: no a′",
    ]


def test_only_the_library_that_reads_the_file_is_said_to():
    selection = RunSelection.of(engines=[CasadiEngine, PinocchioEngine], scenes=[SLEIGH])
    selection = replace(selection, reader=PinocchioEngine)  # type: ignore[arg-type]
    ends = [
        finding_output._called(one, selection).endswith(" (reads the file itself)")
        for one in selection.engines
    ]
    assert ends == [False, True]


def test_what_was_found_is_told_as_observed_and_allowed():
    one = kept(observed=3e-9, allowed=7e-12, verdict="failed", detail="row x")
    numbers = "observed 3e-09, allowed 7e-12"
    assert str(one) == (
        f"[au ~ el] failed on snake, N = 3, state 7 (property-tested: doubles): {numbers}; row x"
    )
    assert ClaimSummary((one,)).cell.hover_text == f"{one}; 1 finding"
    # The last of equals is the worst one, and a state without an error has no place.
    same = [kept(case=1), kept(case=2), kept("motion", observed=0.0)]
    cells = [tuple(map(str, row)) for row in worst_table(by_claim(same)).rows]
    assert ("bias", "50%", "au ~ el", "snake[3] #2", "2") in cells
    (row,) = table(evidence_table(ClaimSummary((same[2],))))
    assert (row["ratio"], row["where"]) == ("0", "")


# ---- JUnit ---------------------------------------------------------------------------------------


def test_junit_has_the_seconds_of_each_scene_and_claim_and_the_sums_and_why_nothing_was_checked(
    tmp_path: Path,
):
    def timed(scene: str, *seconds: float, status: Any = "done") -> Record:
        series = {"claims": ["bias", "motion"], "seconds": list(seconds), "engines": []}
        return Record(RUNS, {"scene": scene}, status, series=series, counts={"states": 2})

    overview = Overview([timed("snake", 1.5, 0.25), timed("sleigh", 4.0, 8.0, status="failed")])
    nothing: dict[str, Any] = {"scene": "sleigh", "links": None, "observed": 9.0}
    overview.rows = [
        kept(),
        kept("motion", verdict="failed", subject="em", detail="broken"),
        kept("motion", verdict="failed", subject="im", case=8),
        kept(verdict="inconclusive", detail="wide", **nothing),
        kept(verdict="skipped", detail="no tree", **nothing),
        kept("motion", verdict="inconclusive", detail="wide", **nothing),
    ]
    write_junit(overview, tmp_path / "r.xml")
    root = ElementTree.parse(tmp_path / "r.xml").getroot()
    names = ("tests", "failures", "errors", "skipped", "time")
    told = {one.get("name"): tuple(one.get(x) for x in names) for one in (root, *root)}
    assert told == {
        "eomcheck": ("5", "1", "1", "2", "13.750"),
        "snake": ("2", "1", "0", "0", "1.750"),
        "sleigh": ("3", "0", "1", "2", "12.000"),
    }
    cases = {(x.get("classname"), x.get("name")): x for x in root.iter("testcase")}
    assert [x.get("time") for x in cases.values()] == ["1.500", "0.250", "4.000", "8.000", "0.000"]
    why = [x.get("message") for x in root.iter("skipped")]
    assert why == ["skipped: no tree", "inconclusive: nothing could be checked"]
    failing = cases["eomcheck.snake", "motion"]
    assert [x.get("message", "").split("]")[0] for x in failing.iter("failure")] == ["[em", "[im"]
    out = [x.findtext("system-out", "") for x in cases.values()]
    assert "1 finding, largest error 50% of the error allowed" in out[0]
    assert "2 findings, largest error FAIL of" in out[1]
    assert "2 findings, 1 inconclusive, 1 skipped, largest error ? of" in out[2]


# ---- The report ----------------------------------------------------------------------------------


def record(scene: str, when: str, **how: Any) -> Record:
    """Return the Record of a validation, made by hand on a machine made by hand."""
    machine = {"cpu": "Abacus", "cores": 3, "python": "3.14", "os": "none"}
    usual = run_of(scene, "done")
    return replace(usual, when=when, machine=machine, **how)


def test_a_report_says_what_it_rests_on_and_where_that_was_made():
    versions = {"eomcheck": "7.1", "sources": "5a5a", "commit": "c0ffee"}
    series = {"engines": ["casadi"], "engine versions": ["CasADi 3"], "claims": [], "seconds": []}
    other = series | {"engines": ["shy"], "engine versions": ["CasADi 3", "Shy 1"]}
    late = record("snake", "2026-03-05T01:02:03+00:00", versions=versions, series=other)
    early = record("sleigh", "2026-01-09T01:02:03+00:00", versions={"sources": "5a5a"})
    early = replace(early, series=series)
    overview = Overview([late, early, Record(PROOFS, {"scene": "sleigh", "links": None})][:2])
    overview.rows = [kept(), kept(subject="shy"), kept(subject="im ~ casadi", scene="sleigh")]
    place = "Abacus (3 cores), Python 3.14"
    assert origin_of(late) == f"2026-03-05, eomcheck 7.1 (c0ffee), {place}"
    assert overview.provenance == [
        f"2026-01-09, eomcheck ? (sources 5a5a), {place}",
        origin_of(late),
    ]
    assert overview.engines == ["CasADi 3", "Shy 1"]
    assert overview.columns == ["im", "au", "el", "casadi", "shy"]
    assert overview.scenes == ["snake", "sleigh"]
    assert overview.basis == "3 findings, 8 states, on snake, sleigh."
    overview.records.append(Record(PROOFS, {"scene": "sleigh", "links": None}))
    assert overview.basis == "3 findings, 8 states, 1 structure proved, on snake, sleigh."


@pytest.mark.parametrize(
    ("rows", "says"),
    [
        ([], "The run did not come to its end; no claim was checked."),
        ([kept()], "The run did not come to its end; until then none of 1 claim failed."),
        (
            [kept(verdict="failed"), kept("motion", verdict="failed"), kept("energy-rate")],
            "2 of 3 claims fail: bias, motion.",
        ),
    ],
)
def test_the_headline_of_a_run_that_did_not_end_says_whether_anything_was_checked(rows, says):
    overview = Overview([replace(run_of("snake", "failed"), counts={"states": 0})])
    overview.rows = rows
    assert overview.headline == says


def test_digits_are_told_of_what_was_decided_and_strata_of_each_run_by_itself():
    names = {"strata": ["speeds", "speeds", "mass"], "ways": ["slow", "fast", "one"]}
    series = {"engines": [], "claims": [], "seconds": [], "states in them": [3, 1, 4]} | names
    other = {"strata": ["speeds"], "ways": ["slow"], "states in them": [8]}
    runs = [
        Record(RUNS, {"scene": "snake"}, series=series),
        Record(RUNS, {"scene": "sleigh"}, series=series | other),
    ]
    overview = Overview(runs)
    overview.rows = [
        kept(subject="au", digits=9.0),
        kept(subject="au", digits=3.0, verdict="inconclusive"),
        kept(subject="au", digits=7.0, verdict="failed"),
    ]
    digits, strata = sections_of(overview)
    assert [tuple(map(str, row)) for row in digits.tables[0].rows] == [("au", "2", "7.0 (8.0)")]
    assert [tuple(map(str, row)) for row in strata.tables[0].rows] == [
        ("snake", "speeds", "slow (3 states), fast (1)"),
        ("snake", "mass", "one (4 states)"),
        ("sleigh", "speeds", "slow (8 states)"),
    ]


def test_a_report_says_by_which_commands_it_can_be_made_again():
    def proof(scene: str, links: int | None) -> Record:
        return Record(PROOFS, {"scene": scene, "links": links, "structure": f"{links}"})

    def run(scene: str, **counts: int) -> Record:
        asked = {"examples": 7, "seed": 3, "first links": 2, "last links": 5} | counts
        return replace(run_of(scene, "done"), counts=asked)

    proofs = [proof("snake", n) for n in (1, 2, 3, 20)] + [proof("sleigh", None)]
    overview = Overview([run("snake"), run("sleigh", examples=9)])
    overview.records += proofs
    assert list(report_formats.commands(overview)) == [
        "eomcheck validate --scene snake --examples 7 --links 2..5 --seed 3",
        "eomcheck validate --scene sleigh --examples 9 --links 2..5 --seed 3",
        "eomcheck prove --scene snake --links 1..3,20",
        "eomcheck prove --scene sleigh",
    ]
    overview = Overview([run(key) for key in SCENES])
    overview.records += [proof(key, 4 if key == "snake" else None) for key in SCENES]
    assert set(report_formats.commands(overview)) == {
        "eomcheck validate --scene all --examples 7 --links 2..5 --seed 3",
        "eomcheck prove --scene all --links 4",
    }
    overview = Overview([run(key, seed=int(key == "snake")) for key in SCENES])
    assert len(set(report_formats.commands(overview))) == len(SCENES)


SUITE = """
import pytest

@pytest.mark.parametrize("claim", ["bias", "mass-matrix"])
def test_both(claim):
    assert "coverage"

def test_named():
    holds("bias")

def test_proved():
    lab.prove(1)

def helper():
    holds("coverage")
"""


def test_tests_are_named_by_the_claims_in_them_and_by_what_they_are_parametrized_with(tmp_path):
    (tmp_path / "test_b.py").write_text("def test_other():\n    holds('bias')\n")
    (tmp_path / "test_a.py").write_text(SUITE)
    (tmp_path / "helper.py").write_text("def test_no():\n    holds('bias')\n")
    a, b = f"{tmp_path.name}/test_a.py::", f"{tmp_path.name}/test_b.py::"
    assert named_tests(tmp_path) == {
        "bias": (f"{a}test_both[bias]", f"{a}test_named", f"{b}test_other"),
        "mass-matrix": (f"{a}test_both[mass-matrix]",),
        "coverage": (f"{a}test_both",),
        "proved": (f"{a}test_proved",),
    }


def test_a_page_shows_failing_states_first_and_each_state_once():
    overview = Overview([run_of("snake", "done")])
    overview.rows = [
        kept(case=1),
        kept(case=2, observed=0.75),
        kept("motion", case=3, verdict="failed"),
        kept("motion", case=2, verdict="failed", subject="em"),
        kept("motion", case=4, evidence="compared: x", observed=0.125),
        kept("motion", case=5, evidence="compared: x"),
        kept("bias", case=6, scene="sleigh", links=None),
    ]
    states = [(one.scene, one.case, one.verdict) for one in report_formats._states(overview)]
    assert states == [
        ("snake", 3, "failed"),
        ("snake", 2, "failed"),
        ("sleigh", 6, "passed"),
        ("snake", 5, "passed"),
    ]
    line = Chart("c", "t", ["x"], {("a",): Panel(Axis("x"), Axis("y"), [Line("kane", [1], [1])])})
    assert report_formats.overview_formulations(overview, [line]) == ["au", "el", "em", "kane"]
    assert report_formats.overview_formulations(Overview([]), []) == []


def test_kept_failures_are_told_by_their_numbers_and_how_many_there_are_of_each(
    monkeypatch, capsys
):
    monkeypatch.setattr(FailureRecord, "python", property(lambda find: f"code of {find.claim}"))
    outcomes: list[Any] = [
        ("holds", "bias", ""),
        ("inconclusive", "motion", "wide"),
        ("failed", "coverage", ""),
        ("not checked", "", "no file"),
        ("holds", "bias", ""),
        ("failed", "multipliers", ""),
        ("holds", "bias", ""),
    ]
    finding_output.print_replayed(
        [
            ReplayResult(FailureRecord("sleigh", {}, [], [], claim=x), one, why)
            for one, x, why in outcomes
        ]
    )
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "7 failures: 3 hold now, 2 fail, 1 inconclusive, 1 not checked"
    assert lines[1] == "inconclusive: failure 2, motion on sleigh: wide"
    assert [x for x in lines if x.startswith("code")] == ["code of coverage", "code of multipliers"]
    assert lines[4] == "not checked: failure 4, all claims on sleigh: no file"
    assert not [x for x in lines if "bias" in x]


# ---- Findings as a document ----------------------------------------------------------------------


def test_a_document_has_each_state_once_and_each_finding_with_the_number_of_its_state(tmp_path):
    first, second, third = at(SLEIGH, 1), at(SLEIGH, 2), at(CHAIN, 3)
    one = ValidationRun(
        [finding(first), finding(second, "failed"), finding(first, subject="el")], ends=[3]
    )
    two = ValidationRun(
        [finding(third, scene=CHAIN)], ends=[1], sampled=[SampledState(CHAIN, third, ())]
    )
    small = finding(at(CHAIN, 9), "failed", CHAIN)
    two.minimal = small
    selection = RunSelection.of(["el", "au"], ["casadi"], ["mass-matrix"], scenes=[SLEIGH])
    write_findings(tmp_path / "a.json", [one, two], selection)
    told = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))
    assert [case["t"] for case in told["cases"]] == [1.0, 2.0, 3.0]
    assert [case["scene"] for case in told["cases"]] == [repr(x) for x in (SLEIGH, SLEIGH, CHAIN)]
    heads = "case", "subject", "verdict", "observed", "allowed"
    assert [tuple(row[x] for x in heads) for row in told["findings"]] == [
        (0, "casadi", "passed", 0.5, 1.0),
        (1, "casadi", "failed", 0.5, 1.0),
        (0, "el", "passed", 0.5, 1.0),
        (2, "casadi", "passed", 0.5, 1.0),
    ]
    assert (told["minimal"], [*told["factors"]]) == (small.as_python(), ["four-bar-chain"])
    assert told["engines"] == [version_of(CasadiEngine)]
    assert sorted(told["formulations"]) == ["au", "el"] and told["eomcheck"] == __version__
    assert [*told["claims"]] == ["mass-matrix"]


# ---- One scene -----------------------------------------------------------------------------------


def test_constraints_are_told_with_their_distance_from_the_others_and_its_rounding(
    monkeypatch, capsys
):
    sheets = shown(monkeypatch, motion_tables)
    assert motion_tables.print_constraints(Bricard(angle=1.0, redundant=1.0)) == 1
    rows = [tuple(row.values()) for row in table(sheets[0])]
    assert [row[0] for row in rows] == ["tip along y", "hinge along y", "tip along z",
                                        "tip along x", "hinge along z"]  # fmt: skip
    assert [row[1] for row in rows] == ["kept"] * 4 + ["redundant"]
    away, rounding = ([float(row[i]) for row in rows] for i in (2, 3))
    assert away[:4] == pytest.approx([1.0, 0.58, 0.73, 1.0]) and away[4] < 1e-14
    assert all(0 < x < 1e-12 for x in rounding)
    assert list(sheets[0].columns) == ["constraint", "status", "distance", "rounding error ≤"]
    assert capsys.readouterr().out.strip().endswith("n = 5, r = 5, rank 4")


def test_a_state_is_told_with_units_and_how_many_coordinates_are_left_out(monkeypatch, capsys):
    shown(monkeypatch, motion_tables)
    scene = Snake.coil(13)
    q, v = scene.initial_state()
    v = np.arange(1.0, 16.0)
    said = motion_tables._state(scene, q, v)
    places, rates = said.split(" Their rates: ")
    assert places.startswith("At t = 0 s: x = ") and places.endswith(" rad and 3 more.")
    assert places.count(",") == rates.count(",") == 11
    assert rates.startswith("x: 1 m/s, y: 2 m/s, ") and rates.endswith(": 12 rad/s and 3 more.")
    assert motion_tables._state(SLEIGH, np.array([0.5, 2.0, 3.0]), np.zeros(3)).startswith(
        "At t = 0 s, at rest: x = 0.5 m, y = 2 m, "
    )


# ---- Comparison of libraries ---------------------------------------------------------------------


def compared() -> LibraryComparison:
    """Return a comparison in which everything is different from everything else."""
    one, two = LibraryResult("one", "One 1.0"), LibraryResult("two", "Two 2.0")
    libraries = {"one": one, "two": two, "three": LibraryResult("three", refusal="cannot")}
    found = LibraryComparison(SLEIGH, libraries, states=5)
    found.running = running_differences(
        {"M": np.array([[0.0, 1e-3, np.nan], [1e-3, 0.0, 4e-7], [np.nan, 4e-7, 0.0]])}
    )
    state = at(SLEIGH, 1)
    one.findings = {
        "mass-matrix": finding(state, "failed", detail="row x is 2 times"),
        "bias": finding(state, "failed", claim="bias", detail="row y has a sign"),
    }
    two.findings = {"bias": finding(state, claim="bias")}
    one.explanations = [Explanation("leaves out the damping"), Explanation("has an armature")]
    one.messages, two.messages = [f"line {k}" for k in range(7)], ["only this"]
    one.decided = True
    found.skipped = ["singular", "singular", "at rest"]
    one.inconclusive_counts = Counter({"acceleration": 4})
    two.inconclusive_counts = Counter({"acceleration": 4})
    two.unresolved = {"bias": [Unresolved("two", "row x", finding(state, claim="bias"), 5)]}
    return found


def test_what_is_said_of_libraries_has_every_reason_count_and_name():
    found = compared()
    assert library_comparison.comparison_headline(found) == "1 of 2 libraries differs: one"
    assert list(library_comparison.differences_in_words(found)) == [
        "One 1.0 differs: row x is 2 times; row y has a sign. Why: leaves out the damping; has an "
        "armature.",
        "    Its message: line 0 / line 1 / line 2 / line 3 (and 3 lines more)",
        library_comparison.NOBODY,
    ]
    assert list(library_comparison.limits_in_words(found)) == [
        "Two 2.0: bias is not resolved in any of 5 states: two, row x",
        "q̈ of one, two: inconclusive in 4 of 5 states, rounding explains any difference there",
        "q̈ is not compared in 3 of 5 states: singular",
        "three gave no answer: cannot",
    ]
    state = at(SLEIGH, 2)
    found.self_failures = [
        finding(state, "failed", observed=2.0, detail="little"),
        finding(state, "failed", observed=9.0, detail="most"),
        finding(state, "failed", observed=4.0, detail="more"),
    ]
    del found.libraries["one"].messages[4:]
    said = list(library_comparison.differences_in_words(found))
    assert said[1].endswith("line 3")
    assert said[2] == "The two derivations of eomcheck differ from each other: most"


def test_the_verdict_on_libraries_groups_those_that_differ_by_reason(capsys):
    found = compared()
    for key in "abc":
        found.libraries[key] = LibraryResult(key, key.upper(), faults={"M": "raises"})
    found.libraries["c"].explanations = found.libraries["b"].explanations = [
        Explanation("leaves out the damping", "no damping")
    ]
    assert (
        library_comparison.comparison_headline(found)
        == "4 of 5 libraries differ: one, a; b, c (no damping)"
    )
    del found.libraries["one"], found.libraries["a"]
    assert (
        library_comparison.comparison_headline(found)
        == "2 of 3 libraries differ: b, c (no damping)"
    )
    found.running = running_differences({"M": np.zeros((4, 4))})
    library_comparison.print_comparison(found)
    assert capsys.readouterr().out.splitlines()[0] == library_comparison.comparison_headline(found)
    only_ours = LibraryComparison(SLEIGH, {"a": LibraryResult("a", "A", decided=True)}, states=1)
    only_ours.self_failures = [finding(at(SLEIGH, 2), "failed", detail="ours")]
    assert library_comparison.comparison_headline(only_ours) == (
        "the two derivations of eomcheck differ from each other"
    )


@pytest.mark.parametrize("wide", [False, True])
def test_quantities_on_which_all_agree_have_rows_only_when_asked(capsys, wide):
    key, other, undecided = list(library_comparison.CONFORMANCE)[:3]
    state = at(SLEIGH, 1)
    one = LibraryResult("one", "One 1.0", decided=True)
    one.findings = {key: finding(state, claim=key), other: finding(state, claim=other)}
    one.findings[undecided] = finding(state, "inconclusive", claim=undecided)
    two = LibraryResult("two", "Two 2.0", decided=True)
    two.findings = {key: finding(state, "failed", claim=key)}
    found = LibraryComparison(SLEIGH, {"one": one, "two": two}, states=1)
    found.running = running_differences({"M": np.zeros((3, 3))})
    library_comparison.print_comparison(found, wide=wide)
    printed = capsys.readouterr().out
    assert "2 of 3" in printed and "0 of 1" in printed
    assert CLAIMS[key].asks in printed and CLAIMS[undecided].asks in printed
    assert (CLAIMS[other].asks in printed) == wide


def test_a_comparison_is_written_with_all_that_was_found(tmp_path):
    found = compared()
    found.libraries["two"].faults = {"M": "raises"}
    found.self_failures = [finding(at(SLEIGH, 2), "failed", detail="ours")]
    library_comparison.write_comparison(found, tmp_path / "a.json")
    told = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))
    assert told["findings"] == json.loads(
        json.dumps([x.as_dict() for one in found.answered for x in one.findings.values()])
    )
    assert [one["detail"] for one in told["own"]] == ["ours"]
    del told["findings"], told["own"]
    assert told == {
        "scene": SLEIGH.name,
        "coordinates": list(SLEIGH.coordinate_names),
        "states": 5,
        "versions": {"one": "One 1.0", "two": "Two 2.0"},
        "refused": {"three": "cannot"},
        "libraries": ["eomcheck", "one", "two"],
        "apart": {"M": [[0.0, 1e-3, None], [1e-3, 0.0, 4e-7], [None, 4e-7, 0.0]]},
        "decided": {"one": True, "two": False},
        "faults": [["two", "M", "raises"]],
        "why": {"one": ["leaves out the damping", "has an armature"], "two": []},
        "said": {"one": [f"line {k}" for k in range(7)], "two": ["only this"]},
        "hidden": [["two", "bias", "not resolved in any of 5 states: two, row x"]],
        "skipped": found.skipped,
    }


# ---- Registries ----------------------------------------------------------------------------------


def test_the_table_of_formulations_is_that_of_the_paper():
    rows = {str(row[0]): tuple(map(str, row[2:-1])) for row in registries._formulations().rows}
    assert rows == {
        "im": ("(6)-(7)", "2n + r", "acceleration level", "yes", "yes"),
        "au": ("(8)-(9)", "n + r", "acceleration level", "yes", "yes"),
        "el": ("(10)-(11)", "n", "acceleration level", "no", "no"),
        "gw": ("(12)-(13)", "n", "acceleration level", "no", "yes"),
        "em": ("(14)-(18)", "n - r", "velocity level", "no", "no"),
        "ml": ("(19)-(21)", "n - r", "velocity level", "no", "no"),
        "kane": ("(22)-(23)", "n - r", "velocity level", "no", "no"),
        "banded": ("not there", "2s + r - n", "acceleration level", "not there", "yes"),
        "uk": ("not there", "n + r", "acceleration level", "not there", "yes"),
    }


def test_the_table_of_scenes_tells_terms_speeds_what_applies_and_what_is_conserved(monkeypatch):
    names = "chain-pendulum", "turntable-ball", "four-bar-chain", "snake"
    monkeypatch.setattr("eomcheck.scenes.SCENES", {name: SCENES[name] for name in names})
    engines = {"shy": SimpleNamespace(represents=lambda scene: scene.key == "snake"), "all": ALL}
    monkeypatch.setattr("eomcheck.engines.ENGINES", engines)
    rows = {row["key"]: tuple(row.values())[2:] for row in table(registries.registered_scenes())}
    motion = "rotation, translation, mirror"
    assert rows == {
        "chain-pendulum": ("M, Q, B", "the velocities", "all but banded", "all", "energy"),
        "turntable-ball": (
            *("M, B, a, gamma, b, offset", "natural", "all but banded", "all"),
            "no energy: the table is driven, rotation, mirror",
        ),
        "four-bar-chain": (
            *("M, Q, B, a, gamma", "partition", "all but banded", "all", "energy, full turns"),
        ),
        "snake": ("M, Q, B, a, gamma", "natural", "all", "shy, all", f"energy, {motion}"),
    }


ALL = SimpleNamespace(represents=lambda scene: True)
