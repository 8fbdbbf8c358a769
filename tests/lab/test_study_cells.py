"""Studies' cells, what is measured in them and drawn of it, held against numbers made by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eomcheck.errors import EomcheckError, InputError
from eomcheck.lab.show.chart import Panel
from eomcheck.lab.store.record_file import Record, Records, record_of_rows
from eomcheck.lab.studies import operations, study_of
from eomcheck.lab.studies import stiff as stiff
from eomcheck.lab.studies.operations import measure
from eomcheck.lab.studies.operations.measure import Operations, Saving, Springs, count_record
from eomcheck.lab.study import run_cells
from eomcheck.numbers.counting import System
from eomcheck.numbers.generic import EPS
from eomcheck.scenes import Sleigh, Snake

# ---- Operations ----------------------------------------------------------------------------------


def counted(key: str, links: int, *of: int) -> Record:
    """Return a count: additions, multiplications, divisions, sines, and the order solved."""
    *numbers, order = of
    solves = (System("A", order, 3),) if order else ()
    return count_record(Operations(key, links, links + 2, links, 2, *numbers, solves))


COUNTS = (
    counted("au", 3, 1100, 70, 5, 3, 4),
    counted("au", 2, 40, 20, 2, 2, 0),
    counted("kane", 2, 7, 30, 1, 4, 2),
    counted("kane", 3, 8, 28, 4, 9, 2),
)


def test_operations_are_drawn_over_the_links_without_those_that_are_none():
    (chart,) = study_of("operations").charts(COUNTS)
    drawn = {}
    for chosen, panel in chart.panels.items():
        assert isinstance(panel, Panel) and panel.y.log and panel.x.log
        drawn[chosen] = [(line.key, line.x, line.y) for line in panel.lines]
    # LU of order 4 with 3 right-hand sides: 34 + 84; of order 2: 3 + 18.
    assert drawn == {
        ("all operations",): [("au", [2, 3], [62, 1175 + 118]), ("kane", [2, 3], [59, 61])],
        ("outside of solves",): [("au", [2, 3], [62, 1175]), ("kane", [2, 3], [38, 40])],
        ("solves, by LU",): [("au", [3], [118]), ("kane", [2, 3], [21, 21])],
    }
    panel = chart.panels["solves, by LU",]
    assert isinstance(panel, Panel)
    assert [line.hover_text[0] for line in panel.lines] == [
        [
            *("au, N = 3", "1 100 additions", "70 multiplications", "5 divisions"),
            *("3 pairs of sin and cos", "118 in solves"),
        ],
        [
            *("kane, N = 2", "7 additions", "30 multiplications", "1 divisions"),
            *("4 pairs of sin and cos", "21 in solves"),
        ],
    ]
    assert [*study_of("operations").charts(())] == []


def test_operations_as_a_document_hold_counts_coefficients_and_systems():
    records = [counted("em", n, n * n - 3, 7 * n, 1, n, n + 2) for n in (2, 3, 4, 5, 6)]
    found = study_of("operations").document(records)
    assert found["operations"][1] == {
        **{"formulation": "em", "links": 3, "n": 5, "r": 3, "s": 2},
        **{"additions": 6, "multiplications": 21, "divisions": 1, "trigonometric_pairs": 3},
        "solves": [{"name": "A", "order": 5, "columns": 3, "half": None}],
    }
    (polynomials,) = found["polynomials"]
    assert polynomials["formulation"] == "em"
    of = polynomials["coefficients"]
    assert of["additions"] == ["-3", "0", "1"] and of["sin and cos"] == ["0", "1"]
    assert found["systems"] == [
        {
            **{"formulation": "em", "matrix": "A", "order in n, r": (1, 0), "final": True},
            **{"right-hand sides": ["3"], "differing from Table I": (2, 3, 4, 5, 6)},
        }
    ]
    saving = Saving("a trailer", ("Q",), "kane", (12, 15), None)
    saved = record_of_rows("operations", {"scene": "trailer"}, [saving])
    assert [one["operations"] for one in study_of("operations").document([saved])["savings"]] == [
        [12, 15]
    ]


def test_springs_are_told_beside_what_their_terms_take_alone():
    rows = [
        Springs("au", 7, (1010, 20, 3), (4, 12, 3), (1006, 8, 0)),
        Springs("el", 7, (10, 20, 3), (4, 12, 2), (6, 8, 0)),
        Springs("au", 3, (5, 5, 5), (5, 5, 5), (0, 0, 0)),
    ]
    found = record_of_rows("operations", {"springs": "present, absent, alone"}, rows)
    three, seven = study_of("operations").tables([found])
    assert (three.name, seven.name) == ("springs-3", "springs-7")
    assert [tuple(row) for row in seven.rows] == [
        ("au", "1 010, 20, 3", "4, 12, 3", "1 006, 8, 0", "1 006, 8, 0", "yes"),
        ("el", "10, 20, 3", "4, 12, 2", "6, 8, 1", "6, 8, 0", "no"),
    ]
    assert seven.columns[1:4] == ("with", "without", "difference")


@pytest.mark.parametrize(("banded", "note"), [(True, "s: number"), (False, "")])
def test_what_s_is_stands_below_the_systems_of_chains_alone(banded, note):
    rows = [*COUNTS, *([counted("banded", 3, 1, 1, 1, 1, 2)] if banded else [])]
    (systems,) = (x for x in study_of("operations").tables(rows) if x.name == "systems")
    assert (note in systems.note) and bool(systems.note) == banded


def test_what_is_not_fitted_and_what_savings_are_is_said_where_there_are_such():
    few = [*study_of("operations").remarks(COUNTS)]
    assert [line.split(":")[0] for line in few] == ["no fit"] and "degree 4 or less" in few[0]
    partly = [counted("em", n, n, n, 2**n, n, n) for n in range(2, 9)]
    assert [*study_of("operations").remarks(partly)] == few
    whole = [counted("em", n, n, n, n, n, n) for n in range(2, 9)]
    assert [*study_of("operations").remarks(whole)] == []
    saving = Saving("a trailer", ("Q",), "kane", (12, 15), None)
    saved = record_of_rows("operations", {"scene": "trailer"}, [saving])
    (line,) = study_of("operations").remarks([*whole, saved])
    assert line.startswith("One right-hand side, outside of solves")


def test_cells_of_operations_are_2_to_100_links_and_springs_at_the_last():
    planned = list(operations.cells(formulation=["au", "kane", "au"]))
    assert planned[:3] == [
        {"formulation": "au", "links": 2},
        {"formulation": "kane", "links": 2},
        {"formulation": "au", "links": 3},
    ]
    assert len(planned) == 2 * 99 + 2
    springs = {"links": 100, "springs": "present, absent, alone"}
    assert planned[-2:] == [{"formulation": key} | springs for key in ("au", "kane")]


def test_cells_of_absent_terms_are_of_three_links_and_fifteen_runs_unless_asked():
    (cell,) = operations.cells(scene="sleigh", formulation=["kane"])
    structure = next(Sleigh.structures(None)).structure
    here = {"scene": "sleigh", "links": None, "formulation": "kane", "repeats": 15}
    assert cell == here | {"structure": structure}
    (cell,) = operations.cells(scene="sleigh", formulation=["kane"], repeats=0)
    assert cell["repeats"] == 0
    assert {one["links"] for one in operations.cells(scene="snake", formulation=["au"])} == {3}
    of = {one["links"] for one in operations.cells(scene="snake", links="2..4")}
    assert of == {4}
    assert "banded" not in {one["formulation"] for one in operations.cells(scene="snake")}


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"scene": "sleigh", "links": "3"}, "sleigh has no number of links to choose"),
        ({"repeats": 3}, "repeats = 3: nothing is timed without a scene"),
        ({"repeats": 0}, "repeats = 0: nothing is timed without a scene"),
        ({"scene": "sleigh", "repeats": -1}, "repeats = -1, expected at least 0"),
    ],
)
def test_options_that_do_not_go_together_are_refused(options, says):
    with pytest.raises(InputError, match=says):
        list(operations.cells(**options))


def test_a_saving_is_of_its_structure_and_tells_what_is_left_out_before_zeros(monkeypatch):
    asked: list[tuple] = []

    def timed(key, jobs, repeats):
        asked.append((key, [job[0] for job in jobs], repeats))
        return SimpleNamespace(seconds=2e-6), SimpleNamespace(seconds=3e-6)

    monkeypatch.setattr(measure, "time_calls", timed)
    monkeypatch.setattr(measure, "rate_call", lambda at, formulation: at.scene)
    second = [*Snake.structures(2)][1]
    settings = {"scene": "snake", "links": 2, "formulation": "au", "repeats": 4}
    found = measure.saving(Snake, settings | {"structure": second.structure})
    assert (found.structure, found.formulation) == (second.structure, "au")
    assert found.absent == measure.absent_terms(second)
    assert found.seconds == (2e-6, 3e-6) and found.operations[0] < found.operations[1]
    assert asked == [("snake", [second.name] * 2, 4)]


# ---- Stiff joints --------------------------------------------------------------------------------


@pytest.fixture
def told(monkeypatch) -> list[str]:
    names: list[str] = []
    monkeypatch.setattr(stiff, "stored_reference", lambda name, folder: names.append(name))
    return names


@pytest.mark.parametrize(
    ("quick", "stiffnesses", "tolerances", "in_scipy"),
    [
        (True, (5e3, 1e6, 1e7), (1e-3, 1e-6, 1e-9), (1e-5,)),
        (False, (5e3, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10), (1e-3, 1e-5, 1e-7, 1e-9), (1e-4, 1e-7)),
    ],
)
def test_cells_of_stiff_joints_are_both_families_and_scipy_of_damped_ones_by_kane(
    quick, stiffnesses, tolerances, in_scipy, told
):
    planned = list(stiff.cells(quick=quick, formulation=["kane", "au"]))
    compiled = [one for one in planned if one["jacobian"] is None]
    assert [
        (x["problem"], x["formulation"], x["stiffness"]) for x in compiled[:: 5 * len(tolerances)]
    ] == [
        (problem, key, k)
        for problem in ("undamped", "damped")
        for key in ("kane", "au")
        for k in stiffnesses
    ]
    assert [(x["integrator"], x["tolerance"]) for x in compiled[: 5 * len(tolerances)]] == [
        (integrator, x)
        for integrator in ("DOP853", "Tsit5", "Radau", "BDF", "LSODA")
        for x in tolerances
    ]
    others = [one for one in planned if one["jacobian"] is not None]
    assert {(x["problem"], x["formulation"]) for x in others} == {("damped", "kane")}
    assert [(x["integrator"], x["jacobian"], x["tolerance"]) for x in others] == [
        (integrator, jacobian, x)
        for _ in stiffnesses
        for integrator in ("Radau", "BDF")
        for jacobian in ("differences", "exact")
        for x in in_scipy
    ]
    assert told == ["paper-rest"]
    assert [one["stiffness"] for one in stiff.truth_cells(quick=quick)] == [*stiffnesses]
    assert [*stiff.truth_cells(stiffness=[7e4])] == [{"stiffness": 7e4}]


def test_dampers_take_ten_milliseconds_of_springs_and_motions_end_by_their_own_clock():
    damped, free = (stiff.stiff_robot(problem, 2e6) for problem in ("damped", "undamped"))
    assert damped.stiffness == pytest.approx(np.full(6, 2e6))
    assert damped.damping == pytest.approx(np.full(6, 2e4))
    assert free.stiffness == pytest.approx(np.full(6, 2e6)) and free.damping is None
    assert stiff.unit_of_time("undamped", 2e6) == stiff.end_of("undamped", 2e6) == 0.05
    assert (stiff.unit_of_time("damped", 2e6), stiff.end_of("damped", 2e6)) == (1.0, 0.02)


@pytest.mark.parametrize(
    ("k", "second", "state"),
    [(1e9, ("kane", "DOP853", 1e-13), 4.0), (1.1e9, ("kane", "Radau", 1e-11), -8.0)],
)
def test_the_explicit_truth_is_kept_up_to_1e9_and_above_the_sharper_implicit_one(
    k, second, state, monkeypatch
):
    asked = []

    def ended(scene, *how):
        asked.append((float(scene.stiffness[0]), scene.damping is not None, *how))
        return np.array([2.0, -8.0]) if how[0] == "banded" else np.array([2.0, 4.0])

    monkeypatch.setattr(stiff, "_end_state", ended)
    record = stiff.damped_truth({"stiffness": k})
    assert asked == [(k, True, "banded", "Radau", 1e-12), (k, True, *second)]
    assert record.series["state"] == [2.0, state]
    assert record.errors["uncertainty"] == 1.5 + 2 * EPS
    assert (record.study, record.settings) == ("stiff-truth", {"stiffness": k})


def test_an_integration_of_the_truth_that_fails_names_its_formulation(monkeypatch):
    class Failing:
        def __init__(self, *of):
            pass

        def solve(self, end, **options):
            assert (end, options["max_steps"]) == (0.02, 0)
            assert options["rtol"] == options["atol"] == 1e-12
            return SimpleNamespace(success=False, message="a step of 0")

    monkeypatch.setattr(stiff, "Motion", Failing)
    with pytest.raises(EomcheckError, match="banded with Radau fails: a step of 0"):
        stiff.damped_truth({"stiffness": 1e6})


def test_the_undamped_truth_is_the_last_state_and_as_uncertain_as_the_reference(monkeypatch):
    reference = SimpleNamespace(
        q=np.array([[9.0, 9.0], [1.0, -2.0]]),
        v=np.array([[90.0, 90.0], [-8.0, 4.0]]),
        uncertainty=1.6e-9,
        rounding=0.8e-9,
    )
    monkeypatch.setattr(stiff, "stored_reference", lambda name, folder: reference)
    truth = stiff.scaled_truth(stiff.REFERENCES)
    assert truth.state.tolist() == [1.0, -2.0, -8.0, 4.0]
    assert truth.uncertainty == pytest.approx((2.4e-9 + 16 * EPS) / 8, rel=1e-12)


class Moved:
    """A motion whose state has q and v apart."""

    rates = SimpleNamespace(calls=77)

    def split(self, state):
        return state[:2], state[2:]


@pytest.fixture
def work(monkeypatch):
    """Return what works off a cell of motions that all come to one end."""
    solved: list[tuple] = []

    def solve(kind):
        def solved_by(motion, end, settings):
            solved.append((kind, end))
            state = None if settings["tolerance"] == 0 else np.array([1.0, 2.0, 40.0, -80.0])
            return stiff._Found(state, "stopped", {"steps": 5})

        return solved_by

    monkeypatch.setattr(stiff, "_by_cyrk", solve("cyrk"))
    monkeypatch.setattr(stiff, "_in_scipy", solve("scipy"))
    monkeypatch.setattr(stiff, "prepare_motion", lambda scene, key: (Moved(), 0.25))
    truth = stiff.Truth(np.array([1.0, 2.5, 2.0, -4.0]), 3e-9)
    monkeypatch.setattr(stiff, "scaled_truth", lambda folder: truth)

    def timed(call, runs):
        call()
        return SimpleNamespace(recorded=lambda: {"cpu_seconds": 0.5, "runs": runs})

    monkeypatch.setattr(stiff, "run_time", timed)
    truths = [
        Record("stiff-truth", {"stiffness": 2e6}, "failed", "too many steps"),
        Record(
            "stiff-truth",
            {"stiffness": 1e5},
            errors={"uncertainty": 7e-9},
            series={"state": [1.0, 2.0, 50.0, -100.0]},
        ),
    ]
    return stiff.worker(truths), solved


def cell(problem: str, k: float, **other: Any) -> dict[str, Any]:
    of = {"problem": problem, "stiffness": k, "formulation": "kane", "integrator": "BDF"}
    return of | {"jacobian": None, "tolerance": 1e-4} | other


def test_errors_of_stiff_joints_are_those_of_coordinates_and_scaled_velocities(work):
    run, solved = work
    # The unit of time is 1/20 s: velocities are 2 and -4, and the second coordinate is 0.5 off.
    record = run(cell("undamped", 2e6))
    assert record.errors == {"final": 0.5 / 4.0, "floor": 3e-9}
    assert record.counts == {"right-hand sides": 77, "steps": 5}
    assert (record.compile_seconds, record.cpu_seconds, record.runs) == (0.25, 0.5, 5)
    assert solved == [("cyrk", 0.05)] * 2
    record = run(cell("damped", 1e5, jacobian="exact"))
    assert record.errors == {"final": 0.2, "floor": 7e-9}
    assert solved[2:] == [("scipy", 0.02)] * 2


@pytest.mark.parametrize("jacobian", ["exact", "differences"])
def test_scipy_s_run_counts_its_own_right_hand_sides_and_has_the_jacobian_asked_for(
    monkeypatch, jacobian
):
    class Rates:
        calls = 17  # of a run before

        def reset(self) -> None:
            self.calls = 0

    motion: Any = SimpleNamespace(rates=Rates(), y0="y0", scene="scene", formulation="kane")
    asked: list[Any] = []

    def solved(rates, span, start, integrator, **how):
        rates.calls += 5
        asked.append((rates, span, start, integrator, how))
        return SimpleNamespace(
            y=np.array([[1.0, 2.0], [3.0, 4.0]]), success=True, message="why", njev=3, nlu=4
        )

    monkeypatch.setattr(stiff, "solve_ivp", solved)
    monkeypatch.setattr(stiff, "_jacobian_of", lambda *of: of)
    settings = {"jacobian": jacobian, "integrator": "BDF", "tolerance": 1e-6}
    found = stiff._in_scipy(motion, 2.5, settings)
    assert (motion.rates.calls, found.state.tolist(), found.reason) == (5, [2.0, 4.0], "why")
    assert found.counts == {"jacobians": 3, "factorizations": 4}
    ((rates, span, start, integrator, how),) = asked
    assert (rates, span, start, integrator) == (motion.rates, (0.0, 2.5), "y0", "BDF")
    assert how == {
        "t_eval": [2.5], "rtol": 1e-6, "atol": 1e-6,
        "jac": ("scene", "kane") if jacobian == "exact" else None,
    }  # fmt: skip


def test_stiff_motions_that_stop_and_truths_that_are_not_known_are_told(work):
    run, _ = work
    record = run(cell("undamped", 2e6, tolerance=0.0))
    assert (record.status, record.reason, record.errors) == ("failed", "stopped", {})
    assert record.counts == {"right-hand sides": 77, "steps": 5}
    with pytest.raises(EomcheckError, match="the true motion is not known: too many steps"):
        run(cell("damped", 2e6))


def stiff_run(integrator: str, k: float, cpu: float, sides: int, final: float, **other) -> Record:
    return Record(
        "stiff",
        cell("damped", k, integrator=integrator) | other,
        seconds=2 * cpu,
        cpu_seconds=cpu,
        counts={"right-hand sides": sides},
        errors={"final": final, "floor": 2e-5},
    )


STIFF = (
    stiff_run("DOP853", 1e4, 1e-3, 900, 1e-6, tolerance=1e-6),
    stiff_run("DOP853", 1e4, 2e-3, 100, 5e-4, tolerance=1e-3),
    stiff_run("DOP853", 1e4, 1e-5, 10, 5e-3, tolerance=1e-2),
    stiff_run("Radau", 1e4, 4e-3, 300, 9e-4),
    stiff_run("DOP853", 1e6, 9e-3, 1800, 9e-4),
    stiff_run("Radau", 1e6, 1e-3, 600, 9e-4),
    stiff_run("Radau", 1e6, 8e-2, 1000, 1e-4, jacobian="differences"),
    stiff_run("Radau", 1e6, 2e-2, 500, 1e-4, jacobian="exact"),
    stiff_run("Radau", 1e6, 1e-2, 100, 1e-4, jacobian="differences", tolerance=1e-7),
    stiff_run("Radau", 1e6, 9e-3, 80, 1e-4, jacobian="exact", tolerance=1e-7),
)


def drawn_of(chart) -> dict[tuple[str, ...], Panel]:
    assert all(isinstance(panel, Panel) for panel in chart.panels.values())
    return chart.panels


def test_work_and_precision_of_stiff_joints_are_drawn_down_to_what_is_known():
    chart, *_ = study_of("stiff").charts(STIFF)
    drawn = drawn_of(chart)
    assert [*drawn] == [("damped", "1e+04"), ("damped", "1e+06")]
    soft = drawn["damped", "1e+04"]
    assert [(x.key, x.x, x.y) for x in soft.lines] == [
        ("DOP853", [1e-5, 2e-3, 1e-3], [5e-3, 5e-4, 2e-5]),
        ("Radau", [4e-3], [9e-4]),
    ]
    assert soft.lines[0].hover_text[1] == ["DOP853, tolerance 1e-03", "2 ms, 100 right-hand sides"]
    assert (soft.unknown, soft.title) == (2e-5, "damped, k = 1e+04 N m/rad")
    assert [len(line.x) for line in drawn["damped", "1e+06"].lines] == [1, 1]


def test_costs_of_stiff_joints_are_the_least_to_an_error_and_marked_where_implicit_ones_win():
    _, chart, _ = study_of("stiff").charts(STIFF)
    drawn = drawn_of(chart)
    seconds, sides = drawn["CPU time / s", "damped"], drawn["right-hand sides", "damped"]
    assert [(x.key, x.x, x.y) for x in seconds.lines] == [
        ("DOP853", [1e4, 1e6], [1e-3, 9e-3]),
        ("Radau", [1e4, 1e6], [4e-3, 1e-3]),
    ]
    assert [(x.key, x.x, x.y) for x in sides.lines] == [
        ("DOP853", [1e4, 1e6], [100, 1800]),
        ("Radau", [1e4, 1e6], [300, 600]),
    ]
    # From a ratio of 1/4 to 9 in two decades, and from 1/3 to 3.
    first = 1e4 * 100 ** (math.log(4) / math.log(36))
    assert [*seconds.marks, *sides.marks] == pytest.approx([first, 1e5])
    assert drawn["CPU time / s", "undamped"].lines == []
    assert seconds.title == "damped, to an error of 1e-03"


def test_what_exact_jacobians_leave_is_their_cost_over_that_of_differences():
    *_, chart = study_of("stiff").charts(STIFF)
    drawn = drawn_of(chart)
    tolerances = "rtol 1e-04", "rtol 1e-07"
    assert [*drawn] == [(cost, at) for cost in ("right-hand sides", "time") for at in tolerances]
    sides = [drawn["right-hand sides", at] for at in tolerances]
    assert [(x.key, x.x, x.y) for panel in sides for x in panel.lines] == [
        ("Radau", [1e6], [0.5]),
        ("Radau", [1e6], [0.8]),
    ]
    assert [(panel.title, panel.level) for panel in sides] == [(at, 1.0) for at in tolerances]
    seconds = (line.y for at in tolerances for line in drawn["time", at].lines)
    assert [y for ys in seconds for y in ys] == pytest.approx([0.25, 0.9])


def test_runs_of_stiff_joints_that_shared_their_core_are_counted():
    quiet = replace(STIFF[0], seconds=STIFF[0].cpu_seconds)
    (line,) = study_of("stiff").remarks([quiet, *STIFF[:3]])
    assert line == "3 of 4 best runs had to share a core."


def test_cells_that_kill_their_processes_are_kept_as_failed(monkeypatch):
    def all_die(executor, function, items, killed):
        return ((item, killed(item)) for item in items)

    monkeypatch.setattr("eomcheck.lab.study.parallel_map", all_die)
    cells = [{"robot": "a", "engine": "b"}, {"robot": "a", "engine": "c"}]
    with Records(None) as records:
        found = run_cells(records, "conformance", cells, print, label="", executor="local:1")
        assert [(one.settings, one.status) for one in found] == [(x, "failed") for x in cells]
        assert {one.reason for one in found} == {"it killed every process that ran it"}
        again = run_cells(records, "conformance", cells, print, label="", executor="local:1")
        assert [one.when for one in again] == [one.when for one in found]
