"""A two-wheeled trailer, its hitch at (x, y), whose axle does not slip sideways. q = [θ, x, y]."""

from typing import Any

import numpy as np

from eomcheck.mechanics.parameters import Parametric, parameter
from eomcheck.mechanics.records import Jacobians


def jacobians(parameters, angle, q, v):  # V = (ẋ, ẏ) - back θ̇ (-sin θ, cos θ), as J v
    back, cos, sin = parameters.back[0], angle.cos[0], angle.sin[0]
    linear = [[[back * sin, 1, 0], [-back * cos, 0, 1]]]
    rest = [[back * cos * v[0] * v[0], back * sin * v[0] * v[0]]]
    angular, angular_rest = [[[1, 0, 0]]], [[0]]
    return Jacobians(*(np.array(x, v.dtype) for x in (linear, angular, rest, angular_rest)))


def constraints(parameters, angle, q):  # a v = 0: the axle's velocity along the axle
    return np.array([[-parameters.axle[0], -angle.sin[0], angle.cos[0]]], q.dtype), None


def drift(parameters, angle, q, v):  # gamma = ȧ v
    return np.array([-v[0] * (v[1] * angle.cos[0] + v[2] * angle.sin[0])], v.dtype)


def velocities(parameters, angle, q, v):  # the second derivation, nothing differentiated
    swing = parameters.back[0] * v[0]
    V = np.array([[v[1] + swing * angle.sin[0], v[2] - swing * angle.cos[0]]], v.dtype)
    return V, v[:1].reshape(1, 1)


def constraint(parameters, angle, q, v):  # the second derivation of a v
    slip = v[2] * angle.cos[0] - v[1] * angle.sin[0] - parameters.axle[0] * v[0]
    return np.array([slip], v.dtype)


class Trailer(Parametric, functions=globals()):
    """A trailer on two wheels."""

    mass: Any = parameter("m", "kg", "> 0", (100.0, 1000.0), (1,), default=(300.0,))
    inertia: Any = parameter("central", "kg m²", ">= 0", (50.0, 500.0), (1,), default=(200.0,))
    back: Any = parameter("from the hitch back to the centre of mass", "m", default=2.5)
    axle: Any = parameter("from the hitch back to the axle", "m", default=2.8)

    key, conserves_energy, angle_coordinates = "trailer", True, slice(0, 1)
    named_coordinates, named_constraints = ("θ", "x", "y"), ("axle",)

    def initial_state(self):
        return np.zeros(3), np.array([0.5, 2.0, 1.4])  # turning: ẏ = 2.8 m θ̇
