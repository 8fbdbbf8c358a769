"""What studies measure and show: each number of a cell, with clocks and results made by hand."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict, dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.lab.test_tables import trajectory

from eomcheck.errors import InputError, RefusedError
from eomcheck.evaluation.dynamics import velocity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import UNDERFLOW
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.store.record_file import Record, record_of_rows
from eomcheck.lab.studies import accuracy, long_run, motion, rhs, work_precision
from eomcheck.lab.studies.stability import FAMILIES, families, two_wheels
from eomcheck.numbers.generic import EPS, FLOAT64
from eomcheck.scenes import SCENES, Bricard, Sleigh, Snake, bicycle

AU = FORMULATIONS["au"]


# ---- Accuracy ------------------------------------------------------------------------------------


def certified(**change: Any) -> Any:
    """Return what is certified of an acceleration whose true entries are at most 2."""
    usual = {"relative": 1e-14, "digits": 13.5, "ulps": np.array([1.0, 7.0, 3.0]), "kappa": 6.0}
    usual |= {
        "condition": {"M": 20.0, "a": 300.0, "C": 5.0},
        "ratio": 0.125,
        "relative_bound": 4e-14,
    }
    usual["truth"] = SimpleNamespace(doubles=lambda: np.array([-2.0, 1.0]))
    return SimpleNamespace(**(usual | change))


@pytest.mark.parametrize(("machine", "state"), [(0.5, ""), (1.0, ""), (1.5, "told"), (np.nan, "")])
def test_what_is_delivered_is_the_worst_entry_the_worst_matrix_and_shares_of_the_bound(
    monkeypatch, machine, state
):
    at: Any = SimpleNamespace(scene=Snake.coil(2), q=np.array([1.0]), u=np.array([2.0, 3.0]))
    monkeypatch.setattr(accuracy, "accuracy_at", lambda formulation, truth, at: certified())
    monkeypatch.setattr(accuracy, "_of_machine_code", lambda formulation, found, at: machine)
    found = accuracy._delivered(AU, None, at)  # type: ignore[arg-type]
    code = f"{at.scene!r}, q = [1.0], u = [2.0, 3.0]" if state else ""
    expected = ("au", 2, None, 13.5, 1e-14, 7.0, 300.0, 6.0, 0.125, 0.25, machine, code)
    assert repr(found) == repr(accuracy.Delivered(*expected))

    def refused(*arguments: Any) -> Any:
        raise RefusedError("a′", 1e-17, 1e-15, "singular")

    monkeypatch.setattr(accuracy, "accuracy_at", refused)
    found = accuracy._delivered(AU, None, at)  # type: ignore[arg-type]
    assert repr(found) == repr(accuracy.Delivered("au", 2, "a′"))


def test_a_bound_is_never_below_what_underflows():
    assert accuracy._bound(certified()) == 4e-14
    assert accuracy._bound(certified(relative_bound=0.0)) == UNDERFLOW / 2.0
    nothing = SimpleNamespace(doubles=lambda: np.zeros(2))
    assert accuracy._bound(certified(relative_bound=0.0, truth=nothing)) == 1.0


def test_machine_code_is_held_against_the_truth_at_its_own_state(monkeypatch):
    at, other = SimpleNamespace(scene="scene", q="q", t="t"), SimpleNamespace(v="v")
    made = certified(relative_bound=1e-14)
    near = certified(relative_bound=2e-15)
    asked: list[Any] = []

    def here(scene, key, q, *, t, v):
        asked.append((scene, key, q, t, v))
        return near

    code = {"value": np.array([1.0])}
    monkeypatch.setattr(accuracy, "as_integrated", lambda at, formulation: (other, "y"))
    monkeypatch.setattr(accuracy, "accuracy", here)
    monkeypatch.setattr(accuracy, "acceleration_in_machine_code", lambda *given: code["value"])
    monkeypatch.setattr(accuracy, "relative_error", lambda x, truth: 1e-14 * float(x[0]))
    of: Any = accuracy._of_machine_code
    assert of(AU, made, at) == pytest.approx(5.0)
    assert asked == [("scene", "au", "q", "t", "v")]
    monkeypatch.setattr(accuracy, "as_integrated", lambda at, formulation: (at, "y"))
    assert of(AU, made, at) == pytest.approx(1.0) and len(asked) == 1
    code["value"] = np.array([1.0, np.inf])
    assert np.isnan(of(AU, made, at))


def test_cells_of_accuracy_are_a_state_each_and_all_alike_but_for_its_number():
    found = list(accuracy.cells(links="3..5", examples=2, seed=4, hostile=True))
    low, high = found[0]["links"]
    assert (low, high) == (3, 5)
    rest = {"links": found[0]["links"], "examples": 2, "seed": 4, "hostile": True}
    assert found == [rest | {"state": 0}, rest | {"state": 1}]
    usual = list(accuracy.cells())
    assert len(usual) == 200 and tuple(usual[-1]["links"]) == (1, 30)
    assert (usual[-1]["seed"], usual[-1]["hostile"], usual[-1]["state"]) == (0, False, 199)
    with pytest.raises(InputError, match="examples = 0"):
        list(accuracy.cells(examples=0))


def test_accuracy_tells_results_without_error_and_alarms_at_what_is_beyond_its_bound():
    one = accuracy.Delivered("im", 2, None, 15.0, 1e-15, 2.0, 3.0, 4.0, 0.25)
    exact, refused = replace(one, relative=0.0), accuracy.Delivered("im", 2, "M")
    found = record_of_rows("accuracy", {}, [one, exact, exact, refused])
    (said,) = accuracy.remarks([found, found])
    assert said.startswith("2 states; errors against the enclosed truth. Left out: 4 results ")
    assert "ratio" not in said and "Largest error / (κ ε scale): 0.25;" in said
    nothing = record_of_rows("accuracy", {}, [refused])
    (said,) = accuracy.remarks([nothing])
    assert "0 results without error" in said and "(κ ε scale): 0;" in said
    assert not accuracy.alarm([found])
    broken = Record("accuracy", {"x": 1}, "failed", "why")
    assert accuracy.alarm([found, broken])
    assert accuracy.alarm([found, record_of_rows("accuracy", {}, [replace(one, state="here")])])
    assert next(iter(accuracy.remarks([broken, found]))) == "x 1 failed: why"
    digits, errors = accuracy.tables([found])
    assert (digits.name, errors.name) == ("digits", "errors")
    assert list(digits.columns) == [
        *("formulation", "solved", "refused", "κ infinite"),
        *("certified digits: fewest", "median", "ulps: median"),
    ]
    assert list(errors.columns) == [
        *("formulation", "condition: median", "largest", "error / (κ ε scale): median", "largest"),
        *("largest error / bound", "in machine code", "no number"),
    ]
    assert [row[:4] for row in digits.rows] == [("im", "1", "1", "0")]
    (row,) = next(iter(accuracy.tables([nothing]))).rows
    assert row == ("im", "0", "1", "0", "", "", "")


# ---- Long runs -----------------------------------------------------------------------------------


def test_a_long_run_is_the_paper_s_robot_with_its_remedy_and_every_number_of_it(monkeypatch):
    times = np.array([0.5, 1.0, 2.0, 4.0])
    start = long_run._start_energy(Sleigh.example())
    found = trajectory(
        times=times,
        q=np.zeros((4, 3)),
        v=np.zeros((4, 3)),
        energy=start * (1 + np.array([1e-6, -2e-6, 4e-6, -8e-6])),
        constraint_residual=np.array([[1e-9], [-1e-9], [1e-9], [1e-9]]),
    )
    asked: list[Any] = []

    def simulate(scene, key, end, **how):
        asked.append((scene, key, end, how))
        return found

    clock = iter([10.0, 10.75])
    monkeypatch.setattr(long_run, "simulate", simulate)
    monkeypatch.setattr(long_run.time, "thread_time", lambda: next(clock))
    settings = {"formulation": "kane", "remedy": "feedback", "t_end": 4.0, "tolerance": 1e-5}
    record = long_run._long_run(settings)
    ((scene, key, end, how),) = asked
    output = how.pop("output_times")
    assert (scene.structure, key, end) == (Snake.paper().structure, "kane", 4.0)
    assert how == {"rtol": 1e-5, "atol": 1e-5, "integrator": "DOP853", "baumgarte": 10.0}
    assert (len(output), output[0], output[-1]) == (200, 0.5, pytest.approx(3.5))
    assert np.ptp(np.diff(np.log(output))) < 1e-9
    assert long_run.REMEDIES == {
        **{"none": {}, "feedback": {"baumgarte": 10.0}, "projection": {"projection": 1.0}}
    }
    assert (record.study, record.settings, record.status) == ("long-run", settings, "done")
    assert (record.seconds, record.cpu_seconds, record.runs) == (1.25, 0.75, 1)
    assert record.counts == {"right-hand sides": 77, "steps": 9}
    energy = pytest.approx([1e-6, 2e-6, 4e-6, 8e-6])
    assert record.series == {"times": times.tolist(), "constraint": [1e-9] * 4, "energy": energy}
    assert record.errors == {
        **{"constraint_exponent": pytest.approx(0.0, abs=1e-9), "constraint_end": 1e-9},
        **{"constraint_rate": record.errors["constraint_rate"], "constraint_largest": 1e-9},
        **{"energy_exponent": record.errors["energy_exponent"], "energy_rate": pytest.approx(2e-6)},
        **{"energy_end": pytest.approx(8e-6), "energy_largest": pytest.approx(8e-6)},
    }


def test_a_long_run_that_stops_at_once_has_no_errors_and_its_reason(monkeypatch):
    none = np.zeros(0)
    found = trajectory(
        times=none,
        q=np.zeros((0, 3)),
        v=np.zeros((0, 3)),
        energy=none,
        constraint_residual=np.zeros((0, 1)),
        status="failed",
        reason="singular",
    )
    monkeypatch.setattr(long_run, "simulate", lambda *given, **how: found)
    settings = {"formulation": "el", "remedy": "none", "t_end": 4.0, "tolerance": 1e-5}
    record = long_run._long_run(settings)
    assert (record.status, record.reason, record.errors) == ("failed", "singular", {})


def test_cells_tables_and_charts_of_long_runs_name_remedies_and_axes():
    how = {"t_end": 30.0, "tolerance": 1e-6}
    assert list(long_run.cells(quick=True)) == [
        {"formulation": key, "remedy": remedy} | how
        for key, remedy in (
            *(("au", "none"), ("kane", "none"), ("au", "feedback"), ("au", "projection")),
        )
    ]
    usual = next(iter(long_run.cells(tolerance=1e-3)))
    assert (usual["t_end"], usual["tolerance"]) == (1000.0, 1e-3)
    assert next(iter(long_run.cells(quick=True, end=5.0)))["t_end"] == 5.0
    for wrong in ({"end": 2.0}, {"tolerance": 1.0}, {"end": np.inf}):
        with pytest.raises(InputError, match=f"{next(iter(wrong))} = {next(iter(wrong.values()))}"):
            list(long_run.cells(**wrong))
    (sheet,) = long_run.tables([])
    assert (sheet.name, sheet.title) == ("long-run", "Laws of growth: rate · T (t/T)^exponent")
    assert list(sheet.columns) == [
        *("formulation", "remedy", "constraint at the end", "exponent", "rate per s"),
        *("energy at the end", "exponent", "rate per s", "right-hand sides", "CPU s"),
    ]
    (chart,) = long_run.charts([])
    assert (chart.name, chart.title, chart.lists) == (
        *("long-run", "Errors of the paper's robot over 1 000 s"),
        ["error", "remedy"],
    )
    titles = [panel.title for panel in chart.panels.values()]
    assert titles == ["nothing added", "feedback, 10/s", "projection every 1 s"] * 2
    panels: Any = chart.panels.items()
    assert all(
        (panel.x[:2], panel.y[:2]) == (("t / s", True), (long_run.SO_FAR.format(label), True))
        for (label, _), panel in panels
    )
    times = [1.0, 2.0, 3.0, 4.0]
    series = {"times": times, "constraint": [0.0] * 4, "energy": [0.5, 0.25, 0.75, 0.0]}
    keys = list(FORMULATIONS)
    two = [
        Record("long-run", {"formulation": key, "remedy": "none"}, series=series)
        for key in (keys[4], keys[1])
    ]
    (chart,) = long_run.charts(two)
    panel: Any = chart.panels["|E - E₀| / E₀", "none"]
    assert [(line.key, line.every) for line in panel.lines] == [
        (keys[1], (3, 30)),
        (keys[4], (12, 30)),
    ]
    # The largest error so far.
    assert [(line.x, line.y) for line in panel.lines] == [(times, [0.5, 0.5, 0.75, 0.75])] * 2
    assert long_run.find_run(two, keys[1], "none") is two[1]
    assert long_run.find_run(two, keys[1], "feedback") is None


def test_the_energy_at_the_start_is_kinetic_and_potential():
    assert long_run._start_energy(Sleigh.example()) > 0
    scene = Snake.paper()
    q, v = scene.initial_state()
    at = scene.parameters(FLOAT64)
    T, U = scene.energies(at, scene.prepare(FLOAT64, at, q, 0.0), q, v)
    assert U is not None and long_run._start_energy(scene) == pytest.approx(float(T + U))


# ---- Times of motions ----------------------------------------------------------------------------


def test_motions_are_timed_in_rounds_and_the_best_of_each_integrator_counts(monkeypatch):
    made: list[Any] = []

    class Fake:
        def __init__(self, scene, formulation, q, v):
            made.append((scene, formulation.key, len(q), len(v)))
            self.formulation, self.rates = formulation, SimpleNamespace(calls=10 * len(made))
            self.y0 = "y0"

        def solve(self, end, *, rtol, atol):
            assert (end, rtol, atol) == (1.0, 1e-12, 1e-12)
            return SimpleNamespace(success=self.formulation.key != "el")

    python = {"au": [9.0, 8.0, 7.0, 7.5, 8.5, 9.5], "kane": [2.0, 1.0, 3.0, 4.0, 5.0, 6.0]}
    cyrk = {"au": [0.5, 0.4, 0.3, 0.2, 0.6, 0.7], "kane": [0.05] * 5 + [0.01]}
    turns: list[tuple[str, int]] = []

    def measure(one):
        key = one.formulation.key
        turn = Counter(key for key, _ in turns)[key]
        turns.append((key, turn))
        return motion.MotionTime(key, cyrk[key][turn], one.rates.calls, python[key][turn])

    monkeypatch.setattr(motion, "Motion", Fake)
    monkeypatch.setattr(motion, "_measure", measure)
    settings = {"formulations": ["au", "el", "kane"], "scene": "sleigh"}
    record = motion.time_motion(settings)
    assert (record.study, record.settings) == ("motion", settings)
    heads = "seconds", "right_hand_sides", "seconds_in_python"
    rows = {one["formulation"]: tuple(one[x] for x in heads) for one in record.series["rows"]}
    assert [*rows] == ["el", "au", "kane"]
    assert (rows["au"], rows["kane"]) == ((0.2, 10, 7.0), (0.01, 30, 1.0))
    assert np.isnan(rows["el"][0]) and rows["el"][1] == 20 and np.isnan(rows["el"][2])
    assert turns == [(key, turn) for turn in range(6) for key in ("au", "kane")]
    assert {type(scene) for scene, *_ in made} == {Sleigh}
    assert [key for _, key, *_ in made] == ["au", "el", "kane"]


def test_a_motion_is_timed_by_five_runs_of_cyrk_and_two_of_scipy_at_one_tolerance(monkeypatch):
    asked: list[Any] = []

    class Rates:
        calls = 0

    def solve(end, *, rtol, atol):
        asked.append((end, rtol, atol))
        Rates.calls = 123

    one: Any = SimpleNamespace(formulation=AU, rates=Rates, solve=solve, y0="y0")

    def timed(work, *, runs):
        work()
        asked.append(runs)
        return SimpleNamespace(seconds=runs / 10)

    def by_scipy(rates, span, start, **how):
        Rates.calls = 999
        asked.append((rates, span, start, how))

    monkeypatch.setattr(motion, "run_time", timed)
    monkeypatch.setattr("scipy.integrate.solve_ivp", by_scipy)
    assert motion._measure(one) == motion.MotionTime("au", 0.5, 123, 0.2)
    how = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-12}
    assert asked == [(1.0, 1e-12, 1e-12), 5, (Rates, (0.0, 1.0), "y0", how), 2]


def test_a_table_of_motions_names_each_scene_once_and_what_does_not_reach_the_end():
    row = motion.MotionTime("kane", 2e-3, 4000, 9e-3)
    never = replace(row, formulation="el", seconds=np.nan)
    found = [
        record_of_rows("motion", {"a": 1}, [row]),
        record_of_rows("motion", {"scene": "sleigh", "a": 1}, [row, never]),
        record_of_rows("motion", {"scene": "sleigh", "a": 2}, [replace(never, formulation="ml")]),
    ]
    (sheet,) = motion.tables(found)
    assert (sheet.name, sheet.title) == ("motion", "Time of a motion")
    heads = ["formulation", "CyRK", "right-hand sides", "each", "SciPy", "ratio"]
    assert list(sheet.columns) == heads
    assert sheet.rows == [("kane", "2 ms", "4,000", "500 ns", "9 ms", "4.5")] * 2
    assert sheet.note == (
        "Best time of 1 s of the paper's robot, sleigh by DOP853, rtol = atol = 1e-12, with the "
        "same right-hand side in machine code. Do not reach the end: el, ml."
    )
    (sheet,) = motion.tables(found[:1])
    assert sheet.note.endswith("paper's robot by DOP853, rtol = atol = 1e-12, with the same "
                               "right-hand side in machine code.")  # fmt: skip
    (cell,) = motion.cells(formulation=["kane", "au"])
    assert cell == {"formulations": ["kane", "au"], "end": 1.0, "tolerance": 1e-12}
    (cell,) = motion.cells(scene="sleigh")
    assert (cell["scene"], "banded" in cell["formulations"]) == ("sleigh", False)


# ---- Times of right-hand sides -------------------------------------------------------------------


def test_batches_take_so_long_as_they_should_and_are_taken_in_turn(monkeypatch):
    now = [100.0]
    cost = {"slow": 0.5, "quick": 1e-4}
    calls: list[tuple[str, int]] = []
    told: list[float] = []

    def call(name: str) -> rhs.Call:
        def called(count: int) -> None:
            calls.append((name, count))
            now[0] += cost[name] * count

        return called

    def jobs():
        now[0] += 3.0  # what making the first takes
        yield "slow", 7, call("slow")
        now[0] += 2.0
        yield "quick", 0, call("quick")

    monkeypatch.setattr(rhs.time, "perf_counter", lambda: now[0])
    found = rhs.time_calls("snake", jobs(), 3, lambda: told.append(now[0]))
    batches = [("slow", 1), ("quick", 200)] * 3
    assert calls == [*[("slow", 1)] * 3, ("quick", 1), *[("quick", 200)] * 2, *batches]
    assert len(told) == 2 + 6
    slow, quick = found
    assert (slow.scene, slow.what, slow.links) == ("snake", "slow", 7)
    assert slow.seconds == pytest.approx(0.5) and slow.quartiles == pytest.approx((0.5, 0.5))
    assert (slow.compile_seconds, quick.compile_seconds) == pytest.approx((3.0, 2.0))
    assert (quick.what, quick.links, quick.seconds) == ("quick", 0, pytest.approx(1e-4))


def test_a_time_is_the_median_of_its_batches_between_their_quartiles():
    found = rhs._timing("s", "au", 7, [5.0, 1.0, 3.0, 2.0, 4.0, 6.0, 7.0], 0.25)
    assert asdict(found) == {
        **{"scene": "s", "what": "au", "links": 7, "seconds": 4.0, "quartiles": (2.0, 6.0)},
        "compile_seconds": 0.25,
    }
    assert rhs._timing("s", "au", 7, [5.0], 0.25).quartiles == (5.0, 5.0)


def test_snakes_are_timed_coiled_and_other_scenes_at_a_state_of_their_own():
    scene, q, u = rhs.bench_state(Snake, 4, {"mass": [3.0]})
    assert isinstance(scene, Snake)
    assert (scene.mass.tolist(), scene.length.tolist()) == ([3.0] * 4, [1.0] * 4)
    assert np.allclose(scene.inertia, 1 / 12) and scene.stiffness.tolist() == [10.0] * 3
    assert np.allclose(scene.wheel_angle, 0.2 * np.cos(np.arange(4)))
    assert np.allclose(np.degrees(q), [0, 0, 44, 88, 132, 176]) and u.tolist() == [1.0, 0.3]
    scene, q, u = rhs.bench_state(Sleigh, None, {"offset": [0.5]})
    assert isinstance(scene, Sleigh) and scene.offset == 0.5
    assert (q.shape, u.shape) == ((scene.n,), (scene.p,))


@pytest.mark.parametrize(
    ("links", "keys", "whats"),
    [
        ([200], None, ["sin, cos", *FORMULATIONS, "kane, 8 lanes", "casadi, C", "pinocchio"]),
        ([201], None, ["sin, cos", "kane", "banded"]),
        ([201], ["au", "kane"], ["sin, cos", "au", "kane"]),
        ([7], ["au"], ["sin, cos", "au", "casadi, C", "pinocchio"]),
    ],
)
def test_what_costs_cubes_is_timed_of_small_snakes_alone_unless_it_is_named(
    monkeypatch, links, keys, whats
):
    def state(kind, n, given):
        assert (kind, given) == (Snake, {})
        return f"snake of {n}", "q", "u"

    monkeypatch.setattr(rhs, "bench_state", state)
    monkeypatch.setattr(rhs, "_angles", lambda scene, q: np.ones(3))
    monkeypatch.setattr(rhs, "sincos_timing_loop", lambda angles: "sines")
    monkeypatch.setattr(rhs, "_formulation_call", lambda f, *at: (f.key, *at))
    monkeypatch.setattr(rhs, "_lanes_call", lambda f, *at: ("lanes", f.key, *at))
    monkeypatch.setattr(rhs, "_casadi_call", lambda *at: ("casadi", *at))
    monkeypatch.setattr(rhs, "_pinocchio_call", lambda *at: ("pinocchio", ("pin", *at)))
    monkeypatch.setattr(rhs.PinocchioEngine, "represents", classmethod(lambda cls, scene: True))
    jobs: list[Any] = []

    def timed(scene, made, repeats, advance):
        jobs.extend(made)
        return [rhs.Timing(scene, "all", repeats, 1.0, (1.0, 1.0), 0.0)]

    monkeypatch.setattr(rhs, "time_calls", timed)
    settings = {"scene": "snake", "links": links, "formulations": keys, "repeats": 5}
    record = rhs.worker([])(settings)
    assert [what for what, *_ in jobs] == whats
    assert {size for _, size, _ in jobs} == {*links}
    at = (f"snake of {links[0]}", "q", "u")
    told = {what: call for what, _, call in jobs}
    assert told["sin, cos"] == "sines"
    if "au" in told:
        assert told["au"] == ("au", *at)
    if links == [200]:
        assert told["kane, 8 lanes"] == ("lanes", "kane", *at)
        assert (told["casadi, C"], told["pinocchio"]) == (("casadi", *at), ("pin", *at))
    assert (record.study, record.settings) == ("rhs", settings)
    assert record.series["rows"][0]["links"] == 5


def test_tables_of_right_hand_sides_have_a_slope_and_a_note_only_where_they_say_something():
    rows = [
        rhs.Timing("snake", "sin, cos", 7, 1e-6, (0.0, 0.0), 0.5),
        rhs.Timing("snake", "kane", 7, 2.5e-6, (0.0, 0.0), 0.25),
        rhs.Timing("snake", "kane", 100, 2e-6, (0.0, 0.0), 1.0),
        rhs.Timing("sleigh", "kane", 0, 2e-6, (0.0, 0.0), 1.0),
    ]
    snake, sleigh = rhs.tables([record_of_rows("rhs", {}, rows)])
    assert (snake.name, sleigh.name) == ("rhs-snake", "rhs-sleigh")
    assert snake.title == "Median time of one right-hand side, snake"
    assert list(snake.columns) == ["right-hand side", "N = 7", "N = 100", "making it"]
    assert list(sleigh.columns) == ["right-hand side", "sleigh", "making it"]
    assert list(map(tuple, snake.rows)) == [
        ("sin, cos", "1 µs (1 ×)", "", "500 ms"),
        ("kane", "2.5 µs (2.5 ×)", "2 µs", "1 s"),
    ]
    assert snake.note.startswith("In brackets the ratio to the sines") and sleigh.note == ""
    more = [*rows, replace(rows[1], links=1000, seconds=2e-4)]
    snake, _ = rhs.tables([record_of_rows("rhs", {}, more)])
    assert snake.columns[-2] == "slope, N >= 100" and snake.rows[1][-2] == "2.000"


def test_cells_of_right_hand_sides_are_a_kind_of_scene_each():
    (cell,) = rhs.cells()
    assert cell == {
        **{"scene": "snake", "links": (7, 20, 100, 1000, 10000)},
        **{"formulations": None, "repeats": 15},
    }
    (cell,) = rhs.cells(scene="chain-pendulum", formulation=["au"], repeats=2, set=["mass=2"])
    assert cell == {
        **{"scene": "chain-pendulum", "links": (3,), "formulations": ["au"]},
        **{"repeats": 2, "set": ["mass=2"]},
    }
    (cell,) = rhs.cells(scene="sleigh")
    assert cell["links"] == (None,)
    for wrong, says in (
        ({"links": [3, 0]}, "links = 0"),
        ({"repeats": 0}, "repeats = 0"),
        ({"scene": "sleigh", "links": [2]}, r"links = \[2\]: sleigh has no number of links"),
        ({"scene": "sleigh", "set": ["mas=1"]}, "mas"),
    ):
        with pytest.raises(InputError, match=says):
            list(rhs.cells(**wrong))


# ---- States of growing severity ------------------------------------------------------------------


def posed(key: str, variant: str, severity: float) -> Any:
    return FAMILIES[key].pose(variant, severity)


def test_a_first_mass_is_times_or_over_its_ratio_and_the_others_stay():
    plain = Sleigh.example()
    for variant, mass in (("heavier", 100.0 * plain.mass), ("lighter", plain.mass / 100.0)):
        one = posed("sleigh-mass", variant, 100.0)
        assert float(one.scene.mass) == pytest.approx(mass)
        assert one.scene.offset == plain.offset
    chain = SCENES["chain-pendulum"].example()
    one = posed("chain-pendulum-mass", "heavier", 10.0)
    assert (one.scene.mass / chain.mass).tolist() == [10.0] + [1.0] * (len(chain.mass) - 1)


def test_speeds_are_times_or_over_their_factor_and_turns_are_of_angles_alone():
    scene = Sleigh.example()
    q, u = families.ordinary(scene)
    assert u.tolist() == [1 / k for k in range(1, scene.p + 1)]
    fast, slow = (posed("sleigh-speed", variant, 100.0) for variant in ("fast", "slow"))
    assert (fast.u / u).tolist() == [100.0] * scene.p and np.allclose(slow.u, u / 100)
    assert fast.q.tolist() == q.tolist() and fast.v is None
    turned = posed("sleigh-turns", "all alike", 3.0)
    away = turned.q - q
    angles = np.zeros(scene.n)
    angles[scene.angle_coordinates] = 6 * np.pi
    assert np.allclose(away, angles) and angles.any() and not angles.all()
    assert turned.u.tolist() == u.tolist()


def test_every_constraint_is_violated_by_the_same_share_of_the_largest_speed():
    scene = SCENES["rolling-disk"].example()
    q, u = families.ordinary(scene)
    v = velocity(scene, q, u)
    one = posed("rolling-disk-violated", "all alike", 1e-3)
    assert one.u is None and one.q.tolist() == q.tolist()
    rates = Evaluation(scene, q, v).terms.a @ (one.v - v)
    assert rates == pytest.approx(np.full(scene.r, 1e-3 * np.abs(v).max()))


def test_single_scenes_come_to_their_limits_step_by_step():
    for variant, sign in (("+π/2", 1), ("-π/2", -1)):
        lean = posed("rolling-disk-flat", variant, 0.125).q[3]
        assert lean == pytest.approx(sign * (np.pi / 2 - 0.125))
    line = posed("four-bar-chain-in-line", "moving", 0.25)
    assert (line.scene.angle, line.scene.links, set(line.u)) == (0.25, 3, {1.0})
    assert posed("sleigh-offset", "moving", 0.5).scene.offset == 0.5
    assert posed("chain-pendulum-links", "moving", 5.0).scene.links == 5
    assert posed("andrews-stiffness", "moving", 7.0).scene.stiffness == 7.0
    stretched = posed("bricard-stretched", "moving", 0.25)
    closed, _ = Bricard().closed_state(-np.pi / 6 + 0.25, 0.0)
    assert (stretched.q.tolist(), stretched.u.tolist()) == (closed.tolist(), [1.0])
    lying = posed("bicycle-lying", "moving", 0.3)
    assert lying.q[bicycle.LEAN] == 0.3
    assert lying.q[bicycle.HEIGHT] == pytest.approx(lying.scene.radius[0] * np.sin(0.3))
    assert lying.u.tolist() == [1 / k for k in range(1, lying.scene.p + 1)]
    assert families._two_wheels("at rest", 0.1).u.tolist() == [0.0]
    assert families._two_wheels("moving", 0.1).u.tolist() == [1.0]
    assert families._two_wheels("moving", 0.1).scene.second == 0.1


def test_families_of_a_scene_have_their_severities_and_a_title_after_it():
    found = {key: one for key, one in FAMILIES.items() if one.about == "sleigh"}
    assert [*found].pop() == "sleigh-offset" and found.pop("sleigh-offset")
    assert {
        key: (one.values[0], one.values[-1], len(one.values)) for key, one in found.items()
    } == {
        "sleigh-mass": (1.0, 1e16, 17),
        "sleigh-speed": (1.0, 1e170, 18),
        "sleigh-turns": (1.0, 1e15, 16),
        "sleigh-violated": (1e-16, 1.0, 17),
    }
    assert [one.quick for one in found.values()] == [
        (1.0, 1e8, 1e16),
        (1.0, 1e100, 1e170),
        (1.0, 1e8),
        (1e-16, 1e-8, 1.0),
    ]
    assert found["sleigh-mass"].title == "sleigh: mass"
    assert (FAMILIES["dependent"].title, FAMILIES["dependent"].about) == (
        *("Dependent constraints", "snake"),
    )
    free = [key for key, one in FAMILIES.items() if one.about == "chain-pendulum"]
    assert free == [f"chain-pendulum-{name}" for name in ("mass", "speed", "turns", "links")]


def test_speeds_of_two_wheels_are_refused_where_their_angle_is_rounding():
    scene, q = two_wheels.TwoWheels(Snake.coil(3), 0.0), np.zeros(5)
    for second, refused in ((0.0, True), (4 * EPS, True), (np.pi, True), (4.1 * EPS, False)):
        scene.second = second
        if refused:
            with pytest.raises(RefusedError, match=r"the two wheels of link 1 are one") as error:
                scene.refuse_speeds(q)
            assert (error.value.what, error.value.threshold) == ("sin second", 4 * EPS)
        else:
            scene.refuse_speeds(q)
    assert (scene.name, scene.constraint_names[-2:]) == (
        *("two-wheels[3]",),
        ("wheel 3", "second wheel"),
    )


# ---- Work and precision --------------------------------------------------------------------------


def test_a_run_is_integrated_to_the_end_of_its_reference_compared_and_timed(monkeypatch):
    scene, asked = Sleigh.example(), []
    q0, _ = scene.initial_state()
    reference = SimpleNamespace(
        scene=scene, q0=q0, u0=np.array([1.0, 0.5]), times=np.array([0, 2, 4.0])
    )
    found = {"run": trajectory()}

    @dataclass
    class Errors:
        final: float = 1e-7

    def ready(scene, key, q, v, u):
        asked.append(("ready", key, np.allclose(v, velocity(scene, q, u)), u is reference.u0))
        motion = SimpleNamespace(
            every_step=lambda *given, **how: asked.append(("every step", *given, how)),
            solve=lambda *given, **how: asked.append(("solve", *given, how)),
        )
        return motion, 0.5

    def trajectory_of(motion, steps, integrator, rtol, atol, seconds, every):
        asked.append((integrator, rtol, atol))
        return found["run"]

    def run_time(work, *, runs):
        work()
        recorded = {"seconds": 3.0, "cpu_seconds": 2.0, "runs": runs}
        return SimpleNamespace(recorded=lambda: recorded)

    drift = SimpleNamespace(rate=2e-9, exponent=1.5)
    of, timing = "eomcheck.lab.studies.work_precision.", "eomcheck.lab.study."
    monkeypatch.setattr(f"{of}stored_reference", lambda *of: asked.append(of) or reference)
    monkeypatch.setattr(f"{of}prepare_motion", ready)
    monkeypatch.setattr(f"{timing}trajectory_of", trajectory_of)
    monkeypatch.setattr(f"{timing}run_time", run_time)
    monkeypatch.setattr(f"{of}errors_of", lambda run, of: Errors())
    monkeypatch.setattr(
        f"{of}DRIFTS", {"constraint": lambda run: None, "energy": lambda run: drift}
    )
    work = work_precision.worker([], references="folder", scene="x.py:X")  # type: ignore[arg-type]
    settings = {"reference": "own", "formulation": "kane", "integrator": "BDF", "tolerance": 1e-5}
    record = work(settings)
    options = {"integrator": "BDF", "rtol": 1e-5, "atol": 1e-5}
    times = {"output_times": reference.times}
    assert asked == [
        ("own", "folder", "x.py:X"),
        ("ready", "kane", True, True),
        ("every step", 4.0, times | options),
        ("solve", 4.0, times | options),
        ("BDF", 1e-5, 1e-5),
        ("solve", 4.0, times | options),
    ]
    assert (record.status, record.seconds, record.cpu_seconds) == ("done", 3.0, 2.0)
    assert (record.runs, record.compile_seconds) == (work_precision.RUNS, 0.5)
    assert record.counts == {"right-hand sides": 77, "steps": 9}
    assert record.errors == {"final": 1e-7, "energy_drift": 2e-9, "energy_exponent": 1.5}
    found["run"] = trajectory(status="failed", reason="too stiff")
    record = work(settings | {"tolerance": 1e-3})
    assert (record.status, record.reason, record.errors) == ("failed", "too stiff", {})
    assert (record.seconds, record.counts["steps"]) == (None, 9)
    assert len(asked) == 9, "the code is made once, and what fails is not timed"


def test_why_an_error_has_no_panel_is_said_with_the_reason_of_its_scene():
    assert work_precision._absent("none such", ["final", "energy", "constraint"]) == ""
    said = work_precision._absent("none such", ["final"])
    assert said == "energy is not conserved; no constraints"
    assert work_precision._absent("paper-rest", ["final", "energy"]) == "no constraints"
