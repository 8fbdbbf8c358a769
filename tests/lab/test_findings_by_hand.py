"""Findings as they are kept, where they come from and times, against values written by hand."""

from __future__ import annotations

import re
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eomcheck.claims import Finding, State
from eomcheck.claims.finding import Proof
from eomcheck.claims.run import ValidationRun
from eomcheck.lab import study as timing
from eomcheck.lab.store import record_file
from eomcheck.lab.store.record_file import Record, by_setting, group, record_of_rows, rows_in
from eomcheck.lab.store.validation_runs import (
    COLUMNS,
    PROOFS,
    STATES,
    StoredFinding,
    cases_of,
    findings_record,
    pose_of,
    stored_findings,
    stored_findings_in,
    why_unreadable,
)
from eomcheck.lab.study import run_time, was_contended
from eomcheck.scenes import Snake

SNAKE = Snake.coil(2)
AT = State(np.arange(4.0), np.ones(4), 0.5)
FINDING = Finding("bias", "au", SNAKE, AT, 0.25, 0.5, "failed", "compared: casadi 3", "row x")
KEPT = StoredFinding(
    *("bias", "au", 0.25, 0.5, "failed", "compared: casadi 3", "row x", None, None),
    *("snake", 2, 7, "", "code"),
)


# ---- Findings as they are kept -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (
            {},
            "failed on snake, N = 2, state 7 (compared: casadi 3): "
            "observed 0.25, allowed 0.5; row x",
        ),
        (
            {"detail": "", "links": None, "observed": 1 / 3},
            "failed on snake, state 7 (compared: casadi 3): observed 0.333, allowed 0.5",
        ),
        (
            {"case": None, "structure": "snake[2], no stiffness"},
            "failed on snake[2], no stiffness (compared: casadi 3): "
            "observed 0.25, allowed 0.5; row x",
        ),
        (
            {"verdict": "skipped", "case": 0},
            "skipped on snake, N = 2, state 0 (compared: casadi 3): row x",
        ),
    ],
)
def test_a_kept_finding_is_printed_with_its_place_its_evidence_and_its_numbers(change, text):
    assert str(replace(KEPT, **change)) == f"[au] {text}"


def test_a_kept_finding_has_a_ratio_and_a_level_and_comes_back_from_what_it_was_written_as():
    assert (KEPT.ratio, KEPT.level) == (0.5, "compared")
    assert replace(KEPT, evidence="proved").level == "proved"
    proof = Proof(degree=3, height=8.0, primes=(3, 5), draws=2, failure_probability=1e-9)
    for one in (KEPT, replace(KEPT, proof=proof)):
        row = asdict(one)
        if one.proof is not None:
            row["proof"]["primes"] = [3, 5]
        before = repr(row)
        assert StoredFinding.read(row) == one and repr(row) == before


def test_verdicts_that_an_older_release_stored_are_read_as_those_of_today():
    old = asdict(KEPT) | {"verdict": "not looked at", "evidence": "not looked at"}
    assert StoredFinding.read(old) == replace(KEPT, verdict="skipped", evidence="skipped")


def test_the_record_of_a_state_has_a_row_for_each_finding_and_one_code_for_all():
    other = replace(FINDING, subject="em", verdict="passed", detail="", digits=3.5)
    kept = stored_findings([FINDING, other], "snake", 7)
    assert [replace(one, python="code", pose="") for one in kept] == [
        KEPT,
        replace(KEPT, subject="em", verdict="passed", detail="", digits=3.5),
    ]
    record = findings_record(kept)
    assert (record.study, record.settings) == (STATES, {"scene": "snake", "links": 2, "case": 7})
    assert {*record.series} == {*COLUMNS, "python", "pose"}
    python, pose = record.series.pop("python"), record.series.pop("pose")
    assert pose == [kept[0].pose] and pose_of(pose[0])[0] == [*SNAKE.coordinate_names]
    assert python == [kept[0].python] and "q = [0.0, 1.0, 2.0, 3.0]" in python[0]
    assert record.series == {
        "claim": ["bias", "bias"],
        "subject": ["au", "em"],
        "observed": [0.25, 0.25],
        "allowed": [0.5, 0.5],
        "verdict": ["failed", "passed"],
        "evidence": ["compared: casadi 3"] * 2,
        "detail": ["row x", ""],
        "digits": [None, 3.5],
        "proof": [None, None],
    }
    structure = findings_record(stored_findings([FINDING], "snake"))
    where = {"scene": "snake", "links": 2, "structure": SNAKE.structure}
    assert (structure.study, structure.settings) == (PROOFS, where)
    (again,) = stored_findings_in([structure])
    assert (again.case, again.structure, again.location) == (None, SNAKE.structure, SNAKE.structure)


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("claim", 3, "claim = 3"),
        ("subject", None, "subject = None"),
        ("observed", "1", "observed = '1'"),
        ("allowed", None, "allowed = None"),
        ("evidence", 1, "evidence = 1"),
        ("detail", [], "detail = []"),
        ("digits", "3", "digits = '3'"),
        ("verdict", "perhaps", "verdict = 'perhaps'"),
    ],
)
def test_a_record_of_findings_of_wrong_kinds_says_which_value_it_is(name, value, said):
    record = findings_record([replace(KEPT, observed=1, allowed=0)])
    assert why_unreadable(record) is None, "whole numbers are numbers"
    series = record.series | {name: [value]}
    fault = why_unreadable(Record(STATES, record.settings, series=series))
    assert fault is not None and said in fault and "Error" in fault
    assert why_unreadable(Record("other", record.settings, series=series)) is None


def test_records_of_findings_without_a_scene_or_a_column_cannot_be_read():
    record = findings_record([KEPT])
    assert why_unreadable(Record(STATES, {"case": 7}, series=record.series))
    for name in (*COLUMNS, "python"):
        series = {x: y for x, y in record.series.items() if x != name}
        assert why_unreadable(Record(STATES, record.settings, series=series)), name
        short = record.series | {name: []}
        assert why_unreadable(Record(STATES, record.settings, series=short)), name


def test_the_findings_of_states_are_told_from_where_the_last_ended():
    run = ValidationRun([replace(FINDING, observed=float(k)) for k in range(7)], ends=[2, 2, 5, 6])

    def told(begin: int) -> list[list[float]]:
        return [[one.observed for one in of] for of in cases_of(run, begin)]

    assert told(0) == [[0.0, 1.0], [2.0, 3.0, 4.0], [5.0]]
    assert told(2) == [[2.0, 3.0, 4.0], [5.0]]
    assert told(3) == [[3.0, 4.0], [5.0]]
    assert told(5) == [[5.0]] and told(6) == []
    assert list(cases_of(ValidationRun())) == []


# ---- Groups --------------------------------------------------------------------------------------


def test_things_are_grouped_in_their_order_and_rows_come_back_as_they_were():
    assert group("banana", lambda x: x == "a") == {False: ["b", "n", "n"], True: ["a"] * 3}
    records = [Record("s", {"n": n, "i": i}) for i, n in enumerate((2, 1, 2))]
    assert [(n, [x.settings["i"] for x in of]) for n, of in by_setting(records, "n").items()] == [
        (2, [0, 2]),
        (1, [1]),
    ]
    rows = [timing.RunTime(float(k), 0.5, [1.0, 2.0], 3, None, None) for k in range(2)]  # type: ignore[arg-type]
    record = record_of_rows("s", {"n": 1}, rows)
    assert (record.study, record.settings, [*record.series]) == ("s", {"n": 1}, ["rows"])
    assert rows_in([record, Record("s", {}), record], timing.RunTime) == rows * 2


# ---- Where results come from ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "threads"),
    [
        ({}, None),
        ({"OMP": "4,2"}, 4),
        ({"OMP": "4", "MKL": " 3 "}, 3),
        ({"OMP": "4", "MKL": "3", "OPENBLAS": "2"}, 2),
        ({"OMP": "4", "OPENBLAS": "many"}, 4),
        ({"OPENBLAS": "-1"}, None),
        ({"OPENBLAS": "", "MKL": "12"}, 12),
    ],
)
def test_threads_are_those_of_the_library_that_comes_first(monkeypatch, given, threads):
    for name in ("OPENBLAS", "MKL", "OMP"):
        monkeypatch.delenv(f"{name}_NUM_THREADS", raising=False)
    for name, value in given.items():
        monkeypatch.setenv(f"{name}_NUM_THREADS", value)
    assert record_file.blas_threads() == threads


def test_versions_are_of_what_is_installed_and_the_commit_where_there_is_one(monkeypatch):
    def version(name: str) -> str:
        if name not in ("numpy", "python-flint"):
            raise record_file.metadata.PackageNotFoundError(name)
        return f"{name} 1"

    monkeypatch.setattr(record_file.metadata, "version", version)
    monkeypatch.setattr(record_file, "sources", lambda: "digest")
    monkeypatch.setattr(record_file.eomcheck, "__version__", "9.9")
    usual = {"eomcheck": "9.9", "sources": "digest"}
    for commit, known in ((None, {}), ("c0ffee+", {"commit": "c0ffee+"})):
        monkeypatch.setattr(record_file, "commit", lambda commit=commit: commit)
        assert record_file._versions.__wrapped__() == usual | known | {
            "numpy": "numpy 1",
            "python-flint": "python-flint 1",
        }


def test_a_machine_without_a_model_name_is_called_by_what_there_is(monkeypatch):
    monkeypatch.setattr(Path, "read_text", lambda path, **how: "flags : x\n")
    monkeypatch.setattr("platform.processor", lambda: "abacus")
    monkeypatch.setattr("platform.machine", lambda: "beads")
    assert record_file._cpu() == "abacus"
    monkeypatch.setattr("platform.processor", lambda: "")
    assert record_file._cpu() == "beads"

    def gone(path: Path, **how: Any) -> str:
        raise FileNotFoundError

    monkeypatch.setattr(Path, "read_text", gone)
    assert record_file._cpu() == "beads"
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00", record_file.now())


# ---- Run times -----------------------------------------------------------------------------------


def test_times_of_runs_have_quartiles_and_the_load_before_the_first(monkeypatch):
    seconds = [4.0, 1.0, 3.0, 2.0, 9.0]
    clock, loads, done = [100.0], [0.5], []
    monkeypatch.setattr(timing.time, "perf_counter", lambda: clock[0])
    monkeypatch.setattr(timing.time, "thread_time", lambda: clock[0] / 2)
    monkeypatch.setattr(timing.os, "getloadavg", lambda: (loads[0], 7.0, 8.0))

    def work() -> None:
        clock[0] += seconds[len(done) % 5]
        loads[0] += 1.0
        done.append(1)

    found = run_time(work, runs=5, long=20.0)
    assert (found.seconds, found.cpu_seconds, found.quartiles) == (1.0, 0.5, (2.0, 4.0))
    assert (found.runs, found.load, len(done)) == (5, 0.5, 5)
    # 4 s are too long to go on, until a run of 1 s is known.
    done.clear()
    assert run_time(work, runs=5, fewest=3, long=2.0).runs == 5
    done.clear()
    assert run_time(work, runs=5, fewest=2, long=0.5).runs == 2
    of_record = found.recorded()
    assert {"core", "load"} <= of_record["machine"].keys() and "core" not in of_record
    assert of_record["machine"]["load"] == 0.5 and "cpu" in of_record["machine"]
    assert of_record["seconds"] == 1.0 and of_record["runs"] == 5


@pytest.mark.parametrize(
    ("seconds", "cpu", "told"),
    [
        (1.04, 1.0, False),
        (1.06, 1.0, True),
        (None, 1.0, False),
        (1.0, None, False),
        (1.0, 2.0, False),
    ],
)
def test_a_run_is_disturbed_where_a_twentieth_of_it_was_not_its_own(seconds, cpu, told):
    record: Any = SimpleNamespace(seconds=seconds, cpu_seconds=cpu)
    assert was_contended(record) is told
