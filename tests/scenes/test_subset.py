"""A scene with some of its constraints, chosen by name."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

import eomcheck
from eomcheck import with_constraints
from eomcheck.errors import InputError, UnknownNameError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.scenes import Bicycle, Bricard, ChainPendulum, FourBarChain, Snake

RING = Bricard(redundant=2.0)
LEFT = with_constraints(RING, RING.constraint_names[:4])
TWICE = replace(FourBarChain.rods(2), angle=1.0, repeated=1.0)


def test_rows_that_are_left_are_those_of_the_scene():
    q, v = RING.closed_state(0.5, 0.7)
    names = "hinge along z", "tip along y"
    some = with_constraints(RING, names)
    assert some.constraint_names == ("tip along y", "hinge along z")
    assert (some.n, some.r, some.p) == (5, 2, 3)
    here, whole = Evaluation(some, q, v).terms, Evaluation(RING, q, v).terms
    for part, of in zip(here, whole, strict=True):
        if of is not None:
            expected = of[[0, 4]] if of is whole.a or of is whole.gamma else of
            assert (part == expected).all()
    assert whole.b is None and here.b is None


@pytest.mark.night
def test_claims_and_proofs_hold_of_what_is_left():
    findings = eomcheck.check_state(LEFT, *RING.closed_state(0.5, 0.7))
    assert {f.verdict for f in findings} <= {"passed", "skipped", "inconclusive"}
    assert {f.subject for f in findings if f.claim == "true-error"} == set(
        eomcheck.formulations.applicable(LEFT)
    )
    proved = eomcheck.prove(LEFT, points=1, seed=1)
    assert {f.verdict for f in proved} == {"passed"}
    assert len(proved) == len(eomcheck.prove(Bricard(), points=1, seed=1))


@pytest.mark.night
def test_without_its_redundant_row_a_scene_is_one_that_never_had_it():
    bare = eomcheck.simulate(Bricard(), "kane", 0.5, output_times=[0.5])
    left = eomcheck.simulate(LEFT, "kane", 0.5, output_times=[0.5])
    assert np.array_equal(bare.q, left.q)
    states = eomcheck.strategies.states(LEFT)
    assert states is not None
    assert len(eomcheck.validate(LEFT, examples=3)) > 0


def test_it_is_read_back_and_written_as_what_it_is():
    again = pickle.loads(pickle.dumps(LEFT))
    assert type(again) is type(LEFT)
    assert again.constraint_names == LEFT.constraint_names
    assert repr(again) == repr(LEFT)
    scope = {"eomcheck": eomcheck, "Bricard": Bricard}
    assert type(eval(repr(LEFT), scope)) is type(LEFT)
    assert LEFT.structure == "bricard, with redundant, without the constraint of hinge along z"


def test_all_of_them_are_the_scene_itself():
    assert with_constraints(RING, RING.constraint_names) is RING


def test_some_of_some_are_left():
    fewer = with_constraints(LEFT, ["tip along x", "tip along y"])
    q, v = RING.closed_state(0.5, 0.7)
    rows = Evaluation(RING, q, v).terms.a[[0, 3]]
    assert (Evaluation(fewer, q, v).terms.a == rows).all()


def test_holonomic_rows_stay_so():
    bicycle = Bicycle()
    closed = bicycle.constraint_names[bicycle.holonomic]
    some = with_constraints(bicycle, [*bicycle.constraint_names[:2], closed[1]])
    assert some.constraint_names[some.holonomic] == (closed[1],)
    q, v = bicycle.initial_state()
    here, whole = Evaluation(some, q, v), Evaluation(bicycle, q, v)
    found, every = (
        at.call(at.scene.position_residual, at.parameters, at.prepared, at.q)
        for at in (here, whole)
    )
    assert found.shape == (1,) and found[0] == every[1]
    a = whole.terms.a[[bicycle.constraint_names.index(name) for name in some.constraint_names]]
    assert (here.terms.a == a).all()
    rolling = with_constraints(bicycle, bicycle.constraint_names[:2])
    assert rolling.position_residual is None


@pytest.mark.parametrize(
    ("scene", "names", "error", "says"),
    [
        (RING, ["tip"], UnknownNameError, "unknown constraint 'tip'; known: tip along y"),
        (RING, [], InputError, r"constraints = \(\), expected the names of some"),
        (RING, "tip along y", InputError, "constraints = 'tip along y', expected a list"),
        (RING, 3, InputError, "constraints = 3, expected a list"),
        (
            ChainPendulum.rods(2) if hasattr(ChainPendulum, "rods") else RING,
            ["x"],
            UnknownNameError,
            "unknown constraint 'x'",
        ),
        (Snake.paper(), Snake.paper().constraint_names[:3], InputError, "none can be left out"),
        ("ring", ["x"], InputError, "expected a scene"),
    ],
)
def test_what_cannot_be_left_is_said(scene, names, error, says):
    with pytest.raises(error, match=says):
        with_constraints(scene, names)


def test_a_change_that_takes_a_constraint_away_is_refused():
    with pytest.raises(
        InputError, match="the scene has 4 constraints, those left were chosen of 5"
    ):
        replace(LEFT, redundant=None).r  # noqa: B018
