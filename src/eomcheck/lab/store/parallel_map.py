"""Parallel map over processes and machines that survives the death of workers.

`parallel_map` yields (item, function(item)) as items finish. The items of a worker that dies are
submitted to another; an item that kills every worker, the last time alone in the pool, is reported
after all the others. It is for untimed work, run by any `concurrent.futures.Executor` of
`eomcheck.lab.store.executors`.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    wait,
)
from dataclasses import dataclass
from itertools import islice
from typing import Any, TypeVar

from eomcheck.deprecated import getattr_of, old_keywords
from eomcheck.errors import DiedError, WorkerError
from eomcheck.lab.store.executors import ExecutorBackend, Local, backend_of
from eomcheck.safe_output import counted

Item = TypeVar("Item")
Result = TypeVar("Result")

DEATHS_TOGETHER = 2
"""Deaths of workers with an item among those running; after that the item is tried alone."""


@old_keywords
def parallel_map(
    executor: str | None, function: Callable[[Item], Result], items: Iterable[Item]
) -> Iterator[tuple[Item, Result]]:
    """Yield (item, function(item)), in the order in which they finish.

    Items are consumed as they are submitted. One whose worker dies is submitted to another. One
    that kills every worker, the last time alone in the pool, is left out and reported after all the
    others. An exception of `function` ends everything.

    Args:
        executor: see `eomcheck.lab.store.executors.executor`.
        function: of a module that workers can import (or a `functools.partial` of one).
        items: anything that can be pickled, and so can the results.

    Raises:
        DiedError: an item killed its workers, no worker is left, or the scheduler is gone.
        WorkerError: workers die as they start.
        InputError, EngineError: see `eomcheck.lab.store.executors.executor`.
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
    if given_up:
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
