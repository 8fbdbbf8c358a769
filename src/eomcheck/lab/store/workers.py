"""Untimed work spread over processes and machines: results as they come, a lost worker made good.

Whatever runs the work is a `concurrent.futures.Executor`: a pool of processes on this machine, or
the workers of a dask scheduler (extra `cluster`).
"""

from __future__ import annotations

import multiprocessing
import multiprocessing.context
import os
import pickle
import re
import signal
import threading
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

from eomcheck.errors import InputError, WorkerError, required
from eomcheck.lab.store.provenance import THREADS, sources
from eomcheck.output import counted

Item = TypeVar("Item")
Result = TypeVar("Result")

DEATHS_TOGETHER = 2
"""So often a worker may die while it has an item in hand; after that the item is tried alone."""
CONNECT_SECONDS = 6
"""How long a scheduler, and then its first worker, may keep us waiting."""


class Place(ABC):
    """Where work is done."""

    width: int
    """Items handed over before the first of them is back."""
    killed = ""
    """Name of the exception that says that an item has killed its workers again and again."""

    @abstractmethod
    def open(self) -> AbstractContextManager[Executor]:
        """Provide an Executor; whatever leaves the block early cancels the work."""

    def call(self, function: Callable, item: Any) -> tuple:
        """Return what to submit for function(item)."""
        return function, item


def place_of(where: str | None) -> Place:
    """Return the place that a text such as "local:4" or "dask:tcp://host:8786" names.

    Raises:
        InputError: it names none.
    """
    scheme, _, rest = ("local" if where is None else where).partition(":")
    match scheme:
        case "local" if re.fullmatch(r"|[1-9]\d*", rest) and not (where or "").endswith(":"):
            return Local(int(rest or os.cpu_count() or 1))
        case "dask" if rest:
            return Dask(rest)
    raise InputError(f"executor = {where!r}, expected local, local:NUMBER or dask:ADDRESS")


def check_place(where: str | None) -> None:
    """Say at once if work cannot go there: connect to a scheduler, and leave.

    Raises:
        InputError, EngineError: see `executor`.
    """
    with executor(where):  # a local pool starts no process before it has work
        pass


def executor(where: str | None = None) -> AbstractContextManager[Executor]:
    """Provide an Executor: None or "local", "local:N" (N processes), "dask:ADDRESS".

    Leaving the block by an exception, Ctrl-C too, cancels the work.

    Raises:
        InputError: no such place, or no scheduler with a worker answers there.
        EngineError: the library that it needs is not installed.
    """
    return place_of(where).open()


def spread(
    where: str | None, function: Callable[[Item], Result], items: Iterable[Item]
) -> Iterator[tuple[Item, Result]]:
    """Yield (item, function(item)), in the order in which they finish.

    Items are taken as they are handed over. One whose worker dies is given to another. One that
    kills every worker it is given to, the last time alone, is left out and reported after all the
    others. An exception of `function` ends everything.

    Args:
        where: see `executor`.
        function: of a module that workers can import (or a `functools.partial` of one).
        items: anything that can be pickled, and so can the results.

    Raises:
        WorkerError: workers died of an item, or die as they start, or the scheduler is gone.
        InputError, EngineError: see `executor`.
    """
    place = place_of(where)
    source = map(_Task, items)
    queue: deque[_Task] = deque()
    alone: deque[_Task] = deque()
    given_up: list[_Task] = []
    progressed = True
    while _refilled(queue, source) or alone:
        batch, here, more = (
            (queue, place, source) if queue else (alone, Local(1, ahead=0), iter(()))
        )
        with here.open() as pool:
            if not progressed:
                _check_start(pool)
            progressed = False
            for task, outcome in _work_off(pool, here, function, batch, more):
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
    if given_up:
        names = "; ".join(_short(task.item) for task in given_up[:3])
        raise WorkerError(f"{counted(len(given_up), 'item')} killed every worker with it: {names}")


@dataclass(eq=False)
class _Task:
    item: Any
    deaths: int = 0


class _Killed:
    """Stands for the result of an item that killed its workers."""


def _work_off(
    pool: Executor, place: Place, function: Callable, queue: deque[_Task], more: Iterator[_Task]
) -> Iterator[tuple[_Task, Any]]:
    """Yield (task, result) until queue and `more` are empty, or the pool broken.

    Then the queue holds what was taken and not done.
    """
    running: dict[Future, _Task] = {}
    broken = False
    while True:
        while not broken and len(running) < place.width and _refilled(queue, more):
            try:
                future = pool.submit(*place.call(function, queue[0].item))
            except BrokenExecutor:
                broken = True
            else:
                running[future] = queue.popleft()
        if not running:
            return
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            task = running.pop(future)
            try:
                result = future.result()
            except BrokenExecutor:
                # Which of the items in hand it was cannot be known.
                broken = True
                task.deaths += 1
                queue.appendleft(task)
                continue
            except CancelledError:
                raise WorkerError("the scheduler is gone, and the work with it") from None
            except Exception as error:
                if type(error).__name__ != place.killed:
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


# ---- Processes on this machine -------------------------------------------------------------------


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
            yield pool
        except BaseException:
            for process in context.started:
                if process.pid is not None:
                    process.terminate()
            pool.shutdown(cancel_futures=True)
            raise
        pool.shutdown()


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
    """Put Ctrl-C off to the end of the block; a process started there never hears it."""
    if threading.current_thread() is not threading.main_thread():
        yield  # the main thread alone is interrupted
        return
    came: list[int] = []
    # Another thread may catch the signal, hence a handler; a process started inherits the mask.
    handler = signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    masks = hasattr(signal, "pthread_sigmask")  # not on Windows
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}) if masks else set()
    try:
        yield
    finally:
        if masks:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        signal.signal(signal.SIGINT, handler)
        if came:
            signal.raise_signal(signal.SIGINT)


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


# ---- The workers of a dask scheduler -------------------------------------------------------------


class Dask(Place):
    """The workers of a dask scheduler; it gives the work of a lost worker to another itself."""

    width = 1024
    killed = "KilledWorker"

    def __init__(self, address: str):
        self.address = address

    def call(self, function: Callable, item: Any) -> tuple:
        """Return the function, guarded."""
        # Pickled here: dask would look for futures, and in old versions for tasks, in an item.
        return guarded, sources(), pickle.dumps((function, item))

    @contextmanager
    def open(self) -> Iterator[Executor]:
        """Connect; leaving early cancels what has not begun."""
        client = self._connect(required("distributed", "cluster").Client)
        try:
            # pure: equal items are still as many items.
            pool = client.get_executor(pure=False)
            try:
                yield pool
            except BaseException:
                # No scheduler may be left to tell.
                with suppress(Exception):
                    pool.shutdown(wait=False)
                raise
            pool.shutdown()
        finally:
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


def guarded(digest: str, work: bytes) -> Any:
    """Return function(item), computed by these very sources, one at a time in this process.

    A dask worker has several threads by default; the precision of balls is one per process.

    Raises:
        WorkerError: this process has other sources of eomcheck than the one that wants the result.
    """
    if sources() != digest:
        raise WorkerError("the workers have another version of eomcheck")
    with _ONE:
        function, item = pickle.loads(work)
        return function(item)
