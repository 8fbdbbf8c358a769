"""Numbers of random descriptions, of choices that are told in advance."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from eomcheck.random_mechanisms import parts
from eomcheck.random_mechanisms.closing import rows_of
from eomcheck.random_mechanisms.trees import Room, rooms


class Chosen:
    """Choices that are told in advance; `asked` is what each number was drawn from."""

    def __init__(self, *numbers: float, first: bool = False):
        self.numbers, self.first = [*numbers], first
        self.asked: list[tuple[float, float]] = []

    def one_of(self, among: Any) -> Any:
        """Return the first or the last of several."""
        return among[0 if self.first else -1]

    def number(self, low: float, high: float) -> float:
        """Return the next number."""
        self.asked.append((low, high))
        return self.numbers.pop(0)

    def whole(self, low: int, high: int) -> int:
        """Return the lowest."""
        return low


def test_places_are_within_a_metre_and_in_the_plane_where_asked_for():
    choices = Chosen(0.3, -0.4, 0.5)
    assert parts.place(choices, False) == (0.3, -0.4, 0.5)
    assert choices.asked == [(-1.0, 1.0)] * 3
    assert parts.place(Chosen(0.3, -0.4), True) == (0.3, -0.4, 0.0)
    assert parts.place(Chosen(first=True), False) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("drawn", "expected"),
    [
        ((0.05, -0.09, 0.01), (1.0, -0.09, 0.01)),
        ((0.05, -0.11, 0.01), (0.05, -0.11, 0.01)),
        ((0.05, 0.01, -0.11), (0.05, 0.01, -0.11)),
        ((-0.11, 0.01, 0.02), (-0.11, 0.01, 0.02)),
    ],
)
def test_a_direction_that_is_nearly_none_is_made_a_long_one(drawn, expected):
    assert parts.direction(Chosen(*drawn), False) == expected


@pytest.mark.parametrize(
    ("along", "drawn", "expected"),
    [
        ((0.0, 0.0, 2.0), (0.05, 0.0, 1.0), (1.0, 0.0, 0.0)),
        ((0.0, 0.0, -2.0), (0.05, 0.0, 1.0), (1.0, 0.0, 0.0)),
        ((0.5, 0.0, 0.4), (-0.5, 0.02, -0.4), (0.0, 1.0, 0.0)),
        ((0.0, 0.0, 2.0), (0.2, 0.0, 1.0), (0.2, 0.0, 1.0)),
        ((0.0, 0.0, 0.01), (0.2, 0.0, 1.0), (0.2, 0.0, 1.0)),
    ],
)
def test_a_direction_across_another_is_nearly_along_none(along, drawn, expected):
    assert parts.across(Chosen(*drawn), along) == expected


def test_a_turn_is_often_none_and_else_of_a_positive_scalar():
    choices = Chosen(0.6, 0.3, -0.4, 0.5)
    assert parts.turn(choices) == (0.6, 0.3, -0.4, 0.5)
    assert choices.asked == [(0.1, 1.0), *[(-1.0, 1.0)] * 3]
    assert parts.turn(Chosen(first=True)) == (1.0, 0.0, 0.0, 0.0)


def test_a_body_in_the_plane_is_a_block_and_its_mass_of_any_magnitude():
    choices = Chosen(0.5, 0.3, -0.4, -1.0, -2.0, -0.5)
    found = parts.body(choices, "b", True)
    mass, (x, y, z) = 10**0.5, 10.0 ** np.array([-1.0, -2.0, -0.5])
    assert found.mass == pytest.approx(mass)
    assert found.center == (0.3, -0.4, 0.0) and found.products == (0.0, 0.0, 0.0)
    assert found.moments == pytest.approx([mass * (y + z), mass * (x + z), mass * (x + y)])
    assert choices.asked == [(-1.0, 1.0)] * 3 + [(-2.0, 0.0)] * 3


def test_a_body_in_space_is_turned_and_its_products_belong_to_its_axes():
    # A quarter turn about z and a bit: x and y are exchanged, and products of them appear.
    c, s = np.cos(0.3), np.sin(0.3)
    choices = Chosen(0.0, 0.1, 0.2, 0.3, -1.0, -2.0, -0.5, c, 0.0, 0.0, s)
    found = parts.body(choices, "b", False)
    x, y, z = 10.0 ** np.array([-1.0, -2.0, -0.5])
    a, b, cc, turned = y + z, x + z, x + y, 0.6
    cos, sin = np.cos(turned), np.sin(turned)
    xx, yy = a * cos**2 + b * sin**2, a * sin**2 + b * cos**2
    assert found.moments == pytest.approx([xx, yy, cc])
    assert found.products == pytest.approx([(a - b) * sin * cos, 0.0, 0.0], abs=1e-15)
    assert (found.mass, found.center) == (1.0, (0.1, 0.2, 0.3))


@pytest.mark.parametrize(
    ("kind", "planar", "spatial"),
    [("pin", 2, 3), ("weld", 3, 6), ("rolling", 2, 3), ("touching", 1, 1), ("hinge", 0, 5)],
)
def test_rows_of_a_constraint_are_all_that_let_it_hold(kind: str, planar: int, spatial: int):
    assert (rows_of(kind, True), rows_of(kind, False)) == (planar, spatial)


def test_there_is_room_for_joints_of_every_kind_and_coordinates_are_counted_once():
    found = {(one.space, one.root, one.fixed): one for one in rooms(4)}
    assert len(found) == len([*rooms(4)]) == 2 * (3 + 5)
    assert found["in space", "floating", 1] == Room("in space", "floating", 1, 2, 0)
    assert found["in space", "revolute", 0] == Room("in space", "revolute", 0, 2, 2)
    assert found["plane", "planar", 0] == Room("plane", "planar", 0, 2, 1)
    counts = {(x.root, x.fixed): x.coordinates for x in rooms(4) if x.space == "in space"}
    assert counts["floating", 1] == 6 + 2 - 1
    assert counts["revolute", 0] == 1 + 1 - 1 + 12
    assert counts["revolute", 1] == 1 + 1 - 1 + 6
    assert {x.fixed for x in rooms(1)} == {0}
    assert {x.root for x in rooms(3, frozenset({"revolute", "planar"}))} == {"revolute", "planar"}
    assert {x.fixed for x in rooms(3, frozenset({"revolute"}))} == {0}
