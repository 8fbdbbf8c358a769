"""Tables: every column, held against data that is made by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.reports import running_differences

from eomcheck.claims.finding import Finding, Proof
from eomcheck.claims.numerical_accuracy import SampledState
from eomcheck.claims.run import RunSelection, ValidationRun
from eomcheck.draws.fuzz_cases import StructuralVariant
from eomcheck.engines.casadi import CasadiEngine
from eomcheck.errors import InputError
from eomcheck.lab import library_comparison
from eomcheck.lab.discrepancy import Explanation
from eomcheck.lab.fuzzing.campaign import Campaign, ScoredCase
from eomcheck.lab.fuzzing.failures import FailureRecord
from eomcheck.lab.fuzzing.motion_rounds import CROSSED, STOPPED
from eomcheck.lab.fuzzing.screening import DECIDED, OPEN
from eomcheck.lab.fuzzing.state_rounds import FunctionsPlan
from eomcheck.lab.library_comparison import LibraryComparison, LibraryResult
from eomcheck.lab.report import finding_output, motion_tables
from eomcheck.lab.report.motion_tables import units
from eomcheck.lab.report.overview import (
    ClaimSummary,
    Overview,
    by_claim,
    digits_table,
    evidence_table,
    factor_table,
    participant_table,
    scene_table,
    worst_table,
)
from eomcheck.lab.report.report_formats import write_junit, write_page
from eomcheck.lab.show.table import ResultTable
from eomcheck.lab.store.record_file import Record
from eomcheck.lab.store.validation_runs import PROOFS, RUNS, StoredFinding, findings_record
from eomcheck.mechanics.records import State
from eomcheck.motion.batch import Trajectories
from eomcheck.motion.simulate import Trajectory
from eomcheck.scenes import SCENES, FlyballGovernor, FourBarChain, Sleigh, Snake

SLEIGH = Sleigh.example()


def table(sheet: ResultTable | None) -> list[dict[str, str]]:
    """Return the rows of a table, by their headings."""
    assert sheet is not None
    return [dict(zip(sheet.columns, map(str, row), strict=True)) for row in sheet.rows]


def kept(claim: str = "bias", subject: str = "au ~ el", **change: Any) -> StoredFinding:
    """Return a Finding, passed at half of what is allowed on a snake unless told otherwise."""
    usual = StoredFinding(
        *(claim, subject, 0.5, 1.0, "passed", "property-tested: doubles", "", None, None),
        *("snake", 3, 7, "", "code"),
    )
    return replace(usual, **change)


def proof(sure: float, degree: int, height: float, **change: Any) -> StoredFinding:
    made = Proof(degree, height, (7, 11), 2, sure)
    usual = {"evidence": "proved: identity", "case": None, "structure": f"snake[{degree}]"}
    return kept(proof=made, **(usual | change))


FEW = [
    kept(observed=0.25, case=1),
    kept(subject="el ~ kane", observed=0.125, case=1),
    kept(subject="im ~ kane", observed=0.75, case=2),
    kept(subject="im ~ kane", verdict="inconclusive", observed=9.0, case=3),
    kept(subject="im", verdict="skipped", scene="sleigh", links=None, detail="why not"),
    kept("mass-matrix", "pinocchio", observed=0.0, scene="sleigh", links=None, case=4),
    kept("energy-rate", "el", verdict="failed", observed=3.0, detail="row 1", case=5),
    kept("energy-rate", "el", verdict="failed", observed=7.0, case=6, links=4),
]


# ---- Claims --------------------------------------------------------------------------------------


def test_the_table_of_what_is_worst_tells_how_bad_by_whom_where_and_of_how_many():
    rows = {row["claim"]: row for row in table(worst_table(by_claim(FEW)))}
    heads = "worst", "by", "on", "findings"
    assert {key: tuple(row[x] for x in heads) for key, row in rows.items()} == {
        "bias": ("75%", "im ~ kane", "snake[3] #2", "5, 1 inconclusive, 1 skipped"),
        "mass-matrix": ("0", "·", "·", "1"),
        "energy-rate": ("FAIL", "el", "snake[4] #6", "2"),
    }


def test_the_wide_table_has_a_column_for_each_party_and_one_for_each_scene():
    names = ("au", "im", "pinocchio")
    rows = table(participant_table(by_claim(FEW), names, {"bias": 1.25, "energy-rate": 0.5}))
    assert [tuple(row.values()) for row in rows if row["claim"] == "bias"] == [
        (
            *("bias", "75%", "25%", "75%", "·"),
            "property-tested, 5, 1 inconclusive, 1 skipped",
            "1.2 s",
        )
    ]
    (row,) = (row for row in rows if row["claim"] == "mass-matrix")
    assert (row["all"], row["au"], row["pinocchio"], row["time"]) == ("0", "·", "0", "0.0 s")
    assert "time" not in table(participant_table(by_claim(FEW), names))[0]
    rows = {row["claim"]: row for row in table(scene_table(by_claim(FEW), ["snake", "sleigh"]))}
    cells = {key: (row["snake"], row["sleigh"]) for key, row in rows.items()}
    assert cells == {
        "bias": ("75%", "?"),
        "mass-matrix": ("·", "0"),
        "energy-rate": ("FAIL", "·"),
    }
    assert rows["bias"]["statement"] and rows["bias"]["evidence"] == "property-tested"


@pytest.mark.parametrize(
    ("observed", "text"), [(0.0, "0"), (0.0099, "<1%"), (0.0101, "1%"), (0.996, "100%")]
)
def test_a_cell_is_the_share_of_what_is_allowed_in_whole_percent(observed: float, text: str):
    assert ClaimSummary((kept(observed=observed),)).text == text


def test_the_table_of_evidence_tells_levels_numbers_and_the_worst_place():
    some = [row for row in FEW if row.claim == "bias"]
    some += [proof(1e-20, 4, 30.0), proof(2e-20, 9, 20.0)]
    rows = table(evidence_table(ClaimSummary(tuple(some))))
    assert [(row["scene"], row["evidence"]) for row in rows] == [
        ("snake", "proved"),
        ("snake", "property-tested"),
        ("sleigh", "property-tested"),
    ]
    proved, tested, _ = rows
    assert (proved["states"], proved["findings"], proved["ratio"]) == ("all", "2", "")
    assert proved["where"] == "2 identities, wrong with a probability below 3.0e-20"
    assert (tested["N"], tested["states"], tested["findings"]) == ("3", "3", "4")
    assert (tested["inconclusive"], tested["ratio"]) == ("1", "75%")
    assert (tested["observed"], tested["allowed"]) == ("0.75", "1")
    assert tested["where"] == "im ~ kane, state 2"
    assert (tested["skipped"], rows[2]["skipped"]) == ("", "1")
    assert rows[2]["inconclusive"] == ""
    seen = table(evidence_table(ClaimSummary(tuple(some[:2]))))
    assert "skipped" not in seen[0]


def test_a_mistake_in_any_proof_is_as_likely_as_in_all_together(capsys):
    rows = [
        proof(1e-20, 4, 30.0),
        proof(3e-20, 9, 20.0),
        kept(verdict="skipped", case=None, structure="snake[2]", detail="no"),
        kept("mass-matrix", verdict="failed", case=None, structure="snake[2]"),
    ]
    assert ClaimSummary(tuple(rows)).failure_probability == pytest.approx(4e-20)
    bias, other = table(finding_output.proof_table(by_claim(rows)))[::-1]
    counts = "proved", "disproved", "skipped"
    if bias["claim"] != "bias":
        bias, other = other, bias
    assert [bias[x] for x in counts] == ["2", "", "1"]
    assert [other[x] for x in counts] == ["", "1", ""]
    assert (bias["degree ≤"], bias["height ≤"]) == ("9", "30 bits")
    assert (bias["failure probability <"], other["failure probability <"]) == ("3.0e-20", "")
    jobs = SimpleNamespace(scenes=[1, 2, 3], points=4)
    of: Any = SimpleNamespace(
        findings={"a": rows[:2], "b": rows[2:]}, jobs=jobs, started_over=False, taken_over=1, seed=5
    )
    finding_output.print_proofs(of)
    said = " ".join(capsys.readouterr().out.split())
    assert "2 identities proved, 1 disproved on 2 of 3 structures (1 of them in an earlier" in said
    assert "below 4.0e-20 (4 random points and primes each). seed 5 2 identities" in said
    assert said.endswith("1 disproved on 2 of 3 structures (1 of them in an earlier run)")


def test_digits_are_the_fewest_and_the_median_of_each_formulation_and_scene():
    rows = [kept(subject="au", digits=x) for x in (12.0, 9.0, 13.0)]
    rows += [kept(subject="au", digits=8.0, scene="sleigh"), kept(subject="im", digits=15.0)]
    assert [tuple(row.values()) for row in table(digits_table([*rows, kept()]))] == [
        ("im", "1", "15.0 (15.0)", "·"),
        ("au", "4", "9.0 (12.0)", "8.0 (8.0)"),
    ]


def test_strata_are_told_with_their_states():
    found = table(factor_table({"snake": {"speeds": {"slow": 1, "fast": 30}}}))
    assert found == [{"scene": "snake", "factor": "speeds", "states": "slow (1 state), fast (30)"}]


def test_the_totals_of_scenes_are_those_of_their_runs():
    verdicts = ["passed", "inconclusive", "skipped", "skipped", "failed"]
    one: Any = SimpleNamespace(
        cases=7,
        findings=[SimpleNamespace(verdict=x) for x in verdicts],
        sampled=[SimpleNamespace(refused=x) for x in ((), ("im",), ("im", "em"))],
        seconds={"bias": 1.5, "motion": 2.0},
    )
    heads, rows = finding_output._totals({"sleigh": one})
    assert dict(zip(heads, *rows, strict=True)) == {
        **{"scene": "sleigh", "states": "7", "findings": "5", "inconclusive": "1"},
        **{"skipped": "2", "refused": "2", "time": "4 s"},
    }


def test_of_failures_the_worst_is_printed_and_the_others_are_counted(capsys):
    rows = [
        kept(verdict="failed", observed=2.0, subject="au", case=1),
        kept(verdict="failed", observed=9.0, subject="el", case=2),
        kept(verdict="failed", observed=3.0, subject="im", case=3),
        kept(verdict="failed", observed=4.0, subject="im", case=3, scene="sleigh", links=None),
    ]
    finding_output.print_failures(by_claim(rows))
    first, second = " ".join(capsys.readouterr().out.split()).split("FAIL bias ")[1:]
    assert first.startswith("(el) on snake, N = 3, state 2 ")
    assert first.endswith("and 2 further subjects of this claim ") and "further" not in second
    assert second.startswith("(im) on sleigh, state 3 ")


@pytest.mark.parametrize("inconclusive", [0, 1])
@pytest.mark.parametrize("unseen", [0, 2])
def test_the_verdict_counts_as_passed_only_claims_that_passed(
    capsys, inconclusive: int, unseen: int
):
    of = "au ~ el", SLEIGH, State(*SLEIGH.initial_state(), 0.0), 0.5, 1.0
    verdicts: list[Any] = ["passed"] * 3 + ["inconclusive"] * inconclusive
    verdicts += ["skipped"] * unseen
    some = [Finding(f"claim {i}", *of, x, "compared") for i, x in enumerate(verdicts)]
    selection = RunSelection.of(engines=[], claims=["bias"], scenes=[SLEIGH])
    finding_output.print_runs({"sleigh": ValidationRun(findings=some, ends=[len(some)])}, selection)
    first, verdict, *_ = capsys.readouterr().out.splitlines()
    assert first.endswith(f", {len(some)} findings")
    largest = "largest error 50 % of what rounding allows (claim 0 [au ~ el])"
    undecided = f", {len(some) - 3} undecided" if some[3:] else ""
    assert verdict == f"3 of {len(some)} claims passed{undecided}; {largest}"


def test_of_a_scene_of_which_an_engine_represents_nothing_that_is_said(capsys):
    class Shy(CasadiEngine):
        key = "shy"

        @classmethod
        def represents(cls, scene):
            return isinstance(scene, Sleigh)

    state = State(*SLEIGH.initial_state(), 0.0)
    empty = ValidationRun(
        sampled=[SampledState(FourBarChain.example(), state, ())] * 2, ends=[0, 0, 0]
    )
    skipped = ValidationRun(sampled=[SampledState(SLEIGH, state, ())], ends=[0])
    found = Finding("bias", "au ~ shy", SLEIGH, state, 0.5, 1.0, "passed", "compared")
    asked = ValidationRun(findings=[found], ends=[1], sampled=empty.sampled)
    runs = {"four-bar-chain": empty, "sleigh": skipped, "snake": asked}

    def said(**how: Any) -> list[str]:
        finding_output.print_runs(runs, RunSelection.of(scenes=[SLEIGH], **how))
        lines = capsys.readouterr().out.splitlines()
        return [one for one in lines if "represents none" in one]

    line = "skipped: four-bar-chain, 3 states: shy represents none of them"
    assert said(engines=[Shy], claims=["bias"]) == [line]
    assert said(engines=[Shy], claims=["kinetic-energy"]) == []
    assert said(engines=None, claims=["bias"]) == []


# ---- The verdict of a report ---------------------------------------------------------------------


def run_of(scene: str, status: str, *rows: StoredFinding) -> Record:
    """Return the Record of a validation."""
    series = {"engines": [], "engine versions": [], "claims": [], "seconds": []}
    return Record(RUNS, {"scene": scene}, status, series=series, counts={"states": 4})


def test_a_report_is_about_the_claims_that_are_named():
    stored = findings_record([kept(), kept("forces-of-old"), kept("mass-matrix")])
    only = Overview([stored], claims=["bias", "momentum-rates"])
    assert ([x.claim for x in only.rows], only.headline) == (["bias"], "All 1 claim hold.")
    assert [x.claim for x in Overview([stored], claims=["forces-of-old"]).rows] == ["forces-of-old"]
    with pytest.raises(InputError, match="did you mean 'bias'"):
        Overview([stored], claims=["bia"])
    with pytest.raises(InputError, match="no finding about any of equivalence, momentum-rates"):
        Overview([stored], claims=["equivalence", "momentum-rates"])


def test_a_page_tells_inconclusive_findings_from_those_not_looked_at(tmp_path: Path):
    made = Overview([run_of("snake", "done")])
    made.rows = [kept(), *[kept(verdict="inconclusive")] * 2, kept(verdict="skipped")]
    write_page(made, tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "<li>property-tested: 4 findings at 1 states, 2 inconclusive, 1 skipped</li>" in page
    assert '<h1 class="verdict passed">All 1 claim hold' in page
    assert '<a href="#claims">Claims</a>' in page and 'href="#failures"' not in page
    made, rows = Overview([run_of("snake", "done")]), made.rows
    made.rows = [*rows, kept("motion", verdict="skipped")]
    write_page(made, tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert '<h1 class="verdict partly">1 of 2 claims hold; on the others' in page


def test_states_are_counted_scene_by_scene_and_proofs_are_none():
    rows = [kept(), kept(), kept(case=8), kept(scene="sleigh"), proof(1e-20, 4, 30.0)]
    assert ClaimSummary(tuple(rows)).states == 3


@pytest.mark.parametrize("statuses", [("done", "failed"), ("failed", "done")])
def test_one_run_that_did_not_end_is_no_passed_report(statuses):
    made = Overview([run_of(x, y) for x, y in zip(("sleigh", "snake"), statuses, strict=True)])
    made.rows = [kept()]
    assert made.verdict == "not finished"
    assert made.headline == "The run did not come to its end; until then none of 1 claim failed."
    made = Overview([run_of("sleigh", "done"), run_of("snake", "done")])
    made.rows = [kept(), kept(verdict="inconclusive")]
    assert (made.verdict, made.undecided, made.states) == ("passed", "1 inconclusive", 8)
    assert made.headline == "All 1 claim hold."
    assert made.basis == "2 findings, 8 states, on snake; 1 inconclusive."
    made.rows.append(kept(verdict="skipped"))
    assert made.basis == "3 findings, 8 states, on snake; 1 inconclusive, 1 skipped."
    made.rows = [kept()]
    assert made.basis == "1 finding, 8 states, on snake."


def test_a_report_fails_by_one_failure_and_says_how_many_claims_were_checked():
    made = Overview([run_of("snake", "done")])
    made.records.append(Record(PROOFS, {"scene": "snake"}))
    made.rows = [*FEW, kept("motion", verdict="inconclusive")]
    assert (made.verdict, made.structures) == ("failed", 1)
    assert made.headline == "1 of 4 claims fails: energy-rate; 1 undecided."
    made = Overview([run_of("snake", "done")])
    made.rows = [kept(), kept("motion", verdict="inconclusive")]
    assert made.headline == "1 of 2 claims hold; on the others nothing could be checked."
    made = Overview([run_of("snake", "done")])
    made.rows = [kept(verdict="inconclusive")]
    assert (made.verdict, made.headline) == ("nothing checked", "No claim was checked.")


HIDDEN = kept(verdict="inconclusive", detail="not resolved in any of 4 states: au, row x")


def test_a_report_names_claims_of_which_no_state_resolves_an_entry():
    made = Overview([run_of("snake", "done")])
    made.rows = [kept(), HIDDEN, kept("motion")]
    assert made.verdict == "passed"
    said = "All 2 claims hold where resolved; entries of bias are resolved in no state."
    assert made.headline == said
    for other in (replace(HIDDEN, detail="of one state"), replace(HIDDEN, verdict="passed")):
        made = Overview([run_of("snake", "done")])
        made.rows = [kept(), other, kept("motion")]
        assert made.headline == "All 2 claims hold."


def test_a_claim_that_is_inconclusive_in_some_states_is_named_in_one_line(capsys):
    open_rows = [kept(verdict="inconclusive", case=k, subject=x) for k in (3, 7) for x in "ab"]
    finding_output.print_unresolved(by_claim([kept(), *open_rows, kept("motion")]))
    said = " ".join(capsys.readouterr().out.split())
    why = "the rounding error is as large as the value"
    assert said == f"inconclusive: bias [a, b] at 2 states: {why}"


def test_entries_that_no_state_resolves_are_printed_and_in_junit(tmp_path, capsys):
    rows = [kept(), HIDDEN, kept("motion")]
    finding_output.print_unresolved(by_claim(rows))
    said = "inconclusive: bias on snake: not resolved in any of 4 states: au, row x"
    assert " ".join(capsys.readouterr().out.split()) == said
    made = Overview([run_of("snake", "done")])
    made.rows = rows
    write_junit(made, tmp_path / "r.xml")
    text = (tmp_path / "r.xml").read_text(encoding="utf-8")
    assert text.count(HIDDEN.detail) == 1


# ---- Fuzzing -------------------------------------------------------------------------------------


@pytest.fixture
def campaign() -> Campaign:
    """A campaign of which everything is told by hand."""
    plan: Any = SimpleNamespace(noun="motion", seed=5)
    made = Campaign(plan, "snake", [StructuralVariant(1, ()), StructuralVariant(2, ())])
    made.counts.update({"states": 240, "ordinary": 200, "climbed": 40, "passed": 99, "nought": 0})
    made.counts.update({CROSSED + "im": 3, STOPPED + "im": 5, STOPPED + "kane": 2})
    made.by_variant.update(
        {stratum.name: x for stratum, x in zip(made.variants, (11, 22), strict=True)}
    )
    made.worst = {
        ("bias", "el"): ScoredCase(0.75, None),  # type: ignore[arg-type]
        ("bias", "au"): ScoredCase(0.5, None),  # type: ignore[arg-type]
        ("motion", ""): ScoredCase(0.25, None),  # type: ignore[arg-type]
    }
    made.counts.update({OPEN + "motion": 4, OPEN + "bias": 2, DECIDED + "bias": 1})
    made.counts.update({OPEN + "drift": 0})
    made.not_batched = {"energy-rate": "branches"}
    made.rounds, made.cpu_seconds, made.seconds = 6, 12.0, 48.0
    find = FailureRecord(
        "snake", {}, [], [], 0.0, "bias", "au ~ el", 2.0, 1.0, "scene", "known by", "row"
    )
    made.failure_records = {find.key: find}
    return made


def test_the_tables_of_a_campaign_hold_its_counts(campaign: Campaign):
    sheet = finding_output.campaign_table(campaign)
    assert sheet.title == "Fuzzing snake, seed 5"
    assert {row["what"]: row["how many"] for row in table(sheet)} == {
        **{"motions": "240", "a second of CPU time": "20", "rounds": "6", "ordinary": "200"},
        **{"climbed": "40", "passed": "99", "not in lanes: energy-rate": "branches"},
        "motion: decided in no state": "4 inconclusive",
    }
    assert table(finding_output.variant_table(campaign)) == [
        {"structure": "1 link", "motions": "11"},
        {"structure": "2 links", "motions": "22"},
    ]
    campaign.by_variant.clear()
    empty = [{"structure": "2 structures", "motions": "none"}]
    assert table(finding_output.variant_table(campaign)) == empty
    campaign.by_variant["2 links"] = 22
    assert table(finding_output.variant_table(campaign)) == [
        {"structure": "2 links", "motions": "22"},
        {"structure": "1 more", "motions": "none"},
    ]
    assert table(finding_output.crossing_table(campaign)) == [
        {"formulation": "im", "crossed": "3", "stopped before, or refused": "5"},
        {"formulation": "kane", "crossed": "0", "stopped before, or refused": "2"},
    ]
    assert table(finding_output.highest_score_table(campaign)) == [
        {"claim": "bias", "ratio": "0.75", "formulation": "el"},
        {"claim": "motion", "ratio": "0.25", "formulation": ""},
    ]
    assert table(finding_output.failure_table(campaign)) == [
        {
            **{"claim": "bias", "subject": "au ~ el", "fault": "scene"},
            **{"what": "row", "evidence": "known by"},
        }
    ]


def test_a_campaign_without_a_state_says_that_nothing_was_checked(monkeypatch, capsys):
    plan = FunctionsPlan("mine.py:own", 5, ("motion",))
    caveats: list[Any] = []
    monkeypatch.setattr(FunctionsPlan, "caveats", lambda *given: caveats.append(given) or ["bare"])
    empty = Campaign(plan, "own", [StructuralVariant(None, ())])
    finding_output.print_campaign(empty)
    said = capsys.readouterr().out
    assert "nothing was checked: no state came to its end" in said and "no failure" not in said
    assert not caveats and "Observed / allowed" not in said
    empty.counts["states"] = 1
    finding_output.print_campaign(empty)
    said = capsys.readouterr().out
    assert "no failure\nbare\n" in said and len(caveats) == 1 and "Observed / allowed" not in said
    empty.worst = {("motion", ""): ScoredCase(0.25, None)}  # type: ignore[arg-type]
    finding_output.print_campaign(empty)
    assert "Observed / allowed at most" in capsys.readouterr().out


def test_a_campaign_prints_its_finds_or_that_there_are_none(
    campaign: Campaign, monkeypatch, capsys
):
    monkeypatch.setattr(FailureRecord, "python", property(lambda find: "the code"))
    finding_output.print_campaign(campaign)
    said = capsys.readouterr().out
    assert "the code" in said and "no failure" not in said
    campaign.failure_records = {}
    finding_output.print_campaign(campaign)
    assert "no failure" in capsys.readouterr().out


def test_a_line_of_progress_counts_the_states_of_this_run_by_the_second(
    campaign: Campaign, monkeypatch, capsys
):
    clock = iter([100.0, 104.0, 110.0, 112.0])
    monkeypatch.setattr("eomcheck.lab.report.finding_output.time.perf_counter", lambda: next(clock))
    campaign.resumed = 40
    teller = finding_output.ProgressPrinter()
    teller(campaign)
    assert capsys.readouterr() == ("", "")
    teller(campaign)
    said = " ".join("".join(capsys.readouterr()).split())
    assert said == "240 motions, 20 a second; worst 0.75, bias el; 1 failure"
    teller(campaign)
    assert capsys.readouterr() == ("", "")


# ---- Comparison of libraries ---------------------------------------------------------------------


def test_a_comparison_shows_the_difference_from_us_and_the_pairs_each_other():
    libraries = (
        LibraryResult("one", "One 1.0", decided=True),
        LibraryResult("two", "Two 2.0", decided=True, faults={"bias": "raises"}),
        LibraryResult("three", refusal="cannot"),
        LibraryResult("four", refusal="not there", missing=True),
    )
    made = LibraryComparison(SLEIGH, {one.library: one for one in libraries}, states=6)
    nothing = np.nan
    made.running = running_differences(
        {
            "M": np.array([[0.0, 1e-3, 2e-5], [1e-3, 0.0, 4e-7], [2e-5, 4e-7, 0.0]]),
            "bias": np.array(
                [[0.0, 0.0, nothing], [0.0, 0.0, nothing], [nothing, nothing, nothing]]
            ),
        }
    )
    sheet = library_comparison.library_table(made)
    assert sheet.title == f"{SLEIGH.name}: {SLEIGH.n} coordinates, 6 states"
    assert table(sheet) == [
        {"library": "One 1.0", "M": "1e-03", "bias": "0", "verdict": "agrees"},
        {"library": "Two 2.0", "M": "2e-05", "bias": "fault", "verdict": "differs"},
        {"library": "three", "M": "-", "bias": "-", "verdict": "no answer"},
        {"library": "four", "M": "-", "bias": "-", "verdict": "not installed"},
    ]
    masses, _ = library_comparison.pair_tables(made)
    assert [tuple(row.values()) for row in table(masses)] == [
        ("eomcheck", "", "1e-03", "2e-05"),
        ("one", "1e-03", "", "4e-07"),
        ("two", "2e-05", "4e-07", ""),
    ]
    assert list(library_comparison.differences_in_words(made)) == [
        "Two 2.0 differs: where it answers, it agrees. Why: no reason known.",
    ]
    assert library_comparison.comparison_headline(made) == "1 of 2 libraries differs: two"
    assert list(library_comparison.limits_in_words(made)) == [
        "three gave no answer: cannot",
        "four was left out: not there",
    ]
    assert (made.agree, made.unanswered) == (False, ["three"])
    known, unknown = (
        Explanation("leaves out the damping", "no damping"),
        Explanation("something else"),
    )
    for whys, word in (
        ([known], "no damping"),
        ([known, known._replace(label="fewer digits")], "no damping, fewer digits"),
        ([known, unknown], "differs"),
        ([unknown, known], "differs"),
    ):
        made.libraries["two"].explanations = whys
        assert made.libraries["two"].verdict == word
    made.libraries["two"].faults = {}
    assert made.agree


@pytest.mark.parametrize(
    ("decided", "skipped", "verdicts", "said"),
    [
        (
            {"one": True, "two": True},
            1,
            ["agrees", "agrees"],
            "all that answered agree to rounding",
        ),
        (
            {"one": True, "two": False},
            2,
            ["agrees", "inconclusive"],
            "all others agree to rounding, two undecided, without q̈",
        ),
        (
            {"two": True},
            0,
            ["nothing compared", "agrees"],
            "all others agree to rounding, one undecided",
        ),
        ({"one": False}, 0, ["inconclusive", "nothing compared"], ""),
    ],
)
def test_libraries_about_which_nothing_is_decided_are_not_said_to_agree(
    capsys, decided, skipped, verdicts, said
):
    made = LibraryComparison(
        SLEIGH,
        {key: LibraryResult(key, f"{key} 1", decided=decided.get(key)) for key in ("one", "two")},
        states=2,
    )
    made.skipped = ["singular"] * skipped
    sheet = library_comparison.library_table(made)
    assert [str(row[-1]) for row in sheet.rows] == verdicts
    looks = ["passed" if word == "agrees" else "open" for word in verdicts]
    assert [getattr(row[-1], "kind", "") for row in sheet.rows] == looks
    library_comparison.print_comparison(made)
    printed = capsys.readouterr().out
    assert printed.splitlines()[0] == said if said else "agree to" not in printed
    assert made.undecided_libraries == [key for key in made.libraries if not decided.get(key)]


# ---- Motions -------------------------------------------------------------------------------------


def shown(monkeypatch, module: Any) -> list[ResultTable]:
    """Return a list to which the tables that a module prints are added."""
    sheets: list[ResultTable] = []
    monkeypatch.setattr(module, "print_tables", sheets.extend)
    return sheets


def trajectory(**change: Any) -> Trajectory:
    """Return a motion of a sleigh, told by hand."""
    zeros = np.zeros((3, SLEIGH.n))
    usual = Trajectory(
        *(SLEIGH, "kane", "RK45", 1e-6, 1e-6, np.array([0.0, 1.0, 2.0]), zeros, zeros, None),
        *(np.array([5.0, 5.5, 4.75]), np.array([[1e-3], [4e-3], [2e-3]]), 77, 9, "finished", ""),
        1.25,
    )
    return replace(usual, **change)


def test_a_line_tells_end_effort_and_the_largest_errors_of_a_motion(monkeypatch, capsys):
    sheets = shown(monkeypatch, motion_tables)
    short = trajectory(key="em", times=np.array([]), energy=np.array([]), status="failed")
    short = replace(short, reason="singular", constraint_residual=np.zeros((0, 1)), steps=0)
    motion_tables.print_trajectories([trajectory(), short])
    first, second = table(sheets[0])
    assert first == {
        **{"formulation": "kane", "end (s)": "2", "steps": "9", "right-hand sides": "77"},
        **{"run time (s)": "1.2", "energy error": "5.0e-01 J", "constraint error (m/s)": "4.0e-03"},
    }
    assert (second["end (s)"], second["energy error"]) == ("0", "")
    assert second["constraint error (m/s)"] == ""
    assert capsys.readouterr().out.strip() == "em failed: singular"
    scene = FlyballGovernor.example()
    zeros = np.zeros((3, scene.n))
    damped = trajectory(scene=scene, q=zeros, v=zeros, constraint_residual=None)
    motion_tables.print_trajectories([damped])
    assert table(sheets[1])[0]["energy left"] == "4.75 J of 5 J"


def test_of_an_acceleration_the_matrix_with_the_smallest_rcond_is_named(monkeypatch):
    sheets = shown(monkeypatch, motion_tables)
    scene = SCENES["four-bar-chain"].example()
    motion_tables.print_accelerations(scene, keys=["el", "gw", "em"])
    heads = "formulation", "matrix", "smallest rcond"
    assert [tuple(row[x] for x in heads) for row in table(sheets[0])] == [
        ("el", "M_El", "0.13"),
        ("gw", "a M^-1 aT", "0.25"),
        ("em", "a_1", "0.67"),
    ]


def test_many_motions_are_told_by_their_quantiles_and_those_that_failed_are_not_in_them(
    monkeypatch, capsys
):
    sheets = shown(monkeypatch, motion_tables)
    m, times = 6, np.array([0.0, 2.0, 3.0])
    q = np.zeros((m, 3, 3))
    q[:, 2] = np.arange(m)[:, None] + np.array([0.0, 10.0, 20.0])
    q[5] = np.nan
    energy = np.ones((m, 3)) * 2.0
    energy[:, 1] += np.array([0.1, -0.2, 0.3, -0.4, 0.5, np.nan])
    energy[:, 2] += np.array([-0.05, 0.1, -0.15, 0.1, 0.25, np.nan])
    residual = np.zeros((m, 3, 1))
    residual[:5, 0, 0] = [1e-3, 2e-3, 3e-3, 4e-3, 5e-3]
    status = np.array(["finished"] * 5 + ["failed"])
    reason = np.array([""] * 5 + ["too many steps"])
    one = np.ones(m, int)
    made = Trajectories(
        *((SLEIGH,) * m, "kane", 1e-6, 1e-6, times, q, q, np.zeros((m, 3, 2)), energy, residual),
        *(one, one, status, reason, 1.5),
    )
    motion_tables.print_many(made)
    (sheet,) = sheets
    assert sheet.title == "kane, t = 3 s"
    assert sheet.note == "6 motions: 5 finished, 1 failed; 1.5 s of integration"
    rows = [tuple(row.values()) for row in table(sheet)]
    assert rows[:3] == [
        ("x / m", "0", "1", "2", "3", "4"),
        ("y / m", "10", "11", "12", "13", "14"),
        (rows[2][0], "20", "21", "22", "23", "24"),
    ]
    assert rows[2][0].endswith(" / rad")
    told = {name: cells for name, *cells in rows[3:]}
    assert told == {
        "energy error / J": ["1.00e-01", "2.00e-01", "3.00e-01", "4.00e-01", "5.00e-01"],
        "constraint error / (m/s)": ["1.00e-03", "2.00e-03", "3.00e-03", "4.00e-03", "5.00e-03"],
    }
    assert capsys.readouterr().out.strip() == "motion 5 failed: too many steps"
    chart = motion_tables.chart_of_many(made)
    assert [*chart.panels] == [(name,) for name in SLEIGH.coordinate_names]
    panel: Any = next(iter(chart.panels.values()))
    whole, half = panel.bands
    assert (whole.low[-1], whole.high[-1], half.low[-1], half.high[-1]) == (-2.0, 2.0, -1.0, 1.0)
    panels: Any = chart.panels.values()
    assert [one.y.title.rpartition("median) / ")[2] for one in panels] == ["m", "m", "rad"]


def test_each_coordinate_has_its_own_unit():
    assert units(SLEIGH) == ["m", "m", "rad"]
    assert units(Snake.coil(3)) == ["m", "m", *["rad"] * 3]
    for kind in SCENES.values():
        scene = kind.example()
        assert len(units(scene)) == scene.n
