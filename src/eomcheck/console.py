"""The terminal: one console for all output, and progress bars."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

WIDTH = 140
"""Width of tables where the output is no terminal."""

PERIOD = 6 * 3600.0
"""Seconds over which progress is averaged; rich's own 30 estimate no end of longer steps."""

console = Console()
if not console.is_terminal:
    console = Console(width=WIDTH)


@contextmanager
def progress(label: str, total: int) -> Iterator[Callable[[], None]]:
    """Show a progress bar on standard error, a terminal; the value is called once per step.

    Without a label there is none.
    """
    errors = Console(stderr=True)
    with Progress(
        TextColumn(label),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=errors,
        transient=True,
        disable=not (errors.is_terminal and label),
        speed_estimate_period=PERIOD,
    ) as bar:
        task = bar.add_task(label, total=total)
        yield lambda: bar.advance(task)
