"""adam, where it is installed: right in NumPy and in JAX, of trees, files and free bases."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.engines.own_findings import failed, own_findings, passed
from tests.robots import arm, hinges

from eomcheck.engines.adam import (
    Adam64Engine,
    AdamEngine,
    AdamFile,
    AdamNumpyEngine,
    AdamNumpyFile,
)
from eomcheck.scenes import ChainPendulum, Snake, from_urdf

pytest.importorskip("adam")

OFFERED = {
    "mass-matrix",
    "bias",
    "engine-gravity",
    "engine-center-of-mass",
    "engine-center-of-mass-jacobian",
    "engine-momentum-matrix",
    "engine-frame-placement",
    "engine-frame-jacobian",
    "engine-frame-bias",
}


@pytest.mark.parametrize(
    "kind",
    [
        AdamNumpyEngine,
        pytest.param(AdamEngine, marks=pytest.mark.night),
        pytest.param(Adam64Engine, marks=pytest.mark.night),
    ],
)
def test_every_quantity_that_it_offers_is_right(kind):
    own = own_findings(kind, ChainPendulum.example(), OFFERED)
    assert failed(own) == []
    assert passed(own) == OFFERED


def test_frames_off_their_joints_and_gravity_of_a_tree_are_right(tmp_path: Path):
    scene = from_urdf(hinges(tmp_path / "arm.urdf"), gravity=(1.0, -2.0, -9.0))
    own = own_findings(AdamNumpyEngine, scene, OFFERED)
    assert failed(own) == []
    assert passed(own) == OFFERED
    assert any("tip" in x.subject for x in own)


@pytest.mark.parametrize("floating", [False, True])
@pytest.mark.parametrize("kind", [AdamNumpyFile, pytest.param(AdamFile, marks=pytest.mark.night)])
def test_a_file_with_a_fixed_and_with_a_free_base_is_right(kind, floating, tmp_path):
    path = hinges(tmp_path / "arm.urdf")
    scene = from_urdf(path, floating=floating, gravity=(1.0, -2.0, -9.0))
    own = own_findings(kind, scene, OFFERED)
    assert failed(own) == []
    assert passed(own) == OFFERED


def test_a_tree_with_a_slide_is_not_represented_and_a_file_with_one_is_refused(tmp_path):
    assert AdamNumpyEngine.represents(ChainPendulum.example())
    assert not AdamNumpyEngine.represents(Snake.example())
    scene = from_urdf(arm(tmp_path / "arm.urdf"))
    with pytest.raises(ValueError, match="concatenation axis"):
        AdamNumpyFile(scene)  # docs/conformance/adam_prismatic_joint.py
