"""The claim that a formulation refuses only where it must."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from eomcheck.arithmetic.linear import column_scale
from eomcheck.checks.claim import CLAIMS, Case, Claim, claim
from eomcheck.checks.finding import Finding, Verdict
from eomcheck.errors import RefusedError
from eomcheck.model import Array, State
from eomcheck.tolerance import largest

HUGE = 1e140
"""Terms above this can overflow in a product of two."""


def independent_rcond(refusal: RefusedError, case: Case) -> float:
    """Return the reciprocal condition number of what was refused, computed in another way.

    A matrix is measured by its singular values; they and the 1-norm of the refusal agree to a
    factor of the order, which is taken off. Generalized speeds exist where a v and u(v) together
    determine v, so the matrix of that linear map stands for a divisor. An overflow counts as
    justified where terms are large enough for it.
    """
    if refusal.matrix is not None:
        return _rcond(refusal.matrix * column_scale(refusal.matrix))
    at = case.at
    if np.isnan(refusal.rcond):
        return 0.0 if max(largest(x) for x in (at.v, at.F, at.terms.M)) > HUGE else 1.0
    unit = np.eye(at.scene.n)
    speeds = at.scene.speeds_of
    u_of_v = np.array([at.call(speeds, at.parameters, at.prepared, at.q, e) for e in unit]).T
    # Velocities are measured by the energy in them, and so have no units of their own.
    energy = np.sqrt(np.diagonal(at.terms.M))
    u_of_v = u_of_v / energy
    u_of_v = u_of_v / np.abs(u_of_v).max(axis=1, keepdims=True)
    if at.terms.a is None:
        return _rcond(u_of_v)
    a = at.terms.a / energy
    return _rcond(np.vstack((a, np.abs(a).max() * u_of_v)))


def _rcond(matrix: Array) -> float:
    if not np.isfinite(matrix).all():
        return 0.0
    singular = np.linalg.svd(matrix, compute_uv=False)
    return float(singular[-1] / singular[0] / singular.size) if singular[0] > 0 else 0.0


@claim("refusals", "refused: rcond is below the threshold", "(7)-(23)", "refusal")
def refusals(case: Case) -> Iterator[Finding]:
    """Every refusal is justified by a reciprocal condition number computed independently."""
    assert case.claim is not None
    for formulation in case.formulations:
        try:
            case.at.acceleration(formulation)
        except RefusedError as refusal:
            rcond = independent_rcond(refusal, case)
            justified = rcond <= refusal.threshold
            yield Finding(
                case.claim.id,
                formulation.key,
                case.at.scene,
                State(case.at.q, case.at.v, case.at.t),
                rcond,
                refusal.threshold,
                "passed" if justified else "failed",
                "property-tested",
                str(refusal)
                if justified
                else f"{formulation.key}, {refusal.what}: refused in vain",
            )


MAY_REFUSE = 0.05
"""Largest share of ordinary states that some formulation may refuse."""

CLAIMS["coverage"] = Claim(
    "coverage",
    f"at least {1 - MAY_REFUSE:.0%} of ordinary states are solved by all formulations",
    "",
    "coverage",
    None,
)


ENOUGH = 20
"""Fewer states than this say nothing about a share of 5 %."""


def coverage(drawn: list[Finding], states: int) -> Finding:
    """Return the Finding on the share of drawn states that some formulation refused.

    Args:
        drawn: the Findings on those states, at least one.
        states: how many states were drawn.
    """
    refused = {id(finding.state.q): finding for finding in drawn if finding.claim == "refusals"}
    example = next(iter(refused.values()), drawn[0])
    share = len(refused) / states
    verdict: Verdict = "passed" if share <= MAY_REFUSE else "failed"
    return Finding(
        "coverage",
        "all",
        example.scene,
        example.state,
        share,
        MAY_REFUSE,
        verdict if states >= ENOUGH else "inconclusive",
        f"property-tested: {states} states",
        f"{states - len(refused)} of {states} ordinary states solved by all formulations",
    )
