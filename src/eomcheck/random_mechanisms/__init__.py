"""Random mechanisms: kinds of scenes of which every draw hangs together in another way."""

from __future__ import annotations

from eomcheck.mechanics.scene import Scene
from eomcheck.random_mechanisms.kinds import RandomMechanism, RandomTree

RANDOM: dict[str, type[Scene]] = {
    kind.key: type(kind.example()) for kind in (RandomTree, RandomMechanism)
}
"""Key -> class: that of its example, for only such a class has equations."""

__all__ = ["RANDOM", "RandomMechanism", "RandomTree"]
