"""Modified Lagrange method: Lagrange's equations in generalized speeds, Eqs. (19)-(21)."""

from __future__ import annotations

from eomcheck.formulations.em import project
from eomcheck.formulations.formulation import Formulation
from eomcheck.numbers.generic import generic
from eomcheck.numbers.linear import solve


@generic
def solution(M, F, W, rest):
    """Return u̇ (p,): Eq. (21) with the paper's w′ = W and rest = ẇ′u + ẋ′."""
    M_ML, F_ML = project(M, F, W, rest)
    return solve(M_ML, F_ML, "M_ML")


ML = Formulation(
    key="ml",
    name="Modified Lagrange",
    equations="(19)-(21)",
    order=(1, -1),
    level="velocity",
    multipliers=False,
    multipliers_in_paper=False,
    state="q, u",
    uses="speeds",
    partitioned=False,
    limits=(
        "Needs the scene's generalized speeds: for the snake cos α_i must not be 0 for i >= 2. "
        "N = 1 has no such wheel; no pose of 1 or 2 links is an exception."
    ),
    solution=solution,
)
