"""Process of one library's engines, which answers the requests of `eomcheck.engines.isolation`.

It runs in the environment of the library, where of eomcheck's own dependencies only NumPy is
installed: it imports adapters without the package `eomcheck.engines`, which needs more.
"""

from __future__ import annotations

import ctypes
import importlib
import os
import runpy
import signal
import sys
import threading
import traceback
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from eomcheck import calls
from eomcheck.engines.pipe_protocol import (
    ProtocolError,
    decoded,
    encoded,
    read_bytes,
    write_bytes,
)
from eomcheck.errors import EomcheckError, raised

DEATH_OF_PARENT = 1
"""Linux's `PR_SET_PDEATHSIG`."""


def serve(requests: int, answers: int, lifeline: int, from_main_thread: bool) -> None:
    """Answer requests until the pipe closes.

    Args:
        requests: file descriptor of the pipe that requests come from.
        answers: file descriptor of the pipe for answers.
        lifeline: file descriptor of a pipe that closes with the process that asks.
        from_main_thread: whether the main thread of that process started this one.
    """
    _end_with_parent(lifeline, from_main_thread)
    calls.dump_stack_on_request(sys.stderr)
    engines = _Engines()
    while True:
        try:
            request = decoded(partial(read_bytes, requests))
        except EOFError:
            return
        try:
            reply = encoded(("answer", *engines.answer(*request)))
        except ProtocolError as error:
            reply = encoded(("error", "TypeError", f"returned {error}"))
        except calls.CallError as error:
            reply = encoded(("ended", error.name, error.what))
        except Exception as error:
            reply = encoded(("error", *_described(error)))
        write_bytes(answers, reply)


class _Engines:
    """Engines of this process, by number."""

    def __init__(self) -> None:
        self.engines: dict[int, Any] = {}

    def answer(self, dropped: list[int], task: str, *arguments: Any) -> tuple[Any, Any]:
        """Return the result of a request, and the arguments of a call if it changed them.

        Engines of the numbers `dropped` are forgotten first.
        """
        for number in dropped:
            self.engines.pop(number, None)
        result, changed = getattr(self, f"_{task}")(*arguments), None
        if task == "call":
            result, changed = result
        return result, changed

    def _version(self, home: str, name: str) -> str:
        return calls.call(f"{name}.version", _class_of(home, name).version, slow=True)

    def _make(self, number: int, home: str, name: str, inputs: Any) -> None:
        engine = object.__new__(_class_of(home, name))
        calls.call(f"{name}(scene)", engine.set_up, inputs, slow=True)
        self.engines[number] = engine

    def _get(self, number: int, name: str) -> Any:
        return getattr(self.engines[number], name)

    def _call(self, number: int, method: str, arguments: list[Any]) -> tuple[Any, Any]:
        before = [x.copy() if isinstance(x, np.ndarray) else x for x in arguments]
        engine = self.engines[number]
        name = f"{type(engine).__name__}.{method}"
        result = calls.call(name, getattr(engine, method), *arguments)
        same = all(
            not isinstance(x, np.ndarray) or np.array_equal(x, y, equal_nan=True)
            for x, y in zip(arguments, before, strict=True)
        )
        return result, None if same else arguments


@cache
def _class_of(home: str, name: str) -> type[Any]:
    """Return a class of a module of this package, or of a file."""
    if not home.endswith(".py"):
        return getattr(importlib.import_module(home), name)
    sys.path.append(str(Path(home).parent))
    return calls.call(home, runpy.run_path, home, slow=True)[name]


def _described(error: Exception) -> tuple[str, str]:
    """Return the type and the description of an exception, with its line if it is not ours."""
    if isinstance(error, EomcheckError):
        return type(error).__name__, str(error)
    lines = traceback.extract_tb(error.__traceback__)
    return type(error).__name__, raised(error, lines[-1] if lines else None)


def _end_with_parent(lifeline: int, from_main_thread: bool) -> None:
    """Make this process end with the one that asks, also within a call that never returns."""

    def wait() -> None:
        os.read(lifeline, 1)
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()
    # A thread waits for ever if a library keeps Python's lock. Linux sends this signal where the
    # thread ends that started this process: the main thread ends with its process.
    if sys.platform == "linux" and from_main_thread:
        ctypes.CDLL(None).prctl(DEATH_OF_PARENT, signal.SIGKILL)
