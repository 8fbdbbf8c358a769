"""A pendulum in Cartesian coordinates q = [x, y]: a holonomic constraint, and speeds of its own."""

from typing import Any, NamedTuple

import numpy as np

from eomcheck.mechanics.parameters import Parametric, parameter
from eomcheck.mechanics.records import Bodies, Jacobians, Range, Speeds
from eomcheck.mechanics.sketch import (
    Body,
    ConstraintMark,
    JointMark,
    Sketch,
    Trail,
    fixed_axes,
    position_dimensions,
)


def jacobians(parameters, prepared, q, v):  # the bob moves with v and does not turn
    linear, angular = [[[1, 0], [0, 1]]], [[[0, 0]]]
    rest, angular_rest = [[0, 0]], [[0]]
    return Jacobians(*(np.array(x, v.dtype) for x in (linear, angular, rest, angular_rest)))


def constraints(parameters, prepared, q):  # a: either entry can be 0
    return np.array([[q[0], q[1]]], q.dtype), None


def drift(parameters, prepared, q, v):
    return np.array([v[0] * v[0] + v[1] * v[1]], v.dtype)


def forces(parameters, prepared, q, v):
    return np.array([0, -parameters.mass[0] * parameters.gravity[0]], v.dtype)


def velocities(parameters, prepared, q, v):  # the second derivation
    return v.reshape(1, 2), np.zeros((1, 1), v.dtype)


def potential(parameters, prepared, q):
    return parameters.mass[0] * parameters.gravity[0] * q[1]


def constraint(parameters, prepared, q, v):
    return np.array([q[0] * v[0] + q[1] * v[1]], v.dtype)


def position_residual(parameters, prepared, q):  # Φ: constraint is its rate
    gap = q[0] * q[0] + q[1] * q[1] - parameters.length[0] * parameters.length[0]
    return np.array([gap / 2], q.dtype)


class Turning(NamedTuple):  # what speeds and bodies share: arrays
    q: Any
    u: Any


def kinematics(parameters, prepared, q, u):
    return Turning(q, u)


def speeds(parameters, prepared, turning):  # v = W ω with W = (-y, x)
    (x, y), omega = turning.q, turning.u[0]
    W, rest = [[-y], [x]], [-omega * omega * x, -omega * omega * y]
    return Speeds(np.array(W, turning.q.dtype), np.array(rest, turning.q.dtype), None)


def bodies(parameters, prepared, turning):
    W, rest, _ = speeds(parameters, prepared, turning)
    still, dtype = np.zeros((1, 1), W.dtype), W.dtype
    force = np.array([-parameters.mass[0] * parameters.gravity[0] * turning.q[0]], dtype)
    inertia = parameters.inertia.reshape(1, 1, 1)
    partial, remainder = W.reshape(1, 2, 1), rest.reshape(1, 2)
    turned = still.reshape(1, 1, 1)
    return Bodies(partial, turned, remainder, still, parameters.mass, inertia, None, force)


def speeds_of(parameters, prepared, q, v):  # ω of any v
    return np.array([(q[0] * v[1] - q[1] * v[0]) / (q[0] * q[0] + q[1] * q[1])], v.dtype)


class Pendulum(Parametric, functions=globals()):
    """A bob on a rod without mass, let go beside its pin."""

    mass: Any = parameter("of the bob", "kg", "> 0", (0.1, 10.0), (1,), default=(1.0,))
    inertia: Any = parameter("of the bob, which does not turn", "kg m²", shape=(1,), default=(0.0,))
    length: Any = parameter("of the rod", "m", "> 0", (0.5, 2.0), default=1.0)
    gravity: Any = parameter("g, along -y", "m/s²", ">= 0", (0.0, 20.0), default=9.81)

    key, conserves_energy = "pendulum", True
    named_coordinates, named_constraints = ("x", "y"), ("rod",)
    coordinate_sample_ranges = Range(-2.0, 2.0), Range(-2.0, 2.0)
    holonomic = slice(None)  # every row, which is the default
    display_pose = 0.6, -0.9  # the pose q of its picture

    def initial_state(self):
        return np.array([float(self.length), 0.0]), np.zeros(2)

    def sketch(self, q, t=0.0):  # what a picture is made of
        rod = Body((np.zeros(2), q), "rod"), ConstraintMark("length", q / 2, rows=(0,))
        return Sketch(
            (
                *fixed_axes(0.4),
                *rod,
                JointMark(np.zeros(2), ground=True),
                *position_dimensions(*q),
                Trail(q),
            )
        )
