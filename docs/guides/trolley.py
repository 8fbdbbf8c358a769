"""A trolley on a rail with a hanging load, derived by hand. q = (x, θ), θ from hanging down."""

import numpy as np

m_trolley, m_load, length, g = 5.0, 2.0, 1.5, 9.81


def M(q):
    coupling = m_load * length * np.cos(q[1])
    return np.array([[m_trolley + m_load, coupling], [coupling, m_load * length**2]])


def bias(q, v):
    return np.array([m_load * length * np.sin(q[1]) * v[1] ** 2, 0.0])


def gravity(q):
    return np.array([0.0, m_load * g * length * np.sin(q[1])])


def qdd(q, v):
    return np.linalg.solve(M(q), -bias(q, v) - gravity(q))


def T(q, v):
    load = np.array([v[0] + length * np.cos(q[1]) * v[1], length * np.sin(q[1]) * v[1]])
    return 0.5 * m_trolley * v[0] ** 2 + 0.5 * m_load * load @ load


def U(q):
    return -m_load * g * length * np.cos(q[1])
