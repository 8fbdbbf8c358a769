"""Mechanisms by description: every kind of joint and constraint is proved, and its faults seen."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from tests.mechanics.descriptions import ALL, CLOSED, TREES, Arm, FourBar, Skate

import eomcheck
from eomcheck.claims.proof import prove
from eomcheck.claims.repeat import python_of
from eomcheck.evaluation.doubles import Evaluation
from eomcheck.evaluation.dynamics import check_consistent
from eomcheck.mechanics.described import (
    closures,
    constraints,
    energies,
    forces,
    motion,
    pose,
    terms,
)
from eomcheck.mechanics.described.absent import NOTHING, cross, scaled
from eomcheck.mechanics.described.mechanism import Mechanism
from eomcheck.mechanics.records import State

every_kind = pytest.mark.parametrize("kind", ALL.values(), ids=ALL)


def failed(kind: type[Mechanism]) -> set[str]:
    return {f.claim for f in prove(kind(), points=1, seed=0) if f.verdict != "passed"}


@every_kind
def test_every_identity_is_proved(kind: type[Mechanism]):
    findings = prove(kind(), points=1, seed=0)
    assert [str(f) for f in findings if f.verdict != "passed"] == []
    proved = {f.claim for f in findings}
    assert {"mass-matrix", "bias", "equivalence", "equations-residual"} <= proved
    if kind in CLOSED.values():
        assert {"constraint-jacobian", "constraint-drift"} <= proved
        assert ("position-rate" in proved) == (kind is not Skate)


@every_kind
def test_drawn_states_pass_every_claim_with_two_engines(kind: type[Mechanism]):
    findings = eomcheck.validate(kind(), examples=2, seed=1)
    assert [str(f) for f in findings if f.verdict == "failed"] == []
    if kind in TREES.values() and kind is not ALL["Following"]:
        assert any(f.subject == "pinocchio" for f in findings)


@every_kind
def test_it_starts_consistent_and_where_it_closes(kind: type[Mechanism]):
    scene = kind()
    q, v = scene.initial_state()
    check_consistent(at := Evaluation(scene, q, v))
    if scene.position_residual is not None:
        residual = scene.position_residual(at.parameters, at.prepared, at.q)
        assert np.abs(residual).max() < 1e-14


@every_kind
def test_scenes_and_their_kinds_are_pickled(kind: type[Mechanism]):
    scene = kind(mass=2.0 * kind().mass)
    again, known = pickle.loads(pickle.dumps((scene, kind)))
    assert type(again) is known is kind
    assert repr(again) == repr(scene)
    with pytest.raises(ValueError, match="read-only"):
        again.mass[0] = 1.0


@every_kind
def test_it_is_printed_as_the_code_that_makes_it_again(kind: type[Mechanism]):
    for scene in (kind(), kind(mass=2.0 * kind().mass)):
        again = eval(repr(scene), {kind.__name__: kind})
        assert repr(again) == repr(scene)
        assert again.mass.tolist() == scene.mass.tolist()
    code = python_of(Arm(), State(np.zeros(3), np.zeros(3)))
    assert "from tests.mechanics.descriptions import Arm" in code.replace("\n", " ")


# ---- Mistakes in one derivation ------------------------------------------------------------------


def without_rest(rates, arm):
    return NOTHING


def carried_only(rates, arm):
    return cross(rates.alpha, arm)


def no_moment(inertia, rates):
    return terms.applied(inertia, rates.alpha)


def not_shifted(one, away):
    return one


def still(inertia, omega):
    return NOTHING


def halved(a, b):
    row = RIGHT["product"](a, b)
    return row._replace(rest=None)


def other_way(axes, axis, cos, sin):
    return RIGHT["hinged"](axes, axis, cos, -sin)


def upwards(plan, parameters, prepared, Q):
    RIGHT["weigh"](plan, parameters._replace(gravity=-parameters.gravity), prepared, Q)


def standing(rates, k, a):
    return rates[k][0] if k >= 0 else NOTHING


def twice(plan, frames, k):
    return {i: scaled(2, x) for i, x in RIGHT["turning_columns"](plan, frames, k).items()}


RIGHT = {
    "product": closures.product,
    "hinged": pose.hinged,
    "weigh": forces.weigh,
    "turning_columns": motion.turning_columns,
}


@pytest.mark.parametrize(
    ("places", "wrong", "kind", "claim"),
    [
        ([(terms, "swung")], without_rest, "Arm", "bias"),
        ([(terms, "swung")], carried_only, "Arm", "bias"),
        ([(motion, "swung")], carried_only, "Arm", "kane-ml-force"),
        ([(terms, "whirl")], no_moment, "Arm", "bias"),
        ([(terms, "shifted")], not_shifted, "Branched", "mass-matrix"),
        ([(motion, "momentum")], still, "Free", "kane-ml-force"),
        ([(constraints, "swung")], carried_only, "Welded", "constraint-drift"),
        ([(pose, "hinged")], other_way, "Arm", "mass-matrix"),
        ([(forces, "weigh")], upwards, "Arm", "generalized-forces"),
        ([(energies, "moved_point")], standing, "Arm", "mass-matrix"),
        ([(closures, "product")], halved, "Rodded", "constraint-drift"),
        ([(constraints, "turning_columns")], twice, "Hinged", "constraint-jacobian"),
    ],
)
def test_a_mistake_in_one_derivation_is_disproved_and_named(
    places, wrong, kind, claim, monkeypatch
):
    for module, name in places:
        monkeypatch.setattr(module, name, wrong)
    assert claim in failed(ALL[kind])


# ---- What it is ----------------------------------------------------------------------------------


def test_what_stays_in_the_plane_has_no_third_component():
    scene = FourBar()
    assert scene.made.topology.planar
    at = Evaluation(scene, *scene.initial_state())
    jacobians = scene.jacobians(at.parameters, at.prepared, at.q, at.v)
    assert jacobians.linear.shape == (3, 2, 3)
    assert jacobians.angular.shape == (3, 1, 3)
    assert jacobians.gyroscopic is None
    assert scene.offset.shape == (3, 2)


def test_what_is_not_there_is_absent():
    at = Evaluation(Skate(), np.ones(3), np.ones(3))
    assert at.terms.Q is None
    assert at.terms.b is None
    at = Evaluation(Arm(), np.ones(3), np.ones(3))
    assert at.terms[3:] == (None, None, None)
    assert not hasattr(FourBar(), "damping")
    assert FourBar.dissipation is None


def test_a_mechanism_moves_in_machine_code_and_keeps_its_energy():
    found = eomcheck.simulate(FourBar(), "em", 1.0)
    assert found.status == "finished"
    assert np.abs(found.energy - found.energy[0]).max() < 1e-6
