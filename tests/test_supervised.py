"""Calls of outside code that do not return, and the supervisor of processes that make them."""

from __future__ import annotations

import inspect
import io
import os
import pickle
import re
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import redirect_stdout
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import eomcheck
from eomcheck import calls, supervisor
from eomcheck.errors import CallError, InputError
from eomcheck.lab.store.parallel_map import Dask, guarded
from eomcheck.lab.store.record_file import sources
from eomcheck.supervisor import ProcessEnd, supervise, why_died

CHILD = """
import collections, itertools, os, signal, sys, time
from eomcheck import calls, supervisor
from eomcheck.errors import CallError
pipe = supervisor.accept_supervision()
def run():
    {body}
for k in range({times}):
    try:
        calls.call("own.f", (lambda: None) if k < {times} - 1 else run{more})
    except CallError as error:
        print("caught:", error, flush=True)
supervisor.report_exit_code(pipe, {code})
"""
UNINTERRUPTED = "collections.deque(itertools.repeat(0, 10**9), 0)"
"""A call of C that takes seconds, in which Python hears no signal."""


@pytest.fixture(autouse=True)
def _soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(supervisor, "POLL", 0.02)
    monkeypatch.setattr(supervisor, "GRACE", 0.3)


def child(body: str, times: int = 2, more: str = "", code: int = 3) -> list[str]:
    return [sys.executable, "-c", CHILD.format(body=body, times=times, more=more, code=code)]


def ended(folder: Path, *what, patience: float = 60.0) -> ProcessEnd:
    return supervise(child(*what), folder, {calls.PATIENT: str(patience)})


# ---- Calls ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [SystemExit, GeneratorExit, BaseException])
def test_a_call_that_raises_what_is_no_exception_fails_and_ends_nothing(kind: type):
    def function(x):
        raise kind(x)

    with pytest.raises(CallError) as caught:
        calls.call("own.f", function, 7)
    assert str(caught.value) == f"own.f raised {kind.__name__}: 7"


@pytest.mark.parametrize("kind", [KeyboardInterrupt, ValueError, calls.UnsupervisedError])
def test_a_call_passes_exceptions_and_ctrl_c_through(kind: type):
    def function():
        raise kind

    with pytest.raises(kind):
        calls.call("own.f", function)


def test_a_function_called_so_keeps_its_name_signature_and_options():
    def scaled(x, by=2):
        """Scale."""
        return x * by

    called = calls.calling("own.scaled", scaled)
    assert (called(3), called(3, by=5), called.__name__, called.__doc__) == (
        6,
        15,
        "scaled",
        "Scale.",
    )


def test_a_board_holds_the_outermost_call_while_it_runs(tmp_path: Path):
    board = calls.Board(tmp_path)
    path = tmp_path / str(os.getpid())
    seen = []

    def inner():
        seen.append(calls.read_board(path))

    before = time.monotonic()
    for _ in range(2):
        board.call("own.outer", lambda: board.call("own.inner", inner, (), False), (), False)
    board.call("own.import", inner, (), True)
    board.call("own.import", inner, (), True)
    assert calls.read_board(path) is None
    assert [(x.name, x.number, x.slow) for x in seen] == [
        ("own.outer", 0, False),
        ("own.outer", 1, False),
        ("own.import", 0, True),
        ("own.import", 1, True),
    ]
    # A first call, and an import, may take longer than others.
    usual = calls.patience()
    assert [x.limit for x in seen] == [calls.FIRST * usual, usual, *[calls.FIRST * usual] * 2]
    assert all(before <= x.began <= time.monotonic() for x in seen)


def test_patience_is_a_minute_a_call_and_five_for_imports_and_first_calls():
    assert (calls.PATIENCE, calls.PATIENCE * calls.FIRST) == (60.0, 300.0)


def test_a_barred_call_is_not_made_and_those_before_it_are(tmp_path: Path):
    board = calls.Board(tmp_path)
    board.barred = calls.unpacked(calls.packed({"own.f": (1, "ended its process by SIGSEGV")}))
    assert board.call("own.f", lambda: 5, (), False) == 5
    for _ in range(2):
        with pytest.raises(CallError, match=r"own\.f ended its process by SIGSEGV"):
            board.call("own.f", pytest.fail, (), False)
    assert board.call("own.g", lambda: 6, (), False) == 6


@pytest.mark.parametrize("letter", ["x", "é", "€"])
def test_a_call_of_a_long_name_is_barred_by_what_its_board_says(letter, tmp_path: Path):
    board, seen = calls.Board(tmp_path), list[str]()
    names = [f"{letter * 150}/{end}" for end in ("own.f", "own.g")]

    def look():
        here = calls.read_board(tmp_path / str(os.getpid()))
        assert here is not None
        seen.append(here.name)

    for name in names:
        board.call(name, look, (), False)
    assert seen[0].endswith("/own.f") and seen[1].endswith("/own.g")
    assert all(x.startswith(letter * 30) for x in seen)
    board.barred = {seen[0]: (1, "died")}
    with pytest.raises(CallError, match=r"own\.f died"):
        board.call(names[0], pytest.fail, (), False)
    assert board.call(names[1], lambda: 6, (), False) == 6


def test_what_is_barred_stays_so_when_another_function_ends_a_process(monkeypatch):
    monkeypatch.setenv(calls.BARRED, "{}")
    calls.bar("own.f", 3, "ended its process by SIGSEGV")
    calls.bar("own.g", 0, "gave no answer in 60 s")
    assert calls.unpacked(os.environ[calls.BARRED]) == {
        "own.f": (3, "ended its process by SIGSEGV"),
        "own.g": (0, "gave no answer in 60 s"),
    }


def test_a_text_that_is_no_board_holds_no_call(tmp_path: Path):
    assert calls.read_board(tmp_path / "none") is None
    (tmp_path / "short").write_bytes(b"1")
    assert calls.read_board(tmp_path / "short") is None


def test_code_of_others_asks_for_a_supervisor_only_within_a_command_that_has_none():
    calls.require_supervision()
    with calls.supervision_required(), pytest.raises(calls.UnsupervisedError):
        calls.require_supervision()
    calls.require_supervision()


def test_a_name_is_shortened_beyond_200_bytes_and_keeps_both_its_ends():
    exact = "a" * 199 + "z"
    assert calls._shortened(exact) == exact
    assert calls._shortened(f"b{exact}") == f"b{'a' * 97}…{'a' * 97}z"
    assert calls._shortened("é" * 101) == f"{'é' * 49}…{'é' * 49}"


def test_a_call_is_interrupted_by_its_board_only_while_it_runs(tmp_path: Path):
    board = calls.Board(tmp_path)
    board.interrupt()
    usual = calls.patience()
    assert board.call("own.g", lambda: 5, (), False) == 5
    assert board.call("own.f", lambda x, y: x - y, (7, 5), False) == 2
    for _ in range(2):
        with pytest.raises(CallError) as error:
            board.call("own.f", board.interrupt, (), False)
        assert str(error.value) == f"own.f gave no answer in {usual:g} s"
    assert (board.barred, board.busy) == ({"own.f": (0, f"gave no answer in {usual:g} s")}, False)
    assert calls.read_board(tmp_path / str(os.getpid())) is None
    board.interrupt()
    assert board.call("own.g", lambda: 5, (), False) == 5


def test_a_process_that_is_supervised_has_a_board_and_knows_what_is_barred(
    tmp_path: Path, monkeypatch
):
    heard: list[tuple] = []
    monkeypatch.setattr(calls, "_board", None)
    monkeypatch.setattr(calls, "dump_stack_on_request", lambda file: heard.append((file.name,)))
    monkeypatch.setattr(signal, "signal", lambda *of: heard.append(of))
    monkeypatch.setenv(calls.BARRED, calls.packed({"own.f": (3, "died")}))
    monkeypatch.delenv(calls.BOARDS, raising=False)
    calls._begin()
    assert (calls._board, calls.boards(), heard) == (None, None, [])
    monkeypatch.setenv(calls.BOARDS, str(tmp_path / "gone"))
    calls._begin()
    assert (calls._board, calls.boards(), heard) == (None, tmp_path / "gone", [])
    monkeypatch.setenv(calls.BOARDS, str(tmp_path))
    calls._begin()
    board: Any = calls._board
    assert board.barred == {"own.f": (3, "died")}
    stack = tmp_path / f"{os.getpid()}.{calls.STACK}"
    assert heard == [(str(stack),), (signal.SIGUSR1, board.interrupt)]
    assert {*tmp_path.iterdir()} == {stack, tmp_path / str(os.getpid())}


def test_patience_is_told_to_processes_that_start_from_here(monkeypatch):
    monkeypatch.setattr(calls, "_patience", [60.0])
    monkeypatch.setenv(calls.PATIENT, "60")
    calls.set_patience(2.5)
    assert (calls.patience(), os.environ[calls.PATIENT]) == (2.5, "2.5")
    assert [calls._limit(*of) for of in ((0, False), (1, False), (1, True))] == [12.5, 2.5, 12.5]


def test_what_is_of_this_package_is_told_by_its_module():
    kinds = [type("X", (), {"__module__": x}) for x in ("eomcheck.calls", "eomcheck_own", "own")]
    assert [calls.is_ours(x) for x in kinds] == [True, False, False]
    assert not calls.is_ours(SimpleNamespace(__module__=None))


# ---- Off the main thread -------------------------------------------------------------------------


def in_thread(function, *arguments):
    """Return what a function answers in a thread, or the CallError that it raises."""
    with ThreadPoolExecutor(1) as pool:
        future = pool.submit(function, *arguments)
        try:
            return future.result(30)
        except CallError as error:
            return str(error)


def lines_of(function) -> range:
    """Return the numbers of the lines of a function."""
    lines, first = inspect.getsourcelines(function)
    return range(first, first + len(lines))


def without_line(text) -> str:
    """Return the end of a call without the line of this file that it names."""
    assert str(text).count(" (test_supervised.py, line ") == 1
    return str(text).partition(" (")[0]


def busy(seconds: float) -> str:
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        pass
    return "done"


@pytest.fixture
def remote(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make this process one that works for a command elsewhere, with a patience of 0.2 s."""
    monkeypatch.setattr(calls, "_threads", calls.ThreadWatch())
    monkeypatch.setattr(calls, "_remote", [False])
    monkeypatch.setattr(calls, "_patience", [60.0])
    monkeypatch.setenv(calls.PATIENT, "60")
    monkeypatch.setattr(calls, "WATCH", 0.02)
    calls.work_for(0.2)


def test_a_call_off_the_main_thread_that_does_not_return_is_interrupted(remote):
    def both():
        first = in_call(4.0)
        return first, in_call(0.0), in_call(4.0), in_call(0.0)

    def in_call(seconds: float) -> str:
        try:
            return calls.call("own.f", busy, seconds)
        except CallError as error:
            return str(error)

    began = time.monotonic()
    gone = "own.f gave no answer in {} (test_supervised.py, line {})"
    first_limit = "1 s, 5 times the limit of 0.2 s for a first call"
    first, *others = in_thread(both)
    assert first in [gone.format(first_limit, line) for line in lines_of(busy)]
    assert others[::2] == ["done", "done"]
    assert others[1] in [gone.format("0.2 s", line) for line in lines_of(busy)]
    assert time.monotonic() - began < 10


def test_a_call_off_the_main_thread_without_an_answer_is_not_made_again(remote, monkeypatch):
    monkeypatch.setattr(calls, "_board", SimpleNamespace(barred={"own.g": (1, "died")}))
    gone = in_thread(said, "own.f", busy, 4.0)
    first_limit = "1 s, 5 times the limit of 0.2 s for a first call"
    assert without_line(gone) == f"own.f gave no answer in {first_limit}"
    assert in_thread(said, "own.f", pytest.fail) == gone
    assert in_thread(said, "own.g", busy, 0.0) == "done"
    assert in_thread(said, "own.g", pytest.fail) == "own.g died"


def said(name: str, *what: Any) -> str:
    """What a call returns, or the text of its error."""
    try:
        return calls.call(name, *what)
    except CallError as error:
        return str(error)


@pytest.mark.parametrize("early", [[], [signal.SIGTERM]])
def test_signals_are_handed_on_once_whenever_they_come(early, monkeypatch):
    sent, heard = [], []
    monkeypatch.setattr(os, "kill", lambda pid, number: sent.append((pid, number)))
    with supervisor._handing_on(heard) as hand_on_to:
        for number in early:
            signal.raise_signal(number)
        assert not sent
        hand_on_to(5)
        signal.raise_signal(signal.SIGINT)
    assert sent == [(5, number) for number in heard]
    assert heard == [*early, signal.SIGINT]


def test_nested_calls_off_the_main_thread_count_once(remote):
    def nested():
        calls.call("own.g", busy, 0.0)
        return calls.call("own.g", busy, 0.5)

    # The first call of a name may take five times as long, and so may all that it calls.
    assert in_thread(calls.call, "own.f", nested) == "done"
    gone = in_thread(calls.call, "own.f", busy, 4.0)
    assert without_line(gone) == "own.f gave no answer in 0.2 s"


def test_a_thread_of_a_process_that_works_for_no_command_is_left_alone(remote, monkeypatch):
    monkeypatch.setattr(calls, "_remote", [False])
    for _ in range(2):
        assert in_thread(calls.call, "own.f", busy, 0.5) == "done"


def test_work_on_a_dask_worker_has_the_patience_of_its_command(remote):
    work = pickle.dumps((_hanging, 4.0))
    calls.set_patience(60.0)
    gone = in_thread(guarded, sources(), work, 0.2)
    assert without_line(gone).startswith("own.f gave no answer in 1 s, 5 times the limit of 0.2 s")
    assert Dask("tcp://nowhere:1").call(len, "")[3] == calls.patience() == 0.2


def _hanging(seconds: float) -> str:
    return calls.call("own.f", busy, seconds)


# ---- The supervisor ------------------------------------------------------------------------------


def test_the_verdict_comes_over_the_pipe(tmp_path: Path):
    assert ended(tmp_path, "pass") == ProcessEnd(3)


@pytest.mark.parametrize(
    ("body", "how"),
    [
        ("os._exit(0)", "ended its process with exit code 0"),
        ("os._exit(7)", "ended its process with exit code 7"),
        ("os.kill(os.getpid(), signal.SIGSEGV)", "ended its process by SIGSEGV"),
    ],
)
def test_a_process_without_a_verdict_died_and_its_call_is_known(tmp_path: Path, body, how):
    end = ended(tmp_path, body)
    assert (end.code, end.signal, end.how, end.stopped) == (None, 0, how, False)
    assert end.call is not None
    assert (end.call.name, end.call.number, end.call.slow) == ("own.f", 1, False)


def test_a_call_that_does_not_return_is_interrupted_and_the_process_goes_on(tmp_path, capfd):
    assert ended(tmp_path, "time.sleep(100)", patience=0.2) == ProcessEnd(3)
    assert capfd.readouterr().out == "caught: own.f gave no answer in 0.2 s\n"


def test_a_first_call_has_more_patience_than_later_ones(tmp_path: Path, capfd):
    assert ended(tmp_path, "time.sleep(0.4)", 1, patience=0.2) == ProcessEnd(3)
    assert capfd.readouterr().out == ""


def test_many_quick_calls_are_no_long_one(tmp_path: Path, monkeypatch):
    """Looked at as often as it may be: each call has the time that it takes itself."""
    clock, sent = [1.0], []
    monkeypatch.setattr(time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(os, "kill", lambda pid, number: sent.append((pid, number)))
    monkeypatch.setattr(calls, "_patience", [1.0])
    board, watch = calls.Board(tmp_path), supervisor._Watch(tmp_path)

    def lasting(seconds: float) -> None:
        for _ in range(round(seconds / supervisor.POLL)):
            clock[0] += supervisor.POLL
            watch.poll()

    for _ in range(30):
        board.call("own.f", lasting, (0.1,), False)
    assert sent == []
    board.call("own.f", lasting, (1.1,), False)
    assert sent == [(os.getpid(), signal.SIGUSR1)]


def test_a_call_over_its_limit_is_interrupted_once_and_killed_after_its_grace(
    tmp_path: Path, monkeypatch
):
    clock, sent, board = [100.0], [], [calls.Call(1.0, 1.0, 3, "own.f", False)]
    monkeypatch.setattr(time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(os, "kill", lambda pid, number: sent.append((pid, number)))
    monkeypatch.setattr(calls, "read_board", lambda path: board[0] if path.name == "17" else None)
    for name in ("17", "18", "16.why"):
        (tmp_path / name).touch()
    watch = supervisor._Watch(tmp_path)

    def looks_until(count: int) -> int:
        """Return the number of looks, 1/16 s apart, until so many signals were sent."""
        for i in range(100):
            if len(sent) == count:
                return i
            clock[0] += 0.0625
            watch.poll()
        return 100

    # It was there at the first look already, and its limit is 1 s: 16 looks, and more than that.
    assert looks_until(1) == 18 and sent == [(17, signal.SIGUSR1)]
    assert not (tmp_path / "17.why").exists()
    # While this process was stopped, nothing is counted but four polls, of 0.02 s each here.
    clock[0] += 1000.0
    watch.poll()
    assert looks_until(3) == 4
    assert sent[1:] == [(17, signal.SIGUSR2), (17, signal.SIGKILL)]
    assert (tmp_path / "17.why").read_text() == "gave no answer in 1 s"
    board[0] = board[0]._replace(began=2.0)
    assert looks_until(4) == 18 and sent[3:] == [(17, signal.SIGUSR1)]


@pytest.mark.parametrize(
    ("body", "how"),
    [(UNINTERRUPTED, "gave no answer in 0.2 s"), ("os.abort()", "ended its process by SIGABRT")],
)
def test_the_line_of_a_call_that_python_cannot_interrupt_is_known(tmp_path: Path, body, how):
    own, boards = tmp_path / "own.py", tmp_path / "boards"
    boards.mkdir()
    own.write_text(f"import collections, itertools, os\n\n\ndef f():\n    {body}\n")
    code = f"import runpy; runpy.run_path({str(own)!r})['f']()"
    end = ended(boards, code, patience=0.2)
    assert (end.code, end.how) == (None, f"{how} (own.py, line 5)")


def test_a_stack_names_the_innermost_line_of_a_users_file():
    files = "/home/me/first.py", "/home/me/model.py", np.__file__, calls.__file__
    lines = [f'  File "{file}", line {k} in f' for k, file in enumerate(files, 1)]
    dumped = "\n".join(["older", "Stack (most recent call first):", *lines[::-1]])
    at = calls.dumped_line(dumped)
    assert at is not None and (at.filename, at.lineno) == ("/home/me/model.py", 2)
    # Where no file is a user's, that of an adapter or of a library.
    at = calls.dumped_line("\n".join(lines[:1:-1]))
    assert at is not None and at.filename == np.__file__
    assert calls.dumped_line("no stack") is None
    assert calls.dumped_line('  File "<string>", line 3 in f') is None


# ---- Limits in a script --------------------------------------------------------------------------


def test_a_script_limits_calls_in_a_block_and_no_others(monkeypatch):
    monkeypatch.setattr(calls, "WATCH", 0.01)
    monkeypatch.setenv(calls.PATIENT, "60")
    before = signal.getsignal(signal.SIGUSR1), calls.patience(), calls._threads
    began = time.monotonic()
    with eomcheck.time_limit(0.02):
        for _ in range(2):  # it waits in C, and is not called again
            with pytest.raises(CallError, match=r"own\.f gave no answer in 0\.1 s"):
                calls.call("own.f", time.sleep, 9.0)
        assert in_thread(calls.call, "own.f", pytest.fail).startswith("own.f gave no answer")
        assert calls.call("own.g", lambda: 5) == 5
    assert time.monotonic() - began < 5
    assert calls.call("own.f", lambda: 6) == 6
    assert (signal.getsignal(signal.SIGUSR1), calls.patience(), calls._threads) == before


def test_a_hang_is_a_finding_with_its_line_and_its_state():
    def M(q):
        while q[0] > 0.0:
            pass
        return np.eye(1)

    with eomcheck.time_limit(0.02):
        findings = eomcheck.testing.check_functions(1, M=M, states=[([-0.5], [0.0]), ([0.5], [0])])
    (failed,) = [x for x in findings if x.verdict == "failed"]
    assert (failed.claim, failed.subject) == ("answers", "M")
    assert failed.state is not None and failed.state.q.tolist() == [0.5]
    line = lines_of(M)[1]
    assert re.fullmatch(
        rf"M gave no answer in .* s \(test_supervised.py, line ({line}|{line + 1})\)",
        failed.detail,
    )


def test_the_printed_code_of_a_hang_ends_by_its_time_limit(tmp_path: Path):
    path = tmp_path / "hangs.py"
    path.write_text("import time\nn = 1\ndef M(q):\n    time.sleep(9)\n")
    begun = time.monotonic()
    with eomcheck.time_limit(0.02):
        (failed,) = eomcheck.check(str(path), states=1).failures
        code = failed.as_python()
    assert "with eomcheck.time_limit(0.02):\n    for finding in check_functions(" in code
    seen = io.StringIO()
    with redirect_stdout(seen):
        exec(code, {})
    limit = "0.1 s, 5 times the limit of 0.02 s for a first call"
    text = f"M gave no answer in {limit} (hangs.py, line 4)"
    assert failed.detail == text and text in seen.getvalue()
    assert time.monotonic() - begun < 8


@pytest.mark.parametrize("seconds", [0, -1.0, float("nan"), 2e6])
def test_a_limit_is_a_positive_number_of_seconds(seconds):
    expected = r"patience = .*, expected seconds, a positive number"
    with pytest.raises(InputError, match=expected), eomcheck.time_limit(seconds):
        pytest.fail("no limit")


def test_a_call_that_cannot_be_interrupted_is_killed(tmp_path: Path):
    begun = time.monotonic()
    end = ended(tmp_path, UNINTERRUPTED, patience=0.2)
    assert (end.code, end.how) == (None, "gave no answer in 0.2 s")
    assert end.call is not None
    assert end.call.name == "own.f"
    assert time.monotonic() - begun < 20


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_are_handed_on_and_end_the_process_as_they_would(tmp_path: Path, number):
    body = "print('ready', flush=True); time.sleep(10)"

    def hand_on():
        while not list(tmp_path.glob("[0-9]*")):
            time.sleep(0.02)
        time.sleep(0.3)
        os.kill(os.getpid(), number)

    timer = threading.Thread(target=hand_on)
    timer.start()
    end = ended(tmp_path, body)
    timer.join()
    assert (end.code, end.stopped) == (None, True)
    assert end.signal == number
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_supervised_process_ends_with_the_one_that_supervises_it(tmp_path: Path):
    note = tmp_path / "pid"
    (tmp_path / "boards").mkdir()
    inner = child(f"open({str(note)!r}, 'w').write(str(os.getpid())); time.sleep(100)")
    code = (
        "from pathlib import Path; from eomcheck.supervisor import supervise; "
        f"supervise({inner!r}, Path({str(tmp_path / 'boards')!r}))"
    )
    parent = subprocess.Popen([sys.executable, "-c", code])
    until = time.monotonic() + 20
    while not (note.exists() and note.read_text()) and time.monotonic() < until:
        time.sleep(0.02)
    parent.kill()
    parent.wait()
    pid = int(note.read_text())
    while Path(f"/proc/{pid}/stat").exists() and time.monotonic() < until:
        if Path(f"/proc/{pid}/stat").read_text().split()[2] == "Z":
            break
        time.sleep(0.02)
    assert time.monotonic() < until


def test_how_a_process_died_is_told_in_words(tmp_path: Path):
    assert why_died(tmp_path, 1, 4) == "ended its process with exit code 4"
    assert why_died(tmp_path, 1, -9) == "ended its process by SIGKILL"
    assert why_died(tmp_path, 1, -63) == "ended its process by signal 63"
    (tmp_path / "1.why").write_text("gave no answer in 60 s")
    assert why_died(tmp_path, 1, -9) == "gave no answer in 60 s"
    assert why_died(tmp_path, None, None) == "ended its process with exit code None"


# ---- A command is run again without the call that ended it ---------------------------------------


class Ends:
    """Stands for `supervise`: gives one End after another and keeps which calls were barred."""

    def __init__(self, *ends: ProcessEnd):
        self.ends, self.barred = list(ends), list[dict]()

    def __call__(self, command, folder, environment) -> ProcessEnd:
        self.barred.append(calls.unpacked(environment[calls.BARRED]))
        return self.ends.pop(0)


def dead(
    number: int = 4,
    slow: bool = False,
    stopped: bool = False,
    call: bool = True,
    name: str = "own.f",
) -> ProcessEnd:
    at = calls.Call(1.0, 60.0, number, name, slow) if call else None
    return ProcessEnd(None, 0, "ended its process by SIGSEGV", at, stopped)


@pytest.mark.parametrize(
    ("ends", "barred", "code", "printed"),
    [
        ([ProcessEnd(0)], [{}], 0, False),
        ([ProcessEnd(2)], [{}], 2, False),
        ([dead(), ProcessEnd(1)], [{}, 4], 1, False),
        # Nothing failed where the call was not made: the death itself is the failure.
        ([dead(), ProcessEnd(0)], [{}, 4], 1, True),
        ([dead(), dead(9), ProcessEnd(1)], [{}, 4, 0], 1, False),
        ([dead(), dead(), dead(), ProcessEnd(1)], [{}, 4, 0], 1, True),
        ([dead(slow=True), ProcessEnd(0)], [{}], 1, True),
        ([dead(stopped=True), ProcessEnd(0)], [{}], 1, True),
        ([dead(call=False), ProcessEnd(0)], [{}], 1, True),
    ],
)
def test_a_command_that_died_is_run_again_without_that_call(
    monkeypatch, capsys, ends, barred, code, printed
):
    ran = Ends(*ends)
    monkeypatch.setattr(supervisor, "supervise", ran)
    assert supervisor.run_supervised(["validate"]) == code
    why = "ended its process by SIGSEGV"
    assert ran.barred == [x if x == {} else {"own.f": (x, why)} for x in barred]
    out = capsys.readouterr().out
    name = "eomcheck" if ends[0].call is None and ends[0].code is None else "own.f"
    assert out == (f"died: {name} {why}\n" if printed else "")


@pytest.mark.parametrize("last", [[ProcessEnd(0)], [dead(name="own.f")], [dead(call=False)]])
def test_every_function_that_ended_a_process_is_named_once(monkeypatch, capsys, last):
    monkeypatch.setattr(supervisor, "supervise", Ends(dead(), dead(name="own.g"), *last))
    assert supervisor.run_supervised(["validate"]) == 1
    why = "ended its process by SIGSEGV"
    names = ["own.f", "own.g", *(["eomcheck"] if last[0] == dead(call=False) else [])]
    assert capsys.readouterr().out == "".join(f"died: {name} {why}\n" for name in names)


def test_a_command_runs_the_words_after_its_name_with_this_python(monkeypatch):
    ran: list[Any] = []

    def supervised(command: Any, folder: Path, environment: Any) -> ProcessEnd:
        ran.append((command, folder.is_dir(), [*folder.iterdir()], environment))
        return ProcessEnd(7)

    monkeypatch.setattr(supervisor, "supervise", supervised)
    assert supervisor.run_supervised(["validate", "--scene", "x.py:X"]) == 7
    ((command, *rest),) = ran
    code = "from eomcheck.cli import main; main()"
    assert command[0] == sys.executable
    assert command[-6:] == ["-P", "-c", code, "validate", "--scene", "x.py:X"]
    assert rest == [True, [], {calls.BARRED: "{}"}]


def test_a_command_ends_by_the_signal_that_ended_its_process(monkeypatch):
    done: list[tuple] = []
    monkeypatch.setattr(os, "kill", lambda *of: done.append(of))
    monkeypatch.setattr(signal, "signal", lambda *of: done.append(of))
    monkeypatch.setattr(
        supervisor, "supervise", Ends(ProcessEnd(None, signal.SIGTERM, "x", None, True))
    )
    assert supervisor.run_supervised(["validate"]) == 1
    assert done == [(signal.SIGTERM, signal.SIG_DFL), (os.getpid(), signal.SIGTERM)]


@pytest.mark.parametrize(("seconds", "times"), [(600.0, 2), (601.0, 1)])
def test_a_command_is_run_again_for_ten_minutes(monkeypatch, seconds, times):
    clock, ran = [50.0], Ends(dead(), ProcessEnd(1))

    def supervised(*of: Any) -> ProcessEnd:
        clock[0] += seconds
        return ran(*of)

    monkeypatch.setattr(time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(supervisor, "supervise", supervised)
    assert supervisor.run_supervised(["validate"]) == 1
    assert len(ran.barred) == times


def test_signals_that_are_ignored_stay_so_and_handlers_come_back(monkeypatch):
    numbers = signal.SIGINT, signal.SIGTERM
    before = [
        signal.signal(*x) for x in zip(numbers, (signal.SIG_IGN, signal.SIG_DFL), strict=True)
    ]
    sent: list[tuple] = []
    monkeypatch.setattr(os, "kill", lambda *of: sent.append(of))
    try:
        with supervisor._handing_on([]) as hand_on_to:
            assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
            hand_on_to(5)
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGTERM)
        assert sent == [(5, signal.SIGTERM)]
        assert [signal.getsignal(x) for x in numbers] == [signal.SIG_IGN, signal.SIG_DFL]
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


def test_a_process_takes_its_pipes_once_and_hands_none_of_them_on(monkeypatch):
    monkeypatch.delenv(calls.VERDICT, raising=False)
    assert supervisor.accept_supervision() is None
    verdict, lifeline = os.pipe(), os.pipe()
    for pipe in (verdict[1], lifeline[0]):
        os.set_inheritable(pipe, True)
    monkeypatch.setenv(calls.VERDICT, f"{verdict[1]} {lifeline[0]}")
    monkeypatch.setattr(threading.Thread, "start", lambda self: self.daemon or pytest.fail("stays"))
    assert supervisor.accept_supervision() == verdict[1]
    assert calls.VERDICT not in os.environ
    assert not os.get_inheritable(verdict[1]) and not os.get_inheritable(lifeline[0])
    supervisor.report_exit_code(verdict[1], 42)
    assert os.read(verdict[0], 10) == b"42\n"
    for pipe in (*verdict, *lifeline):
        os.close(pipe)
    supervisor.report_exit_code(verdict[1], 42)


def test_a_command_that_died_late_is_not_run_again(monkeypatch, capsys):
    ran = Ends(dead(), ProcessEnd(0))
    monkeypatch.setattr(supervisor, "supervise", ran)
    monkeypatch.setattr(supervisor, "AGAIN", -1.0)
    assert supervisor.run_supervised(["validate"]) == 1
    assert len(ran.barred) == 1
