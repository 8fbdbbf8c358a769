"""Random mechanisms: kinds of scenes of which every draw hangs together in another way."""

from __future__ import annotations

from eomcheck.mechanics.scene import Scene
from eomcheck.scenes.random.kinds import RandomMechanism, RandomTree


def _first(kind: type[RandomTree] | type[RandomMechanism]) -> type[Scene]:
    """Return the kind by one of its scenes, which is its example: a class that has equations."""
    return type(next(kind.structures(3)))


RANDOM: dict[str, type[Scene]] = {kind.key: _first(kind) for kind in (RandomTree, RandomMechanism)}
"""Key -> class."""

__all__ = ["RANDOM", "RandomMechanism", "RandomTree"]
