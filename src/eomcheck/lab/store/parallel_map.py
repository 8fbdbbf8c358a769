"""Parallel map over processes and machines that survives the death of workers.

An address names an `ExecutorBackend`: "local", "local:4" or "dask:tcp://host:8786" (extra
`cluster`); its `open` provides a `concurrent.futures.Executor`. Local processes do not receive
Ctrl-C, and none outlives its parent.

`parallel_map` yields (item, function(item)) as items finish. The items of a worker that dies are
submitted to another; an item that kills every worker, the last time alone in the pool, is reported
after all the others. It is for untimed work.
"""

from __future__ import annotations

import logging
import multiprocessing
import multiprocessing.context
import os
import pickle
import re
import signal
import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from itertools import islice
from typing import Any, TypeVar

from eomcheck import calls, supervisor
from eomcheck.calls import patience, work_for
from eomcheck.deprecated import getattr_of, old_keywords
from eomcheck.errors import DiedError, InputError, WorkerError, required
from eomcheck.lab.store.record_file import THREADS, sources
from eomcheck.safe_output import counted

# ---- Contract ------------------------------------------------------------------------------------


class ExecutorBackend(ABC):
    """A backend that runs work: processes or a cluster."""

    max_pending: int
    """Largest number of items submitted and not finished."""
    killed_error = ""
    """Name of the exception by which the backend reports an item that killed its workers."""

    check_seconds: float | None = None
    """Seconds without a result after which `check` is called; None for never."""

    def check(self) -> None:
        """Raise DiedError where no worker is left."""
        return

    @abstractmethod
    def open(self) -> AbstractContextManager[Executor]:
        """Provide an Executor; whatever leaves the block early cancels the work."""

    def call(self, function: Callable, item: Any) -> tuple:
        """Return the callable and arguments to submit for function(item)."""
        return function, item


# ---- Processes on this machine -------------------------------------------------------------------


class Local(ExecutorBackend):
    """A pool of processes."""

    def __init__(self, workers: int, ahead: int = 1):
        self.workers = workers
        # One ahead, so that no worker waits; not more: any running item may have caused a death.
        self.max_pending = workers + ahead

    @contextmanager
    def open(self) -> Iterator[Executor]:
        """Provide the pool; leaving early kills its processes, since they ignore Ctrl-C."""
        context = _Context()
        pool = ProcessPoolExecutor(self.workers, mp_context=context, initializer=_start_worker)
        try:
            # Starts all processes and the thread that manages them: interrupted between the two,
            # the pool could not be shut down.
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
    """Bar later processes from the call of outside code in which this one died, if it did.

    The pool itself ends its processes by SIGTERM where one has died.
    """
    folder, status = calls.boards(), process.exitcode
    if folder is None or status in (None, -signal.SIGTERM):
        return
    last = calls.read_board(folder / str(process.pid))
    if last is not None:
        calls.bar(last.name, 0, supervisor.why_died(folder, process.pid, status))


class _Process(multiprocessing.context.SpawnProcess):
    """A process that starts with one BLAS thread and ignores Ctrl-C.

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
    """Defer Ctrl-C and SIGTERM to the end of the block; processes started there ignore Ctrl-C.

    A process that is interrupted after starting another, and before sending its instructions,
    leaves that one without them, and it prints a traceback.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # the main thread alone is interrupted
        return
    received: list[int] = []
    # Another thread may catch the signal, hence a handler; a started process inherits the mask.
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    handlers = {number: handler for number, handler in before.items() if handler is not None}
    for number in handlers:
        signal.signal(number, lambda number, _: received.append(number))
    masks = hasattr(signal, "pthread_sigmask")  # not on Windows
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}) if masks else set()
    try:
        yield
    finally:
        if masks:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for number, handler in handlers.items():
            signal.signal(number, handler)
        if received:
            signal.raise_signal(received[0])


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


# ---- dask ----------------------------------------------------------------------------------------

CONNECT_SECONDS = 6
"""Longest wait, s, for a scheduler, and then for its first worker."""

ALONE_SECONDS = 20
"""Longest time, s, for which a scheduler may be without workers while there is work."""
LOGS = "distributed", "distributed.client"
"""Loggers that write tracebacks of their own where a scheduler has died."""


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence the library's loggers for failures that are reported by exceptions."""
    levels = {name: logging.getLogger(name).level for name in LOGS}
    for name in levels:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for name, level in levels.items():
            logging.getLogger(name).setLevel(level)


class Dask(ExecutorBackend):
    """The workers of a dask scheduler, which itself reassigns the work of a lost worker."""

    max_pending = 1024
    killed_error = "KilledWorker"
    check_seconds = 1.0

    def __init__(self, address: str):
        self.address = address
        self._client: Any = None
        self._alone_since: float | None = None

    def check(self) -> None:
        """Raise DiedError where the scheduler has had no worker for `ALONE_SECONDS`."""
        if self._client is None or self._client.scheduler_info()["workers"]:
            self._alone_since = None
            return
        now = time.monotonic()
        self._alone_since = self._alone_since or now
        if now - self._alone_since > ALONE_SECONDS:
            raise DiedError(f"the dask scheduler at {self.address!r} has no workers left")

    def call(self, function: Callable, item: Any) -> tuple:
        """Return a guarded call of function(item) and its arguments."""
        # Pickled here: dask would search an item for futures, and in old versions for tasks.
        return guarded, sources(), pickle.dumps((function, item)), patience()

    @contextmanager
    def open(self) -> Iterator[Executor]:
        """Connect; leaving early cancels items that are not started."""
        make = required("distributed", "cluster").Client
        with _quiet():
            yield from self._opened(make)

    def _opened(self, make: Callable) -> Iterator[Executor]:
        client = self._client = self._connect(make)
        try:
            # pure=False: equal items are computed separately.
            pool = client.get_executor(pure=False)
            try:
                yield pool
            except BaseException:
                # The scheduler may be gone.
                with suppress(Exception):
                    pool.shutdown(wait=False)
                raise
            pool.shutdown()
        finally:
            self._client = None
            client.close()

    def _connect(self, make: Callable) -> Any:
        try:
            client = make(self.address, timeout=CONNECT_SECONDS, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            why = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise InputError(f"no dask scheduler answers at {self.address!r}: {why}") from None
        try:
            client.wait_for_workers(1, timeout=CONNECT_SECONDS)
        except TimeoutError:
            client.close()
            raise InputError(f"the dask scheduler at {self.address!r} has no workers") from None
        return client


_ONE = threading.Lock()


def guarded(digest: str, work: bytes, patient: float) -> Any:
    """Return function(item), computed by the caller's sources, one at a time in this process.

    A dask worker has several threads by default; the precision of ball arithmetic is one per
    process.

    Args:
        digest: digest of the sources of the process that requests the result.
        work: (function, item), pickled.
        patient: time limit of a call of outside code, s.

    Raises:
        WorkerError: this process has other sources of eomcheck than the one that requests the
            result.
    """
    if sources() != digest:
        raise WorkerError("the workers have another version of eomcheck")
    work_for(patient)
    with _ONE:
        function, item = pickle.loads(work)
        return function(item)


# ---- By name -------------------------------------------------------------------------------------


def backend_of(address: str | None) -> ExecutorBackend:
    """Return the backend of an address such as "local:4" or "dask:tcp://host:8786".

    Raises:
        InputError: the address names no backend.
    """
    scheme, _, rest = ("local" if address is None else address).partition(":")
    match scheme:
        case "local" if re.fullmatch(r"|[1-9]\d*", rest) and not (address or "").endswith(":"):
            return Local(int(rest or os.cpu_count() or 1))
        case "dask" if rest:
            return Dask(rest)
    raise InputError(f"executor = {address!r}, expected local, local:NUMBER or dask:ADDRESS")


def check_executor(address: str | None) -> None:
    """Raise at once if an executor cannot be used: connect to a scheduler, and leave.

    Raises:
        InputError, EngineError: see `executor`.
    """
    with executor(address):  # a local pool starts no process before it has work
        pass


def executor(address: str | None = None) -> AbstractContextManager[Executor]:
    """Provide an Executor: None or "local", "local:N" (N processes), "dask:ADDRESS".

    Leaving the block by an exception, Ctrl-C too, cancels the work.

    Raises:
        InputError: no such backend, or no scheduler with a worker answers there.
        EngineError: the library of the backend is not installed.
    """
    return backend_of(address).open()


# ---- Parallel map --------------------------------------------------------------------------------

Item = TypeVar("Item")
Result = TypeVar("Result")

DEATHS_TOGETHER = 2
"""Deaths of workers with an item among those running; after that the item is tried alone."""


@old_keywords
def parallel_map(
    executor: str | None,
    function: Callable[[Item], Result],
    items: Iterable[Item],
    killed: Callable[[Item], Result] | None = None,
) -> Iterator[tuple[Item, Result]]:
    """Yield (item, function(item)), in the order in which they finish.

    Items are consumed as they are submitted. One whose worker dies is submitted to another. One
    that kills every worker, the last time alone in the pool, is left out and reported after all the
    others. An exception of `function` ends everything.

    Args:
        executor: see `eomcheck.lab.store.parallel_map.executor`.
        function: of a module that workers can import (or a `functools.partial` of one).
        items: anything that can be pickled, and so can the results.
        killed: item that killed its workers -> the result in place of an error.

    Raises:
        DiedError: an item killed its workers and there is no `killed`; or no worker is left,
            or the scheduler is gone.
        WorkerError: workers die as they start.
        InputError, EngineError: see `eomcheck.lab.store.parallel_map.executor`.
    """
    backend = backend_of(executor)
    source = map(_Task, items)
    queue: deque[_Task] = deque()
    alone: deque[_Task] = deque()
    given_up: list[_Task] = []
    progressed = True
    while _refilled(queue, source) or alone:
        batch, current, more = (
            (queue, backend, source) if queue else (alone, Local(1, ahead=0), iter(()))
        )
        with current.open() as pool:
            if not progressed:
                _check_start(pool)
            progressed = False
            for task, outcome in _work_off(pool, current, function, batch, more):
                progressed = True
                if isinstance(outcome, _Killed):
                    given_up.append(task)
                else:
                    yield task.item, outcome
        for task in [task for task in batch if task.deaths > DEATHS_TOGETHER]:
            batch.remove(task)
            given_up.append(task)
        if batch is queue:
            suspects = [task for task in queue if task.deaths == DEATHS_TOGETHER]
            for task in suspects:
                queue.remove(task)
            alone.extend(suspects)
    if killed is not None:
        yield from ((task.item, killed(task.item)) for task in given_up)
    elif given_up:
        names = "; ".join(_short(task.item) for task in given_up[:3])
        raise DiedError(f"{counted(len(given_up), 'item')} killed every worker with it: {names}")


@dataclass(eq=False)
class _Task:
    item: Any
    deaths: int = 0


class _Killed:
    """Placeholder for the result of an item that killed its workers."""


def _work_off(
    pool: Executor,
    backend: ExecutorBackend,
    function: Callable,
    queue: deque[_Task],
    more: Iterator[_Task],
) -> Iterator[tuple[_Task, Any]]:
    """Yield (task, result) until queue and `more` are empty, or the pool broken.

    Afterwards the queue holds the tasks that were taken and not done.
    """
    running: dict[Future, _Task] = {}
    broken = False
    while True:
        while not broken and len(running) < backend.max_pending and _refilled(queue, more):
            try:
                future = pool.submit(*backend.call(function, queue[0].item))
            except BrokenExecutor:
                broken = True
            else:
                running[future] = queue.popleft()
        if not running:
            return
        done = wait(running, backend.check_seconds, FIRST_COMPLETED).done
        if not done:
            backend.check()
        for future in done:
            task = running.pop(future)
            try:
                result = future.result()
            except BrokenExecutor:
                # It is not known which of the running items caused it.
                broken = True
                task.deaths += 1
                queue.appendleft(task)
                continue
            except CancelledError:
                raise DiedError("the scheduler is gone, and the work with it") from None
            except Exception as error:
                if type(error).__name__ != backend.killed_error:
                    raise
                result = _Killed()
            yield task, result


def _refilled(queue: deque[_Task], source: Iterator[_Task]) -> deque[_Task]:
    """Take the next task where the queue has none left, and return the queue."""
    if not queue:
        queue.extend(islice(source, 1))
    return queue


def _check_start(pool: Executor) -> None:
    try:
        pool.submit(os.getpid).result()
    except BrokenExecutor:
        raise WorkerError(
            "worker processes die as they start; a script that spreads work must begin it under "
            "`if __name__ == '__main__':`"
        ) from None


def _short(item: object) -> str:
    text = str(getattr(item, "structure", item))
    return text if len(text) <= 60 else text[:57] + "..."


__getattr__ = getattr_of(__name__)
