"""The work-precision study: what is measured, kept, and made of it."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from functools import partialmethod
from pathlib import Path
from typing import Any

import pytest
from tests.widths import check_sheets_fit

from eomcheck.errors import InputError, UnknownNameError
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.show.chart_matplotlib import HOLLOW, chart_figure, plt
from eomcheck.lab.show.table import print_tables
from eomcheck.lab.store.record_file import Record, Records
from eomcheck.lab.studies import work_precision
from eomcheck.lab.studies.work_precision import (
    ERRORS,
    STUDY,
    cells,
    charts,
    fastest_to,
    most_accurate,
    pareto_front,
    summary,
    tables,
)
from eomcheck.lab.study import was_contended
from eomcheck.motion.integrators import INTEGRATORS
from eomcheck.motion.simulate import Motion


def record(
    key: str,
    seconds: float | None,
    error: float,
    integrator: str = "DOP853",
    reference: str = "paper-rest",
) -> Record:
    settings = {
        "reference": reference,
        "formulation": key,
        "integrator": integrator,
        "tolerance": error,
    }
    if seconds is None:
        return Record(STUDY.key, settings, "failed", "M is singular")
    errors = {"final": error, "energy": error / 2, "constraint": 0.0, "floor": 1e-15}
    counts = {"right-hand sides": 100, "steps": 9}
    return Record(STUDY.key, settings, seconds=seconds, counts=counts, errors=errors)


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


def test_of_each_formulation_the_most_accurate_run_is_found():
    found = most_accurate(RECORDS)
    assert {key: r.errors["final"] for key, r in found.items()} == {"kane": 1e-10, "au": 1e-11}


def test_a_run_that_had_to_share_its_core_is_disturbed_and_named(capsys):
    alone, unknown = replace(RECORDS[0], cpu_seconds=0.99e-3), RECORDS[1]
    shared = replace(RECORDS[4], cpu_seconds=2.5e-3)
    assert [was_contended(r) for r in (alone, unknown, shared, RECORDS[-1])] == [False] * 2 + [
        True,
        False,
    ]
    print_tables(tables([alone, unknown, shared]))
    printed = capsys.readouterr().out
    assert "Disturbed, even the best run had to share its core: au, DOP853, 1e-05." in printed
    print_tables(tables([alone, unknown]))
    assert "Disturbed" not in capsys.readouterr().out


def test_the_summary_is_made_from_the_numbers():
    said = summary(RECORDS)
    assert "6 of 7 runs finished." in said
    assert "An error of 1e-03 is reached first by kane with DOP853 in 1 ms" in said
    assert "the slowest formulation, au, takes 5 times as long" in said
    assert "None reaches an error of 1e-09." in summary(RECORDS[:1])


@pytest.mark.night
def test_tables_name_what_failed_and_diagrams_are_drawn(tmp_path: Path, capsys):
    check_sheets_fit(tables(RECORDS))
    print_tables(tables(RECORDS))
    (line,) = (x for x in capsys.readouterr().out.splitlines() if "M is singular" in x)
    assert [cell.strip() for cell in line.split("│")[1:-1]] == [
        *("paper-rest", "em", "DOP853", "1e-04", "failed", "M is singular")
    ]
    figures = [path for path in STUDY.write(RECORDS, tmp_path) if path.suffix == ".svg"]
    names = ("work-precision", "work-precision-rhs")
    assert [path.stem for path in figures] == [
        f"{x}{dark}" for x in names for dark in ("", "-dark")
    ]
    assert all(path.stat().st_size > 10_000 for path in figures)


def drawn(records: list[Record], which: int = 0, scene: int = 0) -> Any:
    """Return the figure of a scene, over run times or over right-hand sides."""
    figure = chart_figure([*charts(records)][scene].files()[which])
    plt.close(figure)
    return figure


def test_each_of_several_scenes_has_a_figure_of_its_own_with_a_column_an_integrator():
    other = [
        record("kane", 1e-3, 1e-4, reference="free-3"),
        record("gw", 7e-3, 1e-5, "BDF", "free-3"),
        record("em", None, 1e-4, "BDF", "free-3"),
    ]
    files = [file.name for chart in charts(RECORDS + other) for file in chart.files()]
    assert files == [
        f"work-precision-{scene}{against}"
        for scene in ("paper-rest", "free-3")
        for against in ("", "-rhs")
    ]
    points = []
    for scene, keys in enumerate((["kane", "au"], ["kane", "gw"])):
        figure = drawn(RECORDS + other, scene=scene)
        (legend,) = figure.legends
        assert [text.get_text().partition(":")[0] for text in legend.get_texts()] == keys
        assert len(figure.axes) == 3 * 3  # integrators, errors
        first = figure.axes[:3]
        assert [axes.get_title() for axes in first] == ["DOP853", "Radau", "BDF"]
        assert len({axes.get_xlim() for axes in figure.axes}) == 1
        points.append(sum(len(line.get_xdata()) for axes in first for line in axes.lines))
    assert points == [6, 2]


def test_disturbed_run_times_are_drawn_hollow_and_counts_are_not():
    records = [replace(RECORDS[0], cpu_seconds=0.5e-3), *RECORDS[1:]]
    for which, hollow in enumerate((1, 0)):
        figure = drawn(records, which)
        lines = [line for line in figure.axes[0].lines if len(line.get_xdata())]
        assert sum(line.get_gid() == HOLLOW for line in lines) == hollow
        names = [text.get_text() for text in figure.legends[0].get_texts()]
        assert ("disturbed" in names) == bool(hollow)


def test_a_scene_of_which_no_run_finished_is_drawn_empty():
    nothing = [record("em", None, 1e-4, integrator) for integrator in ("DOP853", "Radau", "BDF")]
    figure = drawn(nothing)
    assert len(figure.axes) == 9
    assert all(not axes.lines for axes in figure.axes)
    assert figure.get_supxlabel() == "run time"


def test_errors_that_a_scene_has_not_get_no_panel_and_a_reason():
    swinging = record("kane", 0.1, 1e-4, reference="turntable")
    swinging = replace(swinging, errors=swinging.errors | {"energy": math.nan})
    figure = drawn([swinging, record("kane", 0.1, 1e-4, reference="sleigh")])
    labels = [axes.get_ylabel().replace("\n", " ") for axes in figure.axes]
    assert labels == list(ERRORS.values())[::2]
    title = figure.legends[0].get_title().get_text()
    assert "energy is not conserved: the table is driven" in title.replace("\n", " ")


def test_cells_are_measured_once_and_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(work_precision, "RUNS", 4)
    planned = {
        "reference": ["free-3"],
        "formulation": ["kane"],
        "integrator": ["DOP853", "BDF"],
        "tolerance": [1e-4, 1e-8],
    }
    with Records(tmp_path / "records.db") as records:
        first = STUDY.measure(records, **planned)
        again = STUDY.measure(records, **planned)
    assert again == first
    assert len(first) == 4
    by_tolerance = {(r.settings["integrator"], r.settings["tolerance"]): r for r in first}
    for r in first:
        assert (r.status, r.runs) == ("done", 4)
        assert r.seconds is not None and r.quartiles is not None
        assert 0 < r.seconds <= r.quartiles[0] <= r.quartiles[1]
        assert r.counts["right-hand sides"] >= r.counts["steps"] > 10
        assert r.errors["floor"] < 1e-12
        assert r.cpu_seconds is not None and r.cpu_seconds > 0
        assert {"cpu", "core", "load"} <= r.machine.keys()
    rough, fine = by_tolerance["DOP853", 1e-4], by_tolerance["DOP853", 1e-8]
    assert fine.errors["final"] < rough.errors["final"] / 100
    assert fine.counts["steps"] > rough.counts["steps"]


def test_cells_are_of_the_paper_at_rest_by_everything_at_six_tolerances_unless_asked():
    found = list(cells())
    assert {one["reference"] for one in found} == {"paper-rest"}
    assert {one["integrator"] for one in found} == set(INTEGRATORS)
    assert [one["tolerance"] for one in found[:6]] == pytest.approx(
        [1e-3, 1e-5, 1e-7, 1e-9, 1e-11, 1e-13]
    )
    assert len(found) == 6 * len(INTEGRATORS) * len({one["formulation"] for one in found})


@pytest.mark.parametrize("key", ["au", "kane"])
def test_a_record_tells_the_drift_of_what_drifts(
    key: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
):
    monkeypatch.setattr(work_precision, "RUNS", 2)
    planned = {"reference": ["free-3"], "formulation": [key], "integrator": ["DOP853"]}
    with Records(tmp_path / "records.db") as records:
        rough, fine = STUDY.measure(records, **planned, tolerance=[1e-5, 1e-9])
    drifts = FORMULATIONS[key].level == "acceleration"
    for found in (rough, fine):
        assert {"energy_drift", "energy_exponent"} <= found.errors.keys()
        for name in ("constraint_drift", "constraint_exponent"):
            assert (name in found.errors) == drifts
    if drifts:
        seen = [found.errors["constraint_drift"] for found in (rough, fine)]
        assert seen[1] < 1e-2 * seen[0]
        # free-3 takes 10 s: the law gives what the error comes to, within its scatter.
        assert fine.errors["constraint"] / 10 < 10.0 * seen[1] < 10 * fine.errors["constraint"]
        print_tables(tables([rough, fine]))
        assert f"{seen[1]:.1e}" in capsys.readouterr().out


# ---- Killed --------------------------------------------------------------------------------------

CLI = """
import sys, time
from eomcheck import cli
from eomcheck.lab import study

log = sys.argv.pop(1)
trajectory_of = study.trajectory_of

def noted(motion, steps, integrator, rtol, *more):
    with open(log, "a") as file:
        file.write(f"{integrator} {rtol}\\n")
    time.sleep(0.1)  # the cells alone are done before anybody can kill it twice
    return trajectory_of(motion, steps, integrator, rtol, *more)

study.trajectory_of = noted
cli.main()
"""


@pytest.mark.night
def test_kill_9_of_the_study_loses_at_most_the_cell_in_flight_and_repeats_nothing(tmp_path: Path):
    path, log = tmp_path / "records.db", tmp_path / "log"
    command = [
        sys.executable,
        "-c",
        CLI,
        str(log),
        "study",
        "work-precision",
        "--records",
        str(path),
    ]
    command += ["--reference", "free-3", "--formulation", "kane"]
    for integrator in ("DOP853", "RK45", "Tsit5"):
        command += ["--integrator", integrator]
    for k in range(3, 9):
        command += ["--tolerance", f"1e-{k}"]

    def begun() -> list[tuple[str, float]]:
        lines = [line.split() for line in log.read_text().splitlines()] if log.exists() else []
        return [(integrator, float(tolerance)) for integrator, tolerance in lines]

    def start() -> subprocess.Popen:
        return subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=os.environ | {"COLUMNS": "200"},
        )

    def kept() -> dict[tuple[str, float], Record]:
        with Records(path, readonly=True) as records:
            found = records.all(STUDY.key)
        return {(r.settings["integrator"], r.settings["tolerance"]): r for r in found}

    before: dict[tuple[str, float], Record] = {}
    for kill in (1, 2):
        process = start()
        deadline = time.monotonic() + 300
        while len(begun()) < 6 * kill and time.monotonic() < deadline and process.poll() is None:
            time.sleep(0.01)
        process.send_signal(signal.SIGKILL)
        said, _ = process.communicate()
        assert process.returncode == -signal.SIGKILL, said
        cells = list(dict.fromkeys(begun()))
        after = kept()
        assert list(after) == cells[: len(after)]
        assert len(cells) - 1 <= len(after) < 18
        assert before.items() <= after.items()
        before = after
    process = start()
    said, _ = process.communicate(timeout=300)
    assert process.returncode == 0, said
    assert "18 of 18 runs finished." in said
    assert len(kept()) == 18
    assert before.items() <= kept().items()  # measured once: times, dates and all
    assert len(begun()) - 18 <= 2  # the cell in flight, once per kill


def test_a_run_that_fails_stays_as_a_cell_with_its_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(Motion, "solve", partialmethod(Motion.solve, max_steps=10))
    planned = {"reference": ["free-3"], "formulation": ["kane"], "integrator": ["DOP853"]}
    with Records(tmp_path / "records.db") as records:
        (found,) = STUDY.measure(records, **planned, tolerance=[1e-6])
    assert found.status == "failed"
    assert "step" in found.reason.lower()
    assert found.seconds is None


@pytest.mark.parametrize(
    ("options", "error", "says"),
    [
        ({"reference": ["no-such"]}, InputError, "no-such"),
        ({"formulation": ["xx"]}, UnknownNameError, "unknown formulation 'xx'"),
        ({"integrator": ["Euler"]}, UnknownNameError, "unknown integrator 'Euler'"),
        ({"tolerance": [0.0]}, InputError, "tolerance = 0.0"),
    ],
)
def test_bad_plans_are_named(options, error, says):
    with pytest.raises(error, match=says):
        list(cells(**options))
