"""Positions that close, and the states that scenes start from."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eomcheck import strategies
from eomcheck.errors import RefusedError
from eomcheck.evaluation import constraint_rank
from eomcheck.evaluation.dynamics import assembled_position, assembly_error
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import check_consistent, sensitivity_of
from eomcheck.evaluation.tolerance import allowed_error
from eomcheck.numbers.linear import least_squares
from eomcheck.scenes import SCENES, FourBarChain

kinds = pytest.mark.parametrize("kind", SCENES.values(), ids=SCENES)
HOLONOMIC = [kind for kind in SCENES.values() if kind.position_residual is not None]
holonomic = pytest.mark.parametrize("kind", HOLONOMIC, ids=[kind.key for kind in HOLONOMIC])


def test_an_open_chain_from_which_no_direction_leads_on_is_not_returned_as_closed():
    """Stretched out backwards its gap is 2 m, along the bars, which cannot change it."""
    with pytest.raises(RefusedError, match="no closed position is found"):
        assembled_position(FourBarChain.rods(1), [np.pi, 0.0, 0.0])


def test_a_search_that_overflows_is_refused(monkeypatch, capfd):
    assert np.isnan(least_squares(np.array([[np.inf, 1.0]]), np.ones(1))).all()
    assert np.isnan(least_squares(np.eye(2), np.array([np.nan, 1.0]))).all()
    assert capfd.readouterr() == ("", ""), "LAPACK complains by itself"
    monkeypatch.setattr(constraint_rank, "least_squares", lambda a, b: np.full(a.shape[1], np.nan))
    with pytest.raises(RefusedError, match="no closed position is found"):
        assembled_position(FourBarChain.rods(1), [0.3, 1.0, 2.0])


@pytest.mark.sampled(2)
@holonomic
@pytest.mark.parametrize("far", [0.01, 0.3, 2.0, 50.0])
def test_what_is_returned_is_closed_wherever_the_search_starts(kind, far):
    scene = kind.example()
    q0, _ = scene.initial_state()
    for seed in range(5):
        q = q0 + far * np.random.default_rng(seed).normal(size=scene.n)
        try:
            at = Evaluation(scene, assembled_position(scene, q), np.zeros(scene.n))
        except RefusedError:
            assert far > 0.01
            continue
        gap = np.abs(scene.position_residual(at.parameters, at.prepared, at.q)).max()
        assert gap <= 1e-12 * (1 + np.abs(at.q).max())


@holonomic
def test_a_gap_ten_times_what_rounding_allows_is_seen(kind):
    scene = kind.example()
    q, v = scene.initial_state()
    gap, allowed = assembly_error(Evaluation(scene, q, v))
    assert gap <= allowed < 1e-12
    a = Evaluation(scene, q, v).terms.a[scene.holonomic]
    opening = np.linalg.lstsq(a, np.full(len(a), 10 * allowed), rcond=None)[0]
    gap, allowed = assembly_error(Evaluation(scene, q + opening, v))
    assert gap > allowed


@kinds
@settings(max_examples=8)
@given(data=st.data())
def test_a_scene_starts_closed_and_consistent_by_both_derivations(kind, data):
    scene = data.draw(strategies.scenes(kind, 1, 5))
    q, v = scene.initial_state()
    at = Evaluation(scene, q, v)
    check_consistent(at)
    if scene.r > 0:

        def constraint(e: Evaluation):
            return np.asarray(e.call(scene.constraint, e.parameters, e.prepared, e.q, e.v))

        sensitivity = sensitivity_of(at, constraint, coordinates=True)
        assert np.abs(constraint(at)).max() <= allowed_error(sensitivity) < 1e-9
    if scene.position_residual is not None:
        gap, allowed = assembly_error(at)
        assert gap <= allowed


@kinds
def test_a_start_that_is_off_by_a_billionth_is_seen(kind):
    scene = kind.example()
    q, v = scene.initial_state()
    a = Evaluation(scene, q, v).terms.a
    if a is None:
        return
    for row in np.eye(scene.r):
        at = Evaluation(scene, q, v + 1e-9 * np.linalg.lstsq(a, row, rcond=None)[0])
        with pytest.raises(ValueError, match="v violates the constraint"):
            check_consistent(at)
