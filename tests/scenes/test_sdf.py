"""Robots in SDF files: against the same trees, other readers, and what is refused."""

from __future__ import annotations

import math
import pickle
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests import robots
from tests.scenes.sdf_texts import sdf_text

import eomcheck
from eomcheck.claims.proof import prove
from eomcheck.descriptions import sdf_reader
from eomcheck.descriptions.build import mechanism
from eomcheck.descriptions.elements import ORIGIN, Joint, Link, hinge, pin, weld
from eomcheck.descriptions.random_trees import urdf_tree
from eomcheck.descriptions.sdf_reader import sdf_kind
from eomcheck.descriptions.urdf_reader import read_urdf, shape_reach
from eomcheck.descriptions.vector_algebra import roll_pitch_yaw, roll_pitch_yaw_of, rotation_matrix
from eomcheck.engines.file_engine import read_description
from eomcheck.errors import InputError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.lab.library_comparison import compare_libraries
from eomcheck.lab.robot_comparison import compare_robots
from eomcheck.mechanics.scene import GeneratorChoices
from eomcheck.mechanics.sketch import Body, Closing
from eomcheck.scene_lookup import robot_named, scene_named
from eomcheck.scenes import from_sdf, from_urdf

VERSIONS = (4, 5, 6, 7, 9, 11)

INERTIAL = (
    "<inertial><mass>2</mass><pose>0.1 0.2 0.3 0 0 0</pose><inertia><ixx>0.3</ixx><iyy>0.4</iyy>"
    "<izz>0.5</izz></inertia></inertial>"
)


def written(folder: Path, text: str, version: str = "1.9", name: str = "robot.sdf") -> Path:
    path = folder / name
    path.write_text(f'<?xml version="1.0"?><sdf version="{version}">{text}</sdf>', "utf-8")
    return path


def link(name: str, inside: str = "") -> str:
    return f'<link name="{name}">{inside}{INERTIAL}</link>'


def joint(kind: str, inside: str = "<axis/>", name: str = "j", ends: str = "world a") -> str:
    parent, child = ends.split()
    return (
        f'<joint name="{name}" type="{kind}"><parent>{parent}</parent><child>{child}</child>'
        f"{inside}</joint>"
    )


def model(inside: str) -> str:
    return f'<model name="m">{inside}</model>'


def terms(scene: Any, q: Any, v: Any) -> list[Any]:
    M, Q, B, *_ = Evaluation(scene, np.array(q, float), np.array(v, float)).terms
    return [np.zeros(scene.n) if x is None else np.asarray(x, float) for x in (M, Q, B)]


def apart(scene: Any, other: Any, states: int = 3) -> float:
    """Return the largest difference of M, Q and B, relative to the largest entry of each.

    Velocities are up to 1 in size, so that B is not below the size of M.
    """
    assert scene.coordinate_names == other.coordinate_names
    random, worst = np.random.default_rng(0), 0.0
    for _ in range(states):
        q, v = random.uniform(-1.0, 1.0, (2, scene.n))
        both = terms(scene, q, v), terms(other, q, v)
        least = np.abs(both[1][0]).max()
        for x, y in zip(*both, strict=True):
            worst = max(worst, np.abs(x - y).max() / max(least, np.abs(y).max()))
    return float(worst)


# ---- Conventions ---------------------------------------------------------------------------------


@pytest.mark.parametrize("minor", VERSIONS)
@pytest.mark.parametrize("seed", range(3))
def test_a_tree_in_any_convention_of_poses_has_its_own_equations_to_1e_12(
    tmp_path: Path, seed: int, minor: int
):
    random = np.random.default_rng((seed, minor))
    tree = urdf_tree(4, GeneratorChoices(random))._replace(gravity=(1.0, -2.0, -9.0))
    path = tmp_path / "tree.sdf"
    path.write_text(sdf_text(random, tree, minor), "utf-8")
    scene, own = from_sdf(path), mechanism("tree", tree.links, tree.joints, gravity=tree.gravity)()
    assert apart(scene, own) <= 1e-12
    assert compare_robots(scene, own).differences == ()
    assert {frame.name for frame in scene.source.frames} == {x.name for x in tree.links[1:]}


@pytest.mark.night
@pytest.mark.parametrize("minor", VERSIONS)
def test_fifty_trees_of_each_version_have_their_own_equations_to_1e_11(tmp_path: Path, minor: int):
    for seed in range(50):
        random = np.random.default_rng((seed, minor, 1))
        tree = urdf_tree(6, GeneratorChoices(random))
        path = tmp_path / "tree.sdf"
        path.write_text(sdf_text(random, tree, minor), "utf-8")
        own = mechanism("tree", tree.links, tree.joints, gravity=tree.gravity)()
        assert apart(from_sdf(path), own) <= 1e-11, seed


def test_a_robot_in_urdf_and_sdf_is_the_same_robot(tmp_path: Path):
    urdf = robots.arm(tmp_path / "arm.urdf", damping="0.3")
    robot = read_urdf(urdf)
    parts, placed = [], {robot.links[0].name: np.eye(4)}
    for one in robot.joints:
        seat = np.eye(4)
        seat[:3, :3], seat[:3, 3] = rotation_matrix(one.orientation), one.origin
        placed[one.child] = placed[one.parent] @ seat
    for one in robot.links:
        X = placed[one.name]
        pose = [*X[:3, 3].tolist(), *roll_pitch_yaw_of(X[:3, :3])]
        inside = f"<pose>{' '.join(map(repr, pose))}</pose>"
        if one.has_inertia:
            names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
            entries = zip(names, (*one.moments, *one.products), strict=True)
            inertia = "".join(f"<{name}>{x!r}</{name}>" for name, x in entries)
            center = " ".join(map(repr, one.center))
            inside += f"<inertial><pose>{center} 0 0 0</pose><mass>{one.mass!r}</mass>"
            inside += f"<inertia>{inertia}</inertia></inertial>"
        parts.append(f'<link name="{one.name}">{inside}</link>')
    for one in robot.joints:
        axis = f"<axis><xyz>{' '.join(map(repr, one.axis))}</xyz>"
        axis += f"<dynamics><damping>{one.damping or 0.0!r}</damping></dynamics></axis>"
        parts.append(joint(one.kind, axis, one.name, f"{one.parent} {one.child}"))
    sdf = written(tmp_path, f'<model name="arm">{"".join(parts)}</model>', name="arm.sdf")
    same = compare_robots(from_urdf(urdf), from_sdf(sdf))
    assert same.differences == () and set(same.matched) == {"shoulder", "slide", "wrist"}
    other = tmp_path / "other.sdf"
    other.write_text(sdf.read_text("utf-8").replace("<mass>2.5<", "<mass>2.6<"), "utf-8")
    heavier = compare_robots(from_urdf(urdf), from_sdf(other))
    assert [one.what for one in heavier.differences] == ["mass"]


FRAMES = [
    # a pose in the frame of a joint, of a frame on another link, and of the model by name
    ('<link name="b"><pose relative_to="j">0 0 1 0 0 0</pose>', (0.0, 1.0, 1.0)),
    ('<link name="b"><pose relative_to="f">0 0 1 0 0 0</pose>', (1.0, 2.0, 1.0)),
    ('<link name="b"><pose relative_to="__model__">0 0 1 0 0 0</pose>', (0.0, 0.0, 1.0)),
    ('<link name="b"><pose>0 0 1 0 0 0</pose>', (0.0, 0.0, 1.0)),
    ('<link name="b"><pose relative_to="a"/>', (0.0, 1.0, 0.0)),
]


@pytest.mark.parametrize(("start", "place"), FRAMES)
def test_a_pose_is_in_the_frame_that_it_names(tmp_path: Path, start: str, place: tuple):
    text = link("a", "<pose>0 1 0 0 0 0</pose>") + start + INERTIAL + "</link>"
    text += '<frame name="f" attached_to="a"><pose>1 1 0 0 0 0</pose></frame>'
    text += joint("revolute") + joint("prismatic", name="k", ends="a b")
    scene = from_sdf(written(tmp_path, model(text)))
    own = mechanism(
        "own",
        [Link("world"), *(Link(x, 2.0, (0.1, 0.2, 0.3), (0.3, 0.4, 0.5)) for x in "ab")],
        [
            Joint("j", "revolute", "world", "a", (0.0, 1.0, 0.0)),
            Joint("k", "prismatic", "a", "b", tuple(np.subtract(place, (0.0, 1.0, 0.0)).tolist())),
        ],
    )()
    assert apart(scene, own) == 0.0


def test_the_frame_of_a_model_may_be_placed_by_one_of_its_frames(tmp_path: Path):
    inside = link("a") + '<frame name="f"><pose>0 0 1 0 0 0</pose></frame>'
    inside += joint("revolute", "<axis><xyz>0 1 0</xyz></axis>")
    placed = f'<model name="m" placement_frame="f"><pose>1 2 3 0.3 0 0</pose>{inside}</model>'
    turn = roll_pitch_yaw(0.3, 0.0, 0.0)
    x, y, z = ((1.0, 2.0, 3.0) - rotation_matrix(turn) @ (0.0, 0.0, 1.0)).tolist()
    own = mechanism(
        "own",
        [Link("world"), Link("a", 2.0, (0.1, 0.2, 0.3), (0.3, 0.4, 0.5))],
        [Joint("j", "revolute", "world", "a", (x, y, z), turn, (0.0, 1.0, 0.0))],
    )()
    scene = from_sdf(written(tmp_path, placed))
    assert apart(scene, own) <= 1e-15
    assert scene.source.frames[0].name == "a"


def test_the_frame_that_places_a_nested_model_is_known_in_its_place(tmp_path: Path):
    tip = link("tip") + '<frame name="f"><pose>0 0 0.5 0.2 0 0</pose></frame>'
    pose = '<pose relative_to="a">0 0 1 0 0.3 0</pose>'
    nested = f'<model name="hand" placement_frame="f">{pose}{tip}</model>'
    axis, seat = "<axis><xyz>0 1 0</xyz></axis>", '<pose relative_to="{}"/>'
    before, after = link("a") + joint("revolute"), joint("revolute", axis + seat, "k", "a hand")
    scene = from_sdf(written(tmp_path, model(before + nested + after.format("hand::f"))))
    place = f'<frame name="g">{pose}</frame>'
    back = f"0 {-math.sin(0.2) / 2} {-math.cos(0.2) / 2} -0.2 0 0"
    turned = link("hand::tip", f'<pose relative_to="g">{back}</pose>')
    after = after.replace(">hand<", ">hand::tip<").format("g")
    flat = from_sdf(written(tmp_path, model(before + place + turned + after)))
    assert apart(scene, flat) <= 1e-15


def test_nested_models_are_one_robot_with_names_of_their_scopes(tmp_path: Path):
    tip = link("tip") + '<frame name="f"><pose>0 0 0.5 0 0 0</pose></frame>'
    nested = f'<model name="hand"><pose relative_to="a">0 0 1 0 0 0</pose>{tip}</model>'
    more = '<pose relative_to="hand::f"/>'
    text = (
        link("a") + nested + joint("revolute") + joint("revolute", f"<axis/>{more}", "k", "a hand")
    )
    scene = from_sdf(written(tmp_path, model(text)))
    assert scene.coordinate_names == ("j", "k")
    assert [frame.name for frame in scene.source.frames] == ["a", "hand::tip"]
    flat = text.replace(nested, link("hand::tip", "<pose>0 0 1 0 0 0</pose>"))
    flat = flat.replace(more, "<pose>0 0 0.5 0 0 0</pose>").replace(">hand<", ">hand::tip<")
    assert apart(scene, from_sdf(written(tmp_path, model(flat), name="flat.sdf"))) == 0.0


# ---- Joints --------------------------------------------------------------------------------------

PLACES = "<pose>0.1 0 0.2 0.3 0 0.4</pose>"


def test_a_universal_joint_is_two_hinges_whose_axes_may_have_dampers_and_springs(tmp_path: Path):
    axes = (
        "<axis><xyz>1 0 0</xyz><dynamics><damping>0.3</damping></dynamics></axis><axis2><xyz>0 1 0"
        "</xyz><dynamics><spring_stiffness>4</spring_stiffness><spring_reference>0.2"
        "</spring_reference></dynamics></axis2>"
    )
    turn = roll_pitch_yaw(0.3, 0.0, 0.4)
    R = rotation_matrix(turn)
    first, second = (tuple(R[:, i].tolist()) for i in (0, 1))
    own = mechanism(
        "own",
        [
            *(Link(x) for x in ("world", "cross", "seat")),
            Link("a", 2.0, (0.1, 0.2, 0.3), (0.3, 0.4, 0.5)),
        ],
        [
            Joint("j_axis", "revolute", "world", "cross", (0.1, 0.0, 0.2), axis=first, damping=0.3),
            Joint(
                *("j_axis2", "revolute", "cross", "seat"),
                axis=second,
                stiffness=4.0,
                rest_position=0.2,
            ),
            Joint("fixed", "fixed", "seat", "a", (-0.1, 0.0, -0.2)),
        ],
    )()
    for kind in "universal", "revolute2":
        text = link("a") + joint(kind, PLACES + axes)
        scene = from_sdf(written(tmp_path, model(text)))
        assert scene.coordinate_names == ("j_axis", "j_axis2")
        assert [frame.name for frame in scene.source.frames] == ["a"]
        assert apart(scene, own) <= 1e-15


@pytest.mark.parametrize(
    ("pitch", "advance"),
    [
        ("<screw_thread_pitch>0.3</screw_thread_pitch>", 0.3 / (2.0 * math.pi)),
        ("<thread_pitch>-20</thread_pitch>", 1.0 / 20.0),
        ("", 1.0 / (2.0 * math.pi)),
    ],
)
def test_a_screw_slides_as_it_turns_by_its_pitch(tmp_path: Path, pitch: str, advance: float):
    text = link("a") + joint("screw", f"<axis><xyz>0 0 1</xyz></axis>{pitch}")
    scene = from_sdf(written(tmp_path, model(text)), gravity=(0.0, 0.0, -10.0))
    M, Q, _ = terms(scene, [0.4], [0.0])
    assert scene.coordinate_names == ("j",)
    about = 0.5 + 2.0 * (0.1**2 + 0.2**2)
    assert M[0, 0] == pytest.approx(about + 2.0 * advance**2, rel=1e-14)
    assert Q[0] == pytest.approx(-20.0 * advance, rel=1e-14)


@pytest.mark.parametrize("place", [(0.1, 0.0, 0.2), (0.0, 0.0, 0.0)])
def test_a_ball_turns_about_the_axes_of_its_own_frame(tmp_path: Path, place: Any):
    turn = roll_pitch_yaw(0.3, 0.0, 0.4)
    w, x, y, z = turn
    back = -rotation_matrix((w, -x, -y, -z)) @ place
    own = mechanism(
        "own",
        [Link("world"), Link("seat"), Link("a", 2.0, (0.1, 0.2, 0.3), (0.3, 0.4, 0.5))],
        [
            Joint("j", "spherical", "world", "seat", place, turn, damping=0.3),
            Joint("fixed", "fixed", "seat", "a", tuple(back.tolist()), (w, -x, -y, -z)),
        ],
    )()
    axis = "<axis><xyz>0 0 1</xyz><dynamics><damping>0.3</damping></dynamics></axis>"
    text = link("a") + joint("ball", PLACES.replace("0.1 0 0.2", "{} {} {}".format(*place)) + axis)
    assert apart(from_sdf(written(tmp_path, model(text))), own) <= 1e-15


def test_a_joint_follows_an_axis_of_another_one(tmp_path: Path):
    mimic = (
        '<mimic joint="j" axis="axis2"><multiplier>2</multiplier><offset>0.5</offset>'
        "<reference>0.1</reference></mimic>"
    )
    axes = "<axis><xyz>1 0 0</xyz></axis><axis2><xyz>0 1 0</xyz></axis2>"
    text = link("a") + link("b") + joint("universal", axes)
    text += joint("revolute", f"<axis>{mimic}</axis>", "k", "a b")
    scene = from_sdf(written(tmp_path, model(text), "1.11"))
    assert scene.coordinate_names == ("j_axis", "j_axis2")
    assert scene.ratio.tolist() == [2.0] and scene.shift.tolist() == [0.5 - 2.0 * 0.1]
    assert scene.tree().coordinates.tolist() == [[1.0, 0.0], [0.0, 1.0], [0.0, 2.0]]


LOOPS = {
    "fixed": ("", weld("c", "a", "b", (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))),
    "ball": ("", pin("c", "a", "b", (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))),
    "revolute": (
        "<axis><xyz>0 1 0</xyz></axis>",
        hinge("c", "a", "b", (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (0.0, 1.0, 0.0)),
    ),
}


@pytest.mark.parametrize("kind", LOOPS)
def test_a_joint_that_closes_a_loop_is_a_constraint(tmp_path: Path, kind: str):
    axis, closing = LOOPS[kind]
    turns = "<axis><xyz>0 1 0</xyz></axis>"
    inside = f"{axis}<pose>0 0 1 0 0 0</pose>"
    text = link("a") + link("b", "<pose>1 0 -1 0 0 0</pose>")
    text += joint("revolute", turns, "j", "world a") + joint("revolute", turns, "k", "world b")
    scene = from_sdf(written(tmp_path, model(text + joint(kind, inside, "c", "a b"))))
    body = {"mass": 2.0, "center": (0.1, 0.2, 0.3), "moments": (0.3, 0.4, 0.5)}
    y = (0.0, 1.0, 0.0)
    own = mechanism(
        "own",
        [Link("world"), Link("a", **body), Link("b", **body)],
        [
            Joint("j", "revolute", "world", "a", axis=y),
            Joint("k", "revolute", "world", "b", (1.0, 0.0, -1.0), axis=y),
        ],
        [closing],
        dependent=scene.coordinate_names[: scene.r] if scene.r < 2 else (),
    )()
    assert scene.r == own.r > 0
    q, v = [0.2, -0.3], [0.5, 0.7]
    order = [scene.coordinate_names.index(x) for x in own.coordinate_names]
    ours, theirs = (Evaluation(s, q, v).terms for s in (scene, own))
    assert np.allclose(np.asarray(ours.a)[:, order], theirs.a, rtol=0.0, atol=1e-14)
    parts = scene.sketch(np.array(q)).parts
    (held,) = (part for part in parts if isinstance(part, Closing))
    assert held.rows == (0, 1, 2)  # those of the point: moments are no force
    ends = [tuple(part.points[1]) for part in parts if isinstance(part, Body)]
    assert {tuple(held.at), tuple(held.other)} <= {*ends}


def test_a_hinge_of_a_turned_link_that_closes_a_loop_is_along_its_axis_in_both_links(
    tmp_path: Path,
):
    turns = "<axis><xyz>0 1 0</xyz></axis>"
    text = link("a") + link("b", "<pose>1 0 0 0 0 0.5</pose>")
    text += joint("revolute", turns, "j", "world a") + joint("revolute", turns, "k", "world b")
    scene = from_sdf(written(tmp_path, model(text + joint("revolute", turns, "c", "a b"))))
    axis, of_parent = (0.0, 1.0, 0.0), (-math.sin(0.5), math.cos(0.5), 0.0)
    closing = hinge("c", "a", "b", (1.0, 0.0, 0.0), (0.0, 0.0, 0.0), of_parent, axis)
    links = [Link("world"), *(Link(x, 2.0, ORIGIN, (0.3, 0.4, 0.5)) for x in "ab")]
    own = mechanism(
        "own",
        links,
        [
            Joint("j", "revolute", "world", "a", axis=axis),
            Joint(
                "k", "revolute", "world", "b", (1.0, 0.0, 0.0), roll_pitch_yaw(0.0, 0.0, 0.5), axis
            ),
        ],
        [closing],
    )()
    assert scene.directions == pytest.approx(own.directions, abs=1e-15)


# ---- Scene ---------------------------------------------------------------------------------------

HINGE = (
    link("a", "<pose>0 0 2 0.4 0 0</pose>")
    + link("b", '<pose relative_to="a"/>')
    + joint("revolute", ends="a b")
)


def test_the_root_stays_where_the_file_places_it_or_is_free_on_request(tmp_path: Path):
    path = written(tmp_path, model(HINGE))
    fixed, free = from_sdf(path), robot_named(f"{path}:floating")()
    assert fixed.coordinate_names == ("j",)
    assert free.coordinate_names == (
        *(f"a_{x}" for x in ("x", "y", "z", "yaw", "pitch", "roll")),
        "j",
    )
    assert free.initial_state()[0].tolist() == pytest.approx([0, 0, 2, 0, 0, 0.4, 0], abs=1e-15)
    assert (fixed.source.floating, free.source.floating) == ("", "a")
    # About an axis that leans by 0.4, the weight acts with its sine.
    across = 0.1 * math.cos(0.3) - 0.2 * math.sin(0.3)
    torque = terms(fixed, [0.3], [0.0])[1][0]
    assert torque == pytest.approx(-2.0 * 9.81 * math.sin(0.4) * across, rel=1e-14)
    turned = from_sdf(written(tmp_path, model(HINGE.replace("0 0 2 0.4", "0 0 0 0.4"))))
    assert terms(turned, [0.3], [0.0])[1][0] == torque


def test_one_of_several_models_is_named_behind_a_colon(tmp_path: Path):
    lone = f'<model name="lone">{link("c")}</model>'
    path = written(tmp_path, f'<world name="w">{model(HINGE)}{lone}</world>')
    assert scene_named(f"{path}:m").coordinate_names == ("j",)
    assert scene_named(f"{path}:lone:floating").n == 6
    assert "other models (1)" in scene_named(f"{path}:m").source.ignored
    said = f"{str(path)!r} has 2 models, name one of them: {path}:m, {path}:lone"
    with pytest.raises(InputError) as refused:
        scene_named(str(path))
    assert str(refused.value) == said
    with pytest.raises(InputError, match=r"expected .*robot.sdf:m or .*robot.sdf:floating"):
        scene_named(f"{path}:m:fixed")
    with pytest.raises(InputError, match="has no model 'n', expected one of: m, lone"):
        scene_named(f"{path}:n")
    path = written(tmp_path, model(HINGE) + model(link("c")))
    with pytest.raises(InputError, match="has 2 models 'm', expected one"):
        scene_named(f"{path}:m")


@pytest.mark.parametrize(
    ("world", "version", "gravity"),
    [
        ("{}", "1.9", (0.0, 0.0, -9.81)),
        ('<world name="w">{}</world>', "1.9", (0.0, 0.0, -9.8)),
        ('<world name="w"><gravity>0 1 2</gravity>{}</world>', "1.9", (0.0, 1.0, 2.0)),
        ('<world name="w"><physics><gravity>0 1 2</gravity></physics>{}</world>', "1.5", (0, 1, 2)),
        ('<world name="w"><gravity>0 0 0</gravity>{}</world>', "1.6", None),
    ],
)
def test_gravity_is_that_of_the_world(tmp_path: Path, world: str, version: str, gravity: Any):
    text = link("a") + joint("revolute", "<axis><xyz>0 1 0</xyz></axis>")
    scene = from_sdf(written(tmp_path, world.format(model(text)), version))
    assert scene.gravity is None if gravity is None else tuple(scene.gravity) == gravity
    off = text.replace("<inertial>", "<gravity>false</gravity><inertial>")
    assert from_sdf(written(tmp_path, world.format(model(off)), version)).gravity is None


def test_a_scene_is_made_again_by_its_code_and_by_pickle(tmp_path: Path):
    path = written(tmp_path, model(HINGE))
    for more in ({}, {"floating": True}, {"gravity": None}, {"model": "m"}):
        scene = from_sdf(path, **more)
        assert type(pickle.loads(pickle.dumps(scene))) is type(scene)
        names: dict[str, Any] = {}
        exec(f"{scene.source.imports}\nmade = {scene.source.code}", names)
        assert type(names["made"]) is type(scene)
    assert sdf_kind(path) is sdf_kind(path)


def test_the_identities_of_a_robot_are_proved(tmp_path: Path):
    text = link("a") + link("b") + joint("ball", PLACES) + joint("screw", "<axis/>", "k", "a b")
    scene = from_sdf(written(tmp_path, model(text)))
    assert [str(f) for f in prove(scene, points=1, seed=0) if f.verdict != "passed"] == []


# ---- What is left out, doubted, refused ----------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "sizes", "reach"),
    [
        ("box", {"size": "2 4 4"}, 3.0),
        ("sphere", {"radius": "2"}, 2.0),
        ("ellipsoid", {"radii": "1 3 2"}, 3.0),
        ("cylinder", {"radius": "3", "length": "8"}, 5.0),
        ("cone", {"radius": "3", "length": "8"}, 5.0),
        ("capsule", {"radius": "5", "length": "14"}, 13.0),
        ("mesh", {"uri": "a.stl"}, None),
    ],
)
def test_no_point_of_a_shape_is_farther_than_its_reach(kind: str, sizes: Any, reach: Any):
    assert shape_reach(kind, ORIGIN, sizes.__getitem__) == reach
    beside = shape_reach(kind, (0.0, 3.0, 4.0), sizes.__getitem__)
    assert beside == (None if reach is None else reach + 5.0)


def test_ignored_parts_are_counted_in_one_sentence(tmp_path: Path):
    axis = (
        "<axis><limit><lower>-1</lower><upper>1</upper></limit><dynamics><friction>1</friction>"
        "</dynamics></axis><sensor/><physics/>"
    )
    more = "<velocity_decay><linear>0.1</linear></velocity_decay><visual/><collision/>"
    text = link("a", more) + joint("revolute", axis) + "<plugin/><gz:thing/>"
    text += "<enable_wind>0</enable_wind><self_collide>1</self_collide>"
    scene = from_sdf(written(tmp_path, f'<world name="w"><include/><light/>{model(text)}</world>'))
    turned = written(tmp_path, model(text.replace("linear>", "angular>")), name="turned.sdf")
    assert "decay of velocities (1)" in from_sdf(turned).source.ignored
    parts = (
        "decay of velocities (1)",
        "friction of joints (1)",
        "included models (1)",
        "lights (1)",
        "limits of joints (1)",
        "plugins (1)",
        "sensors (1)",
        "settings of physics engines (1)",
        "shapes to be seen (1)",
        "shapes to collide (1)",
        "thing (1)",
    )
    assert scene.source.ignored == f"Ignored: {', '.join(parts)}."


@pytest.mark.parametrize(
    ("old", "new", "doubt"),
    [
        ("<pose>0 0 2 0.4 0 0</pose>", "<pose>0 0 2 90 0 0</pose>", "in degrees? 'a'"),
        ("<pose>0 0 2 0.4 0 0</pose>", '<pose degrees="1">0 0 2 90 0 0</pose>', ""),
        ("<pose>0.1 0.2 0.3 0 0 0", "<pose>0.1 0.2 0.3 0 0 45", "in degrees? 'a'"),
        (
            '<link name="b">',
            '<link name="b"><visual name="v"><pose>0 0 0 0 0 90</pose><geometry><sphere>'
            "<radius>1</radius></sphere></geometry></visual>",
            "",
        ),
        ("<mass>2</mass>", "<mass>0</mass>", "Inertia without mass: 'a'."),
        ("<mass>2</mass>", "", "Mass 1 kg or moments 1 kg m² by default: 'a'."),
        (INERTIAL, "", "Mass 1 kg or moments 1 kg m² by default: 'a'."),
        ("<izz>0.5</izz>", "<izz>5</izz>", "No body has the moments of inertia of 'a'"),
        ("<axis/>", "<axis><xyz>0 1 1</xyz></axis>", "Axes that are no unit vectors: 'j'."),
        (
            '<link name="b">',
            '<link name="b"><collision name="c"><geometry><sphere><radius>0.01</radius></sphere>'
            "</geometry></collision>",
            "far center of mass of 'b'",
        ),
    ],
)
def test_doubtful_numbers_are_used_and_named(tmp_path: Path, old: str, new: str, doubt: str):
    assert old in HINGE
    scene = from_sdf(written(tmp_path, model(HINGE.replace(old, new, 1))))
    assert doubt in scene.source.warnings if doubt else scene.source.warnings == ""


SOUND = link("a") + link("b") + joint("revolute") + joint("prismatic", name="k", ends="a b")

AXES = {
    "": "joint 'j' has no <axis>",
    "<axis><xyz>0 0</xyz></axis>": "<xyz> is '0 0', expected three numbers",
    "<axis><xyz>0 0 0</xyz></axis>": "joint 'j' has the axis .0, 0, 0., expected",
    "<axis><dynamics><damping>-1</damping></dynamics></axis>": "damping = -1, expected",
    "<axis><mimic joint='x'/></axis>": "joint 'j' follows 'x', no such joint",
    "<axis><mimic joint='k' axis='axis2'/></axis>": "follows 'axis2' of 'k', which has one",
    '<axis><xyz expressed_in="x">0 0 1</xyz></axis>': "'j' refers to 'x', no link, joint",
}

LINKS = {
    "<pose>0 0 0</pose>": "<pose> has 3 numbers, expected 6",
    '<pose rotation_format="quat_xyzw">0 0 0 0 0 0 0</pose>': "has a quaternion of length 0",
    '<pose rotation_format="euler">0 0 0 0 0 0</pose>': "is 'euler', expected euler_rpy or quat",
    '<pose relative_to="a"/>': "the pose of 'a' is relative to itself",
    '<pose relative_to="j"/>': "the pose of '.' is relative to itself",
    "<kinematic>1</kinematic>": "link 'a' is kinematic: no force moves it",
    "<gravity>0</gravity>": "'a' has no gravity, expected the same of all links, 'b' has weight",
    "<gravity>no</gravity>": "<gravity> is 'no', expected true or false",
    "<inertal/>": "holds <inertal>, which is no part of an SDF known here .did you mean",
    "<drake:inertial/>": "holds <drake:inertial>, which is no part of an SDF known here$",
}

OTHERS = [
    ('type="revolute"', 'type="gearbox"', "joint 'j' has the type 'gearbox', expected one of"),
    ("<parent>world", "<parent>wordl", "'j' refers to 'wordl', no link, .*mean 'world'"),
    ("<child>a", "<child>world", "joint 'j' has the child 'world', expected it as the"),
    ("<parent>world", "<parent>a", "joint 'j' is between 'a' and itself"),
    ("<parent>world</parent>", "", "joint 'j' has no <parent>"),
    ('<link name="a">', '<link name="b">', "link 'b': another link, joint or frame has this"),
    ('<link name="a">', '<link name="world">', "link 'world': another link"),
    ("<inertial>", '<inertial auto="true">', "the inertia follows from shapes, expected"),
    ("<mass>", "<fluid_added_mass><xx>1</xx></fluid_added_mass><mass>", "an added mass of"),
    ("<mass>2", "<mass>-2", "mass = -2, expected a number not below 0"),
    ("<mass>2", "<mass>two", "<mass> is 'two', expected a number"),
    ("0.1 0.2 0.3 0 0 0<", "0.1 0.2 0.3 0 0 nan<", "<pose> is 'nan', expected a finite number"),
    ('<link name="a">', '<static>1</static><link name="a">', "'m' is static: nothing in it"),
    ('<link name="a">', '<include/><link name="a">', "includes another model, expected it in"),
    ('<link name="a">', '<loop/><link name="a">', "holds <loop>, which is no part of an SDF"),
    ('<link name="a">', link("c") + '<link name="a">', "2 links are no joint's child"),
    (
        '<link name="a">',
        '<frame name="f" attached_to="g"><pose relative_to="a"/></frame>'
        '<frame name="g" attached_to="f"><pose relative_to="a"/></frame>'
        '<joint name="l" type="fixed"><child>b</child><parent>f</parent></joint><link name="a">',
        "joint 'l': '[fg]' is attached to itself",
    ),
]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        *(("<axis/>", new, said) for new, said in AXES.items()),
        *(('<link name="a">', f'<link name="a">{new}', said) for new, said in LINKS.items()),
        *OTHERS,
    ],
)
def test_what_a_file_must_not_say_is_refused_in_one_sentence(
    tmp_path: Path, old: str, new: str, said: str
):
    text = model(SOUND)
    assert old in text
    with pytest.raises(InputError, match=said) as refused:
        from_sdf(written(tmp_path, text.replace(old, new, 1)))
    assert "\n" not in str(refused.value) and "robot.sdf" in str(refused.value)


DAMPED = "<axis><dynamics><damping>1</damping></dynamics></axis>"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "robot.sdf' has no model$"),
        ('<world name="w"><include/></world>', "has no model, only included ones, which are not"),
        (model(""), "model 'm' has no link"),
        (model(link("a")), "model 'm' has no joint; .*robot.sdf:floating' sets its link free"),
        (model("") * 2, "has 2 models, name one of them"),
        *(
            (
                model(SOUND + joint("revolute", forced, "c", "world b")),
                "joint 'c' closes a loop at the link 'b', which 'k' moves, expected a fixed joint",
            )
            for forced in (DAMPED, DAMPED.replace("damping", "spring_stiffness"))
        ),
    ],
)
def test_a_file_without_a_robot_is_refused(tmp_path: Path, text: str, said: str):
    with pytest.raises(InputError, match=said):
        from_sdf(written(tmp_path, text))


@pytest.mark.parametrize("version", ["1.3", "1.13", "2.0", "x", "1.\N{SUPERSCRIPT SEVEN}"])
def test_another_version_is_refused(tmp_path: Path, version: str):
    with pytest.raises(InputError, match=rf"is of SDFormat {version}, expected 1.4 to 1.12"):
        from_sdf(written(tmp_path, model(SOUND), version))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('<link name="l{0}"/>', "has 5001 of <link>, expected at most 5000"),
        ('<frame name="l{0}" attached_to="l{1}"/>', "refers to 'l5001', no link, joint, frame"),
    ],
)
def test_a_large_file_is_refused_at_once(tmp_path: Path, text: str, said: str):
    inside = "".join(text.format(i, i + 1) for i in range(5001))
    ends = joint("revolute", ends="l0 a") + link("a") if "frame" in text else ""
    start = time.process_time()
    with pytest.raises(InputError, match=said):
        from_sdf(written(tmp_path, model(inside + ends)))
    assert time.process_time() - start < 5.0


FRAMES = 300
CHAIN = "".join(
    f'<frame name="f{i}" attached_to="f{i + 1}"><pose relative_to="f{i + 1}"/></frame>'
    for i in range(FRAMES)
)


@pytest.mark.parametrize(
    ("inside", "said"),
    [
        (
            f'{CHAIN}<frame name="f{FRAMES}"/>{link("a200")}'
            + "".join(
                link(f"a{i}", f'<pose relative_to="f{i % 2 * (FRAMES - 1)}"/>')
                + joint("fixed", "", f"j{i}", f"a{i} a{i + 1}")
                for i in range(200)
            ),
            "frames refer to others in chains of more than 20000 in all",
        ),
        (f'<model name="{"n" * 10**6}">{"<link/>" * 5000}</model>', "the names of a model and"),
    ],
)
def test_long_chains_of_frames_and_long_names_are_refused_at_once(
    tmp_path: Path, monkeypatch, inside: str, said: str
):
    monkeypatch.setattr(sdf_reader, "MOST_ELEMENTS", 20_000)
    start = time.process_time()
    with pytest.raises(InputError, match=said):
        from_sdf(written(tmp_path, model(inside)))
    assert time.process_time() - start < 5.0


def test_joints_between_other_models_of_a_world_are_left_out(tmp_path: Path):
    others = "".join(f'<model name="{x}">{link("c")}</model>' for x in "no")
    joints = joint("fixed", "", "x", "n::c o::c") + joint("fixed", "", "y", "world n::c")
    text = f'<world name="w">{model(SOUND)}{others}{{}}</world>'
    scene = from_sdf(written(tmp_path, text.format(joints), "1.11"), model="m")
    assert scene.coordinate_names == ("j", "k")
    assert "joints of other models (2), other models (2)" in scene.source.ignored
    with pytest.raises(InputError, match="'x' refers to 'n::c', no link"):
        from_sdf(written(tmp_path, text.format(joint("fixed", "", "x", "m::b n::c"))), model="m")


def test_a_ball_with_a_spring_or_a_leader_is_refused(tmp_path: Path):
    spring = "<dynamics><spring_stiffness>2</spring_stiffness></dynamics>"
    for inside in (spring, '<mimic joint="j"/>'):
        ball = joint("ball", f"<axis>{inside}</axis>", "k", "a b")
        text = model(link("a") + link("b") + joint("revolute") + ball)
        with pytest.raises(InputError, match="'k' is a ball with a spring or a leader, expected"):
            from_sdf(written(tmp_path, text))


def test_a_root_that_a_loop_alone_holds_is_free_or_refused(tmp_path: Path):
    bodies = link("a") + link("b", "<pose>1 0 0 0 0 0</pose>")
    loop = joint("revolute", name="k", ends="a b") + joint("ball", "", "l", "world b")
    path = written(tmp_path, model(bodies + loop))
    with pytest.raises(InputError, match="only joint 'l', which closes a loop, holds the root 'a'"):
        from_sdf(path)
    free = robot_named(f"{path}:floating")()
    assert (free.n, free.r) == (7, 3)


def test_axes_of_the_model_are_those_of_old_files_alone(tmp_path: Path):
    by_model = "<axis><use_parent_model_frame>1</use_parent_model_frame></axis>"
    text = SOUND.replace("<axis/>", by_model, 1)
    assert from_sdf(written(tmp_path, model(text), "1.6")).source.ignored == ""
    new = from_sdf(written(tmp_path, model(text)))
    assert new.source.ignored == "Ignored: use_parent_model_frame (1)."


def test_a_root_that_is_held_is_not_free(tmp_path: Path):
    with pytest.raises(InputError, match="model 'm' is held by joint 'j', and is not free"):
        robot_named(f"{written(tmp_path, model(SOUND))}:floating")


def test_a_link_of_an_old_file_may_be_the_world(tmp_path: Path):
    text = '<link name="world"/>' + SOUND
    assert from_sdf(written(tmp_path, model(text), "1.6")).coordinate_names == ("j", "k")


# ---- Drake ---------------------------------------------------------------------------------------

TILTED = "<axis><xyz>0.6 0 0.8</xyz><dynamics><damping>0.2</damping></dynamics></axis>"
ALONG = "<axis><xyz>1 0 0</xyz></axis>"

MOST = (
    link("a", "<pose>0.3 0.2 0.1 0.2 -0.1 0.4</pose>")
    + link("b", '<pose relative_to="a" degrees="true">0.1 0 0.4 10 20 30</pose>')
    + link("c", '<pose relative_to="f">0.2 0.1 0 0.3 0 0</pose>')
    + link("d")
    + '<frame name="f" attached_to="b"><pose>0 0 0.3 0.1 0.2 0.3</pose></frame>'
    + joint("revolute", f"{TILTED}{PLACES}")
    + joint("prismatic", '<axis><xyz expressed_in="f">0 1 0</xyz></axis>', "k", "a b")
    + joint("screw", f"{ALONG}{PLACES}<screw_thread_pitch>0.2</screw_thread_pitch>", "s", "f c")
    + joint("universal", f"{ALONG}<axis2><xyz>0 1 0</xyz></axis2>{PLACES}", "u", "c d")
)


@pytest.mark.parametrize("floating", [False, True])
def test_drake_reads_the_same_robot_from_a_file(tmp_path: Path, floating: bool):
    pytest.importorskip("pydrake")
    text = MOST.replace("<parent>world</parent>", "<parent>e</parent>") + link("e", PLACES)
    path = written(tmp_path, model(text if floating else MOST))
    scene = robot_named(f"{path}:floating" if floating else str(path))()
    terms = "mass-matrix", "bias", "generalized-forces"
    compared = compare_libraries(scene, ["drake"], states=3, claims=terms)
    assert compared.libraries["drake"].verdict == "agrees", compared.readings("")


@pytest.mark.parametrize(
    ("inside", "root"),
    [
        (link("b") + link("a") + joint("revolute", ends="a b"), "a"),
        (
            link("b") + link("a", PLACES) + '<frame name="f" attached_to="b"/>'
            '<frame name="g" attached_to="a"/>' + joint("revolute", ends="g f"),
            "a",
        ),
        (link("a") + joint("revolute"), "world"),
    ],
)
def test_the_root_of_a_description_does_not_depend_on_the_frames_that_joints_name(
    tmp_path: Path, inside: str, root: str
):
    assert read_description(written(tmp_path, model(inside)), "sdf").root == root


def test_the_leader_of_a_follower_of_a_second_axis_is_the_coordinate_of_that_axis(tmp_path: Path):
    universal = joint("universal", "<axis/><axis2><xyz>0 1 0</xyz></axis2>", "u")
    follower = joint("revolute", '<axis><mimic joint="u" axis="axis2"/></axis>', "k", "a b")
    path = written(tmp_path, model(link("a") + link("b") + universal + follower))
    assert read_description(path, "sdf").follows == {"k": ("u_axis2", 1.0, 0.0)}


def test_drake_takes_no_file_that_it_reads_otherwise(tmp_path: Path):
    kind = eomcheck.engines.BY_FORMAT["sdf"]["drake"]
    spring = "<axis><dynamics><spring_stiffness>2</spring_stiffness></dynamics></axis>"
    text = SOUND.replace("<axis/>", spring, 1)
    assert not kind.represents(from_sdf(written(tmp_path, model(text))))
    assert not kind.represents(from_sdf(written(tmp_path, model(SOUND)), model="m"))
    ball = link("a") + joint("ball", "")
    assert not kind.represents(from_sdf(written(tmp_path, model(ball))))
    assert kind.represents(from_sdf(written(tmp_path, model(SOUND))))
