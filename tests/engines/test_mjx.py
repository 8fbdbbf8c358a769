"""MJX, where it is installed: its quantities are MuJoCo's in float64, and right in float32."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.engines.own_findings import failed, own_findings, passed, verdicts
from tests.robots import arm, tilted

from eomcheck.engines.mjx import Mjx64Engine, Mjx64File, MjxEngine, MjxFile
from eomcheck.scenes import ChainPendulum, from_urdf

pytest.importorskip("mujoco.mjx")


@pytest.mark.parametrize("kind", [MjxEngine, Mjx64Engine])
def test_every_quantity_that_it_offers_is_right(kind):
    own = own_findings(kind, ChainPendulum.example())
    assert failed(own) == []
    some = {"mass-matrix", "bias", "engine-momentum", "engine-frame-jacobian"}
    assert some | {"engine-inverse-dynamics-derivatives"} <= passed(own)


@pytest.mark.parametrize("kind", [MjxFile, Mjx64File])
def test_dampers_of_a_file_are_in_forces_and_accelerations_and_nowhere_else(kind, tmp_path: Path):
    scene = from_urdf(arm(tmp_path / "arm.urdf", damping="3"))
    terms = "generalized-forces", "engine-acceleration", "engine-gravity", "engine-forward-dynamics"
    assert verdicts(kind, scene, terms) == dict.fromkeys(terms, "passed")


def test_a_tree_has_the_gravity_and_the_frames_that_it_is_given(tmp_path: Path):
    scene = tilted(tmp_path / "tilted.xml")
    own = own_findings(Mjx64Engine, scene)
    assert failed(own) == []
    assert passed(own) >= {
        "mass-matrix",
        "bias",
        "engine-gravity",
        "engine-inverse-dynamics",
        "engine-frame-placement",
    }
    assert any("hand" in x.subject for x in own)
