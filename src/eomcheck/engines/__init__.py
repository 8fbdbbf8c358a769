"""Engines: one file each, one line each in `ENGINES`. No library is imported here."""

from __future__ import annotations

from collections.abc import Iterable
from inspect import getattr_static

from eomcheck import calls
from eomcheck.class_lookup import LookupKind, class_named
from eomcheck.engines.answers import Answers, EngineFault, make_engine, represents, version_of
from eomcheck.engines.casadi import CasadiEngine
from eomcheck.engines.drake import DrakeEngine
from eomcheck.engines.engine import OPTIONAL, Engine, EngineAcceleration, VelocityMap
from eomcheck.engines.exudyn import ExudynEngine
from eomcheck.engines.idyntree import IdyntreeEngine
from eomcheck.engines.mujoco import MujocoEngine
from eomcheck.engines.pinocchio import PinocchioEngine
from eomcheck.engines.pybullet import PybulletEngine
from eomcheck.errors import InputError, distinct
from eomcheck.formulations import FORMULATIONS

ENGINES: dict[str, type[Engine]] = {
    engine.key: engine
    for engine in (
        PinocchioEngine,
        CasadiEngine,
        MujocoEngine,
        DrakeEngine,
        ExudynEngine,
        IdyntreeEngine,
        PybulletEngine,
    )
}
"""Key -> class."""

ALWAYS = tuple(key for key, engine in ENGINES.items() if engine.extra is None)
"""Keys of the engines whose libraries come with eomcheck: they take part unless others are named.
So a run does not depend on what else happens to be installed."""


ENGINE: LookupKind[Engine] = LookupKind("engine", Engine, ENGINES)


def engine_of(name: str | type[Engine]) -> type[Engine]:
    """Return the engine that `name` stands for.

    Args:
        name: a key of `ENGINES`, another name as `eomcheck.class_lookup.class_named` understands
            it, or the class itself.

    Raises:
        UnknownNameError: there is none.
        InputError: no such file, no such engine in it, or the class does not keep the contract.
    """
    if isinstance(name, Engine):
        raise InputError(f"engine = {name!r}, expected its class {type(name).__name__}")
    if isinstance(name, type):
        if not issubclass(name, Engine):
            raise InputError(f"engine = {name.__name__}, expected a class that derives from Engine")
        return checked_engine(name)
    return checked_engine(class_named(ENGINE, name))


def engines_among(names: Iterable[str | type[Engine]] | None) -> tuple[type[Engine], ...]:
    """Return the engines that are named, or those of `ALWAYS` if `names` is None.

    Raises:
        InputError, UnknownNameError: see `engine_of`; or two have one key.
    """
    found: dict[str, type[Engine]] = {}
    for kind in map(engine_of, ALWAYS if names is None else distinct("engines", names)):
        if kind.extra is not None:
            calls.require_supervision()  # a library that may crash
        if found.setdefault(kind.key, kind) is not kind:
            raise InputError(f"engines = {names!r}: two have the key {kind.key!r}")
    return tuple(found.values())


def checked_engine(kind: type[Engine]) -> type[Engine]:
    """Return an engine whose class says all that the contract asks of it.

    Raises:
        InputError: a method that is required is missing, or no class method; the key is no name, or
            that of something else; it accelerates, and does not say like which formulation.
    """
    whose = f"engine {kind.__name__}"
    if missing := sorted(getattr(kind, "__abstractmethods__", ())):
        raise InputError(f"{whose} has no {', '.join(missing)}")
    for method in ("version", "represents"):
        if not isinstance(getattr_static(kind, method), classmethod | staticmethod):
            raise InputError(f"{whose}: {method} is no class method, write @classmethod above it")
    if not kind.key.isidentifier():
        raise InputError(f"{whose}: key = {kind.key!r}, expected letters, digits and underscores")
    if kind.key in FORMULATIONS or ENGINES.get(kind.key, kind) is not kind:
        raise InputError(f"{whose}: key = {kind.key!r} is that of something else")
    known = [key for key, one in FORMULATIONS.items() if one.uses == "terms"]
    if kind.offers("acceleration") and getattr(kind, "solves_like", None) not in known:
        listed = ", ".join(known)
        raise InputError(f"{whose} has an acceleration, but solves_like is none of {listed}")
    return kind


__all__ = [
    "ALWAYS",
    "ENGINES",
    "OPTIONAL",
    "Answers",
    "Engine",
    "EngineAcceleration",
    "EngineFault",
    "VelocityMap",
    "engine_of",
    "engines_among",
    "make_engine",
    "represents",
    "version_of",
]


def is_under_test(kind: type[Engine]) -> bool:
    """Return whether an engine is not one of ours, so that it is the one to judge."""
    return kind not in ENGINES.values()


def engine_class_of(engine: Engine | type[Engine]) -> type[Engine]:
    """Return the class of an engine; of one that could not be made, that is all there is."""
    return engine if isinstance(engine, type) else type(engine)
