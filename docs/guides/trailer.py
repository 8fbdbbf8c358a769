"""A two-wheeled trailer, its hitch at (x, y), whose axle does not slip sideways. q = [θ, x, y]."""

from typing import Any, NamedTuple

import numpy as np

from eomcheck.mechanics.assembled import Assembled, Jacobians
from eomcheck.numbers.generic import generic


class Parameters(NamedTuple):
    mass: Any  # (1,), kg
    inertia: Any  # about the centre of mass (1, 1, 1), kg m²
    back: Any  # from the hitch back to the centre of mass, and to the axle (2,), m


@generic
def prepare(arithmetic, parameters, q, t):
    return arithmetic.angles(q[:1])  # whatever is not rational: cos θ and sin θ


@generic
def jacobians(parameters, angle, q, v):  # V = (ẋ, ẏ) - back θ̇ (-sin θ, cos θ), as J v
    back, cos, sin = parameters.back[0], angle.cos[0], angle.sin[0]
    linear, angular = np.zeros((1, 2, 3), v.dtype), np.zeros((1, 1, 3), v.dtype)
    rest, angular_rest = np.zeros((1, 2), v.dtype), np.zeros((1, 1), v.dtype)
    linear[0, 0, 1] = linear[0, 1, 2] = angular[0, 0, 0] = 1
    linear[0, 0, 0], linear[0, 1, 0] = back * sin, -back * cos
    rest[0, 0], rest[0, 1] = back * cos * v[0] * v[0], back * sin * v[0] * v[0]
    return Jacobians(linear, angular, rest, angular_rest, None)


@generic
def constraints(parameters, angle, q):  # a v = 0: the axle's velocity along the axle
    a = np.zeros((1, 3), q.dtype)
    a[0, 0], a[0, 1], a[0, 2] = -parameters.back[1], -angle.sin[0], angle.cos[0]
    return a, None


@generic
def drift(parameters, angle, q, v):  # gamma = ȧ v
    gamma = np.zeros(1, v.dtype)
    gamma[0] = -v[0] * (v[1] * angle.cos[0] + v[2] * angle.sin[0])
    return gamma


@generic
def velocities(parameters, angle, q, v):  # the second derivation, nothing differentiated
    V, omega = np.zeros((1, 2), v.dtype), np.zeros((1, 1), v.dtype)
    V[0, 0] = v[1] + parameters.back[0] * v[0] * angle.sin[0]
    V[0, 1] = v[2] - parameters.back[0] * v[0] * angle.cos[0]
    omega[0, 0] = v[0]
    return V, omega


@generic
def constraint(parameters, angle, q, v):  # the second derivation of a v
    c = np.zeros(1, v.dtype)
    c[0] = v[2] * angle.cos[0] - v[1] * angle.sin[0] - parameters.back[1] * v[0]
    return c


class Trailer(Assembled, functions=globals()):
    """A trailer of 300 kg on two wheels."""

    key, conserves_energy, angle_coordinates = "trailer", True, slice(0, 1)
    coordinate_names, constraint_names = ("θ", "x", "y"), ("axle",)

    def parameters(self, arithmetic):
        values = np.array([300.0]), np.array([[[200.0]]]), np.array([2.5, 2.8])
        return Parameters(*map(arithmetic.numbers, values))

    def initial_state(self):
        return np.zeros(3), np.array([0.5, 2.0, 1.4])  # turning: ẏ = 2.8 m θ̇
