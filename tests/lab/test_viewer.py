"""Mechanisms that are turned by hand: points in space, velocities, forces, and their JSON."""

from __future__ import annotations

import json

import numpy as np
import pytest

from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.lab.show import viewer_plotly as viewer
from eomcheck.lab.show.pictures import scene_and_pose, sketch_of
from eomcheck.lab.show.sketch_drawing import ROLES, Colors, Drawing, Space
from eomcheck.mechanics import sketch as s
from eomcheck.scenes import (
    SCENES,
    Andrews,
    Bricard,
    ChainPendulum,
    FourBarChain,
    Sleigh,
    Snake,
    from_urdf,
)


def test_planar_points_are_in_a_plane_of_space_and_what_is_up_is_the_last_axis():
    flat, upright = s.Sketch(()), s.Sketch((), up=1)
    assert Space(flat)((1.0, 2.0)).tolist() == [[1.0, 2.0, 0.0]]
    assert Space(upright)((1.0, 2.0)).tolist() == [[0.0, 1.0, 2.0]]
    assert Space(upright)((1.0, 2.0, 3.0)).tolist() == [[3.0, 1.0, 2.0]]
    for sketch in (flat, upright):
        right, above = Space(sketch).page
        assert np.allclose(np.cross(right, above), Space(sketch).towards)


def test_a_wheel_stands_upright_on_its_line():
    parts = s.Body([(0.0, 0.0), (9.0, 0.0)]), s.Wheel((3.0, 1.0), (0.0, 2.0), 4.0)
    drawing = Drawing(s.Sketch(parts), ROLES, None, Space(s.Sketch(parts)))
    rim = drawing.strokes[1].points
    assert np.allclose(np.linalg.norm(rim - (3.0, 1.0, 0.0), axis=1), 2.0)
    assert np.allclose(rim[:, 0], 3.0) and np.isclose(rim[:, 2].max(), 2.0)


def arrows(sketch: s.Sketch, kind) -> list:
    return [part for part in sketch.parts if isinstance(part, kind)]


@pytest.mark.parametrize("kind", [Sleigh, Snake])
def test_the_forces_of_wheels_do_the_work_of_the_multipliers(kind):
    scene, q = scene_and_pose(kind)
    state = viewer.shown_state(scene, q)
    (sketch,), scale = viewer.sketches_with_arrows(scene, [state])
    forces = arrows(sketch, s.Force)
    assert len(forces) == scene.r
    size = viewer.LONGEST * Drawing(sketch_of(scene, q), ROLES, view=Space(sketch)).size

    def marks(q):
        return np.array([mark.at for mark in arrows(sketch_of(scene, q), s.ConstraintMark)])

    step = 1e-6
    work = [
        sum(
            (marks(state.q + d) - marks(state.q - d))[k] @ one.along for k, one in enumerate(forces)
        )
        for d in step * np.eye(scene.n)
    ]
    a = Evaluation(scene, state.q, state.v).terms.a
    expected = a.T @ state.multipliers * size / scale.force * 2 * step
    assert np.allclose(work, expected, rtol=0, atol=1e-8 * np.abs(expected).max())


def test_points_of_a_pendulum_move_across_its_link():
    scene, q = scene_and_pose(ChainPendulum, 1)
    (sketch,), scale = viewer.sketches_with_arrows(
        scene, [viewer.state_with_multipliers(scene, q, np.array([2.0]))]
    )
    center, tip = (arrow for arrow in arrows(sketch, s.Velocity))
    assert abs(center.along @ center.at) < 1e-6 * np.linalg.norm(tip.along)
    assert np.allclose(tip.along, 2 * center.along)
    assert np.isclose(scale.speed, 2.0 * np.linalg.norm(tip.at))
    assert scale.force == 0.0 and not arrows(sketch, s.Force)


@pytest.mark.parametrize("kind", [Andrews, Bricard, FourBarChain])
def test_the_forces_where_loops_close_do_the_work_of_their_rows(kind):
    scene, q = scene_and_pose(kind)
    state = viewer.shown_state(scene, q)
    (sketch,), scale = viewer.sketches_with_arrows(scene, [state])
    forces, closings = arrows(sketch, s.Force), arrows(sketch, s.Closing)
    assert len(forces) == len(closings) and scale.force > 0.0
    size = viewer.LONGEST * Drawing(sketch_of(scene, state.q), ROLES, view=Space(sketch)).size

    def gaps(q):
        return np.array(
            [np.subtract(x.at, x.other) for x in arrows(sketch_of(scene, q), s.Closing)]
        )

    step = 1e-6
    at = state.q
    rates = [(gaps(at + d) - gaps(at - d)) / (2 * step) for d in step * np.eye(scene.n)]
    along = np.array([force.along for force in forces]) * scale.force / size
    work = np.einsum("nkd,kd->n", np.array(rates), along)
    a = Evaluation(scene, state.q, state.v).terms.a
    rows = [row for closing in closings for row in closing.rows]
    assert a is not None and state.multipliers is not None
    expected = a[rows].T @ state.multipliers[rows]
    assert np.allclose(work, expected, rtol=0, atol=1e-6 * np.abs(expected).max())


def test_a_force_that_a_point_cannot_explain_is_not_drawn(monkeypatch):
    scene, q = scene_and_pose(Bricard)
    state, sketch = viewer.shown_state(scene, q), Bricard.sketch

    def with_the_hinge(scene, q, t=0.0):
        drawn = sketch(scene, q, t)
        parts = [
            x._replace(rows=(0, 1, 2, 3)) if isinstance(x, s.Closing) else x for x in drawn.parts
        ]
        return drawn._replace(parts=tuple(parts))

    monkeypatch.setattr(type(scene), "sketch", with_the_hinge)
    (sketched,), scale = viewer.sketches_with_arrows(scene, [state])
    assert scale.force == 0.0 and not arrows(sketched, s.Force) and arrows(sketched, s.Velocity)


PENDULUM = """<robot name="hanging"><link name="base"/><link name="arm"><inertial>
<origin xyz="0.1 0 -0.5"/><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
</inertial></link><link name="hand"><inertial><origin xyz="0 0 -0.5"/><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="continuous"><parent link="base"/><child link="arm"/>
<origin xyz="0 0 2"/><axis xyz="0 1 0"/></joint>
<joint name="wrist" type="prismatic"><parent link="arm"/><child link="hand"/>
<origin xyz="0 0 -1"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>"""


def test_a_robot_has_its_base_and_no_center_of_mass_without_a_line(tmp_path):
    (tmp_path / "r.urdf").write_text(PENDULUM)
    scene = from_urdf(tmp_path / "r.urdf")
    for q in ([0.0, 0.0], [0.4, 0.3], [0.4, 1.0]):
        sketch = scene.sketch(np.array(q))
        assert [part.at.tolist() for part in arrows(sketch, s.Ground)] == [[0.0, 0.0, 0.0]]
        ends = np.array([line.points for line in arrows(sketch, s.Body)])
        assert ends[0].tolist() == [[0.0, 0.0, 0.0], [0.0, 0.0, 2.0]]
        for center in arrows(sketch, s.Center):
            assert min(np.linalg.norm(ends[:, 1] - center.at, axis=1)) == 0.0
    content = json.loads(viewer.viewer_json(scene, [viewer.shown_state(scene, np.zeros(2))]))
    groups = {trace["meta"]["group"] for trace in content["figure"]["data"]}
    assert groups == {"mechanism", "names", "velocity"}


def test_labels_of_one_point_stand_on_different_sides_of_it():
    parts = [s.Body([(0.0, 0.0, 0.0), (1.0, 1.0, 1.0)])]
    parts += [s.JointMark((1.0, 1.0, 1.0), name=f"joint {k}") for k in range(4)]
    parts += [s.JointMark((0.0, 0.0, 0.0), name="far")]
    sketch = s.Sketch(tuple(parts))
    places = viewer._label_places(Drawing(sketch, ROLES, (), Space(sketch)))
    assert len({*places[:4]}) == 4 and places[0] == places[4] == "top right"


def test_a_sketch_is_the_same_after_it_was_stored_as_text():
    for key in SCENES:
        scene, q = scene_and_pose(SCENES[key])
        sketch = sketch_of(scene, q)
        again = s.sketch_of_text(s.sketch_text(sketch))
        assert s.sketch_text(again) == s.sketch_text(sketch)
        names = scene.coordinate_names
        assert viewer.sketches_json([again], names) == viewer.sketches_json([sketch], names)
    for wrong in ("", "{}", '{"parts": [["Nothing", {}]]}', '{"parts": [["Body", {"x": 1}]]}'):
        with pytest.raises((LookupError, TypeError, ValueError)):
            s.sketch_of_text(wrong)


@pytest.mark.parametrize("key", SCENES)
def test_every_scene_can_be_turned_in_colors_of_the_page(key):
    scene, q = scene_and_pose(SCENES[key])
    content = json.loads(viewer.viewer_json(scene, [viewer.shown_state(scene, q)]))
    traces = content["figure"]["data"]
    roles = {trace["meta"][x] for trace in traces for x in ("color", "fill") if x in trace["meta"]}
    assert roles <= {*Colors._fields} and not any("color" in t.get("line", {}) for t in traces)
    assert {trace["meta"]["group"] for trace in traces} >= {"mechanism", "names", "velocity"}
    assert content["poses"] == [] and content["times"] == [0.0]


def test_each_pose_of_a_motion_has_all_traces():
    content = json.loads(
        viewer.viewer_json(scene := Sleigh.example(), viewer.states_of_motion(scene, "au", 1.0, 4))
    )
    assert np.allclose(content["times"], [0, 1 / 3, 2 / 3, 1])
    traces = content["figure"]["data"]
    assert {len(pose) for pose in content["poses"]} == {len(traces)}
    first = [[trace[x] for x in "xyz"] for trace in traces]
    assert content["poses"][0] == first != content["poses"][1]


def test_a_page_has_its_script_and_the_picture_of_who_runs_none(tmp_path):
    scene, q = scene_and_pose(Sleigh)
    viewer.write_viewer(scene, [viewer.shown_state(scene, q)], tmp_path / "a.html")
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert page.count("data:image/svg+xml;base64,") == 2 and "startViewers(" in page
    assert 'src="http' not in page and 'class="viewer"' in page
