"""Robots as the words that are read of their files, every number of them by hand."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from eomcheck.descriptions.elements import Joint, Link
from eomcheck.descriptions.mjcf_reader import read_mjcf
from eomcheck.descriptions.urdf_reader import identifier, ignored_summary, read_urdf
from eomcheck.errors import InputError
from eomcheck.scene_lookup import is_robot, robot_named

# ---- Names ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "robot"),
    [
        *((name, True) for name in ("arm.urdf", "a/ARM.URDF", "arm.xml", "arm.Mjcf")),
        *((name, True) for name in ("arm.urdf:floating", "ARM.URDF:floating", "c:/arm.xml")),
        *((name, True) for name in ("arm.urdf:", "arm.xml:free")),
        *(
            (name, False)
            for name in ("snake", "snake:floating", "arm.urdf.txt", "arm.txt:arm.urdf2")
        ),
    ],
)
def test_a_robot_is_known_by_the_end_of_its_files_name(name: str, robot: bool):
    assert is_robot(name) is robot


@pytest.mark.parametrize(
    ("name", "called"),
    [
        ("arm", "arm"),
        ("two-link arm", "two_link_arm"),
        ("2dof", "robot_2dof"),
        ("-arm-", "arm"),
        ("", "robot"),
        ("?!", "robot"),
    ],
)
def test_a_robot_is_called_in_python_by_a_name_that_python_has(name: str, called: str):
    assert identifier(name) == called


def test_what_is_left_out_is_counted_by_kind_and_what_is_not_there_is_no_kind():
    counts = Counter({"visual": 3, "limit": 2, "friction": 0, "odd": 1})
    said = "Ignored: limits of joints (2), odd (1), shapes to be seen (3)."
    assert ignored_summary(counts) == said
    assert ignored_summary(Counter({"limit": 0})) == ""


# ---- URDF ----------------------------------------------------------------------------------------

TOLD = """
<robot NAME><link name="base"><visual/><visual/><collision/></link>
<link name="l1"><inertial><origin xyz="0.1 -0.2 0.3"/><mass value="2.5"/>
  <inertia ixx="0.4" iyy="0.5" izz="0.6" ixy="0.01" ixz="0.02" iyz="0.03"/></inertial></link>
<link name="l2"><visual/></link><link name="l3"/><link name="l4"/><link name="l5"/>
<joint name="turn" type="continuous"><parent link="base"/><child link="l1"/>
  <origin xyz="1 2 3"/><dynamics damping="0.25" friction="0.5"/></joint>
<joint name="slide" type="prismatic"><parent link="l1"/><child link="l2"/>
  <axis xyz="0 -2 0"/><limit/><dynamics damping="0" friction="0"/></joint>
<joint name="geared" type="revolute"><parent link="l2"/><child link="l3"/><limit/><axis/>
  <mimic joint="turn" multiplier="-2" offset="0.5"/></joint>
<joint name="alike" type="revolute"><parent link="l3"/><child link="l4"/><mimic joint="slide"/>
  <dynamics friction="0.1"/></joint>
<joint name="still" type="fixed"><parent link="l4"/><child link="l5"/><mimic joint="turn"/>
  <dynamics damping="3" friction="3"/><origin rpy="0 0 3.141592653589793"/></joint>
<gazebo/><gazebo/><transmission/></robot>
"""


def test_every_number_of_a_urdf_is_where_it_belongs(tmp_path: Path):
    path = tmp_path / "my-arm.urdf"
    path.write_text(TOLD.replace("NAME", 'name="7 up"'), encoding="utf-8")
    found = read_urdf(path)
    assert found.name == "robot_7_up"
    body = Link("l1", 2.5, (0.1, -0.2, 0.3), (0.4, 0.5, 0.6), (0.01, 0.02, 0.03))
    assert found.links == (Link("base"), body, *(Link(f"l{i}") for i in range(2, 6)))
    x = (1.0, 0.0, 0.0)
    still = found.joints[-1]
    assert found.joints == (
        Joint("turn", "revolute", "base", "l1", (1.0, 2.0, 3.0), axis=x, damping=0.25),
        Joint("slide", "prismatic", "l1", "l2", axis=(0.0, -2.0, 0.0)),
        Joint("geared", "revolute", "l2", "l3", axis=x, mimics=("turn", -2.0, 0.5)),
        Joint("alike", "revolute", "l3", "l4", axis=x, mimics=("slide", 1.0, 0.0)),
        Joint("still", "fixed", "l4", "l5", orientation=still.orientation, axis=x),
    )
    assert still.orientation == pytest.approx((0.0, 0.0, 0.0, 1.0), abs=1e-15)
    assert found.ignored == (
        "Ignored: shapes to collide (1), friction of joints (2), settings of Gazebo (2), "
        "limits of joints (2), transmissions (1), shapes to be seen (3)."
    )
    path.write_text(TOLD.replace("NAME", ""), encoding="utf-8")
    assert read_urdf(path).name == "my_arm"


def test_a_robot_that_is_named_is_free_if_its_name_says_so(tmp_path: Path):
    path = tmp_path / "ARM.URDF"
    text = TOLD.replace("NAME", "").replace('<link name="base">', '<link name="base">' + INERTIA)
    text = text.replace('<link name="l4"/>', f'<link name="l4">{INERTIA}</link>')
    path.write_text(text, encoding="utf-8")
    assert len(robot_named(str(path)).plan.topology.coordinates) == 2
    free = robot_named(f"{path}:floating")
    assert len(free.plan.topology.coordinates) == 8 and free.source.floating == "base"
    with pytest.raises(InputError, match=r"expected .*ARM.URDF or .*ARM.URDF:floating"):
        robot_named(f"{path}:")


INERTIA = """<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
</inertial>"""

# ---- MJCF ----------------------------------------------------------------------------------------

BODIES = """
<mujoco><compiler angle="radian" autolimits="true"/><option gravity="0 0 0"/><worldbody>
  <body name="body2" gravcomp="0.5"><joint name="lift" type="slide" axis="0 0 2" frictionloss="1"
    range="0 1" damping="0.3" armature="0.2"/>
    <inertial pos="0 0 0" mass="2" diaginertia="0.2 0.3 0.4"/>
    <body pos="1 2 3"><joint axis="0 1 0" stiffness="4" springref="0.7" frictionloss="2"/>
      <inertial pos="0.1 0.2 0.3" mass="3" fullinertia="0.4 0.5 0.6 0.01 0.02 0.03"/></body>
    <body pos="3 2 1" gravcomp="1"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
  </body></worldbody>
  <keyframe><key name="a"/><key name="b"/><key name="c"/></keyframe></mujoco>
"""


def test_every_number_of_an_mjcf_is_where_it_belongs(tmp_path: Path):
    pytest.importorskip("mujoco")
    path = tmp_path / "2-bodies.xml"
    path.write_text(BODIES, encoding="utf-8")
    found = read_mjcf(path)
    assert (found.name, found.gravity, found.pose) == ("robot_2_bodies", None, {})
    assert [one.name for one in found.links] == ["world", "body2", "body2_", "body3"]
    assert found.joints == (
        Joint("lift", "prismatic", "world", "body2", axis=(0.0, 0.0, 1.0), damping=0.3,
              armature=0.2),
        Joint("joint1", "revolute", "body2", "body2_", (1.0, 2.0, 3.0), axis=(0.0, 1.0, 0.0),
              stiffness=4.0, rest_position=0.7),
        Joint("body3 fixed", "fixed", "body2", "body3", (3.0, 2.0, 1.0)),
    )  # fmt: skip
    one = found.links[2]
    assert (one.mass, one.center) == (3.0, (0.1, 0.2, 0.3))
    np.testing.assert_allclose(one.moments, (0.4, 0.5, 0.6), rtol=1e-12)
    np.testing.assert_allclose(one.products, (0.01, 0.02, 0.03), rtol=1e-11)
    assert found.ignored == (
        "Ignored: compensation of gravity (2), friction of joints (2), keyframes (3), "
        "limits of joints (1)."
    )


FREE = """
<mujoco><compiler angle="radian"/><worldbody><body name="b" pos="1 2 3" euler="TURN">
  <joint name="f" type="KIND" MORE/><geom size="0.1"/></body>
  <body><joint name="h"/><geom size="0.1"/></body></worldbody>EQUAL</mujoco>
"""


def free(path: Path, turn="0 0 0", kind="free", more="", equal="") -> Path:
    given = {"TURN": turn, "KIND": kind, "MORE": more, "EQUAL": equal}
    text = FREE
    for old, new in given.items():
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("turn", "kept"),
    [("1.5 0 0", True), ("0 1.1 0", True), ("0 0 1.5", True), ("0 1.3 0", False)],
)
def test_a_free_body_starts_turned_unless_its_angles_are_nearly_singular(tmp_path, turn, kept):
    pytest.importorskip("mujoco")
    pose = read_mjcf(free(tmp_path / "free.xml", turn)).pose
    assert [pose[f"f_{axis}"] for axis in "xyz"] == [1.0, 2.0, 3.0]
    angles = [float(x) for x in turn.split()] if kept else [0.0] * 3
    found = [pose.get(f"f_{name}", 0.0) for name in ("roll", "pitch", "yaw")]
    assert found == pytest.approx(angles, abs=1e-12)
    assert read_mjcf(free(tmp_path / "ball.xml", turn, "ball")).pose == {}


@pytest.mark.parametrize("kind", ["free", "ball"])
def test_the_spring_of_a_free_or_ball_joint_rests_where_the_file_draws_it(tmp_path: Path, kind):
    pytest.importorskip("mujoco")
    path = free(tmp_path / "m.xml", "0.6 0 0", kind, 'stiffness="1" armature="1"')
    joint = read_mjcf(path).joints[0]
    assert joint.stiffness == 1.0
    place, turn = (1.0, 2.0, 3.0), (np.cos(0.3), np.sin(0.3), 0.0, 0.0)
    if kind == "ball":
        place, turn = 0.0, (1.0, 0.0, 0.0, 0.0)
    assert joint.rest_position == place
    assert joint.rest_orientation == pytest.approx(turn)
    path.write_text(path.read_text().replace("<worldbody>", f"{NO_SPRINGS}<worldbody>", 1))
    assert read_mjcf(path).joints[0].stiffness is None


NO_SPRINGS = '<option><flag spring="disable"/></option>'


@pytest.mark.parametrize("kind", ["free", "ball"])
def test_a_joint_with_several_coordinates_has_one_armature(tmp_path: Path, kind: str):
    pytest.importorskip("mujoco")
    robot = read_mjcf(free(tmp_path / "m.xml", kind=kind, more='armature="0.5"'))
    assert [joint.armature for joint in robot.joints] == [0.5, None]


@pytest.mark.parametrize("kind", ["free", "ball"])
@pytest.mark.parametrize("flag", ["", '<flag damper="disable"/>'])
def test_a_joint_with_several_coordinates_has_one_damper(tmp_path: Path, kind: str, flag: str):
    pytest.importorskip("mujoco")
    path = free(tmp_path / "m.xml", kind=kind, more='damping="0.5"')
    option = f"<option>{flag}</option><worldbody>"
    path.write_text(path.read_text().replace("<worldbody>", option))
    joint, *_ = read_mjcf(path).joints
    assert joint.damping == (None if flag else 0.5)


def test_springs_are_off_where_the_file_says_so_and_dampers_stay(tmp_path: Path):
    pytest.importorskip("mujoco")
    path = tmp_path / "off.xml"
    flag = '<option><flag spring="disable"/></option><worldbody>'
    path.write_text(BODIES.replace("<worldbody>", flag), encoding="utf-8")
    lift, turn, _ = read_mjcf(path).joints
    assert (lift.damping, turn.stiffness, turn.rest_position) == (0.3, None, 0.0)


LAST = '<include file="p99.xml"/>'


def test_as_many_files_are_included_as_may_be_and_no_more(tmp_path: Path):
    pytest.importorskip("mujoco")
    for i in range(100):
        (tmp_path / f"p{i}.xml").write_text("<mujocoinclude><option/></mujocoinclude>")
    include = "".join(f'<include file="p{i}.xml"/>' for i in range(100))
    body = '<worldbody><body><joint/><geom size="0.1"/></body></worldbody>'
    path = tmp_path / "all.xml"
    path.write_text(f"<mujoco>{include}{body}</mujoco>")
    with pytest.raises(InputError, match="includes more than 100 files"):
        read_mjcf(path)
    path.write_text(f"<mujoco>{include.replace(LAST, '')}{body}</mujoco>")
    assert len(read_mjcf(path).joints) == 1
