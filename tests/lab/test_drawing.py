"""Pictures: every stroke, dot, label and size, of sketches whose points are chosen by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PIL import Image

from eomcheck.lab.show import pictures, sketch_drawing
from eomcheck.lab.show.chart_matplotlib import plt
from eomcheck.lab.show.pictures import (
    Block,
    Matrix,
    Structure,
    _title,
    canvas,
    paint,
    scene_figure,
    structure_figure,
)
from eomcheck.lab.show.sketch_drawing import DARK, LIGHT, Drawing, View
from eomcheck.mechanics import sketch as s

GROUND = s.Body([(0.0, 0.0), (10.0, 0.0)])
"""Ten metres of ground, which make the size of a picture."""
DASHED = (0, (4, 3))


def drawing(*parts: Any, named: Any = ("x", "φ"), **view: Any) -> Drawing:
    """Return the drawing of parts on light ground, as wide as `GROUND`."""
    return Drawing(s.Sketch((GROUND, *parts), **view), LIGHT, named)


def strokes(of: Drawing) -> list[tuple[Any, ...]]:
    """Return color, width, style, fill and head of the strokes behind the first, the ground's."""
    return [tuple(one)[1:] for one in of.strokes[1:]]


def ends(of: Drawing) -> list[list[list[float]]]:
    """Return the points of the strokes behind the first."""
    return [np.round(one.points, 12).tolist() for one in of.strokes[1:]]


def told(of: Drawing) -> list[tuple[str, list[float], str, list[float] | None]]:
    """Return text, place, colour and direction of the labels."""
    return [
        (x.text, np.round(x.at, 12).tolist(), x.color,
         None if x.away is None else np.round(x.away, 12).tolist())
        for x in of.labels
    ]  # fmt: skip


# ---- How it is seen ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("view", "right", "above"),
    [
        ({"azimuth": 0.0, "elevation": 0.0}, (0, 1, 0), (0, 0, 1)),
        ({"azimuth": np.pi / 2, "elevation": 0.0}, (-1, 0, 0), (0, 0, 1)),
        ({"azimuth": 0.0, "elevation": np.pi / 2}, (0, 1, 0), (-1, 0, 0)),
        ({"azimuth": 0.0, "elevation": 0.0, "up": 1}, (1, 0, 0), (0, 1, 0)),
        ({"azimuth": np.pi / 2, "elevation": 0.0, "up": 1}, (0, 0, -1), (0, 1, 0)),
        (
            {"azimuth": np.pi / 6, "elevation": np.pi / 6},
            (-0.5, 0.75**0.5, 0),
            (-(0.75**0.5) / 2, -0.25, 0.75**0.5),
        ),
    ],
)
def test_space_is_seen_from_an_azimuth_and_an_elevation_about_what_is_up(view, right, above):
    see = View(s.Sketch((), **view))
    assert np.allclose(see.axes, [right, above])
    assert np.allclose(
        see([(1.0, 2.0, 3.0)]), [[np.dot(right, (1, 2, 3)), np.dot(above, (1, 2, 3))]]
    )
    assert see((4.0, 5.0)).tolist() == [[4.0, 5.0]], "the plane is seen as it is"


# ---- Parts of a sketch ---------------------------------------------------------------------------


def test_bodies_are_lines_through_their_points_with_a_name_beside_the_first():
    bar = s.Body([(0.0, 0.0), (3.0, 6.0), (4.0, 4.0)], "bar_1")
    plate = s.Body([(0.0, 0.0), (3.0, 0.0), (0.0, 1.0)], closed=True)
    made = drawing(bar, plate)
    body = LIGHT.body
    assert strokes(made) == [(body, 3.0, "-", "", False), (body, 3.0, "-", body, False)]
    assert ends(made) == [
        [[0.0, 0.0], [3.0, 6.0], [4.0, 4.0]],
        [[0.0, 0.0], [3.0, 0.0], [0.0, 1.0], [0.0, 0.0]],
    ]
    name = r"$\mathrm{bar}_{\mathrm{1}}$"
    assert told(made) == [(name, [2.0, 4.0], LIGHT.ink, [-6.0, 3.0])]
    assert (made.size, made.bounds.tolist()) == (10.0, [[0.0, 0.0], [10.0, 6.0]])


def test_a_joint_is_a_ring_and_on_the_ground_it_stands_on_a_hatched_foot():
    made = drawing(s.JointMark((1.0, 2.0), ground=True, name="pin"), s.JointMark((5.0, 5.0)))
    body, size = LIGHT.body, 0.22
    assert [x[1:3] for x in strokes(made)] == [(1.5, "-"), *[(1.2, "-")] * 3]
    foot, *teeth = ends(made)
    low = 2.0 - 1.6 * size
    assert np.allclose(foot, [[1 - size, low], [1.0, 2.0], [1 + size, low], [1 - size, low]])
    tops = [tooth[0][0] for tooth in teeth]
    assert np.allclose(tops, [1 - 0.5 * size, 1 + 0.2 * size, 1 + 0.9 * size])
    for tooth in teeth:
        assert np.allclose(np.diff(tooth, axis=0), [[-0.4 * size, -0.7 * size]])
        assert np.isclose(tooth[0][1], low)
    dots = [(at.tolist(), *look) for at, *look in made.dots]
    assert dots == [([x, y], body, 8.0, LIGHT.ground) for x, y in ((1.0, 2.0), (5.0, 5.0))]
    assert told(made) == [("pin", [1.0, 2.0], LIGHT.ink, None)]


def test_a_joint_in_space_has_its_axis_a_tenth_of_the_picture_long():
    ground = s.Body([(0.0, 0.0, 0.0), (0.0, 10.0, 0.0)])
    parts = ground, s.JointMark(np.array([0.0, 2.0, 1.0]), axis=(0.0, 0.0, 1.0))
    made = Drawing(s.Sketch(parts, 0.0, 0.0), LIGHT, ())
    assert strokes(made) == [(LIGHT.axis, 4.0, "-", "", False)]
    assert ends(made) == [[[2.0, 0.5], [2.0, 1.5]]]


def test_a_wheel_is_as_long_as_it_is_along_its_way_which_an_arrow_leads_on():
    at, along = np.array([1.0, 1.0]), (0.0, 3.0)
    made = drawing(s.Wheel(at, along, 4.0), s.Wheel(at, along, 4.0, edge=True))
    color = LIGHT.constraint
    arrow = (color, 1.2, "-", "", True)
    assert strokes(made) == [
        *((color, 7.0, "-", "", False), arrow),
        *((color, 4.0, "-", "", False), arrow),
    ]
    assert ends(made) == [[[1.0, -1.0], [1.0, 3.0]], [[1.0, 3.0], [1.0, 4.8]]] * 2
    assert made.kinds == {"constraint"}


def test_centres_constraints_and_trails_are_points():
    made = drawing(
        s.Center((1.0, 2.0), "S"),
        s.ConstraintMark("no slip", (3.0, 4.0), (0,)),
        s.Trail((5.0, 6.0)),
    )
    assert [(at.tolist(), *look) for at, *look in made.dots] == [
        ([1.0, 2.0], LIGHT.ink, 6.0, LIGHT.ink)
    ]
    assert told(made) == [
        ("S", [1.0, 2.0], LIGHT.ink, None),
        ("no slip", [3.0, 4.0], LIGHT.constraint, None),
    ]
    assert made.kinds == {"center", "constraint"}
    assert [x.tolist() for x in made.trails] == [[5.0, 6.0]]


def test_a_spring_sways_seven_times_to_both_sides_between_its_ends():
    made = drawing(s.SpringMark((0.0, 0.0), (0.0, 5.0), "k"))
    (spring,) = [one for one in made.strokes if one.color == LIGHT.spring]
    x, y = spring.points.T
    assert spring[1:] == (LIGHT.spring, 1.5, "-", "", False)
    assert np.allclose(x, [0, 0, *[-0.18, 0.18] * 7, 0, 0])
    assert np.allclose(y, [0, 1.0, *np.linspace(1.2, 3.8, 14), 4.0, 5.0])
    assert told(made) == [("k", [0.0, 2.5], LIGHT.spring, [-1.0, 0.0])]
    assert made.strokes[0] is spring, "it lies below the bodies"
    here = drawing(s.SpringMark((1.0, 1.0), (1.0, 1.0)))
    assert np.allclose(here.strokes[0].points, 1.0), "a spring without length is a point"


@pytest.mark.parametrize(
    ("angle", "end", "style"),
    [
        (np.pi / 2, np.pi / 2, "-"),
        (-1.0, -1.0, "-"),
        (0.15, 0.15, "-"),
        (0.1499, 0.7, (0, (1, 1.5))),
        (-0.1, 0.7, (0, (1, 1.5))),
    ],
)
def test_an_angle_is_an_arc_from_its_reference_and_one_too_small_tells_its_sense(angle, end, style):
    made = drawing(s.Angle("φ", np.array([1.0, 2.0]), (0.0, 1.0), (-1.0, 0.0), angle, 2.0))
    (faint, *look), arc = strokes(made)
    assert (faint, *look) == (LIGHT.faint, 1.0, DASHED, "", False)
    assert arc == (LIGHT.coordinate, 1.8, style, "", True)
    reference, points = ends(made)
    assert reference == [[1.0, 2.0], [1.0, 4.24]]
    turn = np.linspace(0.0, end, 41)
    assert np.allclose(
        points, np.array([1.0, 2.0]) + 2 * np.column_stack((-np.sin(turn), np.cos(turn)))
    )
    middle = 2 * np.array([-np.sin(end / 2), np.cos(end / 2)])
    ((text, at, color, away),) = told(made)
    assert (text, color) == ("φ", LIGHT.coordinate)
    assert np.allclose(at, middle + np.array([1.0, 2.0])) and np.allclose(away, middle)
    other = drawing(s.Angle("β", (0.0, 0.0), (1.0, 0.0), (0.0, 1.0), angle, 2.0))
    assert strokes(other)[1][0] == LIGHT.ink and "coordinate" not in other.kinds
    assert made.kinds == {"coordinate"}


def test_distances_and_arrows_are_dashed_where_they_have_no_name():
    made = drawing(
        s.Distance("x", (0.0, 0.0), (4.0, 2.0)),
        s.Distance("", (0.0, 1.0), (4.0, 1.0)),
        s.Distance("L", (0.0, 0.0), (0.0, 2.0)),
        s.Arrow("x axis", (1.0, 1.0), (2.0, 0.0)),
        s.Arrow("g", (1.0, 1.0), (0.0, -2.0), frame=False),
        s.Arrow("", (1.0, 1.0), (0.0, 3.0)),
    )
    assert strokes(made) == [
        (LIGHT.coordinate, 1.5, "-", "", True),
        (LIGHT.faint, 1.5, DASHED, "", False),
        (LIGHT.ink, 1.5, "-", "", True),
        (LIGHT.axis, 1.6, "-", "", True),
        (LIGHT.ink, 2.4, "-", "", True),
        (LIGHT.faint, 1.0, DASHED, "", False),
    ]
    assert ends(made)[3:] == [
        [[1.0, 1.0], [3.0, 1.0]],
        [[1.0, 1.0], [1.0, -1.0]],
        [[1.0, 1.0], [1.0, 4.0]],
    ]
    assert told(made) == [
        ("x", [2.0, 1.0], LIGHT.coordinate, [-2.0, 4.0]),
        ("L", [0.0, 1.0], LIGHT.ink, [-2.0, 0.0]),
        ("x", [3.0, 1.0], LIGHT.axis, [2.0, 0.0]),
        ("g", [1.0, -1.0], LIGHT.ink, [0.0, -2.0]),
    ]
    assert made.kinds == {"coordinate", "axis", ""}


@pytest.mark.parametrize("ball", [False, True])
@pytest.mark.parametrize("axis", [(0.0, 0.0, 5.0), (0.0, 1.0, 1.0), (-2.0, 0.0, 0.0)])
def test_a_disk_is_a_circle_about_its_axis_and_a_ball_one_from_all_sides(axis, ball):
    center, radius = np.array([1.0, 2.0, 3.0]), 1.5
    view = {"azimuth": 0.0, "elevation": 0.0}
    made = Drawing(s.Sketch((s.Disk(center, axis, radius, "disk", ball),), **view), LIGHT, ())
    (rim,) = made.strokes
    assert rim[1:] == (LIGHT.body, 2.0 if ball else 2.5, "-", LIGHT.body, False)
    assert len(rim.points) == 73 and np.allclose(rim.points[0], rim.points[-1])
    # Its width along a direction is that of the circle: 2 R times the sine of axis and direction.
    unit = np.asarray(axis) / np.linalg.norm(axis)
    wide, high = np.ptp(rim.points, axis=0) / 2
    sines = [np.sqrt(1 - unit[i] ** 2) for i in (1, 2)]
    assert np.allclose((wide, high), radius if ball else radius * np.array(sines), rtol=1e-2)
    assert np.allclose(rim.points[:-1].mean(axis=0), [2.0, 3.0])
    ((text, at, color, away),) = told(made)
    assert (text, color) == ("disk", LIGHT.ink)
    least = (rim.points @ [1.0, 0.6]).min()
    assert np.isclose(np.dot(at, [1.0, 0.6]), least)
    assert np.allclose(away, at - rim.points.mean(axis=0))


def test_ground_lies_below_disks_springs_bodies_wheels_and_measures():
    plane = s.Plane([(0.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 1.0, 1.0)])
    zero, one = np.zeros(3), np.array([0.0, 1.0, 0.0])
    parts = (
        s.Angle("φ", zero, one, (0.0, 0.0, 1.0), 1.0, 1.0),
        s.Arrow("", zero, one),
        s.Distance("x", zero, one),
        s.Wheel(zero, one, 1.0),
        s.Body([zero, one]),
        s.SpringMark(zero, one),
        s.Disk(zero, one, 1.0),
        plane,
    )
    made = Drawing(s.Sketch(parts, 0.0, 0.0), LIGHT, ("φ", "x"))
    assert [one.width for one in made.strokes] == [0.6, 2.5, 1.5, 3.0, 7.0, 1.2, 1.5, 1.0, 1.0, 1.8]
    ground = made.strokes[0]
    assert ground.points.tolist() == [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 0.0]]
    assert (ground.color, ground.fill) == (LIGHT.faint, LIGHT.faint)
    # Without names no measures are drawn.
    bare = Drawing(s.Sketch((*parts, s.Center(zero, "S")), 0.0, 0.0), LIGHT)
    assert [one.width for one in bare.strokes] == [0.6, 2.5, 1.5, 3.0, 7.0]
    assert (bare.labels, bare.dots, bare.kinds) == ([], [], {"constraint"})


# ---- The page ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("bounds", "x", "y", "height"),
    [
        ([[0, 0], [10, 5]], (-0.9, 10.9), (-0.9, 5.9), 7 * 6.8 / 11.8),
        ([[0, 0], [1, 10]], (0.5 - 7.375, 0.5 + 7.375), (-0.9, 10.9), 5.6),
        ([[0, 2], [10, 2]], (-0.9, 10.9), (2 - 2.36, 2 + 2.36), 2.8),
    ],
)
def test_a_page_is_neither_flat_nor_tall_and_has_a_margin_and_room_below(bounds, x, y, height):
    axes = canvas(np.array(bounds, float), DARK, 7.0, below=0.35)
    figure = axes.figure
    assert (axes.get_xlim(), axes.get_ylim()) == (pytest.approx(x), pytest.approx(y))
    assert figure.get_size_inches() == pytest.approx((7.0, height + 0.35))
    share = 0.35 / (height + 0.35)
    assert axes.get_position().bounds == pytest.approx((0.0, share, 1.0, 1 - share))
    assert plt.matplotlib.colors.to_hex(figure.get_facecolor()) == DARK.ground
    assert figure.dpi == 100 and not axes.axison
    plt.close(figure)


def test_strokes_and_dots_are_painted_as_they_are_drawn():
    made = drawing(
        s.Body([(0.0, 0.0), (3.0, 0.0), (0.0, 1.0)], closed=True),
        s.Distance("", (0.0, 0.0), (1.0, 1.0)),
        s.Distance("x", (0.0, 2.0), (1.0, 3.0)),
        s.JointMark((4.0, 4.0)),
    )
    axes = canvas(made.bounds, LIGHT, 7.0)
    paint(axes, made)
    to_hex = plt.matplotlib.colors.to_hex
    lines = [(x.get_linewidth(), x.get_marker(), to_hex(x.get_color())) for x in axes.lines]
    assert [x[:2] for x in lines] == [*[(3.0, "None")] * 2, *[(1.5, "None")] * 2, (1.5, "o")]
    assert [x[2].upper() for x in lines] == [
        x.upper() for x in (LIGHT.body, LIGHT.body, LIGHT.faint, LIGHT.coordinate, LIGHT.body)
    ]
    assert axes.lines[0].get_xdata().tolist() == [0.0, 10.0]
    assert axes.lines[2].is_dashed() and not axes.lines[3].is_dashed()
    dot = axes.lines[-1]
    assert (dot.get_xdata(), dot.get_ydata()) == ([4.0], [4.0])
    assert (dot.get_markersize(), dot.get_markerfacecolor()) == (8.0, LIGHT.ground)
    (area,) = axes.patches
    assert (area.get_alpha(), area.get_linewidth()) == (0.12, 0)
    assert to_hex(area.get_facecolor()) == LIGHT.body
    (head,) = axes.texts
    assert (list(head.xy), list(head.xyann)) == ([1.0, 3.0], [0.0, 2.0])
    assert (head.arrow_patch.get_linewidth(), head.arrow_patch.shrinkA) == (1.5, 0)
    plt.close(axes.figure)


@pytest.mark.parametrize("dark", [False, True])
def test_the_legend_has_the_kinds_that_are_drawn(dark):
    parts = (
        GROUND,
        s.Distance("x", (0.0, 0.0), (4.0, 0.0)),
        s.Arrow("y axis", (0.0, 0.0), (0.0, 4.0)),
    )
    colors = DARK if dark else LIGHT
    figure, texts = scene_figure(s.Sketch(parts), ("x",), dark)
    (legend,) = figure.legends
    assert [x.get_text() for x in legend.get_texts()] == ["coordinate", "axis of a frame"]
    assert [x.get_color() for x in legend.get_lines()] == [colors.coordinate, colors.axis]
    to_hex = plt.matplotlib.colors.to_hex
    assert {to_hex(x.get_color()) for x in legend.get_texts()} == {colors.ink}
    assert sorted(x.get_text() for x in texts) == ["x", "y"]
    plt.close(figure)
    more = s.Center((1.0, 0.0)), s.ConstraintMark("c", (2.0, 0.0), (0,))
    figure, _ = scene_figure(s.Sketch((GROUND, *more)), (), dark)
    (legend,) = figure.legends
    assert [x.get_text() for x in legend.get_texts()] == ["constraint", "centre of mass"]
    assert legend.get_lines()[-1].get_marker() == "o"
    plt.close(figure)


# ---- Labels --------------------------------------------------------------------------------------


def array(*numbers: float) -> np.ndarray:
    return np.array(numbers, float)


FRAME = SimpleNamespace(x0=0.0, y0=0.0, x1=100.0, y1=100.0)
NOTHING = np.zeros((0, 2))


def test_points_along_a_line_are_four_pixels_apart_or_less_and_both_ends_are_among_them():
    assert sketch_drawing._sampled(np.array([[0, 0], [9, 0], [9, 3]], float)).tolist() == [
        *([9.0, 3.0], [0.0, 0.0], [4.5, 0.0], [9.0, 0.0])
    ]


def test_places_of_a_label_are_all_around_and_cost_distance_and_the_wrong_direction():
    places = sketch_drawing._positions(array(50, 50), array(20, 10), None)
    assert len(places) == 7 * 16
    assert places[0][0].tolist() == [69.0, 50.0] and places[0][1] == 0.25 * 9
    assert np.allclose(places[4][0], [50.0, 64.0]) and np.allclose(places[8][0], [31.0, 50.0])
    assert np.allclose(places[16][0], [76.0, 50.0]) and places[16][1] == 4.0
    for away in (array(0, 3), array(0, 0.1)):
        costs = [cost for _, cost in sketch_drawing._positions(array(50, 50), array(20, 10), away)]
        assert np.allclose([costs[k] for k in (0, 4, 8, 12)], [7.25, 2.25, 7.25, 12.25])
    still = sketch_drawing._positions(array(50, 50), array(20, 10), array(0, 0))
    assert [cost for _, cost in still[:16]] == [2.25] * 16


def test_a_label_costs_what_it_covers_and_what_is_off_the_page():
    points = np.array([[50, 50], [51, 50], [52, 50], [50, 51], [40, 50]], float)
    box = array(50, 50), array(4, 2)
    assert sketch_drawing._cost(*box, [], points, FRAME) == 12.0, "of those within, not on its edge"
    over, beside = np.array([[51, 50], [60, 60]]), np.array([[52, 49], [60, 51]])
    assert sketch_drawing._cost(*box, [over, beside, over], NOTHING, FRAME) == 2e4
    above = np.array([[48, 51], [52, 60]])
    assert sketch_drawing._cost(*box, [above], NOTHING, FRAME) == 0.0
    assert sketch_drawing._cost(array(99, 0), array(4, 2), [], NOTHING, FRAME) == 2e3
    assert sketch_drawing._cost(array(1, 100.5), array(4, 2), [], NOTHING, FRAME) == 2.5e3


def test_a_line_leads_to_a_label_that_is_far_and_ends_at_its_edge():
    size = array(10, 4)
    assert sketch_drawing._leader(array(0, 0), array(27, 0), size) is None
    assert sketch_drawing._leader(array(0, 0), array(27.1, 0), size) is not None
    leader = sketch_drawing._leader(array(0, 0), array(30, 0), size)
    assert np.allclose(leader, [[0, 0], [25, 0]])
    slanted = sketch_drawing._leader(array(1, 1), array(31, 41), size)
    assert np.allclose(slanted, [[1, 1], [29.5, 39]])


def test_a_line_to_a_label_costs_labels_and_lines_that_it_crosses_but_not_at_its_start():
    leader = np.array([[0, 0], [40, 0]], float)
    assert sketch_drawing._cost_of_leader(None, [], NOTHING) == 0.0
    assert sketch_drawing._cost_of_leader(leader, [], NOTHING) == 0.0
    across, beside = np.array([[20, -1], [30, 1]]), np.array([[20, 0], [30, 1]])
    assert sketch_drawing._cost_of_leader(leader, [across, beside, across], NOTHING) == 1000.0
    points = np.array([[24, 1.9], [32, -1.0], [16, 2.0], [4, 0.0], [8, 0]], float)
    assert sketch_drawing._cost_of_leader(leader, [], points) == 6.0
    assert sketch_drawing._cost_of_leader(leader, [across], points) == 506.0


def test_a_label_is_put_where_it_costs_least():
    at, size, away = array(50, 50), array(20, 10), array(0, 1)
    best = sketch_drawing._best(at, size, away, [], NOTHING, FRAME)
    assert np.allclose(best, [50, 64])
    taken = [np.array([[40, 59], [60, 69]], float)]
    other = sketch_drawing._best(at, size, away, taken, NOTHING, FRAME)
    assert sketch_drawing._cost(other, size, taken, NOTHING, FRAME) == 0.0
    assert np.hypot(*(other - at)) < 40 and other[1] > 50


def test_labels_are_written_the_shortest_first_and_do_not_cover_each_other():
    figure, axes = plt.subplots(figsize=(4, 4), dpi=100)
    axes.set(xlim=(0, 1), ylim=(0, 1))
    points = np.array([[0.5, 0.5], [0.6, 0.5]])
    three = [
        sketch_drawing.Label(text, np.array([0.5, 0.5]), color, away)
        for text, color, away in (
            ("a sentence", "#ff0000", None),
            ("x", "#00ff00", np.array([0.0, 1.0])),
            ("long", "#0000ff", np.array([0.0, 1.0])),
        )
    ]
    texts = sketch_drawing.place_labels(axes, three, [points], "#888888")
    assert [x.get_text() for x in texts] == ["x", "long", "a sentence"]
    assert [x.get_color() for x in texts] == ["#00ff00", "#0000ff", "#ff0000"]
    assert {x.get_fontsize() for x in texts} == {15.0}
    x, y = texts[0].get_position()
    assert x == pytest.approx(0.5) and 0.5 < y < 0.6
    boxes = [one.get_window_extent() for one in texts]
    assert not any(boxes[i].overlaps(boxes[j]) for i, j in ((0, 1), (0, 2), (1, 2)))
    plt.close(figure)


@pytest.mark.parametrize(
    ("name", "written"),
    [
        ("θ_1", r"$\mathrm{θ}_{\mathrm{1}}$"),
        ("rod_12 turns", r"$\mathrm{rod}_{\mathrm{12}}$ turns"),
        ("a_b_c", r"$\mathrm{a}_{\mathrm{b_c}}$"),
        ("φ", "φ"),
        ("_x", "_x"),
    ],
)
def test_what_stands_behind_an_underscore_is_an_index(name, written):
    assert sketch_drawing.symbol(name) == written


# ---- Matrices ------------------------------------------------------------------------------------


def matrix(name: str, entries: Any, *blocks: Block, columns: Any = (("", 1),)) -> Matrix:
    return Matrix(name, np.asarray(entries, float), blocks, columns)


@pytest.mark.parametrize(
    ("name", "blocks", "title"),
    [
        ("M_Au", ("M", "-aᵀ"), r"$\mathrm{M}_\mathrm{Au}$"),
        ("M_Em", ("wᵀ M w",), r"$\mathrm{M}_\mathrm{Em}$ = wᵀ M w"),
        ("a_1", ("a₁",), "a₁"),
        ("a_1", ("",), r"$\mathrm{a}_\mathrm{1}$"),
        ("a M^-1 aT", ("a M⁻¹ aᵀ",), "a M⁻¹ aᵀ"),
        ("∂V/∂u", ("",), "∂V/∂u"),
    ],
)
def test_a_matrix_is_called_what_it_equals_if_that_says_more(name, blocks, title):
    made = [Block(one, slice(0, 1), slice(0, 1)) for one in blocks]
    assert _title(matrix(name, [[1.0]], *made)) == title


def figure_of(*read: Matrix, solved: Any = (), dark: bool = False) -> tuple[Any, Any]:
    figure = structure_figure(Structure(read, tuple(solved)), dark)
    plt.close(figure)
    return figure, figure.axes[0]


def test_the_entries_of_a_matrix_are_squares_in_the_colours_of_its_blocks():
    entries = np.zeros((5, 7))
    entries[0, 0], entries[2, 1], entries[4, 6], entries[3, 3] = 1.0, -2.0, 3.0, 4.0
    three, last = slice(0, 3), slice(3, 5)
    blocks = (
        Block("M", three, slice(0, 3)),
        Block("-aᵀ", three, slice(3, 7)),
        Block("-a", last, slice(0, 3)),
        Block("", last, slice(3, 7)),
    )
    made = matrix("M_Au", entries, *blocks, columns=(("v̇", 3), ("λ", 4)))
    figure, axes = figure_of(solved=[made])
    (wide, _), (high, _) = axes.get_xlim()[::-1], axes.get_ylim()
    side = 0.21
    assert (wide, high) == (pytest.approx(7.0 / side), 9.0)
    assert figure.get_size_inches() == pytest.approx((7.0, 9.0 * side))
    free = (wide - 7) / 2
    squares = {
        (round(x.get_x() - free, 6), round(x.get_y() - 3, 6)): x.get_facecolor()
        for x in axes.patches
        if x.get_width() == 0.88
    }
    to_rgba = plt.matplotlib.colors.to_rgba
    assert squares == {
        (0.06, 0.06): to_rgba(LIGHT.coordinate),
        (1.06, 2.06): to_rgba(LIGHT.coordinate),
        (6.06, 4.06): to_rgba(LIGHT.axis),
        (3.06, 3.06): to_rgba(LIGHT.axis),
    }
    frames = [
        (round(x.get_x() - free, 6), x.get_y() - 3, x.get_width(), x.get_height())
        for x in axes.patches
        if x.get_width() != 0.88
    ]
    assert frames == [(0, 0, 3, 3), (3, 0, 4, 3), (0, 3, 3, 2), (3, 3, 4, 2), (0, 0, 7, 5)]
    texts = [
        (x.get_text(), *np.round(np.array(x.get_position()) - [free, 3.0], 6).tolist())
        for x in axes.texts
    ]
    assert texts == [
        ("M", 1.5, 1.5),
        ("0", 5.0, 1.5),
        ("0", 7.3, 4.0),
        ("v̇", 1.5, -0.15),
        ("λ", 5.0, -0.15),
        (r"$\mathrm{M}_\mathrm{Au}$   5 × 7", 3.5, round(-0.25 - 16 / (72 * side), 6)),
    ]
    sizes = [x.get_fontsize() for x in axes.texts]
    assert sizes == [15.0, 12.0, 12.0, 13.0, 13.0, 12.0]


def test_small_matrices_stand_side_by_side_and_of_wide_ones_those_read_above_each_other():
    eye = [matrix("M", np.eye(4)), matrix("a", np.ones((2, 4)))]
    _, axes = figure_of(*eye)
    frames = [x for x in axes.patches if x.get_width() != 0.88]
    assert [x.get_y() for x in frames] == [3.0, 3.0]
    wide = axes.get_xlim()[1]
    free = (wide - 8) / 3
    assert [x.get_x() for x in frames] == pytest.approx([free, 2 * free + 4])
    assert axes.get_ylim()[0] == 8.0
    large = [matrix("M", np.eye(16)), matrix("a", np.ones((2, 16)))]
    _, axes = figure_of(*large, solved=[matrix("x", np.eye(3))])
    frames = [x for x in axes.patches if x.get_width() != 0.88]
    assert [x.get_y() for x in frames] == [3.0, 22.0, 3.0]
    assert frames[0].get_x() == frames[1].get_x() < frames[2].get_x()
    assert axes.get_ylim()[0] == 25.0
    title = [x.get_text() for x in axes.texts]
    assert title == ["M   16 × 16", "a   2 × 16", "x   3 × 3"]
    assert [x.get_position()[1] for x in axes.texts] == [2.75, 21.75, 2.75]


def test_many_entries_are_smaller_and_dark_ground_has_its_own_colours():
    figure, axes = figure_of(matrix("M", np.zeros((64, 64))), dark=True)
    side = 7.0 / (64 + 6)
    assert figure.get_size_inches() == pytest.approx((7.0, 68 * side))
    assert plt.matplotlib.colors.to_hex(figure.get_facecolor()) == DARK.ground
    (frame,) = axes.patches
    assert plt.matplotlib.colors.to_hex(frame.get_edgecolor()) == DARK.ink


# ---- Motions -------------------------------------------------------------------------------------


def test_a_motion_stays_in_its_picture_and_leaves_its_trail_in_every_frame(tmp_path, monkeypatch):
    places = [(0.0, 0.0), (-5.0, 3.0), (2.0, -4.0), (6.0, 1.0), (1.0, 1.0)]
    sketches = [s.Sketch((s.Body([at, (1.0, 0.0)]), s.Trail(at)), up=1) for at in places]
    shown: list[Any] = []

    def framed(bounds, *look):
        axes = canvas(bounds, *look)
        shown.append((bounds, axes))
        return axes

    monkeypatch.setattr(pictures, "canvas", framed)
    monkeypatch.setattr(plt, "close", lambda figure: None)
    path = tmp_path / "motion.gif"
    pictures.draw_motion(sketches, [0.0, 0.5, 1.0, 1.5, 2.0], path, 2)
    monkeypatch.undo()
    assert len(shown) == 3
    for k, (bounds, axes) in enumerate(shown):
        assert bounds.tolist() == [[-5.0, -4.0], [6.0, 3.0]]
        trail = axes.lines[0].get_xydata()
        assert trail.tolist() == [list(at) for at in places[: 2 * k + 1]]
        assert axes.texts[-1].get_text() == f"t = {k:.2f} s"
        plt.close(axes.figure)
    with Image.open(path) as picture:
        durations = []
        for k in range(picture.n_frames):
            picture.seek(k)
            durations.append(picture.info["duration"])
    assert durations == [80, 80, 1200]


def test_the_ground_of_a_motion_reaches_beyond_its_traced_points():
    """Two disks that roll far from the patch that their still picture shows."""
    patch = s.Plane([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0)])
    sketches = [
        s.Sketch(
            (
                patch,
                *(s.Disk((x, 0.5, 0.5), (0.0, 1.0, 0.0), radius) for radius in (0.5, 0.2)),
                s.Trail((x, -x, 0.0)),
            )
        )
        for x in (0.0, 9.0)
    ]
    first, last = pictures.on_wide_ground(sketches)
    assert first.parts[1:] == sketches[0].parts[1:] and last.parts[1:] == sketches[1].parts[1:]
    beside = 0.5 * pictures.BESIDE_TRAILS
    corners = np.array(first.parts[0].points)
    np.testing.assert_allclose(corners.min(axis=0), [-beside, -9.0 - beside, 0.0])
    np.testing.assert_allclose(corners.max(axis=0), [9.0 + beside, beside, 0.0])
    assert last.parts[0] is first.parts[0]
    for missing in (s.Plane, s.Trail):
        without = [
            x._replace(parts=tuple(y for y in x.parts if not isinstance(y, missing)))
            for x in sketches
        ]
        assert pictures.on_wide_ground(without) == without
    shown = pictures.Drawing(first, pictures.LIGHT)
    assert s.Plane in shown.drawn
    bare = [x._replace(parts=(patch, x.parts[-1])) for x in sketches]
    (ground, _), _ = (x.parts for x in pictures.on_wide_ground(bare))
    assert np.ptp(ground.points, axis=0).tolist() == [9.0, 9.0, 0.0]  # nothing rolls on it
