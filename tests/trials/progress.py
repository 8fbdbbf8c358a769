"""Progress of a long trial, and its end by Ctrl-C, which prints the table of what is done."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Iterable, Iterator
from types import TracebackType
from typing import Any, TypeVar

Item = TypeVar("Item")

PERIOD = 10.0
"""Seconds between two lines of progress."""


class Progress:
    """A context in which items of a trial are counted, and Ctrl-C ends the trial and no more.

    Args:
        total: number of items.
        period: seconds between two lines of progress on standard error.
    """

    def __init__(self, total: int, period: float = PERIOD):
        self.total, self.period, self.done = total, period, 0
        self.interrupted = False
        """Whether Ctrl-C came."""

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, kind: type | None, error: Any, trace: TracebackType | None) -> bool:
        self.interrupted = kind is KeyboardInterrupt
        if self.interrupted:
            print(f"interrupted after {self.done} of {self.total}", file=sys.stderr, flush=True)
        return self.interrupted

    def of(self, items: Iterable[Item]) -> Iterator[Item]:
        """Yield the items, and print how many there were now and then."""
        last = time.monotonic()
        for item in items:
            yield item
            self.done += 1
            if time.monotonic() - last >= self.period:
                last = time.monotonic()
                print(f"{self.done} of {self.total}", file=sys.stderr, flush=True)


def ignore_interrupts() -> None:
    """Leave Ctrl-C to the process that prints the table; an initializer of workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
