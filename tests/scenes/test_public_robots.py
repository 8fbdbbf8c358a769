"""Public robot descriptions, where wheels that hold them are installed: agreement with Pinocchio.

Such are example-robot-data and pybullet. `EOMCHECK_ROBOTS` names one more folder to look in, say
the site-packages of another environment.
"""

from __future__ import annotations

import os
import site
from functools import cache
from pathlib import Path

import pytest
from tests.robots import difference_from_pinocchio

from eomcheck.claims.proof import prove
from eomcheck.scenes import from_urdf

FOLDERS = "cmeel.prefix/share/example-robot-data/robots", "pybullet_data", "pybullet_robots"
FIXED = ("ur5_robot", "z1", "xarm7", "panda", "kinova", "allegro_right_hand", "xarm6_with_gripper")
FREE = ("solo12", "anymal", "hyq_no_sensors", "simple_humanoid")


@cache
def found(name: str) -> Path | None:
    """Return the file of a robot, None where no wheel with it is installed."""
    more = os.environ.get("EOMCHECK_ROBOTS")
    for place in (*site.getsitepackages(), *((more,) if more else ())):
        for folder in FOLDERS:
            for path in sorted((Path(place) / folder).rglob(f"{name}.urdf")):
                return path
    return None


@pytest.mark.parametrize(
    ("name", "floating"), [*((x, False) for x in FIXED), *((x, True) for x in FREE)]
)
@pytest.mark.sampled(3)
def test_a_public_robot_agrees_with_what_pinocchio_reads_and_is_proved(name: str, floating: bool):
    path = found(name)
    if path is None:
        pytest.skip(f"no {name}.urdf: neither example-robot-data nor pybullet is installed")
    scene = from_urdf(path, floating=floating)
    assert difference_from_pinocchio(scene, states=5) <= 1e-13
    findings = prove(scene, points=1, seed=0)
    assert [str(f) for f in findings if f.verdict != "passed"] == []
