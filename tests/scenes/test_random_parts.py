"""Numbers of random descriptions, of choices that are told in advance."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from eomcheck.descriptions import random_trees
from eomcheck.descriptions.random_mechanisms import (
    RandomMechanism,
    RandomTree,
    row_count_with_contact,
)
from eomcheck.descriptions.random_trees import JointBudget, _Tree, joint_budgets
from eomcheck.errors import InputError


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
    assert random_trees.random_point(choices, False) == (0.3, -0.4, 0.5)
    assert choices.asked == [(-1.0, 1.0)] * 3
    assert random_trees.random_point(Chosen(0.3, -0.4), True) == (0.3, -0.4, 0.0)
    assert random_trees.random_point(Chosen(first=True), False) == (0.0, 0.0, 0.0)


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
    assert random_trees.random_direction(Chosen(*drawn), False) == expected


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
    assert random_trees.random_transverse(Chosen(*drawn), along) == expected


def test_a_turn_is_often_none_and_else_of_a_positive_scalar():
    choices = Chosen(0.6, 0.3, -0.4, 0.5)
    assert random_trees.random_orientation(choices) == (0.6, 0.3, -0.4, 0.5)
    assert choices.asked == [(0.1, 1.0), *[(-1.0, 1.0)] * 3]
    assert random_trees.random_orientation(Chosen(first=True)) == (1.0, 0.0, 0.0, 0.0)


def test_a_body_in_the_plane_is_a_block_and_its_mass_of_any_magnitude():
    choices = Chosen(0.5, 0.3, -0.4, -1.0, -2.0, -0.5)
    found = random_trees.random_link(choices, "b", True)
    mass, (x, y, z) = 10**0.5, 10.0 ** np.array([-1.0, -2.0, -0.5])
    assert found.mass == pytest.approx(mass)
    assert found.center == (0.3, -0.4, 0.0) and found.products == (0.0, 0.0, 0.0)
    assert found.moments == pytest.approx([mass * (y + z), mass * (x + z), mass * (x + y)])
    assert choices.asked == [(-1.0, 1.0)] * 3 + [(-2.0, 0.0)] * 3


def test_a_body_in_space_is_turned_and_its_products_belong_to_its_axes():
    # A quarter turn about z and a bit: x and y are exchanged, and products of them appear.
    c, s = np.cos(0.3), np.sin(0.3)
    choices = Chosen(0.0, 0.1, 0.2, 0.3, -1.0, -2.0, -0.5, c, 0.0, 0.0, s)
    found = random_trees.random_link(choices, "b", False)
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
    assert (row_count_with_contact(kind, True), row_count_with_contact(kind, False)) == (
        planar,
        spatial,
    )


def test_there_is_room_for_joints_of_every_kind_and_coordinates_are_counted_once():
    found = {(one.space, one.root, one.fixed): one for one in joint_budgets(4)}
    assert len(found) == len([*joint_budgets(4)]) == 2 * (3 + 5)
    assert found["in space", "floating", 1] == JointBudget("in space", "floating", 1, 2, 0)
    assert found["in space", "revolute", 0] == JointBudget("in space", "revolute", 0, 2, 2)
    assert found["plane", "planar", 0] == JointBudget("plane", "planar", 0, 2, 1)
    counts = {(x.root, x.fixed): x.coordinates for x in joint_budgets(4) if x.space == "in space"}
    assert counts["floating", 1] == 6 + 2 - 1
    assert counts["revolute", 0] == 1 + 1 - 1 + 12
    assert counts["revolute", 1] == 1 + 1 - 1 + 6
    assert {x.fixed for x in joint_budgets(1)} == {0}
    assert {x.root for x in joint_budgets(3, frozenset({"revolute", "planar"}))} == {
        "revolute",
        "planar",
    }
    assert {x.fixed for x in joint_budgets(3, frozenset({"revolute"}))} == {0}


# ---- Trees ---------------------------------------------------------------------------------------


def grown(kinds: tuple[str, ...], choices: Any, **more: Any) -> Any:
    """Return a tree with joints of these kinds, whose numbers are still to be drawn."""
    one = object.__new__(_Tree)
    usual = {"kinds": [*kinds], "choices": choices, "links": len(kinds), "carrier": None}
    levels = {"axes": "oblique", "shape": "branched"}
    one.__dict__.update(
        usual | {"planar": False, "last_axis": (0.0, 0.0, 1.0), "levels": levels} | more
    )
    return one


@pytest.mark.parametrize(
    ("axis", "at", "placed"),
    [
        ((0.0, 0.0, 2.0), (0.11, 0.0, 9.0), (0.11, 0.0, 9.0)),
        ((0.0, 0.0, 2.0), (0.09, 0.0, 9.0), (0.5, 0.0, 0.0)),
        ((0.0, 0.0, 0.5), (0.0, 0.11, 0.0), (0.0, 0.11, 0.0)),
        ((0.0, 0.0, 0.5), (0.0, 0.09, 0.0), (0.5, 0.0, 0.0)),
        ((-1.0, 0.0, 0.0), (5.0, 0.0, 0.0), (0.0, 0.5, 0.0)),
        ((0.3, -0.4, 0.0), (0.0, 0.0, 0.0), (0.5, 0.0, 0.0)),
        ((-0.5, 0.4, 0.0), (0.0, 0.0, 0.0), (0.0, 0.5, 0.0)),
        ((0.4, 0.4, 0.4), (0.0, 0.0, 0.0), (0.0, 0.5, 0.0)),
    ],
)
def test_a_hinge_that_is_carried_is_off_the_axis_of_the_one_before(axis, at, placed):
    tree = grown(("revolute", "revolute"), Chosen(), last_axis=axis)
    assert tree._off_axis(at, 0) == placed
    for kind in ("prismatic", "planar"):
        slid = grown((kind, "revolute"), Chosen(), last_axis=axis)
        assert slid._off_axis(at, 0) == at


@pytest.mark.parametrize(
    ("drawn", "axis"),
    [
        ((1.0, 0.0, 0.0), (1.0, 0.5, 0.5)),
        ((0.0, 0.0, 0.0), (1.0, 0.5, 0.5)),
        ((0.3, 0.0, -0.2), (0.3, 0.0, -0.2)),
        ((0.3, 0.1, -0.2), (0.3, 0.1, -0.2)),
    ],
)
def test_an_oblique_axis_is_along_none_of_its_frame(drawn, axis):
    assert grown(("fixed", "revolute"), Chosen(*drawn))._axis(1) == axis
    # Later ones may be straight, and in the plane all are.
    assert grown(("revolute", "revolute"), Chosen(first=True))._axis(1) == (0.0, 0.0, 1.0)
    straight = {"axes": "straight"}
    assert grown(("planar",), Chosen(), levels=straight)._axis(0) == (0.0, -1.0, 0.0)
    for kind in ("fixed", "spherical", "floating"):
        assert grown((kind,), Chosen())._axis(0) == (0.0, 0.0, 1.0)
    flat = {"prismatic": (0.0, -1.0, 0.0), "revolute": (0.0, 0.0, -1.0), "planar": (0.0, 0.0, 1.0)}
    for kind, last in flat.items():
        assert grown((kind,), Chosen(), planar=True)._axis(0) == last


class Highest(Chosen):
    """Choices of which whole numbers are the highest."""

    def whole(self, low: int, high: int) -> int:
        """Return the highest."""
        return high


@pytest.mark.parametrize(
    ("count", "carrier", "parents"),
    [
        (4, None, [0, 1, 2, 2]),
        (4, 2, [0, 1, 1, 3]),
        (3, 1, [0, 0, 2]),
        (2, None, [0, 0]),
    ],
)
def test_a_chain_that_should_branch_does_so_as_far_out_as_it_can(count, carrier, parents):
    tree = grown(("revolute",) * count, Highest(), carrier=carrier)
    tree._choose_parents()
    assert tree.parents == parents
    chain = grown(("revolute",) * count, Highest(), levels={"shape": "chain"})
    chain._choose_parents()
    assert chain.parents == list(range(count))
    low = grown(("revolute",) * count, Chosen(), carrier=carrier)
    low._choose_parents()
    assert low.parents == [i if i - 1 == carrier else 0 for i in range(count)]


ONE_ROW = ("distance", "on-plane", "on-quadric", "square", "coupling", "edge", "touching")
MORE_ROWS = {
    ("plane", "planar"): {"pin", "rolling"},
    ("in space", "planar"): set(),
    ("in space", "spherical"): set(),
    ("in space", "floating"): {"pin", "hinge", "rolling"},
}
"""Space and only joint -> constraints with several rows that leave it a motion."""


def test_mechanisms_have_constraints_that_leave_a_motion_and_what_a_clock_drives_moves():
    found = list(RandomMechanism.topologies(1))
    told = [
        ((*x["space"], *x["root joint"]), set(x["constraints"]), x.get("motion")) for x in found
    ]
    expected = []
    for where, more in MORE_ROWS.items():
        expected.append((where, {*ONE_ROW, *more}, None))
        expected.append((where, {*ONE_ROW, *more, "drive"}, ("moving",)))
    assert told == expected
    assert {len(x["constraints"]) for x in found} == {7, 8, 9, 10, 11}, "each is there once"
    said = r"^links = 31, expected at most 30 of a random scene$"
    for kind in (RandomMechanism, RandomTree):
        with pytest.raises(InputError, match=said):
            kind.topologies(31)
        assert kind.topologies(30)
    assert len(RandomTree.topologies(1)) == len([*joint_budgets(1)])
