"""What is kept of runs and of cells: each field of a Record, and in which order work is done."""

from __future__ import annotations

import sqlite3
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.lab.test_printed import at, finding
from tests.reports import running_differences

from eomcheck.claims.numerical_accuracy import SampledState
from eomcheck.claims.run import RunSelection, ValidationRun
from eomcheck.engines import version_of
from eomcheck.engines.casadi import CasadiEngine
from eomcheck.errors import DiedError, InputError, UnwrittenError
from eomcheck.lab.discrepancy import Explanation
from eomcheck.lab.library_comparison import LibraryComparison, LibraryReading, LibraryResult
from eomcheck.lab.store import parallel_map, record_file, validation_runs
from eomcheck.lab.store.record_file import Record, Records, rows_in, select, values
from eomcheck.lab.store.validation_runs import (
    RUNS,
    STATES,
    ValidationWriter,
    stored_findings_of_runs,
    why_unreadable,
)
from eomcheck.lab.studies import engines, motion, rhs, robots, tolerance
from eomcheck.lab.studies.motion import MotionTime
from eomcheck.lab.study import run_cells
from eomcheck.mechanics.records import State
from eomcheck.scenes import FourBarChain, Sleigh

SLEIGH = Sleigh.example()


def kept_run() -> ValidationRun:
    """Return a run of two states and of coverage, with times."""
    states = [at(SLEIGH, k) for k in (1, 2)]
    made = ValidationRun([finding(x) for x in (states[0], states[0], states[1])], ends=[2, 3])
    made.findings.append(finding(states[0], claim="coverage", subject="all"))
    made.findings.append(finding(states[1], claim="bias", subject="unresolved"))
    made.seconds |= {"bias": 0.5, "mass-matrix": 2.0, "motion": 9.0}
    made.sampled = [SampledState(SLEIGH, states[1], ())]
    return made


# ---- Runs ----------------------------------------------------------------------------------------


def test_a_run_is_kept_with_all_that_was_asked_for_and_found():
    selection = RunSelection.of(["el"], ["casadi"], ["mass-matrix", "invariance", "bias"])
    made = kept_run()
    with Records(None) as records:
        records.add(Record(STATES, {"scene": "sleigh", "links": 3, "case": 9}))
        records.add(Record(STATES, {"scene": "snake", "links": 3, "case": 9}))
        keeper = ValidationWriter(records, Sleigh, made, selection, (2, 5), 7, 3)
        (begun,) = records.all(RUNS)
        keeper.save()
        keeper.finish()
        (run,) = records.all(RUNS)
        states = records.all(STATES, scene="sleigh")
        assert len(records.all(STATES)) == len(states) + 1
    assert (begun.status, begun.reason, run.status) == ("failed", "not finished", "done")
    asked = {"examples": 7, "seed": 3, "first links": 2, "last links": 5, "states": 2}
    assert run.counts == asked and run.settings == {"scene": "sleigh"}
    strata = [(x, *one) for x, of in made.level_counts.items() for one in of.items()]
    assert run.series == {
        "formulations": [x.key for x in selection.formulations],
        "engines": ["casadi"],
        "engine versions": [version_of(CasadiEngine)],
        "claims": ["mass-matrix", "invariance", "bias"],
        "seconds": [2.0, 0.0, 0.5],
        "strata": [x for x, _, _ in strata],
        "ways": [x for _, x, _ in strata],
        "states in them": [x for _, _, x in strata],
    }
    assert [one.settings["case"] for one in states] == [0, 1, 2, 3]
    assert [len(one.series["claim"]) for one in states] == [2, 1, 1, 1]
    assert [one.series["claim"][0] for one in states[2:]] == ["coverage", "bias"]
    assert states[0].settings == {"scene": "sleigh", "links": None, "case": 0}


def test_findings_of_runs_are_told_with_the_number_of_their_state_in_each_run():
    chain = ValidationRun(
        [finding(at(FourBarChain.example(), 5), scene=FourBarChain.example())], ends=[1]
    )
    found = stored_findings_of_runs(
        {"sleigh": kept_run(), "four-bar-chain": chain, "snake": ValidationRun()}
    )
    assert [(one.scene, one.case, one.claim) for one in found] == [
        ("sleigh", 0, "mass-matrix"),
        ("sleigh", 0, "mass-matrix"),
        ("sleigh", 1, "mass-matrix"),
        ("sleigh", 2, "coverage"),
        ("sleigh", 3, "bias"),
        ("four-bar-chain", 0, "mass-matrix"),
    ]
    assert [one.links for one in found][-2:] == [None, FourBarChain.example().links]


def test_a_run_whose_times_are_not_those_of_its_claims_cannot_be_read():
    def run(claims: Any, seconds: Any) -> Record:
        return Record(RUNS, {"scene": "x"}, series={"claims": claims, "seconds": seconds})

    assert why_unreadable(run(["a", "b"], [1.0, 2.0])) is None
    assert why_unreadable(run(["a", "b"], [1.0])) and why_unreadable(run([], [1.0]))
    assert why_unreadable(Record(RUNS, {}, series={"claims": [], "seconds": []}))
    assert why_unreadable(Record(RUNS, {"scene": "x"}))


@pytest.mark.parametrize("unwritten", [False, True])
def test_kinds_are_looked_at_alike_the_largest_first_and_each_state_is_counted(
    unwritten, monkeypatch
):
    order, asked, told = [], [], []

    def spread(where: Any, work: Any, items: Any) -> Any:
        order.extend(items)
        assert where == "local:3"
        yield from ((one, work(one)) for one in items)

    def look(kind: Any, run: ValidationRun, *how: Any) -> None:
        asked.append((kind.key, *how[:-1]))
        run.ends.extend([0] * (len(order) - len(asked) + 1))

    class Full(Records):
        def add(self, record: Record) -> None:
            if unwritten and record.status == "done" and record.settings["scene"] == "snake":
                raise UnwrittenError("full")
            super().add(record)

    monkeypatch.setattr(validation_runs, "parallel_map", spread)
    monkeypatch.setattr(validation_runs, "validate_kind", look)
    runs = {key: ValidationRun() for key in ("sleigh", "snake", "rolling-disk")}
    selection = RunSelection.of(["au"], [], ["bias"])
    failed = ""
    with Full(None) as records:
        try:
            how = selection, (2, 3), 7, 5, lambda: told.append(1), records, "local:3"
            validation_runs.validate_kinds(runs, *how)
        except UnwrittenError as error:
            failed = str(error)
        status = {one.settings["scene"]: one.status for one in records.all(RUNS)}
        counts = {one.settings["scene"]: one.counts["seed"] for one in records.all(RUNS)}
    assert order == ["snake", "rolling-disk", "sleigh"] and [*runs] == [
        *("sleigh", "snake", "rolling-disk")
    ]
    assert asked == [(key, selection, (2, 3), 7, 5) for key in order]
    assert [runs[key].cases for key in order] == [3, 2, 1] and len(told) == 6
    assert status == {
        "sleigh": "done", "snake": "failed" if unwritten else "done", "rolling-disk": "done",
    }  # fmt: skip
    assert set(counts.values()) == {5}
    assert failed == ("full" if unwritten else "")


# ---- Files and cells -----------------------------------------------------------------------------


@pytest.mark.parametrize("version", [0, 2])
def test_records_of_another_version_are_not_read_whether_earlier_or_later(version, tmp_path: Path):
    path = tmp_path / "r.db"
    Records(path).close()
    with sqlite3.connect(path) as connection:
        connection.execute(f"PRAGMA user_version = {version}")
    connection.close()
    for readonly in (True, False):
        with pytest.raises(InputError, match=f"version {version}, this eomcheck reads version 1"):
            Records(path, readonly=readonly)


def test_cells_that_share_settings_are_handed_over_together_and_come_back_in_their_order():
    cells = [{"key": key, "n": n, "m": n % 2} for n in (3, 1, 2) for key in ("b", "a")]
    batches = []

    def spread(where: Any, work: Any, items: Any, killed: Any) -> Any:
        assert where == "local:2"
        for one in reversed([*items]):
            batches.append([(x["key"], x["n"]) for x in one])
            yield one, work(one)

    with Records(None) as records, pytest.MonkeyPatch.context() as patched:
        patched.setattr("eomcheck.lab.study.parallel_map", spread)
        how: dict[str, Any] = {"executor": "local:2", "by": ("key", "m")}
        found = run_cells(records, "s", cells, lambda one: Record("s", one), **how)
        assert [one.settings for one in found] == cells
    assert batches == [[("a", 2)], [("b", 2)], [("a", 3), ("a", 1)], [("b", 3), ("b", 1)]]


def test_records_are_picked_by_study_settings_and_run_time():
    records = [
        Record("s", {"n": 1, "key": "a"}, seconds=1.0),
        Record("s", {"n": 2, "key": "a"}, seconds=0.0),
        Record("s", {"n": 1, "key": "b"}),
        Record("t", {"n": 1}, seconds=2.0),
    ]
    assert select(records) == [records[0], records[1], records[3]]
    assert select(records, "s") == records[:2]
    assert select(records, "s", n=1, key="a") == records[:1]
    assert values(records, "n") == [1, 2] and values(records, "key") == ["a", "b"]


def test_a_result_is_of_a_commit_that_is_marked_where_files_were_changed(monkeypatch):
    def commit(**said: str | None) -> str | None:
        monkeypatch.setattr(record_file, "_git", lambda folder, what, *more: said.get(what))
        return record_file.commit.__wrapped__()

    head = {"ls-files": "__init__.py", "rev-parse": "c0ffee"}
    assert commit(**head, status="") == "c0ffee"
    assert commit(**head, status=" M x.py") == "c0ffee+"
    assert commit(status="", **{"rev-parse": "c0ffee", "ls-files": ""}) is None
    assert commit() is None
    lines = "processor : 0\nmodel name\t: Abacus 7\nmodel name\t: Other\n"
    monkeypatch.setattr(Path, "read_text", lambda path, **how: lines)
    assert record_file._cpu() == "Abacus 7"
    monkeypatch.setattr("os.cpu_count", lambda: 17)
    monkeypatch.setattr("platform.platform", lambda: "CP/M")
    monkeypatch.setattr("platform.python_version", lambda: "4.0")
    assert record_file._machine.__wrapped__() == {
        **{"cpu": "Abacus 7", "cores": 17, "os": "CP/M", "python": "4.0"}
    }


def test_items_that_kill_workers_are_counted_and_the_first_three_are_named(monkeypatch):
    items = [f"item {k} {'x' * 70}" for k in range(5)]
    here = SimpleNamespace(open=nullcontext)
    monkeypatch.setattr(parallel_map, "backend_of", lambda where: here)

    def killed(pool: Any, place: Any, function: Any, queue: Any, more: Any) -> Any:
        for task in (*queue, *more):
            yield task, parallel_map._Killed() if "2" not in str(task.item)[:7] else 7
        queue.clear()

    monkeypatch.setattr(parallel_map, "_work_off", killed)
    results = parallel_map.parallel_map("local:1", print, items)
    assert next(results) == (items[2], 7)
    with pytest.raises(DiedError) as error:
        next(results)
    names = [f"item {k} {'x' * 50}..." for k in (0, 1, 3)]
    assert str(error.value) == f"4 items killed every worker with it: {'; '.join(names)}"


# ---- What studies measure ------------------------------------------------------------------------


def test_the_best_time_of_all_rounds_counts_and_a_motion_that_fails_has_none(monkeypatch):
    def made(scene: Any, formulation: Any, *start: Any) -> Any:
        success = formulation.key != "el"
        rates = SimpleNamespace(calls=11)
        solve = lambda *how, **more: SimpleNamespace(success=success)  # noqa: E731
        return SimpleNamespace(formulation=formulation, rates=rates, solve=solve)

    times = {"kane": [5.0, 3.0, 4.0, 6.0, 7.0, 8.0], "au": [9.0, 9.0, 9.0, 9.0, 9.0, 1.0]}

    def measured(one: Any) -> MotionTime:
        seconds = times[one.formulation.key].pop(0)
        return MotionTime(one.formulation.key, seconds, 100, 20.0 - seconds)

    monkeypatch.setattr(motion, "Motion", made)
    monkeypatch.setattr(motion, "_measure", measured)
    record = motion.time_motion(
        {"formulations": ["el", "kane", "au"], "end": 1.0, "tolerance": 1e-12}
    )
    failed, *told = rows_in([record], MotionTime)
    assert told == [MotionTime("kane", 3.0, 100, 12.0), MotionTime("au", 1.0, 100, 11.0)]
    assert (failed.formulation, failed.right_hand_sides) == ("el", 11)
    assert np.isnan([failed.seconds, failed.seconds_in_python]).all()


def test_right_hand_sides_are_timed_in_turn_each_by_the_call(monkeypatch):
    clock, calls, steps = [0.0], [], []
    cost = {"a": 0.01, "b": 0.002}

    def job(what: str) -> Any:
        def call(count: int) -> None:
            calls.append((what, count))
            clock[0] += count * cost[what] * (1 + len(calls) % 3 / 10)

        return what, 7, call

    monkeypatch.setattr(rhs.time, "perf_counter", lambda: clock[0])
    one, other = rhs.time_calls("snake", map(job, "ab"), 4, lambda: steps.append(1))
    assert [what for what, _ in calls[6:]] == [*"abababab"]
    assert len(steps) == 2 + 2 * 4
    assert (one.scene, one.what, one.links, other.what) == ("snake", "a", 7, "b")
    for timing, seconds in ((one, 0.01), (other, 0.002)):
        low, high = timing.quartiles
        assert seconds <= low <= timing.seconds <= high <= 1.3 * seconds
        assert low < high
    assert rhs._timing("s", "w", 2, [4.0, 1.0, 2.0, 3.0, 9.0], 0.5) == rhs.Timing(
        *("s", "w", 2, 3.0, (1.5, 6.5), 0.5)
    )
    assert rhs._timing("s", "w", 2, [4.0], 0.5).quartiles == (4.0, 4.0)


def test_robots_are_counted_by_what_checks_and_proofs_came_to(monkeypatch, tmp_path):
    def verdicts(**counts: int) -> list[Any]:
        words = {x.replace("_", " "): n for x, n in counts.items()}
        return [SimpleNamespace(verdict=x) for x, n in words.items() for _ in range(n)]

    asked = []
    made = SimpleNamespace(ignored="a mesh")
    scene = type("Arm", (Sleigh,), {"source": made, "key": "arm"})
    checked = verdicts(passed=5, failed=1, inconclusive=2, skipped=3)
    proved = verdicts(passed=7, failed=4, skipped=2)
    why = [Explanation("x"), Explanation("y")]
    libraries = (
        LibraryResult("three", refusal="cannot"),
        LibraryResult("one", "One 1", explanations=why, decided=True),
        LibraryResult("two", "Two 2", decided=True),
    )
    found = LibraryComparison(SLEIGH, {one.library: one for one in libraries}, states=9)
    found.running = running_differences(
        {"M": np.array([[0.0, 1e-3, 2e-5], [1e-3, 0.0, 4e-7], [2e-5, 4e-7, 0.0]])}
    )
    stubs: dict[str, Any] = {
        "robot_named": lambda name: asked.append(name) or scene,
        "validate": lambda one, **how: asked.append(how) or checked,
        "prove_structure": lambda one, formulations, *how: asked.append(how) or proved,
        "compare_libraries": lambda one, *how: asked.append(how) or found,
    }
    for name, stub in stubs.items():
        monkeypatch.setattr(robots, name, stub)
    path = tmp_path / "arm.urdf"
    path.write_text("")
    settings = {"robot": str(path), "free": True, "states": 9, "seed": 3}
    record = robots._check_robot(settings)
    assert asked == [f"{path}:floating", {"examples": 9, "seed": 3}, (4, 3), (None, 9, 3)]
    assert record.counts == {
        **{"coordinates": 3, "passed": 5, "failed": 1, "proved": 7, "disproved": 4}
    }
    assert [(x.library, x.verdict, x.apart, x.why) for x in rows_in([record], LibraryReading)] == [
        ("One 1", "agrees", {"M": 1e-3}, "x; y"),
        ("Two 2", "agrees", {"M": 2e-5}, ""),
        ("three", "no answer", {}, "cannot"),
    ]
    assert {x.robot for x in rows_in([record], LibraryReading)} == {f"{path}, free"}


def test_ratios_are_over_the_constant_and_of_what_was_decided(monkeypatch):
    rows = [
        ("bias", 0.5, "passed"),
        ("bias", 3.0, "failed"),
        ("bias", 9.0, "inconclusive"),
        ("refusals", 0.5, "passed"),
        ("motion", 0.25, "passed"),
    ]

    def explore(run: ValidationRun, cases: Any, selection: Any, advance: Any) -> None:
        how = at(SLEIGH, 1)
        run.findings += [finding(how, x, claim=c, observed=o) for c, o, x in rows]  # type: ignore[arg-type]

    monkeypatch.setattr(ValidationRun, "explore", explore)
    record = tolerance._ratios(Sleigh, {"examples": 2, "links": (1, 1), "seed": 0})
    assert record.series == {
        "bias": [0.5 * tolerance.C, 3 * tolerance.C],
        "motion": [tolerance.C / 4],
    }


def test_an_engine_is_as_far_off_as_in_its_worst_state(monkeypatch):
    heights = [1.0, 2.0, 3.0, 4.0]
    scene = SLEIGH
    states = [State(np.array([0.0, 0.0, x]), np.array([0.0, 0.0, 1.0]), 0.0) for x in heights]
    off = dict(zip(heights, (1e-6, 3e-6, 2e-6, 5e-6), strict=True))
    verdicts: list[Any] = ["failed", "failed", "passed", "inconclusive"]

    class Own(CasadiEngine):
        key = "own"

    def look(run: ValidationRun, scene: Any, state: State, selection: Any) -> list[Any]:
        place = len(run.findings)
        change = {"observed": [2.0, 4.0, 0.5, 99.0][place], "claim": "mass-matrix"}
        run.findings.append(finding(state, verdicts[place], allowed=1.0, **change))
        # In the last state nothing is larger than what is allowed.
        return [SimpleNamespace(claim="mass-matrix", allowed=1.0 if place < 3 else 1e3)]

    def differences(engine: Any, scene: Any, state: State) -> Any:
        assert isinstance(engine, Own)
        yield "mass-matrix", 100 * off[state.q[2]], 100.0

    monkeypatch.setattr(engines, "engine_of", lambda key: Own)
    monkeypatch.setattr(engines, "scene_cases", lambda *how: [(scene, x) for x in states])
    monkeypatch.setattr(engines, "_differences", differences)
    monkeypatch.setattr(ValidationRun, "check_state", look)
    monkeypatch.setattr(
        engines.RunSelection, "of", lambda *how, **more: SimpleNamespace(how=how, more=more)
    )
    settings = {"engine": "own", "scene": "sleigh", "links": (1, 1), "states": 9, "seed": 0}
    (row,) = rows_in([engines._compare(settings)], engines.EngineDifference)
    assert (row.engine, row.scene, row.claim, row.gives_way) == (
        *("own", "sleigh", "mass-matrix", False),
    )
    assert (row.states, row.failed, row.share) == (4, 2, 4.0)
    assert row.relative == pytest.approx(3e-6)
