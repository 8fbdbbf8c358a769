"""Scenes by name: those of the registry, of installed packages, and a user's own in a file."""

from __future__ import annotations

from eomcheck.lookup import Kind, looked_up
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import SCENES

ALL = "all"

SCENE: Kind[Scene] = Kind("scene", Scene, SCENES)


def kinds_of(name: str) -> tuple[type[Scene], ...]:
    """Return the kinds of scenes that `name` stands for.

    Args:
        name: "all" of the registry, or a name as `eomcheck.lookup.looked_up` understands it.

    Raises:
        UnknownNameError: there is no such key.
        InputError: no such file, or no such scene in it.
    """
    return tuple(SCENES.values()) if name == ALL else (looked_up(SCENE, name),)
