"""Tests of an engine are skipped, with the reason, where its library is not installed."""

from __future__ import annotations

import pytest

from eomcheck.claims import run
from eomcheck.engines import LIBRARIES, Engine, asked_by_default
from eomcheck.engines.tree_engine import library_key
from eomcheck.errors import EngineError


@pytest.fixture(autouse=True)
def installed(request: pytest.FixtureRequest) -> None:
    """Skip a test whose argument `key` or `kind` is an engine without its library.

    All libraries that are asked on request cannot be installed together: `python -m
    tests.libraries` asks each in an environment of its own, so that none is missing at night.
    """
    callspec = getattr(request.node, "callspec", None)
    key, kind = (None if callspec is None else callspec.params.get(x) for x in ("key", "kind"))
    engine = LIBRARIES.get(key) if isinstance(key, str) else None
    if isinstance(kind, type) and issubclass(kind, Engine):
        engine = kind
    if engine is not None and engine.extra is not None:
        try:
            engine.version()
        except EngineError as error:
            asked = library_key(engine) in asked_by_default(LIBRARIES)
            alone = f"{engine.extra} is asked by tests.libraries, in an environment of its own"
            pytest.skip(str(error) if asked else alone)


@pytest.fixture(autouse=True)
def seldom(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have engines on trial asked again a few times only: other tests say how often."""
    if request.module.__name__.rpartition(".")[2] != "test_engine_history":
        monkeypatch.setattr(run, "OFTEN", 2)
