"""Without ranges of their own functions are tried beyond the default ones too, and it is said."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.testing.own import guide

from eomcheck.claims.finding import Finding
from eomcheck.testing import EquationsOfMotion, check_functions
from eomcheck.testing.function_checks import WIDE
from eomcheck.testing.suite import EquationsTarget

CART = guide("cart")
CLAIMS = ["answers", "double-precision", "gravity-of-potential", "reference", "answers-repeat"]
INSIDE = "checked q in [-1, 1], v in [-1, 1]"


def checked(gravity: Any = CART.gravity, **options: Any) -> list[Finding]:
    own = {"gravity": gravity, "U": CART.U, "states": 2, "claims": CLAIMS}
    return check_functions(3, **(own | options))


def details(found: list[Finding], claim: str) -> list[str]:
    return [x.detail for x in found if x.claim == claim and x.verdict != "passed"]


def wrapped(q):
    """Gravity that takes angles beyond 1.2 for others, as arcsin of a sine does too late."""
    return CART.gravity(np.where(np.abs(q) > 1.2, 2.4 - q, q))


def test_what_fails_beyond_the_default_ranges_only_is_inconclusive_and_names_them():
    found = checked(wrapped)
    assert {x.verdict for x in found} == {"passed", "inconclusive", "skipped"}
    (text,) = details(found, "gravity-of-potential")
    assert text.startswith("outside the ranges only, with q in [-π, π]: gravity, row q[")
    assert text.endswith("; say `ranges`")
    assert [x.verdict for x in found if x.claim == "gravity-of-potential"] == [
        "passed",
        "inconclusive",
    ]


def test_a_test_of_what_fails_beyond_the_default_ranges_only_does_not_pass():
    """It is inconclusive, and the text is that of the finding."""
    found = [
        EquationsTarget(EquationsOfMotion(3, gravity=gravity, U=CART.U)).results(2, 0)
        for gravity in (CART.gravity, wrapped)
    ]
    right, wrong = (each["gravity-of-potential"] for each in found)
    assert right == ("passed", "")
    assert wrong.verdict == "inconclusive"
    assert "outside the ranges only, with q in [-π, π]: gravity, row q[" in wrong.text


def test_what_fails_within_ranges_that_are_given_fails():
    assert "failed" in {x.verdict for x in checked(wrapped, ranges=(-3.0, 3.0), states=5)}


def test_the_ranges_that_were_drawn_from_are_said_once():
    without, ranges = details(checked(), "reference")
    assert without.endswith("against would tell")
    assert ranges == f"{INSIDE}, and {WIDE} of {WIDE} states with q in [-π, π]: `ranges` for more"
    assert len(details(checked(ranges=(-1.0, 1.0)), "reference")) == 1
    assert len(details(checked(states=[(np.zeros(3), np.ones(3))]), "reference")) == 1


@pytest.mark.parametrize("raises", [False, True])
def test_states_where_a_function_has_no_value_are_left_out(raises: bool):
    def bounded(q):
        if np.abs(q).max() > 1.9:
            if raises:
                raise ValueError("out of the table")
            return np.full(3, np.nan)
        return CART.gravity(q)

    found = checked(bounded)
    assert {x.verdict for x in found if x.claim != "reference"} == {"passed"}
    assert f", and 1 of {WIDE} states" in details(found, "reference")[1]


def test_nothing_is_drawn_beyond_where_something_fails_inside():
    found = checked(lambda q: 2.0 * wrapped(q))
    assert "inconclusive" not in {x.verdict for x in found}
    assert details(found, "reference")[1] == f"{INSIDE}: `ranges` for more"


def test_coordinates_reach_to_a_half_turn_and_velocities_stay():
    seen: list[tuple[float, float]] = []

    def bias(q, v):
        seen.append((float(np.abs(q).max()), float(np.abs(v).max())))
        return CART.bias(q, v)

    for seed in range(4):
        check_functions(3, bias=bias, states=1, claims=["answers"], seed=seed)
    q, v = np.array(seen).T
    assert len(seen) == 4 * (1 + 2 * WIDE)  # each once as it has a value, once as it is asked
    assert 2.5 < q.max() <= np.pi
    assert v.max() <= 1.0


def test_rates_along_a_motion_stay_near_ranges_that_are_narrow():
    asked: list[float] = []

    def ratio(q):
        asked.append(abs(q[0]))
        return np.arccos(q[0] / 0.02)

    own = {"T": lambda q, v: ratio(q) * v[0] ** 2 / 2, "bias": lambda q, v: [-slope(q) * v[0] ** 2]}
    slope = lambda q: 0.5 / np.sqrt(0.02**2 - q[0] ** 2)  # noqa: E731
    ranges = [(-0.01, 0.01), (-1.0, 1.0)]
    (found,) = check_functions(1, **own, ranges=ranges, claims=["bias-power"], states=3)
    assert found.verdict == "passed"
    assert max(asked) < 0.02


def test_a_write_into_arguments_beyond_the_ranges_fails():
    """Claims about all calls of a run come last: they see those of the states beyond too."""

    def gravity(q):
        value = CART.gravity(q)
        q[np.abs(q) > 2.0] = 0.0
        return value

    found = checked(gravity, claims=["answers", "arguments-unchanged"])
    assert [x.claim for x in found if x.verdict == "failed"] == ["arguments-unchanged"]
