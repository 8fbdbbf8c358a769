"""What is not given is not judged: forces and dampers that only q̈ holds, noise at a jump."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from eomcheck.claims.finding import Finding
from eomcheck.testing import check_functions
from eomcheck.testing.claims_answers import NOISE

EVEN, QUADRATIC = ["acceleration-even"], ["acceleration-quadratic"]
M = np.array([[2.0, 0.3], [0.3, 1.0]])
GYRO = np.array([[0.0, 0.4], [0.2, 0.0]])


def inertia(q):
    return M + np.diag([0.0, 0.5 * np.sin(q[0])])


def bias(q, v):
    return 0.25 * np.cos(q[0]) * np.array([-(v[1] ** 2), 2.0 * v[0] * v[1]])


def qdd(q, v, factor: float = 1.0, damping: Any = 0.0, weight: float = 9.81):
    gravity = weight * np.array([np.sin(q[0]), np.sin(q[1])])
    return np.linalg.solve(inertia(q), -factor * bias(q, v) - gravity - damping)


def failed(found: list[Finding]) -> set[str]:
    return {one.claim for one in found if one.verdict == "failed"}


def damped(q, v):
    return qdd(q, v, damping=np.array([0.3 * v[0] - 0.1 * v[1], 0.0]))


def test_accelerations_with_a_linear_damper_are_not_judged_by_what_is_odd_in_v():
    found = check_functions(2, qdd=damped, states=5)
    assert not failed(found)
    (one,) = [x for x in found if x.claim == "acceleration-even" and x.verdict != "passed"]
    assert one.verdict == "inconclusive"
    assert one.detail.endswith("q[0], q[1]: odd in v, and linear: a damper? R or Q would tell")
    assert [x.verdict for x in found if x.claim == "acceleration-quadratic"] == ["passed"]


def test_a_damper_in_one_row_leaves_the_other_rows_judged():
    def one_row(q, v, more: float = 0.0):
        return qdd(q, v) - np.array([0.3 * v[0], more * v[1] ** 3])

    right = check_functions(2, qdd=one_row, claims=EVEN)
    assert [(x.subject, x.verdict) for x in right] == [
        ("q̈ odd in v", "inconclusive"),
        ("q̈", "passed"),
    ]
    assert "row q[0]: odd" in right[0].detail
    (wrong,) = [
        x
        for x in check_functions(2, qdd=lambda q, v: one_row(q, v, 1e-3), claims=EVEN)
        if x.verdict == "failed"
    ]
    assert "row q[1]: odd in v, and not linear: drag" in wrong.detail


def test_a_cubic_term_beside_a_damper_fails():
    def both(q, v):
        return damped(q, v) + 1e-3 * np.abs(v) ** 3

    assert failed(check_functions(2, qdd=both, states=5)) == {"acceleration-quadratic"}


@pytest.mark.parametrize("acceleration", [qdd, damped])
@pytest.mark.parametrize("given", [{"M": inertia}, {"M": inertia, "bias": bias}])
def test_forces_that_only_accelerations_hold_are_named_and_do_not_fail(
    acceleration: Callable, given: dict[str, Any]
):
    found = check_functions(2, qdd=acceleration, **given, states=4)
    assert not failed(found)
    would = "no force is given: gravity, U, R or Q would tell"
    told = [x for x in found if would in x.detail]
    assert [(x.claim, x.subject, x.verdict) for x in told] == [
        ("motion", "forces", "inconclusive"),
        ("power-balance", "Ṫ ~ v·forces", "skipped"),
    ]


def test_a_wrong_bias_in_accelerations_fails_where_no_force_is_given():
    for factor in (-1.0, 0.0, 0.5):
        found = check_functions(2, M=inertia, qdd=lambda q, v, f=factor: qdd(q, v, f), states=4)
        assert failed(found) == {"motion"}


def test_accelerations_without_forces_pass():
    found = check_functions(2, M=inertia, qdd=lambda q, v: qdd(q, v, weight=0.0), states=4)
    claims = {x.claim: x.verdict for x in found}
    assert (claims["motion"], claims["power-balance"]) == ("passed", "passed")


def test_forces_of_a_driven_constraint_are_not_judged_where_none_is_given():
    found = check_functions(
        2,
        M=inertia,
        qdd=qdd,
        a=lambda q: [[1.0, 0.0]],
        b=lambda t: [0.3],
        gamma=lambda q, v: [0.0],
        states=3,
    )
    (motion,) = [x for x in found if x.claim == "motion"]
    assert (motion.verdict, motion.detail[:20]) == ("skipped", "no force is given: g")


DOUBLE = ["double-precision"]


@pytest.mark.parametrize("potential", [lambda q: 1.0 - np.cos(q[0]), lambda q: (q[0] - 0.3) ** 2])
@pytest.mark.parametrize("distance", [0.0, 1e-8, 1e-6, 1e-4, 1e-3])
def test_plain_formulas_are_far_from_single_precision_also_where_they_vanish(
    potential: Callable, distance: float
):
    for middle in (0.0, 0.3):
        state = ([middle + distance], [0.1])
        (found,) = check_functions(1, U=potential, states=[state], claims=DOUBLE)
        assert found.verdict == "passed"
        assert found.observed <= 1e-4 * NOISE


@pytest.mark.parametrize("size", [1e-8, 1e-6, 1e-3])
@pytest.mark.parametrize("beside", [0.0, 1e-10, -1e-8])
def test_a_jump_is_not_called_single_precision(size: float, beside: float):
    def gravity(q):
        return [9.81 * np.sin(q[0]) + size * (q[0] > 0.3)]

    state = ([0.3 + beside], [0.1])
    (found,) = check_functions(1, gravity=gravity, states=[state], claims=DOUBLE)
    assert found.verdict == "inconclusive"
    assert (
        found.detail
        == "gravity, jumps or has a kink at this state: its noise is not measured there"
    )


def test_noise_that_is_everywhere_is_not_called_a_jump():
    def gravity(q):
        return [9.81 * np.sin(q[0]) + (1e6 + np.sin(1e3 * q[0])) - 1e6]

    def rough(q):
        return [9.81 * np.sin(q[0]) + 1e-7 * np.sin(1e10 * q[0])]

    for one, verdict in ((gravity, "passed"), (rough, "inconclusive")):
        (found,) = check_functions(1, gravity=one, states=[([0.3], [0.1])], claims=DOUBLE)
        assert found.verdict == verdict
        assert "jumps" not in found.detail
