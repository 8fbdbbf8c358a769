"""The scenes: one file each, one line each in `SCENES`."""

from __future__ import annotations

from eomcheck.errors import named
from eomcheck.model import Scene
from eomcheck.scenes.chain_pendulum import ChainPendulum
from eomcheck.scenes.snake import Snake

SCENES: dict[str, type[Scene]] = {
    scene.key: scene
    for scene in (
        Snake,
        ChainPendulum,
    )
}
"""Key -> class."""


def scene_of(key: str) -> type[Scene]:
    """Return the kind of scene called `key`.

    Raises:
        UnknownNameError: there is none.
    """
    return named("scene", key, SCENES)


__all__ = ["SCENES", "ChainPendulum", "Snake", "scene_of"]
