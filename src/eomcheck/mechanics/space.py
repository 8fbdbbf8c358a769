"""Moments of inertia in space."""

from __future__ import annotations

import numpy as np

from eomcheck.numbers.generic import generic


@generic
def diagonal(moments):
    """Return moments of inertia (n_b, 3) about principal axes as matrices (n_b, 3, 3)."""
    principal = [[[x, 0, 0], [0, y, 0], [0, 0, z]] for x, y, z in moments]
    return np.array(principal, moments.dtype)
