"""Engines that read a robot's file: its description, joints, bases and answers, all by hand."""

from __future__ import annotations

import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.robots import arm, body, joint

from eomcheck.engines import (
    BY_FORMAT,
    DEFAULT,
    READERS,
    Answers,
    MjcfFile,
    asked_by_default,
    default_reader,
)
from eomcheck.engines.file_engine import (
    BaseVelocity,
    FileEngine,
    RobotDescription,
    capture_output,
    few,
    file_of,
    free_base,
    is_free,
    read_description,
)
from eomcheck.engines.idyntree import IdyntreeFile
from eomcheck.engines.mujoco import MujocoFile
from eomcheck.engines.pinocchio import PinocchioFile
from eomcheck.engines.pybullet import PybulletFile
from eomcheck.engines.tree_engine import SUFFIXES
from eomcheck.errors import EngineError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.scenes import ChainPendulum, from_mjcf, from_urdf

# ---- What is in a file ---------------------------------------------------------------------------

INERTIA = '<inertia ixx="{}" iyy="{}" izz="{}" ixy="0" ixz="0" iyz="0"/>'


def link(name: str, mass: str, *moments: str) -> str:
    inertia = INERTIA.format(*moments)
    return f'<link name="{name}"><inertial><mass value="{mass}"/>{inertia}</inertial></link>'


def between(name: str, ends: str, kind: str = "revolute", more: str = "") -> str:
    parent, child = ends.split()
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{more}</joint>'


ODD = [
    '<link name="root"><visual/><collision/><inertial><mass value="1"/>',
    INERTIA.format(1, 1, 1),
    "</inertial><visual/></link>",
    link("light", "0", "0.1", "0.2", "0.2"),
    '<link name="empty"><collision/></link>',
    link("flat", "2", "1", "1", "3"),
    link("round", "2", "1", "1", "1"),
    '<link name="tip"/>',
    between("a", "root light", more='<dynamics damping="0.5"/>'),
    between("b", "light empty", more='<mimic joint="a" multiplier="-2" offset="0.25"/>'),
    between("c", "empty flat", "prismatic", '<dynamics damping="0"/>'),
    between("d", "flat round", more='<mimic joint="b"/><dynamics damping="2"/>'),
    between("e", "round tip", "fixed", '<mimic joint="a"/><dynamics damping="7"/>'),
]


def test_a_file_is_described_by_its_root_its_followers_dampers_and_odd_links(tmp_path: Path):
    path = tmp_path / "odd.urdf"
    path.write_text(f"<robot name='odd'>{''.join(ODD)}</robot>", encoding="utf-8")
    found = read_description(path)
    bare = "".join(ODD).replace("<visual/>", "").replace("<collision/>", "")
    assert found.text.replace(" />", "/>") == f'<robot name="odd">{bare}</robot>'.replace(
        '<link name="empty"></link>', '<link name="empty"/>'
    )
    assert found == RobotDescription(
        found.text,
        "root",
        {"b": ("a", -2.0, 0.25), "d": ("b", 1.0, 0.0)},
        frozenset({"a", "d"}),
        ("light",),
        ("empty", "tip"),
        ("flat",),
    )


@pytest.mark.parametrize(
    ("names", "told"),
    [
        (["b"], "b"),
        (["c", "a", "b"], "c, a, b"),
        (frozenset("cab"), "a, b, c"),
        (["d", "c", "b", "a"], "d, c, b and 1 more"),
        (frozenset("badec"), "a, b, c and 2 more"),
        ([], ""),
    ],
)
def test_at_most_three_names_are_told(names, told: str):
    assert few(names) == told


def test_readers_are_known_by_format_and_no_other_scene_has_one(tmp_path: Path):
    asked = asked_by_default(READERS)
    assert list(asked) == ["pinocchio", "mujoco", "drake", "idyntree", "pybullet"]
    for format, suffix in SUFFIXES.items():
        for key, kind in BY_FORMAT[format].items():
            assert (kind.key, kind.format) in ((f"{key}{suffix}", format), (key, format))
    assert BY_FORMAT["urdf"] is READERS and BY_FORMAT["mjcf"]["mujoco"] is MjcfFile
    assert {"urdf": PinocchioFile, "mjcf": MjcfFile} == DEFAULT
    scene = from_urdf(arm(tmp_path / "arm.urdf"))
    assert default_reader(scene) is default_reader(type(scene)) is PinocchioFile
    assert default_reader(ChainPendulum) is default_reader(ChainPendulum.rods(2)) is None
    assert (file_of(scene), is_free(scene)) == (tmp_path / "arm.urdf", False)
    assert (file_of(ChainPendulum.rods(2)), is_free(ChainPendulum.rods(2))) == (None, False)
    for kind in (*READERS.values(), *BY_FORMAT["mjcf"].values()):
        assert kind.reads_file and not kind.compliant and not kind.reads_parameters


# ---- Joints of a library and coordinates of the scene --------------------------------------------


class Silent(FileEngine):
    """A reader without a library: its joints are those that a test says, its terms by hand."""

    key = "silent_file"
    names: Any = ()
    line = ""

    @classmethod
    def _library(cls) -> Any:
        return SimpleNamespace(__version__="1.2")

    def _read(self, library: Any, description: RobotDescription) -> None:
        self.handed = library.__version__, description
        os.write(1, self.line.encode())

    def joints(self) -> list[str]:
        return list(self.names)

    def _build(self, library: Any, links: Any) -> None:
        raise AssertionError

    def mass_matrix(self, q, t=0.0):
        return np.diag(2.0 + np.arange(len(self.shift)))

    def bias(self, q, v, t=0.0):
        return v * v

    def forces(self, q, v, t=0.0):
        return 3 * q


FINGERS = (
    body("left")
    + body("right", mass=0.4)
    + body("thumb", mass=0.3)
    + joint("far", "right", "thumb", "revolute", "0 0 1",
            '<mimic joint="near" multiplier="0.5" offset="0.3"/>')
    + joint("near", "hand", "right", "revolute", "0 0 1",
            '<mimic joint="grip" multiplier="-2" offset="0.1"/>')
    + joint("grip", "hand", "left", "prismatic", "1 0 0", '<dynamics damping="0.2"/>')
)  # fmt: skip


def silent(names: list[str] | None, scene: Any, **more: Any) -> Any:
    return type("Silent", (Silent,), {"key": "silent_file", "names": names or (), **more})(scene)


def test_joints_of_a_library_are_coordinates_in_its_own_order_and_those_that_follow_are_geared(
    tmp_path: Path,
):
    scene = from_urdf(arm(tmp_path / "arm.urdf", more=FINGERS))
    assert scene.coordinate_names == ("shoulder", "slide", "wrist", "grip")
    names = ["far", "wrist", "grip", "shoulder", "near", "slide"]
    one = silent(names, scene)
    expected = [
        [0, 0, 0, -1.0],
        [0, 0, 1, 0],
        [0, 0, 0, 1],
        [1, 0, 0, 0],
        [0, 0, 0, -2.0],
        [0, 1, 0, 0],
    ]
    assert one.coordinates.tolist() == expected
    # far = 0.5 near + 0.3, near = -2 grip + 0.1.
    assert one.shift == pytest.approx([0.35, 0, 0, 0, 0.1, 0], abs=1e-16)
    assert one.handed == ("1.2", read_description(tmp_path / "arm.urdf"))
    assert (one.base, one.follow, one._gravity.tolist()) == (0, True, [0.0, 0.0, -9.81])
    assert one.free_base(np.zeros(4), np.zeros(4)) is None
    x, S, rest = one.velocity_map(np.array([0.1, 0.2, 0.3, 0.4]), np.ones(4))
    assert x == pytest.approx([-0.05, 0.3, 0.4, 0.1, -0.7, 0.2])
    assert S.tolist() == expected and rest.tolist() == [0.0] * 6
    S[:] = 0.0
    assert one.coordinates.tolist() == expected, "the answer is the caller's own"
    assert one.version() == "silent 1.2"
    weightless = silent(names, from_urdf(tmp_path / "arm.urdf", gravity=None))
    assert weightless._gravity.tolist() == [0.0, 0.0, 0.0]


def test_a_library_with_another_joint_or_without_one_is_refused_by_the_name_of_the_joint(tmp_path):
    scene = from_urdf(arm(tmp_path / "arm.urdf"))
    said = "^silent_file has a joint 'elbow' that the file does not move$"
    with pytest.raises(EngineError, match=said):
        silent(["shoulder", "slide", "wrist", "elbow"], scene)
    with pytest.raises(EngineError, match=r"^silent_file has no joint 'slide', which the file mov"):
        silent(["shoulder", "wrist"], scene)
    with pytest.raises(EngineError, match=r"^silent_file cannot represent chain-pendulum.* by its"):
        silent([], ChainPendulum.rods(2))
    with pytest.raises(EngineError, match=r"^silent_file cannot represent arm by its file$"):
        silent([], scene, represents=classmethod(lambda cls, scene: False))


def test_joints_of_a_free_base_come_first_and_its_frame_is_the_librarys(tmp_path: Path):
    text = arm(tmp_path / "arm.urdf").read_text().replace('<link name="base"/>', body("base"))
    (tmp_path / "arm.urdf").write_text(text, encoding="utf-8")
    scene, told = from_urdf(tmp_path / "arm.urdf", floating=True), BaseVelocity("base", "ground")
    assert is_free(scene) and file_of(scene) == tmp_path / "arm.urdf"
    one = silent(["wrist", "shoulder", "slide"], scene, base_velocity=told)
    assert (one.base, one.follow, one.shift.shape) == (6, False, (9,))
    assert one.coordinates[:6].tolist() == np.eye(9)[:6].tolist()
    assert one.coordinates[6:].tolist() == np.eye(9)[[8, 6, 7]].tolist()
    q, v = np.linspace(-0.4, 0.9, 9), np.linspace(1.1, -0.7, 9)
    base = free_base(q[:6], v[:6])
    S, rest = base.velocity(told, v[:6])
    x, whole, more = one.velocity_map(q, v)
    assert x.tolist() == [*base.position, *base.quaternion, q[8], q[6], q[7]]
    assert whole[:6, :6].tolist() == S.tolist() and not whole[:6, 6:].any()
    assert whole[6:].tolist() == one.coordinates[6:].tolist()
    assert more.tolist() == [*rest, 0.0, 0.0, 0.0]
    frame, velocity = one.free_base(q, v)
    assert velocity is told
    np.testing.assert_array_equal(frame.R, base.R)


def test_what_an_answer_leaves_out_is_the_dampers_or_what_the_library_wrote(tmp_path: Path):
    names = ["shoulder", "slide", "wrist"]
    still = from_urdf(arm(tmp_path / "still.urdf"))
    damped = from_urdf(arm(tmp_path / "damped.urdf", damping="0.5"))
    dampers = "its accelerations leave out the damping of slide"
    wrote = "while it read the file it wrote 'no INERTIA of x'"
    for scene, undamped, line, acceleration, other in (
        (still, True, "", "", ""),
        (damped, False, "", "", ""),
        (damped, True, "", dampers, ""),
        (damped, True, "a word\nno INERTIA of x\nno inertia of y", dampers, wrote),
        (still, True, "no INERTIA of x", wrote, wrote),
        (still, True, "another word", "", ""),
    ):
        one = silent(names, scene, undamped=undamped, line=line)
        told = one.leaves_out("acceleration"), one.leaves_out("bias")
        assert told == (acceleration, other)
        assert one.library_output == [x for x in line.splitlines() if x]


def test_accelerations_come_of_the_librarys_terms_and_joints_that_follow_are_eliminated(tmp_path):
    q, v = np.array([0.5, -1.0, 2.0]), np.array([1.0, 3.0, -2.0])
    nothing = np.full(3, np.nan), None, None
    free = silent(["shoulder", "slide", "wrist"], from_urdf(arm(tmp_path / "free.urdf")))
    vdot, multipliers = free.acceleration(q, v, *nothing)
    assert multipliers is None
    assert vdot == pytest.approx((3 * q - v * v) / [2, 3, 4])
    geared = (
        arm(tmp_path / "geared.urdf")
        .read_text()
        .replace(
            '<axis xyz="0.6 0 0.8"/>',
            '<axis xyz="0.6 0 0.8"/><mimic joint="slide" multiplier="3"/>',
        )
    )
    (tmp_path / "geared.urdf").write_text(geared, encoding="utf-8")
    one = silent(["shoulder", "slide", "wrist"], from_urdf(tmp_path / "geared.urdf"))
    vdot, multipliers = one.acceleration(q, v, *nothing)
    # The wrist turns three times: 3 ẍ + 3 (4 (3 ẍ)) of the slide, forces likewise.
    slide = (-3 - 9 + 3 * (6 - 4)) / (3 + 9 * 4)
    assert vdot == pytest.approx([(1.5 - 1) / 2, slide, 3 * slide])
    assert multipliers is None


# ---- A free base ---------------------------------------------------------------------------------


def test_a_base_is_turned_about_z_then_y_then_x_and_its_velocities_are_by_hand():
    q = np.array([1.0, 2.0, 3.0, np.pi / 2, 0.0, 0.0])
    v = np.array([0.1, 0.2, 0.3, 2.0, 3.0, 5.0])
    base = free_base(q, v, np.array([1.0, 0.0, 0.0]), np.diag([1.0, -1.0, -1.0]))
    near: Any = lambda x: pytest.approx(np.array(x, float), abs=1e-15)  # noqa: E731
    assert base.position == near([1, 3, 3])
    assert near([[0, 1, 0], [1, 0, 0], [0, 0, -1]]) == base.R
    # A quarter turn about z: y points to -x, x to y.
    assert base.angular == near(np.column_stack([np.zeros((3, 3)), [0, 0, 1], [-1, 0, 0],
                                                 [0, 1, 0]]))  # fmt: skip
    assert base.linear[:, :3] == near(np.eye(3))
    # The arm is (0, 1, 0): z × y = -x, -x × y = -z, y × y = 0.
    assert base.linear[:, 3:] == near([[-1, 0, 0], [0, 0, 0], [0, -1, 0]])
    # 2 z × (-3 x) = -6 y, 2 z × 5 y = -10 x, -3 x × 5 y = -15 z.
    assert base.angular_rest == near([-10, -6, -15])
    omega = np.array([-3.0, 5.0, 2.0])
    arm_ = np.array([0.0, 1.0, 0.0])
    alpha = np.array([-10.0, -6.0, -15.0])
    assert base.linear_rest == near(np.cross(alpha, arm_) + np.cross(omega, np.cross(omega, arm_)))
    plain = free_base(q, v)
    assert plain.position.tolist() == [1, 2, 3] and not plain.linear[:, 3:].any()
    assert near([[0, -1, 0], [1, 0, 0], [0, 0, 1]]) == plain.R


@pytest.mark.parametrize(
    ("angles", "quaternion"),
    [
        ((0.3, 0.0, 0.0), (np.cos(0.15), 0.0, 0.0, np.sin(0.15))),
        ((0.0, 0.4, 0.0), (np.cos(0.2), 0.0, np.sin(0.2), 0.0)),
        ((0.0, 0.0, 2.8), (np.cos(1.4), np.sin(1.4), 0.0, 0.0)),
        ((0.0, 2.8, 0.0), (np.cos(1.4), 0.0, np.sin(1.4), 0.0)),
        ((2.8, 0.0, 0.0), (np.cos(1.4), 0.0, 0.0, np.sin(1.4))),
        ((-2.8, 0.0, 0.0), (-np.cos(1.4), 0.0, 0.0, np.sin(1.4))),
        ((np.pi, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)),
    ],
)
def test_a_quaternion_is_found_wherever_its_largest_part_is(angles, quaternion):
    found = free_base(np.array([0.0, 0.0, 0.0, *angles]), np.zeros(6)).quaternion
    assert found == pytest.approx(np.array(quaternion), abs=1e-15)
    assert np.linalg.norm(found) == pytest.approx(1.0, abs=1e-15)


def test_a_velocity_of_a_base_is_told_in_the_order_of_the_library():
    ground, base = "velocity along the axes of the ground", "velocity along the axes of the base"
    assert str(BaseVelocity("ground", "base")) == f"linear {ground}, then angular {base}"
    assert str(BaseVelocity("ground", "base", True)) == f"angular {base}, then linear {ground}"


def test_libraries_have_these_velocities_and_coordinates_of_a_free_base():
    readers = asked_by_default(READERS)
    told = {key: tuple(kind.base_velocity) for key, kind in readers.items()}
    assert told == {
        "pinocchio": ("base", "base", False),
        "mujoco": ("ground", "base", False),
        "drake": ("ground", "ground", True),
        "idyntree": ("ground", "ground", False),
        "pybullet": ("base", "base", True),
    }
    assert {key for key, kind in readers.items() if kind.undamped} == {"pinocchio"}
    base = free_base(np.array([1.0, 2.0, 3.0, 0.3, -0.7, 1.1]), np.zeros(6))
    (w, x, y, z), place, R = base.quaternion, [1.0, 2.0, 3.0], base.R.ravel().tolist()
    assert PinocchioFile.pose(None, base).tolist() == [*place, x, y, z, w]  # type: ignore
    assert MujocoFile.pose(None, base).tolist() == [*place, w, x, y, z]  # type: ignore
    assert READERS["drake"].pose(None, base).tolist() == [w, x, y, z, *place]  # type: ignore
    assert IdyntreeFile.pose(None, base).tolist() == [*place, *R]  # type: ignore
    assert PybulletFile.pose(None, base).tolist() == [*place, x, y, z, w, *R]  # type: ignore


# ---- Answers of libraries ------------------------------------------------------------------------


def engine_of(key: str, scene: Any) -> Any:
    try:
        READERS[key].version()
    except EngineError as error:
        pytest.skip(str(error))
    return READERS[key](scene)


def assert_terms(scene: Any, answers: Answers, undamped: bool, accelerates: bool) -> None:
    """Assert that M, B, Q and accelerations are ours; undamped: Q but for the dampers."""
    random = np.random.default_rng(7)
    for _ in range(2):
        q, v = random.uniform(-1.1, 1.1, scene.n), random.uniform(-2.0, 2.0, scene.n)
        M, Q, B, *_ = Evaluation(scene, q, v).terms
        at_rest = Evaluation(scene, q, 0 * v).terms.Q
        found = {
            "M": (answers.mass_matrix(q), M),
            "B": (answers.bias(q, v), B),
            "Q": (answers.forces(q, v), at_rest if undamped else Q),
        }
        if accelerates:
            vdot = answers.acceleration(q, v, np.full(scene.n, np.nan), None, None).vdot
            found["v̇"] = vdot, np.linalg.solve(M, (at_rest if undamped else Q) - B)
        for name, (theirs, ours) in found.items():
            assert np.abs(theirs - ours).max() <= 2e-11 * np.abs(ours).max(), name


@pytest.mark.parametrize("key", asked_by_default(READERS))
@pytest.mark.parametrize("floating", [False, True])
@pytest.mark.parametrize("more", ["", FINGERS])
def test_every_library_that_reads_a_file_has_our_terms_and_accelerations(
    key: str, floating: bool, more: str, tmp_path: Path
):
    path = arm(tmp_path / "arm.urdf", more=more, damping="0.4")
    turned = body("base").replace('rpy="0 0 0"', 'rpy="0.4 -0.3 0.2"')
    path.write_text(path.read_text().replace('<link name="base"/>', turned), encoding="utf-8")
    scene = from_urdf(path, floating=floating, gravity=(1.0, -2.0, -9.0))
    engine = engine_of(key, scene)
    undamped = key in ("idyntree", "pybullet")
    # Pinocchio's own accelerations leave the dampers out, that of joints that follow do not.
    assert_terms(scene, Answers(engine), undamped, key != "pinocchio" or bool(more))
    assert engine.version().startswith(f"{key} ")


MJCF = """
<mujoco><compiler angle="radian"/><option gravity="1 -2 -9"/><worldbody>
  <body pos="1 2 3"><joint name="hinge" axis="0.6 0 0.8" damping="0.4" stiffness="2" ref="0.1"/>
    <geom type="box" size="0.1 0.2 0.3" pos="0.1 0.2 0"/>
    <body pos="0.5 0 0.2" euler="0.3 0.2 0.1"><joint name="ball" type="ball"/>
      <geom type="box" size="0.2 0.1 0.3" pos="0.3 0.1 0"/>
      <body pos="0 0.5 0"><joint name="slide" type="slide" axis="1 0 0" armature="0.3"/>
        <geom type="capsule" size="0.1 0.2" pos="0.1 0.2 0.3"/></body></body></body>
  <body><freejoint name="free"/><geom type="box" size="0.1 0.2 0.3" pos="0.1 0.2 0"/></body>
</worldbody>MORE</mujoco>
"""


def mjcf(path: Path, more: str = "") -> Any:
    pytest.importorskip("mujoco")
    path.write_text(MJCF.replace("MORE", more), encoding="utf-8")
    return from_mjcf(path)


def test_mujoco_has_our_terms_of_balls_and_free_bodies_in_coordinates_of_its_own(tmp_path: Path):
    scene = mjcf(tmp_path / "robot.xml")
    engine = MjcfFile(scene)
    assert_terms(scene, Answers(engine), False, True)
    q, v = np.linspace(-0.6, 0.7, 11), np.linspace(0.9, -0.8, 11)
    x, S, rest = engine.velocity_map(q, v)
    ball = free_base(np.array([0, 0, 0, *q[1:4]]), np.array([0, 0, 0, *v[1:4]]))
    free = free_base(q[5:], v[5:])
    assert x.tolist() == [q[0], *ball.quaternion, q[4], *free.position, *free.quaternion]
    whole, more = np.eye(11), np.zeros(11)
    whole[1:4, 1:4], more[1:4] = (
        part[3:] if part.ndim == 1 else part[3:, 3:]
        for part in ball.velocity(BaseVelocity("ground", "base"), np.array([0, 0, 0, *v[1:4]]))
    )
    whole[5:, 5:], more[5:] = free.velocity(BaseVelocity("ground", "base"), v[5:])
    np.testing.assert_allclose(S, whole, atol=1e-15)
    np.testing.assert_allclose(rest, more, atol=1e-15)
    assert (engine.description.damped, engine.leaves_out("acceleration")) == ({"hinge"}, "")
    assert MjcfFile.version().startswith("mujoco ")


def test_mujoco_has_the_accelerations_of_constraints_that_its_own_solver_lets_give_way(tmp_path):
    equal = '<equality><joint joint1="slide" joint2="hinge" polycoef="0.2 -1.5 0 0 0"/></equality>'
    scene = mjcf(tmp_path / "robot.xml", equal)
    q = np.linspace(-0.6, 0.7, 11)
    at = Evaluation(scene, q, np.linspace(0.9, -0.8, 11))
    M, Q, B, a, gamma, *_ = at.terms
    vdot, multipliers = Answers(MjcfFile(scene)).acceleration(at.q, at.v, Q, a, gamma)
    kkt = np.block([[M, -a.T], [a, np.zeros((1, 1))]])
    expected = np.linalg.solve(kkt, [*(Q - B), *-gamma])
    np.testing.assert_allclose([*vdot, *multipliers], expected, rtol=1e-10, atol=1e-10)
    other = scene.changed(gravity=None)
    assert MjcfFile.represents(scene) and not MjcfFile.represents(other)
    assert not MjcfFile.represents(ChainPendulum.rods(2))
    with pytest.raises(EngineError, match=r"^mujoco_mjcf cannot represent robot by its file$"):
        MjcfFile(other)


# ---- What libraries write ------------------------------------------------------------------------


def test_lines_are_kept_once_without_blanks_and_streams_come_back_after_an_exception(capfd):
    print("before")
    with pytest.raises(KeyError), capture_output() as lines:
        os.write(1, b"  two \n\n")
        os.write(2, b"\xff two\n  \ntwo\n")
        raise KeyError
    assert lines == ["two", "� two"]
    print("after")
    os.write(2, b"there\n")
    assert capfd.readouterr() == ("before\nafter\n", "there\n")


def test_a_joint_of_the_name_of_a_link_is_not_its_frame(tmp_path: Path):
    scene, q = from_urdf(arm(tmp_path / "arm.urdf")), np.array([0.3, 0.1, -0.4])
    text = (tmp_path / "arm.urdf").read_text(encoding="utf-8")
    (tmp_path / "same.urdf").write_text(text.replace('"shoulder"', '"hand"'), encoding="utf-8")
    engines = PinocchioFile(scene), PinocchioFile(from_urdf(tmp_path / "same.urdf"))
    first, second = (Answers(one).ask("frame_placement", q, q, q, "hand", 0.0) for one in engines)
    np.testing.assert_array_equal(first, second)
    assert not engines[1].has_frame("shoulder")


def test_bodies_that_stand_or_are_moved_by_commands_have_no_part_in_the_centre_of_mass(tmp_path):
    text = """<mujoco><worldbody><body pos="1 0 0"><joint axis="0 1 0"/>
    <geom type="sphere" size="0.1" pos="0 0 -1"/></body>{}</worldbody></mujoco>"""
    heavy = '<geom type="sphere" size="0.3"/></body>'
    others = "", f'<body pos="0 2 0">{heavy}', f'<body mocap="true" pos="0 2 0">{heavy}'
    centers, q = [], np.array([0.3])
    for k, other in enumerate(others):
        (tmp_path / f"{k}.xml").write_text(text.format(other), encoding="utf-8")
        answers = Answers(MjcfFile(from_mjcf(tmp_path / f"{k}.xml")))
        centers.append(answers.ask("center_of_mass", q, q, q, "", 0.0))
    np.testing.assert_allclose(centers[1:], [centers[0]] * 2, rtol=1e-15, atol=1e-15)
