"""What a Finding says: as text, as plain data, and of the entry that is wrong."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.claims.test_finding import FOUND, SCENE

from eomcheck.claims import registry
from eomcheck.claims.confusions import diagnose
from eomcheck.claims.finding import (
    Finding,
    Proof,
    Unresolved,
    entries_of,
    entry_name,
    judge,
    unresolved_by_claim,
    unresolved_finding,
    worst_of,
)
from eomcheck.evaluation.tolerance import INCONCLUSIVE, UNDERFLOW, allowed_error
from eomcheck.numbers.generic import EPS
from eomcheck.scenes import Snake

PROOF = Proof(7, 12.5, (101, 103, 107), 5, 1e-30)
FOR_ALL = replace(FOUND, state=None, evidence="proved: 3 points", detail="", proof=PROOF)


@pytest.mark.parametrize(
    ("finding", "said"),
    [
        (FOUND, "bias [au] failed on heavy: observed 3, allowed 2 (row x)"),
        (
            replace(FOUND, verdict="passed", detail="", observed=1e-9, allowed=0.125),
            "bias [au] passed on heavy: observed 1e-09, allowed 0.125",
        ),
        (
            replace(FOUND, verdict="skipped", detail="no λ"),
            "bias [au] skipped on heavy: no λ",
        ),
        (FOR_ALL, f"bias [au] proved: 3 points on {SCENE.structure}"),
        (
            replace(FOR_ALL, detail="row y: wrong sign"),
            f"bias [au] proved: 3 points on {SCENE.structure} (row y: wrong sign)",
        ),
        (
            replace(FOUND, cause="M", follows="of-energy"),
            "  follows from M: bias [au] failed on heavy: observed 3, allowed 2 (row x)",
        ),
        (
            replace(FOUND, cause="M"),
            "bias [au] failed on heavy: observed 3, allowed 2 (row x)",
        ),
    ],
    ids=["failed", "passed", "skipped", "proved", "disproved", "follows", "cause"],
)
def test_a_finding_is_one_line(finding: Finding, said: str):
    assert str(finding) == said


DATA = {
    "claim": "bias",
    "subject": "au",
    "scene": repr(SCENE),
    "q": [0.1, -0.2, 0.3],
    "v": [1.0, 2.0, 3.0],
    "t": 1.5,
    "observed": 3.0,
    "allowed": 2.0,
    "verdict": "failed",
    "evidence": "compared",
    "detail": "row x",
}
PLACE = ("scene", "q", "v", "t")


@pytest.mark.parametrize(
    ("changes", "also"),
    [
        ({}, {}),
        ({"observed": np.inf}, {"observed": None}),
        ({"observed": np.nan}, {"observed": None}),
        ({"allowed": np.inf}, {"allowed": None}),
        ({"digits": 3.5}, {"digits": 3.5}),
        ({"cause": "M"}, {"cause": "M"}),
        ({"cause": "M", "follows": "energy"}, {"cause": "M", "follows": "energy"}),
        (
            {"proof": PROOF},
            {
                "proof": {
                    "degree": 7,
                    "height": 12.5,
                    "primes": [101, 103, 107],
                    "draws": 5,
                    "failure_probability": 1e-30,
                }
            },
        ),
    ],
)
def test_a_finding_as_plain_data_has_all_that_it_says(changes: dict, also: dict):
    found = replace(FOUND, **changes)
    assert found.as_dict() == DATA | also
    without = {name: x for name, x in (DATA | also).items() if name not in PLACE}
    assert found.as_dict(whole=False) == without


def test_a_finding_about_all_states_has_a_structure_for_a_place():
    assert FOR_ALL.place == {"structure": SCENE.structure}
    assert FOR_ALL.as_dict().keys() >= {"structure", "proof"}
    assert not FOR_ALL.as_dict().keys() & set(PLACE)


def test_a_reason_is_added_to_a_detail():
    assert FOUND.because("so").detail == "row x; so"
    assert FOUND.because("so").because("it is").detail == "row x; so; it is"


# ---- Diagnoses -----------------------------------------------------------------------------------

SQUARE = np.array([[1.0, 2.0], [-3.0, 5.0]])
ROWS = np.array([[1.0, 2.0, 7.0], [-3.0, 5.0, -0.125]])


def with_worst(x: np.ndarray, where: tuple[int, ...], value: float) -> np.ndarray:
    found = x + 1e-3  # wrong everywhere, and most in one entry
    found[where] = value
    return found


@pytest.mark.parametrize(
    ("found", "said"),
    [
        (SQUARE.T, "transposed"),
        (-SQUARE, "wrong sign"),
        (with_worst(ROWS, (1, 0), 3.0), "wrong sign"),
        (with_worst(ROWS, (0, 2), 0.0), "missing"),
        (with_worst(ROWS, (0, 2), 14.0), "twice the expected value"),
        (with_worst(ROWS, (1, 1), 20.0), "4 times the expected value"),
        (with_worst(ROWS, (0, 2), 3.5), "half the expected value"),
        (with_worst(ROWS, (0, 2), 1.75), "a quarter of the expected value"),
        (with_worst(ROWS, (1, 2), -0.5), "4 times the expected value"),
        (with_worst(ROWS, (1, 1), 15.0), "15, expected 5"),
        (with_worst(ROWS, (0, 2), -7.0 * (1 + 500 * EPS)), "wrong sign"),
        (with_worst(ROWS, (0, 2), -7.0 * (1 + 2000 * EPS)), "-7, expected 7"),
    ],
)
def test_the_worst_entry_is_told_by_what_it_looks_like(found: np.ndarray, said: str):
    expected = SQUARE if found.shape == SQUARE.shape else ROWS
    assert diagnose(found, expected, 0.0) == said


@pytest.mark.parametrize(("off", "said"), [(0.9e-3, "wrong sign"), (1.1e-3, "-7.0011, expected 7")])
def test_what_an_entry_looks_like_is_told_within_what_rounding_explains(off: float, said: str):
    assert diagnose(with_worst(ROWS, (0, 2), -7.0 - off), ROWS, 1e-3) == said


def test_an_entry_is_told_as_asked_though_another_is_worse():
    found = with_worst(ROWS, (0, 2), -7.0)
    found[1, 1] = 10.0
    assert diagnose(found, ROWS, 0.0, (1, 1)) == "twice the expected value"


def test_the_worst_entry_is_the_largest_of_either_sign_and_what_is_no_number():
    error = np.array([[1.0, -4.0, 2.0], [3.0, 0.0, -3.5]])
    assert worst_of(error) == (0, 1)
    error[1, 2] = np.nan
    assert worst_of(error) == (1, 2)


# ---- Verdicts ------------------------------------------------------------------------------------

SENSITIVITY = 1.0 / allowed_error(1.0)  # of which 1 is allowed


@pytest.mark.parametrize(
    ("observed", "allowed", "scale", "verdict"),
    [
        (1.0, 1.0, 1e4, "passed"),
        (1.0 + 1e-9, 1.0, 1e4, "failed"),
        (0.0, 1.0, 1.001 / INCONCLUSIVE, "passed"),
        (0.0, 1.0, 0.999 / INCONCLUSIVE, "inconclusive"),
        (50.0, 1.0, 0.999 / INCONCLUSIVE, "inconclusive"),
        (np.inf, 1.0, 1e-9, "failed"),
        (np.nan, 1.0, 1e4, "failed"),
        (np.nan, 1.0, np.inf, "inconclusive"),
        (0.0, np.inf, 1.0, "inconclusive"),
        (0.0, 0.5 * UNDERFLOW, 0.0, "passed"),
        (0.0, 2.0 * UNDERFLOW, 0.0, "inconclusive"),
        (UNDERFLOW, 0.0, 1.0, "inconclusive"),
        (2.0 * UNDERFLOW, 0.0, 1.0, "failed"),
        (0.0, 0.0, 0.0, "passed"),
    ],
)
def test_a_verdict_changes_where_it_should(observed, allowed, scale, verdict):
    assert judge(observed, allowed * SENSITIVITY, scale) == (pytest.approx(allowed), verdict)


# ---- What is not resolved ------------------------------------------------------------------------


def test_entries_are_named_along_their_axes():
    names = ("x", "y"), ("a", "b", "c"), ("p",)
    assert entry_name((1, 2), names[:2]) == "entry (y, c)"
    assert entry_name((1,), names[:1]) == "row y"
    assert entry_name((0, 1, 0), names) == "entry (x, b, p)"
    assert entry_name((), ()) == "value"


def test_what_many_subjects_leave_is_about_all_of_them():
    found = replace(FOUND, entries=entries_of((("x", "y"),), [True, False], [False, True]))
    left = [Unresolved(f"f{i}", "row x", found, 3) for i in range(9)]
    few, many = unresolved_finding(left[:8]), unresolved_finding(left)
    assert few.subject == "f0, f1, f2, f3, f4, f5, f6, f7" and many.subject == "all"
    assert few.detail.endswith("f6, row x; f7, row x") and many.detail.endswith(" and 1 more")
    assert few.detail.startswith("not resolved in any of 3 states: f0, row x; f1, row x")
    twice = unresolved_finding([left[0], left[0]._replace(entry="row y", states=1)])
    assert (twice.subject, twice.verdict, twice.entries) == ("f0", "inconclusive", None)
    whole = unresolved_finding([Unresolved("au", "", FOUND, 1)])
    assert whole.detail == "not resolved in this state: au"


def test_the_largest_scene_stands_for_what_no_state_resolves():
    def of(links: int) -> Finding:
        scene = Snake.coil(links)
        entries = entries_of((("a", "b", "c"),), [True, False, False], [False, True, False])
        return replace(FOUND, scene=scene, verdict="passed", entries=entries)

    findings = [of(2), of(4), of(3), replace(of(5), state=None), replace(of(6), subject="im")]
    ((one, other),) = unresolved_by_claim(findings).values()
    assert (one.subject, one.entry, one.states, one.finding.scene.n) == ("au", "row b", 3, 6)
    assert (other.name, other.states, other.finding.scene.n) == ("im, row b", 3, 8)


# ---- Sides ---------------------------------------------------------------------------------------


def test_sides_that_vanish_have_the_sizes_of_their_terms():
    terms = np.array([[1.0, 8.0, 2.0], [4.0, 0.5, 3.0]])
    sides = registry.vanishing("x", terms - terms, (("a", "b"), ("c", "d", "e")), terms, 5.0)
    assert (sides.size, sides.sensitivity, sides.may_vanish) == (8.0, 5.0, False)
    assert sides.sizes is terms and sides.expected.shape == (2, 3) and not sides.expected.any()
    one = registry.vanishing("x", np.zeros(2), (("a", "b"),), 3.0)
    assert (one.size, one.sizes, one.sensitivity) == (3.0, None, None)


@pytest.mark.parametrize(("told", "sensitivity"), [(True, None), (False, np.inf)])
def test_what_is_not_told_is_allowed_anything(told: bool, sensitivity: Any):
    assert registry.sensitivity_where(told) == sensitivity


def test_magnitudes_are_products_without_signs():
    a, b = np.array([[1.0, -2.0], [-3.0, 0.5], [0.0, 4.0]]), np.array([-5.0, 2.0])
    assert registry.magnitude(a, b).tolist() == [9.0, 16.0, 8.0]
    assert registry.product_size(a, b) == 16.0
    assert registry.product_size(np.ones(3), a, b) == 33.0
    assert registry.product_size(a.astype(object), b) == registry.product_size(None) == 0.0


def test_sides_along_directions_are_rows_by_coordinates():
    look: Any = type("At", (), {"directions": np.eye(3), "direction_names": ("x", "y", "z")})()
    given = iter([(1, 2), None, (3, 5)])
    (one,) = registry.along_directions(look, "B", lambda direction: next(given))
    assert (one.actual.tolist(), one.expected.tolist()) == ([1, 3], [2, 5])
    assert (one.subject, one.names) == ("B", (("x", "y", "z"),))
    assert not list(registry.along_directions(look, "B", lambda direction: None))


def test_axes_are_named_by_what_they_count():
    scene = Snake.coil(2)
    q, wheels = scene.coordinate_names, scene.constraint_names
    assert {name: registry.names_of_term(scene, name) for name in ("M", "Q", "B", "a", "b")} == {
        "M": (q, q),
        "Q": (q,),
        "B": (q,),
        "a": (wheels, q),
        "b": (wheels,),
    }
    assert registry.names_of_term(scene, "gamma") == (wheels,) != (q,)
    assert registry.numbered("u_", 3) == ("u_1", "u_2", "u_3")
    assert list(registry.unordered_pairs("abc")) == [("a", "b"), ("a", "c"), ("b", "c")]
