"""The workers of a dask scheduler (extra `cluster`)."""

from __future__ import annotations

import logging
import pickle
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import (
    Executor,
)
from contextlib import contextmanager, suppress
from typing import Any

from eomcheck.calls import patience, work_for
from eomcheck.errors import DiedError, InputError, WorkerError, required
from eomcheck.lab.store.place import Place
from eomcheck.lab.store.provenance import sources

CONNECT_SECONDS = 6
"""How long a scheduler, and then its first worker, may keep us waiting."""

ALONE_SECONDS = 20
"""How long a scheduler may be without workers while there is work."""
LOGS = "distributed", "distributed.client"
"""Loggers that write tracebacks of their own where a scheduler has died."""


@contextmanager
def _quiet() -> Iterator[None]:
    """Have the library write nothing of what is reported by exceptions."""
    levels = {name: logging.getLogger(name).level for name in LOGS}
    for name in levels:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for name, level in levels.items():
            logging.getLogger(name).setLevel(level)


class Dask(Place):
    """The workers of a dask scheduler; it gives the work of a lost worker to another itself."""

    width = 1024
    killed = "KilledWorker"
    every = 1.0

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
        """Return the function, guarded."""
        # Pickled here: dask would look for futures, and in old versions for tasks, in an item.
        return guarded, sources(), pickle.dumps((function, item)), patience()

    @contextmanager
    def open(self) -> Iterator[Executor]:
        """Connect; leaving early cancels what has not begun."""
        make = required("distributed", "cluster").Client
        with _quiet():
            yield from self._opened(make)

    def _opened(self, make: Callable) -> Iterator[Executor]:
        client = self._client = self._connect(make)
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
    """Return function(item), computed by these very sources, one at a time in this process.

    A dask worker has several threads by default; the precision of balls is one per process.

    Args:
        digest: of the sources of the process that wants the result.
        work: (function, item), pickled.
        patient: seconds that a call of code that is not ours may take.

    Raises:
        WorkerError: this process has other sources of eomcheck than the one that wants the result.
    """
    if sources() != digest:
        raise WorkerError("the workers have another version of eomcheck")
    work_for(patient)
    with _ONE:
        function, item = pickle.loads(work)
        return function(item)
