"""What robots' files hold, and what is refused of them, at every limit and in every word."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from eomcheck.descriptions import mjcf_reader, urdf_reader
from eomcheck.descriptions.elements import Joint, Link, coupling, drive, pin, weld
from eomcheck.descriptions.mjcf_reader import EqualityContext, equality_constraint, read_mjcf
from eomcheck.descriptions.urdf_reader import (
    URDF,
    Unreadable,
    finite_number,
    ignored_tags,
    number_attribute,
    root_of,
    single_child,
    text_attribute,
    triple_attribute,
)
from eomcheck.errors import InputError
from eomcheck.scene_lookup import robot_named
from eomcheck.scenes import from_mjcf, from_urdf

# ---- XML -----------------------------------------------------------------------------------------


def element(source: str) -> ElementTree.Element:
    return ElementTree.fromstring(source)


def refusal(call: Any, *arguments: Any) -> str:
    """Return the sentence in which a call is refused."""
    with pytest.raises(Unreadable) as refused:
        call(*arguments)
    return str(refused.value)


def test_attributes_are_numbers_and_texts_or_refused_in_these_words():
    one = element('<mass value=" 2.5 " empty=" " odd="x" many="1 2" far="-inf" pair="1_0"/>')
    assert (text_attribute(one, "value", "w"), number_attribute(one, "value", "w")) == ("2.5", 2.5)
    assert (number_attribute(one, "none", "w", 0.0), number_attribute(one, "value", "w", 7.0)) == (
        0.0,
        2.5,
    )
    for name in ("empty", "none"):
        assert refusal(text_attribute, one, name, "w") == f"w: <mass> has no attribute {name!r}"
        assert refusal(number_attribute, one, name, "w") == f"w: <mass> has no attribute {name!r}"
    said = "w: odd of <mass> is 'x', expected a number"
    assert (
        refusal(number_attribute, one, "odd", "w")
        == refusal(number_attribute, one, "odd", "w", 1.0)
        == said
    )
    assert (
        refusal(number_attribute, one, "pair", "w")
        == "w: pair of <mass> is '1_0', expected a number"
    )
    far = "w: far of <mass> is '-inf', expected a finite number"
    assert refusal(number_attribute, one, "far", "w") == far
    assert finite_number("-1e-3", "w") == -0.001
    assert triple_attribute(element('<a xyz=" 1 -2\n3e1 "/>'), "xyz", "w", (0.0, 0.0, 0.0)) == (
        1,
        -2,
        30,
    )
    assert triple_attribute(one, "none", "w", (4.0, 5.0, 6.0)) == (4, 5, 6)
    many = "w: many of <mass> is '1 2', expected three numbers"
    assert refusal(triple_attribute, one, "many", "w", (0, 0, 0)) == many


def test_children_are_one_or_none_and_known():
    parent = element("<link><a/><b/><a/></link>")
    assert single_child(parent, "c", "w") is None
    found = single_child(parent, "b", "w")
    assert found is not None and found.tag == "b"
    assert refusal(single_child, parent, "a", "w") == "w has 2 of <a>, expected one"
    assert list(ignored_tags(parent, frozenset("abc"), "w")) == ["a", "b", "a"]
    assert list(ignored_tags(parent, frozenset("a"), "w")) == ["a", "b", "a"]


@pytest.mark.parametrize(
    ("tag", "hint"),
    [
        ("inertal", " (did you mean 'inertial'?)"),
        ("Inertial", " (did you mean 'inertial'?)"),
        ("loop_closure", ""),
        ("springs", ""),
        ("added_mass", ""),
        ("link", ""),
    ],
)
def test_an_unknown_element_that_may_change_the_dynamics_is_refused(tag: str, hint: str):
    parent, read = element(f"<link><{tag}/></link>"), frozenset({"inertial"})
    known = f"w holds <{tag}>, which is no part of a URDF known here{hint}"
    assert refusal(lambda: list(ignored_tags(parent, frozenset(), "w", read))) == known


def test_a_file_is_read_up_to_its_limits_and_refused_behind_them(tmp_path: Path, monkeypatch):
    path = tmp_path / "r.urdf"
    name = repr(str(path))

    def root(source: str | bytes, *more: Any) -> Any:
        path.write_bytes(source.encode() if isinstance(source, str) else source)
        return root_of(path, *more)

    assert (URDF.name, URDF.roots, URDF.deepest) == ("URDF", ("robot",), 60)
    inside = f"<robot>{'<a>' * 59}{'</a>' * 59}</robot>"
    assert root(inside).tag == "robot"
    deep = f"<robot>{'<a>' * 60}{'</a>' * 60}</robot>"
    limits = f"{name} has more than 200000 elements, or more than 60 inside each other"
    assert refusal(root, deep) == limits
    assert root(deep, URDF._replace(deepest=61)).tag == "robot"
    assert len(root(f"<robot>{'<a></a>' * 61}</robot>")) == 61, "beside each other"
    monkeypatch.setattr(urdf_reader, "MOST_ELEMENTS", 3)
    assert len(root("<robot><a/><a/></robot>")) == 2
    few = f"{name} has more than 3 elements, or more than 60 inside each other"
    assert refusal(root, "<robot><a/><a/><a/></robot>") == few
    monkeypatch.setattr(urdf_reader, "LARGEST", 10)
    assert root("<robot/>  ").tag == "robot"
    assert refusal(root, "<robot/>   ") == f"{name} has more than 0 million bytes"
    monkeypatch.undo()
    for source, said in (
        (" \n", f"{name} is empty"),
        ("<sdf/>", f"{name} holds <sdf>, expected <robot>: no URDF"),
        ("<robot xmlns:xacro='x'><xacro:a/></robot>", f"{name} is a template for xacro: have it "
         "expanded first"),
        ("<robot a='${x}'/>", f"{name} is a template for xacro: have it expanded first"),
        ("<!DOCTYPE robot><robot/>", f"{name} declares a document type: entities are not expanded "
         "here"),
    ):  # fmt: skip
        assert refusal(root, source) == said
    assert refusal(root, "<robot>").startswith(f"{name} is no XML: no element found")
    assert root("<robot a='{x}$'/>").tag == "robot"
    assert urdf_reader.MOST_ELEMENTS == 200_000 and urdf_reader.LARGEST == 20_000_000


# ---- Equalities of MuJoCo ------------------------------------------------------------------------

SITE, BODY = 6, 1
HALF = np.sqrt(0.5)


def read(
    kind: int, objects: tuple[int, int], data: list[float], on: int, name: str = "e"
) -> EqualityContext:
    model = SimpleNamespace(
        equality=lambda i: SimpleNamespace(name=name),
        eq_type=np.array([9, kind]),
        eq_obj1id=np.array([8, objects[0]]),
        eq_obj2id=np.array([8, objects[1]]),
        eq_data=np.array([[np.nan] * 11, (data + 11 * [0.0])[:11]]),
        eq_objtype=np.array([9, on]),
        site_pos=np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]]),
        site_quat=np.array([[HALF, HALF, 0.0, 0.0], [HALF, 0.0, HALF, 0.0]]),
        site_bodyid=np.array([2, 1]),
    )
    joints = ["h", "s", "ball"]
    return EqualityContext(model, "'f.xml'", ["world", "a", "b"], joints, {"h": 0.5, "s": 0.25})


def near(one: Any, other: Any) -> bool:
    """Whether two constraints are the same, numbers to rounding."""
    flat = [
        [*(x for _, at in c.points for x in at), *(x for _, at in c.directions for x in at),
         *(c.numbers or ())]
        for c in (one, other)
    ]  # fmt: skip
    words = [
        (c.kind, c.name, [x for x, _ in c.points], [x for x, _ in c.directions], c.joints)
        for c in (one, other)
    ]
    return words[0] == words[1] and flat[0] == pytest.approx(flat[1], abs=1e-15)


def test_equalities_are_pins_welds_drives_and_couplings_between_these_points():
    connect, held, joint = range(3)
    data = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, HALF, 0.0, 0.0, HALF]
    found = equality_constraint(read(connect, (1, 2), data, BODY), 1)
    assert near(found, pin("e", "a", "b", (0.1, 0.2, 0.3), (0.4, 0.5, 0.6)))
    found = equality_constraint(read(connect, (2, 0), data, BODY, ""), 1)
    assert near(found, pin("equality1", "b", "world", (0.1, 0.2, 0.3), (0.4, 0.5, 0.6)))
    found = equality_constraint(read(connect, (0, 1), data, SITE), 1)
    assert near(found, pin("e", "b", "a", (0.1, 0.2, 0.3), (0.4, 0.5, 0.6)))
    found = equality_constraint(read(held, (1, 2), data, BODY), 1)
    turn = (HALF, 0.0, 0.0, HALF)
    assert near(found, weld("e", "a", "b", (0.4, 0.5, 0.6), (0.1, 0.2, 0.3), turn))
    found = equality_constraint(read(held, (0, 1), data, SITE), 1)
    # A quarter turn about x, then one back about y.
    turn = (0.5, 0.5, -0.5, -0.5)
    assert near(found, weld("e", "b", "a", (0.1, 0.2, 0.3), (0.4, 0.5, 0.6), turn))
    found = equality_constraint(read(joint, (0, -1), [0.1, 9.0], BODY), 1)
    assert found == drive("e", "h", 0.6)
    found = equality_constraint(read(joint, (1, 0), [0.1, -2.0], BODY), 1)
    assert near(found, coupling("e", "s", "h", -2.0, 0.25 + 0.1 + 2.0 * 0.5))
    for i in (2, 3, 4):
        curved = [0.1, -2.0, 0.0, 0.0, 0.0]
        curved[i] = 1e-9
        said = "'f.xml': equality 'e' is not linear"
        assert refusal(equality_constraint, read(joint, (1, 0), curved, BODY), 1) == said
        assert equality_constraint(read(joint, (1, -1), curved, BODY), 1) == drive("e", "s", 0.35)
    for pair in ((2, 0), (0, 2), (2, -1)):
        said = "'f.xml': equality 'e' is of joint 'ball', which has several coordinates"
        assert refusal(equality_constraint, read(joint, pair, [0.0, 1.0], BODY), 1) == said


# ---- What MuJoCo is handed -----------------------------------------------------------------------


def checked(source: str) -> None:
    mjcf_reader._check(element(source), Path("m.xml"))


def test_sizes_of_a_file_are_checked_at_their_limits(monkeypatch):
    for good in (
        '<mujoco><mesh params="100 -100"/><mesh/></mujoco>',
        '<mujoco><hfield nrow="2000" ncol="2000"/><size nuser_body="2000" memory="9e9"/></mujoco>',
        '<mujoco><geom nrow="9999"/><size nrow="9999"/></mujoco>',
    ):
        checked(good)
    most = "expected at most"
    for bad, said in (
        ('<mesh params="100 -101"/>', f"a parameter of <mesh> is -101, {most} 100"),
        ('<mesh params="x"/>', "params of <mesh> is 'x', expected a number"),
        ('<hfield nrow="2000.5"/>', f"nrow of <hfield> is 2000.5, {most} 2000"),
        ('<hfield ncol="2001"/>', f"ncol of <hfield> is 2001, {most} 2000"),
        ('<size nuser_cam="2001"/>', f"nuser_cam of <size> is 2001, {most} 2000"),
    ):
        assert refusal(checked, f"<mujoco>{bad}</mujoco>") == f"'m.xml': {said}"
    monkeypatch.setattr(mjcf_reader, "MAX_FILE_ELEMENTS", 2)
    for tag in ("body", "joint"):
        checked(f"<mujoco>{f'<{tag}/>' * 2}</mujoco>")
        said = f"'m.xml' has 3 elements <{tag}>, expected at most 2"
        assert refusal(checked, f"<mujoco>{f'<{tag}/>' * 3}</mujoco>") == said
    assert {"composite", "flex", "flexcomp"} == mjcf_reader.NOT_UNDERSTOOD.keys()
    for tag, reason in mjcf_reader.NOT_UNDERSTOOD.items():
        said = f"'m.xml' holds <{tag}>, {reason}"
        assert refusal(checked, f"<mujoco><{tag}/></mujoco>") == said


LOADED = """
<mujoco><option density="1.2" viscosity="1e-5"/><size nuserdata="3"/>
<asset><texture name="t" type="2d" builtin="flat" width="8" height="8"/>
  <material name="m" texture="t"/><hfield name="h" nrow="2" ncol="2" size="1 1 1 1"/></asset>
<worldbody><geom type="hfield" hfield="h"/><site material="m"/>
  <body name="a" gravcomp="1"><joint name="j" frictionloss="2" range="0 1" limited="true"/>
    <geom size="0.1" material="m"/><geom size="0.2" contype="0" conaffinity="0"/>
    <body name="b" gravcomp="0.5"><joint name="k"/><geom size="0.3"/>
      <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body></body></worldbody>
<contact><exclude body1="a" body2="b"/></contact>
<tendon><fixed name="t"><joint joint="j" coef="1"/></fixed></tendon>
<actuator><motor joint="j"/><motor joint="k"/></actuator>
<sensor><jointpos joint="j"/><jointpos joint="k"/><jointvel joint="k"/></sensor>
<keyframe><key name="a"/></keyframe>
<custom><numeric name="n" data="1"/><text name="x" data="y"/></custom></mujoco>
"""


def test_all_that_no_equation_needs_is_taken_out_and_what_a_motion_would_notice_is_counted(
    tmp_path: Path,
):
    pytest.importorskip("mujoco")
    path = tmp_path / "loaded.xml"
    path.write_text(LOADED, encoding="utf-8")
    model, out, _ = mjcf_reader.compile_model(path)
    assert {name: count for name, count in out.items() if count} == {
        "drag of a fluid": 1, "sensors": 3, "actuators": 2, "tendons": 1, "keyframes": 1,
        "compensation of gravity": 2, "shapes to collide": 3,
    }  # fmt: skip
    left = "nsensor", "nu", "ntendon", "nkey", "nexclude", "nnumeric", "ntext", "nmat", "ntex"
    assert {name: getattr(model, name) for name in left} == dict.fromkeys(left, 0)
    assert (model.nhfield, model.nuserdata, model.opt.density, model.opt.viscosity) == (0, 0, 0, 0)
    assert not model.body_gravcomp.any()
    # Shapes stay only where inertia follows from them.
    assert (model.ngeom, model.njnt, model.nbody) == (2, 2, 3)
    said = read_mjcf(path).ignored
    assert "friction of joints (1)" in said and "limits of joints (1)" in said


LIMB = """
<mujoco><compiler angle="radian"/><option gravity="0 0 -5"><flag BITS/></option><worldbody>
  <body name="leg" pos="1 2 3" quat="0.70710678118654757 0 0 0.70710678118654757">
    <joint name="roll" axis="1 0 0" pos="0.1 0 0" ref="1.5707963267948966" damping="0.3"
      stiffness="2" springref="0.4"/>
    <joint name="push" type="slide" axis="0 0 1" ref="0.25" armature="0.1"/>
    <joint name="yaw" axis="0 0 1" pos="0 0 0.5"/>
    <inertial pos="0.1 0.2 0.3" mass="2" diaginertia="0.2 0.3 0.4"/>
    <body name="foot" pos="0 0 -1"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
  </body></worldbody></mujoco>
"""


def limb(path: Path, bits: str = "") -> Path:
    path.write_text(LIMB.replace("BITS", bits), encoding="utf-8")
    return path


def test_joints_in_a_row_turn_about_points_of_their_own_and_begin_where_they_are_drawn(tmp_path):
    pytest.importorskip("mujoco")
    found = read_mjcf(limb(tmp_path / "limb.xml"))
    assert [one.name for one in found.links] == [
        "world", "leg after roll", "leg after push", "leg after yaw", "leg", "foot",
    ]  # fmt: skip
    roll, push, yaw, leg_joint, foot = found.joints
    assert [(x.name, x.kind, x.parent, x.child) for x in found.joints] == [
        ("roll", "revolute", "world", "leg after roll"),
        ("push", "prismatic", "leg after roll", "leg after push"),
        ("yaw", "revolute", "leg after push", "leg after yaw"),
        ("leg fixed", "fixed", "leg after yaw", "leg"),
        ("foot fixed", "fixed", "leg", "foot"),
    ]
    near: Any = lambda x: pytest.approx(x, abs=1e-15)  # noqa: E731
    # A quarter turn about z, and back a quarter about x: what is drawn is at ref.
    assert roll.origin == near((1.0, 2.1, 3.0))
    assert roll.orientation == near((0.5, -0.5, -0.5, 0.5))
    assert (roll.axis, roll.damping, roll.stiffness, roll.rest_position) == (
        (1, 0, 0),
        0.3,
        2.0,
        0.4,
    )
    assert push.origin == near((-0.1, 0.0, -0.25)) and push.orientation == (1, 0, 0, 0)
    assert (push.axis, push.armature, push.stiffness, push.rest_position) == (
        (0, 0, 1),
        0.1,
        None,
        0.0,
    )
    assert yaw.origin == near((0.0, 0.0, 0.5)) and (yaw.damping, yaw.armature) == (None, None)
    # The body's frame, behind a last joint that is off its origin.
    assert leg_joint.origin == near((0.0, 0.0, -0.5)) and leg_joint.orientation == (1, 0, 0, 0)
    assert foot.origin == near((0.0, 0.0, -1.0))
    massless, leg, last = found.links[3:]
    assert (leg.mass, leg.moments) == (2.0, near((0.2, 0.3, 0.4)))
    assert leg.center == near((0.1, 0.2, 0.3))
    assert massless == Link("leg after yaw")
    assert (last.center, found.links[1]) == ((0, 0, 0), Link("leg after roll"))
    assert found.pose == {"roll": 1.5707963267948966, "push": 0.25}
    assert (found.coordinates, found.gravity) == (["roll", "push", "yaw"], (0.0, 0.0, -5.0))


@pytest.mark.parametrize("name", ["constraint", "equality", "spring", "damper", "gravity"])
def test_what_an_option_switches_off_is_off_alone(tmp_path: Path, name: str):
    pytest.importorskip("mujoco")
    path = limb(tmp_path / "limb.xml", f'{name}="disable"')
    model, out, _ = mjcf_reader.compile_model(path)
    off = mjcf_reader._MjcfReader(path, model, out).off
    assert {key for key, value in off.items() if value} == {name}
    found = read_mjcf(path)
    roll = found.joints[0]
    assert (roll.stiffness is None, roll.damping is None) == (name == "spring", name == "damper")
    assert (found.gravity is None) == (name == "gravity")


def test_names_that_a_file_lacks_are_numbers_that_no_other_has():
    assert mjcf_reader._names(["", "a", "", ""], "body") == ["body0", "a", "body2", "body3"]
    assert mjcf_reader._names(["body1", ""], "body") == ["body1", "body1_"]
    assert mjcf_reader._names(["", "", "joint1"], "joint") == ["joint0", "joint1_", "joint1"]


def test_a_robot_knows_the_file_that_it_is_of_and_the_code_that_makes_it(tmp_path: Path):
    pytest.importorskip("mujoco")
    path = limb(tmp_path / "limb.xml")
    made = from_mjcf(path, gravity=(1, 2, 3)).source
    assert (made.code, made.imports, made.file, made.format) == (
        f"from_mjcf({str(path)!r}, gravity=(1.0, 2.0, 3.0))",
        "from eomcheck.scenes import from_mjcf",
        str(path),
        "mjcf",
    )
    for wrong, said in (((1, 2), "gravity has shape (2,), expected (3,)"), (3, "gravity has")):
        with pytest.raises(InputError) as error:
            from_mjcf(path, gravity=wrong)  # type: ignore
        assert str(error.value).startswith(said)
    with pytest.raises(InputError) as error:
        from_mjcf(3)  # type: ignore
    assert str(error.value) == "path = 3, expected the path of an MJCF file"
    with pytest.raises(InputError) as error:
        robot_named(f"{path}:floating")
    assert str(error.value) == f"scene = {f'{path}:floating'!r}: {path} says itself what is free"
    urdf = tmp_path / "one.urdf"
    inertia = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    bodies = "".join(
        f'<link name="{x}"><inertial><mass value="1"/>{inertia}</inertial></link>' for x in "ab"
    )
    joint = '<joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint>'
    urdf.write_text(f'<robot name="two">{bodies}{joint}</robot>', encoding="utf-8")
    for options, code, key, floating in (
        ({}, "", "two", ""),
        ({"floating": True}, ", floating=True", "two_floating", "a"),
        ({"gravity": None}, ", gravity=None", "two", ""),
        ({"floating": True, "gravity": (0, 0, 1)}, ", floating=True, gravity=(0.0, 0.0, 1.0)",
         "two_floating", "a"),
    ):  # fmt: skip
        scene = from_urdf(urdf, **options)  # type: ignore
        made = scene.source
        assert (made.code, scene.key, made.floating) == (f"from_urdf({str(urdf)!r}{code})", key,
                                                         floating)  # fmt: skip
        assert (made.imports, made.file, made.format, made.warnings) == (
            "from eomcheck.scenes import from_urdf", str(urdf), "urdf", "",
        )  # fmt: skip
    with pytest.raises(InputError) as error:
        from_urdf(3)  # type: ignore
    assert str(error.value) == "path = 3, expected the path of a URDF file"
    assert Joint("j", "revolute", "a", "b").name == scene.coordinate_names[-1]


def test_coordinates_that_constraints_determine_come_first(tmp_path: Path):
    pytest.importorskip("mujoco")
    path = tmp_path / "geared.xml"
    bodies = "".join(f'<body><joint name="{x}"/><geom size="0.1"/></body>' for x in "abc")
    equal = '<equality><joint joint1="b" joint2="c" polycoef="0 5 0 0 0"/></equality>'
    path.write_text(f"<mujoco><worldbody>{bodies}</worldbody>{equal}</mujoco>", encoding="utf-8")
    # q_b = 5 q_c: by the largest entry of a it is c that is determined.
    assert from_mjcf(path).coordinate_names == ("c", "a", "b")
