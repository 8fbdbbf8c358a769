"""Guarded calls of code outside this package: a user's file, or an outside library.

Such code is only called through `call`: it records the call on a *board* (a small memory-mapped
file per process, readable after a crash), limits its time and restores the floating-point
environment. The contract of `call` has five rules:

1. The result and every `Exception` pass through unchanged, but for rule 5, and so does
   KeyboardInterrupt. Any other BaseException (SystemExit, GeneratorExit, ...) comes out as a
   `CallError`: it ends the call, not the command.
2. In a process of a supervised command (`eomcheck.supervisor`) each call is written on the board of
   its process before it begins and erased when it returns. The supervisor reads the board, so
   it knows which call a process died in, and how long a call has been running.
3. A call that runs longer than `patience` seconds (`FIRST` times as long if it is the first of its
   name, or an import) is interrupted and comes out as a `CallError`, "gave no answer in 60 s
   (own.py, line 7)". A process that cannot be interrupted is killed; C code of Python's
   `faulthandler` reports its line. Off the main thread, and so in a dask worker, only Python code
   can be interrupted. In a process without a supervisor `time_limit` does the same, without the
   killing; otherwise nothing is limited there.
4. A function in which a process died or gave no answer is not called again: from the call on that
   ended the process, `call` raises the `CallError` at once. So a command that is run again after a
   death comes to a finding. A worker elsewhere outlives the command, and calls it again.
5. The floating-point rounding mode, and whether subnormal numbers are flushed to zero, are restored
   after each call. A call that changed them comes out as a `CallError` that also names the
   exception it raised, if any. Exempt are imports, since libraries compiled with -ffast-math change
   them, and errors that eomcheck raises on purpose.

Calls do not nest: within a call only the outermost one counts.
"""

from __future__ import annotations

import ctypes
import faulthandler
import mmap
import os
import re
import signal
import struct
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial, wraps
from pathlib import Path
from traceback import FrameSummary, extract_tb
from typing import IO, Any, NamedTuple, TypeVar

from eomcheck.errors import (
    CallError,
    EomcheckError,
    InputError,
    innermost_outside,
    located,
    raised,
)

# ---- Floating-point environment ------------------------------------------------------------------

ONE, LITTLE = 1.0, 2.0**-60
SMALLEST = sys.float_info.min
"""The smallest normal number; half of it is subnormal."""

ROUNDING = "changes the floating-point rounding mode"
FLUSHING = "turns on flushing of subnormal numbers to zero"


def environment_change() -> str:
    """Return the change from the default environment: `ROUNDING`, `FLUSHING`, or ""."""
    nearest = ONE + LITTLE == ONE == ONE - LITTLE
    if nearest and SMALLEST * 0.5 > 0.0:
        return ""
    return FLUSHING if nearest else ROUNDING


def restore_environment() -> None:
    """Restore the default floating-point environment."""
    # If the C library has no such function, a change is still reported.
    with suppress(OSError, TypeError, AttributeError, ValueError):
        library = ctypes.CDLL(None)
        apple = sys.platform == "darwin"
        address = ctypes.c_char.in_dll(library, "_FE_DFL_ENV") if apple else None
        default = ctypes.c_void_p(-1) if address is None else ctypes.byref(address)
        library.fesetenv(default)


# ---- Guarded calls -------------------------------------------------------------------------------

T = TypeVar("T")

PATIENCE = 60.0
"""Default time limit of a call, s."""
FIRST = 5
"""Factor on the time limit of the first call of a name, and of an import."""

WATCH = 0.1
"""Polling interval for calls off the main thread, s."""

VERDICT = "EOMCHECK_VERDICT"
"""Environment variable of a supervised command: the pipe for its exit code, and the lifeline."""
BOARDS = "EOMCHECK_BOARDS"
"""Environment variable of its processes: the folder of their boards."""
PATIENT = "EOMCHECK_PATIENCE"
"""Environment variable of its processes: time limit of a call, s."""
BARRED = "EOMCHECK_BARRED"
"""Environment variable of its processes: name -> (number, why) of the calls that ended one."""

_HEAD = struct.Struct("<ddqqq")
_LONGEST = 200
_SIZE = _HEAD.size + _LONGEST


def is_ours(of: Any) -> bool:
    """Return whether a class or function is of this package; False if it has no module."""
    return (of.__module__ or "").startswith("eomcheck.")


class UnsupervisedError(BaseException):
    """A command is about to run code of a user's file without a supervisor."""


class _NoAnswer(BaseException):
    """A call has exceeded its time limit; raised within that call."""


class Call(NamedTuple):
    """A call in progress, as read from a board.

    Attributes:
        began: start time by `time.monotonic`, s.
        limit: time limit, s.
        number: number of earlier calls of this name in this process.
        name: of the function, such as "Engine.bias".
        slow: whether it may take longer in any case, as an import.
    """

    began: float
    limit: float
    number: int
    name: str
    slow: bool


Barred = dict[str, tuple[int, str]]
"""Barred calls: name of a function (`_shortened`) -> (number of the first barred call, why)."""


def _refuse(barred: Barred, name: str, key: str, number: int) -> None:
    """Raise `CallError` if this call of a function is barred."""
    if key in barred and number >= barred[key][0]:
        raise CallError(name, barred[key][1])


def _no_answer(barred: Barred, name: str, key: str, limit: float, stop: _NoAnswer) -> CallError:
    """Bar a function that gave no answer in `limit` s, and return its `CallError` with the line."""
    text = no_answer_text(limit, patience())
    why = located(text, call_line(extract_tb(stop.__traceback__)))
    barred[key] = 0, why
    return CallError(name, why)


NO_ANSWER = "gave no answer in "


def no_answer_text(limit: float, usual: float) -> str:
    """Return the description of a call that is over its time limit.

    Args:
        limit: the time limit of this call, s.
        usual: that of later calls, s.
    """
    longer = f", {limit / usual:g} times the limit of {usual:g} s for a first call"
    return f"{NO_ANSWER}{limit:g} s{longer if limit > usual else ''}"


def call_line(frames: Sequence[FrameSummary]) -> FrameSummary | None:
    """Return the frame of a call that is named as its place, None if there is none.

    Args:
        frames: frames of the call, the outermost first. The innermost one in a user's file counts,
            or else the innermost one of all, such as that of an adapter.
    """
    ours = [at for at in frames if at.filename != __file__ and not at.filename.startswith("<")]
    return innermost_outside(frames) or (ours[-1] if ours else None)


class Board:
    """A memory-mapped file with the call in progress in one process, readable after its death."""

    def __init__(self, folder: Path):
        path = folder / str(os.getpid())
        path.write_bytes(bytes(_SIZE))
        with path.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), _SIZE)
        self.counts: Counter[str] = Counter()
        self.barred: Barred = {}
        self.busy = False
        self.limit = 0.0

    def call(self, name: str, function: Callable[..., T], arguments: tuple, slow: bool) -> T:
        """Return function(*arguments), recorded on the board while it runs."""
        if self.busy:
            return function(*arguments)
        key = _shortened(name)
        number = self.counts[key]
        self.counts[key] += 1
        _refuse(self.barred, name, key, number)
        self.limit = _limit(number, slow)
        word = key.encode()
        self._map[_HEAD.size : _HEAD.size + len(word)] = word
        self.busy = True
        try:
            _HEAD.pack_into(self._map, 0, time.monotonic(), self.limit, number, len(word), slow)
            return function(*arguments)
        except _NoAnswer as stop:
            raise _no_answer(self.barred, name, key, self.limit, stop) from None
        finally:
            self.busy = False
            self._map[: _HEAD.size] = bytes(_HEAD.size)

    def interrupt(self, *_: object) -> None:
        """Raise `_NoAnswer` within the call in progress, if there is one."""
        if self.busy:
            raise _NoAnswer


def _limit(number: int, slow: bool) -> float:
    """Return the time limit, s, of a call with `number` earlier calls of its name."""
    return patience() * (FIRST if slow or not number else 1)


def _shortened(name: str) -> str:
    """Return the name of a function cut to `_LONGEST` bytes, its distinctive end included."""
    word, half = name.encode(), _LONGEST // 2 - 2
    if len(word) <= _LONGEST:
        return name
    first, last = (x.decode(errors="ignore") for x in (word[:half], word[-half:]))
    return f"{first}…{last}"


class ThreadWatch:
    """A thread that interrupts calls of this process that exceed their time limits.

    Off the main thread, and on Windows, only Python code can be interrupted.

    Args:
        barred: calls that are barred in a process without a board; by default none ever are.
    """

    def __init__(self, barred: Barred | None = None) -> None:
        self.barred = barred
        self.lock = threading.Lock()
        self.counts: Counter[str] = Counter()
        self.running: dict[int, tuple[float, bool]] = {}
        """Ident of a thread -> (deadline of its call, s; whether it has been interrupted)."""
        self.thread: threading.Thread | None = None

    def call(self, name: str, function: Callable[..., T], arguments: tuple, slow: bool) -> T:
        """Return function(*arguments), interrupted at its time limit."""
        thread, key = threading.get_ident(), _shortened(name)
        barred = self.barred if _board is None else _board.barred
        if barred is None:
            barred = {}
        with self.lock:
            nested = thread in self.running and not self.running[thread][1]
            number = self.counts[key]
            limit = _limit(number, slow)
            if not nested:
                self.counts[key] += 1
                _refuse(barred, name, key, number)
                self.running[thread] = time.monotonic() + limit, False
            if self.thread is None:
                self.thread = threading.Thread(target=self._watch, daemon=True)
                self.thread.start()
        if nested:
            return function(*arguments)
        try:
            try:
                return function(*arguments)
            finally:
                with self.lock:
                    self.running.pop(thread, None)
                    _raise_in(thread, None)  # take back an interrupt that is still pending
        except _NoAnswer as stop:
            self.running.pop(thread, None)
            raise _no_answer(barred, name, key, limit, stop) from None

    def _watch(self) -> None:
        while True:
            time.sleep(WATCH)
            now = time.monotonic()
            with self.lock:
                for thread, (until, interrupted) in self.running.items():
                    if now > until and not interrupted:
                        self.running[thread] = until, True
                        if thread == threading.main_thread().ident and os.name == "posix":
                            signal.pthread_kill(thread, signal.SIGUSR1)  # ends a sleep too
                        else:
                            _raise_in(thread, _NoAnswer)

    def interrupt(self, *_: object) -> None:
        """Raise `_NoAnswer` within the call of the main thread, if it is over its limit."""
        # Without the lock, which this thread may hold.
        if self.running.get(threading.get_ident(), (0.0, False))[1]:
            raise _NoAnswer


def _raise_in(thread: int, error: type[BaseException] | None) -> None:
    """Schedule an exception in another thread; None cancels a pending one."""
    raised = None if error is None else ctypes.py_object(error)
    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), raised)


def read_board(path: Path) -> Call | None:
    """Return the call in progress on a board, or None."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    if len(content) < _SIZE:
        return None
    began, limit, number, length, slow = _HEAD.unpack_from(content)
    if not began:
        return None
    word = content[_HEAD.size : _HEAD.size + length]
    return Call(began, limit, number, word.decode(errors="replace"), bool(slow))


# ---- Stacks of processes that Python no longer controls ------------------------------------------

STACK = "stack"
"""Suffix of the file, beside its board, into which a process writes its stack."""

STACK_HEAD = re.compile(r"^(Fatal Python error|Stack|Current thread)\b", re.MULTILINE)
"""Beginning of a stack that a process writes."""

_DUMPED = re.compile(r'^  File "(.+)", line (\d+) in (.+)$', re.MULTILINE)


def dump_stack_on_request(file: IO) -> None:
    """Write the stack of the main thread into a file at SIGUSR2, and where this process crashes.

    This is done by C code: it needs no lock of Python, which a call in C may hold for ever.
    """
    faulthandler.register(signal.SIGUSR2, file, all_threads=False)
    faulthandler.enable(file, all_threads=False)


def request_stack(pid: int) -> None:
    """Make a process write its stack, see `dump_stack_on_request`, and wait for it a moment."""
    with suppress(ProcessLookupError):
        os.kill(pid, signal.SIGUSR2)
        time.sleep(WATCH)


def dumped_line(text: str) -> FrameSummary | None:
    """Return the place, see `call_line`, of the last stack in a text; None if there is none."""
    *_, last = text.split("(most recent call first)")
    lines = reversed(_DUMPED.findall(last))
    return call_line([FrameSummary(x, int(n), of, lookup_line=False) for x, n, of in lines])


def patience() -> float:
    """Return the time limit of a call, s."""
    return _patience[0]


def set_patience(seconds: float) -> None:
    """Set the time limit of calls, s, in this process and in those that it starts."""
    _patience[0] = seconds
    os.environ[PATIENT] = str(seconds)


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Limit each call of user-supplied code and of outside libraries inside the block.

    A call over its limit is interrupted and is a failure of its function, which is not called again
    inside the block. The first call of a function, and an import, may take `FIRST` times as long.
    Compiled code that does not return to Python cannot be interrupted; the commands of `eomcheck`
    end its process. Without a block there is no limit.

    Args:
        seconds: time limit of a call, s.

    Raises:
        InputError: it is not positive, or above 1e6.

    Example:
        >>> import time, numpy as np, eomcheck
        >>> with eomcheck.time_limit(0.05):
        ...     found = eomcheck.testing.check_functions(1, M=lambda q: time.sleep(9), states=1)
        >>> found[0].verdict, found[0].detail[:26]
        ('failed', 'M gave no answer in 0.25 s')
    """
    global _threads
    checked_patience(seconds)
    before = _threads, _remote[0], patience()
    on_main = threading.current_thread() is threading.main_thread() and os.name == "posix"
    on_main = on_main and _board is None  # a supervisor interrupts calls of its process itself
    _threads = ThreadWatch({})
    handler = signal.signal(signal.SIGUSR1, _threads.interrupt) if on_main else None
    _remote[0] = True
    set_patience(seconds)
    try:
        yield
    finally:
        _threads, _remote[0] = before[:2]
        set_patience(before[2])
        if on_main:
            signal.signal(signal.SIGUSR1, handler)


def checked_patience(seconds: float) -> float:
    """Return a time limit of calls, s.

    Raises:
        InputError: it is no positive number up to 1e6.
    """
    if not 0 < seconds <= 1e6:
        raise InputError(f"patience = {seconds}, expected seconds, a positive number up to 1e6")
    return seconds


def call(name: str, function: Callable[..., T], *arguments: Any, slow: bool = False) -> T:
    """Return function(*arguments), a function of a user's file or an outside library.

    Args:
        name: of the function, such as "Engine.bias".
        function: the function.
        arguments: its arguments.
        slow: whether it may take `FIRST` times as long in any case, as an import.

    Raises:
        CallError: it raised a BaseException that is no Exception, gave no answer in time, killed
            its process, or changed the rounding of float64.
        Exception: raised by the function itself.
    """
    if environment_change():
        restore_environment()  # so that no call is blamed for an earlier change
    what = ""
    try:
        if getattr(function, "limits_itself", False):
            answer = function(*arguments)
        elif threading.current_thread() is threading.main_thread() and _board is not None:
            answer = _board.call(name, function, arguments, slow)
        elif _board is not None or _remote[0]:
            answer = _threads.call(name, function, arguments, slow)
        else:
            answer = function(*arguments)
    except (EomcheckError, KeyboardInterrupt, UnsupervisedError):
        raise
    except BaseException as error:
        what = "" if slow else environment_change()
        if isinstance(error, Exception) and not what:
            raise
        what = f"{what} and {raised(error, None)}" if what else raised(error, None)
        raise CallError(name, what).with_traceback(error.__traceback__) from error
    finally:
        if what := environment_change():
            restore_environment()
    if what and not slow:
        raise CallError(name, what)
    return answer


def limits_itself(function: Callable[..., T]) -> Callable[..., T]:
    """Mark a function that limits its own time, and runs outside code in another process.

    `call` neither writes it on the board nor limits its time: it may have to start that process.
    """
    function.limits_itself = True  # type: ignore[attr-defined]
    return function


def calling(name: str, function: Callable[..., T]) -> Callable[..., T]:
    """Return a wrapper of `function` that goes through `call`, with its name and signature."""

    @wraps(function)
    def called(*arguments: Any, **options: Any) -> T:
        return call(name, partial(function, **options) if options else function, *arguments)

    return called


# ---- Signals -------------------------------------------------------------------------------------


@contextmanager
def handling_signals(handler: Callable[[int, Any], None]) -> Iterator[None]:
    """Handle Ctrl-C and SIGTERM inside the block, unless they are ignored.

    Nothing changes off the main thread, the only one that handles signals.

    Args:
        handler: called with the number of a signal and the handler before the block.
    """
    before: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():
        before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    for number, old in before.items():
        if old not in (signal.SIG_IGN, None):
            signal.signal(number, lambda number, _: handler(number, before[number]))
    try:
        yield
    finally:
        for number, old in before.items():
            if old is not None:
                signal.signal(number, old)


# ---- The processes of a supervised command -------------------------------------------------------

_patience = [float(os.environ.get(PATIENT, PATIENCE))]
_board: Board | None = None
_threads = ThreadWatch()
_remote = [False]
_required = [False]
_stack: list[IO] = []
"""The file for the stack, open as long as the process runs."""


def work_for(seconds: float) -> None:
    """Limit calls in this worker process, which serves a command elsewhere, to `seconds`."""
    _remote[0] = True
    set_patience(seconds)


@contextmanager
def supervision_required() -> Iterator[None]:
    """Make `require_supervision` raise inside the block if this process has no supervisor."""
    _required[0] = True
    try:
        yield
    finally:
        _required[0] = False


def require_supervision() -> None:
    """Declare that code of a user's file or of an outside library that may crash runs from here.

    Raises:
        UnsupervisedError: this is a command that is not supervised yet, see `supervision_required`.
    """
    if _required[0] and _board is None:
        raise UnsupervisedError


def bar(name: str, number: int, why: str) -> None:
    """Bar a call of a function in every process that starts from now on.

    Args:
        name: of the function.
        number: of the first call that is barred.
        why: message of the `CallError`.
    """
    os.environ[BARRED] = packed(unpacked(os.environ.get(BARRED, "{}")) | {name: (number, why)})


def packed(barred: Barred) -> str:
    """Return barred calls, name -> (number, why), as text for an environment variable."""
    import json

    return json.dumps(barred)


def unpacked(text: str) -> Barred:
    """Return the barred calls, name -> (number, why), of a text by `packed`."""
    import json

    return {name: (number, why) for name, (number, why) in json.loads(text).items()}


def boards() -> Path | None:
    """Return the folder of the boards; None if this process has no supervisor."""
    return Path(os.environ[BOARDS]) if BOARDS in os.environ else None


def _begin() -> None:
    """Set the board up in a process of a supervised command."""
    global _board
    folder = boards()
    if folder is None or not folder.is_dir():
        return
    _board = Board(folder)
    _board.barred = unpacked(os.environ.get(BARRED, "{}"))
    _stack.append(folder.joinpath(f"{os.getpid()}.{STACK}").open("w"))
    dump_stack_on_request(_stack[-1])
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGUSR1, _board.interrupt)


_begin()
