"""Support of generalized speeds, the bodies that each one moves: correctness and cost."""

from __future__ import annotations

import numpy as np
import pytest
from tests.mechanics.descriptions import ALL, GROUND, TREES, rod, turning
from tests.samples import random_state

import eomcheck
from eomcheck.descriptions.build import mechanism
from eomcheck.evaluation import evaluation, perturbed
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import FORMULATIONS, applicable
from eomcheck.kernels.perturbed_trace import LARGEST_TOTAL, TraceRunner
from eomcheck.mechanics.scene import Scene
from eomcheck.motion.right_hand_side import acceleration_in_machine_code, trace_rates
from eomcheck.scenes import SCENES

DESCRIBED = {key: kind for key, kind in SCENES.items() if kind.example().support is not None}
KINDS = {name: kind() for name, kind in ALL.items()} | {
    key: kind.example() for key, kind in DESCRIBED.items()
}


def chain(joints: int) -> Scene:
    """Return links behind each other, every joint about another axis."""
    names = ["ground", *(f"l{i}" for i in range(joints))]
    links = [GROUND, *(rod(name, (0.3, 0.1, 0.05)) for name in names[1:])]
    axes = np.random.default_rng(1).normal(size=(joints, 3)).tolist()
    between = [
        turning(f"j{i}", names[i], names[i + 1], (0.4, 0.1, 0.0), axis=tuple(axes[i]))
        for i in range(joints)
    ]
    return mechanism("Long", links, between)()


def state(scene: Scene) -> Evaluation:
    n = scene.n
    return Evaluation(scene, np.linspace(-1, 1, n), np.cos(3.0 * np.arange(n)))


def moved(at: Evaluation) -> np.ndarray:
    """Return a mask of the speeds that move each body at a state (n_b, p)."""
    turning, sliding = at.bodies.partial_angular_velocity, at.bodies.partial_velocity
    return (np.concatenate((turning, sliding), axis=1) != 0).any(axis=1)


def test_all_scenes_made_of_descriptions_know_their_support():
    assert {"chain-pendulum", "andrews", "bricard", "bicycle", "flyball-governor"} <= {*DESCRIBED}
    assert SCENES["snake"].example().support is None


@pytest.mark.parametrize("scene", KINDS.values(), ids=KINDS)
def test_no_speed_outside_the_support_moves_a_body(scene: Scene):
    at = Evaluation(scene, *random_state(scene, np.random.default_rng(2)))
    assert scene.support.shape == moved(at).shape == (len(at.bodies.mass), scene.p)
    assert not (moved(at) & ~scene.support).any()


@pytest.mark.parametrize("kind", TREES.values(), ids=TREES)
def test_the_support_of_a_tree_is_no_larger_than_what_moves(kind):
    scene = kind()
    at = Evaluation(scene, *random_state(scene, np.random.default_rng(2)))
    assert (moved(at) == scene.support).all()


def test_the_tape_of_a_tree_grows_with_the_square_of_its_joints():
    kane = FORMULATIONS["kane"]
    short, long = (len(trace_rates(chain(n), kane).tape.operations) for n in (16, 32))
    assert long < 4.4 * short


@pytest.mark.night
def test_all_that_is_perturbed_of_a_tree_of_50_joints_is_kept_at_once(
    monkeypatch: pytest.MonkeyPatch,
):
    moves = TraceRunner()  # without the cached traces of earlier tests
    for module in (evaluation, perturbed):
        monkeypatch.setattr(module, "MOVES", moves)
    scene = chain(50)
    at = state(scene)
    bound = eomcheck.acceleration(scene, "kane", at.q, at.v).error_bound
    assert bound < 1e-6
    assert 0 < moves._places < LARGEST_TOTAL / 2


@pytest.mark.night
def test_sums_as_one_product_are_within_the_error_bounds():
    scene = chain(25)
    at = state(scene)
    found = {key: eomcheck.acceleration(scene, key, at.q, at.v) for key in ("kane", "au")}
    apart = np.abs(found["kane"].vdot - found["au"].vdot).max()
    assert 0 < apart < sum(x.error_bound for x in found.values())
    by_machine = acceleration_in_machine_code(at, FORMULATIONS["kane"])
    assert np.abs(by_machine - found["kane"].vdot).max() < 2 * found["kane"].error_bound


@pytest.mark.night
@pytest.mark.parametrize("key", applicable(chain(2)))
def test_a_tree_of_100_joints_has_an_acceleration_by_every_formulation(key):
    scene = chain(100)
    at = state(scene)
    found = eomcheck.acceleration(scene, key, at.q, at.v)
    other = eomcheck.acceleration(scene, "au", at.q, at.v)
    assert np.abs(found.vdot - other.vdot).max() <= found.error_bound + other.error_bound
    assert found.error_bound < 1e-4
