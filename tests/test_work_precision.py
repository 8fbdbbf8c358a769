"""The work-precision study: what is measured, kept, and made of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from eomcheck.errors import InputError, UnknownNameError
from eomcheck.report.work_precision import draw_work_precision, print_work_precision
from eomcheck.studies import work_precision
from eomcheck.studies.records import Record, Records
from eomcheck.studies.work_precision import (
    STUDY,
    fastest_to,
    measure,
    pareto_front,
    plan,
    summary,
)

FOLDER = Path("validation/references")


def record(key: str, seconds: float | None, error: float, integrator: str = "DOP853") -> Record:
    settings = {
        "reference": "paper-rest",
        "formulation": key,
        "integrator": integrator,
        "tolerance": error,
    }
    if seconds is None:
        return Record(STUDY, settings, "failed", "M is singular")
    errors = {"final": error, "energy": error / 2, "constraint": 0.0, "floor": 1e-15}
    return Record(STUDY, settings, seconds=seconds, counts={"right-hand sides": 100}, errors=errors)


RECORDS = [
    record("kane", 1e-3, 1e-4),
    record("kane", 2e-3, 1e-7),
    record("kane", 4e-3, 1e-10),
    record("kane", 3e-3, 1e-4, "Radau"),
    record("au", 5e-3, 1e-5),
    record("au", 9e-3, 1e-11),
    record("em", None, 1e-4),
]


def test_the_fastest_run_below_an_error_counts():
    best = fastest_to(RECORDS, 1e-3)
    assert {key: r.seconds for key, r in best.items()} == {
        ("kane", "DOP853"): 1e-3,
        ("kane", "Radau"): 3e-3,
        ("au", "DOP853"): 5e-3,
    }
    assert fastest_to(RECORDS, 1e-9)["kane", "DOP853"].seconds == 4e-3
    assert fastest_to(RECORDS, 1e-12) == {}


def test_the_front_holds_what_nothing_beats_in_both():
    assert [r.seconds for r in pareto_front(RECORDS)] == [1e-3, 2e-3, 4e-3, 9e-3]


def test_the_summary_is_made_from_the_numbers():
    said = summary(RECORDS)
    assert "6 of 7 runs finished." in said
    assert "An error of 1e-03 is reached first by kane with DOP853 in 1 ms" in said
    assert "the slowest formulation, au, takes 5 times as long" in said
    assert "None reaches an error of 1e-09." in summary(RECORDS[:1])


def test_tables_name_what_failed_and_diagrams_are_drawn(tmp_path: Path, capsys):
    print_work_precision(RECORDS)
    printed = capsys.readouterr().out
    assert "failed: em, DOP853, 1e-04: M is singular" in printed
    for against in ("seconds", "right-hand sides"):
        draw_work_precision(RECORDS, tmp_path / "figure.png", against)
        assert (tmp_path / "figure.png").stat().st_size > 10_000


def test_cells_are_measured_once_and_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(work_precision, "RUNS", 4)
    planned = plan(FOLDER, ["free-3"], ["kane"], ["DOP853", "BDF"], [1e-4, 1e-8])
    with Records(tmp_path / "records.db") as records:
        first = measure(planned, records)
        again = measure(planned, records)
    assert again == first
    assert len(first) == 4
    by_tolerance = {(r.settings["integrator"], r.settings["tolerance"]): r for r in first}
    for r in first:
        assert (r.status, r.runs) == ("done", 4)
        assert r.seconds is not None and r.quartiles is not None
        assert 0 < r.seconds <= r.quartiles[0] <= r.quartiles[1]
        assert r.counts["right-hand sides"] >= r.counts["steps"] > 10
        assert r.errors["floor"] < 1e-12
    rough, fine = by_tolerance["DOP853", 1e-4], by_tolerance["DOP853", 1e-8]
    assert fine.errors["final"] < rough.errors["final"] / 100
    assert fine.counts["steps"] > rough.counts["steps"]


def test_a_run_that_fails_stays_as_a_cell_with_its_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(work_precision, "MOST_STEPS", 10)
    planned = plan(FOLDER, ["free-3"], ["kane"], ["DOP853"], [1e-6])
    with Records(tmp_path / "records.db") as records:
        (found,) = measure(planned, records)
    assert found.status == "failed"
    assert "step" in found.reason.lower()
    assert found.seconds is None


@pytest.mark.parametrize(
    ("arguments", "error", "says"),
    [
        ((FOLDER, ["no-such"]), InputError, "no-such"),
        ((FOLDER, None, ["xx"]), UnknownNameError, "unknown formulation 'xx'"),
        ((FOLDER, None, None, ["Euler"]), UnknownNameError, "unknown integrator 'Euler'"),
        ((FOLDER, None, None, None, [0.0]), InputError, "tolerance = 0.0"),
    ],
)
def test_bad_plans_are_named(arguments, error, says):
    with pytest.raises(error, match=says):
        plan(*arguments)
