"""Conformance quantities that libraries offer: which, equal to ours, and planted mistakes."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.engines.offered import CLASSIC, DERIVATIVES, EXUDYN, FRAMES, OFFERED
from tests.robots import arm, body, joint
from tests.samples import ordinary, random_state

from eomcheck import check_state
from eomcheck.claims.engine_quantities import (
    BY_DIFFERENCES,
    CONFORMANCE,
    by_differences,
    frames_asked,
)
from eomcheck.claims.finding import Finding
from eomcheck.engines import Answers, Engine, EngineFault
from eomcheck.engines.casadi import CasadiEngine
from eomcheck.engines.dart import DartFile
from eomcheck.engines.drake import DrakeEngine, DrakeFile
from eomcheck.engines.exudyn import ExudynEngine
from eomcheck.engines.idyntree import IdyntreeEngine, IdyntreeFile
from eomcheck.engines.mujoco import MjcfFile, MujocoEngine, MujocoFile
from eomcheck.engines.mujoco_warp import MujocoWarpEngine, MujocoWarpMjcf
from eomcheck.engines.newton import NewtonEngine, NewtonFile, NewtonMjcf
from eomcheck.engines.pinocchio import PinocchioEngine, PinocchioFile
from eomcheck.engines.pybullet import PybulletEngine, PybulletFile
from eomcheck.evaluation.conformance import QUANTITIES, ConformancePoint
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.lab.studies.conformance import true_digits
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import EPS
from eomcheck.scenes import SCENES, from_mjcf, from_urdf

OFF_ITS_JOINT = """
<mujoco><worldbody>
  <body name="stand"><geom type="sphere" size=".2" mass="5" pos=".3 .1 .2"/>
    <body name="cart" pos=".1 .2 .3" euler="20 30 40">
      <joint name="slide" type="slide" axis="1 2 2"/>
      <geom type="box" size=".1 .2 .3" mass="2" pos=".05 0 .1"/>
      <body name="pole" pos="0 .1 .4">
        <joint name="swing" type="hinge" axis="0 1 0" pos=".02 .05 -.03"/>
        <geom type="box" size=".02 .03 .5" mass="1" pos="0 0 .4"/>
      </body>
    </body>
  </body>
  <body name="drone"><freejoint name="flight"/>
    <geom type="box" size=".1 .2 .05" mass="1"/>
    <body name="camera" pos="0 0 -.1"><joint name="gimbal" type="ball"/>
      <geom type="box" size=".03 .05 .02" mass=".2" pos="0 .01 -.05"/></body>
  </body>
</worldbody></mujoco>
"""
"""A mass that is fixed, a joint off the origin of its body, a free joint and a ball."""


def robot(
    folder: Path, *, floating: bool = False, products: bool = True, heavy: bool = False
) -> Scene:
    """Return the arm with a link that is fixed to its hand; a free or `heavy` base has mass."""
    more = body("tip") + joint("grip", "hand", "tip", "fixed", "1 0 0")
    path = arm(folder / "arm.urdf", more=more, damping="0.3")
    text = path.read_text(encoding="utf-8")
    if floating or heavy:
        text = text.replace('<link name="base"/>', body("base"))
    if not products:
        text = text.replace('ixy="0.01" ixz="-0.02" iyz="0.015"', 'ixy="0" ixz="0" iyz="0"')
    path.write_text(text, encoding="utf-8")
    return from_urdf(path, floating=floating)


def scene_of(kind: type[Engine], folder: Path, *, floating: bool = True) -> Scene:
    """Return a scene that an engine represents: a robot for those that read files."""
    if kind in (MjcfFile, MujocoWarpMjcf, NewtonMjcf):
        path = folder / "off.xml"
        # A light camera takes the digits of float32.
        heavier = '".3 .5 .2" mass="2"' if kind.unit_roundoff > EPS else '".03 .05 .02" mass=".2"'
        text = OFF_ITS_JOINT.replace('".03 .05 .02" mass=".2"', heavier)
        path.write_text(text, encoding="utf-8")
        return from_mjcf(path)
    if kind.reads_file:
        # PyBullet turns to principal axes itself, to 1e-9 to 1e-11 only.
        return robot(folder, floating=floating, products=kind is not PybulletFile)
    # Its own constraint forces have a part from the drift; those of a chain of four-bars have none.
    return ordinary(SCENES["bricard" if kind is CasadiEngine else "four-bar-chain"], 3)[0]


@pytest.fixture(scope="module", name="represented")
def represented_scenes(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Scene]:
    """Return the cached `scene_of` an engine, in a folder of its own."""

    @cache
    def represented(kind: type[Engine], floating: bool = True) -> Scene:
        return scene_of(kind, tmp_path_factory.mktemp("robot"), floating=floating)

    return represented


def findings(kind: type[Engine], scene: Scene, seed: int = 1, *names: str) -> list[Finding]:
    """Return the Findings about quantities of an engine in an ordinary state."""
    state = random_state(scene, np.random.default_rng(seed))
    claims = [f"engine-{x.replace('_', '-')}" for x in names] or CONFORMANCE
    return check_state(scene, *state, engines=[kind], claims=claims)


@pytest.mark.parametrize("kind", OFFERED | CLASSIC)
def test_an_engine_offers_what_its_library_computes(kind: type[Engine]):
    assert {name for name in QUANTITIES if kind.offers(name)} == (OFFERED | CLASSIC)[kind]


@pytest.mark.parametrize("floating", [False, True])
@pytest.mark.parametrize("kind", OFFERED)
def test_all_quantities_of_an_engine_are_ours(
    kind: type[Engine], floating: bool, represented: Callable[..., Scene]
):
    scene, passed = represented(kind, floating), []
    right = {"passed", "skipped"} | ({"inconclusive"} if kind.unit_roundoff > EPS else set())
    for seed in range(2):
        found = findings(kind, scene, seed)
        assert [str(x) for x in found if x.verdict not in right] == []
        passed.append({x.claim.removeprefix("engine-") for x in found if x.verdict == "passed"})
    exact = {name for name in OFFERED[kind] if not by_differences(kind, name)}
    every = {name.replace("_", "-") for name in exact}
    assert set.union(*passed) == every
    assert "inconclusive" in right or passed == [every] * 2


@pytest.mark.parametrize("floating", [False, True])
@pytest.mark.parametrize("kind", [MujocoEngine, MujocoFile, MjcfFile])
def test_derivatives_by_differences_are_skipped_and_have_their_digits(
    kind: type[Engine], floating: bool, represented: Callable[..., Scene]
):
    scene, name = represented(kind, floating), "inverse_dynamics_derivatives"
    (found,) = findings(kind, scene, 1, name)
    assert (found.verdict, found.detail) == ("skipped", BY_DIFFERENCES)
    at = Evaluation(scene, *random_state(scene, np.random.default_rng(1)))
    # One-sided differences have half of the digits of a double at best.
    assert 4 < dict(true_digits(at, Answers(kind(scene)), kind))[name] < 9


@pytest.mark.parametrize("floating", [False, True])
@pytest.mark.parametrize(
    "kind",
    [
        *(MujocoEngine, MujocoWarpEngine, PybulletEngine, ExudynEngine, DrakeEngine),
        *(IdyntreeEngine, NewtonEngine),
    ],
)
def test_frames_off_their_joints_are_ours(kind: type[Engine], floating: bool, tmp_path: Path):
    scene = robot(tmp_path, floating=floating)
    assert {x.name: x.p.any() for x in scene.tree().frames}["tip"]
    names = sorted(name for name in OFFERED[kind] if QUANTITIES[name].of_frame)
    found = findings(kind, scene, 1, *names)
    assert [str(x) for x in found if x.verdict != "passed"] == []
    assert {x.subject.split(", ")[-1].split(" ~ ")[0] for x in found} >= {"tip"}


def test_several_arrays_may_be_one(tmp_path: Path):
    """Side by side or stacked, and no other."""
    scene = robot(tmp_path)
    q, v, _ = random_state(scene, np.random.default_rng(1))
    names = ("inverse_dynamics_derivatives", "forward_dynamics_derivatives", "frame_placement")

    def answers(join: Callable[[Any], Any]) -> list[Any]:
        def joined(name: str) -> Callable[..., Any]:
            return lambda self, *x: join(getattr(PinocchioFile, name)(self, *x))

        kind = type("Joined", (PinocchioFile,), {name: joined(name) for name in names})
        return [Answers(kind(scene)).ask(name, q, v, np.cos(q), "hand", 0.0) for name in names]

    separate, beside = answers(tuple), answers(np.column_stack)
    assert all(map(np.array_equal, separate, beside))
    stacked = answers(lambda parts: np.stack(parts) if parts[1].ndim == 2 else parts)
    assert all(map(np.array_equal, separate, stacked))
    for parts in (np.vstack, lambda parts: np.column_stack(parts[:1]), np.concatenate):
        with pytest.raises(EngineFault, match="inverse_dynamics_derivatives returned"):
            answers(parts)


@pytest.mark.parametrize("kind", OFFERED)
def test_no_quantity_of_an_engine_keeps_what_was_asked_before(
    kind: type[Engine], represented: Callable[..., Scene]
):
    """Constraints, gravity, forces and accelerations that one method sets are gone after it."""
    scene = represented(kind)
    state, elsewhere = (random_state(scene, np.random.default_rng(seed)) for seed in (1, 2))
    engine, third = kind(scene), np.cos(np.arange(scene.n))
    frames = [x.name for x in scene.tree().frames if x.joint >= 0 and engine.has_frame(x.name)]

    def ask(engine: Engine, name: str, at: State) -> Any:
        frame = frames[-1] if name in QUANTITIES and QUANTITIES[name].of_frame else ""
        arguments = (third, frame) if name in QUANTITIES else ()
        return Answers(engine).ask(name, at.q, at.v, *arguments, at.t)

    asked = *sorted(OFFERED[kind]), "mass_matrix", "bias"
    for name in asked:
        fresh = ask(kind(scene), name, state)
        for other in asked:
            ask(engine, other, elsewhere)
            assert np.array_equal(ask(engine, name, state), fresh), (name, other)


@pytest.mark.parametrize("kind", [MujocoFile, DrakeFile, IdyntreeFile, DartFile])
def test_a_link_that_is_fixed_to_the_ground_has_no_part_in_the_centre_of_mass(
    kind: type[Engine], tmp_path: Path
):
    found = findings(kind, robot(tmp_path, heavy=True), 1, "center_of_mass", "momentum")
    assert {x.verdict for x in found} == {"passed"}


def test_the_weight_of_casadi_has_no_part_of_springs():
    scene = ordinary(SCENES["flyball-governor"], 1)[0]
    found = findings(CasadiEngine, scene, 1, "gravity", "potential_energy", "inverse_dynamics")
    assert {x.verdict for x in found} == {"passed"}


@pytest.mark.parametrize("distance, verdict", [(1e3, "passed"), (1e12, "skipped")])
def test_far_from_the_base_idyntree_is_allowed_the_inverse_of_the_locked_inertia(
    distance: float, verdict: str
):
    scene, state = ordinary(SCENES["snake"], 1)
    q = state.q + np.r_[distance, distance, np.zeros(scene.n - 2)]
    claims = ["engine-center-of-mass-jacobian", "engine-center-of-mass-acceleration"]
    found = check_state(scene, q, state.v, 0.0, engines=[IdyntreeEngine], claims=claims)
    assert {x.verdict for x in found} == {verdict}
    assert all("locked inertia" in x.detail for x in found if verdict == "skipped")


def test_idyntree_is_allowed_the_rounding_of_the_momentum_of_a_link():
    """In v × m (v + ω × c) a fast link loses ω × c, which does not cancel any more."""
    scene, _ = ordinary(SCENES["sleigh"], 1)
    v = np.array([1e20 * np.cos(1.0), 1e20 * np.sin(1.0), 1e-20])
    claims = ["bias", "engine-coriolis-matrix"]
    state = np.array([0.0, 0.0, 1.0]), v, 0.0
    found = check_state(scene, *state, engines=[IdyntreeEngine], claims=claims)
    asked = [x for x in found if "idyntree" in x.subject]
    assert {x.claim for x in asked} == set(claims)
    assert "failed" not in {x.verdict for x in asked}
    theirs = Answers(IdyntreeEngine(scene)).bias(*state)
    assert abs(theirs[2]) > 0.01, "the rounding that is allowed"


@pytest.mark.parametrize("kind", [DartFile])
def test_dart_loses_coupling_across_a_fixed_joint_in_its_inverse_of_m(
    kind: type[Engine], tmp_path: Path
):
    path = arm(
        tmp_path / "arm.urdf",
        more=body("tool") + joint("flange", "hand", "tool", "fixed", "1 0 0")
        + body("jaw") + joint("grip", "tool", "jaw", "revolute", "0 1 0"),
    )  # fmt: skip
    found = findings(kind, from_urdf(path), 1)
    wrong = {x.claim for x in found if x.verdict == "failed"}
    assert wrong == {"engine-inverse-mass-matrix"}


@pytest.mark.parametrize("kind", [DartFile])
@pytest.mark.parametrize("turn", [0.0, 2e-3, 3.0, 4.0])
def test_a_free_base_of_dart_has_a_rotation_vector(kind: type[Any], turn: float, tmp_path: Path):
    scene = robot(tmp_path, floating=True)
    v = random_state(scene, np.random.default_rng(1)).v
    q = np.array([1.0, 2.0, 3.0, turn, 0.0, 0.0, 0.1, 0.2, 0.3])
    claims = ["engine-frame-placement", "mass-matrix", "bias"]
    found = check_state(scene, q, v, 0.0, engines=[kind], claims=claims)
    own = [x for x in found if "dart" in x.subject and x.verdict != "skipped"]
    assert {(x.claim, x.verdict) for x in own} == {(claim, "passed") for claim in claims}
    x = kind(scene).velocity_map(q, v).x
    assert np.allclose(x[:3], [0, 0, turn if turn < np.pi else turn - 2 * np.pi], atol=1e-15)


# ---- Frames and coordinates that a library does not have -----------------------------------------


def test_a_link_that_mujoco_merges_with_another_has_no_frame(tmp_path: Path):
    held, free = robot(tmp_path), robot(tmp_path, floating=True)
    held_names = [x.name for x in held.tree().frames if MujocoFile(held).has_frame(x.name)]
    assert held_names == ["upper", "fore", "hand"]
    assert MujocoFile(free).has_frame("tip")
    with pytest.raises(EngineFault, match="no frame of link 'tip'"):
        q = np.zeros(held.n)
        Answers(MujocoFile(held)).ask("frame_placement", q, q, q, "tip", 0.0)
    found = findings(MujocoFile, held, 1, "frame_velocity")
    skipped, *passed = found
    assert skipped.detail == "its model has no frame of link base, tip"
    assert {x.subject.split(", ")[-1].split(" ")[0] for x in passed} == {"upper", "fore", "hand"}
    assert (skipped.verdict, {x.verdict for x in passed}) == ("skipped", {"passed"})


def test_a_link_that_one_of_two_engines_lacks_is_skipped_for_that(tmp_path: Path):
    scene = robot(tmp_path)
    state = random_state(scene, np.random.default_rng(1))
    claims = ["engine-frame-placement"]
    found = check_state(scene, *state, engines=[MujocoFile, PybulletFile], claims=claims)
    skipped = [x for x in found if x.verdict == "skipped"]
    assert {x.detail for x in skipped} == {"its model has no frame of link base, tip"}
    assert {x.subject for x in skipped} == {"mujoco_file"}
    assert any("tip" in x.subject and x.verdict == "passed" for x in found)


@pytest.mark.parametrize(
    "kind", [PinocchioFile, MujocoFile, DrakeFile, IdyntreeFile, PybulletFile, DartFile, NewtonFile]
)
@pytest.mark.parametrize("root", ["base", "world", "free"])
def test_a_link_on_the_ground_that_a_library_lacks_is_no_fault(kind, root: str, tmp_path: Path):
    scene = robot(tmp_path, floating=root == "free")
    if root == "world":
        file = tmp_path / "arm.urdf"
        file.write_text(file.read_text(encoding="utf-8").replace('"base"', '"world"'))
        scene = from_urdf(file)
    engine, q = kind(scene), np.zeros(scene.n)
    lacks = [x.name for x in scene.tree().frames if not Answers(engine).has_frame(x.name)]
    for link in lacks:
        with pytest.raises(EngineFault, match=link):
            Answers(engine).ask("frame_placement", q, q, q, link, 0.0)
    found = findings(kind, scene, 1, "frame_placement", "frame_velocity", "frame_jacobian")
    assert {x.verdict for x in found} - {"skipped"} == {"passed"}, found
    skipped = [x.claim for x in found if x.verdict == "skipped"]
    assert len(skipped) == len(set(skipped)) <= 3 * len(lacks)
    if root == "free":
        assert lacks == ["the ground"]


def test_links_are_asked_of_those_that_are_known_and_of_all_if_none_is():
    scene, state = ordinary(SCENES["snake"], 1)
    at = Evaluation(scene, *state)
    point = ConformancePoint(at)
    assert set(frames_asked(at, point, lambda name: name in ("link 2", "link 3"))) == {
        "link 2",
        "link 3",
    }
    assert frames_asked(at, point, lambda name: False) == frames_asked(at, point)
    assert len(frames_asked(at, point)) <= 3


def test_an_engine_that_cannot_say_which_frames_it_has_is_asked_for_them_all_the_same():
    class Silent(PybulletEngine):
        def has_frame(self, f):
            raise ValueError(f)

    Silent.key = "silent"
    scene, _ = ordinary(SCENES["snake"], 1)
    assert Answers(Silent(scene)).has_frame("nowhere") is True
    assert {x.verdict for x in findings(Silent, scene, 1, "frame_placement")} == {"passed"}


def test_inverses_are_skipped_where_joints_follow_others_in_one_model_alone(tmp_path: Path):
    more = '<mimic joint="slide" multiplier="0.5"/>'
    path = arm(tmp_path / "arm.urdf", more=body("tip") + joint("b", "hand", "tip", "revolute",
                                                              "1 0 0", more))  # fmt: skip
    found = findings(MujocoFile, from_urdf(path), 1)
    skipped = {x.claim for x in found if x.verdict == "skipped" and "follow others" in x.detail}
    assert skipped == {"engine-forward-dynamics", "engine-inverse-mass-matrix"}
    assert not [str(x) for x in found if x.verdict == "failed"]


@pytest.mark.parametrize(
    "kind", [PinocchioFile, MujocoFile, DrakeFile, IdyntreeFile, DartFile, NewtonFile]
)
def test_a_base_that_is_fixed_at_an_angle_to_a_root_without_mass_stays_there(kind, tmp_path: Path):
    path = tmp_path / "turned.urdf"
    path.write_text(
        '<robot name="turned"><link name="root"/>'
        + body("base")
        + body("upper", mass=2.0)
        + joint("held", "root", "base", "fixed", "1 0 0")
        + joint("shoulder", "base", "upper", "revolute", "0 1 0")
        + "</robot>",
        encoding="utf-8",
    )
    found = findings(kind, from_urdf(path), 1)
    assert not [str(x) for x in found if x.verdict == "failed"]
    assert "engine-frame-placement" in {x.claim for x in found if x.verdict == "passed"}


# ---- Mistakes ------------------------------------------------------------------------------------


def answered(name: str, change: Callable[[Any, Engine], Any]):
    """Return a fault that changes the result of one method."""

    def plant(kind: type[Any]) -> type[Engine]:
        def faulty(self, *arguments):
            return change(getattr(kind, name)(self, *arguments), self)

        return type("Faulty", (kind,), {name: faulty})

    return plant


MISTAKES = [
    *((name, "angular first", lambda x, _: np.roll(x, 3, axis=0)) for name in EXUDYN & FRAMES
      if name != "frame_placement"),
    ("gravity", "other sign", lambda x, _: -x),
    ("frame_placement", "R transposed", lambda x, _: (x[0].T, x[1])),
    ("frame_jacobian", "angular first", lambda x, _: np.roll(x, 3, axis=0)),
    ("inverse_dynamics", "half", lambda x, _: x / 2),
    ("forward_dynamics", "other sign", lambda x, _: -x),
    ("inverse_mass_matrix", "single precision", lambda x, _: np.float64(np.float32(x))),
    ("kinetic_energy", "without the half", lambda x, _: 2 * x),
    ("potential_energy", "other sign", lambda x, _: -x),
    ("center_of_mass_jacobian", "columns in another order", lambda x, _: x[:, ::-1]),
    ("momentum", "angular first", lambda x, _: np.roll(x, 3)),
    ("momentum_matrix", "per mass", lambda x, _: x / 7),
    ("center_of_mass_acceleration", "other sign", lambda x, _: -x),
    ("coriolis_matrix", "transposed", lambda x, _: x.T),
    ("regressor", "products of inertia in another order",
     lambda x, _: x.reshape(len(x), -1, 10)[:, :, [0, 1, 2, 3, 4, 5, 7, 6, 8, 9]].reshape(x.shape)),
    ("frame_bias", "other sign", lambda x, _: -x),
    ("frame_acceleration", "with gravity", lambda x, e: x - np.r_[e._gravity, 0, 0, 0]),
    *((name, *mistake) for name in (*sorted(DERIVATIVES), "constraint_force_derivatives")
      for mistake in (
          ("other sign", lambda x, _: tuple(-part for part in x)),
          ("transposed", lambda x, _: tuple(part.T.reshape(part.shape) for part in x)),
          ("by v first", lambda x, _: (x[1], x[0], *x[2:])),
          ("single precision", lambda x, _: tuple(np.float64(np.float32(y)) for y in x)),
      )),
    ("forward_dynamics_derivatives", "M for its inverse",
     lambda x, _: (*x[:2], np.linalg.inv(x[2]))),
]  # fmt: skip
"""Method, mistake, and how it changes a result."""


@cache
def bicycle() -> Scene:
    """Return a bicycle."""
    return ordinary(SCENES["bicycle"], 1)[0]


@pytest.mark.sampled(10)
@pytest.mark.parametrize("name, what, change", MISTAKES, ids=[f"{x[0]}: {x[1]}" for x in MISTAKES])
@pytest.mark.parametrize("kind", OFFERED)
def test_a_wrong_convention_is_found(
    kind: type[Engine], name: str, what: str, change: Any, represented: Callable[..., Scene]
):
    if name not in OFFERED[kind] or by_differences(kind, name):
        assert name in OFFERED[kind] or not kind.offers(name)
        return
    if what == "single precision" and kind.unit_roundoff > EPS:
        return
    scene = represented(kind)
    if kind is ExudynEngine or not kind.reads_file:
        scene = bicycle()
    found = findings(answered(name, change)(kind), scene, 1, name)
    assert "failed" in {x.verdict for x in found}, found


@pytest.mark.parametrize(
    ("method", "count"),
    [("placement", 1), ("velocity", 2), ("jacobian", 1), ("acceleration", 3), ("bias", 2)],
)
def test_pinocchio_is_not_asked_about_a_frame_that_it_does_not_have(method: str, count: int):
    engine = PinocchioEngine(SCENES["chain-pendulum"].example())
    with pytest.raises(KeyError, match="the model has no frame 'missing'"):
        getattr(engine, f"frame_{method}")("missing", *[np.zeros(3)] * count)
