"""A process that is watched over: its verdict comes over a pipe, its absence is a finding.

`supervise` runs a process and returns what became of it, an `ProcessEnd`:

1. The process is told of two pipes. Into the first it writes its exit code once all else is
   written; the second it only reads, and ends when that closes, with this process.
2. While it runs, the boards of the process and its workers are read (`eomcheck.calls`). A call
   that is over its limit is interrupted by SIGUSR1, and `GRACE` seconds later its process killed.
3. SIGINT and SIGTERM are handed on. The process has a session of its own, so that Ctrl-C in a
   terminal comes to it once.
4. A process that ends without its exit code has died: the `ProcessEnd` says how, and in which call.

`run_supervised` does so with a command of eomcheck. Where a process died or was killed in a call,
it runs
the command again, in which that call raises an exception: the finding then is that of the command,
with all that it found otherwise. This needs POSIX; elsewhere commands run unsupervised.
"""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

from eomcheck import calls
from eomcheck.calls import BARRED, BOARDS, VERDICT, Call

POLL = 0.25
"""Seconds between two looks at the boards."""
GRACE = 5.0
"""Seconds that a process has to come back from an interrupted call, or to end after its verdict."""
AGAIN = 600.0
"""A command that died later than after so many seconds is not run again."""
ATTEMPTS = 3
"""So often a command is run at most."""

COMMAND = "from eomcheck.cli import main; main()"


class ProcessEnd(NamedTuple):
    """How a supervised process ended.

    Attributes:
        code: the exit code that it gave as its verdict, None where it died.
        signal: number of the signal that was handed on and ended it, else 0.
        how: what became of a process that died: "ended with exit code 0", "was ended by SIGSEGV",
            "gave no answer in 60 s".
        call: the call in which it died, or None.
        stopped: whether a signal was handed on to it.
    """

    code: int | None
    signal: int = 0
    how: str = ""
    call: Call | None = None
    stopped: bool = False


class _Watch:
    """How long calls in progress have been running, by the time that this process was awake."""

    def __init__(self, folder: Path):
        self.folder = folder
        self._running: dict[int, tuple[Call, float]] = {}
        self._interrupted: dict[int, tuple[Call, float]] = {}
        self._last = time.monotonic()

    def poll(self) -> None:
        """Read the boards; interrupt calls over their limits, and kill what does not come back."""
        now = time.monotonic()
        # Of time in which this process was stopped nobody says what the others did.
        passed, self._last = min(now - self._last, 4 * POLL), now
        for path in self.folder.iterdir():
            if not path.name.isdigit():
                continue
            pid, call = int(path.name), calls.read_board(path)
            if call is None:
                self._running.pop(pid, None)
                continue
            before, seconds = self._running.get(pid, (None, 0.0))
            seconds = seconds + passed if before == call else 0.0
            self._running[pid] = call, seconds
            if seconds > call.limit:
                self._end(pid, call, seconds)

    def _end(self, pid: int, call: Call, seconds: float) -> None:
        known, since = self._interrupted.get(pid, (None, 0.0))
        with suppress(ProcessLookupError):
            if known != call:
                self._interrupted[pid] = call, seconds
                os.kill(pid, signal.SIGUSR1)
            elif seconds - since > GRACE:
                _why(self.folder, pid).write_text(_no_answer(call), encoding="utf-8")
                os.kill(pid, signal.SIGKILL)


def _no_answer(call: Call) -> str:
    return f"gave no answer in {call.limit:g} s"


def supervise(
    command: Sequence[str], folder: Path, environment: Mapping[str, str] | None = None
) -> ProcessEnd:
    """Run a process of this package to its end, and return what became of it.

    Args:
        command: its words; it is to call `accept_supervision` or to keep the rules of this file
            itself.
        folder: an empty folder, for the boards of the process and of its workers.
        environment: variables beside those of this process.
    """
    verdict, write = os.pipe()
    read, lifeline = os.pipe()
    told = {VERDICT: f"{write} {read}", BOARDS: str(folder), **(environment or {})}
    watch, heard = _Watch(folder), list[int]()
    try:
        with _handing_on(heard) as hand_on_to:
            process = subprocess.Popen(
                command,
                env=os.environ | told,
                pass_fds=(write, read),
                start_new_session=True,
            )
            hand_on_to(process.pid)
            os.close(write)
            os.close(read)
            text = b""
            while True:
                ready, _, _ = select.select([verdict], [], [], POLL)
                got = os.read(verdict, 64) if ready else b""
                if ready and not got:
                    break
                text += got
                if text.endswith(b"\n") or (process.poll() is not None and not ready):
                    break
                watch.poll()
            with suppress(subprocess.TimeoutExpired):
                process.wait(GRACE)
            _kill_group(process)
            status = process.wait()
    finally:
        os.close(verdict)
        os.close(lifeline)
    if text.endswith(b"\n"):
        return ProcessEnd(int(text))
    number = -status if -status in heard else 0
    how = why_died(folder, process.pid, status)
    return ProcessEnd(None, number, how, calls.read_board(folder / str(process.pid)), bool(heard))


def _why(folder: Path, pid: int) -> Path:
    return folder / f"{pid}.why"


def why_died(folder: Path, pid: int | None, status: int | None) -> str:
    """Return how a process ended: its exit status, negative of a signal, or that it was killed.

    Args:
        folder: that of the boards.
        pid: of the process.
        status: its exit status.
    """
    if pid is not None and _why(folder, pid).exists():
        return _why(folder, pid).read_text(encoding="utf-8")
    if status is None or status >= 0:
        return f"ended its process with exit code {status}"
    try:
        return f"ended its process by {signal.Signals(-status).name}"
    except ValueError:
        return f"ended its process by signal {-status}"


def _kill_group(process: subprocess.Popen) -> None:
    """Kill what is left of a process and of those that it started."""
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)


@contextmanager
def _handing_on(heard: list[int]) -> Iterator[Callable[[int], None]]:
    """Hand SIGINT and SIGTERM on inside the block to a process, once its number is known."""
    pids, early = list[int](), list[int]()

    def hand_on(number: int, _: object) -> None:
        heard.append(number)
        if not pids:
            early.append(number)
        for pid in pids:
            with suppress(ProcessLookupError):
                os.kill(pid, number)

    def to(pid: int) -> None:
        pids.append(pid)  # from here on signals are handed on as they come, each once
        while early:
            os.kill(pid, early.pop(0))

    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    for number, handler in before.items():
        if handler not in (signal.SIG_IGN, None):
            signal.signal(number, hand_on)
    try:
        yield to
    finally:
        for number, handler in before.items():
            if handler is not None:
                signal.signal(number, handler)


def run_supervised(words: Sequence[str]) -> int:
    """Run a command of eomcheck in a supervised process, and return its exit code.

    A command whose process died, or gave no answer and could not be interrupted, ends with 1.

    Args:
        words: the command line after "eomcheck".
    """
    flags = subprocess._args_from_interpreter_flags()  # type: ignore[attr-defined]
    process = [sys.executable, *flags, "-P", "-c", COMMAND, *words]
    begun, deaths = time.monotonic(), list[str]()
    barred: dict[str, tuple[int, str]] = {}
    while True:
        with tempfile.TemporaryDirectory(prefix="eomcheck-") as folder:
            environment = {BARRED: calls.packed(barred)}
            end = supervise(process, Path(folder), environment)
        if end.code is not None:
            break
        if end.signal:
            signal.signal(end.signal, signal.SIG_DFL)
            os.kill(os.getpid(), end.signal)
        name = "eomcheck" if end.call is None else end.call.name
        deaths.append(f"{name} {end.how}")
        last = end.stopped or time.monotonic() - begun > AGAIN or len(deaths) == ATTEMPTS
        if end.call is None or end.call.slow or last:
            break
        # In the same command the same call comes again; if not, none of this function is made.
        barred[name] = (0 if name in barred else end.call.number), end.how
    if end.code is None or (deaths and end.code == 0):
        for death in dict.fromkeys(deaths):
            print(f"died: {death}", flush=True)
        return 1
    return end.code


def accept_supervision() -> int | None:
    """Return the pipe for the exit code of this process; None if nobody supervises it.

    From then on the process ends with the one that supervises it.
    """
    told = os.environ.pop(VERDICT, None)
    if told is None:
        return None
    verdict, lifeline = map(int, told.split())
    for pipe in (verdict, lifeline):
        os.set_inheritable(pipe, False)

    def end_with_parent() -> None:
        os.read(lifeline, 1)
        os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()
    return verdict


def report_exit_code(verdict: int, code: int) -> None:
    """Write the exit code of this process, its last word."""
    with suppress(OSError):
        os.write(verdict, f"{code}\n".encode())


def can_supervise() -> bool:
    """Return whether processes can be supervised here, and print where this one does."""
    return os.name == "posix" and bool(sys.executable) and sys.stdout is sys.__stdout__
