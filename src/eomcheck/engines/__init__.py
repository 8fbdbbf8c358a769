"""Engines: adapters to multibody dynamics libraries, the independent references of eomcheck.

A library has one file, and one line in `COMPARED` or `ON_REQUEST`; the engine classes in the files
are the registry. Importing this package imports no library. `ENGINES` build models of scenes, those
of `BY_FORMAT` are of libraries that read a robot description by their own parser:

eomcheck validate --scene arm.urdf --engine eomcheck.engines:PinocchioFile
eomcheck validate --scene ant.xml --engine eomcheck.engines:MjcfFile

A name with a version is an engine whose library runs in a process and an environment of its own
(`eomcheck.engines.isolation`), in any version with `*`:

eomcheck compare arm.urdf --engine mujoco==3.12.0 --engine mujoco==4.0.0
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from importlib import import_module, metadata
from inspect import getattr_static, isabstract
from numbers import Real
from typing import Any, TypeVar

from eomcheck import calls
from eomcheck.class_lookup import LookupKind, class_named, home_of_code
from eomcheck.descriptions.mechanism_class import Mechanism
from eomcheck.engines.answers import (
    OPTIONAL,
    Answers,
    EngineFault,
    make_engine,
    represents,
    version_of,
)
from eomcheck.engines.engine import Engine, EngineAcceleration, VelocityMap
from eomcheck.engines.file_engine import FileEngine
from eomcheck.engines.isolation import ANY, PINNED, adapter_of, isolated
from eomcheck.engines.mujoco import MjcfFile
from eomcheck.engines.pinocchio import PinocchioFile
from eomcheck.engines.tree_engine import (
    SUFFIXES,
    UNSTATED,
    TreeEngine,
    library_key,
    requirements_of,
)
from eomcheck.errors import EngineError, InputError, distinct, registered, safe_repr
from eomcheck.evaluation.tolerance import UNIT_ROUNDOFF
from eomcheck.formulations import FORMULATIONS
from eomcheck.mechanics.scene import Scene

# ---- Registry ------------------------------------------------------------------------------------

COMPARED = ("pinocchio", "casadi", "mujoco", "drake", "exudyn", "idyntree", "pybullet")
"""Files of the libraries that a comparison asks unless others are named."""

ON_REQUEST = [
    "adam",
    "brax",
    "dart",
    "genesis",
    "jaxsim",
    "newton",
    "mjx",
    "mujoco_warp",
    "opensim",
    "roboticstoolbox",
    "sympy_mechanics",
]
"""Files of the libraries that are asked only where they are named, one a line."""

K = TypeVar("K", bound=Engine)


def _adapters(file: str) -> Iterator[type[Engine]]:
    """Yield the engine classes of a file of this package, as they stand in it."""
    module = import_module(f"{__name__}.{file}")
    for kind in vars(module).values():
        own = isinstance(kind, type) and kind.__module__ == module.__name__
        if own and issubclass(kind, Engine) and not isabstract(kind):
            yield kind


_BUILT_IN = [kind for file in (*COMPARED, *ON_REQUEST) for kind in _adapters(file)]

ENGINES: dict[str, type[Engine]] = {
    kind.key: kind for kind in _BUILT_IN if not issubclass(kind, FileEngine)
}
"""Key -> engine class."""

BY_FORMAT: dict[str, dict[str, type[FileEngine]]] = {
    format: {
        library_key(kind): kind
        for kind in _BUILT_IN
        if issubclass(kind, FileEngine) and kind.format == format
    }
    for format in SUFFIXES
}
"""Format of a file -> classes that read it, by key of the library."""

READERS = BY_FORMAT["urdf"]
"""Key of the library -> class that reads a URDF."""

DEFAULT: dict[str, type[FileEngine]] = {"urdf": PinocchioFile, "mjcf": MjcfFile}
"""Format of a file -> class that reads it in a validation unless engines are named."""

LIBRARIES: dict[str, type[Engine]] = ENGINES | BY_FORMAT["mjcf"] | READERS | ENGINES
"""Key -> engine class; of a library that builds no model of a scene, the class that reads files."""


def asked_by_default(registry: Mapping[str, type[K]]) -> dict[str, type[K]]:
    """Return the engines of a registry that a comparison asks unless others are named."""
    others = {library_key(kind) for file in ON_REQUEST for kind in _adapters(file)}
    return {key: kind for key, kind in registry.items() if key not in others}


def installed_version(kind: type[Engine]) -> str:
    """Return name and version of the library of an engine, "" if it is not installed.

    Of a tree engine no library is imported for it, as that takes seconds and memory.
    """
    try:
        if issubclass(kind, TreeEngine):
            return f"{kind.extra or kind.key} {metadata.version(kind.distribution())}"
        return version_of(kind)
    except (EngineError, metadata.PackageNotFoundError):
        return ""


def least_version(kind: type[Engine]) -> str:
    """Return the oldest version of its library that an engine supports, "" if none is stated.

    It is `TreeEngine.oldest`, or else what eomcheck requires.
    """
    oldest = getattr(kind, "oldest", UNSTATED)
    if oldest != UNSTATED:
        return oldest
    name = kind.distribution() if issubclass(kind, TreeEngine) else kind.key
    return requirements_of(name, kind.extra)[0].partition(">=")[2]


ALWAYS = tuple(key for key, engine in ENGINES.items() if engine.extra is None)
"""Keys of the engines whose libraries come with eomcheck: they take part unless others are named.
So a run does not depend on other libraries that happen to be installed."""


LARGEST_UNIT_ROUNDOFF = 2.0**-8
"""The largest unit roundoff of an engine, that of bfloat16."""

ENGINE: LookupKind[Engine] = LookupKind("engine", Engine, LIBRARIES)


def engine_of(name: str | type[Engine]) -> type[Engine]:
    """Return the engine class that `name` stands for.

    Args:
        name: a key of `LIBRARIES`, another name as `eomcheck.class_lookup.class_named` understands
            it, either with a version as in "mujoco==4.0.0", or the class itself.

    Raises:
        UnknownNameError: no engine has this name.
        InputError: no such file, no such engine in it, or the class breaks the contract.
    """
    if isinstance(name, Engine):
        raise InputError(f"engine = {name!r}, expected its class {type(name).__name__}")
    if isinstance(name, type):
        if not issubclass(name, Engine):
            raise InputError(f"engine = {name.__name__}, expected a class that derives from Engine")
        return checked_engine(name)
    library, pinned, version = name.partition(PINNED) if isinstance(name, str) else (name, "", "")
    kind = checked_engine(class_named(ENGINE, library))
    return isolated(kind, version) if pinned else kind


def isolated_names(names: Iterable[str]) -> list[str]:
    """Return names by which optional libraries run in processes and environments of their own.

    A key of `LIBRARIES` with an extra gets the version `ANY`; all other names are the same.
    """
    optional = [key for key, kind in LIBRARIES.items() if kind.extra is not None]
    return [f"{name}{PINNED}{ANY}" if name in optional else name for name in names]


def plain_name(name: str) -> str:
    """Return a name of an engine without the version `ANY`, as its key is."""
    return name.removesuffix(f"{PINNED}{ANY}")


def engines_among(names: Iterable[str | type[Engine]] | None) -> tuple[type[Engine], ...]:
    """Return the engine classes that are named, or those of `ALWAYS` if `names` is None.

    Args:
        names: keys, other names or classes, see `engine_of`.

    Returns:
        Engine classes in the order of `names`.

    Raises:
        InputError, UnknownNameError: see `engine_of`; or two have one key.
    """
    engines: dict[str, type[Engine]] = {}
    for kind in map(engine_of, ALWAYS if names is None else distinct("engines", names)):
        if kind.extra is not None and adapter_of(kind) is kind:
            calls.require_supervision()  # a library that may crash this process
        if engines.setdefault(kind.key, kind) is not kind:
            raise InputError(f"engines = {names!r}: two have the key {kind.key!r}")
    return tuple(engines.values())


def checked_engine(kind: type[Engine]) -> type[Engine]:
    """Return the engine class itself, if it meets the contract.

    Raises:
        InputError: a required method is missing, or no class method; the key is no identifier, or
            taken; `unit_roundoff` is none; an optional method is misspelt; it overrides
            `acceleration` and has no valid `solves_like`.
    """
    whose = f"engine {kind.__name__}"
    if missing := sorted(getattr(kind, "__abstractmethods__", ())):
        raise InputError(f"{whose} has no {', '.join(missing)}")
    for method in ("version", "represents"):
        if not isinstance(getattr_static(kind, method), classmethod | staticmethod):
            raise InputError(f"{whose}: {method} is no class method, write @classmethod above it")
    check_unit_roundoff(kind)
    if adapter_of(kind) is not kind:
        return kind
    if not kind.key.isidentifier():
        raise InputError(f"{whose}: key = {kind.key!r}, expected letters, digits and underscores")
    if kind.key in FORMULATIONS or ENGINES.get(kind.key, kind) is not kind:
        raise InputError(f"{whose}: key = {kind.key!r} is that of something else")
    check_method_names(kind)
    solvers = [key for key, f in FORMULATIONS.items() if f.uses == "terms"]
    if kind.offers("acceleration") and getattr(kind, "solves_like", None) not in solvers:
        listed = ", ".join(solvers)
        raise InputError(f"{whose} has an acceleration, but solves_like is none of {listed}")
    return kind


SHORTEST = 7
"""Letters of a name from which on it is recognized although it is misspelt."""


def check_method_names(kind: type[Engine]) -> None:
    """Check that no public method of an engine class has nearly the name of an optional one.

    Nothing would ever call it. A helper beside the method itself may have any name.

    Raises:
        InputError: one has.
    """
    optional = {name for name in (*OPTIONAL, *FURTHER) if not kind.offers(name)}
    own = {
        name: value
        for base in kind.__mro__[: kind.__mro__.index(Engine)]
        for name, value in vars(base).items()
        if callable(value) and not name.startswith("_") and not hasattr(Engine, name)
    }
    for name in own:
        for near in sorted(optional):
            if len(near) >= SHORTEST and is_misspelt(name, near):
                raise InputError(
                    f"engine {kind.__name__}: {name} is no method that is called (did you mean "
                    f"{near!r}?); begin the name of a helper with _"
                )


def is_misspelt(name: str, known: str) -> bool:
    """Return whether a name is another one but for a letter, two exchanged ones or the order of
    its words.
    """
    if sorted(name.split("_")) == sorted(known.split("_")):
        return name != known
    start = _common(name, known)
    first, second = name[start:], known[start:]
    end = _common(first[::-1], second[::-1])
    first, second = first[: len(first) - end], second[: len(second) - end]
    return max(len(first), len(second)) == 1 or (len(first) == 2 and first == second[::-1])


def _common(first: str, second: str) -> int:
    """Return the number of letters with which both begin."""
    pairs = enumerate(zip(first, second, strict=False))
    return next((i for i, (x, y) in pairs if x != y), min(len(first), len(second)))


FURTHER = "velocity_map", "velocity_map_derivatives", "has_frame"
"""Optional methods beside those that answer for a quantity."""


def check_unit_roundoff(kind: type[Engine]) -> None:
    """Check the `unit_roundoff` of an engine class.

    Raises:
        InputError: it is no power of two from 2**-53 to 2**-8.
    """
    u: Any = kind.unit_roundoff
    number = float(u) if isinstance(u, Real) and not isinstance(u, bool) else math.nan
    if UNIT_ROUNDOFF <= number <= LARGEST_UNIT_ROUNDOFF and math.frexp(number)[0] == 0.5:
        return
    raise InputError(
        f"engine {kind.__name__}: unit_roundoff = {safe_repr(u)}, expected a power of two from "
        "2**-53, of float64, to 2**-8: half the spacing of its numbers at 1, 2**-24 for float32"
    )


def is_under_test(kind: type[Engine]) -> bool:
    """Return whether an engine is user-supplied, not built in, and so the code under test."""
    return adapter_of(kind) not in ENGINES.values()


def engine_class_of(engine: Engine | type[Engine]) -> type[Engine]:
    """Return the class of an engine, or the class itself of one that could not be constructed."""
    return engine if isinstance(engine, type) else type(engine)


# ---- Readers of robot descriptions ---------------------------------------------------------------


def reader_of(scene: Mechanism, name: str) -> type[FileEngine]:
    """Return the class of a library that reads the file of a robot.

    Args:
        scene: the robot.
        name: key of the library, maybe with a version as in "mujoco==4.0.0", or the name of a
            `FileEngine` of a user, see `engine_of`.

    Raises:
        UnknownNameError: no library of this name reads files of this format.
        InputError: the version is none, or a user's class does not read this file.
    """
    library, pinned, version = name.partition(PINNED)
    if home_of_code(library) is not None:
        kind = engine_of(name)
        if issubclass(kind, FileEngine) and represents(kind, scene):
            return kind
        raise InputError(
            f"engine = {name!r} is no FileEngine that reads {scene.name}; an engine that builds "
            "bodies from a tree is checked by `eomcheck validate --engine`"
        )
    reader = registered("engine", library, BY_FORMAT[scene.source.format])
    return isolated(reader, version) if pinned else reader


def default_reader(scene: Scene | type[Scene]) -> type[FileEngine] | None:
    """Return the class that reads the file of a robot by default; None for any other scene."""
    return DEFAULT.get(getattr(getattr(scene, "source", None), "format", ""))


__all__ = [
    "ALWAYS",
    "BY_FORMAT",
    "ENGINES",
    "LIBRARIES",
    "OPTIONAL",
    "READERS",
    "Answers",
    "Engine",
    "EngineAcceleration",
    "EngineFault",
    "FileEngine",
    "MjcfFile",
    "PinocchioFile",
    "VelocityMap",
    "asked_by_default",
    "default_reader",
    "engine_of",
    "engines_among",
    "isolated_names",
    "make_engine",
    "reader_of",
    "represents",
    "version_of",
]
