"""A Record: what one cell of a study came to, and where and when."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

from eomcheck.errors import InputError
from eomcheck.lab.store.provenance import blas_threads, machine, now, versions
from eomcheck.lab.store.settings import Settings, json_of

Status = Literal["done", "failed", "refused"]

TEXTS = "study", "reason", "when"
"""Fields of a Record that are text."""


@dataclass(frozen=True)
class Record:
    """One cell of a study. What is not given is that of this process, now.

    Attributes:
        study: which study.
        settings: what the study varies: scene, formulation, integrator, rtol, ...
        status: "done", "failed" (it went wrong) or "refused" (an honest "cannot").
        reason: why, where it is not done.
        seconds: best run time, or None where nothing was timed.
        quartiles: lower and upper quartile of the run times.
        cpu_seconds: CPU time of the best run, less than `seconds` where it had to share its core.
        runs: number of timed runs.
        compile_seconds: what compiling took, apart from `seconds`.
        counts: right-hand sides, steps, ...
        errors: kind of error -> its size; infinities and NaN are kept.
        series: what was found over time, or over coordinates -> its values, a list (of lists).
        machine: cpu, cores, os, python; of a timed cell also core and load, see `RunTime`.
        versions: of eomcheck (and the digest of its sources) and of the libraries installed.
        threads: BLAS threads that the environment sets, None if it does not.
        when: UTC, ISO 8601.
    """

    study: str
    settings: Settings
    status: Status = "done"
    reason: str = ""
    seconds: float | None = None
    quartiles: tuple[float, float] | None = None
    cpu_seconds: float | None = None
    runs: int = 0
    compile_seconds: float | None = None
    counts: dict[str, int] = field(default_factory=dict)
    errors: dict[str, float] = field(default_factory=dict)
    series: dict[str, list] = field(default_factory=dict)
    machine: dict[str, Any] = field(default_factory=machine)
    versions: dict[str, str] = field(default_factory=versions)
    threads: int | None = field(default_factory=blas_threads)
    when: str = field(default_factory=now)

    def __post_init__(self):
        if self.status not in get_args(Status):
            raise InputError(f"status = {self.status!r}, expected one of {get_args(Status)}")
        for kind, names in ((str, TEXTS), (dict, ("machine", "versions"))):
            for name in names:
                if not isinstance(getattr(self, name), kind):
                    raise InputError(f"{name} = {getattr(self, name)!r}, expected {kind.__name__}")
        # What is read back must equal what was written: no tuples, no scalars of numpy.
        plain: dict[str, Any] = {
            "settings": json.loads(json_of("settings", self.settings)),
            "series": json.loads(json_of("series", self.series)),
            "counts": {name: int(value) for name, value in self.counts.items()},
            "errors": {name: float(value) for name, value in self.errors.items()},
        }
        for name in ("seconds", "cpu_seconds", "compile_seconds"):
            value = getattr(self, name)
            plain[name] = None if value is None else float(value)
        if self.quartiles is not None:
            low, high = self.quartiles
            plain["quartiles"] = (float(low), float(high))
        for name, value in plain.items():
            object.__setattr__(self, name, value)
