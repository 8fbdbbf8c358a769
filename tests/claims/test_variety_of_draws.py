"""Draws are various: a strategy that always draws the same would find nothing and pass."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import null_space

from eomcheck import strategies
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.scenes import SCENES, Snake, TurntableBall
from eomcheck.strategies import draw_samples

COIL = Snake.coil(3)


@pytest.fixture(scope="module")
def states():
    return draw_samples(strategies.states(COIL), 200, 0)


@pytest.fixture(scope="module")
def components(states) -> np.ndarray:
    """Return the components (200, p) of v along a basis of what the constraints allow."""
    bases = (null_space(Evaluation(COIL, *state).terms.a) for state in states)
    return np.array([basis.T @ state.v for basis, state in zip(bases, states, strict=True)])


def test_states_move_along_every_direction_and_back(components: np.ndarray):
    seen = np.abs(components) > strategies.NEGLIGIBLE / 2
    assert seen.all(axis=1).mean() > 0.3
    for sign in (1, -1):
        assert ((sign * components > 0) & seen).mean(axis=0).min() > 0.15


def test_numbers_between_nothing_and_one_are_drawn(components: np.ndarray):
    small = (np.abs(components) > 1e-5) & (np.abs(components) < 0.9)
    assert small.mean() > 0.05


def test_every_heading_is_drawn(states):
    first = np.array([state.q[2] for state in states])
    for low in (-math.pi, -math.pi / 2, 0.0, math.pi / 2):
        assert ((first >= low) & (first < low + math.pi / 2)).mean() > 0.05


@pytest.mark.parametrize("name", ["mass", "length", "inertia", "wheel_angle"])
@pytest.mark.night
def test_links_of_a_snake_differ_in_every_parameter(name: str):
    snakes = draw_samples(strategies.snakes(3, 3), 100, 0)
    different = [len(set(getattr(snake, name).tolist())) == 3 for snake in snakes]
    assert np.mean(different) > 0.2


def test_a_scene_with_a_clock_is_drawn_at_many_times():
    table = TurntableBall(swing=1.0, frequency=3.0)
    times = [state.t for state in draw_samples(strategies.states(table), 200, 0)]
    assert len(set(times)) > 20
    assert min(times) < 2.0 < 8.0 < max(times)


@pytest.mark.sampled(5)
@pytest.mark.parametrize("kind", SCENES.values(), ids=SCENES)
def test_both_halves_of_every_range_are_drawn(kind):
    links = 3 if kind.has_links else None
    scenes = draw_samples(strategies.scenes(kind, 3, 3), 150, 0)
    for name, one in kind.ranges(links).items():
        given = [getattr(scene, name) for scene in scenes]
        values = np.concatenate([np.ravel(x) for x in given if x is not None])
        if one.low < one.high:
            middle = (one.low + one.high) / 2
            assert (values < middle).any() and (values > middle).any(), name


@pytest.mark.night
def test_hostile_snakes_have_huge_and_tiny_parameters_and_wheels_across():
    snakes = draw_samples(strategies.hostile_snakes(), 400, 0)
    for name in ("mass", "length", "inertia"):
        values = np.concatenate([getattr(snake, name) for snake in snakes])
        assert (values > 1e6).mean() > 0.02 and ((values > 0) & (values < 1e-6)).mean() > 0.02
    across = [(np.abs(np.cos(snake.wheel_angle)) < 1e-3).any() for snake in snakes]
    assert np.mean(across) > 0.1


@pytest.mark.night
def test_hostile_states_are_straight_or_turned_often_and_of_all_speeds():
    states = draw_samples(strategies.hostile_states(COIL), 1000, 0)
    straight = [np.ptp(state.q[2:]) == 0 and state.q[2] != 0 for state in states]
    turned = [np.abs(state.q[2:]).max() > 100.0 for state in states]
    speeds = np.array([np.abs(state.v).max() for state in states])
    assert np.mean(straight) > 0.1 and np.mean(turned) > 0.1
    assert (speeds > 1e50).mean() > 0.03 and ((speeds > 0) & (speeds < 1e-50)).mean() > 0.03


def test_studies_draw_as_many_as_asked_by_their_seed():
    first, again, other = (draw_samples(strategies.snakes(), 20, seed) for seed in (1, 1, 2))
    assert len(first) == 20
    assert list(map(repr, first)) == list(map(repr, again)) != list(map(repr, other))
