"""The terminal: one console for all output, and progress bars."""

from __future__ import annotations

import os
import re
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from threading import Event, Lock, Thread, current_thread, main_thread

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

from eomcheck.safe_output import counted

WIDTH = 140
"""Width of tables where the output is no terminal, and COLUMNS does not say it."""

PERIOD = 6 * 3600.0
"""Seconds over which progress is averaged; rich's own 30 estimate no end of longer steps."""

LEAST_WIDTH = 20
"""No COLUMNS below that is believed."""

console = Console()
WIDTH_KNOWN = console.file.isatty() or "COLUMNS" in os.environ
"""Whether somebody looks at the output who has a width. Lines of tables always have one."""
if not WIDTH_KNOWN or console.width < LEAST_WIDTH:
    console = Console(width=WIDTH)


PATIENCE = 2.0
"""Seconds that something may take before `polled_progress` shows how far it has come."""

_now = ["starting"]
"""What goes on, the innermost last: what `slow_work_notice` says."""

_showing = Lock()
"""Held by the one bar that is shown: what takes place within it shows none."""


_NOUN = re.compile(r"\{(.+?)\}")


def _with(total: float) -> Callable[[re.Match], str]:
    return lambda noun: counted(int(total), noun[1])


def _many(noun: re.Match) -> str:
    return counted(2, noun[1]).removeprefix("2 ")


@contextmanager
def activity(what: str) -> Iterator[None]:
    """Name what goes on inside the block, for `slow_work_notice`; there is no bar."""
    _now.append(what)
    try:
        yield
    finally:
        _now.pop()


@contextmanager
def _bar(label: str, total: float, *columns: ProgressColumn) -> Iterator[Progress]:
    """Show a bar on standard error, a terminal; without a label, or within another, show none.

    A noun in the label, "checking {state}", is what is counted: a bar has its own numbers, without
    one they are said, "checking 12 states".
    """
    said, label = (_NOUN.sub(how, label) for how in (_with(total), _many))
    errors = Console(stderr=True)
    shown = bool(label) and errors.is_terminal and _showing.acquire(blocking=False)
    try:
        showing = Progress(
            TextColumn(label),
            BarColumn(),
            *columns,
            TimeRemainingColumn(),
            console=errors,
            transient=True,
            disable=not shown,
            speed_estimate_period=PERIOD,
        )
        with activity(said or _now[-1]), showing as bar:
            bar.add_task(label, total=total)
            yield bar
    finally:
        if shown:
            _showing.release()


@contextmanager
def slow_work_notice(what: str) -> Iterator[None]:
    """Say what goes on, once, on standard error, if the block takes longer than `PATIENCE`.

    Not where a bar is shown by then, which says more.

    Args:
        what: what goes on until some bar has a name for it.
    """
    over = Event()
    _now[0] = what

    def say() -> None:
        if not over.wait(PATIENCE) and not _showing.locked():
            with suppress(OSError, ValueError):  # nobody listens
                print(f"eomcheck: {_now[-1]} ...", file=sys.stderr, flush=True)

    Thread(target=say, daemon=True).start()
    try:
        yield
    finally:
        over.set()


@contextmanager
def progress(label: str, total: int) -> Iterator[Callable[[], None]]:
    """Show a progress bar on standard error, a terminal; the value is called once per step.

    Args:
        label: what it does, with what a step is in braces: "checking {state}". Without a label
            there is no bar.
        total: the number of steps.
    """
    with _bar(label, total, MofNCompleteColumn()) as bar:

        def advance() -> None:
            bar.advance(bar.task_ids[0])
            if _stopped.is_set():
                _stopped.clear()
                raise KeyboardInterrupt

        yield advance


@contextmanager
def polled_progress(label: str, total: float, reached: Callable[[], float]) -> Iterator[None]:
    """Show how far something has come that takes longer than `PATIENCE`, as `progress` does.

    Args:
        label: what it does.
        total: where it ends.
        reached: how far it has come; called from another thread.
    """
    if not Console(stderr=True).is_terminal:
        with activity(label):
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


@contextmanager
def _signalled(hear: Callable[[int], None]) -> Iterator[None]:
    """Call `hear` with the number of the first Ctrl-C and the first SIGTERM inside the block.

    A second signal does what the first would do without this.
    """
    before = {}

    def handler(number: int, frame: object) -> None:
        signal.signal(number, before[number])
        hear(number)

    if current_thread() is main_thread():  # which alone hears signals
        for number in (signal.SIGINT, signal.SIGTERM):
            before[number] = signal.getsignal(number)
            if before[number] not in (signal.SIG_IGN, None):
                signal.signal(number, handler)
    try:
        yield
    finally:
        for number, old in before.items():
            if old is not None:
                signal.signal(number, old)


@contextmanager
def deferring_interrupts() -> Iterator[None]:
    """Raise KeyboardInterrupt at Ctrl-C or SIGTERM after the block: what it writes is written.

    For blocks of milliseconds. A second signal does what the first would do without this.
    """
    heard: list[int] = []
    with _signalled(heard.append):
        yield
    if heard:
        raise KeyboardInterrupt


_stopped = Event()
"""Set when this process was told to end; some callbacks swallow the exception that says so."""


@contextmanager
def interruptible() -> Iterator[None]:
    """Raise KeyboardInterrupt at Ctrl-C or SIGTERM inside the block, once.

    At once, or where something swallows that, with the next step of `progress`. What comes after
    the first is as without this.
    """

    def stop(_: int) -> None:
        _stopped.set()
        raise KeyboardInterrupt

    def swallowed(said) -> None:
        # What was stopped while it was deleted may be deleted again, and fail at that.
        if said.exc_type is not KeyboardInterrupt and not _stopped.is_set():
            hook(said)

    hook, sys.unraisablehook = sys.unraisablehook, swallowed
    try:
        with _signalled(stop):
            yield
    finally:
        sys.unraisablehook = hook
        _stopped.clear()
