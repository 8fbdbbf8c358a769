"""Two robots compared: differences of one number are named alone, other frames are none."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from tests.lab.test_recorded_answers import arm_text

from eomcheck import cli
from eomcheck.errors import InputError, UnknownNameError
from eomcheck.lab.robot_comparison import RobotComparison, compare_robots, print_robots
from eomcheck.mechanics.parameters import settable
from eomcheck.scenes import SCENES, from_mjcf, from_sdf, from_urdf

ARM = arm_text()


def compared(tmp_path: Path, first: str, second: str, **match: str) -> RobotComparison:
    paths = tmp_path / "a.urdf", tmp_path / "b.urdf"
    for path, text in zip(paths, (first, second), strict=True):
        path.write_text(text)
    return compare_robots(*map(from_urdf, paths), match, examples=3)


def in_link(k: int, old: str, new: str) -> str:
    """Return the arm with a text of a link, and of the joint behind it, replaced."""
    at = ARM.index(f'<link name="link{k}">')
    end = ARM.find('<link name="link', at + 1)
    part = ARM[at:] if end < 0 else ARM[at:end]
    assert part.count(old) == 1, (old, part)
    return ARM[:at] + part.replace(old, new) + ("" if end < 0 else ARM[end:])


def in_joint(k: int, old: str, new: str) -> str:
    at = ARM.index(f'<joint name="j{k}"')
    end = ARM.index("</joint>", at)
    assert ARM[at:end].count(old) == 1, (old, ARM[at:end])
    return ARM[:at] + ARM[at:end].replace(old, new) + ARM[end:]


def with_dynamics(k: int, attributes: str) -> str:
    return in_joint(k, "<axis", f"<dynamics {attributes}/><axis")


PLANTED: dict[str, tuple[str, str, str]] = {
    **{
        f"mass of {k}": (in_link(k, '<mass value="', '<mass value="1'), f"j{k}", "mass")
        for k in range(6)
    },
    **{
        f"center of {k}": (in_link(k, 'xyz="0.1 0.05', 'xyz="0.12 0.05'), f"j{k}", "center of mass")
        for k in range(6)
    },
    "center mirrored": (in_link(2, 'xyz="0.1 0.05', 'xyz="0.1 -0.05'), "j2", "other sign"),
    **{
        f"moment of {k}": (in_link(k, 'ixx="0.04"', 'ixx="0.041"'), f"j{k}", "inertia")
        for k in range(6)
    },
    "center along the axis": (
        in_link(5, 'xyz="0.1 0.05 0.2"', 'xyz="0.108 0.05 0.206"'),
        "j5",
        "center of mass",
    ),
    "product with the other sign": (
        in_link(3, 'ixy="0.004" ixz="-0.003" iyy="0.05" iyz="0.002"',
                'ixy="-0.004" ixz="0.003" iyy="0.05" iyz="-0.002"'),
        "j3",
        "",
    ),
    "inertia of 1000": (
        in_link(4, 'ixx="0.04" ixy="0.004" ixz="-0.003" iyy="0.05" iyz="0.002" izz="0.03"',
                'ixx="40" ixy="4" ixz="-3" iyy="50" iyz="2" izz="30"'),
        "j4",
        "1000 times",
    ),
    "inertia rotated": (in_link(1, 'rpy="0.3 0.1 0"', 'rpy="0 0 0"'), "j1", "rotated: the same"),
    **{
        f"axis of {k}": (in_joint(k, f'axis xyz="{axis}"', f'axis xyz="{other}"'), f"j{k}", text)
        for k, axis, other, text in (
            (0, "0 0 1", "0 0.1 1", "axis: turned by 5.711°"),
            (1, "0 1 0", "0 -1 0", "axis: opposite direction"),
            (3, "1 0 0", "0.9 0.1 0", "axis: turned by"),
        )
    },
    **{
        f"placement of {k}": (
            in_joint(k, 'origin xyz="0 0.1', 'origin xyz="0.01 0.1'),
            f"j{k}",
            "placement",
        )
        for k in range(1, 6)
    },
    "damping": (with_dynamics(2, 'damping="0.3"'), "j2", "damping: 0, 0.3"),
    "zero position": (
        in_joint(3, 'rpy="0.2 0 0"', 'rpy="0.7 0 0"'),
        "j3",
        "zero position: differs by 28.6479°",
    ),
}  # fmt: skip
"""Difference -> (text of the second robot, joint, words of the only difference)."""


@pytest.mark.parametrize("what", PLANTED)
def test_a_difference_of_one_number_is_named_alone(what: str, tmp_path: Path):
    text, joint, words = PLANTED[what]
    (difference,) = compared(tmp_path, ARM, text).differences
    assert re.search(rf"\b{joint}\b", difference.where)
    assert words in str(difference)
    (back,) = compared(tmp_path, text, ARM).differences
    assert re.search(rf"\b{joint}\b", back.where)


def test_there_are_30_planted_differences():
    assert len(PLANTED) >= 30


def test_the_same_robot_is_the_same_whatever_its_frames_are(tmp_path: Path):
    same = compared(tmp_path, ARM, ARM)
    assert same.is_same and not same.effects
    assert len(same.matched) == 6
    # The last link's frame elsewhere: its inertial is moved back.
    shifted = ARM.replace('<joint name="j5" type="revolute">', '<joint name="j5" type="revolute" >')
    at = shifted.index('<link name="link5">')
    link = shifted[at:]
    moved = link.replace('rpy="0.3 0.5 0"', 'rpy="0.3 0.5 0"')
    assert compared(tmp_path, ARM, shifted[:at] + moved).is_same


def test_a_link_in_two_parts_is_one_body(tmp_path: Path):
    tip = '<link name="tip"><inertial><mass value="{}"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link>'  # noqa: E501
    fixed = (
        '<joint name="fix" type="fixed"><parent link="link5"/><child link="tip"/>'
        '<origin xyz="0.3 0 0"/></joint>'
    )
    whole = ARM.replace("</robot>", tip.format(0.5) + fixed + "</robot>")
    lighter = ARM.replace("</robot>", tip.format(0.4) + fixed + "</robot>")
    assert compared(tmp_path, whole, whole).is_same
    found = compared(tmp_path, whole, lighter).differences
    assert {x.what for x in found} == {"mass", "center of mass", "inertia"}
    assert all("tip" in x.where for x in found)


def test_an_inertia_about_the_joint_is_named(tmp_path: Path):
    m, c = 3.0 - 0.4 * 5, np.array([0.1, 0.05, 0.2])
    first = in_link(5, 'rpy="0.3 0.5 0"', 'rpy="0 0 0"')
    own = np.array([[0.04, 0.004, -0.003], [0.004, 0.05, 0.002], [-0.003, 0.002, 0.03]])
    about = own + m * (c @ c * np.eye(3) - np.outer(c, c))
    names = ["xx", "xy", "xz", "yy", "yz", "zz"]
    numbers = about[np.triu_indices(3)]
    inertia = " ".join(f'i{name}="{x:.17g}"' for name, x in zip(names, numbers, strict=True))
    at = first.index('<link name="link5">')
    second = first[:at] + re.sub(r"<inertia .*?/>", f"<inertia {inertia}/>", first[at:], count=1)
    (difference,) = compared(tmp_path, first, second).differences
    assert difference.text.startswith("about the joint, not about the center of mass")


def test_an_inertia_without_products_is_named(tmp_path: Path):
    first = in_link(5, 'rpy="0.3 0.5 0"', 'rpy="0 0 0"')
    at = first.index('<link name="link5">')
    second = first[:at] + re.sub(r'(ixy|ixz|iyz)="[^"]*"', r'\1="0"', first[at:])
    (difference,) = compared(tmp_path, first, second).differences
    assert difference.text.startswith("diagonal only")


def test_a_slide_that_is_mounted_elsewhere_is_named_and_not_its_bodies(tmp_path: Path):
    slide = in_joint(0, 'rpy="0.2 0 0"', 'rpy="0 0 0"').replace(
        'name="j0" type="revolute"', 'name="j0" type="prismatic"'
    )
    for place, text in (
        ("0.2 0.1 0.3", "displaced by 0.2 m (0.2, 0, 0)"),
        ("0.2 0.1 0.4", "displaced by 0.2 m (0.2, 0, 0)"),
        ("0 0.1 0.4", "differs by 0.1 m"),
    ):
        other = slide.replace('origin xyz="0 0.1 0.3"', f'origin xyz="{place}"', 1)
        found = compared(tmp_path, slide, other).differences
        assert {x.where for x in found} == {"joint j0"}
        assert any(text in str(x) for x in found)


def test_joints_with_other_names_are_matched_by_request_and_by_their_place(tmp_path: Path):
    renamed = ARM.replace('name="j2"', 'name="elbow"').replace('name="j5"', 'name="wrist"')
    found = compared(tmp_path, ARM, renamed)
    assert found.is_same
    assert found.by_structure == ("j2", "j5")
    assert found.matched["j2"] == "elbow"
    asked = compared(tmp_path, ARM, renamed, j2="elbow")
    assert asked.by_structure == ("j5",)
    with pytest.raises(UnknownNameError, match="elbows"):
        compared(tmp_path, ARM, renamed, j2="elbows")
    with pytest.raises(UnknownNameError, match="j9"):
        compared(tmp_path, ARM, renamed, j9="elbow")


def test_a_joint_that_one_robot_has_alone_comes_first(tmp_path: Path):
    at = ARM.index('<link name="link5">')
    shorter = in_link(0, 'ixx="0.04"', 'ixx="0.05"')[: at + 0] + "</robot>"
    found = compared(tmp_path, ARM, shorter)
    assert str(found.differences[0]) == "joint j5: missing: only in a.urdf"
    assert found.differences[1].what == "inertia"
    assert not found.effects


def test_effects_are_relative_to_the_largest_and_name_the_joint(tmp_path: Path):
    doubled = compared(tmp_path, ARM, in_link(5, '<mass value="', '<mass value="2'))
    effects = {effect.quantity: effect for effect in doubled.effects}
    assert set(effects) == {"M", "gravity", "acceleration"}
    assert all(effect.size > 0.01 for effect in effects.values())
    same = compared(tmp_path, ARM, with_dynamics(5, 'damping="0.1"'))
    assert [effect.size for effect in same.effects[:2]] == [0.0, 0.0]
    assert same.effects[2].size > 0.01, "dampers change accelerations"


def test_digits_of_a_rounded_file_are_no_difference_and_short_numbers_are_exact(tmp_path: Path):
    rounded = ARM.replace('mass value="2.6"', 'mass value="2.600001"')
    assert compared(tmp_path, ARM, rounded).is_same  # seven digits, as programs write
    other = ARM.replace('mass value="2.6"', 'mass value="2.601"')
    assert [x.what for x in compared(tmp_path, ARM, other).differences] == ["mass"]


def test_digits_are_those_of_numbers_of_the_same_sort(tmp_path: Path):
    exact = ARM.replace('mass value="2.6"', 'mass value="2.6000012"')
    fine = ARM.replace('xyz="0 0.1 0.27"', 'xyz="0 0.10000000001 0.27"')
    assert fine != ARM
    found = compared(tmp_path, fine, fine.replace('mass value="2.6"', 'mass value="2.600001"'))
    assert found.is_same  # masses have seven digits, whatever the places of joints have
    other = exact.replace('mass value="3"', 'mass value="3.00000002"')
    (difference,) = compared(tmp_path, exact, other.replace("2.6000012", "2.6000112")).differences
    assert difference.what == "mass"


def test_a_base_does_not_move_along_axes_that_all_its_joints_have(tmp_path: Path):
    joints = ""
    for k, y in (("left", 0.1), ("right", -0.1)):
        link = ARM[ARM.index('<link name="link0">') : ARM.index('<joint name="j0"')]
        joints += link.replace("link0", k) + (
            f'<joint name="{k}" type="continuous"><parent link="trunk"/><child link="{k}"/>'
            f'<origin xyz="0.2 {y} 0"/><axis xyz="1 0 0"/></joint>'
        )
    trunk = ARM[ARM.index('<link name="link1">') : ARM.index('<joint name="j1"')]
    trunk = trunk.replace("link1", "trunk")
    texts = [
        f'<robot name="r">{x}{joints}</robot>' for x in (trunk, trunk.replace('"0.1', '"0.11'))
    ]
    paths = tmp_path / "a.urdf", tmp_path / "b.urdf"
    for path, text in zip(paths, texts, strict=True):
        path.write_text(text)
    scenes = [from_urdf(path, floating=True) for path in paths]
    (difference,) = compare_robots(*scenes, {}, 1).differences
    assert (difference.where, difference.what) == ("body of trunk_roll (trunk)", "center of mass")


def test_many_links_of_a_body_are_named_in_part(tmp_path: Path):
    tags = "".join(
        f'<link name="tag{i}"/><joint name="fix{i}" type="fixed"><parent link="link5"/>'
        f'<child link="tag{i}"/></joint>'
        for i in range(6)
    )
    whole = ARM.replace("</robot>", f"{tags}</robot>")
    lighter = whole.replace('<mass value="1"/>', '<mass value="1.5"/>')
    (difference,) = compared(tmp_path, whole, lighter).differences
    assert difference.where == "body of j5 (link5, tag0, tag1, tag2, tag3 and 2 others)"


def chain_text(
    dynamics: str = "", equality: str = "", gravity: str = "0 0 -9.81", order: str = "lr"
) -> str:
    """Return an MJCF: a hinge, a hinge with dynamics on it, and two hinges on that one."""
    inertial = '<inertial pos="0.1 0 {}" mass="1" diaginertia="1 1 1.2"/>'
    ends = "".join(
        f'<body name="{x}" pos="1 0 {x == "l":d}"><joint name="{x}" axis="0 1 0"/>'
        f"{inertial.format(0.1)}</body>"
        for x in order
    )
    return (
        f'<mujoco><option gravity="{gravity}"/><worldbody><body name="a">'
        f'<joint name="j" axis="0 1 0"/>{inertial.format(0)}<body name="b" pos="1 0 0">'
        f'<joint name="k" axis="0 1 0" {dynamics}/>{inertial.format(0)}{ends}</body></body>'
        f"</worldbody><equality>{equality}</equality></mujoco>"
    )


def compared_mjcf(tmp_path: Path, first: str, second: str) -> RobotComparison:
    pytest.importorskip("mujoco")
    paths = tmp_path / "a.xml", tmp_path / "b.xml"
    for path, text in zip(paths, (first, second), strict=True):
        path.write_text(text)
    return compare_robots(*map(from_mjcf, paths), {}, examples=3)


COUPLED = '<joint joint1="l" joint2="j" polycoef="{}"/>'
HELD = '<connect body1="l" body2="world" anchor="{} 0 0"/>'


@pytest.mark.parametrize(
    ("first", "second", "said"),
    [
        ((), ('armature="0.1"',), "joint k: armature: 0, 0.1"),
        (('stiffness="2"',), ('stiffness="3"',), "joint k: stiffness: 2, 3"),
        (
            ('stiffness="2" springref="30"',),
            ('stiffness="2"',),
            "joint k: rest of its spring: 0.523599, 0",
        ),
        ((), ("", "", "0 0 9.81"), "world: gravity: (0, 0, -9.81), (0, 0, 9.81) m/s²"),
        ((), ("", HELD.format(0.1)), "constraints: number: 0 equations of a.xml, 2 of b.xml"),
        (("", COUPLED.format("0 1 0 0 0")), (), "number: 1 equation of a.xml, 0 of b.xml"),
        (("", COUPLED.format("0 1 0 0 0")), ("", COUPLED.format("0 -1 0 0 0")), "equations: a po"),
        (("", COUPLED.format("0 1 0 0 0")), ("", COUPLED.format("1 1 0 0 0")), "equations: a po"),
        (("", HELD.format(0.1)), ("", HELD.format(0.101)), "constraints: equations: a position or"),
    ],
)
def test_a_difference_of_forces_or_constraints_is_named_alone(first, second, said, tmp_path: Path):
    (difference,) = compared_mjcf(tmp_path, chain_text(*first), chain_text(*second)).differences
    assert said in str(difference)


@pytest.mark.parametrize("name", ["stiffness", "rest_length", "torque"])
def test_springs_between_points_and_constant_torques_are_compared(name: str):
    scene = SCENES["andrews"].example()
    numbers = {x: getattr(scene, x) for x in settable(scene)}
    other = type(scene)(**numbers | {name: 1.5 * getattr(scene, name)})
    assert compare_robots(scene, scene, examples=3).is_same
    comparison = compare_robots(scene, other, examples=3)
    (difference,) = comparison.differences
    assert "forces: springs between points, constant torques or others" in str(difference)
    effects = {effect.quantity: effect.size for effect in comparison.effects}
    assert effects["M"] == effects["gravity"] == 0.0 < effects["acceleration"]


def test_forces_are_compared_beside_other_bodies_and_in_any_order_of_joints(tmp_path: Path):
    scene = SCENES["andrews"].example()
    numbers = {x: getattr(scene, x) for x in settable(scene)}
    other = type(scene)(**numbers | {x: 1.5 * getattr(scene, x) for x in ("mass", "torque")})
    found = compare_robots(scene, other, examples=1).differences
    assert {"mass", "forces"} <= {one.what for one in found}
    held = ' stiffness="5" damping="2"'
    first, second = (
        chain_text(order=order).replace('"l" axis="0 1 0"', '"l" axis="0 1 0"' + held)
        for order in ("lr", "rl")
    )
    assert compared_mjcf(tmp_path, first, second).is_same


def test_tendons_are_named_as_not_compared_and_the_robots_not_as_the_same(tmp_path: Path, capsys):
    tendon = '<tendon><fixed stiffness="3"><joint joint="j" coef="1"/></fixed></tendon></mujoco>'
    plain = chain_text()
    comparison = compared_mjcf(tmp_path, plain, plain.replace("</mujoco>", tendon))
    print_robots(comparison)
    same, why, unread = capsys.readouterr().out.strip().splitlines()
    assert "numbers are compared to " in why
    assert same.startswith("a.xml and b.xml are the same robot in all that is compared, to ")
    assert unread == "not compared: tendons of b.xml, with their springs and dampers"


@pytest.mark.parametrize("equality", [HELD.format(0.1), COUPLED.format("0.2 -0.7 0 0 0")])
def test_constraints_are_the_same_in_any_order_of_joints_and_with_printed_digits(
    equality: str, tmp_path: Path
):
    dynamics = 'stiffness="2" springref="20"'
    first = chain_text(dynamics, equality)
    assert compared_mjcf(tmp_path, first, chain_text(dynamics, equality, order="rl")).is_same
    mujoco = pytest.importorskip("mujoco")
    spec = mujoco.MjSpec.from_string(first)
    spec.compile()
    assert compared_mjcf(tmp_path, first, spec.to_xml()).is_same


def test_an_armature_of_a_ball_that_differs_is_named_alone_with_its_effect(tmp_path: Path):
    text = '<mujoco><worldbody><body><joint type="ball" name="b" armature="{}"/><geom size="0.1" '
    text += 'pos="0.3 0 0.1"/></body></worldbody></mujoco>'
    found = compared_mjcf(tmp_path, text.format(0.3), text.format(0.2))
    assert [str(one) for one in found.differences] == ["joint b_roll: armature: 0.3, 0.2"]
    assert next(x.size for x in found.effects if x.quantity == "M") > 0.1


def test_forces_of_stiff_joints_may_differ_by_their_own_digits(tmp_path: Path):
    first, second = (chain_text(f'stiffness="1e9" springref="{x}"') for x in (0.3, 0.3000001))
    assert first != second
    assert compared_mjcf(tmp_path, first, second).is_same


def test_a_spring_of_a_ball_that_differs_is_named_alone(tmp_path: Path):
    text = '<mujoco><worldbody><body euler="{}"><joint type="{}" name="b" stiffness="{}"/>'
    text += '<geom size="0.1" pos="0.3 0 0.1"/></body></worldbody></mujoco>'
    found = compared_mjcf(
        tmp_path, text.format("0 0 0", "ball", 0.3), text.format("0 0 0", "ball", 0.2)
    )
    assert [str(one) for one in found.differences] == ["joint b_roll: stiffness: 0.3, 0.2"]
    found = compared_mjcf(
        tmp_path, text.format("0 0 0", "free", 0.3), text.format("0 0 30", "free", 0.3)
    )
    named = "joint b_roll: rest of its spring: orientations 0.524 rad apart"
    assert [str(one) for one in found.differences] == [named]


def arm_in_sdf(name: str, damping: float) -> str:
    """Return an arm whose numbers have few digits, but for its damping."""
    return f"""<sdf version="1.9"><model name="m"><link name="{name}"><inertial>
<pose>0.1 0 0.2 0 0 0</pose><mass>2</mass><inertia><ixx>0.3</ixx><iyy>0.3</iyy><izz>0.4</izz>
</inertia></inertial></link><joint name="j" type="revolute"><parent>world</parent>
<child>{name}</child><axis><xyz>0 1 0</xyz><dynamics><damping>{damping}</damping></dynamics></axis>
</joint></model></sdf>"""


@pytest.mark.parametrize(
    ("name", "damping", "named"),
    [("arm", 0.30001, ["damping"]), ("arm", 0.300001, []), ("arm_20240517001", 0.300001, [])],
)
def test_numbers_are_compared_to_their_digits_and_not_to_those_of_names(
    tmp_path: Path, name: str, damping: float, named: list[str]
):
    scenes = []
    for at, number in enumerate((0.3, damping)):
        path = tmp_path / f"{at}.sdf"
        path.write_text(arm_in_sdf(name, number))
        scenes.append(from_sdf(path))
    assert [one.what for one in compare_robots(*scenes).differences] == named


def test_a_small_turn_of_the_rest_of_one_of_two_springs_is_named(tmp_path: Path):
    geom = '<geom size="0.1" pos="0.3 0 0.1"/>'
    text = '<mujoco><worldbody><body euler="0 0 {}"><joint type="free" name="f" stiffness="0.3"/>'
    text += f'{geom}<body pos="0 0 0.4"><joint type="ball" name="b" stiffness="0.2"/>{geom}'
    text += "</body></body></worldbody></mujoco>"
    found = compared_mjcf(tmp_path, text.format(0.0), text.format(0.1))
    named = "joint f_roll: rest of its spring: orientations 0.00175 rad apart"
    assert [str(one) for one in found.differences] == [named]


def test_the_effect_is_at_the_joint_that_differs_in_any_order(tmp_path: Path):
    other = chain_text(order="rl").replace('"l" axis="0 1 0"', '"l" axis="0 1 0" armature="5"')
    for first, second in ((chain_text(), other), (other, chain_text())):
        found = compared_mjcf(tmp_path, first, second)
        assert {x.quantity: x.joint for x in found.effects if x.size}["M"] == "l"


def mimicking(leader: int, ratio: float) -> str:
    tag = f'<mimic joint="j{leader}" multiplier="{ratio}"/>'
    return in_joint(5, "<axis", f"{tag}<axis")


def test_the_leader_and_the_ratio_of_a_joint_that_follows_are_named(tmp_path: Path):
    (leader,) = compared(tmp_path, mimicking(1, 2.0), mimicking(2, 2.0)).differences
    assert str(leader) == "joint j5: mimic: follows j1; follows j2"
    ratios = compared(tmp_path, mimicking(1, 2.0), mimicking(1, -2.0)).differences
    assert "joint j5: mimic: ratio 2, -2" in map(str, ratios)
    for first, second, said in (
        (ARM, mimicking(1, 2.0), "free; follows j1, 2 times"),
        (mimicking(1, 2.0), ARM, "follows j1, 2 times; free"),
    ):
        found = compared(tmp_path, first, second).differences
        assert f"joint j5: mimic: {said}" in map(str, found)


def test_a_joint_on_another_parent_is_named(tmp_path: Path):
    moved = in_joint(5, '<parent link="link4"/>', '<parent link="link3"/>')
    found = compared(tmp_path, ARM, moved).differences
    assert "joint j5: parent: on j4, on j3" in map(str, found)


def test_a_scene_without_a_tree_is_refused():
    scene = next(kind.example() for kind in SCENES.values() if kind.example().tree() is None)
    with pytest.raises(InputError, match="has no tree of bodies"):
        compare_robots(scene, scene)


def test_two_files_are_compared_by_the_command(tmp_path: Path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("eomcheck.console.PATIENCE", 1e4)
    Path("a.urdf").write_text(ARM)
    Path("b.urdf").write_text(in_link(3, '<mass value="', '<mass value="1'))
    Path("c.urdf").write_text(ARM.replace('name="j2"', 'name="elbow"'))

    def run(*words: str) -> int:
        monkeypatch.setattr(sys, "argv", ["eomcheck", "compare", *words])
        with pytest.raises(SystemExit) as stop:
            cli._run()
        return int(stop.value.code or 0)

    assert run("a.urdf", "a.urdf") == 0
    same = capsys.readouterr().out
    resolution, why = re.findall(
        r"to (\S+) of its size|^\S+: (numbers are compared .*)", same, re.M
    )
    assert same.count(resolution[0]) == 2 and float(resolution[0]) == 0.5 * 10.0 ** (
        1 - int(why[1].split("compared to ")[1].split(" ")[0])
    )
    assert run("a.urdf", "b.urdf", "--json", "d.json") == 1
    out = capsys.readouterr().out
    assert "a.urdf and b.urdf are two robots: 1 difference" in out
    assert "body of j3 (link3): mass: 1.8 kg, 11.8 kg" in out
    assert "M differs by up to" in out
    document = json.loads(Path("d.json").read_text())
    assert (document["same"], len(document["differences"]), len(document["effects"])) == (
        False,
        1,
        3,
    )
    assert run("a.urdf", "c.urdf", "--match", "j2=elbow") == 0
    Path("short.urdf").write_text(ARM[: ARM.index('<link name="link5">')] + "</robot>")
    for words in (("a.urdf", "short.urdf"), ("short.urdf", "a.urdf")):
        capsys.readouterr()
        assert run(*words) == 1
        assert "joint j5: missing: only in a.urdf" in capsys.readouterr().out
    for words, message in (
        (("a.urdf", "c.urdf", "--match", "j2"), "expected JOINT=JOINT"),
        (("a.urdf", "c.urdf", "--match", "j2=j9"), "'j9'"),
        (("a.urdf", "c.urdf", "--engine", "pinocchio"), "--engine"),
        (("a.urdf", "--match", "j2=elbow"), "--match"),
    ):
        assert run(*words) == 2
        assert message in capsys.readouterr().err
