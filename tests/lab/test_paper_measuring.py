"""The paper's study measured: its cells and motions, going on, and the command."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eomcheck import cli
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.store.record_file import Record, Records
from eomcheck.lab.studies.paper import STUDY as PAPER_STUDY
from eomcheck.lab.studies.paper import measure as paper
from eomcheck.lab.studies.paper.measure import FULL, PAPER, QUICK, PaperRecords, Solver, StudyPlan


def test_the_study_is_about_the_papers_seven_formulations():
    assert PAPER == ("im", "au", "el", "gw", "em", "ml", "kane")
    assert QUICK.formulations == FULL.formulations == PAPER
    assert len(FULL.links) == 20
    assert (min(FULL.links), max(FULL.links)) == (2, 100)
    assert set(QUICK.links) <= set(FULL.links)
    assert set(QUICK.solvers) < set(FULL.solvers)


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Record]]:
    path = tmp_path_factory.mktemp("paper") / "records.db"
    with Records(path) as records, pytest.MonkeyPatch.context() as patch:
        patch.setattr(paper, "OUTPUTS", OUTPUTS)
        patch.setattr(paper, "QUICK", SMALL)
        return path, PAPER_STUDY.measure(records, quick=True)


OUTPUTS = 21
SMALL = StudyPlan((2, 3, 7), (Solver("RK45", 1e-5),), ("au", "kane"), runs=2)


def test_each_cell_is_one_record(measured):
    _, records = measured
    found = PaperRecords(records)
    assert len(records) == 2 * (3 + 7) + 2 * 3
    assert not found.unfinished
    for (links, key, _), record in found.motions.items():
        assert record.cpu_seconds is not None and 1 <= record.runs <= SMALL.runs
        assert len(record.series["times"]) == OUTPUTS
        norm = np.linalg.norm(record.series["constraint"])
        assert record.errors["constraint"] == pytest.approx(norm)
        assert ("q" in record.series) == (links == 7)
        within = record.errors["constraint"] <= record.errors["constraint allowed"]
        assert within == (FORMULATIONS[key].level == "velocity")


def test_a_motion_that_is_far_between_output_times_crosses_no_singular_pose(monkeypatch):
    """Six links turn so far in 1/100 s that the straight line from one output to the next does."""
    monkeypatch.setattr(paper, "FULL", replace(FULL, runs=2))
    cell = {"cell": "motion", "formulation": "el", "end": 0.2, "outputs": 21}
    cell |= Solver("RK45", 1e-6)._asdict()
    found = paper.worker(())(cell | {"links": 6})
    assert (found.status, found.reason) == ("done", "")
    crossing = paper.worker(())(cell | {"links": 4})
    assert crossing.status == "failed" and "a_1" in crossing.reason


def test_the_systems_solved_are_those_of_table_i(measured):
    for (links, key), record in PaperRecords(measured[1]).equations.items():
        assert record.counts["final system"] == {"au": 2 * links + 2, "kane": 2}[key]
        assert record.counts["multipliers"] == {"au": links, "kane": 0}[key]


def test_a_wheel_across_its_link_stops_generalized_speeds_only(measured):
    across = PaperRecords(measured[1]).across
    refused = [at for at, record in across.items() if record.status == "refused"]
    assert refused == [(wheel, "kane") for wheel in range(2, 8)]


def test_the_robot_begins_in_the_papers_pose(measured):
    record = PaperRecords(measured[1]).motions[7, "kane", SMALL.solvers[0]]
    assert record.series["q"][0] == [0, 0, 0.7679, 1.536, 2.304, 3.072, 3.840, 4.608, 5.376]
    assert record.errors["initial energy"] == pytest.approx(8847.744025)


def test_a_study_that_goes_on_repeats_nothing(measured, monkeypatch: pytest.MonkeyPatch):
    path, before = measured
    monkeypatch.setattr(paper, "OUTPUTS", OUTPUTS)
    monkeypatch.setattr(paper, "QUICK", SMALL)
    monkeypatch.setattr(paper, "_equations", None)
    monkeypatch.setattr(paper, "_simulate", None)
    with Records(path) as records:
        assert PAPER_STUDY.measure(records, quick=True) == before


# ---- The command ---------------------------------------------------------------------------------


def run(*arguments: str, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(sys, "argv", ["eomcheck", "study", "paper", "--records", *arguments])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    return stop.value.code or 0


@pytest.mark.night
def test_the_command_measures_prints_and_draws(measured, tmp_path: Path, monkeypatch, capsys):
    monkeypatch.setattr(paper, "QUICK", SMALL)
    monkeypatch.setattr(paper, "OUTPUTS", OUTPUTS)
    folder = str(tmp_path)
    assert run(str(measured[0]), "--quick", "--figures", folder, monkeypatch=monkeypatch) == 0
    printed = capsys.readouterr().out
    assert "The paper's claims" in printed
    assert (tmp_path / "paper-fig2.gif").exists()
    assert "does not hold here" in (tmp_path / "paper-claims.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("x.db", "--figures", "no/such/folder"), "there is no folder 'no/such'"),
        (("pyproject.toml", "--quick"), "is not a file of records"),
    ],
)
def test_bad_input_is_exit_code_2(arguments, says, monkeypatch, capsys):
    assert run(*arguments, monkeypatch=monkeypatch) == 2
    assert says in capsys.readouterr().err
