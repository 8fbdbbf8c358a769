"""Terminal output: one console for all tables, progress bars, and Ctrl-C handling.

Bars are shown on standard error, if it is a terminal, one at a time. Without a bar, slow work is
announced by one line (`slow_work_notice`). Ctrl-C and SIGTERM become one KeyboardInterrupt.
"""

from __future__ import annotations

import os
import re
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from itertools import count
from threading import Event, Lock, Thread
from typing import Any

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
from rich.status import Status
from rich.text import Text

from eomcheck.calls import handling_signals
from eomcheck.safe_output import counted

WIDTH = 140
"""Width of tables, characters, if the output is no terminal and COLUMNS is not set."""

PERIOD = 6 * 3600.0
"""Averaging window of the remaining time, s; rich's default of 30 s is shorter than some steps."""

LEAST_WIDTH = 20
"""Smallest plausible COLUMNS; smaller values are ignored."""

console = Console()
WIDTH_KNOWN = console.file.isatty() or "COLUMNS" in os.environ
"""Whether the width of the output is known: a terminal, or COLUMNS. Tables always have one."""
if not WIDTH_KNOWN or console.width < LEAST_WIDTH:
    console = Console(width=WIDTH)


PATIENCE = 2.0
"""Delay before `polled_progress` or `slow_work_notice` print anything, s."""

EVERY = 5.0
"""Seconds between two lines of progress, where standard error is no terminal."""

_now = ["starting"]
"""Stack of current activities, innermost last: the text printed by `slow_work_notice`."""

_showing = Lock()
"""Lock held by the one bar that is shown; nested bars are not shown."""


_NOUN = re.compile(r"\{(.+?)\}")


def _with(total: float) -> Callable[[re.Match], str]:
    return lambda noun: counted(int(total), noun[1])


def _many(noun: re.Match) -> str:
    return counted(2, noun[1]).removeprefix("2 ")


_steps: dict[str, int] = {}
"""Text of an activity -> number of its steps that are done."""

_reporting = Event()
"""Set once `report_progress` has printed a line."""

_status: list[Status] = []
"""The status line that is shown, none or one."""

_drawing = Lock()
"""Lock held while the status line is drawn or taken away."""


def _hide_status() -> None:
    """Take the status line away; with `_drawing` held."""
    for status in _status:
        status.stop()
    _status.clear()


@contextmanager
def activity(what: str) -> Iterator[None]:
    """Name the activity inside the block for `slow_work_notice`, without a bar."""
    _now.append(what)
    try:
        yield
    finally:
        with _drawing:
            _now.pop()
            if len(_now) == 1:
                _hide_status()


def report_progress(text: str) -> None:
    """Show a line of progress: in the status line of a terminal, else printed."""
    if Console(stderr=True).is_terminal and len(_now) > 1:
        _now[-1] = text
    else:
        _reporting.set()
        console.print(text, highlight=False)


def _show_status(over: Event, errors: Console) -> None:
    """Show the current activities in a status line, unless a bar is shown, until `over`."""
    while not over.wait(0.1):
        with _drawing:
            if len(_now) == 1 or _showing.locked():
                _hide_status()
                continue
            text = Text(", ".join(_now[1:]), no_wrap=True, overflow="ellipsis")
            if _status:
                _status[0].update(text)
            else:
                _status.append(Status(text, console=errors))
                _status[0].start()
    with _drawing:
        _hide_status()


@contextmanager
def _bar(label: str, total: float, *columns: ProgressColumn) -> Iterator[Progress]:
    """Show a progress bar if standard error is a terminal; none without a label or inside another.

    A noun in braces in the label, "checking {state}", names the steps: the bar shows "checking
    states" beside its own numbers, the notice without a bar "checking 12 states".
    """
    notice, label = (_NOUN.sub(how, label) for how in (_with(total), _many))
    errors = Console(stderr=True)
    shown = bool(label) and errors.is_terminal and _showing.acquire(blocking=False)
    if shown:
        with _drawing:
            _hide_status()
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
        with activity(notice or _now[-1]), showing as bar:
            bar.add_task(label, total=total)
            yield bar
    finally:
        if shown:
            _showing.release()


@contextmanager
def slow_work_notice(what: str) -> Iterator[None]:
    """Show the current activity on standard error if the block exceeds `PATIENCE`.

    A terminal has a status line while there is an activity and no bar; elsewhere the activity and
    its steps are printed every few seconds, unless `report_progress` prints.

    Args:
        what: name of the activity until an inner `activity` or bar names another.
    """
    over = Event()
    _now[0] = what
    _reporting.clear()

    def notify() -> None:
        if over.wait(PATIENCE):
            return
        errors = Console(stderr=True)
        with _drawing:
            if not (_showing.locked() or (errors.is_terminal and len(_now) > 1)):
                with suppress(OSError, ValueError):  # standard error is closed
                    print(f"eomcheck: {_now[-1]} ...", file=sys.stderr, flush=True)
        if errors.is_terminal:
            _show_status(over, errors)
        start = time.monotonic() - PATIENCE
        while not over.wait(EVERY):
            if _reporting.is_set():
                return
            with suppress(OSError, ValueError):
                now, seconds = _now[-1], time.monotonic() - start
                steps = f", {_steps[now]} done" if now in _steps else ""
                print(f"eomcheck: {now}{steps} ... {seconds:.0f} s", file=sys.stderr, flush=True)

    notifier = Thread(target=notify, daemon=True)
    notifier.start()
    try:
        yield
    finally:
        over.set()
        notifier.join(1.0)


@contextmanager
def progress(label: str, total: int) -> Iterator[Callable[[], None]]:
    """Show a progress bar if standard error is a terminal; yield the function to call per step.

    Args:
        label: name of the activity, with the noun of a step in braces: "checking {state}". Without
            a label there is no bar.
        total: number of steps.
    """
    with _bar(label, total, MofNCompleteColumn()) as bar:
        notice, done = _now[-1], count(1)

        def advance() -> None:
            bar.advance(bar.task_ids[0])
            if label:
                _steps[notice] = next(done)
            if _stopped.is_set():
                _stopped.clear()
                raise KeyboardInterrupt

        try:
            yield advance
        finally:
            _steps.pop(notice, None)


@contextmanager
def polled_progress(label: str, total: float, reached: Callable[[], float]) -> Iterator[None]:
    """Show a progress bar that polls its value, if the block exceeds `PATIENCE`.

    Args:
        label: name of the activity, as for `progress`.
        total: value at which it is complete.
        reached: returns the present value; called from another thread.
    """
    if not Console(stderr=True).is_terminal:
        with activity(_NOUN.sub(_with(total), label)):
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

    A second signal of a kind is handled as before the block.
    """

    def handler(number: int, before: Any) -> None:
        signal.signal(number, before)
        hear(number)

    with handling_signals(handler):
        yield


@contextmanager
def deferring_interrupts() -> Iterator[None]:
    """Defer Ctrl-C or SIGTERM to the end of the block, as KeyboardInterrupt: its writes complete.

    For blocks of milliseconds. A second signal is handled as before the block.
    """
    heard: list[int] = []
    with _signalled(heard.append):
        yield
    if heard:
        raise KeyboardInterrupt


_stopped = Event()
"""Set by Ctrl-C or SIGTERM, since some callbacks swallow the KeyboardInterrupt."""


@contextmanager
def interruptible() -> Iterator[None]:
    """Raise KeyboardInterrupt at Ctrl-C or SIGTERM inside the block, once.

    At once, or with the next step of `progress` if a callback swallows the exception. Later signals
    are handled as before the block.
    """

    def stop(_: int) -> None:
        _stopped.set()
        raise KeyboardInterrupt

    def swallowed(unraisable) -> None:
        # An object interrupted in its deletion may be deleted again, and fail.
        if unraisable.exc_type is not KeyboardInterrupt and not _stopped.is_set():
            hook(unraisable)

    hook, sys.unraisablehook = sys.unraisablehook, swallowed
    try:
        with _signalled(stop):
            yield
    finally:
        sys.unraisablehook = hook
        _stopped.clear()
