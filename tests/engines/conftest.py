"""Tests of an engine are skipped, with the reason, where its library is not installed."""

from __future__ import annotations

import pytest

from eomcheck.claims import run
from eomcheck.engines import ENGINES, Engine
from eomcheck.errors import EngineError


@pytest.fixture(autouse=True)
def installed(request: pytest.FixtureRequest) -> None:
    """Skip a test whose argument `key` or `kind` is an engine without its library."""
    callspec = getattr(request.node, "callspec", None)
    key, kind = (None if callspec is None else callspec.params.get(x) for x in ("key", "kind"))
    engine = ENGINES.get(key) if isinstance(key, str) else None
    if isinstance(kind, type) and issubclass(kind, Engine):
        engine = kind
    if engine is not None and engine.extra is not None:
        try:
            engine.version()
        except EngineError as error:
            pytest.skip(str(error))


@pytest.fixture(autouse=True)
def seldom(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have engines on trial asked again a few times only: other tests say how often."""
    if request.module.__name__.rpartition(".")[2] != "test_engine_history":
        monkeypatch.setattr(run, "OFTEN", 2)
