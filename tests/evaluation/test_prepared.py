"""What is prepared moves too: cosines, sines, roots, and what is formed on the way to them."""

from __future__ import annotations

import numpy as np
import pytest

import eomcheck
from eomcheck.evaluation.evaluation import BatchEvaluation, Evaluation
from eomcheck.evaluation.perturbed import perturbed_samples
from eomcheck.evaluation.tolerance import allowed_error
from eomcheck.formulations import applicable
from eomcheck.mechanics.records import State
from eomcheck.numbers.batch_arrays import BatchArray
from eomcheck.numbers.generic import Angles
from eomcheck.numbers.noise import SAMPLES, STEP
from eomcheck.scenes import Bicycle, Snake, TurntableBall

EPS = np.finfo(np.float64).eps
MASSES = [1.0, 2.0], [1.0, 0.5], [0.1, 0.2], [4.0], [0.125, -0.5]


class Rooted(Snake, functions=()):
    """A snake whose cosines are roots of (c² + s²) - s², of which little is left near π/2.

    Whatever c and s are moved by, that is c²: only what rounds between shows the loss.
    """

    @staticmethod
    def prepare(arithmetic, parameters, q, t):
        value, cos, sin = arithmetic.angles(q[2:])
        return Angles(value, arithmetic.root(cos * cos + sin * sin - sin * sin), sin)


class Scaled(Snake, functions=()):
    """A snake that prepares with a literal that is no integer: no list of operations has it."""

    @staticmethod
    def prepare(arithmetic, parameters, q, t):
        return arithmetic.angles(0.5 * (q[2:] + q[2:]))


def at_rest(scene, q) -> Evaluation:
    return Evaluation(scene, np.asarray(q, float), np.zeros(scene.n), 0.0)


def parts(record) -> list[np.ndarray]:
    """Return the arrays of a record of doubles or of lanes."""
    if isinstance(record, tuple):
        return [x for part in record for x in parts(part)]
    return (
        []
        if record is None
        else [np.asarray(record.data if isinstance(record, BatchArray) else record)]
    )


@pytest.mark.parametrize("kind", [Snake, Scaled], ids=["listed", "not listed"])
def test_cosines_and_sines_move_by_a_step(kind):
    at = at_rest(kind(*MASSES), [0.4, -0.2, 0.3, 1.1])
    prepared = perturbed_samples(at).prepared
    for name in ("cos", "sin"):
        still, moved = getattr(at.prepared, name), getattr(prepared, name).data
        steps = np.abs(moved[:-1] - still) / np.abs(still) / STEP
        assert ((steps > 0.4) & (steps < 1.6)).all()
    assert len(np.unique(prepared.cos.data, axis=0)) == SAMPLES + 1


def test_what_is_lost_before_a_root_shows():
    near = np.pi / 2 - 1e-6
    at = at_rest(Rooted(*MASSES), [0.0, 0.0, near, near - 0.4])
    true = np.cos(near)
    error = abs(at.prepared.cos[0] / true - 1)
    assert error > 1e5 * EPS
    moved = perturbed_samples(at).prepared.cos.data[:-1, 0]
    assert (np.abs(moved / at.prepared.cos[0] - 1) > 1e10 * STEP).all()


@pytest.mark.parametrize("away", [1e-3, 1e-5, 1e-7])
def test_no_formulation_is_wrong_by_a_root_and_does_not_say_so(away):
    scene = Rooted(*MASSES)
    q, v = np.array([0.0, 0.0, np.pi / 2 - away, 1.2]), np.zeros(4)
    for key in applicable(scene):
        found = eomcheck.accuracy(scene, key, q, v=v)
        assert not found.silently_wrong, (key, found)


def test_lanes_are_moved_as_a_single_state_is():
    kinds = (
        (Rooted(*MASSES), [0.0, 0.0, 1.5, 1.1], 0.0),
        (TurntableBall(swing=0.3, frequency=2.0), [0.1, 0.2, 0.3, 0.4, 0.5], 1.7),
    )
    for scene, q, t in kinds:
        states = [State(np.array(q) + shift, np.zeros(scene.n), t) for shift in (0.0, 0.01)]
        among = parts(perturbed_samples(BatchEvaluation([scene] * 2, states)).prepared)
        for i, state in enumerate(states):
            alone = parts(perturbed_samples(Evaluation(scene, *state)).prepared)
            for x, y in zip(alone, among, strict=True):
                assert x.tolist() == y[i::2].tolist()


def test_a_phase_that_is_formed_moves_before_its_sine_is_taken():
    scene = TurntableBall(swing=0.3, frequency=1e6)
    at = Evaluation(scene, np.zeros(5), np.zeros(5), 3.0)
    change = perturbed_samples(at).prepared.rate.data[:-1, 0] - at.prepared.rate[0]
    assert (np.abs(change) > 1e4 * STEP).all()  # 3e6 rad are known to 1e6 steps


def test_rates_of_what_is_prepared_are_those_of_moved_angles():
    scene = Bicycle()
    q, v = scene.initial_state()
    at = Evaluation(scene, q, v, 0.0)
    still = at.prepared_duals(v)[0].sines[0].rate
    moved = perturbed_samples(at).prepared_duals(v)[0].sines[0].rate.data[:-1]
    assert (np.abs(moved - still) < allowed_error(1.0) / EPS * STEP).all()
    assert len(np.unique(moved)) > 1
    assert set(moved.tolist()) != {still}


def test_a_bicycle_that_nearly_lies_keeps_the_digits_of_its_wheels_lean():
    # Its sine was the root of 1 - cos²: Kane was 13 600 times its bound off, and said nothing.
    scene, lean = Bicycle(), 1e-5
    q = np.array([0.0, 0.0, 3e-6, 0.0, np.pi, 0.0, lean, 0.0, 0.0])
    assert abs(at_rest(scene, q).prepared.sines[0] / np.sin(lean) - 1) < 4 * EPS
    for key in applicable(scene):
        found = eomcheck.accuracy(scene, key, q, [1.0, 1 / 2, 1 / 3])
        assert not found.silently_wrong, (key, found)
