"""Tables of studies: every column, held against Records that are made by hand."""

from __future__ import annotations

from dataclasses import replace
from math import nan
from typing import Any

import pytest

from eomcheck.evaluation.tolerance import C
from eomcheck.lab.library_comparison import QUANTITIES, LibraryReading
from eomcheck.lab.show.table import Cell
from eomcheck.lab.store.record_file import Record, record_of_rows
from eomcheck.lab.studies import study_of
from eomcheck.lab.studies.accuracy import Delivered
from eomcheck.lab.studies.agreement import Agreement
from eomcheck.lab.studies.conformance import ConformanceRow
from eomcheck.lab.studies.engines import EngineDifference
from eomcheck.lab.studies.motion import MotionTime
from eomcheck.lab.studies.operations.measure import Operations, Saving, count_record
from eomcheck.lab.studies.rhs import Timing
from eomcheck.lab.studies.stability import WORDS, outcome_of
from eomcheck.numbers.counting import System


def tables(key: str, *found: Record) -> list[list[tuple[str, ...]]]:
    """Return the rows of each table of a study."""
    sheets = list(study_of(key).tables(found))
    assert all(len(row) == len(sheet.columns) for sheet in sheets for row in sheet.rows)
    return [[tuple(map(str, row)) for row in sheet.rows] for sheet in sheets]


def said(key: str, *found: Record) -> list[str]:
    return list(study_of(key).remarks(found))


def test_accuracy_tells_fewest_digits_medians_and_the_largest_errors():
    one = Delivered("au", 2, None, 15.0, 1e-15, 1.0, 10.0, 2.0, 0.25, 0.5, 0.125)
    rows = [
        one,
        replace(one, digits=9.0, ulps=4.0, condition=1000.0, ratio=0.75, of_bound=0.25),
        replace(one, digits=12.0, ulps=3.0, condition=20.0, ratio=nan, machine_of_bound=nan),
        replace(one, relative=0.0),
        Delivered("au", 2, "M"),
        replace(one, key="kane", state="Snake(...)"),
    ]
    found = record_of_rows("accuracy", {}, rows)
    digits, errors = tables("accuracy", found)
    assert digits == [
        ("au", "3", "1", "1", "9.0", "12.0", "3"),
        ("kane", "1", "0", "0", "15.0", "15.0", "1"),
    ]
    assert errors[0] == ("au", "20", "1e+03", "0.5", "0.75", "0.5", "0.12", "1")
    first, second = said("accuracy", found)
    assert "1 state;" in first and "1 result without error" in first
    assert f"Largest error / (κ ε scale): 0.75; the constant C of the tolerances is {C:g}" in first
    assert second == "beyond its bound: kane, Snake(...)"


def test_agreement_tells_the_largest_distance_of_all_states():
    rows = [
        Agreement("im", 2, 2e-15, 1e-14, 1e-3),
        Agreement("im", 3, 4e-15, 8e-15, 8e-4),
        Agreement("im", 3, 5e-15, 1e-12, 1.0),
        Agreement("el", 3, 1e-16, 1e-15, 1e-6),
    ]
    (table,) = tables("agreement", record_of_rows("agreement", {}, rows))
    assert table == [
        ("im", "3", "5.0e-15", "50.0%", "1.0e+11"),
        ("el", "1", "1.0e-16", "10.0%", "1.0e+09"),
    ]


def test_tolerance_tells_the_median_and_the_largest_ratio_of_each_claim():
    one = Record("tolerance", {}, series={"bias": [0.5, 2.0, 1.0]})
    (table,) = tables("tolerance", one)
    assert table == [("bias", "3", "1", "2")]
    assert "largest 2" in said("tolerance", one)[-1]
    other = Record("tolerance", {"scene": "sleigh"}, series={"bias": [0.25]})
    (table,) = tables("tolerance", one, other)
    assert table[1] == ("sleigh", "bias", "1", "0.25", "0.25")


def test_a_motion_is_timed_by_both_integrators_and_their_ratio():
    rows = [MotionTime("kane", 2e-3, 1000, 8e-3), MotionTime("el", nan, 5, nan)]
    (table,) = tables("motion", record_of_rows("motion", {}, rows))
    ((key, cyrk, calls, each, scipy, ratio),) = table
    assert (key, calls, ratio) == ("kane", "1,000", "4")
    assert [x.split()[0] for x in (cyrk, each, scipy)] == ["2", "2", "8"]
    assert len({cyrk, each, scipy}) == 3
    (sheet,) = study_of("motion").tables([record_of_rows("motion", {}, rows)])
    assert "Do not reach the end: el." in sheet.note


def test_engines_tell_the_largest_difference_their_failures_and_what_is_soft():
    one = EngineDifference("casadi", "CasADi 3", "sleigh", "mass-matrix", 4, 0, 1e-15, 0.5, False)
    rows = [
        one,
        replace(one, scene="snake", states=6, relative=3e-15, share=0.25),
        replace(one, claim="bias", relative=2e-9, failed=2),
        replace(one, claim="bias", scene="snake", states=6, relative=1e-12),
        replace(one, claim="engine-acceleration", relative=4e-7, share=None),
        replace(one, claim="engine-multipliers", relative=5e-3, gives_way=True),
    ]
    found = record_of_rows("engines", {}, rows)
    engines, scenes = tables("engines", found)
    ((name, kinds, states, failures, *cells),) = engines
    assert (name, kinds, states, failures) == ("CasADi 3", "2", "10", "2")
    assert {"3e-15", "2e-09 FAIL", "4e-07 inconclusive", "5e-03 soft"} <= set(cells)
    assert {(row[0], row[1]) for row in scenes} == {("casadi", "sleigh"), ("casadi", "snake")}
    assert "1e-15" in scenes[0] and "3e-15" in scenes[1]
    first, second = said("engines", found)
    assert first.startswith("Largest error: 50.0% of what rounding allows.")
    assert second.startswith("`inconclusive`")


def test_an_engine_that_fails_where_nothing_has_a_size_is_no_dash():
    one = EngineDifference("casadi", "CasADi 3", "sleigh", "bias", 4, 2, None, 2.0, False)
    found = record_of_rows("engines", {}, [one, replace(one, claim="mass-matrix", failed=0)])
    (engine,), (scene,) = tables("engines", found)
    assert engine[3:6] == ("2", "-", "FAIL") and scene[2:4] == ("-", "FAIL")


def test_robots_tell_counts_times_and_each_library_in_its_column():
    counts = {"coordinates": 3, "passed": 40, "failed": 1, "proved": 12, "disproved": 2}
    apart = dict.fromkeys(QUANTITIES, 2e-9) | {"M": 3e-4}
    reads = [
        LibraryReading("arm", "mujoco 3", "agrees", {**apart, "M": 2e-16}, ""),
        LibraryReading("arm", "drake 1", "differs", apart, "has an armature"),
        LibraryReading("arm", "exudyn", "no answer", {}, "cannot"),
        LibraryReading("arm", "idyntree", "agrees where decided", apart, ""),
        LibraryReading("arm", "pybullet", "inconclusive", apart, ""),
    ]
    settings = {"robot": "arm", "free": False}
    series: dict[str, Any] = {"rows": [vars(one) for one in reads], "left out": [[]]}
    times = {"checks, s": 1.25, "proof, s": 0.5}
    done = Record("robots", settings, counts=counts, errors=times, series=series)
    missing = Record("robots", {"robot": "leg", "free": True}, "refused", "no mujoco")
    ours, theirs = tables("robots", done, missing)
    assert ours == [("arm", "3", "40", "1", "12", "2", "1.2", "0.5")]
    words = ("2e-16", "3e-04 differs", "no answer", "3e-04 agrees where decided")
    assert theirs == [("arm", *words, "3e-04 inconclusive")]
    (row,) = list(study_of("robots").tables([done]))[1].rows
    looks = [cell.kind for cell in row[1:] if isinstance(cell, Cell)]
    assert looks == ["passed", "failed", "open", "passed", "open"]
    lines = said("robots", done, missing)
    assert any("no mujoco" in line for line in lines)
    assert any(line.startswith("arm, drake 1: M 3e-04") for line in lines)
    assert "arm, exudyn: cannot" in lines
    assert not any(library in line for line in lines for library in ("mujoco 3", "idyntree"))


def test_long_runs_tell_both_laws_and_their_ends():
    errors = {"constraint_end": 1e-7, "constraint_exponent": 1.5, "constraint_rate": 2e-9}
    errors |= {"energy_end": 3e-6, "energy_exponent": 0.5, "energy_rate": 4e-8}
    errors |= {"constraint_largest": 1.0, "energy_largest": 1.0}
    settings = {"formulation": "au", "remedy": "none"}
    record = Record(
        "long-run", settings, errors=errors, counts={"right-hand sides": 12345}, cpu_seconds=1.5
    )
    short = Record("long-run", settings | {"remedy": "projection"}, "failed", "singular")
    (table,) = tables("long-run", record, short)
    first, second = table
    assert (first[:2], first[-2:]) == (("au", "none"), ("12,345", "1.5"))
    assert [float(x) for x in first[2:8]] == pytest.approx([1e-7, 1.5, 2e-9, 3e-6, 0.5, 4e-8])
    assert second == ("au", "projection", *[""] * 6, "0", "")
    assert said("long-run", record, short) == ["au, projection failed: singular"]


@pytest.mark.parametrize(
    ("relative", "bound", "word"), [(1e-7, 0.0, ""), (1e-3, 1e-2, "tells"), (1e-3, 1e-4, "SILENT")]
)
def test_a_cell_of_the_atlas_is_good_told_or_silent_by_its_error_and_bound(relative, bound, word):
    record = Record("stability", {}, errors={"relative": relative, "bound": bound})
    assert word in WORDS.get(outcome_of(record), "")
    assert bool(WORDS.get(outcome_of(record))) == bool(word)


def test_right_hand_sides_tell_medians_their_ratio_to_sines_their_slope_and_their_making():
    rows = [
        Timing("snake", "sin, cos", 100, 1e-6, (0.0, 0.0), 0.0),
        Timing("snake", "sin, cos", 7, 5e-8, (0.0, 0.0), 0.0),
        Timing("snake", "kane", 7, 2e-7, (0.0, 0.0), 0.5),
        Timing("snake", "kane", 100, 4e-6, (0.0, 0.0), 3.0),
        Timing("snake", "kane", 1000, 4e-4, (0.0, 0.0), 2.0),
        Timing("sleigh", "kane", 0, 3e-7, (0.0, 0.0), 0.25),
    ]
    (sines, kane), (sleigh,) = tables("rhs", record_of_rows("rhs", {}, rows))
    assert kane[0] == "kane" and [x.split("(")[-1] for x in kane[1:3]] == ["4 ×)", "4 ×)"]
    assert [x.split(" ")[0] for x in kane[1:4]] == ["200", "4", "400"]
    assert kane[4:] == ("2.000", "3 s")
    assert [x.split(" ")[0] for x in sines[1:3]] == ["50", "1"] and sines[3] == ""
    assert [x.split(" ")[0] for x in sleigh] == ["kane", "300", "250"]


def run_to(final: float, seconds: float | None, **settings: Any) -> Record:
    errors = {"final": final, "floor": 1e-15, "energy": 1e-9, "constraint": 1e-11}
    errors |= {"constraint_drift": 3e-10, "constraint_exponent": 1.25}
    settings = {"reference": "paper-rest", "integrator": "Radau", "tolerance": 1e-3} | settings
    if seconds is None:
        return Record("work-precision", settings, "failed", "a step of zero")
    counts = {"right-hand sides": 1234, "steps": 56}
    return Record("work-precision", settings, seconds=seconds, counts=counts, errors=errors)


def test_work_and_precision_tell_the_fastest_to_each_error_the_front_drift_and_failures():
    found = (
        run_to(1e-4, 2e-3, formulation="kane"),
        run_to(5e-7, 6e-3, formulation="kane", integrator="DOP853", tolerance=1e-7),
        run_to(2e-4, 8e-3, formulation="au"),
        run_to(9e-4, 5e-3, formulation="au", integrator="BDF"),
        run_to(1e-2, 1e-3, formulation="el"),
        run_to(0.0, None, formulation="ml"),
    )
    targets, front, drift, failed = tables("work-precision", *found)
    blank = ("", "", "")
    assert targets == [
        ("kane", "2 ms", "Radau", "1", "6 ms", "DOP853", "1", *blank),
        ("au", "5 ms", "BDF", "2.5", *blank, *blank),
        ("el", *blank, *blank, *blank),
        ("ml", *blank, *blank, *blank),
    ]
    assert front == [
        ("el", "Radau", "1e-03", "1 ms", "1.0e-02"),
        ("kane", "Radau", "1e-03", "2 ms", "1.0e-04"),
        ("kane", "DOP853", "1e-07", "6 ms", "5.0e-07"),
    ]
    assert drift[:2] == [
        ("kane", "DOP853", "1e-07", "3.0e-10", "1.2", "", ""),
        ("au", "Radau", "1e-03", "3.0e-10", "1.2", "", ""),
    ]
    assert failed == [("paper-rest", "ml", "Radau", "1e-03", "failed", "a step of zero")]
    (text,) = said("work-precision", *found)
    assert text.startswith("paper-rest: 5 of 6 runs finished.")
    assert "An error of 1e-03 is reached first by kane with Radau in 2 ms; the slowest" in text
    assert "au, takes 2.5 times as long" in text and "None reaches an error of 1e-09." in text


def stiff_run(integrator: str, k: float, cpu: float, sides: int, **other: Any) -> Record:
    settings = {"problem": "damped", "formulation": "kane", "tolerance": 1e-4, "jacobian": None}
    settings |= {"integrator": integrator, "stiffness": k} | other
    return Record(
        "stiff",
        settings,
        seconds=9.0,
        cpu_seconds=cpu,
        counts={"right-hand sides": sides},
        errors={"final": 5e-4, "floor": 1e-12},
    )


def test_stiff_joints_tell_costs_crossovers_what_jacobians_save_and_failures():
    settings = {"problem": "damped", "formulation": "kane", "integrator": "BDF", "tolerance": 1e-8}
    found = (
        Record("stiff-truth", {"stiffness": 1e4}, errors={"uncertainty": 3e-11}),
        Record("stiff-truth", {"stiffness": 1e8}, "failed", "no truth"),
        stiff_run("DOP853", 1e4, 1e-3, 100),
        stiff_run("Radau", 1e4, 4e-3, 900),
        stiff_run("DOP853", 1e8, 8e-3, 800),
        stiff_run("Radau", 1e8, 2e-3, 600),
        stiff_run("Radau", 1e8, 4e-2, 1000, jacobian="differences"),
        stiff_run("Radau", 1e8, 1e-2, 250, jacobian="exact"),
        Record("stiff", settings | {"stiffness": 1e8, "jacobian": None}, "failed", "too slow"),
    )
    truth, *costs, crossover, jacobians, failures = tables("stiff", *found)
    assert truth == [("1e+04", "3.0e-11"), ("1e+08", "no truth")]
    titles = [sheet.title for sheet in study_of("stiff").tables(found)][1:5]
    rough = costs[2]
    assert titles[2].startswith("damped, kane") and titles[2].endswith("1e-03")
    assert ("DOP853", "1  100", "8  800") in rough and ("Radau", "4  900", "2  600") in rough
    assert costs[3] == [(row[0], "", "") for row in costs[3]], "none is right to 1e-6"
    at = {row[:3]: row[3:] for row in crossover}
    # The ratio of CPU times goes from 1/4 to 4, that of right-hand sides from 1/9 to 4/3.
    assert at["damped", "1e-03", "kane"] == ("1.0e+06", "3.4e+07")
    assert at["undamped", "1e-03", "kane"] == ("never", "never")
    assert jacobians == [
        ("Radau", "1e-04", "1e+08", "1000", "250", "75%", "40", "10", "75%", "5e-04", "5e-04")
    ]
    assert failures == [("damped", "kane", "BDF", "too slow", "1e+08 at 1e-08")]


def test_operations_tell_counts_systems_springs_and_savings():
    counts = [
        count_record(
            Operations("au", n, n + 2, n, 2, 10 * n, 5 * n, n, n, (System("A", 2 * n, 1),))
        )
        for n in range(2, 9)
    ]
    saving = Saving("a trailer", ("Q", "b"), "kane", (1200, 1500), (2e-6, 3e-6))
    savings = record_of_rows("operations", {"scene": "trailer"}, [saving])
    table, polynomials, totals, systems, saved = tables("operations", *counts, savings)
    assert table == [(str(n), str(16 * n)) for n in range(2, 9)]
    (row,) = polynomials
    assert row[0] == "au" and [x.replace(" ", "") for x in row[1:]] == ["10N", "5N", "N", "N"]
    assert totals == [("au", "16 N", "16/3 N³ + 6 N² - 7/3 N")]
    (solved,) = systems
    assert solved[:4] == ("au", "A", "2r", "1")
    assert solved[4] == "n + r: differs at N = 2, 3, 4, 5, 6, 7, 8"
    assert saved == [("kane", "1 200", "1 500", "300", "2", "3")]


def paper_state(key: str, links: int, multipliers: int, **orders: int) -> Record:
    settings = {"cell": "equations", "links": links, "formulation": key, "across": 0}
    counts = {"n": links + 2, "r": links, "degrees of freedom": 2, "multipliers": multipliers}
    counts |= {f"order of {name}": order for name, order in orders.items()}
    counts["final system"] = 3 * links
    return Record("paper", settings, counts=counts, errors={"bound": 1e-9}, series={"vdot": [1.0]})


def paper_motion(
    key: str, links: int, cpu: float | None, tolerance: float = 1e-3, error: float = 1.0
) -> Record:
    settings = {"cell": "motion", "links": links, "formulation": key}
    settings |= {"integrator": "RK45", "tolerance": tolerance}
    if cpu is None:
        return Record("paper", settings, "failed", "a_1 is singular", counts={"state": 4})
    series: dict[str, list] = {
        "times": [0.0, 0.21, 0.38, 0.6, 0.83, 1.0],
        "constraint": [0.0, 1e-9 * error, 3e-9 * error, 2e-9 * error, 0.0, 0.0],
        "energy": [0.0, 1e-7, -4e-7 * error, 2e-7, 0.0, 0.0],
        "q": [[i + k / 10 for k in range(9)] for i in range(6)],
    }
    errors = {"constraint": error * links * 1e-8, "energy": error * links * tolerance}
    errors["constraint allowed"] = 1e-12
    counts = {"state": links}
    return Record("paper", settings, cpu_seconds=cpu, counts=counts, errors=errors, series=series)


def test_the_paper_over_again_tells_systems_poses_errors_times_and_claims():
    found = (
        *(paper_state("au", n, n, A=2 * n + 2) for n in (7, 20, 40)),
        *(paper_state("kane", n, 3, M=2, W=n) for n in (7, 20, 40)),
        *(paper_motion("au", n, 2e-5 * n**2, x) for x in (1e-3, 1e-9) for n in (7, 20, 40)),
        *(paper_motion("kane", n, 5e-5 * n, error=0.1) for n in (7, 20, 40)),
        *(paper_motion("kane", n, cpu, 1e-9) for n, cpu in ((7, None), (20, 1e-3), (40, 8e-3))),
    )
    sheets = list(study_of("paper").tables(found))
    systems, poses, robot, constraint, energy, times, claims = tables("paper", *found)
    assert sheets[0].columns[3] == "last one at N = 40"
    assert systems == [
        ("au", "n + r", "A: n + r", "120", "acceleration level", "yes", "yes"),
        ("kane", "n - r", "M: n - r, then W: r", "120", "velocity level", "no", "yes"),
    ]
    at = ("0", "0.2", "0.4", "0.6", "0.8")
    assert poses == [(t, *(f"{i}.{k}00000" for k in range(9))) for i, t in enumerate(at)]
    assert [head.split()[0] for head in sheets[1].columns][1:4] == ["x", "y", "θ_1"]
    first, second = "RK45 1e-03", "RK45 1e-09"
    assert robot == [
        (first, "au", "3.00e-09", "7.00e-08", "4.00e-07", "7.00e-03"),
        (first, "kane", "3.00e-10", "7.00e-09", "2.00e-07", "7.00e-04"),
        (second, "au", "3.00e-09", "7.00e-08", "4.00e-07", "7.00e-09"),
    ]
    assert all(sheets[k].columns == ("solver", "N", "au", "kane") for k in (3, 4, 5))
    assert constraint == [
        (first, "7", "7.0e-08", "7.0e-09"),
        (first, "20", "2.0e-07", "2.0e-08"),
        (first, "40", "4.0e-07", "4.0e-08"),
        (second, "7", "7.0e-08", "-"),
        (second, "20", "2.0e-07", "2.0e-07"),
        (second, "40", "4.0e-07", "4.0e-07"),
    ]
    assert [row[2:] for row in energy] == [
        *[("7.0e-03", "7.0e-04"), ("2.0e-02", "2.0e-03"), ("4.0e-02", "4.0e-03")],
        *[("7.0e-09", "-"), ("2.0e-08", "2.0e-08"), ("4.0e-08", "4.0e-08")],
    ]
    assert times == [
        (first, "7", "980 µs (2.8)", "350 µs"),
        (first, "20", "8 ms (8.0)", "1 ms"),
        (first, "40", "32 ms (16.0)", "2 ms"),
        (second, "7", "980 µs", "-"),
        (second, "20", "8 ms (8.0)", "1 ms"),
        (second, "40", "32 ms (4.0)", "8 ms"),
        (first, "N^p", "2.00", "1.00"),
        (second, "N^p", "2.00", "3.00"),
    ]
    (freedom,) = [row for row in claims if row[0] == "Sec. 10"]
    assert freedom[1:] == (
        "The snake has two degrees of freedom, whatever N.",
        *("n - rank(a) is 2 at 3 values of N.", "holds", "a has full rank N."),
    )
    assert said("paper", *found)[-1] == "failed: kane, 7 links, RK45 1e-09: a_1 is singular"


# ---- Conformance ---------------------------------------------------------------------------------


@pytest.mark.parametrize("fault", [False, True])
def test_a_library_that_gives_no_answer_is_an_alarm_and_one_that_differs_is_none(fault: bool):
    row = ConformanceRow("a", "a 1", "arm", "bias", 2, "failed", None, "why", fault)
    found = record_of_rows("conformance", {"robot": "arm", "engine": "a", "states": 2}, [row])
    assert study_of("conformance").alarm([found]) == fault
    by_quantity, *_ = tables("conformance", found)
    assert by_quantity[1] == ("bias", f"{'no answer' if fault else 'differs'} on 1 of 1")
