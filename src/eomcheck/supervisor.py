"""Supervised processes: the exit code comes over a pipe, and a crash or hang becomes a finding.

`supervise` runs a process and returns a `ProcessEnd`, its exit code or the cause of its death:

1. The process inherits two pipes, the verdict and the lifeline. Into the first it writes its exit
   code after all other output; the second it only reads, and ends when that closes, together with
   this process.
2. While it runs, the boards of the process and its workers are read (`eomcheck.calls`). A call
   that exceeds its time limit is interrupted by SIGUSR1, and its process killed `GRACE` seconds
   later.
3. SIGINT and SIGTERM are forwarded. The process has a session of its own, so that Ctrl-C in a
   terminal reaches it once.
4. A process that ends without writing its exit code has died: the `ProcessEnd` names the cause, and
   the call in progress.

`run_supervised` does so with a command of eomcheck. If a process died or was killed in a call, the
command is run again with that call barred, so that it raises an exception: the death then is one
finding among the other findings of the command. This needs POSIX; elsewhere commands run
unsupervised.
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
from eomcheck.errors import located

POLL = 0.25
"""Polling interval of the boards, s."""
GRACE = 5.0
"""Time for a process to return from an interrupted call, or to end after its verdict, s."""
AGAIN = 600.0
"""Time after which a command that dies is not run again, s."""
ATTEMPTS = 3
"""Largest number of runs of a command."""

COMMAND = "from eomcheck.cli import main; main()"


class ProcessEnd(NamedTuple):
    """The exit code of a supervised process, or the cause of its death.

    Attributes:
        code: the exit code that it wrote as its verdict, None if it died.
        signal: number of the forwarded signal that ended it, else 0.
        how: cause of death: "ended with exit code 0", "was ended by SIGSEGV", "gave no answer in
            60 s".
        call: the call in which it died, or None.
        stopped: whether a signal was forwarded to it.
    """

    code: int | None
    signal: int = 0
    how: str = ""
    call: Call | None = None
    stopped: bool = False


class _Watch:
    """Durations of the calls in progress, in the time that this process was awake itself."""

    def __init__(self, folder: Path):
        self.folder = folder
        self._running: dict[int, tuple[Call, float]] = {}
        self._interrupted: dict[int, tuple[Call, float]] = {}
        self._last = time.monotonic()

    def poll(self) -> None:
        """Read the boards; interrupt calls over their limits, and kill processes still in them."""
        now = time.monotonic()
        # Time in which this process was stopped does not count: the others may have been too.
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
                calls.request_stack(pid)
                usual = call.limit / (calls.FIRST if call.slow or not call.number else 1)
                why = _with_line(calls.no_answer_text(call.limit, usual), self.folder, pid)
                _why(self.folder, pid).write_text(why, encoding="utf-8")
                os.kill(pid, signal.SIGKILL)


def supervise(
    command: Sequence[str], folder: Path, environment: Mapping[str, str] | None = None
) -> ProcessEnd:
    """Run a process of this package to its end, and return its exit code or cause of death.

    Args:
        command: program and arguments; it has to call `accept_supervision` or to follow the
            protocol of this module itself.
        folder: an empty folder, for the boards of the process and of its workers.
        environment: variables in addition to those of this process.
    """
    verdict, write = os.pipe()
    read, lifeline = os.pipe()
    variables = {VERDICT: f"{write} {read}", BOARDS: str(folder), **(environment or {})}
    watch, heard = _Watch(folder), list[int]()
    try:
        with _handing_on(heard) as hand_on_to:
            process = subprocess.Popen(
                command,
                env=os.environ | variables,
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
    """Return the cause of death of a process: exit code, signal, or the reason it was killed for.

    Args:
        folder: folder of the boards.
        pid: process id, None if unknown.
        status: exit status, negative of the number of a signal; None if unknown.
    """
    if pid is not None and _why(folder, pid).exists():
        return _why(folder, pid).read_text(encoding="utf-8")
    if status is None or status >= 0:
        return f"ended its process with exit code {status}"
    try:
        why = f"ended its process by {signal.Signals(-status).name}"
    except ValueError:
        why = f"ended its process by signal {-status}"
    return why if pid is None else _with_line(why, folder, pid)


def _with_line(why: str, folder: Path, pid: int) -> str:
    """Return the cause of death with the line in a user's file where the process was, if known."""
    with suppress(OSError):
        text = folder.joinpath(f"{pid}.{calls.STACK}").read_text(encoding="utf-8")
        return located(why, calls.dumped_line(text))
    return why


def _kill_group(process: subprocess.Popen) -> None:
    """Kill the remaining processes of the process group of `process`."""
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)


@contextmanager
def _handing_on(heard: list[int]) -> Iterator[Callable[[int], None]]:
    """Forward SIGINT and SIGTERM inside the block to a process, once its id is known.

    Yields the function that takes the id; `heard` collects the numbers of the signals.
    """
    pids, early = list[int](), list[int]()

    def hand_on(number: int, _: object) -> None:
        heard.append(number)
        if not pids:
            early.append(number)
        for pid in pids:
            with suppress(ProcessLookupError):
                os.kill(pid, number)

    def to(pid: int) -> None:
        pids.append(pid)  # from now on signals are forwarded as they come, each once
        while early:
            os.kill(pid, early.pop(0))

    with calls.handling_signals(hand_on):
        yield to


def run_supervised(words: Sequence[str]) -> int:
    """Run a command of eomcheck in a supervised process, and return its exit code.

    The exit code is 1 if its process died, or gave no answer and could not be interrupted.

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
        # The same command makes the same call again; if it died elsewhere, bar the whole function.
        barred[name] = (0 if name in barred else end.call.number), end.how
    if end.code is None or (deaths and end.code == 0):
        for death in dict.fromkeys(deaths):
            print(f"died: {death}", flush=True)
        return 1
    return end.code


def accept_supervision() -> int | None:
    """Return the pipe for the exit code of this process; None if it has no supervisor.

    From then on this process ends together with its supervisor.
    """
    pipes = os.environ.pop(VERDICT, None)
    if pipes is None:
        return None
    verdict, lifeline = map(int, pipes.split())
    for pipe in (verdict, lifeline):
        os.set_inheritable(pipe, False)

    def end_with_parent() -> None:
        os.read(lifeline, 1)
        os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()
    return verdict


def report_exit_code(verdict: int, code: int) -> None:
    """Write the exit code of this process to the verdict pipe, as its last output."""
    with suppress(OSError):
        os.write(verdict, f"{code}\n".encode())


def can_supervise() -> bool:
    """Return whether this system supports supervision and standard output is not replaced."""
    return os.name == "posix" and bool(sys.executable) and sys.stdout is sys.__stdout__
