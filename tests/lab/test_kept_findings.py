"""Findings and Records as they are kept: nothing lost, nothing of another kind."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eomcheck.claims import Finding, State
from eomcheck.claims.run import RunSelection, ValidationRun
from eomcheck.errors import InputError
from eomcheck.lab.store.record_file import Record, Records, select
from eomcheck.lab.store.validation_runs import (
    PROOFS,
    RUNS,
    STATES,
    ValidationWriter,
    findings_record,
    stored_findings,
    stored_findings_in,
)
from eomcheck.scenes import Sleigh, Snake

SNAKE = Snake.coil(2)
STATE = State(np.arange(4.0), np.ones(4), 0.5)
PASSED = Finding("bias", "casadi", SNAKE, STATE, 1e-15, 1e-13, "passed", "compared: casadi 3")
FAILED = replace(PASSED, subject="au", verdict="failed", observed=math.inf, detail="bias, row x")
OPEN = replace(PASSED, subject="el", verdict="inconclusive", allowed=math.inf, digits=3.0)


def test_what_failed_passed_or_was_open_is_kept_as_it_was(tmp_path: Path):
    run, made = ValidationRun(), [PASSED, FAILED, OPEN]
    run.findings, run.ends = made, [2]  # the last is about the run as a whole
    with Records(tmp_path / "r.db") as records:
        ValidationWriter(records, Snake, run, RunSelection.of(engines=[]), (1, 2), 1, 0).finish()
        kept = stored_findings_in(records.all())
    for names in (("claim", "subject", "verdict", "evidence", "detail", "digits"),):
        for one, other in zip(kept, made, strict=True):
            assert [getattr(one, x) for x in names] == [getattr(other, x) for x in names]
    assert [(one.observed, one.allowed) for one in kept] == [
        (one.observed, one.allowed) for one in made
    ]


def test_a_validation_takes_the_place_of_that_of_the_same_kind_alone(tmp_path: Path):
    with Records(tmp_path / "r.db") as records:
        for kind, made in ((Snake, [PASSED, FAILED]), (Sleigh, [OPEN]), (Snake, [FAILED])):
            run = ValidationRun()
            run.findings, run.ends = made, [*range(1, len(made) + 1)]
            ValidationWriter(records, kind, run, RunSelection.of(engines=[]), (1, 2), 1, 0).finish()
        kept = [(one.scene, one.subject) for one in stored_findings_in(records.all())]
        runs = {one.settings["scene"]: one.status for one in records.all(RUNS)}
    assert sorted(kept) == [("sleigh", "el"), ("snake", "au")]
    assert runs == {"sleigh": "done", "snake": "done"}


def test_findings_of_states_and_proofs_are_read_and_nothing_else():
    state = findings_record(stored_findings([PASSED], "snake", 7))
    proof = findings_record(stored_findings([replace(PASSED, subject="proof")], "snake"))
    other = replace(state, study="accuracy")
    assert (state.study, proof.study) == (STATES, PROOFS)
    assert [one.subject for one in stored_findings_in([state, proof, other])] == ["casadi", "proof"]


def test_the_place_of_a_finding_is_scene_links_and_state():
    (kept,) = stored_findings_in([findings_record(stored_findings([PASSED], "snake", 7))])
    assert kept.location == "snake, N = 2, state 7"
    assert replace(kept, links=None).location == "snake, state 7"
    assert stored_findings([PASSED], "snake")[0].location == SNAKE.structure


def test_of_cells_that_cannot_all_be_forgotten_none_is(tmp_path: Path):
    with Records(tmp_path / "r.db") as records:
        for n in (1, 2):
            records.add(Record("study", {"n": n}))
        with pytest.raises(InputError):
            records.forget("study", [{"n": 1}, {"n": Path("x")}])
        assert len(records) == 2


def test_only_timed_records_with_these_settings_are_selected():
    timed = Record("study", {"n": 1, "key": "au"}, seconds=1.0)
    other = Record("study", {"n": 2, "key": "au"}, seconds=1.0)
    untimed = Record("study", {"n": 1, "key": "el"})
    elsewhere = Record("another", {"n": 1}, seconds=1.0)
    records = [timed, other, untimed, elsewhere]
    assert select(records, "study", n=1) == [timed]
    assert select(records, n=1) == [timed, elsewhere]
    assert select(records, "study") == [timed, other]
