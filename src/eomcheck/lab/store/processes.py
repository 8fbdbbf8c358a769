"""A pool of processes on this machine: none hears Ctrl-C, and none outlives its parent."""

from __future__ import annotations

import multiprocessing
import multiprocessing.context
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import (
    Executor,
    ProcessPoolExecutor,
)
from contextlib import contextmanager
from typing import Any

from eomcheck import calls, supervisor
from eomcheck.lab.store.place import Place
from eomcheck.lab.store.provenance import THREADS


class Local(Place):
    """A pool of processes."""

    def __init__(self, workers: int, ahead: int = 1):
        self.workers = workers
        # One ahead, so that no worker waits; not more, for all in hand are suspects when one dies.
        self.width = workers + ahead

    @contextmanager
    def open(self) -> Iterator[Executor]:
        """Provide the pool; leaving early kills its processes, for they do not hear Ctrl-C."""
        context = _Context()
        pool = ProcessPoolExecutor(self.workers, mp_context=context, initializer=_start_worker)
        try:
            # Starts all processes and the thread that looks after them: interrupted between the
            # two, the pool could not be shut down.
            with _no_interrupt():
                pool.submit(os.getpid)
            yield pool
        except BaseException:
            for process in context.started:
                if process.pid is not None:
                    process.terminate()
            pool.shutdown(cancel_futures=True)
            raise
        pool.shutdown()
        for process in context.started:
            _bar_last_call(process)


def _bar_last_call(process: multiprocessing.context.SpawnProcess) -> None:
    """Have no later process make the call of outside code in which this one died, if it did.

    The pool itself ends its processes by SIGTERM where one has died.
    """
    folder, status = calls.boards(), process.exitcode
    if folder is None or status in (None, -signal.SIGTERM):
        return
    last = calls.read(folder / str(process.pid))
    if last is not None:
        calls.bar(last.name, 0, supervisor.why_died(folder, process.pid, status))


class _Process(multiprocessing.context.SpawnProcess):
    """A process that starts with one BLAS thread and does not hear Ctrl-C.

    Both must hold before its first import: a script's own imports come before any initializer, and
    Ctrl-C during them would print a traceback.
    """

    def start(self):
        before = {name: os.environ.get(name) for name in THREADS}
        os.environ.update(dict.fromkeys(THREADS, "1"))
        try:
            with _no_interrupt():
                super().start()
        finally:
            for name, value in before.items():
                if value is None:
                    del os.environ[name]
                else:
                    os.environ[name] = value


@contextmanager
def _no_interrupt() -> Iterator[None]:
    """Put Ctrl-C and SIGTERM off to the end of the block; what starts there never hears Ctrl-C.

    A process that is interrupted between starting another and telling it what to do leaves it
    without its instructions, of which that complains.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # the main thread alone is interrupted
        return
    came: list[int] = []
    # Another thread may catch the signal, hence a handler; a process started inherits the mask.
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    heard = {number: handler for number, handler in before.items() if handler is not None}
    for number in heard:
        signal.signal(number, lambda number, _: came.append(number))
    masks = hasattr(signal, "pthread_sigmask")  # not on Windows
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}) if masks else set()
    try:
        yield
    finally:
        if masks:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for number, handler in heard.items():
            signal.signal(number, handler)
        if came:
            signal.raise_signal(came[0])


class _Context(multiprocessing.context.SpawnContext):
    """The spawn context (a fork would copy the threads' locks), which remembers its processes."""

    def __init__(self):
        super().__init__()
        self.started: list[_Process] = []

    def Process(  # pyright: ignore[reportIncompatibleVariableOverride]
        self, *arguments: Any, **options: Any
    ) -> _Process:
        """Return a new process."""
        self.started.append(_Process(*arguments, **options))
        return self.started[-1]


def _start_worker() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this worker when its parent is gone: after `kill -9` it would wait for work for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
