"""JaxSim, where it is installed: right as a tree, in both precisions, but for an energy's sign."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.engines.own_findings import failed, own_findings, passed
from tests.robots import arm, body

from eomcheck.engines.jaxsim import Jaxsim64Engine, JaxsimEngine
from eomcheck.scenes import ChainPendulum, from_urdf

pytest.importorskip("jaxsim")

OFFERED = {
    "mass-matrix",
    "bias",
    *("engine-inverse-dynamics", "engine-forward-dynamics", "engine-gravity"),
    *("engine-coriolis-matrix", "engine-kinetic-energy", "engine-potential-energy"),
    *("engine-center-of-mass", "engine-center-of-mass-velocity"),
    *("engine-momentum", "engine-momentum-matrix"),
    *("engine-frame-placement", "engine-frame-velocity"),
    *("engine-frame-jacobian", "engine-frame-bias"),
}
DERIVATIVES = {"engine-inverse-dynamics-derivatives", "engine-forward-dynamics-derivatives"}
WRONG = {"engine-potential-energy"}
"""docs/conformance/jaxsim_potential_energy.py"""


@pytest.mark.night
@pytest.mark.parametrize("kind", [JaxsimEngine, Jaxsim64Engine])
def test_every_quantity_that_it_offers_is_right_but_potential_energy(kind):
    own = own_findings(kind, ChainPendulum.example())
    assert {x.claim for x in own if x.verdict == "failed"} == WRONG
    assert passed(own) >= (OFFERED | DERIVATIVES) - WRONG


@pytest.mark.night
def test_slides_and_links_without_mass_in_space_are_right(tmp_path: Path):
    path = arm(tmp_path / "arm.urdf")
    text = path.read_text(encoding="utf-8").replace('<link name="base"/>', body("base"))
    path.write_text(text, encoding="utf-8")
    scene = from_urdf(path, floating=True, gravity=(1.0, -2.0, -9.0))
    own = own_findings(Jaxsim64Engine, scene, OFFERED - WRONG)
    assert failed(own) == []
    assert passed(own) == OFFERED - WRONG


def test_the_bias_and_a_motion_of_a_tree_are_right():
    claims = "mass-matrix", "bias", "engine-frame-velocity"
    own = own_findings(Jaxsim64Engine, ChainPendulum.example(), claims)
    assert {x.verdict for x in own} == {"passed"} and passed(own) == {*claims}
