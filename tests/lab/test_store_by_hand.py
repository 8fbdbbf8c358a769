"""Settings, Records and places of work, each held against values that are written down."""

from __future__ import annotations

import math
import os
import pickle
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, Future
from contextlib import contextmanager
from multiprocessing.context import SpawnProcess
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

from eomcheck import calls
from eomcheck.engines.casadi import CasadiEngine
from eomcheck.errors import DiedError, InputError, WorkerError
from eomcheck.lab.store import parallel_map, validation_runs
from eomcheck.lab.store import parallel_map as executors
from eomcheck.lab.store.parallel_map import ExecutorBackend, Local, backend_of
from eomcheck.lab.store.record_file import Record, canonical, json_of, key_of
from eomcheck.mechanics.records import State
from eomcheck.scenes import Sleigh

# ---- Settings ------------------------------------------------------------------------------------


def test_json_is_sorted_close_and_in_letters_as_they_are():
    given = {"b": "θ", "a": (1.5, math.inf, None), "c": {"z": True, "y": math.nan}}
    text = '{"a":[1.5,Infinity,null],"b":"θ","c":{"y":NaN,"z":true}}'
    assert json_of("series", given) == key_of(given) == text


@pytest.mark.parametrize(
    ("number", "text"),
    [
        (2.0**53, "9007199254740992"),
        (2.0**53 + 2, "9007199254740994.0"),
        (-(2.0**53), "-9007199254740992"),
        (-(2.0**54), "-1.8014398509481984e+16"),
        (-0.0, "0"),
        (1.5, "1.5"),
        (True, "true"),
        (2**60, "1152921504606846976"),
    ],
)
def test_whole_floats_are_written_as_integers_as_long_as_each_is_one(number, text):
    assert key_of({"a": number}) == f'{{"a":{text}}}'


def test_equal_numbers_have_one_key_however_deep_they_are():
    assert canonical({"a": ({"b": 2.0}, [3.0, (4.0, 0.5)])}) == {"a": [{"b": 2}, [3, [4, 0.5]]]}
    assert key_of({"a": ({"b": 2.0}, [3.0])}) == '{"a":[{"b":2},[3]]}'


def circular() -> dict[str, Any]:
    """Return a dict that holds itself."""
    of: dict[str, Any] = {}
    of["x"] = of
    return of


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ([1], "[1], expected a dict with names as keys"),
        (["a"], "['a'], expected a dict with names as keys"),
        ("", "'', expected a dict with names as keys"),
        ({1: 2}, "{1: 2}, expected a dict with names as keys"),
        ({"a": 1j}, "{'a': 1j}: Object of type complex is not JSON serializable"),
        (circular(), "{'x': {...}}: Circular reference detected"),
    ],
)
def test_what_would_not_come_back_is_refused_in_a_sentence(given, message):
    with pytest.raises(InputError) as error:
        json_of("series", given)
    assert str(error.value) == f"series = {message}"
    if isinstance(given, dict) and 1j in given.values():
        with pytest.raises(InputError) as error:
            key_of(given)
        assert str(error.value) == f"settings = {message}"


# ---- Records -------------------------------------------------------------------------------------


def test_a_record_holds_plain_numbers_and_lists_whatever_it_was_given():
    made = Record(
        "s",
        {"n": (1, [2.0])},
        seconds=np.float64(0.0),  # type: ignore[arg-type]
        cpu_seconds=np.float32(0.5),  # type: ignore[arg-type]
        compile_seconds=2,
        quartiles=(np.float64(1.0), 3),  # type: ignore[arg-type]
        counts={"steps": np.int64(7)},  # type: ignore[dict-item]
        errors={"end": np.float64(0.25), "none": 0},  # type: ignore[dict-item]
        series={"q": ((1.0, 2), ())},  # type: ignore[dict-item]
    )
    plain = {
        "settings": {"n": [1, [2.0]]},
        "seconds": 0.0,
        "cpu_seconds": 0.5,
        "compile_seconds": 2.0,
        "quartiles": (1.0, 3.0),
        "counts": {"steps": 7},
        "errors": {"end": 0.25, "none": 0.0},
        "series": {"q": [[1.0, 2], []]},
    }
    assert {name: repr(getattr(made, name)) for name in plain} == {
        name: repr(value) for name, value in plain.items()
    }
    empty = Record("s", {})
    assert (empty.status, empty.reason, empty.runs) == ("done", "", 0)
    assert (empty.seconds, empty.quartiles, empty.cpu_seconds, empty.compile_seconds) == (None,) * 4
    assert empty.counts == empty.errors == empty.series == {}


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            {"status": "good"},
            "status = 'good', expected one of ('done', 'failed', 'refused')",
        ),
        ({"study": 3}, "study = 3, expected str"),
        ({"reason": None}, "reason = None, expected str"),
        ({"when": 0}, "when = 0, expected str"),
        ({"machine": "m"}, "machine = 'm', expected dict"),
        ({"versions": []}, "versions = [], expected dict"),
        ({"settings": "n"}, "settings = 'n', expected a dict with names as keys"),
        ({"series": ["q"]}, "series = ['q'], expected a dict with names as keys"),
    ],
)
def test_a_record_of_wrong_kinds_is_refused_by_the_name_of_its_field(given, message):
    with pytest.raises(InputError) as error:
        Record(**({"study": "s", "settings": {}} | given))
    assert str(error.value) == message


# ---- Where work goes -----------------------------------------------------------------------------


def test_a_place_has_as_many_processes_as_its_text_says_and_else_one_a_core(monkeypatch):
    monkeypatch.setattr("os.cpu_count", lambda: 17)
    places: list[Any] = [backend_of(text) for text in (None, "local", "local:1", "local:203")]
    assert [(place.workers, place.max_pending) for place in places] == [
        (17, 18), (17, 18), (1, 2), (203, 204),
    ]  # fmt: skip
    monkeypatch.setattr("os.cpu_count", lambda: None)
    assert backend_of(None).max_pending == 2 and Local(3, ahead=0).max_pending == 3
    dask: Any = backend_of("dask:tcp://here:8786")
    assert (dask.address, dask.max_pending, dask.killed_error, dask.check_seconds) == (
        *("tcp://here:8786", 1024, "KilledWorker", 1.0),
    )


@pytest.mark.parametrize("where", ["ray:1", "local:01", "local:1:", "local: 2", "dask"])
def test_what_is_no_place_is_refused_with_those_that_there_are(where):
    with pytest.raises(InputError) as error:
        backend_of(where)
    said = "expected local, local:NUMBER or dask:ADDRESS"
    assert str(error.value) == f"executor = {where!r}, {said}"


# ---- Processes -----------------------------------------------------------------------------------


class Pool:
    """Stands for a `ProcessPoolExecutor`: keeps how it was made and ended."""

    made: ClassVar[list[Pool]] = []

    def __init__(self, workers: int, mp_context: Any, initializer: Any):
        self.workers, self.context, self.initializer = workers, mp_context, initializer
        self.ended: list[dict] = []
        Pool.made.append(self)

    def submit(self, function: Any) -> None:
        """Start two processes, of which the second has no number yet."""
        self.terminated: list[int | None] = []
        for pid in (5, None):
            end = lambda pid=pid: self.terminated.append(pid)  # noqa: E731
            self.context.started.append(SimpleNamespace(pid=pid, exitcode=-9, terminate=end))

    def shutdown(self, **how: Any) -> None:
        self.ended.append(how)


def test_a_pool_that_is_left_early_is_ended_and_else_waits_and_bars_what_killed_it(monkeypatch):
    barred: list[Any] = []
    monkeypatch.setattr(executors, "ProcessPoolExecutor", Pool)
    monkeypatch.setattr(executors, "_bar_last_call", barred.append)
    monkeypatch.setattr(Pool, "made", [])
    with Local(3).open() as pool:
        assert not barred
    (made,) = Pool.made
    assert pool is made and (made.workers, made.initializer) == (3, executors._start_worker)
    assert (made.ended, made.terminated, barred) == ([{}], [], made.context.started)
    barred.clear()
    with pytest.raises(ZeroDivisionError), Local(2).open():
        raise ZeroDivisionError
    made = Pool.made[1]
    assert (made.ended, made.terminated, barred) == ([{"cancel_futures": True}], [5], [])


def test_the_call_in_which_a_worker_died_is_barred_but_not_where_the_pool_ended_it(
    monkeypatch, tmp_path: Path
):
    barred: list[tuple] = []
    at = calls.Call(1.0, 60.0, 4, "own.f", False)
    monkeypatch.setattr(calls, "bar", lambda *of: barred.append(of))
    monkeypatch.setattr(calls, "read_board", lambda path: at if path == tmp_path / "7" else None)
    ends = ((7, None), (7, -signal.SIGTERM), (8, -signal.SIGKILL), (7, -signal.SIGKILL), (7, 3))

    def end() -> None:
        for pid, status in ends:
            executors._bar_last_call(SimpleNamespace(pid=pid, exitcode=status))  # type: ignore[arg-type]

    monkeypatch.delenv(calls.BOARDS, raising=False)
    end()
    assert not barred
    monkeypatch.setenv(calls.BOARDS, str(tmp_path))
    end()
    assert barred == [
        ("own.f", 0, "ended its process by SIGKILL"),
        ("own.f", 0, "ended its process with exit code 3"),
    ]


def test_a_process_starts_with_one_thread_of_each_library_and_this_one_keeps_its_own(monkeypatch):
    names = "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"
    seen: list[list[str | None]] = []

    def start(self: Any) -> None:
        seen.append([os.environ.get(name) for name in names])
        raise ZeroDivisionError

    monkeypatch.setattr(SpawnProcess, "start", start)
    monkeypatch.setenv(names[0], "7")
    monkeypatch.setenv(names[1], "")
    monkeypatch.delenv(names[2], raising=False)
    context = executors._Context()
    one, other = context.Process(name="a"), context.Process(name="b")
    assert [one.name, other.name] == ["a", "b"] and context.started == [one, other]
    with pytest.raises(ZeroDivisionError):
        one.start()
    assert seen == [["1", "1", "1"]]
    assert [os.environ.get(name) for name in names] == ["7", "", None]


def test_of_two_signals_that_were_put_off_the_first_is_raised():
    heard: list[int] = []
    numbers = signal.SIGINT, signal.SIGTERM
    before = [signal.signal(x, lambda number, _: heard.append(number)) for x in numbers]
    try:
        with executors._no_interrupt():
            signal.raise_signal(signal.SIGTERM)
            signal.raise_signal(signal.SIGINT)
            assert not heard
        assert heard == [signal.SIGTERM]
        with executors._no_interrupt():
            pass
        assert heard == [signal.SIGTERM]
        signal.raise_signal(signal.SIGINT)
        assert heard == [signal.SIGTERM, signal.SIGINT]
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


# ---- Work spread over places ---------------------------------------------------------------------


class Scripted(ExecutorBackend):
    """A place where each item comes to what `outcome_of` says of it at once."""

    def __init__(self, outcome: Any, width: int = 2, killed: str = ""):
        self.outcome, self.max_pending, self.killed_error = outcome, width, killed
        self.pools: list[list[Any]] = []
        self.pending: list[Future] = []

    @contextmanager
    def open(self) -> Iterator[Any]:
        """Provide a pool that is broken from the first item on that breaks it."""
        items: list[Any] = []
        self.pools.append(items)
        broken: list[bool] = []

        def submit(function: Any, *item: Any) -> Future:
            if broken:
                raise BrokenExecutor
            items.append(item[0] if item else function)
            future: Future = Future()
            outcome = self.outcome(items[-1])
            if isinstance(outcome, BaseException):
                future.set_exception(outcome)
                broken.extend([True] * isinstance(outcome, BrokenExecutor))
            elif outcome is None:
                self.pending.append(future)
            else:
                future.set_result(outcome)
            return future

        yield SimpleNamespace(submit=submit)


def spread_over(
    monkeypatch, place: ExecutorBackend, items: Any
) -> tuple[list, BaseException | None]:
    """Return what comes of items at a place, and the error at the end."""
    monkeypatch.setattr(parallel_map, "backend_of", lambda where: place)
    results: list = []
    try:
        results.extend(parallel_map.parallel_map("there", len, items))
    except Exception as error:
        return results, error
    return results, None


def test_what_kills_its_workers_is_tried_twice_beside_others_and_then_alone(monkeypatch):
    def outcome(item: Any) -> Any:
        return BrokenExecutor() if item == 1 else (item, "done")

    place, alone, asked = Scripted(outcome), Scripted(outcome), []
    monkeypatch.setattr(parallel_map, "Local", lambda n, ahead: asked.append((n, ahead)) or alone)
    results, error = spread_over(monkeypatch, place, range(6))
    assert sorted(results) == [(item, (item, "done")) for item in (0, 2, 3, 4, 5)]
    assert type(error) is DiedError and str(error) == "1 item killed every worker with it: 1"
    # A pool in which nothing came back is followed by a look at whether workers can start.
    assert place.pools == [[0, 1], [1], [os.getpid, 2, 3, 4, 5]]
    assert (alone.pools, asked) == ([[1]], [(1, 0)])
    assert spread_over(monkeypatch, Scripted(outcome), [])[1] is None


def test_workers_that_die_as_they_start_are_reported_and_no_item_is_blamed(monkeypatch):
    place = Scripted(lambda item: BrokenExecutor())
    results, error = spread_over(monkeypatch, place, [0, 1])
    assert results == [] and place.pools == [[0], [os.getpid]]
    assert type(error) is WorkerError and str(error) == (
        "worker processes die as they start; a script that spreads work must begin it under "
        "`if __name__ == '__main__':`"
    )


def test_what_a_place_names_as_killed_is_left_out_and_other_errors_end_all(monkeypatch):
    class KilledWorker(Exception):
        pass

    def outcome(item: Any) -> Any:
        return {2: KilledWorker(), 5: ValueError("five")}.get(item, 10 * item)

    results, error = spread_over(monkeypatch, Scripted(outcome, 1, "KilledWorker"), [1, 2, 3])
    assert results == [(1, 10), (3, 30)]
    assert str(error) == "1 item killed every worker with it: 2"
    results, error = spread_over(monkeypatch, Scripted(outcome, 1), [1, 2, 3])
    assert results == [(1, 10)] and isinstance(error, KilledWorker)
    results, error = spread_over(monkeypatch, Scripted(outcome, 1, "KilledWorker"), [1, 5, 3])
    assert results == [(1, 10)] and repr(error) == "ValueError('five')"


def test_a_place_is_asked_whether_it_is_still_there_while_nothing_comes(monkeypatch):
    class Waiting(Scripted):
        check_seconds = 0.01

        def check(self) -> None:
            raise DiedError("nobody is left")

    place = Waiting(lambda item: item or None, 3)
    late = threading.Timer(1.0, lambda: place.pending[0].set_result("late"))
    late.start()
    results, error = spread_over(monkeypatch, place, [4, 0])
    late.cancel()
    assert results == [(4, 4)] and str(error) == "nobody is left"


def test_items_are_named_by_their_structure_in_sixty_letters_at_most():
    letters = "x" * 60
    assert parallel_map._short(letters) == letters and parallel_map._short(7) == "7"
    assert parallel_map._short(f"{letters}y") == f"{'x' * 57}..."
    assert parallel_map._short(SimpleNamespace(structure="snake[3]")) == "snake[3]"


# ---- States spread over processes ----------------------------------------------------------------


class Own(Sleigh, functions=()):
    """A kind of scene that is not of this package."""


def test_states_go_out_with_their_number_their_scene_and_a_name_and_come_back_with_them(
    monkeypatch,
):
    items: list[Any] = []

    def spread(where: Any, work: Any, given: Any) -> Any:
        assert where == "local:2" and work.keywords == {"selection": "selection"}
        for one in given:
            items.append(one)
            yield one, f"look {one.number}"

    monkeypatch.setattr(validation_runs, "parallel_map", spread)
    scene = Sleigh.example()
    cases = [(scene, State(np.full(3, float(k)), np.zeros(3), 0.5)) for k in range(3)]
    found: list[Any] = list(validation_runs.check_in_parallel("local:2", cases, "selection"))  # type: ignore[arg-type]
    assert [look for _, _, look in found] == ["look 0", "look 1", "look 2"]
    for i, ((one, state, _), item) in enumerate(zip(found, items, strict=True)):
        assert one is scene and state is cases[i][1] is item.state and item.number == i
        assert item.structure == f"{scene.structure} in {state}"
        assert repr(pickle.loads(item.scene)) == repr(scene)


def test_a_scene_is_made_once_for_states_that_follow_each_other(monkeypatch):
    made: list[str] = []
    monkeypatch.setattr(
        validation_runs, "make_scene_engines", lambda scene, selection: made.append(scene) or scene
    )
    monkeypatch.setattr(validation_runs, "evaluate_state", lambda *of, number: (*of, number))
    monkeypatch.setattr(validation_runs, "repeats_at", lambda number: 10 * number)
    validation_runs._asked.cache_clear()
    try:
        scenes = [pickle.dumps(x) for x in ("a", "a", "b", "a")]
        for number, scene in enumerate(scenes):
            item = validation_runs._Item(number, scene, f"state {number}", "")  # type: ignore[arg-type]
            look: Any = validation_runs._evaluate(item, "selection")  # type: ignore[arg-type]
            expected = pickle.loads(scene), f"state {number}", "selection", 10 * number, number
            assert look == expected
    finally:
        validation_runs._asked.cache_clear()
    assert made == ["a", "b", "a"]


def test_scenes_and_engines_of_somebody_stay_in_this_process(monkeypatch):
    assert validation_runs.all_built_in() and validation_runs.all_built_in(Sleigh, CasadiEngine)
    assert not validation_runs.all_built_in(Sleigh, Own) and not validation_runs.all_built_in(
        Own, Sleigh
    )
    monkeypatch.setattr("os.cpu_count", lambda: 3)
    assert validation_runs.default_executor(1000, [Sleigh], [CasadiEngine]) == "local:3"
    assert validation_runs.default_executor(1000, [Sleigh], [Own]) is None  # type: ignore[list-item]
    assert validation_runs.default_executor(1000, [Sleigh, Own], []) is None
    assert (
        validation_runs.default_executor(60, [Sleigh], []),
        validation_runs.default_executor(59, [Sleigh], []),
    ) == (*("local:2", None),)
