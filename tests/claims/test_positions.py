"""Claims about positions, heights and moved scenes: mistakes that both derivations share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from tests.mechanics.descriptions import Arm, FourBar

import eomcheck
from eomcheck.claims.terms_and_positions import tried_motions
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.mechanics.parameters import Parametric, parameter
from eomcheck.mechanics.records import Jacobians, Symmetry
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import generic

Columns = Callable[[Any, Any, Any], list[list[Any]]]


def body(
    columns: Columns, names: str, angles: slice, height: Callable | None = None, **more: Any
) -> Scene:
    """Return a body in the plane, both of whose derivations are made of one velocity.

    Args:
        columns: function of (q, cos, sin of the angles): ∂V/∂v, a column a coordinate.
        names: of the coordinates.
        angles: which are angles; ω is the sum of their rates.
        height: function of (q, cos, sin), of which U is m g times; None where there is none.
        more: further functions of the scene.
    """
    n = len(names.split())
    turning = [int(i in range(n)[angles]) for i in range(n)]

    def of(angle):
        return (None, None) if angle is None else (angle.cos, angle.sin)

    @generic
    def jacobians(parameters, angle, q, v):
        J = np.array([columns(q, *of(angle))], v.dtype).swapaxes(1, 2)
        rest = np.zeros((1, 2), v.dtype), np.zeros((1, 1), v.dtype)
        return Jacobians(J, np.array([[turning]], v.dtype), *rest)

    @generic
    def velocities(parameters, angle, q, v):
        V = np.zeros((1, 2), v.dtype)
        for column, rate in zip(columns(q, *of(angle)), v, strict=True):
            V[0, 0] += column[0] * rate
            V[0, 1] += column[1] * rate
        omega = sum(turns * rate for turns, rate in zip(turning, v, strict=True))
        return V, np.array([[omega]], v.dtype)

    @generic
    def potential(parameters, angle, q):
        weight = parameters.mass[0] * parameters.gravity[0]
        return None if height is None else weight * height(q, *of(angle))

    written = {"jacobians": jacobians, "velocities": velocities, "potential": potential, **more}

    class Body(Parametric, functions=written):
        """A body of a test."""

        mass: Any = parameter("m", "kg", "> 0", (1.0, 2.0), (1,), default=(1.5,))
        inertia: Any = parameter("central", "kg m²", ">= 0", (1.0, 2.0), (1,), default=(0.5,))
        gravity: Any = parameter("down", "m/s²", default=9.81)

        key, conserves_energy, angle_coordinates = "body", True, angles
        named_coordinates = tuple(names.split())

        def initial_state(self):
            return np.linspace(0.4, 0.9, n), np.linspace(0.5, 1.0, n)

    return Body()


def failed(scene: Scene, claims: list[str] | None = None) -> set[str]:
    """Return what fails at the beginning, as "claim subject"."""
    found = eomcheck.check_state(scene, *scene.initial_state(), claims=claims, engines=[])
    return {f"{one.claim} {one.subject}" for one in found if one.verdict == "failed"}


NEW = ["position-velocity", "height-velocity", "moved-energy"]
LAST = slice(2, 3)
PLACES = "x y θ"


def free(q, cos, sin):
    return [[1, 0], [0, 1], [0, 0]]


def fast_along_x(q, cos, sin):
    return [[q[0] * 0 + 11, 0], [0, 10], [0, 0]]


# ---- Motions of the whole scene ------------------------------------------------------------------


def test_a_free_body_that_does_not_say_how_it_may_be_moved_is_moved():
    scene = body(free, PLACES, LAST)
    found = eomcheck.check_state(scene, *scene.initial_state(), claims=["moved-energy"])
    assert {(f.subject, f.verdict) for f in found} == {
        ("translation", "passed"),
        ("rotation", "passed"),
    }


def test_a_velocity_that_both_derivations_have_wrong_is_told_by_the_moved_scene_alone():
    assert failed(body(fast_along_x, PLACES, LAST)) == {"moved-energy rotation"}


@pytest.mark.parametrize(
    ("columns", "told"),
    [
        (lambda q, cos, sin: [[1 + sin[0] / 9, 0], [0, 1], [0, 0]], {"rotation"}),
        (lambda q, cos, sin: [[1 + sin[0] / 9, 0], [0, 1 + sin[0] / 9], [0, 0]], {"rotation"}),
        (lambda q, cos, sin: [[1 + q[0] / 9, 0], [0, 1], [0, 0]], {"rotation", "translation"}),
        (lambda q, cos, sin: [[1, 0], [0, 1], [q[1] / 9, 0]], {"rotation", "translation"}),
    ],
    ids=["heading", "heading, both ways", "place", "place and turn"],
)
def test_kinetic_energy_that_changes_with_heading_or_place_fails(columns: Columns, told: set[str]):
    expected = {f"moved-energy {name}" for name in told}
    assert failed(body(columns, PLACES, LAST), ["moved-energy"]) == expected


def test_an_error_of_a_billionth_in_the_kinetic_energy_fails():
    tiny = body(lambda q, cos, sin: [[10**9 + 1, 0], [0, 10**9], [0, 0]], PLACES, LAST)
    assert failed(tiny, ["moved-energy"]) == {"moved-energy rotation"}


def turning_frame(q, cos, sin):
    """x and y on a table that turns by θ."""
    x, y = q[0], q[1]
    c, s = cos[0], sin[0]
    return [[c, s], [-s, c], [-s * x - c * y, c * x - s * y]]


def on_a_cart(q, cos, sin):
    return [[1, 0], [0, 1], [1, 0]]


@pytest.mark.parametrize(
    ("columns", "names", "angles", "tried"),
    [
        (turning_frame, PLACES, LAST, set()),
        (free, "x s θ", LAST, set()),  # along a rail
        (free, "s p θ", LAST, set()),  # nobody says that they are places
        (free, "x yaw θ", LAST, set()),
        (free, "x_1 y_1 θ", LAST, {"rotation", "translation"}),
        (lambda q, cos, sin: [[0, 0], [0, 0], [1, 0]], PLACES, LAST, set()),  # it stays
        (on_a_cart, "x y s", slice(0, 0), {"translation"}),  # a length that does not turn
    ],
    ids=["turning frame", "rail", "names", "yaw", "numbered", "stays", "cart"],
)
def test_no_motion_is_tried_where_there_is_a_reason_against_it(columns, names, angles, tried):
    scene = body(columns, names, angles)
    there = Evaluation(scene, *scene.initial_state())
    assert {one.name for one in tried_motions(there)} == tried
    assert not failed(scene, ["moved-energy"])


def test_no_motion_is_tried_of_a_scene_that_a_clock_drives():
    scene = body(free, PLACES, LAST)
    right = type(scene).velocities

    @generic
    def driven(parameters, angle, q, v):
        V, omega = right(parameters, angle, q, v)
        return V + parameters.mass[0], omega

    kind: Any = type("Driven", (type(scene),), {"velocities": staticmethod(driven)})
    assert not list(tried_motions(Evaluation(kind(), *scene.initial_state())))


def test_the_motions_that_are_tried_turn_and_shift_the_scene():
    scene = body(free, PLACES, LAST)
    q, v = scene.initial_state()
    moved = {one.name: one for one in tried_motions(Evaluation(scene, q, v))}
    assert isinstance(moved["rotation"], Symmetry)
    c, s = np.cos(0.75), np.sin(0.75)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    assert moved["rotation"].q == pytest.approx(turn @ q + [0, 0, 0.75])
    assert moved["rotation"].v == pytest.approx(turn @ v)
    assert moved["translation"].q == pytest.approx(q + np.array([3.0, -2.0, 0]))
    assert moved["translation"].v == pytest.approx(v)


@pytest.mark.parametrize(
    ("first", "tried"),
    [((1, 0), {"rotation", "translation"}), ((1, 1), {"translation"})],
    ids=["first angle", "sum"],
)
def test_a_scene_is_turned_by_relative_angles_where_its_bodies_tell_by_which(first, tried):
    """The second body, at the end of two links, turns by both angles; the first one by `first`."""
    turning = [[0, 0, *first], [0, 0, 1, 1]]

    def columns(angle):
        (c, c2), (s, s2) = angle.cos, angle.sin
        both = [-2 * (s * c2 + c * s2), 2 * (c * c2 - s * s2)]
        return [[1, 0], [0, 1], [both[0] - s, both[1] + c], both]

    @generic
    def jacobians(parameters, angle, q, v):
        zero, one = 0 * v[0], 1 + 0 * v[0]
        first = [[one, zero], [zero, one], [zero, zero], [zero, zero]]
        J = np.array([first, columns(angle)], v.dtype).swapaxes(1, 2)
        rest = np.zeros((2, 2), v.dtype), np.zeros((2, 1), v.dtype)
        return Jacobians(J, np.array(turning, v.dtype).reshape(2, 1, 4), *rest)

    @generic
    def velocities(parameters, angle, q, v):
        V = sum(np.array(x, v.dtype) * rate for x, rate in zip(columns(angle), v, strict=True))
        omega = [[sum(x * rate for x, rate in zip(one, v, strict=True))] for one in turning]
        return np.array([[v[0], v[1]], V], v.dtype), np.array(omega, v.dtype)

    class Links(Parametric, functions={"jacobians": jacobians, "velocities": velocities}):
        """Two bodies on links."""

        mass: Any = parameter("m", "kg", "> 0", (1.0, 2.0), (2,), default=(1.5, 0.5))
        inertia: Any = parameter("central", "kg m²", ">= 0", (1.0, 2.0), (2,), default=(0.5, 0.25))
        key, conserves_energy, angle_coordinates = "links", True, slice(2, 4)
        named_coordinates = ("x", "y", "θ", "φ")

        def initial_state(self):
            return np.linspace(0.4, 0.9, 4), np.linspace(0.5, 1.0, 4)

    scene = Links()
    q, v = scene.initial_state()
    moved = {one.name: one.q for one in tried_motions(Evaluation(scene, q, v))}
    found = eomcheck.check_state(scene, q, v, claims=["moved-energy"], engines=[])
    assert {(f.subject, f.verdict) for f in found} == {(name, "passed") for name in moved}
    assert set(moved) == tried
    if "rotation" in tried:
        assert moved["rotation"][2:] - q[2:] == pytest.approx([0.75, 0.0])


# ---- Positions and heights -----------------------------------------------------------------------


def swinging(length: float) -> Columns:
    return lambda q, cos, sin: [[length * cos[0], length * sin[0]]]


def low(q, cos, sin):
    return -2 * cos[0]


@pytest.mark.parametrize(("length", "told"), [(2, False), (3, False), (1, True), (-2, False)])
def test_a_body_that_is_slower_than_its_height_in_the_potential_fails(length: int, told: bool):
    """One height bounds a velocity from below; a body may move across it as it likes."""
    scene = body(swinging(length), "θ", slice(0, 1), low)
    found = eomcheck.check_state(scene, [1.5], [0.5], claims=NEW)  # it rises steeply
    checked = (f for f in found if f.verdict != "skipped")
    assert {f"{f.claim} {f.subject}": f.verdict for f in checked} == {
        "height-velocity body 1": "failed" if told else "passed"
    }


def test_a_body_that_is_slower_by_a_billionth_than_its_height_fails_in_every_direction():
    n = 10**9
    slow = body(lambda q, cos, sin: [[1, 0], [0, n - 1]], "p s", slice(0, 0), _second)
    right = body(lambda q, cos, sin: [[1, 0], [0, n]], "p s", slice(0, 0), _second)
    assert failed(slow, ["height-velocity"]) == {"height-velocity body 1"}
    assert not failed(right, ["height-velocity"])


def _second(q, cos, sin):
    return 10**9 * q[1]


def of_positions(columns: Columns) -> Scene:
    @generic
    def positions(parameters, angle, q):
        return np.array([[2 * angle.sin[0], -2 * angle.cos[0]]], q.dtype)

    return body(columns, "θ", slice(0, 1), low, positions=positions)


@pytest.mark.parametrize("length", [2, 3, 1])
def test_a_body_that_moves_otherwise_than_its_position_fails(length: int):
    told = failed(of_positions(swinging(length)), NEW)
    assert ("position-velocity body 1" in told) == (length != 2)
    assert "position-velocity body 1" in {
        f"{f.claim} {f.subject}"
        for f in eomcheck.check_state(of_positions(swinging(2)), [0.4], [0.5], claims=NEW)
    }


def test_what_weighs_beside_the_bodies_is_no_height_of_theirs():
    @generic
    def heavy(parameters, angle, q):
        return parameters.mass[0] * parameters.gravity[0] * 10 * q[0] + parameters.gravity[0] * q[0]

    scene = body(lambda q, cos, sin: [[1, 0]], "s", slice(0, 0), potential=heavy)
    (skipped,) = eomcheck.check_state(scene, *scene.initial_state(), claims=["height-velocity"])
    assert skipped.verdict == "skipped"


@pytest.mark.parametrize("plane", [FourBar, Arm], ids=lambda kind: kind.key)
def test_a_body_that_moves_otherwise_than_where_the_potential_has_it_fails(plane: type[Scene]):
    """Gravity with all its components tells whole positions."""
    right: Any = plane.velocities

    @generic
    def fast(parameters, prepared, q, v):
        V, omega = right(parameters, prepared, q, v)
        return V * (10**9 + 1) / 10**9, omega

    kind: Any = type("Fast", (plane,), {"velocities": staticmethod(fast)})
    bodies = {f"position-velocity body {i}, U" for i in (1, 2, 3)}
    assert failed(kind(), ["position-velocity"]) == bodies
    assert not failed(plane(), ["position-velocity"])


def test_a_position_of_wrong_shape_is_refused():
    @generic
    def flat(parameters, angle, q):
        return np.zeros(2, q.dtype)

    scene = body(swinging(2), "θ", slice(0, 1), positions=flat)
    with pytest.raises(
        eomcheck.InputError, match=r"positions: r has shape \(2,\), expected \(1, 2\)"
    ):
        eomcheck.check_state(scene, *scene.initial_state())
