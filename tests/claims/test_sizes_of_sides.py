"""What claims say of the terms that cancel in their sides: each from terms of the state alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.claims.test_checks import SNAKE, Q, V

import eomcheck
from eomcheck.claims import CLAIMS, Case
from eomcheck.claims.registry import Comparison
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import FORMULATIONS
from eomcheck.scenes import SCENES

KEYS = ("au", "ml", "kane", "im")


@pytest.fixture(scope="module")
def case() -> Case:
    return Case(Evaluation(SNAKE, Q, V), tuple(FORMULATIONS[key] for key in KEYS), ())


def sides_of(case: Case, claim: str) -> dict[str, Comparison]:
    sides: Any = CLAIMS[claim].sides
    return {one.subject: one for one in sides(case.at, case)}


def row_sum(matrix: np.ndarray) -> float:
    return float(np.abs(matrix).sum(axis=1).max())


def assert_sized(one: Comparison, terms: np.ndarray) -> None:
    assert one.sizes == pytest.approx(terms, rel=1e-9)
    assert one.size == pytest.approx(np.max(terms), rel=1e-9)


def test_the_state_tells_each_term_from_the_others(case: Case):
    M, Q_, B, a, gamma, _ = case.at.terms
    assert all(x is not None and np.any(x) for x in (M, Q_, B, a, gamma))


def test_null_spaces_have_the_sizes_of_their_products(case: Case):
    a, W = np.abs(case.at.terms.a), np.abs(case.at.speeds.W)
    assert_sized(sides_of(case, "null-space-speeds")["ml, kane"], a @ W)


def test_remainders_have_the_size_of_both_their_terms(case: Case):
    a, gamma, rest = case.at.terms.a, case.at.terms.gamma, case.at.speeds.rest
    found = sides_of(case, "speeds-remainder")
    assert_sized(found["ml, kane"], np.abs(a) @ np.abs(rest) + np.abs(gamma))
    assert found["ml, kane"].may_vanish and found["rest"].may_vanish
    assert found["rest"].size is None and found["rest"].sensitivity is None


def test_forces_have_the_sizes_of_what_is_projected_and_of_what_is_subtracted(case: Case):
    W, Q_, force = case.at.speeds.W, case.at.terms.Q, case.at.bodies.force
    (active,) = sides_of(case, "active-forces").values()
    assert_sized(active, np.abs(W).T @ np.abs(Q_))
    q = Q + np.array([0.0, 0.0, -1.0, 0.7, -0.6])  # where springs push both ways
    bent = Case(Evaluation(SNAKE, q, eomcheck.velocity(SNAKE, q, [0.5, 0.7])), (), ())
    terms = np.abs(bent.at.speeds.W).T @ np.abs(bent.at.terms.Q)
    assert_sized(sides_of(bent, "active-forces")["kane"], terms)
    assert active.actual is force
    (one,) = sides_of(case, "kane-ml-force").values()
    remainder = force - one.actual
    assert_sized(one, np.abs(remainder) + np.abs(force))


def test_constraints_and_energies_have_the_size_of_their_largest_row(case: Case):
    at = case.at
    for claim, subject in (("constraint-jacobian", "a"), ("constraint-velocity", "c")):
        one = sides_of(case, claim)[subject]
        assert one.size == pytest.approx(np.max(np.abs(at.terms.a) @ np.abs(V)))
        assert one.names == (SNAKE.constraint_names,)
    (energy,) = sides_of(case, "kinetic-energy").values()
    assert energy.size == pytest.approx(np.abs(V) @ np.abs(at.terms.M @ V))
    assert energy.actual == pytest.approx(V @ at.terms.M @ V)


def test_accelerations_are_allowed_the_rounding_of_both(case: Case):
    own = {f.key: case.vdot_sensitivity(f) for f in case.formulations}
    found = sides_of(case, "equivalence")
    assert len(found) == 6 and len(set(own.values())) == 4
    for subject, one in found.items():
        f, g = subject.split(" ~ ")
        assert one.sensitivity == own[f] + own[g], subject


def test_multipliers_are_allowed_the_rounding_of_both_and_are_there_where_declared(case: Case):
    own = {f.key: case.multiplier_sensitivity(f) for f in case.formulations if f.multipliers}
    found = sides_of(case, "multipliers")
    pairs = {subject: one for subject, one in found.items() if "~" in subject}
    assert pairs and len(found) == len(pairs) + len(KEYS)
    for subject, one in pairs.items():
        f, g = subject.split(" ~ ")
        assert one.sensitivity == own[f] + own[g], subject
    assert {key: found[key].actual for key in KEYS} == {key: int(key in own) for key in KEYS}


def test_constraints_at_acceleration_level_are_allowed_what_q_and_gamma_round(case: Case):
    a, gamma = case.at.terms.a, case.at.terms.gamma
    of_gamma = case.sensitivity(lambda e: e.terms.gamma)
    for f, x in case.solutions:
        one = sides_of(case, "constraint-acceleration")[f.key]
        terms = np.abs(a) @ np.abs(x.vdot) + np.abs(gamma)
        assert_sized(one, terms)
        allowed = row_sum(a) * case.vdot_sensitivity(f) + of_gamma + terms.max()
        assert one.sensitivity == pytest.approx(allowed)
        assert one.actual == pytest.approx(a @ x.vdot + gamma, abs=1e-15)


def test_equations_of_motion_have_the_sizes_of_inertia_forces_and_multipliers(case: Case):
    M, a, F = case.at.terms.M, case.at.terms.a, case.at.F
    found = sides_of(case, "equations-residual")
    for f, x in case.solutions:
        if x.multipliers is None:
            assert found[f.key].actual.shape == (SNAKE.n - SNAKE.r,)
            assert found[f.key].names[0][0] == "allowed motion 1"
            continue
        terms = np.abs(M) @ np.abs(x.vdot) + np.abs(F) + np.abs(a.T) @ np.abs(x.multipliers)
        assert_sized(found[f.key], terms)
        least = row_sum(M) * case.vdot_sensitivity(f) + terms.max()
        least += row_sum(a.T) * case.multiplier_sensitivity(f)
        of_F, of_left = (found[f.key].sensitivity - least, case.sensitivity(lambda e: e.F))
        assert (of_F == pytest.approx(of_left, rel=1e-3)) == (not f.linear)


def chain_case() -> Case:
    for kind in SCENES.values():
        scene = kind.example()
        if hasattr(scene, "chain"):
            q, _ = scene.initial_state()
            v = eomcheck.velocity(scene, q + 0.1, np.linspace(0.5, 1.0, scene.p))
            return Case(Evaluation(scene, q + 0.1, v), (), ())
    raise AssertionError("no scene has a chain")


def test_joints_of_a_chain_have_the_size_of_both_their_bodies():
    case = chain_case()
    at = case.at
    before, after, x = at.chain.before, at.chain.after, at.x.reshape(-1, 2)
    terms = [
        np.abs(A) @ np.abs(x[k]) + np.abs(C) @ np.abs(x[k + 1])
        for k, (A, C) in enumerate(zip(before, after, strict=True))
    ]
    (one,) = sides_of(case, "chain-coupling").values()
    assert one.size == pytest.approx(np.max(terms))
    (rest,) = sides_of(case, "chain-remainder").values()
    assert rest.size == pytest.approx(
        np.abs(at.chain.rest).max() + np.max(terms) * np.abs(at.v).max()
    )
    (velocity,) = sides_of(case, "chain-velocity").values()
    assert velocity.size == pytest.approx(np.abs(at.v).max())
