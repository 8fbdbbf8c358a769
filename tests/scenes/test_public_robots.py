"""Public robot descriptions, where wheels that hold them are installed: agreement with Pinocchio.

Such are example-robot-data and pybullet. `EOMCHECK_ROBOTS` names one more folder to look in, say
the site-packages of another environment.
"""

from __future__ import annotations

import os
import site
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from eomcheck.claims.proof import prove
from eomcheck.engines import PinocchioFile
from eomcheck.engines.answers import Answers
from eomcheck.evaluation.evaluation import Evaluation
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
    answers, random = Answers(PinocchioFile(scene)), np.random.default_rng(0)
    for _ in range(5):
        q, v = random.uniform(-1.2, 1.2, scene.n), random.uniform(-3.0, 3.0, scene.n)
        M, Q, B, *_ = Evaluation(scene, q, v).terms
        for ours, theirs in (
            (M, answers.mass_matrix(q)),
            (B, answers.bias(q, v)),
            (Q, answers.forces(q, v)),
        ):
            assert np.abs(ours - theirs).max() <= 1e-13 * np.abs(theirs).max()
    findings = prove(scene, points=1, seed=0)
    assert [str(f) for f in findings if f.verdict != "passed"] == []
