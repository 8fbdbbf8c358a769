"""Faults planted in an engine of somebody else's: each is caught, and named."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

import numpy as np
import pytest
from tests.engines.planar import planar, with_fault

import eomcheck
from eomcheck.claims import CLAIMS, Finding
from eomcheck.claims.engine_quantities import CONFORMANCE
from eomcheck.engines import Engine, EngineAcceleration
from eomcheck.scenes import ChainPendulum, Sleigh, Snake

ASKING = [one.id for one in CLAIMS.values() if one.asks and one.id not in CONFORMANCE]
"""Claims about the terms of engines; of other quantities `Planar` has none."""
SCENE = Snake([1.0, 2.0, 0.5], [1.0, 0.5, 2.0], [0.1, 0.2, 0.3], [3.0, 5.0], [0.125, -0.5, 1.0])
Q = np.array([0.4, -0.2, 0.3, 0.9, 1.6])
V = eomcheck.velocity(SCENE, Q, [1.5, -0.75])


def judged(engine: type[Engine], claims=ASKING, q=Q, v=V) -> list[Finding]:
    return eomcheck.check_state(SCENE, q, v, engines=[engine], claims=claims)


def failures(engine: type[Engine], claims=ASKING, **state) -> dict[str, str]:
    """Return what failed: claim -> detail."""
    return {f.claim: f.detail for f in judged(engine, claims, **state) if f.verdict == "failed"}


def test_the_right_engine_passes_everything_that_it_offers():
    found = judged(planar())
    verdicts = {f.claim: f.verdict for f in found}
    offered = {"mass-matrix", "bias", "engine-acceleration", "engine-multipliers"}
    assert {claim for claim, verdict in verdicts.items() if verdict == "passed"} == offered
    assert {f.verdict for f in found} == {"passed", "skipped"}
    assert all(f.engine.__name__ == "Planar" for f in found)


@pytest.mark.parametrize("kind", [Snake, ChainPendulum, Sleigh])
@pytest.mark.night
def test_the_right_engine_passes_at_random_states(kind):
    found = eomcheck.validate(kind.example(), examples=40, engines=[planar()], claims=ASKING)
    assert [str(f) for f in found if f.verdict == "failed"] == []
    assert len([f for f in found if f.verdict == "passed"]) > 100


# ---- Faults of the model -------------------------------------------------------------------------

ROTATION = "[[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]"
MASS = "return M + np.diag(self.tree.armature)"
BIAS = "return sum(m * J.T @ rest for m, _, J, rest, _ in self.bodies(q, v))"
MODEL = {
    "transposed_rotation": (ROTATION, f"{ROTATION}).T + 0 * (0", "mass-matrix", "sign"),
    "wrong_parent": ("placed[parent]", "placed[max(parent - 1, -1)]", "mass-matrix", "(y, θ_1)"),
    "centrifugal_sign": ("rest - (spin @ w) ** 2", "rest + (spin @ w) ** 2", "bias", "sign"),
    "centrifugal_half": ("rest - (spin", "rest - 0.5 * (spin", "bias", "half the expected value"),
    "centrifugal_in_degrees": ("rest - (spin", "rest - 57.3**2 * (spin", "bias", "found"),
    "armature": (MASS, f"{MASS} + 0.01 * np.eye(len(q))", "mass-matrix", "found"),
    "no_inertia": (" + i * np.outer(spin, spin)", "", "mass-matrix", "(θ_3, θ_3): found"),
    "mass_in_gram": ("sum(m * J.T @ J", "sum(1000 * m * J.T @ J", "mass-matrix", "found"),
    "angle_in_degrees": ("rotation(x[j])", "rotation(np.degrees(x[j]))", "mass-matrix", "found"),
    "angle_sign": ("rotation(x[j])", "rotation(-x[j])", "mass-matrix", "sign"),
    "other_coordinates": ("return T @ q +", "return q.copy() +", "mass-matrix", "found"),
    "other_velocities": ("shift, T, ", "shift, np.eye(len(T)), ", "mass-matrix", "found"),
    "gravity_in_bias": ("J.T @ rest", "J.T @ (rest + [0, 9.81])", "bias", "row y: found"),
    "no_bias": (BIAS, "return np.zeros(len(q))", "bias", "missing"),
    "float32_mass": (MASS, f"return ({MASS[7:]}).astype('f')", "mass-matrix", "single precision"),
    "float32_bias": (BIAS, f"{BIAS}.astype('f')", "bias", "single precision"),
    "upper_half": (MASS, f"return np.triu({MASS[7:]})", "mass-matrix", "found 0, expected"),
    "multipliers_sign": ("x[n:]", "-x[n:]", "engine-multipliers", "sign"),
    "drift_sign": ("[F, -gamma]", "[F, gamma]", "engine-acceleration", "found"),
    "forces_forgotten": ("Q - self.bias", "-self.bias", "engine-acceleration", "found"),
}
"""Name -> text, what it becomes, the claim that fails first, and what is said."""


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", MODEL)
def test_a_fault_of_the_model_is_caught_and_named(name, tmp_path):
    old, new, claim, says = MODEL[name]
    engine = planar(with_fault(tmp_path, f"planar_{name}", old, new))
    found = failures(engine)
    assert next(iter(found)) == claim
    assert says in found[claim]
    assert "expected" in found[claim]


def test_found_is_the_engines_and_expected_the_references():
    class Double(planar()):
        def mass_matrix(self, q, t=0.0):
            return 2 * super().mass_matrix(q, t)

    (detail,) = failures(Double, ["mass-matrix"]).values()
    here = SCENE.terms(*_arguments())
    largest = np.unravel_index(np.argmax(np.abs(here.M)), here.M.shape)
    assert f"found {2 * here.M[largest]:.9g}, expected {here.M[largest]:.9g}" in detail
    assert "twice the expected value" in detail


def _arguments():
    from eomcheck.evaluation.evaluation import Evaluation

    at = Evaluation(SCENE, Q, V)
    return at.parameters, at.prepared, at.q, at.v


def test_of_our_engines_found_is_still_the_scenes():
    class Wrong(Snake):
        @staticmethod
        def terms(parameters, angles, q, v):
            terms = Snake.terms(parameters, angles, q, v)
            return terms._replace(M=2 * terms.M)

    scene = Wrong([1.0], [1.0], [0.1], None, [0.0])
    (finding,) = eomcheck.check_state(
        scene, np.zeros(3), np.zeros(3), engines=["casadi"], claims=["mass-matrix"]
    )
    assert finding.detail.endswith("twice the expected value")
    assert finding.engine is None


# ---- Answers that are none -----------------------------------------------------------------------


def changed(**methods) -> type[Engine]:
    return type("Changed", (planar(),), methods)


def raising(self, q, v, t=0.0):
    return {}["missing"]


def writing(place: int) -> dict[str, Callable]:
    """Return an acceleration that writes into one of its arguments once it has its answer."""

    def acceleration(self, *given):
        found = planar().acceleration(self, *given)
        given[place].fill(7.0)
        return found

    return {"acceleration": acceleration}


class Odd:
    def __getattr__(self, name):
        raise ValueError(name)


ARRAY = "expected an array of shape"
ANSWERS = {
    "nan": ("bias", lambda self, q, v, t: np.full(5, np.nan), "returned nan in entry [0]"),
    "inf": ("mass_matrix", lambda self, q, t: np.full((5, 5), np.inf), "returned inf in entry"),
    "list": ("bias", lambda self, q, v, t: [0.0] * 5, f"returned a list, {ARRAY} (5)"),
    "none": ("mass_matrix", lambda self, q, t: None, f"returned None, {ARRAY} (5, 5)"),
    "column": ("bias", lambda self, q, v, t: np.zeros((5, 1)), f"of shape (5, 1), {ARRAY} (5)"),
    "half": ("mass_matrix", lambda self, q, t: np.zeros(15), f"of shape (15,), {ARRAY} (5, 5)"),
    "complex": ("bias", lambda self, q, v, t: np.zeros(5, complex), "an array of complex128"),
    "truth": ("mass_matrix", lambda self, q, t: np.eye(5) > 0, "an array of bool, expected real"),
    "text": ("bias", lambda self, q, v, t: np.array(["x"] * 5), "an array of <U1"),
    "odd": ("bias", lambda self, q, v, t: Odd(), "returned an Odd, which raised ValueError"),
    "exception": ("bias", raising, "raised KeyError: 'missing' (test_engine_faults.py, line"),
    "no t": ("mass_matrix", lambda self, q: np.eye(5), "raised TypeError"),
    "writes": ("bias", lambda self, q, v, t: v.fill(0) or v, "changes an array that it is handed"),
    "map": ("velocity_map", lambda self, q, v: (q, np.eye(4), q), "S returned an array of shape"),
    "no map": ("velocity_map", lambda self, q, v: 1.0, "velocity_map returned a float"),
    "no pair": ("acceleration", lambda self, *_: np.zeros(5), "acceleration returned a"),
    "short": ("acceleration", lambda self, *_: (np.zeros(5), np.zeros(2)), "λ returned an array"),
}


@pytest.mark.parametrize("name", ANSWERS)
def test_an_answer_that_is_none_fails_with_engine_method_and_state(name):
    method, function, says = ANSWERS[name]
    found = [f for f in judged(changed(**{method: function})) if f.verdict == "failed"]
    assert found
    (first, *_) = [f for f in found if says in f.detail]
    assert first.detail.startswith(f"Changed: {method}")
    assert first.observed == np.inf and first.ratio == np.inf
    assert first.state is not None and first.state.q.tolist() == Q.tolist()


@pytest.mark.parametrize("place", range(5), ids=["q", "v", "Q", "a", "gamma"])
def test_an_engine_that_writes_into_what_it_is_handed_fails_wherever_it_does(place):
    found = failures(changed(**writing(place)))
    says = "Changed: acceleration changes an array that it is handed"
    assert set(found) == {"engine-acceleration", "engine-multipliers"}
    assert all(detail.startswith(says) for detail in found.values())


def test_what_an_engine_raises_is_told_with_the_line_that_raised_it():
    def deep(q):
        return 1 / int(q[0] > 100)

    def bias(self, q, v, t=0.0):
        return deep(q) * q

    line = deep.__code__.co_firstlineno + 1
    what = "raised ZeroDivisionError: division by zero"
    said = f"Changed: bias {what} (test_engine_faults.py, line {line})"
    assert failures(changed(bias=bias))["bias"].startswith(said)


def test_one_method_that_breaks_does_not_end_the_run():
    def broken(self, q, v, t=0.0):
        raise RuntimeError("no")

    found = judged(changed(bias=broken))
    passed = {f.claim for f in found if f.verdict == "passed"}
    failed = {f.claim for f in found if f.verdict == "failed"}
    assert passed == {"mass-matrix"}
    assert failed == {"bias", "engine-acceleration", "engine-multipliers"}


def test_an_engine_that_cannot_be_made_fails_in_every_claim_that_it_offers():
    def broken(self, scene):
        raise ValueError("no wheels")

    found = judged(changed(__init__=broken))
    failed = [f for f in found if f.verdict == "failed"]
    assert {"mass-matrix", "bias", "engine-acceleration"} <= {f.claim for f in failed}
    assert all("Changed(scene) raised ValueError: no wheels" in f.detail for f in failed)


def test_what_overflows_in_the_engine_alone_is_inconclusive_where_the_state_is_huge():
    engine = changed(bias=lambda self, q, v, t=0.0: np.full(5, np.inf))
    (finding,) = eomcheck.check_state(
        SCENE, Q, 1e120 * V, engines=[engine], claims=["bias"], consistent=False
    )
    assert finding.verdict == "inconclusive"
    assert "bias" in failures(engine)


# ---- State that is kept --------------------------------------------------------------------------


def remembering(method: str, key) -> type[Engine]:
    """Return an engine that answers again what it answered for the same `key` of its arguments."""
    right = getattr(planar(), method)

    def remembered(self, *arguments):
        known = self.__dict__.setdefault("known", {})
        return known.setdefault(key(*arguments), right(self, *arguments))

    return changed(**{method: remembered})


STALE = {
    "forever": ("mass_matrix", lambda q, t: 0, "mass-matrix"),
    "by the position": ("bias", lambda q, v, t: tuple(q), "bias"),
    "by the velocity": ("bias", lambda q, v, t: tuple(v), "bias"),
}


@pytest.mark.parametrize("name", STALE)
def test_an_answer_that_is_kept_where_it_should_not_be_fails_and_is_named(name):
    method, key, claim = STALE[name]
    found = failures(remembering(method, key), [claim])
    if name == "by the velocity":  # another position at the same speed is not asked for
        assert found == {} or "a new engine answers right" in found[claim]
    else:
        assert "a new engine answers right: it keeps what it was asked before" in found[claim]


def test_a_bias_that_needs_the_mass_matrix_asked_at_the_same_place_first_fails():
    right = planar()

    def mass_matrix(self, q, t=0.0):
        self.q = q.copy()
        return right.mass_matrix(self, q, t)

    def bias(self, q, v, t=0.0):
        return right.bias(self, getattr(self, "q", q), v, t)

    assert "bias" in failures(changed(mass_matrix=mass_matrix, bias=bias))


# ---- What is not told ----------------------------------------------------------------------------


def test_what_an_engine_does_not_offer_is_told_once_in_a_run():
    found = eomcheck.validate(SCENE, examples=5, engines=[planar()], claims=ASKING)
    unseen = [f for f in found if f.verdict == "skipped"]
    assert [f.detail for f in unseen] == [
        "it does not offer forces",
        "it does not offer constraint_jacobian",
        "it does not offer constraint_drift",
        "it does not offer kane_inertia_remainder",
    ]


def test_what_an_engine_does_not_offer_is_told_of_every_engine():
    engines = [type(key, (planar(),), {"key": key}) for key in ("one", "other")]
    found = eomcheck.validate(SCENE, examples=1, engines=engines, claims=["generalized-forces"])
    unseen = [f.subject for f in found if f.verdict == "skipped"]
    assert unseen == ["one", "other"]


def test_without_constraints_nothing_of_them_is_missing():
    scene = ChainPendulum.example()
    found = eomcheck.check_state(scene, *scene.initial_state(), engines=[planar()], claims=ASKING)
    unseen = {f.claim: f.detail for f in found if f.verdict == "skipped"}
    for claim in ("constraint-jacobian", "constraint-drift", "engine-multipliers"):
        assert unseen[claim].startswith("needs constraints")
    assert unseen["generalized-forces"] == "it does not offer forces"


@pytest.mark.parametrize(("pull", "verdicts"), [(0.0, ["skipped"]), (-9.81, ["failed"])])
def test_forces_that_only_the_engine_has_fail_and_zeros_are_skipped(pull, verdicts):
    scene = Sleigh.example()
    engine = changed(forces=lambda self, q, v, t=0.0: np.array([0.0, pull, 0.0]))
    found = eomcheck.check_state(
        scene, *scene.initial_state(), engines=[engine], claims=["generalized-forces"]
    )
    assert [f.verdict for f in found] == verdicts
    why = "needs forces" if pull == 0.0 else "row y: found -9.81, expected 0: should vanish"
    assert all(why in f.detail for f in found)


def test_an_engine_without_acceleration_needs_not_say_what_it_solves_like():
    class Bare(Engine):
        version = classmethod(lambda cls: "bare 1")
        represents = classmethod(lambda cls, scene: True)
        mass_matrix, bias = planar().mass_matrix, planar().bias
        velocity_map, bodies = planar().velocity_map, planar().bodies  # type: ignore[attr-defined]

        def __init__(self, scene):
            super().__init__(scene)
            self.tree = scene.tree()

    assert Bare.key == "bare"
    verdicts = {f.claim: f.verdict for f in judged(Bare)}
    assert verdicts["mass-matrix"] == verdicts["bias"] == "passed"
    assert verdicts["engine-acceleration"] == "skipped"


def test_constraints_that_give_way_are_a_difference_of_model_and_never_pass_or_fail():
    class Soft(planar()):
        compliant: ClassVar[bool] = True

        def acceleration(self, *arguments):
            vdot, multipliers = super().acceleration(*arguments)
            return EngineAcceleration(1.04 * vdot, multipliers)

    found = {f.claim: f for f in judged(Soft)}
    one = found["engine-acceleration"]
    assert one.verdict == "skipped"
    assert one.detail == "its constraints are compliant: a difference of model, here 0.04 of it"
    assert found["engine-multipliers"].verdict == "skipped"
    assert found["mass-matrix"].verdict == "passed"


def test_without_constraints_even_a_compliant_engine_is_compared():
    scene = ChainPendulum.example()
    engine = changed(compliant=True, acceleration=lambda self, *_: (np.ones(3), None))
    found = eomcheck.check_state(
        scene, *scene.initial_state(), engines=[engine], claims=["engine-acceleration"]
    )
    assert [f.verdict for f in found] == ["failed"]


def test_a_wrong_signature_is_reported_at_the_method():
    class Narrow(planar()):  # type: ignore[misc]
        def bias(self, q, t=0.0):
            return q

    scene = Sleigh()
    (finding,) = eomcheck.check_state(
        scene, *scene.initial_state(), engines=[Narrow], claims=["bias"]
    )
    line = Narrow.bias.__code__.co_firstlineno
    assert finding.detail.endswith(f"were given (test_engine_faults.py, line {line})")
