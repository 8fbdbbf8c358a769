"""Brax, where it is installed: right on hinges, in both precisions; its MJCFs in its own order."""

from __future__ import annotations

import pytest
from tests.engines.own_findings import failed, own_findings, passed, verdicts
from tests.robots import hinges

from eomcheck.descriptions import mjcf_reader
from eomcheck.engines.brax import Brax64Engine, Brax64File, Brax64Mjcf, BraxEngine
from eomcheck.scenes import ChainPendulum, from_urdf

pytest.importorskip("brax")

CLAIMS = "mass-matrix", "bias", "engine-gravity", "engine-center-of-mass"
FRAMES = "engine-frame-placement", "engine-frame-velocity", "engine-frame-jacobian"


@pytest.mark.night
@pytest.mark.parametrize("kind", [BraxEngine, Brax64Engine])
def test_every_quantity_that_it_offers_is_right(kind):
    own = own_findings(kind, ChainPendulum.example())
    assert failed(own) == []
    assert {*CLAIMS, *FRAMES, "engine-forward-dynamics-derivatives"} <= passed(own)


FUSED = """<mujoco><option gravity="1 2 -9"/><worldbody>
  <body name="trunk" pos="0.1 0.2 0.3" euler="20 30 40"><freejoint/>
    <geom type="box" size="0.1 0.2 0.3" mass="3" pos="0.1 0 0"/>
    <body name="mount" pos="0.5 0 0">
      <body name="behind" pos="0 0.25 0"><joint axis="0.6 0 0.8"/>
        <geom type="box" size="0.1 0.2 0.1" mass="1" pos="0 0.125 0"/></body></body>
    <body name="arm" pos="0 0 0.5"><joint axis="0 1 0"/>
      <geom type="box" size="0.1 0.1 0.2" mass="2" pos="0 0 0.25"/></body>
  </body></worldbody></mujoco>"""


def test_a_free_base_and_joints_that_brax_moves_to_the_end_are_mapped(tmp_path):
    path = tmp_path / "fused.xml"
    path.write_text(FUSED, encoding="utf-8")
    scene = mjcf_reader.from_mjcf(path)
    claims = (*CLAIMS, *FRAMES[::2], "engine-acceleration")
    own = own_findings(Brax64Mjcf, scene, claims)
    assert failed(own) == []
    # Brax merges the mount into its parent.
    left_out = {str(x).partition(": ")[2] for x in own if x.verdict == "skipped"}
    assert left_out == {"its model has no frame of link world, mount"}
    assert {*CLAIMS, *FRAMES[::2], "engine-acceleration"} <= passed(own)


def test_dampers_of_a_file_are_in_forces_and_accelerations_and_nowhere_else(tmp_path):
    scene = from_urdf(hinges(tmp_path / "arm.urdf", damping="3"))
    terms = "generalized-forces", "engine-acceleration", "engine-gravity", "engine-forward-dynamics"
    assert verdicts(Brax64File, scene, terms) == dict.fromkeys(terms, "passed")


SLIDE = """<mujoco><worldbody><body><joint axis="0 0 1"/><geom size="0.1" mass="1"/>
  <body pos="0.2 0 0"><joint type="slide" axis="1 0 0"/><geom size="0.1" mass="2" pos="0 0.3 0"/>
  </body></body></worldbody></mujoco>"""


def test_a_slide_on_a_link_that_turns_is_known_to_be_wrong(tmp_path):
    path = tmp_path / "slide.xml"
    path.write_text(SLIDE, encoding="utf-8")
    own = own_findings(Brax64Mjcf, mjcf_reader.from_mjcf(path), ["mass-matrix"])
    assert len(failed(own)) == 1  # docs/conformance/brax_slide_on_turning_link.py
