"""Readers of robot descriptions: engines whose libraries read the file by their own parser.

eomcheck validate --scene arm.urdf --engine eomcheck.engines.files:PinocchioFile
eomcheck validate --scene ant.xml --engine eomcheck.engines.files:MjcfFile
"""

from __future__ import annotations

from eomcheck.engines.drake import DrakeFile
from eomcheck.engines.file_engine import FILE, FileEngine
from eomcheck.engines.idyntree import IdyntreeFile
from eomcheck.engines.mujoco import MjcfFile, MujocoFile
from eomcheck.engines.pinocchio import PinocchioFile
from eomcheck.engines.pybullet import PybulletFile
from eomcheck.mechanics.scene import Scene

READERS: dict[str, type[FileEngine]] = {
    engine.key.removesuffix(FILE): engine
    for engine in (PinocchioFile, MujocoFile, DrakeFile, IdyntreeFile, PybulletFile)
}
"""Key of the library -> class that reads a URDF."""

DEFAULT: dict[str, type[FileEngine]] = {"urdf": PinocchioFile, "mjcf": MjcfFile}
"""Format of a file -> class that reads it in a validation unless engines are named."""

BY_FORMAT: dict[str, dict[str, type[FileEngine]]] = {"urdf": READERS, "mjcf": {"mujoco": MjcfFile}}
"""Format of a file -> classes that read it, by key of the library."""


def default_reader(scene: Scene | type[Scene]) -> type[FileEngine] | None:
    """Return the class that reads the file of a robot by default; None for any other scene."""
    return DEFAULT.get(getattr(getattr(scene, "source", None), "format", ""))


__all__ = [
    "BY_FORMAT",
    "READERS",
    "FileEngine",
    "MjcfFile",
    "PinocchioFile",
    "default_reader",
]
