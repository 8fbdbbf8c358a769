"""Engines whose coordinates are more than the scene's: joints that follow others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.robots import arm, body, joint

from eomcheck import validate
from eomcheck.engines import Engine
from eomcheck.engines.pinocchio import PinocchioEngine
from eomcheck.scenes import from_urdf

MIMIC = '<mimic joint="grip" multiplier="-2"/>'


class Eliminating(Engine):
    """Solve all joints as if they were free, and hold those that follow afterwards."""

    solves_like = "gw"
    factor = 1.0

    def __init__(self, scene):
        self.tree = PinocchioEngine(scene)

    @classmethod
    def version(cls):
        return "eliminating 1"

    @classmethod
    def represents(cls, scene):
        return scene.tree() is not None

    def velocity_map(self, q, v):
        return self.tree.velocity_map(q, v)

    def mass_matrix(self, q, t=0.0):
        return self.tree.mass_matrix(q)

    def bias(self, q, v, t=0.0):
        return self.tree.bias(q, v)

    def acceleration(self, q, v, Q, a, gamma, t=0.0):
        M, S = self.mass_matrix(q), self.tree.coordinates
        rows = np.linalg.svd(S)[0][:, S.shape[1] :].T
        free, response = np.linalg.solve(M, Q - self.bias(q, v)), np.linalg.solve(M, rows.T)
        return self.factor * (free - response @ np.linalg.solve(rows @ response, rows @ free)), None


class Slow(Eliminating):
    """A millionth too slow."""

    factor = 1 - 1e-6


def verdicts(path: Path, kind: type[Engine], mass: float) -> set[tuple[str, str]]:
    """Return verdicts and details on accelerations of a robot whose last finger has this mass."""
    light = {"mass": mass, "xx": mass / 5, "yy": mass / 4, "zz": mass / 3}
    finger = body("right", **light)
    for product in ("0.01", "-0.02", "0.015"):
        finger = finger.replace(f'"{product}"', '"0"')
    grip = joint("grip", "hand", "left", "prismatic", "1 0 0")
    more = body("left") + finger + grip + joint("f", "left", "right", "revolute", "0 0 1", MIMIC)
    scene = from_urdf(arm(path, more=more))
    how = {"engines": [kind], "formulations": ["gw"], "claims": ["engine-acceleration"]}
    found = validate(scene, examples=4, **how)
    return {(one.verdict, one.detail.partition(",")[0]) for one in found}


@pytest.mark.parametrize("mass", [0.5, 1e-8])
def test_a_right_engine_is_not_blamed_for_a_light_joint_that_follows(tmp_path: Path, mass: float):
    found = verdicts(tmp_path / "arm.urdf", Eliminating, mass)
    why = "the condition of its own matrix"
    assert found <= {("passed", ""), ("inconclusive", why)}
    assert (("inconclusive", why) in found) == (mass == 1e-8)


def test_a_wrong_engine_is_blamed_though_joints_follow(tmp_path: Path):
    assert ("failed", "acceleration") in verdicts(tmp_path / "arm.urdf", Slow, 0.5)
