"""Units of the coordinates of a scene."""

from __future__ import annotations

from eomcheck.descriptions.mechanism_class import Mechanism
from eomcheck.mechanics.scene import Scene


def units(scene: Scene) -> list[str]:
    """Return the unit of each coordinate (n,)."""
    angles = set(range(scene.n)[scene.angle_coordinates])
    if isinstance(scene, Mechanism):  # of which only some need be angles, anywhere in the row
        angles = {one.coordinate for one in scene.made.topology.slots if not one.slides}
    return ["rad" if i in angles else "m" for i in range(scene.n)]
