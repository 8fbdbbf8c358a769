"""Bounds of claims about functions, against errors that are numbers."""

from __future__ import annotations

import numpy as np
import pytest

from eomcheck.testing import check_functions

STATES = [([0.3, 0.7], [0.5, -0.8])]


def inertia(q):
    coupled = 0.7 * np.cos(q[1])
    return np.array([[3.0, coupled], [coupled, 1.1]])


def energy(q, v):
    return v @ inertia(q) @ v / 2.0


@pytest.mark.parametrize(("error", "verdict"), [(0.0, "passed"), (3e-13, "failed")])
def test_a_mass_matrix_and_a_kinetic_energy_may_differ_by_rounding_only(error, verdict):
    def wrong(q):
        return inertia(q) + np.diag([0.0, error])

    (found,) = check_functions(2, M=wrong, T=energy, states=STATES, claims=["kinetic-energy"])
    assert found.verdict == verdict, str(found)
