"""Scenes by name: those of the registry, and a user's own in a file."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

from eomcheck.errors import InputError, named
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import SCENES

ALL = "all"


def kinds_of(name: str) -> tuple[type[Scene], ...]:
    """Return the kinds of scenes that `name` stands for.

    Args:
        name: a key of `SCENES`, "all" of them, or "path/to/file.py:ClassName".

    Raises:
        UnknownNameError: there is no such key.
        InputError: no such file, or no such scene in it.
    """
    if name == ALL:
        return tuple(SCENES.values())
    path, colon, kind = name.rpartition(":")
    if colon and path.endswith(".py"):
        return (own_scene(Path(path), kind),)
    return (named("scene", name, SCENES),)


def own_scene(path: Path, name: str) -> type[Scene]:
    """Return the scene called `name` in the Python file `path`.

    Raises:
        InputError: no such file, it cannot be run, or it has no such scene.
    """
    module = _module(path)
    found = getattr(module, name, None)
    if not (isinstance(found, type) and issubclass(found, Scene)):
        own = [
            key
            for key, value in vars(module).items()
            if isinstance(value, type) and value.__module__ == module.__name__
            if issubclass(value, Scene)
        ]
        raise InputError(f"{str(path)!r} has no scene {name!r}; it has: {', '.join(own) or 'none'}")
    return found


def _module(path: Path) -> ModuleType:
    """Return the file as a module, under the name by which its folder would import it."""
    if not path.is_file():
        raise InputError(f"{str(path)!r} is not a file")
    name, path = path.stem, path.resolve()
    known = sys.modules.get(name)
    if known is not None:
        if getattr(known, "__file__", None) == str(path):
            return known
        raise InputError(f"{str(path)!r} has the name of another module, {name}")
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        del sys.modules[name]
        what = f"{type(error).__name__}: {error}"
        raise InputError(f"{str(path)!r} cannot be run: {what}") from error
    return module
