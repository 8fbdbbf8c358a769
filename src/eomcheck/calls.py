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
   name, or an import) is interrupted and comes out as a `CallError`, "gave no answer in 60 s". A
   process that cannot be interrupted is killed. Off the main thread, and so in a dask worker, only
   Python code can be interrupted.
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
import mmap
import os
import signal
import struct
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial, wraps
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from eomcheck.errors import CallError, EomcheckError, raised

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


def _no_answer(barred: Barred, name: str, key: str, limit: float) -> CallError:
    """Bar a function that gave no answer in `limit` s, and return its `CallError`."""
    why = f"gave no answer in {limit:g} s"
    barred[key] = 0, why
    return CallError(name, why)


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
        except _NoAnswer:
            raise _no_answer(self.barred, name, key, self.limit) from None
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
    """A thread that interrupts calls off the main thread that exceed their time limits."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.counts: Counter[str] = Counter()
        self.running: dict[int, tuple[float, bool]] = {}
        """Ident of a thread -> (deadline of its call, s; whether it has been interrupted)."""
        self.thread: threading.Thread | None = None

    def call(self, name: str, function: Callable[..., T], arguments: tuple, slow: bool) -> T:
        """Return function(*arguments), interrupted at its time limit."""
        thread, key = threading.get_ident(), _shortened(name)
        barred: Barred = {} if _board is None else _board.barred
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
        except _NoAnswer:
            raise _no_answer(barred, name, key, limit) from None

    def _watch(self) -> None:
        while True:
            time.sleep(WATCH)
            now = time.monotonic()
            with self.lock:
                for thread, (until, interrupted) in self.running.items():
                    if now > until and not interrupted:
                        self.running[thread] = until, True
                        _raise_in(thread, _NoAnswer)


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


def patience() -> float:
    """Return the time limit of a call, s."""
    return _patience[0]


def set_patience(seconds: float) -> None:
    """Set the time limit of calls, s, in this process and in those that it starts."""
    _patience[0] = seconds
    os.environ[PATIENT] = str(seconds)


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
        elif threading.current_thread() is not threading.main_thread():
            if _board is None and not _remote[0]:
                answer = function(*arguments)
            else:
                answer = _threads.call(name, function, arguments, slow)
        elif _board is None:
            answer = function(*arguments)
        else:
            answer = _board.call(name, function, arguments, slow)
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
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGUSR1, _board.interrupt)


_begin()
