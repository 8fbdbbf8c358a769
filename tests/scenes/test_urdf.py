"""Robots from their files: against Pinocchio's own parser, and what is refused."""

from __future__ import annotations

import pickle
import time
from pathlib import Path

import numpy as np
import pytest
from tests.robots import arm, body, difference_from_pinocchio

import eomcheck
from eomcheck.claims.proof import prove
from eomcheck.claims.reproducer import reproducer_code
from eomcheck.claims.run import RunSelection, ValidationRun
from eomcheck.descriptions.urdf_reader import urdf_kind
from eomcheck.engines import PinocchioFile
from eomcheck.errors import InputError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.mechanics.records import State
from eomcheck.scene_lookup import robot_file_warnings, scene_classes_named, scene_named
from eomcheck.scenes import from_urdf

ROBOTS = Path(__file__).parent / "robots"
CASES = [("arm", False), ("arm", True), ("gripper", False), ("walker", True)]
every_robot = pytest.mark.parametrize(("name", "floating"), CASES)


def robot(name: str, floating: bool = False, **more):
    return from_urdf(ROBOTS / f"{name}.urdf", floating=floating, **more)


# ---- What is read --------------------------------------------------------------------------------


@every_robot
def test_a_robot_agrees_with_what_pinocchio_reads_to_1e_13(name: str, floating: bool):
    scene = robot(name, floating, gravity=(1.0, -2.0, -9.0))
    assert difference_from_pinocchio(scene, states=20) <= 1e-13


@pytest.mark.parametrize("turn", ["0 1.5708 0", "0 1.5708 1.5708", "0 -1.57 1.5708"])
def test_rounding_of_a_fixed_turn_is_no_error_where_a_joint_hangs_straight(tmp_path, turn: str):
    path = tmp_path / "turned.urdf"
    text = body("root") + body("link")
    text += '<joint name="j" type="continuous"><parent link="root"/><child link="link"/>'
    text += f'<origin rpy="{turn}"/><axis xyz="0 0 1"/></joint>'
    path.write_text(f"<robot>{text}</robot>", encoding="utf-8")
    scene, claims = from_urdf(path), ["true-error"]
    found = eomcheck.check_state(scene, [0.0], [0.0], consistent=False, claims=claims)
    assert {one.verdict for one in found} == {"passed"}, found


@pytest.mark.sampled(3)
@every_robot
def test_all_identities_of_a_robot_are_proved(name: str, floating: bool):
    findings = prove(robot(name, floating), points=1, seed=0)
    assert [str(f) for f in findings if f.verdict != "passed"] == []


@pytest.mark.night
@every_robot
def test_the_claims_hold_for_a_robot_with_pinocchio_on_trial(name: str, floating: bool):
    engines = ["casadi", PinocchioFile]
    findings = eomcheck.validate(robot(name, floating), examples=2, engines=engines)
    # Pinocchio's accelerations leave out the dampers that it reads.
    damped = getattr(robot(name, floating), "damping", None) is not None
    failed = {f.claim for f in findings if f.verdict == "failed"}
    assert failed == ({"engine-acceleration"} if damped else set())
    told = {f.claim for f in findings if "pinocchio_file" in f.subject and f.verdict == "passed"}
    assert {"mass-matrix", "bias", "generalized-forces"} <= told


def test_coordinates_are_the_joints_in_the_order_of_the_file():
    assert robot("arm").coordinate_names == ("wrist", "shoulder", "elbow", "reach")
    base = tuple(f"trunk_{part}" for part in ("x", "y", "z", "yaw", "pitch", "roll"))
    legs = "right_hip", "right_knee", "left_hip", "left_knee"
    assert robot("walker", True).coordinate_names == (*base, *legs)
    assert robot("gripper").coordinate_names == ("palm_turn", "left_slide")


def test_what_is_left_out_is_said():
    said = robot("arm").source.ignored
    for part in ("limits of joints (3)", "friction of joints (1)", "transmissions (1)", "Gazebo"):
        assert part in said
    assert said.startswith("Ignored: ")
    assert said.count(".") == 1


def test_a_damper_of_a_joint_with_several_coordinates_acts_on_all_its_velocities(tmp_path: Path):
    path, read = tmp_path / "damped.urdf", {}
    for kind in ("planar", "floating", "spherical", "fixed", "revolute"):
        for damping in ("0.5", "0"):
            text = body("root") + body("link") + body("tip")
            text += f'<joint name="j" type="{kind}"><parent link="root"/><child link="link"/>'
            text += f'<dynamics damping="{damping}" friction="0.1"/></joint>'
            text += (
                '<joint name="k" type="revolute"><parent link="link"/><child link="tip"/></joint>'
            )
            path.write_text(f"<robot>{text}</robot>", encoding="utf-8")
            read[kind, damping] = scene = from_urdf(path)
            friction = "" if kind == "fixed" else "Ignored: friction of joints (1)."
            assert scene.source.ignored == friction
            assert hasattr(scene, "damping") == (kind != "fixed" and damping == "0.5")
    for kind, n in (("planar", 3), ("floating", 6), ("spherical", 3)):
        v = np.append([0.3, -0.2, 0.5, 0.7, 0.1, -0.4][:n], 0.0)
        # Where all angles are 0, their rates are the angular velocity.
        states = (Evaluation(read[kind, x], np.zeros(n + 1), v) for x in ("0.5", "0"))
        damped, undamped = (state.terms.Q for state in states)
        assert v @ (damped - undamped) == pytest.approx(-0.5 * v @ v, rel=1e-14), kind


def test_moments_of_inertia_that_no_body_has_are_taken_and_said(tmp_path: Path):
    text = (ROBOTS / "arm.urdf").read_text("utf-8")
    for last, said in (("0.03", ""), ("0.0300001", "'lower'"), ("0.02", "")):
        file = tmp_path / "doubtful.urdf"
        moments = 'ixx="0.02" ixy="0" ixz="0" iyy="0.01" iyz="0" izz='
        assert text.count(moments) == 1
        file.write_text(text.replace(f'{moments}"0.02"', f'{moments}"{last}"'), "utf-8")
        scene = from_urdf(file)
        assert (said in scene.source.warnings) if said else scene.source.warnings == ""
        told = [*robot_file_warnings([type(scene)])]
        assert (told[-1] == f"{file}: {scene.source.warnings}") == bool(said)
        assert scene.mass.tolist() == robot("arm").mass.tolist()


DOUBTS = {
    "no mass": ('<mass value="1.5"/>', '<mass value="0"/>', "Inertia without mass: 'lower'."),
    "degrees": (
        '<origin xyz="0 0 -0.4"/><axis xyz="0 1 0"/>',
        '<origin xyz="0 0 -0.4" rpy="0 0 90"/><axis xyz="0 1 0"/>',
        "Angles of more than 2π rad, in degrees? 'elbow'.",
    ),
    "a turn": (
        '<origin xyz="0 0 -0.4"/><axis xyz="0 1 0"/>',
        '<origin xyz="0 0 -0.4" rpy="0 0 -6.28319"/><axis xyz="0 1 0"/>',
        "",
    ),
    "axis": (
        '<origin xyz="0 0 -0.4"/><axis xyz="0 1 0"/>',
        '<origin xyz="0 0 -0.4"/><axis xyz="0 1 1"/>',
        "Axes that are no unit vectors: 'elbow'.",
    ),
    "short axis": (
        '<origin xyz="0 0 -0.4"/><axis xyz="0 1 0"/>',
        '<origin xyz="0 0 -0.4"/><axis xyz="0 0.5 0"/>',
        "Axes that are no unit vectors: 'elbow'.",
    ),
    "printed axis": (
        '<origin xyz="0 0 -0.4"/><axis xyz="0 1 0"/>',
        '<origin xyz="0 0 -0.4"/><axis xyz="0 0.7071 -0.707"/>',
        "",
    ),
    "millimetres": (
        '<origin xyz="0 0 -0.2"/><mass value="1.5"/>',
        '<origin xyz="0 0 -200"/><mass value="1.5"/>',
        "Out of proportion with the size of the link: far center of mass of 'lower'.",
    ),
    "large inertia": (
        'ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.01"',
        'ixx="90" ixy="0" ixz="0" iyy="90" iyz="0" izz="90"',
        "Out of proportion with the size of the link: large inertia of 'lower'.",
    ),
    "small inertia": (
        'ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.01"',
        'ixx="2e-8" ixy="0" ixz="0" iyy="2e-8" iyz="0" izz="1e-8"',
        "Out of proportion with the size of the link: small inertia of 'lower'.",
    ),
    "none": ("elbow", "elbow", ""),
}
"""Text of a robot -> replaced by, doubts about it."""

LEG = """<robot name="leg"><link name="base"/><link name="upper"><inertial><origin xyz="0 0 -0.2"/>
<mass value="2"/><inertia ixx="0.03" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.01"/></inertial>
</link><link name="lower"><inertial><origin xyz="0 0 -0.2"/><mass value="1.5"/>
<inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.01"/></inertial>{shape}</link>
<joint name="hip" type="continuous"><parent link="base"/><child link="upper"/></joint>
<joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/>
<origin xyz="0 0 -0.4"/><axis xyz="0 1 0"/></joint></robot>"""

ROD = '<visual><origin xyz="0 0 -0.2"/><geometry><cylinder radius="0.02" length="0.4"/></geometry>'
MESH = '<visual><geometry><mesh filename="lower.stl"/></geometry>'


@pytest.mark.parametrize("what", DOUBTS)
@pytest.mark.parametrize("shape", [f"{ROD}</visual>", f"{MESH}</visual>", ""])
def test_numbers_that_look_like_a_mistake_are_taken_and_named(
    what: str, shape: str, tmp_path: Path
):
    old, new, doubt = DOUBTS[what]
    text = LEG.format(shape=shape)
    assert text.count(old) >= 1
    file = tmp_path / "leg.urdf"
    file.write_text(text.replace(old, new), "utf-8")
    assert from_urdf(file).source.warnings == doubt


def test_a_long_robot_does_not_hide_a_small_link_whose_shape_is_known(tmp_path: Path):
    ball = '<visual><geometry><sphere radius="0.01"/></geometry></visual>'
    said = {}
    for shape in (ball, f"{MESH}</visual>", ball.replace("radius", "broken")):
        file = tmp_path / "leg.urdf"
        file.write_text(LEG.format(shape=shape), "utf-8")
        said[shape] = from_urdf(file).source.warnings
    far, *others = said.values()
    assert "far center of mass of 'lower'; large inertia of 'lower'" in far
    assert others == ["", ""]


def test_parameters_are_those_of_the_file_until_they_are_changed():
    scene = robot("arm")
    assert scene.as_described
    assert scene.mass.tolist() == [2.5, 1.5, 0.7, 0.4]
    assert scene.damping.tolist() == [0.5, 0.02]
    assert PinocchioFile.represents(scene)
    other = scene.changed(gravity=None, mass=[1.0, 2.0, 3.0, 4.0])
    assert not other.as_described
    assert not PinocchioFile.represents(other)


def test_a_robot_is_printed_as_code_that_makes_it_again():
    for scene in (robot("walker", True), robot("walker", True).changed(gravity=None)):
        again = eval(repr(scene), {"from_urdf": from_urdf})
        assert repr(again) == repr(scene)
        assert pickle.loads(pickle.dumps(scene)).mass.tolist() == again.mass.tolist()
    weightless = robot("arm", gravity=None)
    assert repr(weightless).endswith("arm.urdf', gravity=None)")
    code = reproducer_code(scene, State(*scene.initial_state()))
    assert "from eomcheck.scenes import from_urdf" in code
    exec(code, {})


def test_a_file_is_a_kind_of_scene_wherever_a_name_is():
    (kind,) = scene_classes_named(str(ROBOTS / "arm.urdf"))
    assert kind is type(robot("arm"))
    assert kind.example().as_described
    assert kind.structure.fget(kind()) == "arm"


def test_random_robots_of_a_file_without_gravity_have_some_or_none():
    kind = urdf_kind(ROBOTS / "arm.urdf", gravity=None)
    run, claims = ValidationRun(), ["finite-terms", "generalized-forces"]
    run.validate_kind(kind, RunSelection.of(["gw"], [], claims, scenes=[kind]), (1, 1), 8, 0)
    assert {one.verdict for one in run.findings} == {"passed"}
    drawn = [one.scene.gravity for one in run.sampled[1:]]  # type: ignore[attr-defined]
    assert {None if x is None else x.shape for x in drawn} == {None, (3,)}


# ---- What is refused -----------------------------------------------------------------------------

LINK = '<link name="a"/>'
BODY = """<link name="b"><inertial><mass value="1"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>"""
JOINT = '<joint name="j" type="revolute"><parent link="a"/><child link="b"/></joint>'
SOUND = LINK + BODY + JOINT


def written(tmp_path: Path, text: str | bytes) -> Path:
    path = tmp_path / "robot.urdf"
    data = text if isinstance(text, bytes) else text.encode()
    path.write_bytes(data)
    return path


def test_the_file_that_the_others_are_made_of_is_read(tmp_path):
    scene = from_urdf(written(tmp_path, f"<robot>{SOUND}</robot>"))
    assert scene.coordinate_names == ("j",)
    assert scene.key == "robot"


SIX = ("j_x", "j_y", "j_z", "j_yaw", "j_pitch", "j_roll")


@pytest.mark.parametrize(
    ("kind", "names"),
    [("floating", SIX), ("planar", ("j_x", "j_y", "j_turn")), ("spherical", SIX[3:])],
)
def test_joints_with_more_coordinates_are_proved_and_keep_away_from_singular_angles(
    tmp_path, kind, names
):
    scene = from_urdf(written(tmp_path, f"<robot>{SOUND}</robot>".replace("revolute", kind)))
    assert scene.coordinate_names == names
    assert {f.verdict for f in prove(scene, points=1, seed=0)} == {"passed"}
    pitch = dict(zip(names, scene.coordinate_ranges(), strict=True)).get("j_pitch")
    assert pitch is None or pitch.high == -pitch.low == 1.2
    # Pinocchio's parser has no balls.
    assert PinocchioFile.represents(scene) == (kind != "spherical")


def test_a_prefix_without_a_namespace_is_read_as_others_read_it(tmp_path: Path):
    file = tmp_path / "leg.urdf"
    text = LEG.format(shape="<drake:proximity_properties/>")
    limit = '<limit drake:acceleration="2" effort="1"/>'
    file.write_text(
        text.replace('<link name="base"/>', f'<link name="base">{limit}</link>'), "utf-8"
    )
    scene = from_urdf(file)
    assert scene.n == 2
    assert scene.source.ignored == "Ignored: limits of joints (1), proximity_properties (1)."


def test_unknown_elements_and_namespaces_are_left_out_and_said(tmp_path):
    plain = from_urdf(written(tmp_path, f"<robot>{SOUND}</robot>"))
    more = SOUND.replace('<child link="b"/>', '<child link="b"/><controller_gains kp="1"/>')
    text = f'<robot xmlns="urn:u" xmlns:x="urn:x"><x:wheel/><wheel/>{more}</robot>'
    scene = from_urdf(written(tmp_path, text))
    assert scene.source.ignored == "Ignored: controller_gains (1), wheel (2)."
    assert repr(scene.float64_parameters) == repr(plain.float64_parameters)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('value="1"', 'value="-1"', r"link 'b': mass = -1 kg, expected a number that is not neg"),
        ('value="1"', 'value="nan"', "link 'b': value of <mass> is 'nan', expected a finite"),
        ('value="1"', 'value="inf"', "expected a finite number"),
        ('value="1"', 'value="1e999"', "expected a finite number"),
        ('value="1"', 'value="1_0"', "is '1_0', expected a number"),
        ('value="1"', "", "link 'b': <mass> has no attribute 'value'"),
        ('<mass value="1"/>', "", "link 'b': <inertial> has no <mass>"),
        ('iyz="0"', "", "<inertia> has no attribute 'iyz'"),
        ('izz="1"', 'izz="-1"', "principal moment of inertia -1 kg m², expected none below 0"),
        ("revolute", "hinge", "joint 'j' has the type 'hinge', expected one of: revolute"),
        (' type="revolute"', "", "<joint> has no attribute 'type'"),
        ('<link name="a"/>', "<link/>", "<link> has no attribute 'name'"),
        ('<parent link="a"/>', "", "joint 'j' has no <parent>"),
        ('<parent link="a"/>', '<parent link="x"/>', "joint 'j' has the parent 'x', no such link"),
        ('<child link="b"/>', '<child link="x"/>', "joint 'j' has the child 'x', no such link"),
        ('<child link="b"/>', '<child link="b"/><axis xyz="0 0 0"/>', "the axis .0, 0, 0."),
        ('<child link="b"/>', '<child link="b"/><axis xyz="0 0"/>', "expected three numbers"),
        ('<child link="b"/>', '<child link="b"/><mimic joint="x"/>', "follows 'x', no such joint"),
        ('<child link="b"/>', '<child link="b"/><mimic joint="j"/>', "follows itself"),
        ('<child link="b"/>', '<child link="b"/><axes/>', "joint 'j' holds <axes>, which is no"),
        ("<mass", "<masses/><mass", "<inertial> holds <masses>, which is no part"),
        ('<child link="b"/>', '<child link="b"/><dynamics damping="-1"/>', "damping = -1, expect"),
        ("<robot>", "<robot><loop/>", "holds <loop>, which is no part of a URDF"),
        ("<robot>", '<robot><link name="c"/>', "2 links are no joint's child .'c', 'a'., expected"),
        ("<robot>", '<robot><link name="a"/>', "two links have the name 'a'"),
        ("revolute", "fixed", "no joint of it moves"),
        ("<mass", "<mass value='2'/><mass", "has 2 of <mass>, expected one"),
        ("<robot>", '<!DOCTYPE robot [<!ENTITY x "y">]><robot>', "declares a document type"),
        ("<robot>", "<sdf>", "is no XML"),
        ("<robot>", "<robot x='${pi}'>", "template for xacro"),
        ("ixx=\"1\" ixy=\"0\" ixz=\"0\" iyy=\"1\" iyz=\"0\" izz=\"1\"",
         "ixx=\"0\" ixy=\"0\" ixz=\"0\" iyy=\"0\" iyz=\"0\" izz=\"0\"",
         "joint 'j' moves nothing that has inertia"),
    ],
)  # fmt: skip
def test_what_a_file_must_not_say_is_refused_in_one_sentence(tmp_path, old, new, said):
    text = f"<robot>{SOUND}</robot>"
    assert old in text
    path = written(tmp_path, text.replace(old, new, 1))
    with pytest.raises(InputError, match=said) as refused:
        from_urdf(path)
    assert "\n" not in str(refused.value)
    assert "robot.urdf" in str(refused.value)


RING = "".join(
    f'<link name="l{i}"/><joint name="j{i}" type="fixed"><parent link="l{i}"/>'
    f'<child link="l{(i + 1) % 3}"/></joint>'
    for i in range(3)
)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is empty"),
        ("  \n", "is empty"),
        (b"\xff\xfe\x00", "is no XML"),
        ("<sdf/>", "holds <sdf>, expected <robot>"),
        ("<robot/>", "has no link"),
        (f"<robot>{LINK}</robot>", "has no joint"),
        (f"<robot>{RING}</robot>", "every link is a joint's child: 'l0' <- "),
        (f"<robot>{SOUND}{RING}</robot>", "links go round in a circle"),
        (
            f'<robot>{SOUND}<joint name="k" type="fixed"><parent link="a"/><child link="b"/>'
            "</joint></robot>",
            "link 'b' is the child of two joints, 'j' and 'k'",
        ),
    ],
)
def test_a_file_that_is_no_tree_is_refused(tmp_path, text, said):
    with pytest.raises(InputError, match=said):
        from_urdf(written(tmp_path, text))


def test_a_file_that_cannot_be_read_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"cannot be read: No such file"):
        from_urdf(tmp_path / "none.urdf")
    with pytest.raises(InputError, match=r"is not a regular file"):
        from_urdf(tmp_path)
    with pytest.raises(InputError, match=r"path = 3, expected the path"):
        from_urdf(3)
    with pytest.raises(InputError, match=r"gravity"):
        robot("arm", gravity=(0.0, 1.0))


def test_a_root_without_inertia_cannot_be_free():
    with pytest.raises(InputError, match="mass matrix is singular: joint 'palm_turn' can move"):
        robot("gripper", True)


def chain_of(count: int, kind: str) -> str:
    joint = '<joint name="j{0}" type="{2}"><parent link="l{0}"/><child link="l{1}"/></joint>'
    links = "".join(BODY.replace('"b"', f'"l{i}"') for i in range(count + 1))
    return links + "".join(joint.format(i, i + 1, kind) for i in range(count))


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("text", "said"),
    [
        (chain_of(10_000, "revolute"), "10001 links, expected at most 5000"),
        (chain_of(300, "revolute"), "300 coordinates, expected at most 200"),
        ("<a>" * 100_000, "more than 60 inside"),
        ("<a/>" * 300_000, "more than 200000 elements"),
        (" " * 30_000_000, "more than 20 million bytes"),
    ],
)
def test_what_is_too_large_is_refused_at_once(tmp_path, text, said):
    start = time.process_time()
    with pytest.raises(InputError, match=said):
        from_urdf(written(tmp_path, f"<robot>{text}</robot>"))
    assert time.process_time() - start < 5.0


def test_many_fixed_links_are_one_body(tmp_path):
    text = chain_of(1000, "fixed").replace('type="fixed"', 'type="revolute"', 1)
    scene = from_urdf(written(tmp_path, f"<robot>{text}</robot>"))
    assert scene.n == 1
    assert scene.mass.tolist() == [1000.0]


def test_a_free_root_is_asked_for_behind_a_colon_wherever_a_scene_is_named(tmp_path: Path):
    file = tmp_path / "arm.urdf"
    arm(file).write_text(file.read_text().replace('<link name="base"/>', body("base")))
    scene = scene_named(f"{file}:floating")
    assert repr(scene) == repr(from_urdf(file, floating=True))
    assert scene.coordinate_names[:3] == ("base_x", "base_y", "base_z")
    assert (
        scene.name != scene_named(str(file)).name
    )  # what is kept by name is not that of the other
    with pytest.raises(InputError, match=r"only the root of a robot in a \.urdf or \.sdf can be"):
        scene_named("snake:floating")
    with pytest.raises(InputError, match=r"expected .*arm.urdf or .*arm.urdf:floating"):
        scene_named(f"{file}:fixed")


def test_the_ground_need_not_be_a_link_of_the_file(tmp_path: Path):
    file = tmp_path / "leg.urdf"
    file.write_text(LEG.format(shape=""), "utf-8")
    whole = from_urdf(file)
    text = LEG.format(shape="").replace('<link name="base"/>', "").replace('"base"', '"world"')
    file.write_text(text, "utf-8")
    assert [*map(repr, from_urdf(file).mass)] == [*map(repr, whole.mass)]
    file.write_text(text.replace('"world"', '"ground"'), "utf-8")
    with pytest.raises(InputError, match="has the parent 'ground', no such link"):
        from_urdf(file)


def test_a_link_without_joints_is_a_robot_where_it_is_free(tmp_path: Path):
    path = tmp_path / "one.urdf"
    path.write_text(f"<robot>{body('a')}</robot>", encoding="utf-8")
    with pytest.raises(InputError, match=r"has no joint; '.*one.urdf:floating' sets its link free"):
        from_urdf(path)
    scene = from_urdf(path, floating=True)
    assert scene.n == 6
    claims = ["mass-matrix", "kinetic-energy"]
    found = eomcheck.validate(scene, examples=1, formulations=["gw"], claims=claims)
    assert "failed" not in {one.verdict for one in found}
    assert "pinocchio_file" in {one.subject for one in found}
