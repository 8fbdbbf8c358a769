"""What a place is where work is done; neighbours say which there are."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from concurrent.futures import Executor
from contextlib import AbstractContextManager
from typing import Any


class Place(ABC):
    """Where work is done."""

    width: int
    """Items handed over before the first of them is back."""
    killed = ""
    """Name of the exception that says that an item has killed its workers again and again."""

    every: float | None = None
    """Seconds without a result after which `check` is asked; None for never."""

    def check(self) -> None:
        """Raise DiedError where nobody is left who could do the work."""
        return

    @abstractmethod
    def open(self) -> AbstractContextManager[Executor]:
        """Provide an Executor; whatever leaves the block early cancels the work."""

    def call(self, function: Callable, item: Any) -> tuple:
        """Return what to submit for function(item)."""
        return function, item
