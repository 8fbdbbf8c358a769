"""The terminal: one console for all output, and progress bars."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Lock, Thread

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)

WIDTH = 140
"""Width of tables where the output is no terminal."""

PERIOD = 6 * 3600.0
"""Seconds over which progress is averaged; rich's own 30 estimate no end of longer steps."""

console = Console()
if not console.is_terminal:
    console = Console(width=WIDTH)


PATIENCE = 2.0
"""Seconds that something may take before `watched` shows how far it has come."""

_showing = Lock()
"""Held by the one bar that is shown: what takes place within it shows none."""


@contextmanager
def _bar(label: str, total: float, *columns: ProgressColumn) -> Iterator[Progress]:
    """Show a bar on standard error, a terminal; without a label, or within another, show none."""
    errors = Console(stderr=True)
    shown = bool(label) and errors.is_terminal and _showing.acquire(blocking=False)
    try:
        with Progress(
            TextColumn(label),
            BarColumn(),
            *columns,
            TimeRemainingColumn(),
            console=errors,
            transient=True,
            disable=not shown,
            speed_estimate_period=PERIOD,
        ) as bar:
            bar.add_task(label, total=total)
            yield bar
    finally:
        if shown:
            _showing.release()


@contextmanager
def progress(label: str, total: int) -> Iterator[Callable[[], None]]:
    """Show a progress bar on standard error, a terminal; the value is called once per step.

    Without a label there is none.
    """
    with _bar(label, total, MofNCompleteColumn()) as bar:
        yield lambda: bar.advance(bar.task_ids[0])


@contextmanager
def watched(label: str, total: float, reached: Callable[[], float]) -> Iterator[None]:
    """Show how far something has come that takes longer than `PATIENCE`, as `progress` does.

    Args:
        label: what it does.
        total: where it ends.
        reached: how far it has come; called from another thread.
    """
    if not Console(stderr=True).is_terminal:
        yield
        return
    over = Event()

    def watch() -> None:
        if not over.wait(PATIENCE):
            with _bar(label, total, TaskProgressColumn()) as bar:
                while not over.wait(0.1):
                    bar.update(bar.task_ids[0], completed=reached())

    watcher = Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        over.set()
        watcher.join()
