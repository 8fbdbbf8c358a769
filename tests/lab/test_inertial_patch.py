"""Patches of inertials: applied, the second file describes the bodies of the first."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from tests.lab.test_recorded_answers import arm_text
from tests.lab.test_robot_comparison import in_link

from eomcheck import cli
from eomcheck.errors import InputError
from eomcheck.lab.inertial_patch import inertial_patch
from eomcheck.lab.robot_comparison import compare_robots
from eomcheck.scene_lookup import scene_named

ARM = arm_text()

needs_patch = pytest.mark.skipif(shutil.which("patch") is None, reason="needs the command patch")

TIP = """
  <link name="tip"><!-- a tool --><inertial><mass value="0.5"/>
    <inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/></inertial></link>
  <joint name="fix" type="fixed"><parent link="link5"/><child link="tip"/>
    <origin xyz="0.3 0 0.1" rpy="0.2 0 1"/></joint></robot>"""

WITH_TIP = ARM.replace("</robot>", TIP)


def patched(first: Path, second: Path) -> str:
    """Apply the patch of two files to the second, and return it."""
    scenes = scene_named(str(first)), scene_named(str(second))
    text = inertial_patch(*scenes, compare_robots(*scenes, examples=1))
    applied = subprocess.run(
        ["patch", "-p0", str(second)], input=text, text=True, capture_output=True, check=False
    )
    assert applied.returncode == 0, applied.stdout + applied.stderr
    return text


def changed_lines(patch: str) -> int:
    """Return the number of lines that a patch adds."""
    return sum(line.startswith("+") and not line.startswith("+++") for line in patch.splitlines())


CHANGES = {
    "mass": (ARM, in_link(2, '<mass value="', '<mass value="1')),
    "center": (ARM, in_link(4, 'xyz="0.1 0.05', 'xyz="0.12 -0.05')),
    "inertia": (ARM, in_link(1, 'ixx="0.04"', 'ixx="0.041"')),
    "axes": (ARM, in_link(3, 'rpy="0.3 0.3 0"', 'rpy="0 0.3 0.1"')),
    "tool": (WITH_TIP, WITH_TIP.replace('mass value="0.5"', 'mass value="0.2"')),
    "arm with a tool": (
        WITH_TIP,
        in_link(5, 'xyz="0.1 0.05', 'xyz="0.12 0.05').replace("</robot>", TIP),
    ),
    "no tool's inertial": (
        WITH_TIP,
        WITH_TIP.replace(TIP[TIP.index("<inertial>") : TIP.index("</link>")], ""),
    ),
}  # fmt: skip
"""Change -> both robots."""


@needs_patch
@pytest.mark.parametrize("what", CHANGES)
def test_the_patched_file_is_the_same_robot(what: str, tmp_path: Path):
    paths = tmp_path / "a.urdf", tmp_path / "b.urdf"
    for path, text in zip(paths, CHANGES[what], strict=True):
        path.write_text(text)
    assert not compare_robots(*map(scene_named, map(str, paths)), examples=1).is_same
    patch = patched(*paths)
    assert compare_robots(*map(scene_named, map(str, paths)), examples=1).is_same
    before, after = CHANGES[what][1].splitlines(), paths[1].read_text().splitlines()
    assert changed_lines(patch) <= (3 if len(before) == len(after) else 6)
    assert "<!-- a tool -->" in paths[1].read_text() or "tool" not in what
    words = (one.read_text().split() for one in paths)
    if what in ("mass", "inertia"):  # numbers that do not differ stay as they are written
        assert changed_lines(patch) == 1
        assert sum(x != y for x, y in zip(*words, strict=True)) <= 1
    removed = [line for line in patch.splitlines() if line.startswith("-")]
    assert what != "tool" or any('"tip"' in line for line in removed), "the link that differs"


@needs_patch
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
@pytest.mark.parametrize("last", ["", "end"])
def test_an_mjcf_is_patched_to_the_bodies_of_a_urdf(newline: str, last: str, tmp_path: Path):
    mujoco = pytest.importorskip("mujoco")
    urdf = tmp_path / "a.urdf"
    urdf.write_text(ARM)
    spec = mujoco.MjSpec.from_file(str(urdf))
    spec.compile()
    text = spec.to_xml()
    assert text.count('mass="2.6"') == 1
    text = text.replace('mass="2.6"', 'mass="2.5"').rstrip("\n") + ("" if last else "\n")
    mjcf = tmp_path / "b.xml"
    mjcf.write_bytes(text.replace("\n", newline).encode())
    patch = patched(urdf, mjcf)
    assert changed_lines(patch) == 1
    assert compare_robots(*map(scene_named, (str(urdf), str(mjcf))), examples=1).is_same


@needs_patch
def test_a_body_without_inertial_gets_one_in_the_file_that_has_it(tmp_path: Path):
    pytest.importorskip("mujoco")
    body = (
        '<body name="bob" pos="0 0 1">\n<joint name="swing" axis="0 1 0"/>\n'
        '<geom size="0.1" pos="0 0 -0.5"{}/>\n</body>\n'
    )
    whole = "<mujoco><worldbody>{}</worldbody></mujoco>"
    (tmp_path / "a.xml").write_text(whole.format(body.format(' mass="2"')))
    (tmp_path / "b.xml").write_text('<mujoco><include file="part.xml"/></mujoco>')
    part = f"<mujocoinclude><worldbody>{body.format('')}</worldbody></mujocoinclude>"
    (tmp_path / "part.xml").write_text(part)
    scenes = [scene_named(str(tmp_path / name)) for name in ("a.xml", "b.xml")]
    text = inertial_patch(*scenes, compare_robots(*scenes, examples=1))
    assert text.startswith(f"--- {tmp_path / 'part.xml'}\n")
    subprocess.run(["patch", "-p0", str(tmp_path / "part.xml")], input=text, text=True, check=True)
    again = scene_named(str(tmp_path / "b.xml"))
    assert compare_robots(scenes[0], again, examples=1).is_same


def test_nothing_is_patched_where_bodies_agree(tmp_path: Path):
    paths = tmp_path / "a.urdf", tmp_path / "b.urdf"
    for path, text in zip(paths, (ARM, ARM.replace('xyz="0 0 1"', 'xyz="0 0.1 1"')), strict=True):
        path.write_text(text)
    scenes = [*map(scene_named, map(str, paths))]
    comparison = compare_robots(*scenes, examples=1)
    assert not comparison.is_same
    assert inertial_patch(*scenes, comparison) == ""


def test_a_body_that_one_link_cannot_mend_is_named(tmp_path: Path):
    paths = tmp_path / "a.urdf", tmp_path / "b.urdf"
    heavy = in_link(5, '<mass value="1"', '<mass value="3"').replace("</robot>", TIP)
    light = WITH_TIP.replace('mass value="0.5"', 'mass value="0.1"').replace('"tip"', '"top"')
    for path, text in zip(paths, (light, heavy), strict=True):
        path.write_text(text)
    scenes = [*map(scene_named, map(str, paths))]
    comparison = compare_robots(*scenes, examples=1)
    with pytest.raises(InputError, match="no inertia of 'link5' makes it that"):
        inertial_patch(*scenes, comparison)


def test_the_command_writes_the_patch(tmp_path: Path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("a.urdf").write_text(ARM)
    Path("b.urdf").write_text(in_link(3, '<mass value="', '<mass value="1'))

    def run(*words: str) -> int:
        monkeypatch.setattr(sys, "argv", ["eomcheck", "compare", *words])
        with pytest.raises(SystemExit) as stop:
            cli._run()
        return int(stop.value.code or 0)

    assert run("a.urdf", "b.urdf", "--patch", "mend.diff") == 1
    assert "written: mend.diff" in capsys.readouterr().out
    assert Path("mend.diff").read_text().startswith("--- b.urdf\n+++ b.urdf\n@@")
    assert run("a.urdf", "--patch", "mend.diff") == 2
    assert "--patch" in capsys.readouterr().err


def test_a_robot_without_a_file_is_not_patched(tmp_path: Path):
    path = tmp_path / "a.urdf"
    path.write_text(ARM)
    arm, pendulum = scene_named(str(path)), scene_named("chain-pendulum", 3)
    comparison = compare_robots(arm, arm, examples=1)
    with pytest.raises(InputError, match="has no file to patch"):
        inertial_patch(arm, pendulum, comparison)
