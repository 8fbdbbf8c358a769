"""Where work goes: a text such as "local:4" or "dask:tcp://host:8786", and its Executor."""

from __future__ import annotations

import os
import re
from concurrent.futures import (
    Executor,
)
from contextlib import AbstractContextManager

from eomcheck.errors import InputError
from eomcheck.lab.store.cluster import Dask
from eomcheck.lab.store.place import Place
from eomcheck.lab.store.processes import Local


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
