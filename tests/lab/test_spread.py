"""Work spread over processes and over dask workers: nothing lost when a worker is killed."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest

from eomcheck.errors import DiedError, InputError, RefusedError, UnknownNameError, WorkerError
from eomcheck.lab.store import parallel_map as cluster_module
from eomcheck.lab.store.parallel_map import (
    DEATHS_TOGETHER,
    backend_of,
    check_executor,
    executor,
    guarded,
    parallel_map,
)

WORK = '''
"""What workers do; each call leaves a line (item, process) in a file of its own."""
import os, signal, sys, threading, time
from pathlib import Path

def note(folder, item):
    with Path(folder, str(os.getpid())).open("a") as file:
        file.write(f"{item}\\n")

def square(folder, seconds, item):
    note(folder, item)
    time.sleep(seconds)
    return item * item

def deadly(folder, item):
    note(folder, item)
    attempts = sum(x.read_text().split().count(str(item)) for x in Path(folder).iterdir())
    if item == 3 and attempts < 9:  # a pool that tries for ever ends all the same
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.05)
    return item

def wrong(item):
    from eomcheck.errors import RefusedError
    raise RefusedError("M", 1e-20, 1e-16, "M is singular")

def surroundings(item):
    return os.environ["OPENBLAS_NUM_THREADS"], signal.getsignal(signal.SIGINT).name
'''


@pytest.fixture
def work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator:
    """The module above, where workers find it as well."""
    (tmp_path / "spread_work.py").write_text(WORK, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    import importlib

    yield importlib.import_module("spread_work")
    del sys.modules["spread_work"]


@pytest.fixture
def notes(tmp_path: Path) -> Path:
    folder = tmp_path / "notes"
    folder.mkdir()
    return folder


def done_by(notes: Path) -> dict[int, list[int]]:
    """Return process -> items that it began."""
    return {int(f.name): [int(x) for x in f.read_text().split()] for f in notes.iterdir()}


def within(seconds: float, condition: Callable[[], object]) -> bool:
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        if condition():
            return True
        time.sleep(0.02)
    return False


def alive(process: int) -> bool:
    try:
        state = Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except OSError:
        return False
    return state != "Z"


# ---- Processes on this machine -------------------------------------------------------------------


def test_every_item_comes_back_once_with_its_result(work, notes: Path):
    found = list(parallel_map("local:2", partial(work.square, notes, 0.0), range(20)))
    assert sorted(found) == [(k, k * k) for k in range(20)]
    assert os.getpid() not in done_by(notes)


def test_nothing_is_no_work():
    assert list(parallel_map(None, len, [])) == []


def test_items_are_taken_as_they_are_handed_over():
    taken: list[str] = []

    def items() -> Iterator[str]:
        for text in ("a" * i for i in range(100)):
            taken.append(text)
            yield text

    results = parallel_map("local:2", len, items())
    next(results)
    assert len(taken) <= 4
    assert len(list(results)) == 99


def test_workers_have_one_blas_thread_and_do_not_hear_ctrl_c(work, monkeypatch):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "7")
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    assert list(parallel_map("local:1", work.surroundings, [0])) == [(0, ("1", "SIG_IGN"))]
    assert os.environ["OPENBLAS_NUM_THREADS"] == "7"
    assert "OMP_NUM_THREADS" not in os.environ


def test_nothing_is_lost_when_a_worker_is_killed(work, notes: Path):
    found = []
    for item, result in parallel_map("local:2", partial(work.square, notes, 0.1), range(16)):
        found.append((item, result))
        if len(found) == 4:
            os.kill(next(p for p in done_by(notes) if alive(p)), signal.SIGKILL)
    assert sorted(found) == [(k, k * k) for k in range(16)]
    assert len(done_by(notes)) > 2


def test_an_item_that_kills_its_workers_is_reported_after_all_the_others(work, notes: Path):
    found = []
    with pytest.raises(WorkerError, match=r"1 item killed every worker .*: 3$"):
        for item, _ in parallel_map("local:2", partial(work.deadly, notes), range(12)):
            found.append(item)
    assert sorted(found) == [k for k in range(12) if k != 3]
    began = [item for items in done_by(notes).values() for item in items]
    assert began.count(3) == DEATHS_TOGETHER + 1


def test_an_item_that_kills_its_workers_has_the_result_that_is_given_for_it(work, notes: Path):
    found = parallel_map("local:2", partial(work.deadly, notes), range(6), lambda item: -item)
    assert dict(found)[3] == -3


def test_an_exception_of_the_work_is_raised_as_it_was(work):
    with pytest.raises(RefusedError, match="M is singular") as caught:
        list(parallel_map("local:2", work.wrong, range(8)))
    assert caught.value.rcond == 1e-20


@pytest.mark.parametrize(
    "error", [UnknownNameError("scene", "worm", ["snake"]), RefusedError("M", 0.0, 1.0, "why")]
)
def test_exceptions_survive_the_way_between_processes(error):
    read = pickle.loads(pickle.dumps(error))
    assert (type(read), str(read), vars(read)) == (type(error), str(error), vars(error))


def test_workers_end_when_the_results_are_no_longer_wanted(work, notes: Path):
    results = parallel_map("local:2", partial(work.square, notes, 0.2), range(100))
    next(results)
    start = time.monotonic()
    results.close()
    assert time.monotonic() - start < 5
    assert within(5, lambda: not any(map(alive, done_by(notes))))


SCRIPT = """
import signal
import sys
from functools import partial
# A shell that runs the tests in the background has its jobs ignore Ctrl-C.
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.path.insert(0, {path!r})
import spread_work
from eomcheck.lab.store.parallel_map import parallel_map

{guard}
    for item, result in parallel_map("local:2", partial(spread_work.square, {notes!r}, {seconds}), range(50)):
        print(item, flush=True)
"""  # noqa: E501


def script(tmp_path: Path, notes: Path, guard: str, seconds: float) -> list[str]:
    path = tmp_path / "script.py"
    text = SCRIPT.format(path=str(tmp_path), notes=str(notes), guard=guard, seconds=seconds)
    path.write_text(text, encoding="utf-8")
    return [sys.executable, str(path)]


GUARD = "if __name__ == '__main__':"


@pytest.mark.parametrize("seconds", [0.1, 30.0])
def test_ctrl_c_ends_at_once_and_without_a_word_from_workers(work, notes, tmp_path, seconds):
    process = subprocess.Popen(
        script(tmp_path, notes, GUARD, seconds),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert within(60, lambda: len(done_by(notes)) == 2)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to all of them
    _, said = process.communicate(timeout=20)
    assert process.returncode not in (0, None)
    assert said.count("Traceback") == 1 and said.rstrip().endswith("KeyboardInterrupt")
    assert "spread_work" not in said.replace("spread_work.square", "")
    assert within(5, lambda: not any(map(alive, done_by(notes))))


def test_ctrl_c_while_workers_start_is_as_quiet(work, notes, tmp_path):
    process = subprocess.Popen(
        script(tmp_path, notes, GUARD + "\n    print('go', flush=True)", 30.0),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stdout is not None and process.stdout.readline() == "go\n"
    time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=20)
    assert said.count("Traceback") == 1 and said.rstrip().endswith("KeyboardInterrupt")


def test_workers_end_with_a_parent_that_is_killed(work, notes, tmp_path):
    process = subprocess.Popen(
        script(tmp_path, notes, GUARD, 0.1), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    assert within(60, lambda: len(done_by(notes)) == 2)
    process.kill()
    process.wait()
    assert within(10, lambda: not any(map(alive, done_by(notes))))


@pytest.mark.night
def test_a_script_without_its_guard_is_told_so_and_does_not_run_for_ever(work, notes, tmp_path):
    command = script(tmp_path, notes, "if True:", 0.0)
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode != 0
    assert "WorkerError: worker processes die as they start" in done.stderr


@pytest.mark.parametrize(
    "where", ["", "local:", "local:0", "local:x", "local:-1", "dask", "dask:", "ray:1", "Local"]
)
def test_a_place_that_is_none_is_refused(where):
    with pytest.raises(InputError, match="expected local, local:NUMBER or dask:ADDRESS"):
        backend_of(where)


def test_an_executor_is_one_of_concurrent_futures():
    with executor("local:1") as pool:
        assert pool.submit(pow, 2, 10).result() == 1024


def test_work_of_other_sources_is_not_done():
    with pytest.raises(WorkerError, match="another version"):
        guarded("other", pickle.dumps((len, "")), 60.0)


# ---- The workers of a dask scheduler -------------------------------------------------------------


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[tuple[str, list[subprocess.Popen]]]:
    """A real scheduler and two worker processes: (address, [scheduler, worker, worker])."""
    pytest.importorskip("distributed")
    import json

    note = tmp_path / "scheduler.json"
    here = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    log = (tmp_path / "dask.log").open("w")
    quiet = {"stdout": log, "stderr": log, "env": here, "cwd": tmp_path}

    def start(what: str, *options: str) -> subprocess.Popen:
        command = [sys.executable, "-m", f"distributed.cli.{what}", "--no-dashboard", *options]
        return subprocess.Popen(command, **quiet)

    file = ("--scheduler-file", str(note))
    started = [start("dask_scheduler", "--host", "127.0.0.1", "--port", "0", *file)]
    try:
        assert within(60, note.exists), Path(log.name).read_text()
        assert within(10, lambda: note.read_text().rstrip().endswith("}"))
        address = json.loads(note.read_text())["address"]
        one = ("--nthreads", "1", "--no-nanny", "--host", "127.0.0.1")
        started += [start("dask_worker", address, *one) for _ in range(2)]
        yield f"dask:{address}", started
    finally:
        for process in started:
            process.kill()
            process.wait()
        log.close()


@pytest.fixture
def deadline() -> Iterator[None]:
    """Interrupt a test that waits for a cluster for more than a minute and a half."""
    timer = threading.Timer(90, lambda: os.kill(os.getpid(), signal.SIGINT))
    timer.start()
    yield
    timer.cancel()
    timer.join()


def wait_for_workers(address: str) -> None:
    import distributed

    with distributed.Client(address, timeout=20, set_as_default=False) as client:
        client.wait_for_workers(2, timeout=40)


@pytest.mark.night
@pytest.mark.usefixtures("deadline")
def test_nothing_is_lost_when_a_dask_worker_is_killed_midway(work, notes: Path, cluster):
    where, (_, *workers) = cluster
    wait_for_workers(where.removeprefix("dask:"))
    found = []
    for item, result in parallel_map(where, partial(work.square, notes, 0.1), range(30)):
        found.append((item, result))
        if len(found) == 6:
            workers[0].kill()
    assert sorted(found) == [(k, k * k) for k in range(30)]
    assert set(done_by(notes)) == {worker.pid for worker in workers}
    assert done_by(notes)[workers[0].pid]


@pytest.mark.usefixtures("deadline")
@pytest.mark.night
def test_an_exception_on_a_dask_worker_is_raised_as_it_was(work, cluster):
    where, _ = cluster
    with pytest.raises(RefusedError, match="M is singular"):
        list(parallel_map(where, work.wrong, range(8)))


@pytest.mark.usefixtures("deadline")
@pytest.mark.night
def test_a_scheduler_that_goes_away_is_reported(work, notes: Path, cluster):
    where, (scheduler, *_) = cluster
    with pytest.raises(WorkerError, match="the scheduler is gone"):
        for _ in parallel_map(where, partial(work.square, notes, 0.1), range(40)):
            scheduler.kill()


def test_a_scheduler_that_stays_without_workers_ends_the_work(monkeypatch):
    pytest.importorskip("distributed")
    from eomcheck.lab.store import parallel_map as executors

    clock, workers = [100.0], {"one": {}}
    monkeypatch.setattr(executors.time, "monotonic", lambda: clock[0])
    place = executors.Dask("tcp://here:1")
    place.check()
    place._client = SimpleNamespace(scheduler_info=lambda: {"workers": workers})
    for seconds, there in ((0, True), (30, True), (0, False), (19, False), (2, True), (0, False)):
        clock[0] += seconds
        workers = {"one": {}} if there else {}
        place.check()
    clock[0] += 21
    with pytest.raises(DiedError, match="'tcp://here:1' has no workers left"):
        place.check()


@pytest.mark.usefixtures("deadline")
@pytest.mark.night
def test_a_scheduler_without_workers_is_refused(cluster, monkeypatch):
    where, (_, *workers) = cluster
    wait_for_workers(where.removeprefix("dask:"))
    for worker in workers:
        worker.kill()
        worker.wait()
    monkeypatch.setattr(cluster_module, "CONNECT_SECONDS", 2)
    with pytest.raises(InputError, match="has no workers"):
        check_executor(where)


@pytest.mark.night
@pytest.mark.usefixtures("deadline")
@pytest.mark.parametrize("address", ["127.0.0.1:9", "tcp://127.0.0.1:9", "nonsense://x", "a:b:c"])
def test_a_scheduler_that_does_not_answer_is_bad_input_and_soon(address, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr(cluster_module, "CONNECT_SECONDS", 2)
    start = time.monotonic()
    with pytest.raises(InputError, match="no dask scheduler answers at"):
        check_executor(f"dask:{address}")
    assert time.monotonic() - start < 10


def test_a_missing_library_names_the_extra(monkeypatch):
    from eomcheck.errors import EngineError

    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(EngineError, match="extra `cluster`"):
        check_executor("dask:127.0.0.1:8786")
