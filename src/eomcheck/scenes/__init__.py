"""The built-in scenes: one file each, registered in `SCENES`, one line each.

Snake, sleigh, disk and ball are derived by hand, the others described by links and joints. By hand
they keep generalized speeds of their own, which a description has not (the sleigh's partition is
singular where it starts), the disk 5 coordinates instead of 6, the ball a table that oscillates;
and they cost less: a description has 35 times (sleigh) and 70 times (disk) the time of `terms`, and
the check of a state takes 1.1 and 1.5 times as long. Descriptions are tested against them.
"""

from __future__ import annotations

from eomcheck.descriptions.mjcf_reader import from_mjcf
from eomcheck.descriptions.sdf_reader import from_sdf
from eomcheck.descriptions.urdf_reader import from_urdf
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes.andrews import Andrews
from eomcheck.scenes.bicycle import Bicycle
from eomcheck.scenes.bricard import Bricard
from eomcheck.scenes.chain_pendulum import ChainPendulum
from eomcheck.scenes.flyball_governor import FlyballGovernor
from eomcheck.scenes.four_bar_chain import FourBarChain
from eomcheck.scenes.rolling_disk import RollingDisk
from eomcheck.scenes.sleigh import Sleigh
from eomcheck.scenes.snake import Snake
from eomcheck.scenes.turntable_ball import TurntableBall

SCENES: dict[str, type[Scene]] = {
    scene.key: scene
    for scene in (
        Snake,
        ChainPendulum,
        Sleigh,
        RollingDisk,
        TurntableBall,
        FourBarChain,
        Andrews,
        FlyballGovernor,
        Bricard,
        Bicycle,
    )
}
"""Key -> scene class."""

__all__ = [
    "SCENES",
    "Andrews",
    "Bicycle",
    "Bricard",
    "ChainPendulum",
    "FlyballGovernor",
    "FourBarChain",
    "RollingDisk",
    "Sleigh",
    "Snake",
    "TurntableBall",
    "from_mjcf",
    "from_sdf",
    "from_urdf",
]
