"""The workers of a dask scheduler (extra `cluster`)."""

from __future__ import annotations

import pickle
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import (
    Executor,
)
from contextlib import contextmanager, suppress
from typing import Any

from eomcheck.errors import InputError, WorkerError, required
from eomcheck.lab.store.place import Place
from eomcheck.lab.store.provenance import sources

CONNECT_SECONDS = 6
"""How long a scheduler, and then its first worker, may keep us waiting."""


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
