"""Greenwood's method on M + aᵀ a: the motion is the same, and M itself may be singular."""

import numpy as np

from eomcheck.formulations.formulation import Formulation
from eomcheck.formulations.gw import system
from eomcheck.numbers.generic import generic
from eomcheck.numbers.linear import solve


@generic
def solution(M, F, a, gamma, v, partition):
    if a is None:
        return solve(M, F, "M"), None
    n, r = F.size, gamma.size
    columns = np.zeros((n, r + 1), M.dtype)
    columns[:, :r], columns[:, r] = a.T, F - a.T @ gamma
    shifted = M + np.ascontiguousarray(a.T) @ a
    mobility = a @ solve(shifted, columns, "M + aT a")
    lambda_ = -solve(np.ascontiguousarray(mobility[:, :r]), mobility[:, r] + gamma, "a S^-1 aT")
    _, force = system(M, F - a.T @ gamma, a, lambda_)
    return solve(shifted, force, "M + aT a"), lambda_


SHIFTED = Formulation(
    key="shifted",
    name="Shifted",
    equations="",
    order=(1, 0),
    level="acceleration",
    multipliers=True,
    multipliers_in_paper=None,
    state="q, v",
    uses="terms",
    partitioned=False,
    limits="Adds quantities in different units: in kilograms and metres, or rounding decides.",
    solution=solution,
)
