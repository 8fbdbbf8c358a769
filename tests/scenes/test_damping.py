"""Viscous damping of the joints: through every formulation, engine, arithmetic and check."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eomcheck
from eomcheck.claims.proof import prove
from eomcheck.engines import ENGINES
from eomcheck.formulations import FORMULATIONS
from eomcheck.numbers.generic import generic
from eomcheck.scenes import Snake
from eomcheck.scenes.snake import half_squares, terms

LINKS = 4
DAMPED = replace(Snake.coil(LINKS), damping=[1.0, 20.0, 300.0])
BARE = replace(DAMPED, stiffness=None)
damped = pytest.mark.parametrize("scene", [DAMPED, BARE], ids=lambda scene: scene.structure)
Q = DAMPED.initial_state()[0]


@damped
def test_every_claim_holds_on_a_damped_snake(scene: Snake):
    findings = eomcheck.check_state(scene, Q, eomcheck.velocity(scene, Q, [1.0, 0.5]))
    assert [str(f) for f in findings if f.verdict != "passed"] == []
    seen = {f.subject for f in findings if f.claim == "power-balance"}
    assert seen == set(FORMULATIONS)


@damped
def test_every_identity_is_proved_of_a_damped_snake(scene: Snake):
    findings = prove(scene, points=1, seed=3)
    assert {f.verdict for f in findings} == {"passed"}
    assert {f.subject for f in findings if f.claim == "power-balance"} == set(FORMULATIONS)


@generic
def reversed_dissipation(parameters, angles, q, v):
    """Return -R."""
    R = half_squares(parameters.damping, v[2:])
    return None if R is None else -R


@generic
def undamped_terms(parameters, angles, q, v):
    """Return the terms of a snake whose dampers were forgotten in Q."""
    return terms(parameters._replace(damping=None), angles, q, v)


class Reversed(Snake):
    dissipation = staticmethod(reversed_dissipation)


class Forgetful(Snake):
    terms = staticmethod(undamped_terms)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("kind", [Reversed, Forgetful])
@damped
def test_a_damper_that_is_reversed_or_forgotten_is_disproved(kind: type[Snake], scene: Snake):
    wrong = kind(**{name: getattr(scene, name) for name in scene.__dataclass_fields__})
    failed = {f.claim for f in prove(wrong, points=1, seed=3) if f.verdict == "failed"}
    assert {"generalized-forces", "power-balance"} <= failed


def test_enclosures_of_a_damped_snake_contain_what_doubles_deliver():
    u = [1.0, 0.5]
    v = eomcheck.velocity(DAMPED, Q, u)
    for key in FORMULATIONS:
        true = eomcheck.enclose(DAMPED, key, Q, u, digits=20)
        found = eomcheck.acceleration(DAMPED, key, Q, v)
        assert np.abs(true.doubles() - found.vdot).max() <= found.error_bound + 1e-9


def test_pinocchio_has_no_dampers_of_its_own_and_gets_theirs_in_q():
    engine = ENGINES["pinocchio"](DAMPED)
    model, data = engine.model, engine.data
    state = engine.coordinates @ Q, np.ones(DAMPED.n), np.zeros(DAMPED.n)
    before = np.array(engine._pin.aba(model, data, *state))
    model.damping = np.full(DAMPED.n, 3.0)
    assert np.array_equal(engine._pin.aba(model, data, *state), before)


@pytest.mark.parametrize("key", ["au", "kane", "banded"])
def test_a_damped_snake_comes_to_rest_and_loses_energy_at_every_step(key: str):
    found = eomcheck.simulate(DAMPED, key, 2.0, rtol=1e-9, atol=1e-9)
    assert found.status == "finished"
    assert (np.diff(found.energy) <= 1e-6 * found.energy[0]).all()
    assert found.energy[-1] < 0.9 * found.energy[0]


@pytest.mark.parametrize("links", [1, 3])
def test_dampers_that_are_not_one_a_joint_are_refused(links: int):
    with pytest.raises(eomcheck.errors.InputError, match="damping"):
        replace(Snake.coil(links), damping=np.ones(links))
