"""Exit codes: what a command found decides them, and nothing else."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.reports import running_differences

from eomcheck import cli
from eomcheck.claims.finding import Finding
from eomcheck.cli.study_commands import GROUPS
from eomcheck.engines import engine_of
from eomcheck.errors import WorkerError
from eomcheck.evaluation.tolerance import C
from eomcheck.lab import library_comparison
from eomcheck.lab.fuzzing import campaign as campaigns
from eomcheck.lab.fuzzing.failures import FailureRecord, ReplayResult
from eomcheck.lab.library_comparison import LibraryComparison, LibraryResult
from eomcheck.lab.store.record_file import Record, record_of_rows
from eomcheck.lab.studies import study_of
from eomcheck.lab.studies.accuracy import Delivered
from eomcheck.lab.studies.agreement import Agreement
from eomcheck.lab.studies.engines import EngineDifference
from eomcheck.mechanics.records import State
from eomcheck.scenes import Sleigh

SLEIGH = Sleigh.example()
STATE = State(*SLEIGH.initial_state(), 0.0)


def code_of(monkeypatch: pytest.MonkeyPatch, *words: str) -> int:
    """Run the command line in this process and return its exit code."""
    monkeypatch.setattr(sys, "argv", ["eomcheck", *words])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    return stop.value.code or 0


def finding(verdict: Any, claim: str = "bias", engine: str | None = None) -> Finding:
    """Return a Finding about the sleigh."""
    of = None if engine is None else engine_of(engine)
    subject = engine or "au ~ el"
    return Finding(claim, subject, SLEIGH, STATE, 0.5, 1.0, verdict, "compared: x", "", engine=of)


def found(monkeypatch: pytest.MonkeyPatch, *findings: Finding, error: Any = None) -> None:
    """Let `validate` find these, then raise an error if one is given."""

    def look(kind: Any, run: Any, *how: Any) -> None:
        run.findings.extend(findings)
        run.ends.append(len(run.findings))
        if error is not None:
            raise error

    monkeypatch.setattr("eomcheck.lab.store.validation_runs.validate_kind", look)


@pytest.mark.parametrize("place", [0, 1, 2])
def test_one_failure_among_any_findings_is_1_the_first_and_the_last_included(place, monkeypatch):
    verdicts = ["passed", "inconclusive", "skipped"]
    verdicts[place] = "failed"
    found(monkeypatch, *map(finding, verdicts))
    assert code_of(monkeypatch, "validate", "--scene", "sleigh") == 1


@pytest.mark.parametrize("verdicts", [["passed"], ["passed", "inconclusive", "skipped"]])
def test_findings_without_a_failure_are_0(verdicts, monkeypatch):
    found(monkeypatch, *map(finding, verdicts))
    assert code_of(monkeypatch, "validate", "--scene", "sleigh") == 0


@pytest.mark.parametrize("verdicts", [[], ["skipped"], ["inconclusive", "skipped"]])
def test_a_run_that_decides_nothing_is_2(verdicts, monkeypatch, capsys):
    found(monkeypatch, *(replace(finding(x), detail="why") for x in verdicts))
    assert code_of(monkeypatch, "validate", "--scene", "sleigh") == 2
    message = capsys.readouterr().err
    reasons = [f": bias is {verdict}: why" for verdict in verdicts[:1]]
    assert message.endswith(f"no claim could be decided{''.join(reasons)}\n")


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("verdicts", "code"),
    [
        (["inconclusive", "inconclusive"], 2),
        (["skipped"], 2),
        ([], 2),
        (["inconclusive", "passed"], 0),
        (["inconclusive", "failed"], 1),
    ],
)
def test_an_engine_about_which_nothing_was_decided_is_2(verdicts, code, monkeypatch, capsys):
    mine = [finding(x, "mass-matrix", "casadi") for x in verdicts]
    found(monkeypatch, finding("passed"), *mine)
    assert code_of(monkeypatch, "validate", "--scene", "sleigh", "--engine", "casadi") == code
    assert ("casadi" in capsys.readouterr().err) == (code == 2)


def test_an_interrupted_validation_is_130_and_one_that_lost_a_worker_2(monkeypatch, capsys):
    words = "validate", "--scene", "sleigh"
    found(monkeypatch, finding("failed"), error=KeyboardInterrupt())
    assert code_of(monkeypatch, *words) == 130
    found(monkeypatch, finding("passed"), error=WorkerError("a worker died"))
    assert code_of(monkeypatch, *words) == 2
    assert "a worker died" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("end", "code"),
    [
        (ZeroDivisionError("by hand"), 1),
        (GeneratorExit("by hand"), 1),
        (SystemExit(2), 2),
        (SystemExit(130), 130),
        (SystemExit(None), 0),
        (SystemExit(0), 0),
    ],
)
def test_a_supervised_command_gives_the_code_it_ends_with_and_1_after_a_traceback(
    end, code, monkeypatch, capsys
):
    def run():
        raise end

    given = []
    monkeypatch.setattr(cli, "_run", run)
    monkeypatch.setattr(cli.supervisor, "accept_supervision", lambda: 7)
    monkeypatch.setattr(cli.supervisor, "report_exit_code", lambda *told: given.append(told))
    assert code_of(monkeypatch, "validate") == code
    assert given == [(7, code)]
    assert ("by hand" in capsys.readouterr().err) == (code == 1)


class Proofs:
    """Proofs that came to something by hand."""

    failed, decided, error = False, True, None

    def __init__(self, *how: Any):
        self.how = how

    def run(self) -> None:
        if self.error is not None:
            raise self.error


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({}, 0),
        ({"failed": True}, 1),
        ({"decided": False}, 2),
        ({"failed": True, "decided": False}, 1),
        ({"error": KeyboardInterrupt()}, 130),
        ({"error": WorkerError("lost")}, 2),
    ],
)
def test_a_disproof_is_1_and_nothing_proved_2(change, code, monkeypatch):
    monkeypatch.setattr("eomcheck.lab.proofs.Proofs", type("Made", (Proofs,), change))
    monkeypatch.setattr("eomcheck.lab.report.finding_output.print_proofs", lambda proofs: None)
    assert code_of(monkeypatch, "prove", "--scene", "sleigh") == code


@pytest.mark.parametrize(
    ("finds", "error", "code"),
    [({}, None, 0), ({"a": 1}, None, 1), ({"a": 1}, KeyboardInterrupt(), 130)],
)
def test_a_campaign_with_a_find_is_1(finds, error, code, monkeypatch):
    def run(*how: Any) -> None:
        if error is not None:
            raise error

    made = SimpleNamespace(failure_records=finds, run=run)
    monkeypatch.setattr(campaigns, "Campaign", lambda *how: made)
    monkeypatch.setattr("eomcheck.lab.report.finding_output.print_campaign", lambda campaign: None)
    assert code_of(monkeypatch, "fuzz", "--scene", "sleigh", "--examples", "1") == code


@pytest.mark.parametrize(
    ("outcomes", "code"),
    [
        (["holds"], 0),
        (["holds", "inconclusive"], 0),
        (["holds", "failed"], 1),
        (["not checked", "holds"], 2),
        (["not checked", "failed"], 1),
    ],
)
def test_a_kept_failure_that_fails_is_1_and_one_not_checked_2(
    outcomes, code, monkeypatch, tmp_path
):
    results = [ReplayResult(FailureRecord("sleigh", {}, [], []), one, "why") for one in outcomes]
    monkeypatch.setattr("eomcheck.lab.fuzzing.failures.read_failures", lambda path: [1])
    monkeypatch.setattr("eomcheck.lab.fuzzing.failures.replay_failures", lambda *how: results)
    monkeypatch.setattr(FailureRecord, "python", "code")
    (tmp_path / "kept.json").write_text("")
    assert code_of(monkeypatch, "fuzz", "--replay", str(tmp_path / "kept.json")) == code


@pytest.mark.parametrize("place", [0, 1])
@pytest.mark.parametrize(("status", "code"), [("finished", 0), ("failed", 1), ("refused", 1)])
def test_one_motion_that_does_not_reach_its_end_is_1(place, status, code, monkeypatch):
    both = ["finished", "finished"]
    both[place] = status
    left = [SimpleNamespace(status=x) for x in both]
    monkeypatch.setattr("eomcheck.simulate", lambda *how, **more: left.pop(0))
    monkeypatch.setattr("eomcheck.lab.report.motion_tables.print_trajectories", lambda found: None)
    assert code_of(monkeypatch, "simulate", "--end", "1", "--formulation", "au,el") == code
    many = SimpleNamespace(status=np.array(both))
    monkeypatch.setattr("eomcheck.simulate_many", lambda *how, **more: many)
    monkeypatch.setattr("eomcheck.lab.report.motion_tables.print_many", lambda found: None)
    assert code_of(monkeypatch, "simulate", "--end", "1", "--examples", "2") == code


@pytest.mark.parametrize("command", ["acceleration", "constraints"])
@pytest.mark.parametrize(("count", "code"), [(0, 0), (1, 1), (3, 1)])
def test_refusals_and_redundant_constraints_are_1(command, count, code, monkeypatch):
    name = f"print_{command}".replace("acceleration", "accelerations")
    monkeypatch.setattr(f"eomcheck.lab.report.motion_tables.{name}", lambda *how: count)
    assert code_of(monkeypatch, command, "--scene", "sleigh") == code


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({}, 0),
        ({"beside": LibraryResult("drake", refusal="no", missing=True)}, 0),
        ({"beside": LibraryResult("drake", refusal="no")}, 1),
        ({"faults": {"M": "raises"}}, 1),
        ({"findings": {"bias": finding("failed")}}, 1),
        ({"findings": {"bias": finding("inconclusive")}}, 0),
        ({"decided": False}, 2),
        ({"decided": None}, 2),
        ({"decided": None, "faults": {"M": "raises"}}, 1),
    ],
)
def test_a_library_that_differs_or_gives_no_answer_is_1(change, code, monkeypatch):
    change = {"decided": True} | change
    others = {"drake": change.pop("beside")} if "beside" in change else {}
    made = LibraryComparison(
        SLEIGH, {"mujoco": LibraryResult("mujoco", "MuJoCo 3", **change)} | others
    )
    made.running = running_differences({"M": np.zeros((2, 2))})
    monkeypatch.setattr(library_comparison, "compare_libraries", lambda *how: made)
    monkeypatch.setattr("eomcheck.scene_lookup.scene_named", lambda name: SLEIGH)
    assert code_of(monkeypatch, "compare", "robot.urdf") == code


# ---- Studies -------------------------------------------------------------------------------------

STUDIES = [(group, key) for group, keys in GROUPS.items() if group != "draw" for key in keys]
MEASURES = {"long-run", "paper", "stiff", "work-precision"}
"""Studies of where formulations fail: a motion that does not reach its end is what they measure."""


def told(
    monkeypatch: pytest.MonkeyPatch, key: str, records: list[Record], error: Any = None
) -> Any:
    """Let a study come to these Records, and print nothing of them."""
    study = study_of(key)

    def run(self: Any, *how: Any, **options: Any) -> list[Record]:
        if error is not None:
            raise error
        return records

    monkeypatch.setattr(type(study), "run", run)
    for name in ("charts", "tables", "remarks"):
        monkeypatch.setitem(study.__dict__, name, lambda found: [])
    return study


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("group", "key"), STUDIES, ids=[" ".join(x) for x in STUDIES])
def test_a_cell_that_failed_is_1_where_a_study_is_no_measurement_of_failures(
    group, key, monkeypatch, tmp_path
):
    words = group, key, "--records", str(tmp_path / "r.db")
    told(monkeypatch, key, [Record(key, {}, "failed", "overflow")])
    assert code_of(monkeypatch, *words) == (0 if key in MEASURES else 1)
    told(monkeypatch, key, [])
    assert code_of(monkeypatch, *words) == 0
    told(monkeypatch, key, [], KeyboardInterrupt())
    assert code_of(monkeypatch, *words) == 130


def record(key: str, row: Any) -> Record:
    """Return a finished cell of a study with one row."""
    return record_of_rows(key, {}, [row])


RIGHT = Delivered("au", 2, None, of_bound=0.5, machine_of_bound=0.5)
BESIDE = Agreement("im", 2, 0.5, 1.0, 9.0)


def cell(relative: float, bound: float, status: Any = "done") -> Record:
    """Return a cell of the atlas of stability."""
    return Record("stability", {}, status, errors={"relative": relative, "bound": bound})


ALARMS = {
    "accuracy": (record("accuracy", RIGHT), record("accuracy", replace(RIGHT, state="beyond"))),
    "agreement": (record("agreement", BESIDE), record("agreement", replace(BESIDE, observed=2.0))),
    "tolerance": (
        Record("tolerance", {}, series={"bias": [0.5 * C]}),
        Record("tolerance", {}, series={"bias": [0.5 * C, 2.0 * C]}),
    ),
    "robots": (
        Record("robots", {}, counts={"failed": 0, "disproved": 0, "passed": 9}),
        Record("robots", {}, counts={"failed": 0, "disproved": 1}),
    ),
    "engines": tuple(
        record(
            "engines",
            EngineDifference("casadi", "1", "sleigh", "bias", 3, failed, 1e-3, 0.5, False),
        )
        for failed in (0, 2)
    ),
    "stability": (cell(1e-3, 1e-2), cell(1e-3, 9e-4)),
}
"""Study -> a finished cell in which all is well, and one in which something is wrong."""


@pytest.mark.parametrize("key", ALARMS)
def test_a_study_that_finds_an_error_that_nothing_tells_is_1(key, monkeypatch, tmp_path):
    (group,) = (group for group, one in STUDIES if one == key)
    words = group, key, "--records", str(tmp_path / "r.db")
    well, wrong = ALARMS[key]
    told(monkeypatch, key, [well])
    assert code_of(monkeypatch, *words) == 0
    told(monkeypatch, key, [well, wrong, well])
    assert code_of(monkeypatch, *words) == 1


@pytest.mark.parametrize("old", [("r.db", "--end", "5"), ("--records", "r.db", "--t-end=5")])
def test_old_forms_of_a_study_s_command_are_accepted_and_warned_of(old, monkeypatch, capsys):
    asked = []
    study = told(monkeypatch, "long-run", [])
    monkeypatch.setattr(
        type(study), "run", lambda self, file, fresh, **how: asked.append((file, how["end"])) or []
    )
    assert code_of(monkeypatch, "study", "long-run", *old) == 0
    assert asked == [(Path("r.db"), 5.0)] and "is now" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words",
    [
        ("fuzz", "--time="),
        ("fuzz", "--examples", "1", "--links="),
        ("draw", "scene", "sleigh.gif", "--scene", "sleigh", "--formulation="),
        ("bench", "tolerance", "--links="),
        ("study", "operations", "--links="),
    ],
    ids=lambda words: f"{words[0]} {words[-1]}",
)
def test_an_option_of_no_characters_is_not_its_default(words, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(campaigns.Campaign, "run", None)
    assert code_of(monkeypatch, *words) == 2
    name = words[-1].strip("-=")
    said = "".join(capsys.readouterr())
    assert f"--{name} ''" in said or f"unknown {name} ''" in said
