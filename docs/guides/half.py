"""A cart with a pendulum, as plain NumPy functions; half of its bias is missing."""

import numpy as np


def M(q):
    return np.array([[3.0, np.cos(q[1])], [np.cos(q[1]), 1.0]])


def bias(q, v):
    return np.array([-np.sin(q[1]) * v[1] ** 2 / 2, 0.0])


def T(q, v):
    return 0.5 * (2.0 * v[0] ** 2 + (v[0] + np.cos(q[1]) * v[1]) ** 2 + (np.sin(q[1]) * v[1]) ** 2)
