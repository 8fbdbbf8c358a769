"""A process of a pool: started whole, whatever interrupts its parent meanwhile."""

from __future__ import annotations

import os
import signal
from concurrent.futures import process
from multiprocessing.context import SpawnProcess

import pytest

from eomcheck.console import interruptible
from eomcheck.lab.store import parallel_map


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_worker_is_started_whole_before_an_interruption(monkeypatch, number: int):
    began = []

    def start(self):
        began.append("begun")
        signal.raise_signal(number)
        began.append("told what to do")

    monkeypatch.setattr(SpawnProcess, "start", start)
    handlers = [signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)]
    # A shell that runs the tests in the background has its jobs ignore Ctrl-C.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt), interruptible():
            parallel_map._Context().Process().start()
    finally:
        signal.signal(signal.SIGINT, before)
    assert began == ["begun", "told what to do"]
    assert [signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)] == handlers


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interruption_while_the_pool_starts_is_no_other_error(monkeypatch, number: int):
    handler = signal.signal(number, signal.default_int_handler)
    start = process._ExecutorManagerThread.start

    def interrupted(self) -> None:
        signal.raise_signal(number)
        start(self)

    monkeypatch.setattr(process._ExecutorManagerThread, "start", interrupted)
    try:
        with pytest.raises(KeyboardInterrupt), parallel_map.Local(1).open() as pool:
            pool.submit(os.getpid).result()
    finally:
        signal.signal(number, handler)
