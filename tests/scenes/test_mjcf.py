"""Robots from MJCF files: against MuJoCo's own model of them, and what is refused."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import eomcheck
from eomcheck.claims.proof import prove
from eomcheck.claims.run import RunSelection, ValidationRun, check_state, validate
from eomcheck.cli import app
from eomcheck.descriptions import mjcf_reader
from eomcheck.descriptions.mechanism_class import Mechanism
from eomcheck.engines import ENGINES, MjcfFile
from eomcheck.errors import EngineError, InputError
from eomcheck.evaluation.conformance import ConformancePoint
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.lab.library_comparison import compare_libraries
from eomcheck.numbers.generic import EPS
from eomcheck.scene_lookup import scene_named
from eomcheck.scenes import from_mjcf

mujoco = pytest.importorskip("mujoco")

LIMB = """
<mujoco>
  <compiler angle="radian" autolimits="true"/>
  <default><joint damping="0.3"/><default class="tilted"><geom euler="0.3 0.2 -0.4"/></default></default>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body name="trunk" pos="0.1 0.2 1.3" euler="0.2 -0.4 0.3">
      FREE
      <geom type="box" size="0.3 0.2 0.1" pos="0.05 -0.02 0.1"/>
      <body name="thigh" pos="0.3 0.1 -0.2" quat="1 0.2 -0.3 0.1" childclass="tilted">
        <joint name="abduct" axis="1 0 0.2" pos="0.05 0 0.1" ref="0.4" stiffness="2" springref="0.1"/>
        <joint name="flex" axis="0 1 0" pos="0 0.03 0.1" armature="0.02" range="-1 1"/>
        <joint name="stretch" type="slide" axis="0.3 0 1" ref="-0.2" frictionloss="0.1"/>
        <geom type="capsule" size="0.05 0.2" pos="0 0 -0.2"/>
        <body name="pack" pos="0 0.2 0.1" euler="0 0.5 0"><geom size="0.08"/></body>
        <body pos="0 0 -0.5" name="shin">
          <inertial pos="0 0.01 -0.2" mass="1.2" fullinertia="0.03 0.04 0.02 0.002 -0.003 0.001"/>
          BALL
          <geom type="mesh" mesh="no-such-file"/>
          <body pos="0.02 0 -0.4"><joint axis="0 1 0" name="toe"/><geom size="0.1 0.04 0.02" type="box"/></body>
        </body>
      </body>
    </body>
  </worldbody>
  <asset><mesh name="no-such-file" file="nowhere.stl"/></asset>
  <actuator><motor joint="flex" gear="3"/></actuator>
  <sensor><jointpos joint="flex"/></sensor>
</mujoco>
"""  # noqa: E501


def limb(path: Path, free: bool = True, ball: bool = True) -> Path:
    """Write the limb, free or on a hinge, its knee a ball or a hinge; return `path`."""
    base = '<freejoint name="root"/>' if free else '<joint name="root" axis="0 0 1"/>'
    knee = f'<joint name="knee" {"type" if ball else "class"}="{"ball" if ball else "main"}"'
    knee += ' damping="0" pos="0 0 0.02"/>'
    path.write_text(LIMB.replace("FREE", base).replace("BALL", knee), encoding="utf-8")
    return path


PENDULUM_ON_A_BALL = """
<mujoco><worldbody><body><joint name="arm" axis="0 1 0"/><geom size="0.1 0.2 0.1" type="box" pos="0.2 0 0"/>
  <body pos="0.5 0 0" euler="20 10 30"><joint name="ball" type="ball" armature="0.4"/>
  <geom type="box" size="0.1 0.2 0.3" pos="0 0.1 0.2"/></body></body></worldbody></mujoco>
"""  # noqa: E501


# ---- What is read --------------------------------------------------------------------------------


@pytest.mark.parametrize("free", [False, True])
@pytest.mark.parametrize("ball", [False, True])
def test_a_robot_agrees_with_mujoco_s_own_model_to_rounding(tmp_path: Path, free, ball):
    scene = from_mjcf(limb(tmp_path / "limb.xml", free, ball))
    assert scene.n == (6 if free else 1) + 3 + (3 if ball else 1) + 1
    claims = "mass-matrix", "bias", "generalized-forces", "engine-acceleration"
    found = validate(scene, examples=15, engines=[MjcfFile], formulations=["gw"], claims=claims)
    assert {(one.claim, one.verdict) for one in found} == {(name, "passed") for name in claims}
    found = compare_libraries(scene, states=5)
    assert found.libraries["mujoco"].verdict == "agrees"
    assert all(table.max() < 1e-12 for table in found.differences.values())


def several(path: Path, of_root: str, of_knee: str) -> Path:
    """Write the limb with attributes of its free joint and of its ball; return `path`."""
    text = limb(path, True, True).read_text()
    text = text.replace('damping="0" pos="0 0 0.02"', f'{of_knee} pos="0 0 0.02"')
    root = f'<joint type="free" name="root" {of_root}/>'
    path.write_text(text.replace('<freejoint name="root"/>', root))
    return path


def test_a_free_and_a_ball_joint_are_damped_as_mujoco_damps_them(tmp_path: Path):
    scene = from_mjcf(several(tmp_path / "limb.xml", 'damping="0.7"', 'damping="0.4"'))
    assert scene.damping.tolist() == [0.7, 0.3, 0.3, 0.3, 0.4, 0.3]
    assert not scene.conserves_energy
    claims = "generalized-forces", "engine-acceleration", "power-balance"
    found = validate(scene, examples=10, engines=[MjcfFile], formulations=["gw"], claims=claims)
    assert {(one.claim, one.verdict) for one in found} == {(name, "passed") for name in claims}
    assert {one.verdict for one in prove(scene, points=1)} == {"passed"}


def test_a_free_and_a_ball_joint_have_the_springs_that_mujoco_gives_them(tmp_path: Path):
    """Along the shortest rotation from rest, which is that of the file's pose."""
    scene = from_mjcf(several(tmp_path / "limb.xml", 'stiffness="7"', 'stiffness="3"'))
    assert scene.stiffness.tolist() == [7.0, 7.0, 7.0, 2.0]
    assert scene.gimbal_stiffness.tolist() == [7.0, 3.0]
    claims = "generalized-forces", "engine-acceleration", "power-balance"
    found = validate(scene, examples=10, engines=[MjcfFile], formulations=["gw"], claims=claims)
    assert {(one.claim, one.verdict) for one in found} == {(name, "passed") for name in claims}
    rest, still = scene.initial_state()
    states = [rest, rest + 1e-9, rest + 1e-4, rest + 0.01]
    for q in states:  # smooth where θ / sin θ is 0 / 0
        found = check_state(scene, q, still, formulations=["gw"], engines=[MjcfFile])
        assert {one.verdict for one in found if one.claim in claims} == {"passed"}


@pytest.mark.parametrize("turns", [0.0, 1e-9, 0.3, 2.0, 3.0, 3.14])
def test_a_ball_s_spring_has_the_energy_of_its_angle_to_rounding(tmp_path: Path, turns: float):
    (tmp_path / "ball.xml").write_text(PENDULUM_ON_A_BALL.replace("armature", "stiffness"))
    scene = from_mjcf(tmp_path / "ball.xml").changed(gravity=None)
    at = Evaluation(scene, np.array([0.7, turns, 0.0, 0.0]), np.zeros(4))
    energy = scene.potential(at.parameters, at.prepared, at.q)
    # The angle is in a cosine, twice near half a turn: so a small one has half the digits.
    assert energy == pytest.approx(0.2 * turns**2, rel=1e-12, abs=64 * EPS * 0.4)


def test_the_spring_of_a_ball_is_proved_in_every_formulation_and_quantity(tmp_path: Path):
    (tmp_path / "ball.xml").write_text(PENDULUM_ON_A_BALL.replace("armature", "stiffness"))
    found = prove(from_mjcf(tmp_path / "ball.xml"), points=1)
    assert {one.verdict for one in found} == {"passed"}
    assert {"generalized-forces", "power-balance", "weight-gradient"} <= {x.claim for x in found}


def test_a_free_and_a_ball_joint_have_the_armature_that_mujoco_gives_them(tmp_path: Path):
    """It is added to M in MuJoCo's velocities; here the turns of a ball are not perpendicular."""
    scene = from_mjcf(several(tmp_path / "limb.xml", 'armature="0.7"', 'armature="0.3"'))
    assert scene.armature.tolist() == [0.7, 0.7, 0.7, 0.7, 0.02, 0.3]
    tree = scene.tree()
    assert tree.gimbal_armature[[5, 11]].tolist() == [0.7, 0.3]
    assert not ENGINES["pinocchio"].represents(scene)
    dynamics = "inverse-dynamics", "forward-dynamics", "kinetic-energy", "momentum"
    claims = "mass-matrix", "bias", "engine-acceleration", *(f"engine-{x}" for x in dynamics)
    found = validate(scene, examples=5, engines=[MjcfFile], formulations=["gw"], claims=claims)
    assert {(one.claim, one.verdict) for one in found} == {(name, "passed") for name in claims}


def test_the_armature_of_a_ball_is_proved_in_every_formulation_and_quantity(tmp_path: Path):
    (tmp_path / "ball.xml").write_text(PENDULUM_ON_A_BALL)
    scene = from_mjcf(tmp_path / "ball.xml")
    found = prove(scene, points=1)
    assert {one.verdict for one in found} == {"passed"}
    assert {"coriolis-identities", "regressor-identity"} <= {one.claim for one in found}
    of_formulations = {one.subject for one in found if one.claim == "equations-residual"}
    assert {"au", "kane", "gw"} <= of_formulations


def test_a_tree_by_hand_may_have_the_rotor_of_a_ball(tmp_path: Path):
    (tmp_path / "ball.xml").write_text(PENDULUM_ON_A_BALL)
    scene = from_mjcf(tmp_path / "ball.xml")

    class Own(type(scene)):
        def tree(self):
            return own

    claims = "coriolis-identities", "regressor-identity"
    tree = scene.tree()
    for factor, failing in (1.0, set()), (1.1, {*claims}):
        own = tree._replace(gimbal_armature=factor * tree.gimbal_armature)
        found = validate(Own(), examples=2, formulations=["gw"], claims=claims, engines=[])
        assert {one.claim for one in found if one.verdict == "failed"} == failing
        assert {one.claim for one in found} == {*claims}
    own = tree._replace(gimbal_armature=np.roll(tree.gimbal_armature, 1))
    with pytest.raises(InputError, match=r"gimbal_armature\[0\] ends the turns"):
        validate(Own(), examples=1, formulations=["gw"], claims=claims, engines=[])


@pytest.mark.night
@pytest.mark.parametrize("name", ["tendon-of-three", "tendons"])
def test_coupled_coordinates_of_tendons_are_proved(tmp_path: Path, name: str):
    (tmp_path / "loop.xml").write_text(LOOP.replace("EQUALITY", EQUALITIES[name][0]))
    scene = from_mjcf(tmp_path / "loop.xml")
    assert {one.verdict for one in prove(scene, points=1)} == {"passed"}
    run = ValidationRun()
    run.validate_scene(scene, RunSelection.of(scenes=[scene]), 1, 0)
    assert [str(one) for one in run.findings if one.verdict == "failed"] == []


def test_replicated_and_attached_bodies_and_plugins_of_actuators_are_compiled(tmp_path: Path):
    (tmp_path / "leg.xml").write_text(f"<mujoco><worldbody>{BODY}</worldbody></mujoco>")
    (tmp_path / "all.xml").write_text(
        '<mujoco><extension><plugin plugin="mujoco.pid"/></extension><asset><model name="leg" '
        'file="leg.xml"/></asset><worldbody><replicate count="3" offset="1 0 0"><body name="pod">'
        '<joint name="hip" axis="0 1 0"/><geom size="0.1" pos="0 0 -0.3"/></body></replicate><body '
        'name="base"><joint type="slide"/><geom size="0.2"/><attach model="leg" prefix="left_"/>'
        '<attach model="leg" prefix="right_"/></body></worldbody><actuator><plugin '
        'plugin="mujoco.pid" joint="hip0"><config key="kp" value="1"/></plugin></actuator></mujoco>'
    )
    scene = from_mjcf(tmp_path / "all.xml")
    assert scene.coordinate_names == ("hip0", "hip1", "hip2", "joint3", "left_j", "right_j")
    assert compare_libraries(scene, states=2).libraries["mujoco"].verdict == "agrees"


def test_frames_are_those_of_the_bodies_of_the_file(tmp_path: Path):
    """Whatever points their joints are at; links between two joints of a body have none."""
    scene = from_mjcf(limb(tmp_path / "limb.xml", True, True))
    engine = MjcfFile(scene)
    names = [x.name for x in scene.tree().frames]
    model = engine.model
    assert sorted(names) == sorted(model.body(i).name or f"body{i}" for i in range(model.nbody))
    q = scene.initial_state()[0] + np.random.default_rng(4).uniform(-0.6, 0.6, scene.n)
    engine.data.qpos[:] = engine.velocity_map(q, np.zeros(scene.n)).x
    mujoco.mj_kinematics(model, engine.data)
    assert model.jnt_pos.any()
    for i in range(model.nbody):
        ours = eomcheck.quantity(
            scene, "frame_placement", q, frame=model.body(i).name or f"body{i}"
        )
        theirs = np.column_stack((engine.data.xmat[i].reshape(3, 3), engine.data.xpos[i]))
        assert np.abs(ours - theirs).max() < 1e-13


def test_frames_and_their_motions_agree_with_those_of_mujoco(tmp_path: Path):
    scene = from_mjcf(limb(tmp_path / "limb.xml", True, True))
    about = "placement", "velocity", "jacobian", "acceleration", "bias"
    claims = [f"engine-frame-{name}" for name in about]
    found = validate(scene, examples=1, engines=[MjcfFile], formulations=["gw"], claims=claims)
    passed = [(one.claim, *one.subject.split(", ")) for one in found if one.verdict == "passed"]
    for claim in claims:
        links = {link for id, engine, link in passed if (id, engine) == (claim, MjcfFile.key)}
        assert {"trunk", "thigh", "pack", "shin"} <= links
    assert not [one for one in found if one.verdict not in ("passed", "skipped")]


def test_a_regressor_is_about_the_frames_of_bodies(tmp_path: Path):
    """Its parameters are m, m c and the inertia about the origin of the body in the file."""
    scene = from_mjcf(limb(tmp_path / "limb.xml", False, False))
    model = MjcfFile(scene).model
    at = ConformancePoint(Evaluation(scene, *scene.initial_state()))
    shin = at.model.bodies.index("shin")
    mass, *moments = at.regressor.parameters[10 * shin : 10 * shin + 4]
    body = model.body("shin")
    assert mass == 1.2
    assert np.allclose(np.array(moments) / mass, body.ipos, atol=1e-15)


def test_numbers_that_look_like_a_mistake_are_named(tmp_path: Path):
    path = limb(tmp_path / "limb.xml", True, False)
    axes = "Axes that are no unit vectors: 'abduct', 'stretch'."
    assert from_mjcf(path).source.warnings == axes
    text = path.read_text().replace('pos="0 0.01 -0.2" mass="1.2"', 'pos="0 0.01 -20" mass="1.2"')
    path.write_text(text.replace('euler="0.2 -0.4 0.3"', 'euler="0.2 -40 0.3"'))
    far = "Out of proportion with the size of the link: far center of mass of 'shin'."
    degrees = "Angles of more than 2π rad, in degrees? 'trunk'."
    assert from_mjcf(path).source.warnings == f"{far} {degrees} {axes}"
    path.write_text(path.read_text().replace('angle="radian"', ""))
    assert from_mjcf(path).source.warnings == f"{far} {axes}"


def test_it_starts_where_the_file_draws_it(tmp_path: Path):
    scene = from_mjcf(limb(tmp_path / "limb.xml"))
    q, v = scene.initial_state()
    model = mjcf_reader.compile_model(tmp_path / "limb.xml")[0]
    assert MjcfFile(scene).velocity_map(q, v).x == pytest.approx(model.qpos0, abs=1e-15)
    assert not v.any()


def test_what_is_left_out_is_said_in_one_sentence(tmp_path: Path):
    scene = from_mjcf(limb(tmp_path / "limb.xml"))
    assert scene.source.ignored == (
        "Ignored: actuators (1), friction of joints (1), limits of joints (1), sensors (1), "
        "shapes to collide (6)."
    )
    assert "no-such-file" in (tmp_path / "limb.xml").read_text()  # a mesh that is not looked for


@pytest.mark.parametrize(("contype", "conaffinity"), [(0, 0), (1, 0), (0, 2), (1, 2)])
def test_a_shape_collides_if_either_of_its_masks_is_set(tmp_path: Path, contype, conaffinity):
    masks = f'contype="{contype}" conaffinity="{conaffinity}"'
    path = tmp_path / "shape.xml"
    body = f'<body><joint/><geom size="0.1" {masks}/></body>'
    path.write_text(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    collides = "Ignored: shapes to collide (1)."
    assert from_mjcf(path).source.ignored == (collides if contype or conaffinity else "")


@pytest.mark.parametrize("fluid", ["", 'density="1.2"', 'viscosity="1e-5"'])
def test_the_drag_of_a_fluid_is_left_out_whether_dense_or_viscous(tmp_path: Path, fluid: str):
    body = '<body><joint/><geom size="0.1" contype="0" conaffinity="0"/></body>'
    path = tmp_path / "wet.xml"
    path.write_text(f"<mujoco><option {fluid}/><worldbody>{body}</worldbody></mujoco>")
    said = from_mjcf(path).source.ignored
    assert said == ("Ignored: drag of a fluid (1)." if fluid else "")


def test_every_identity_is_proved(tmp_path: Path):
    found = prove(from_mjcf(limb(tmp_path / "limb.xml", ball=False)), points=1)
    assert {one.verdict for one in found} == {"passed"}


def test_gravity_is_that_of_the_file_unless_another_is_asked_for(tmp_path: Path):
    path = limb(tmp_path / "limb.xml")
    assert from_mjcf(path).gravity.tolist() == [0, 0, -9.81]  # type: ignore[attr-defined]
    assert repr(from_mjcf(path)) == f"from_mjcf({str(path)!r})"
    without = from_mjcf(path, gravity=None)
    assert without.gravity is None  # type: ignore[attr-defined]
    assert repr(without) == f"from_mjcf({str(path)!r}, gravity=None)"
    own = from_mjcf(path, gravity=(1, 2, 3))
    assert own.gravity.tolist() == [1, 2, 3]  # type: ignore[attr-defined]
    assert repr(own) == f"from_mjcf({str(path)!r}, gravity=(1.0, 2.0, 3.0))"
    path.write_text(path.read_text().replace("<worldbody>", FLAGS + "<worldbody>", 1))
    off = from_mjcf(path)
    assert (off.gravity, getattr(off, "damping", None)) == (None, None)  # type: ignore[attr-defined]


FLAGS = '<option><flag gravity="disable" damper="disable"/></option>'


# ---- Equalities ----------------------------------------------------------------------------------

LOOP = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body name="a" pos="0.1 0 0">
      <joint name="a1" axis="0 1 0.1" pos="0 0.02 0"/><joint name="a2" axis="1 0 0" ref="0.2"/>
      <geom size="0.1 0.05 0.2" type="box" pos="0.1 0 0"/><site name="s" pos="0.2 0.1 0" euler="0.1 0 0.3"/>
      <body name="b" pos="0.4 0 0.1" euler="0.2 0.3 0.1">
        <joint name="b1" axis="0 1 0" pos="0 0 0.05"/><joint name="b2" axis="0 0 1"/>
        <joint name="b3" axis="1 0 0"/><geom size="0.1"/>
      </body>
    </body>
    <body name="c" pos="0.5 0.3 0.2" euler="0.3 0.1 0.2"><freejoint name="c"/><geom size="0.1 0.2 0.1" type="box"/>
      <site name="t" pos="0.1 0 0.2" euler="0 0.4 0"/>
    </body>
  </worldbody>
  <equality>EQUALITY</equality>
</mujoco>
"""  # noqa: E501


def tendons(*equalities: str, **joints: dict[str, float]) -> str:
    """Return equalities of fixed tendons, by their joints and coefficients, as elements."""
    fixed = "".join(
        f'<fixed name="{name}">'
        + "".join(f'<joint joint="{joint}" coef="{x}"/>' for joint, x in parts.items())
        + "</fixed>"
        for name, parts in joints.items()
    )
    held = "".join(f"<tendon {equality}/>" for equality in equalities)
    return f"{held}</equality><tendon>{fixed}</tendon><equality>"


EQUALITIES = {
    "connect": ('<connect body1="b" body2="c" anchor="0.1 0.05 0.02"/>', 3),
    "connect-ground": ('<connect body1="c" anchor="0.1 0.05 0.02"/>', 3),
    "connect-sites": ('<connect site1="s" site2="t"/>', 3),
    "weld": ('<weld body1="b" body2="c" anchor="0.1 0.05 0.02"/>', 6),
    "weld-elsewhere": ('<weld body1="b" body2="c" relpose="0.2 0.1 0.1 1 0.2 0.1 0"/>', 6),
    "weld-sites": ('<weld site1="s" site2="t"/>', 6),
    "joint": ('<joint joint1="a2" joint2="b1" polycoef="0.3 -1.5 0 0 0"/>', 1),
    "joint-of-one-with-a-reference": (
        '<joint joint1="b1" joint2="a2" polycoef="0.3 -1.5 0 0 0"/>',
        1,
    ),
    "joint-alone": ('<joint joint1="a2" polycoef="0.3 0 0 0 0"/>', 1),
    "tendon": (tendons('tendon1="t" polycoef="0.2 1 0 0 0"', t={"a1": 0.5, "b1": -1.5}), 1),
    "tendon-of-three": (tendons('tendon1="t"', t={"a1": 0.5, "a2": 0.8, "b1": -1.5}), 1),
    "tendon-of-one": (tendons('tendon1="t" polycoef="0.3 0 0 0 0"', t={"a2": 2.0}), 1),
    "tendons": (
        tendons(
            'tendon1="t" tendon2="u" polycoef="0.1 -0.7 0 0 0"',
            t={"a1": 0.5, "b1": 0.2},
            u={"a2": 1.2, "b1": 0.3},
        ),
        1,
    ),
}


@pytest.mark.parametrize("name", EQUALITIES)
def test_an_equality_is_held_where_mujoco_s_is_and_frees_the_same_velocities(tmp_path, name):
    text, rows = EQUALITIES[name]
    (tmp_path / "loop.xml").write_text(LOOP.replace("EQUALITY", text))
    scene = from_mjcf(tmp_path / "loop.xml")
    assert scene.r == rows
    q, _ = scene.initial_state()
    a = Evaluation(scene, q, np.zeros(scene.n)).terms.a
    x, S, _ = MjcfFile(scene).velocity_map(q, np.zeros(scene.n))
    model = mjcf_reader.compile_model(tmp_path / "loop.xml")[0]
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    data = mujoco.MjData(model)
    data.qpos[:] = x
    mujoco.mj_forward(model, data)
    theirs = data.efc_J.reshape(data.nefc, model.nv)[:rows] @ S
    assert np.abs(data.efc_pos[:rows]).max() < 1e-9
    assert np.linalg.matrix_rank(a, 1e-9) == rows
    assert np.linalg.matrix_rank(np.vstack([a, theirs]), 1e-9) == rows


def test_what_is_held_is_compared_as_it_is_held():
    scene = from_mjcf(Path("docs/guides/rocker.xml"))
    assert scene.coordinate_names == ("rocker", "travel", "crank", "knee")  # what the gear turns
    found = compare_libraries(scene, states=5)
    assert found.libraries["mujoco"].verdict == "agrees"
    assert [one.version for one in found.answered] == [f"mujoco {mujoco.__version__}"]
    assert all(table.max() < 1e-12 for table in found.differences.values())
    assert {one.verdict for one in prove(scene, points=1)} == {"passed"}


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("<joint joint1", '<joint active="false" joint1'),
        ("<worldbody>", '<option><flag equality="disable"/></option><worldbody>'),
        ("<worldbody>", '<option><flag constraint="disable"/></option><worldbody>'),
    ],
)
def test_an_equality_that_is_not_active_is_none(tmp_path: Path, old: str, new: str):
    text = LOOP.replace("EQUALITY", EQUALITIES["joint"][0])
    assert text.count(old) == 1
    (tmp_path / "loop.xml").write_text(text.replace(old, new))
    assert from_mjcf(tmp_path / "loop.xml").r == 0


FOUR_BAR = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body name="crank" pos="0 0 0.1"><joint name="crank" axis="0 1 0" damping="0.1"/>
      <geom type="capsule" size="0.02" fromto="0 0 0 0.2 0 0"/>
      <body name="coupler" pos="0.2 0 0"><joint name="coupler" axis="0 1 0" ref="0.3"/>
        <geom type="capsule" size="0.02" fromto="0 0 0 0 0 0.3"/>
      </body>
    </body>
    <body name="rocker" pos="0.3 0 0.1">
      <joint name="rocker" axis="0 -1 0" stiffness="2" springref="0.4"/>
      <geom type="capsule" size="0.02" fromto="0 0 0 -0.1 0 0.3"/>
    </body>
  </worldbody>
  <equality>HELD</equality>
</mujoco>
"""
HELD = '<connect body1="coupler" body2="rocker" anchor="0 0 0.3"/>'
"""A pin in space, of a mechanism that stays in a plane: one of its three rows is redundant."""


def four_bar(path: Path, pins: int) -> Mechanism:
    path.write_text(FOUR_BAR.replace("HELD", pins * HELD), encoding="utf-8")
    return from_mjcf(path)


@pytest.mark.parametrize("pins", [1, 2])
def test_as_many_constraints_as_coordinates_or_more_are_validated(tmp_path: Path, pins: int):
    scene = four_bar(tmp_path / "bar.xml", pins)
    assert (scene.n, scene.r) == (3, 3 * pins)
    run, selection = ValidationRun(), RunSelection.of(scenes=[scene])
    run.validate_scene(scene, selection, 1, 0)
    assert {one.verdict for one in run.findings} >= {"passed"}
    assert [str(one) for one in run.findings if one.verdict == "failed"] == []
    assert all(one.state.v.any() for one in run.sampled)  # it still moves
    by_uk = {one.verdict for one in run.findings if one.claim == "equations-residual"}
    assert by_uk == {"passed"}
    embedded = {one.subject for one in run.findings if one.claim == "null-space-embedding"}
    assert embedded == set()


def test_more_constraints_than_coordinates_are_neither_proved_nor_disproved(tmp_path: Path):
    (found,) = prove(four_bar(tmp_path / "bar.xml", 2), points=1)
    assert found.verdict == "skipped"
    assert found.detail.startswith("6 constraints on 3 coordinates: at a random point no velocity")


# ---- What is refused -----------------------------------------------------------------------------

BODY = '<body><joint name="j"/><geom size="1"/></body>'
ENTITIES = '<!DOCTYPE x [<!ENTITY a "b">]><mujoco>&a;</mujoco>'


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is empty"),
        ("<mujoco>", "is no XML"),
        ("<robot/>", "holds <robot>, expected <mujoco>: no MJCF"),
        (ENTITIES, "declares a document type: entities are not expanded here"),
        ("<mujoco/>", "no joint"),
        (
            f"<mujoco><worldbody>{BODY * 5001}</worldbody></mujoco>",
            "5001 elements <body>, expected",
        ),
        ("<mujoco>" + "<body>" * 501 + "</body>" * 501 + "</mujoco>", "more than 500 inside each"),
        (
            f'<mujoco><worldbody><replicate count="9999">{BODY}</replicate></worldbody></mujoco>',
            "9999 of <body>, replicated and attached, expected at most 5000",
        ),
        (
            '<mujoco><worldbody><composite type="cable"/></worldbody></mujoco>',
            "holds <composite>, which MuJoCo 4 does not have either, expected bodies, joints and",
        ),
        (
            '<mujoco><worldbody><flexcomp type="grid"/></worldbody></mujoco>',
            "holds <flexcomp>, a deformable body, expected rigid ones",
        ),
        (
            "<mujoco><deformable><flex/></deformable></mujoco>",
            "holds <flex>, a deformable body, expected rigid ones",
        ),
        ('<mujoco><extension><plugin plugin="x"/></extension></mujoco>', "is refused by MuJoCo"),
        (
            '<mujoco><asset><hfield nrow="60000" ncol="9" name="h"/></asset></mujoco>',
            "nrow of <hfield> is 60000, expected at most 2000",
        ),
        (
            '<mujoco><size nuser_geom="1e9"/></mujoco>',
            "nuser_geom of <size> is 1e9, expected at most 2000",
        ),
        ('<mujoco><include file="m.xml"/></mujoco>', "includes 'm.xml' twice"),
        ('<mujoco><include file="none.xml"/></mujoco>', "none.xml' cannot be read"),
        ("<mujoco><unknown/></mujoco>", "is refused by MuJoCo"),
        (
            "<mujoco><worldbody><body><joint/></body></worldbody></mujoco>",
            "is refused by MuJoCo: Error: mass and inertia of moving bodies must be larger",
        ),
        (
            f"<mujoco><worldbody><site name='s'/>{BODY.replace('<geom', '<site/><geom')}".replace(
                "<site/>", "<site name='r'/>"
            )
            + "</worldbody><tendon><spatial name='t'><site site='s'/><site site='r'/></spatial>"
            "</tendon><equality><tendon name='e' tendon1='t'/></equality></mujoco>",
            "equality 'e' is of a tendon in space",
        ),
    ],
)
def test_a_file_that_is_not_understood_is_refused_in_one_sentence(tmp_path, text: str, said: str):
    path, start = tmp_path / "m.xml", time.perf_counter()
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as refused:
        from_mjcf(path)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)
    assert time.perf_counter() - start < 10.0
    ran = CliRunner().invoke(app, ["validate", "--scene", str(path)])
    assert isinstance(ran.exception, InputError)


def test_an_equality_that_is_not_linear_is_refused(tmp_path: Path):
    text = EQUALITIES["joint"][0].replace("-1.5 0", "-1.5 1")
    (tmp_path / "loop.xml").write_text(LOOP.replace("EQUALITY", text))
    with pytest.raises(InputError, match="equality 'equality0' is not linear"):
        from_mjcf(tmp_path / "loop.xml")


def test_what_would_be_huge_in_memory_and_no_body_is_taken_out(tmp_path: Path):
    path, start = limb(tmp_path / "limb.xml"), time.perf_counter()
    huge = (
        '<size memory="900G" nuserdata="100000000"/><asset><texture name="t" type="2d" '
        'builtin="flat" width="60000" height="60000"/><material name="m" texture="t"/></asset>'
    )
    path.write_text(path.read_text().replace("<worldbody>", huge + "<worldbody>", 1))
    assert from_mjcf(path).n == 13
    assert time.perf_counter() - start < 5.0


def test_a_light_with_a_texture_is_read_without_it(tmp_path: Path):
    pytest.importorskip("mujoco")
    path = tmp_path / "lit.xml"
    path.write_text(
        '<mujoco><asset><texture name="t" type="2d" builtin="flat" width="8" height="8"/></asset>'
        '<worldbody><light type="image" texture="t"/><body><joint axis="0 1 0"/>'
        '<geom size="0.1" pos="0.2 0 0"/></body></worldbody></mujoco>',
        encoding="utf-8",
    )
    assert from_mjcf(path).n == 1


@pytest.mark.parametrize(
    ("bodies", "joint", "found", "read"),
    [
        (201, "<joint/>", 201, False),
        (34, "<freejoint/>", 204, True),
        (67, '<joint type="ball"/>', 201, True),
    ],
)
def test_coordinates_are_counted_before_anything_slow(
    tmp_path: Path, monkeypatch, bodies: int, joint: str, found: int, read: bool
):
    pytest.importorskip("mujoco")
    path, seen = tmp_path / "many.xml", []
    body = f'<body>{joint}<geom size="0.1"/></body>'
    path.write_text(f"<mujoco><worldbody>{body * bodies}</worldbody></mujoco>", encoding="utf-8")
    reading = mjcf_reader._read
    monkeypatch.setattr(mjcf_reader, "_read", lambda *given: seen.append(1) or reading(*given))
    monkeypatch.setattr(mjcf_reader, "_strip", lambda *_: pytest.fail("stripped"))
    with pytest.raises(InputError, match=f"many.xml': {found} coordinates, expected at most 200"):
        from_mjcf(path)
    assert bool(seen) == read


def test_200_coordinates_are_not_too_many(tmp_path: Path, monkeypatch):
    pytest.importorskip("mujoco")
    path = tmp_path / "many.xml"
    body = '<body><joint/><geom size="0.1"/></body>'
    path.write_text(f"<mujoco><worldbody>{body * 200}</worldbody></mujoco>", encoding="utf-8")
    assert mjcf_reader.compile_model(path)[0].nv == 200


def test_files_that_are_included_are_looked_through_as_well(tmp_path: Path):
    path, other = limb(tmp_path / "limb.xml"), tmp_path / "part.xml"
    other.write_text("<mujocoinclude><option gravity='0 0 -1'/></mujocoinclude>")
    path.write_text(
        path.read_text().replace("<worldbody>", '<include file="part.xml"/><worldbody>')
    )
    assert from_mjcf(path).gravity.tolist() == [0, 0, -1]  # type: ignore[attr-defined]
    other.write_text(ENTITIES)
    with pytest.raises(InputError, match=r"part\.xml' declares a document type"):
        from_mjcf(path)


@pytest.mark.parametrize("params", ["100000000 1", "1 101", "nan 1"])
def test_a_mesh_made_by_parameters_is_of_bounded_size(params: str, tmp_path: Path):
    path = limb(tmp_path / "limb.xml")
    mesh = f'<asset><mesh name="m" builtin="cone" params="{params}"/></asset>'
    path.write_text(path.read_text().replace("<worldbody>", mesh + "<worldbody>", 1))
    with pytest.raises(InputError, match="of <mesh> is"):
        from_mjcf(path)


def test_a_missing_library_is_one_sentence(tmp_path: Path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "mujoco", None)
    with pytest.raises(EngineError, match="it comes with the extra `mujoco`"):
        from_mjcf(limb(tmp_path / "limb.xml"))


def test_a_scene_is_named_by_its_file_and_says_itself_what_is_free(tmp_path: Path):
    path = limb(tmp_path / "limb.mjcf")
    assert repr(scene_named(str(path))) == f"from_mjcf({str(path)!r})"
    with pytest.raises(InputError, match=r"limb\.mjcf says itself what is free"):
        scene_named(f"{path}:floating")
    assert not MjcfFile.represents(scene_named(str(path), given={"gravity": None}))
