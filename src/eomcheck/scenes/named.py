"""Scenes by name: those of the registry, of installed packages, and a user's own in a file."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from eomcheck.lookup import Kind, looked_up
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import SCENES
from eomcheck.scenes.urdf import urdf_kind

ALL = "all"

SCENE: Kind[Scene] = Kind("scene", Scene, SCENES)


def left_out(kinds: Iterable[type[Scene]]) -> Iterator[str]:
    """Yield, a sentence each, what is left out of the files that kinds of scenes are read from."""
    for kind in kinds:
        made = getattr(kind, "made", None)
        if made is not None and made.left_out:
            yield f"{made.source}: {made.left_out}"


def kinds_of(name: str) -> tuple[type[Scene], ...]:
    """Return the kinds of scenes that `name` stands for.

    Args:
        name: "all" of the registry, a robot's file.urdf, or a name as `eomcheck.lookup.looked_up`
            understands it.

    Raises:
        UnknownNameError: there is no such key.
        InputError: no such file, no such scene in it, or a robot that `from_urdf` refuses.
    """
    if name.lower().endswith(".urdf"):
        return (urdf_kind(name),)
    return tuple(SCENES.values()) if name == ALL else (looked_up(SCENE, name),)
