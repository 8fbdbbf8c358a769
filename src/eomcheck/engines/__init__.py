"""The engines: one file each, one line each in `ENGINES`. No library is imported here."""

from __future__ import annotations

from eomcheck.engines.answers import Answers
from eomcheck.engines.base import OPTIONAL, Engine, EngineAcceleration, VelocityMap
from eomcheck.engines.casadi import CasadiEngine
from eomcheck.engines.pinocchio import PinocchioEngine
from eomcheck.errors import named

ENGINES: dict[str, type[Engine]] = {
    engine.key: engine for engine in (PinocchioEngine, CasadiEngine)
}
"""Key -> class."""


def engine_of(key: str) -> type[Engine]:
    """Return the engine called `key`.

    Raises:
        UnknownNameError: there is none.
    """
    return named("engine", key, ENGINES)


__all__ = [
    "ENGINES",
    "OPTIONAL",
    "Answers",
    "Engine",
    "EngineAcceleration",
    "VelocityMap",
    "engine_of",
]
