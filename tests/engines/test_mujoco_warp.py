"""MuJoCo Warp, where it is installed: springs and dampers are where they belong."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.engines.own_findings import failed, own_findings, passed, verdicts
from tests.robots import arm, tilted

from eomcheck.engines.mujoco_warp import MujocoWarpEngine, MujocoWarpFile
from eomcheck.scenes import from_urdf

pytest.importorskip("mujoco_warp")


def test_dampers_of_a_file_are_in_forces_and_accelerations_and_nowhere_else(tmp_path: Path):
    scene = from_urdf(arm(tmp_path / "arm.urdf", damping="3"))
    terms = "generalized-forces", "engine-acceleration", "engine-gravity", "engine-forward-dynamics"
    assert verdicts(MujocoWarpFile, scene, terms) == dict.fromkeys(terms, "passed")


def test_a_tree_has_the_gravity_and_the_frames_that_it_is_given(tmp_path: Path):
    scene = tilted(tmp_path / "tilted.xml")
    own = own_findings(MujocoWarpEngine, scene)
    assert failed(own) == []
    assert passed(own) >= {"mass-matrix", "bias", "engine-gravity", "engine-inverse-dynamics"}
    assert any("hand" in x.subject for x in own)
