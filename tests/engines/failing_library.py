"""Engines of Pinocchio whose bias fails, each in a way that a process of its own survives."""

from __future__ import annotations

import ctypes
import gc
import os
import sys
import time
import weakref
from pathlib import Path
from typing import ClassVar

import numpy as np

from eomcheck.engines.pinocchio import PinocchioEngine, PinocchioFile


class Failing(PinocchioEngine):
    """Pinocchio's tree of bodies."""

    solves_like = "gw"


class Segfaulting(Failing):
    """Engine that reads an address that it may not."""

    def bias(self, q, v, t=0.0):
        print("about to read address 0", flush=True)
        return ctypes.string_at(0)


class Exiting(Failing):
    """Engine that ends its process with exit code 0."""

    def bias(self, q, v, t=0.0):
        os._exit(0)


class Babbling(Failing):
    """Engine that writes garbage where its answer goes."""

    def bias(self, q, v, t=0.0):
        os.write(int(sys.argv[3]), b"garbage " * 100)
        return super().bias(q, v, t)


class Printing(Failing):
    """Engine that prints, as libraries do."""

    def bias(self, q, v, t=0.0):
        print("garbage " * 100000, flush=True)
        os.write(1, b"garbage\n")
        return super().bias(q, v, t)


class Sleeping(Failing):
    """Engine that never answers, and holds Python's lock."""

    def bias(self, q, v, t=0.0):
        ctypes.PyDLL(None).sleep(600)


class Waiting(Failing):
    """Engine that never answers."""

    def bias(self, q, v, t=0.0):
        time.sleep(600)


class Undefined(Failing):
    """Engine that answers NaN."""

    def bias(self, q, v, t=0.0):
        return np.full(len(v), np.nan)


class Raising(Failing):
    """Engine that raises an exception."""

    def bias(self, q, v, t=0.0):
        raise KeyError("Coriolis")


class Overwriting(Failing):
    """Engine that changes an array that it is handed."""

    def bias(self, q, v, t=0.0):
        result = super().bias(q, v, t)
        v[0] += 1.0
        return result


class Textual(Failing):
    """Engine that answers an object that no message holds."""

    def bias(self, q, v, t=0.0):
        return object()


class Counted(Failing):
    """Engine whose bias is the number of models of its class in this process."""

    models: ClassVar[weakref.WeakSet] = weakref.WeakSet()

    def set_up(self, inputs):
        super().set_up(inputs)
        self.models.add(self)

    def bias(self, q, v, t=0.0):
        gc.collect()
        return np.full(len(q), float(len(self.models)))


class Stub(PinocchioFile):
    """Reader of files by a library with an extra, as if it were optional."""

    key = "stub_file"
    extra = "stub"

    @classmethod
    def distribution(cls):
        return "stub"


class Missing(Stub):
    """Reader of files whose library is not there."""

    module = "no_such_library"


class SegfaultingFile(Segfaulting, PinocchioFile):
    """Reader of files that reads an address that it may not."""


class ExitingFile(Exiting, PinocchioFile):
    """Reader of files that ends its process with exit code 0."""


class BabblingFile(Babbling, PinocchioFile):
    """Reader of files that writes garbage where its answer goes."""


class SleepingFile(Sleeping, PinocchioFile):
    """Reader of files that never answers, and holds Python's lock."""


class UndefinedFile(Undefined, PinocchioFile):
    """Reader of files that answers NaN."""


def has_ended(pid: int) -> bool:
    """Return whether a process has ended, maybe as a zombie."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    state = Path(f"/proc/{pid}/stat")
    return state.exists() and state.read_text().rpartition(")")[2].split()[0] == "Z"
