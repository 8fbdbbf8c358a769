"""Bounds of judges, against errors that are numbers: a wider bound lets them pass."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.claims.test_every_claim_fails import MOVING, SNAKE, moving, sample

import eomcheck
from eomcheck.claims import CLAIMS, Case, numerical_accuracy
from eomcheck.claims.engine_quantities import CONFORMANCE
from eomcheck.claims.finding import Finding
from eomcheck.engines.casadi import CasadiEngine
from eomcheck.engines.pinocchio import PinocchioEngine
from eomcheck.evaluation.conformance import QUANTITIES
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import FORMULATIONS
from eomcheck.mechanics.scene import Scene

# ---- Engines -------------------------------------------------------------------------------------

SLIGHT = {
    "mass-matrix": ("mass_matrix", 2e-13),
    "bias": ("bias", 5e-13),
    "generalized-forces": ("forces", 2e-13),
    "constraint-jacobian": ("constraint_jacobian", 1e-13),
    "constraint-drift": ("constraint_drift", 1.5e-13),
    "kane-n-matrix": ("kane_inertia_remainder", 1.5e-11),
    "engine-acceleration": ("acceleration", 9e-12),
    "engine-multipliers": ("acceleration", 5e-12),
}
"""What each claim asks of an engine, and an error of three times what rounding explains of the
snake in motion: in kg m², N m, m/s² and so on."""


def with_error(claim: str, error: float) -> type[CasadiEngine]:
    """Return an engine whose answer to a claim has this error in its last entry."""
    method, _ = SLIGHT[claim]
    right = getattr(CasadiEngine, method)

    def wrong(self: Any, *arguments: Any) -> Any:
        answer = right(self, *arguments)
        if method == "kane_inertia_remainder":
            return (shifted(answer[0]), *answer[1:])
        if method != "acceleration":
            return shifted(answer)
        part = "vdot" if claim == "engine-acceleration" else "multipliers"
        return answer._replace(**{part: shifted(getattr(answer, part))})

    def shifted(x: Any) -> Any:
        changed = np.array(x)
        changed[(-1,) * changed.ndim] += error
        return changed

    return type("Slight", (CasadiEngine,), {"key": "slight", method: wrong})


def findings_with(claim: str, error: float) -> list[Finding]:
    engine = with_error(claim, error)
    found = eomcheck.check_state(SNAKE, *MOVING[:2], engines=[engine], claims=[claim])
    return [one for one in found if "slight" in one.subject.split(" ~ ")]


def test_every_question_to_an_engine_has_an_error_here():
    asked = {id: claim.asks for id, claim in CLAIMS.items() if claim.asks}
    of_terms = {claim: method for claim, (method, _) in SLIGHT.items()}
    assert asked == of_terms | dict(zip(CONFORMANCE, QUANTITIES, strict=True))


@pytest.mark.sampled(3)
@pytest.mark.parametrize("claim", SLIGHT)
def test_an_engine_that_is_off_by_three_times_what_rounding_explains_fails(claim: str):
    (failure,) = findings_with(claim, SLIGHT[claim][1])
    assert failure.verdict == "failed", str(failure)
    (right,) = findings_with(claim, 0.0)
    assert right.verdict == "passed", str(right)


def conformance_findings(quantity: str, error: float) -> list[Finding]:
    """Look at a quantity of an engine whose answers have this error in their first entry."""
    kind = PinocchioEngine if PinocchioEngine.offers(quantity) else CasadiEngine
    right = getattr(kind, quantity)

    def wrong(self: Any, *arguments: Any) -> Any:
        answer = right(self, *arguments)
        if isinstance(answer, tuple):
            return (shifted(answer[0]), *answer[1:])
        return answer + error if isinstance(answer, float) else shifted(answer)

    def shifted(x: Any) -> Any:
        changed = np.array(x)
        changed[(0,) * changed.ndim] += error
        return changed

    engine = type("Slight", (kind,), {"key": "slight", quantity: wrong})
    claim = dict(zip(QUANTITIES, CONFORMANCE, strict=True))[quantity]
    scene, state = sample("bicycle") if quantity == "gravity" else (SNAKE, MOVING)
    # Not the snake's gravity: it has none, and errors that underflow alone may cause do not fail.
    return eomcheck.check_state(scene, *state[:2], engines=[engine], claims=[claim])


KNOWN = [one for one in QUANTITIES if one != "potential_energy"]
"""Quantities that are known, not up to a constant."""


@pytest.mark.sampled(3)
@pytest.mark.parametrize("quantity", KNOWN)
def test_a_quantity_that_is_off_by_three_times_what_rounding_explains_fails(quantity: str):
    right = conformance_findings(quantity, 0.0)
    assert {one.verdict for one in right} == {"passed"}
    # Of C an entry is multiplied by a velocity.
    error = 3.0 * max(one.allowed for one in right) / min(1.0, abs(MOVING.v[0]))
    first, *others = (one.verdict for one in conformance_findings(quantity, error))
    # Blocks of derivatives are judged one by one: the error is in the first alone.
    expected = "passed" if quantity.endswith("_derivatives") else "failed"
    assert first == "failed" and set(others) <= {expected}


def test_a_constant_of_the_potential_energy_is_no_error():
    findings = conformance_findings("potential_energy", 1.0)
    assert {one.verdict for one in findings} == {"passed"}


# ---- Terms that are not finite -------------------------------------------------------------------


@pytest.mark.parametrize("key", ["snake", "turntable-ball"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_nothing_is_judged_beside_a_term_that_is_not_finite(key: str, value: float):
    scene, state = sample(key)
    for name in ("M", "Q", "B", "a", "gamma", "b"):
        at = Evaluation(scene, *state)
        term = getattr(at.terms, name)
        if term is None:
            continue
        bad = np.array(term)
        bad[(-1,) * bad.ndim] = value
        at.terms = at.terms._replace(**{name: bad})
        case = Case(at, tuple(FORMULATIONS.values()), ())
        assert not case.finite, name
        failed = [f for f in case.evaluate(CLAIMS["finite-terms"]) if f.verdict == "failed"]
        assert [f.subject for f in failed] == [name]


def test_the_two_samples_have_all_terms():
    had = {
        name
        for key in ("snake", "turntable-ball")
        for name, term in Evaluation(sample(key)[0], *sample(key)[1]).terms._asdict().items()
        if term is not None
    }
    assert had == {"M", "Q", "B", "a", "gamma", "b"}


# ---- The truth -----------------------------------------------------------------------------------


def driven() -> tuple[Scene, Evaluation]:
    """Return a scene whose accelerations depend on the time, at 0.7 s."""
    scene, _ = sample("turntable-ball")
    q, _ = scene.initial_state()
    v = eomcheck.velocity(scene, q, [0.5, -0.4, 0.3], t=0.7)
    return scene, Evaluation(scene, q, v, 0.7)


def test_the_truth_of_a_driven_scene_is_that_of_the_time_at_hand():
    scene, at = driven()
    formulations = tuple(f for f in FORMULATIONS.values() if f.applies_to(scene))
    here = Case(at, formulations, ())
    for f in formulations:
        enclosed = numerical_accuracy._enclose(here, f, {})
        assert not isinstance(enclosed, Finding)
        assert enclosed.doubles() == pytest.approx(at.acceleration(f).vdot, rel=1e-9)
    at_start = Evaluation(scene, at.q, eomcheck.velocity(scene, at.q, at.u), 0.0)
    differ = np.abs(at_start.acceleration(formulations[0]).vdot - at.acceleration(f).vdot)
    assert differ.max() > 1e-3, "the time makes a difference"
    for claim in ("enclosures", "true-error"):
        found = here.evaluate(CLAIMS[claim])
        assert {one.verdict for one in found} == {"passed"}


def test_true_errors_are_those_of_the_time_at_hand(monkeypatch):
    times, right = [], numerical_accuracy.true_acceleration

    def recorded(scene, q, u, t):
        times.append(t)
        return right(scene, q, u, t)

    monkeypatch.setattr(numerical_accuracy, "true_acceleration", recorded)
    Case(driven()[1], (FORMULATIONS["au"],), ()).evaluate(CLAIMS["true-error"])
    assert times == [0.7]


def test_a_truth_without_speeds_is_that_of_the_time_at_hand():
    _, at = driven()
    case = Case(at, (FORMULATIONS["au"],), ())
    case.has_speeds = False
    (found,) = case.evaluate(CLAIMS["true-error"])
    assert found.verdict == "passed", str(found)


def test_a_true_error_of_three_times_what_rounding_explains_fails():
    right = FORMULATIONS["au"]

    def wrong(*arguments: Any) -> Any:
        vdot, multipliers = right.solution(*arguments)
        if vdot.dtype == np.float64:
            vdot = vdot.copy()
            vdot[-1] += 1.2e-11  # rad/s²
        return vdot, multipliers

    case = Case(moving(), (replace(right, solution=wrong),), ())
    (found,) = case.evaluate(CLAIMS["true-error"])
    assert found.verdict == "failed", str(found)
