"""Strata of scenes: in which way a parameter is there, and which rows are drawn."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.claims.test_checks import SNAKE, Q, V

from eomcheck.claims import State
from eomcheck.draws import pairwise_design
from eomcheck.draws.pairwise_design import (
    ABSENT,
    AT_REST,
    BOTH,
    LINKS,
    MOTION,
    MOVING,
    NEGATIVE,
    POSITIVE,
    PRESENT,
    ZERO,
)
from eomcheck.mechanics.records import Range
from eomcheck.scenes import ChainPendulum, Sleigh, Snake

EITHER, UP, FAR = Range(-1.0, 4.0, (3, 2)), Range(0.0, 4.0, (3,)), Range(2.0, 5.0)


@pytest.mark.parametrize(
    ("one", "ways"),
    [
        (EITHER, (ZERO, POSITIVE, NEGATIVE, BOTH)),
        (EITHER._replace(shape=(1,)), (ZERO, POSITIVE, NEGATIVE)),
        (EITHER._replace(shape=()), (ZERO, POSITIVE, NEGATIVE)),
        (EITHER._replace(shape=(), optional=True), (ABSENT, ZERO, POSITIVE, NEGATIVE)),
        (UP, (ZERO, POSITIVE)),
        (UP._replace(optional=True), (ABSENT, ZERO, POSITIVE)),
        (FAR, (PRESENT,)),
        (FAR._replace(optional=True), (ABSENT, PRESENT)),
        (Range(-3.0, 0.0), (PRESENT,)),
        (Range(-3.0, -1.0), (PRESENT,)),
        (Range(0.0, 4.0, (0, 3)), (ABSENT,)),
    ],
)
def test_a_parameter_is_drawn_in_the_ways_that_its_range_has(one: Range, ways: tuple[str, ...]):
    assert pairwise_design.levels_of_range(one) == ways


@pytest.mark.parametrize(
    ("value", "way"),
    [
        (None, ABSENT),
        (np.zeros((0, 2)), ABSENT),
        (0.0, ZERO),
        ([0.0, 0.0], ZERO),
        ([0.0, 2.0], POSITIVE),
        ([-1.0, 0.0], NEGATIVE),
        ([0.0, -1.0, 3.0], BOTH),
        ([3.0, 0.0, -1.0], BOTH),
    ],
)
def test_the_way_of_a_parameter_is_seen_on_its_numbers(value: Any, way: str):
    assert pairwise_design.level_of_value(value) == way


def drawn(one: Range, way: str, count: int = 200) -> np.ndarray:
    random = np.random.default_rng(0)
    return np.array([pairwise_design.sample_level(one, way, random) for _ in range(count)])


def test_values_are_drawn_in_the_way_that_is_asked_for_and_fill_their_range():
    for one in (EITHER, EITHER._replace(shape=(2,))):
        x = {way: drawn(one, way) for way in (ZERO, POSITIVE, NEGATIVE, BOTH)}
        assert not x[ZERO].any() and x[ZERO].shape == (200, *one.shape)
        assert (x[POSITIVE] > 0).all() and 3.9 < x[POSITIVE].max() <= 4
        assert (x[NEGATIVE] < 0).all() and -1 <= x[NEGATIVE].min() < -0.95
        signs = np.sign(x[BOTH]).reshape(200, -1)
        # As many of either sign, and each entry has either.
        assert (signs.sum(axis=1) == 0).all() and (np.abs(signs.sum(axis=0)) < 199).all()
        assert -1 <= x[BOTH].min() < -0.95 and 3.9 < x[BOTH].max() <= 4
    odd = np.sign(drawn(EITHER._replace(shape=(3,)), BOTH)).sum(axis=1)
    assert set(odd) == {1.0}


def test_magnitudes_are_drawn_evenly_or_by_decades_down_to_a_thousandth():
    x = np.sort(drawn(UP._replace(shape=()), POSITIVE, 2500))
    assert x[0] > 0.0 and x[-1] <= 4.0
    below = {bound: np.mean(x < bound) for bound in (0.004, 0.04, 0.4)}
    # Half of them even; the other half a third below each decade.
    assert below[0.004] == pytest.approx(0.0005, abs=0.002)
    assert below[0.04] == pytest.approx(0.5 / 3 + 0.005, abs=0.02)
    assert below[0.4] == pytest.approx(1.0 / 3 + 0.05, abs=0.02)
    far = drawn(FAR, PRESENT, 1500)
    assert 2.0 <= far.min() < 2.02 and 4.98 < far.max() <= 5.0
    below_middle = 0.25 + 0.5 * np.log(3.5 / 2) / np.log(2.5)  # half even, half by logarithm
    assert np.mean(far < 3.5) == pytest.approx(below_middle, abs=0.03)
    for way in (POSITIVE, PRESENT):
        assert {len(set(np.diff(drawn(UP, way, 40), axis=1).ravel()))} == {80}


def test_what_is_absent_is_none_or_has_no_entries_that_count():
    random = np.random.default_rng(0)
    assert pairwise_design.sample_level(EITHER._replace(optional=True), ABSENT, random) is None
    assert pairwise_design.sample_level(Range(0.0, 1.0, (0, 3)), ABSENT, random).shape == (0, 3)
    number = pairwise_design.sample_level(FAR, PRESENT, random)
    assert type(number) is float


# ---- Rows ----------------------------------------------------------------------------------------

LENGTHS: list[dict[str, tuple[str, ...]]] = [
    {LINKS: (str(n),), MOTION: (MOVING, AT_REST), "spring": (ABSENT, ZERO, POSITIVE)}
    for n in (1, 2, 3, 4, 5)
]


def test_rows_that_follow_a_covering_array_move_without_zeros_by_the_smaller_links_in_turn():
    random = np.random.default_rng(0)
    covered = len(pairwise_design.covering_array(LENGTHS, np.random.default_rng(0)))
    later = list(pairwise_design.design_rows(LENGTHS, 400, random))[200:]
    assert covered < 60 and {row[MOTION] for row in later} == {MOVING}
    assert {row["spring"] for row in later} == {ABSENT, POSITIVE}
    links = [row[LINKS] for row in later]
    assert set(links) == {"1", "2", "3"} and links[:6] == 2 * links[:3]
    only_zero = [{MOTION: (MOVING,), "spring": (ZERO,)}]
    assert list(pairwise_design.design_rows(only_zero, 3, random))[-1] == {
        MOTION: MOVING,
        "spring": ZERO,
    }


def test_every_tenth_row_is_at_rest_until_none_is_left():
    rows = list(pairwise_design.design_rows(LENGTHS, 400, np.random.default_rng(1)))
    resting = [i for i, row in enumerate(rows) if row[MOTION] == AT_REST]
    covered = pairwise_design.covering_array(LENGTHS, np.random.default_rng(1))
    assert resting == [9 + 10 * i for i in range(len(resting))]
    assert len(resting) == sum(row[MOTION] == AT_REST for row in covered) >= 5


def test_links_are_counted_in_their_order_and_what_cannot_be_otherwise_is_left_out():
    def case(links: int, angle: float) -> tuple[Snake, State]:
        scene = Snake([1] * links, [1] * links, [0.1] * links, None, [angle] * links)
        return scene, State(np.zeros(scene.n), np.full(scene.n, float(links == 2)))

    counts = pairwise_design.count_levels(
        [case(10, 0.1), case(2, 0.1), case(10, -0.1), case(9, 0.0)]
    )
    assert list(counts[LINKS].items()) == [("2", 1), ("9", 1), ("10", 2)]
    assert counts[MOTION] == {MOVING: 1, AT_REST: 3}
    assert counts["wheel_angle"] == {ZERO: 1, POSITIVE: 2, NEGATIVE: 1, BOTH: 0}
    assert counts["stiffness"] == {ABSENT: 4, ZERO: 0, POSITIVE: 0}
    assert "mass" not in counts and "length" not in counts


def test_a_case_is_in_the_strata_of_its_own_numbers():
    row = pairwise_design.levels_of_case(SNAKE, State(Q, V))
    assert (row[LINKS], row[MOTION], row["mass"]) == ("3", MOVING, PRESENT)
    assert row["wheel_angle"] == pairwise_design.level_of_value(SNAKE.wheel_angle)
    assert pairwise_design.levels_of_case(SNAKE, State(Q, 0 * V))[MOTION] == AT_REST
    assert LINKS not in pairwise_design.levels_of_case(Sleigh(), State(np.zeros(3), np.zeros(3)))


# ---- States beyond the ordinary ones -------------------------------------------------------------


@pytest.mark.parametrize(
    ("number", "turned", "decades"),
    [
        (0, True, None),
        (1, True, pairwise_design.FAST),
        (2, True, pairwise_design.SLOW),
        (3, False, pairwise_design.FAST),
        (4, True, None),
        (7, False, pairwise_design.FAST),
    ],
)
def test_states_that_follow_each_other_are_wide_in_turn(number: int, turned: bool, decades: Any):
    scene = ChainPendulum.rods(3)
    q, v = np.array([0.3, -0.4, 0.9]), np.array([0.5, -2.0, 1.0])
    found = [
        pairwise_design.wide_state(scene, State(q, v, 2.5), number, np.random.default_rng(seed))
        for seed in range(12)
    ]
    assert {one.t for one in found} == {2.5}
    assert any(np.abs(one.q - q).max() > 6 for one in found) == turned
    for one in found:
        sizes = np.abs(one.v).max(), one.v / np.abs(one.v).max()
        assert sizes[1] == pytest.approx(v / 2.0), "in the direction of the ordinary one"
        low, high = (np.log10(2.0),) * 2 if decades is None else decades
        assert low - 1e-9 <= np.log10(sizes[0]) <= high + 1e-9
    resting = pairwise_design.wide_state(scene, State(q, 0 * v), 1, np.random.default_rng(0))
    assert not resting.v.any()
