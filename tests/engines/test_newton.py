"""Newton, where it is installed: what its adapter maps, and where its own reading differs."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.engines.own_findings import failed, own_findings, passed, verdicts
from tests.robots import arm, tilted

from eomcheck.engines.newton import NewtonEngine, NewtonFile, NewtonMjcf
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import ChainPendulum, from_mjcf, from_urdf

pytest.importorskip("newton")

TERMS = "mass-matrix", "bias", "generalized-forces", "engine-acceleration"
BODY = """<joint name="{0}" type="{1}" axis="{2}" {3}/>"""


def mjcf(folder: Path, joints: str, head: str = "") -> Scene:
    """Return a robot of one body with these joints, and a pole on it."""
    path = folder / "robot.xml"
    path.write_text(
        f"""<mujoco>{head}<worldbody><body name="cart" pos="0.1 0.2 0.3">{joints}
        <geom type="box" size=".1 .2 .3" mass="2" pos=".05 0 .1"/>
        <body name="pole" pos="0 .1 .4"><joint name="swing" axis="0 1 0"/>
        <geom type="box" size=".02 .03 .5" mass="1" pos="0 0 .4"/></body></body>
        </worldbody></mujoco>""",
        encoding="utf-8",
    )
    return from_mjcf(path)


def test_dampers_of_a_file_are_in_forces_and_accelerations(tmp_path: Path):
    scene = from_urdf(arm(tmp_path / "arm.urdf", damping="3"))
    assert verdicts(NewtonFile, scene, TERMS) == dict.fromkeys(TERMS, "passed")


def test_a_joint_that_follows_another_is_eliminated(tmp_path: Path):
    mimic = '<mimic joint="wrist" multiplier="-0.5" offset="0.3"/>'
    text = arm(tmp_path / "arm.urdf").read_text(encoding="utf-8")
    (tmp_path / "arm.urdf").write_text(
        text.replace('<axis xyz="0 0 1"/>', f'<axis xyz="0 0 1"/>{mimic}'), encoding="utf-8"
    )
    scene = from_urdf(tmp_path / "arm.urdf")
    assert scene.n == 2
    assert verdicts(NewtonFile, scene, TERMS) == dict.fromkeys(TERMS, "passed")


def test_coordinates_of_an_mjcf_are_measured_from_its_references(tmp_path: Path):
    slide = BODY.format("x", "slide", "1 0 0", 'ref="0.4"')
    scene = mjcf(tmp_path, slide + BODY.format("turn", "hinge", "0 1 0", 'ref="30"'))
    found = verdicts(NewtonMjcf, scene, (*TERMS, "engine-frame-placement"))
    assert set(found.values()) == {"passed"}


def test_frames_of_an_mjcf_are_those_of_bodies_wherever_their_joints_are(tmp_path: Path):
    scene = mjcf(tmp_path, BODY.format("turn", "hinge", "0 1 0", 'pos="0.1 0 -0.2"'))
    frames = "engine-frame-placement", "engine-frame-velocity", "engine-frame-jacobian"
    assert verdicts(NewtonMjcf, scene, frames) == dict.fromkeys(frames, "passed")


def test_slides_of_a_body_come_before_its_turns(tmp_path: Path):
    """About axes on which that makes no difference: the file has the turn first."""
    turn = BODY.format("turn", "hinge", "0 0 1", "")
    scene = mjcf(tmp_path, turn + BODY.format("z", "slide", "0 0 1", ""))
    assert verdicts(NewtonMjcf, scene, TERMS) == dict.fromkeys(TERMS, "passed")


def test_joints_of_one_body_at_different_points_differ(tmp_path: Path):
    slide = BODY.format("x", "slide", "1 0 0", 'pos="0 0 -1"')
    scene = mjcf(tmp_path, slide + BODY.format("turn", "hinge", "0 1 0", ""))
    assert verdicts(NewtonMjcf, scene, ["mass-matrix"]) == {"mass-matrix": "failed"}


def test_a_tree_has_the_moments_of_inertia_that_it_is_given():
    """Points of 1 g, whose moments Newton would replace by 1e-6 kg m²."""
    scene = ChainPendulum([1e-3, 1e-3], [0.1, 0.1], [1e-11] * 2)
    found = verdicts(NewtonEngine, scene, ["mass-matrix", "bias"])
    assert found == {"mass-matrix": "passed", "bias": "passed"}


def test_a_tree_has_the_gravity_and_the_rotors_that_it_is_given(tmp_path: Path):
    scene = tilted(tmp_path / "tilted.xml", rotors=True)
    own = own_findings(NewtonEngine, scene)
    assert failed(own) == []
    assert passed(own) >= {"mass-matrix", "bias", "engine-gravity", "engine-inverse-dynamics"}
    assert any("hand" in x.subject for x in own)
