"""Numbers, states and snakes that strategies draw: bounds reached, zeros, times and headings."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eomcheck import strategies
from eomcheck.draws import (
    angles_of,
    draw_array,
    draw_magnitude,
    ordinary_state,
    scene_within,
    state_ranges,
)
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import check_consistent
from eomcheck.mechanics.records import Range
from eomcheck.scenes import SCENES, Snake, TurntableBall
from eomcheck.strategies import (
    HypothesisChoices,
    draw_samples,
    strategy_of,
    without_tiny,
)


@pytest.mark.parametrize(
    ("x", "drawn"),
    [(2e-6, 2e-6), (-2e-6, -2e-6), (0.9e-6, 0.0), (-0.9e-6, 0.0), (0.0, 0.0), (-3.0, -3.0)],
)
def test_numbers_below_a_millionth_are_drawn_as_zero(x: float, drawn: float):
    assert without_tiny(x) == drawn


def test_only_numbers_of_both_signs_are_drawn_as_zero_where_they_are_small():
    small = draw_samples(strategy_of(lambda choices: choices.number(1e-9, 1e-7)), 30, 0)
    assert all(1e-9 <= x <= 1e-7 for x in small)
    both = draw_samples(strategy_of(lambda choices: choices.number(-1e-7, 1e-7)), 30, 0)
    assert {*both} == {0.0}
    one_sided = draw_samples(strategy_of(lambda choices: choices.number(-1e-7, 0.0)), 30, 0)
    assert one_sided != [0.0] * 30
    tiny = draw_samples(strategy_of(lambda choices: choices.number(-1e-7, 1e-7), tiny=True), 30, 0)
    assert {*tiny} != {0.0}


def test_numbers_of_links_are_all_between_the_bounds_and_the_bounds():
    links = draw_samples(strategies.snakes(2, 5).map(lambda snake: snake.links), 100, 0)
    assert {*links} == {2, 3, 4, 5}


def test_magnitudes_are_powers_of_ten():
    strategy = strategy_of(lambda choices: draw_magnitude(choices, -3.0, 5.0))
    exponents = np.log10(draw_samples(strategy, 80, 0))
    assert -3.0 <= exponents.min() < -2.0 and 4.0 < exponents.max() <= 5.0 + 1e-12


def test_parameters_have_the_shape_of_their_range_and_may_be_absent():
    table = draw_samples(strategy_of(lambda x: draw_array(Range(2.0, 3.0, (4, 2)), x)), 20, 0)
    assert {np.shape(x) for x in table} == {(4, 2)}
    ranges = {"only": Range(2.0, 3.0, (3,), optional=True)}
    of: Any = lambda only: (only,)  # noqa: E731
    either = [x for (x,) in draw_samples(strategy_of(lambda x: scene_within(of, ranges, x)), 60, 0)]
    there = [x for x in either if x is not None]
    assert 10 < len(there) < 60
    assert {len(x) for x in there} == {3}


def test_choices_reach_both_bounds_and_every_one_of_several():
    @st.composite
    def chosen(drawing: Any) -> tuple[int, float, str]:
        choices = HypothesisChoices(drawing)
        return choices.whole(3, 5), choices.number(-2.0, 1.0), choices.one_of(["a", "b", "c"])

    whole, number, of = zip(*draw_samples(chosen(), 60, 0), strict=True)
    assert {*whole} == {3, 4, 5}
    assert {*of} == {"a", "b", "c"}
    assert -2.0 <= min(number) < -1.0 and 0.3 < max(number) <= 1.0


def test_states_of_a_driven_scene_keep_the_constraints_of_their_time():
    scene = TurntableBall.example()
    driven = draw_samples(strategies.states(scene, time=8.0), 40, 0)
    times = {state.t for state in driven}
    assert len(times) > 10 and 4.0 < max(times) <= 8.0
    for state in driven:
        check_consistent(Evaluation(scene, *state))


def test_angles_are_drawn_around_a_curve_with_a_heading_and_positions_are_not():
    """Snake: x and y, then angles: the first is turned by 0.4 rad, each of the next by as much."""
    coil = Snake.coil(3)
    assert angles_of(coil) == [False, False, True, True, True]
    given_ = [1.5, -2.5, 0.1, 0.2, 0.3]
    numbers = iter([*given_, 0.7, *[0.0] * coil.p, 0.0])
    choices: Any = SimpleNamespace(number=lambda low, high: next(numbers))
    q = ordinary_state(coil, choices).q
    assert q == pytest.approx([1.5, -2.5, 0.1 + 1.1, 0.2 + 1.5, 0.3 + 1.9])


def test_what_states_are_drawn_from_is_as_wide_as_it_is_said():
    coil = Snake.coil(2)
    found = state_ranges(coil, 3.0, 0.5, 7.0, 9.0)
    assert [(x.low, x.high) for x in found.coordinates] == [
        (-3, 3),
        (-3, 3),
        (-0.5, 0.5),
        (-0.5, 0.5),
    ]
    assert (found.heading.low, found.heading.high) == (-math.pi, math.pi)
    assert (found.components.low, found.components.high) == (-7.0, 7.0)
    assert found.components.shape == (coil.p,)
    assert (found.time.low, found.time.high) == (0.0, 0.0)
    driven = state_ranges(TurntableBall.example(), time=9.0)
    assert (driven.time.low, driven.time.high) == (0.0, 9.0)
    closed = SCENES["bricard"].example()  # which gives ranges of its own
    assert state_ranges(closed).coordinates == closed.coordinate_ranges()
    assert state_ranges(closed).heading == Range(0.0, 0.0)


@given(strategies.hostile_snakes(3, 3))
def test_hostile_snakes_have_springs_of_their_joints(snake):
    for name in ("stiffness", "damping"):
        value = getattr(snake, name)
        assert value is None or (value.shape == (2,) and (value >= 0.0).all())
    assert (np.abs(snake.wheel_angle) <= math.pi).all()
