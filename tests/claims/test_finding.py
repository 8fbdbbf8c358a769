"""A Finding: how far beyond what is allowed, and the code that shows it again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.reports import Heavy

import eomcheck
from eomcheck.claims.finding import Finding, ratio, worst
from eomcheck.mechanics.records import State

SCENE = Heavy()
STATE = State(np.array([0.1, -0.2, 0.3]), np.array([1.0, 2.0, 3.0]), 1.5)
FOUND = Finding("bias", "au", SCENE, STATE, 3.0, 2.0, "failed", "compared", "row x")


def test_the_ratio_is_observed_over_allowed():
    assert FOUND.ratio == ratio(3.0, 2.0) == 1.5
    assert ratio(1.0, 4.0) == 0.25


def test_an_error_where_none_is_allowed_is_infinitely_too_large():
    assert ratio(1e-300, 0.0) == float("inf")
    assert ratio(np.float64(150.0), np.float64(1e-319)) == float("inf"), "without a warning"
    assert ratio(0.0, 0.0) == 0.0


def test_the_code_of_a_finding_prints_the_finding(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """Whatever the velocity is: a fault may be in the constraints themselves."""
    asked = []

    def check(scene, q, v, t=0.0, *, consistent=True):
        asked.append((repr(scene), q, v, t, consistent))
        return [FOUND, replace(FOUND, verdict="passed"), replace(FOUND, verdict="inconclusive")]

    monkeypatch.setattr(eomcheck, "check_state", check)
    exec(FOUND.as_python(), {})
    assert asked == [(repr(SCENE), STATE.q.tolist(), STATE.v.tolist(), 1.5, False)]
    assert capsys.readouterr().out == f"{FOUND}\n"


def test_a_result_without_a_certain_digit_has_0_digits_and_one_not_enclosed_has_none():
    assert replace(FOUND, digits=0.0).as_dict()["digits"] == 0.0
    assert "digits" not in FOUND.as_dict()


def test_the_worst_finding_is_a_failed_one_then_one_that_passed_then_the_largest_ratio():
    order = ["failed", "passed", "inconclusive", "skipped"]
    each = [replace(FOUND, verdict=verdict, observed=k) for k, verdict in enumerate(order)]
    for k, finding in enumerate(each):
        assert worst(each[k:]) is worst(reversed(each[k:])) is finding
    larger, same = replace(FOUND, observed=7.0), replace(FOUND, subject="kane")
    assert worst([each[1], FOUND, larger, same]) is larger
    assert worst([FOUND, same]) is worst([each[1], FOUND, larger], first=True) is FOUND
