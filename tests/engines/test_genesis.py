"""Genesis, where it is installed: what it computes of a tree and of a URDF, dampers too."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.engines.own_findings import failed, own_findings, passed
from tests.robots import arm

from eomcheck.engines.genesis import GenesisEngine, GenesisFile
from eomcheck.scenes import from_urdf

pytest.importorskip("genesis")

OFFERED = {
    "mass-matrix",
    "bias",
    *("engine-gravity", "engine-forward-dynamics"),
    *("engine-kinetic-energy", "engine-potential-energy"),
    *("engine-frame-placement", "engine-frame-velocity", "engine-frame-jacobian"),
}


@pytest.mark.night
@pytest.mark.parametrize("kind", [GenesisEngine, GenesisFile])
def test_every_quantity_that_it_offers_is_right(kind, tmp_path: Path):
    scene = from_urdf(arm(tmp_path / "arm.urdf", damping="3"), gravity=(1.0, -2.0, -9.0))
    of_files = {"generalized-forces", "engine-acceleration"} if kind.reads_file else set()
    own = own_findings(kind, scene, OFFERED | of_files)
    assert failed(own) == []
    assert passed(own) == OFFERED | of_files
