"""A Finding: how far beyond what is allowed, and the code that shows it again."""

from __future__ import annotations

from dataclasses import replace
from html import escape

import numpy as np
import pytest
from tests.reports import Heavy

import eomcheck
from eomcheck.claims.finding import Finding, ratio, worst
from eomcheck.claims.findings import Findings, headline
from eomcheck.claims.run import is_same_failure
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


# ---- Results of a check --------------------------------------------------------------------------

PASSED = replace(FOUND, claim="mass-matrix", verdict="passed", observed=0.5, detail="")
OPEN = replace(FOUND, claim="energy", verdict="skipped", detail="needs T")


def test_results_fail_by_one_failure():
    assert Findings([PASSED, FOUND, OPEN]).verdict == "failed"
    assert Findings([OPEN, PASSED, OPEN]).verdict == "passed"
    assert (Findings([OPEN]).verdict, Findings().verdict) == ("skipped", "skipped")
    result = Findings([PASSED, FOUND, OPEN])
    assert (result.failures, result.undecided) == ([FOUND], [OPEN])
    assert (result.as_python(), Findings([PASSED]).as_python()) == (FOUND.as_python(), "")
    assert isinstance(result, list) and result == [PASSED, FOUND, OPEN]


def test_results_name_the_largest_error():
    small = replace(PASSED, observed=0.1, claim="small")
    largest = "largest error 25 % of what rounding allows (mass-matrix [au])"
    assert headline([small, PASSED]) == f"2 of 2 claims passed; {largest}"
    assert headline([small, PASSED, OPEN]) == f"2 of 3 claims passed, 1 undecided; {largest}"
    assert (
        headline([replace(PASSED, observed=0.0)]) == "1 of 1 claim passed; no error larger than 0"
    )
    assert headline([small, FOUND, FOUND]) == "1 of 2 claims failed: bias"
    assert headline([small, FOUND, OPEN]) == "1 of 3 claims failed: bias; 1 undecided"
    assert headline([OPEN]) == headline([]) == "nothing was decided"
    two = [replace(FOUND, subject=x) for x in ("M[0,1]", "qdd")]
    assert headline(two, "subject") == "2 of 2 quantities failed: M[0,1], qdd"


def test_results_are_printed_in_ten_lines_at_most():
    worse = replace(FOUND, cause="M", detail="; ".join(["a" * 200, *"bcdefgh"]))
    follows = [replace(worse, claim=f"claim-{k}", follows="bias") for k in range(9)]
    others = [replace(FOUND, claim=f"other-{k}", cause=f"cause {k}") for k in range(9)]
    skipped = [replace(OPEN, claim=f"open-{k}") for k in range(9)]
    text = repr(Findings([PASSED, worse, *follows, *others, *skipped]))
    lines = text.splitlines()
    assert len(lines) <= 10 and max(map(len, lines)) <= 100
    assert lines[0].startswith("19 of 29 claims failed: M, cause 0, ")
    assert lines[1] == "FAIL M of heavy (bias [au])"
    assert "and 9 further failures: cause 0 (other-0), cause 1 (other-1), " in text
    assert "skipped: open-0 [au]: needs T\nundecided too: open-1, open-2, open-3 and 5 more" in text
    assert lines[-1] == "code that reproduces the first failure: print(result.as_python())"
    one = repr(Findings([PASSED, FOUND, replace(others[0], subject="el")]))
    assert "and 1 further failure: cause 0 (other-0)" in one
    assert "\n     row x\n     error 3, rounding allows 2\n" in one
    assert repr(Findings([PASSED])).count("\n") == 0


def test_results_are_html_without_a_load_from_outside():
    named = replace(FOUND, detail="row <x>", cause="M & B")
    page = Findings([named, PASSED])._repr_html_()
    assert "FAIL M &amp; B of heavy" in page and "row &lt;x&gt;" in page
    assert escape(named.as_python()) in page and "http" not in page and "<script" not in page
    assert "<details>" not in Findings([PASSED])._repr_html_()


@pytest.mark.parametrize(
    ("change", "same"),
    [
        ({}, True),
        ({"subject": "ml ~ kane"}, True),
        ({"subject": "kane ~ uk"}, False),
        ({"claim": "power-balance"}, False),
        ({"detail": "v̇, row θ_2: 7.5, expected 1e-3"}, True),
        ({"detail": "v̇, row θ_1: wrong sign"}, False),
        ({"verdict": "passed"}, False),
        ({"observed": 3.0, "allowed": 2.0}, True),
    ],
)
def test_a_failure_is_the_same_with_other_numbers_and_its_sides_in_any_order(change, same):
    detail = "v̇, row θ_1: 2.5, expected 2"
    one = Finding("equivalence", "kane ~ ml", None, None, 1.0, 0.1, "failed", "checked", detail)
    assert is_same_failure(replace(one, **change), one) is same
