"""One right-hand side, compiled end to end: sines and cosines, terms, formulation, solve.

`right_hand_side(scene, formulation)` composes the generic functions of both into one compiled
function of (parameters, q, speeds, partition) that returns (q̇, rate of the speeds). The speeds are
v for the formulations that use Lagrange's terms, u for ML and Kane, x for a chain. A matrix that is
singular gives NaN: compiled code must not raise.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

from eomcheck.arithmetic.float64 import angles, compiled
from eomcheck.arithmetic.generic import generic
from eomcheck.formulations import Formulation
from eomcheck.model import Scene
from eomcheck.quantities import net_force, velocity


@generic
def rates_from_terms(terms, solution, parameters, prepared, q, v, partition):
    """Return (q̇, v̇, λ or None) of a formulation that uses Lagrange's terms."""
    M, Q, B, a, gamma, _ = terms(parameters, prepared, q, v)
    vdot, multipliers = solution(M, net_force(Q, B), a, gamma, v, partition)
    return v, vdot, multipliers


@generic
def rates_from_speeds(terms, kinematics, speeds, solution, parameters, prepared, q, u):
    """Return (q̇, u̇) of a formulation that uses Lagrange's terms and generalized speeds."""
    W, rest, offset = speeds(parameters, prepared, kinematics(parameters, prepared, q, u))
    v = velocity(u, W, offset)
    now = terms(parameters, prepared, q, v)
    return v, solution(now.M, net_force(now.Q, now.B), W, rest)


@generic
def rates_from_bodies(kinematics, speeds, qdot, bodies, solution, parameters, prepared, q, u):
    """Return (q̇, u̇) of a formulation that sums over the bodies; qdot may be None."""
    shared = kinematics(parameters, prepared, q, u)
    if qdot is None:
        W, _, offset = speeds(parameters, prepared, shared)
        v = velocity(u, W, offset)
    else:
        v = qdot(parameters, prepared, shared)
    vp, wp, rv, rw, mass, inertia, gyroscopic, force = bodies(parameters, prepared, shared)
    udot = solution(vp, wp, rv, rw, mass, inertia, gyroscopic, force)
    return v, udot


@generic
def rates_from_chain(chain, chain_velocity, solution, parameters, prepared, q, x):
    """Return (q̇, ẋ) of a formulation that uses the bodies as a chain."""
    mass, force, before, after, rest = chain(parameters, prepared, q, x)
    xdot, _ = solution(mass, force, before, after, rest)
    return chain_velocity(parameters, prepared, q, x), xdot


def right_hand_side(scene: Scene, formulation: Formulation) -> Callable:
    """Return the compiled right-hand side of `formulation` for scenes of this kind."""
    return _right_hand_side(type(scene), formulation)


@cache
def _right_hand_side(scene: type[Scene], formulation: Formulation) -> Callable:
    return compiled(_COMPOSERS[formulation.uses](scene, formulation.solution))


def _from_terms(scene: type[Scene], solution: Callable) -> Callable:
    terms = scene.terms
    start, stop = scene.angle_coordinates.start, scene.angle_coordinates.stop

    def rate(parameters, q, v, partition):
        prepared = angles(q[start:stop])
        qdot, vdot, _ = rates_from_terms(terms, solution, parameters, prepared, q, v, partition)
        return qdot, vdot

    return rate


def _from_speeds(scene: type[Scene], solution: Callable) -> Callable:
    terms, kinematics, speeds = scene.terms, scene.kinematics, scene.speeds
    start, stop = scene.angle_coordinates.start, scene.angle_coordinates.stop

    def rate(parameters, q, u, partition):
        prepared = angles(q[start:stop])
        return rates_from_speeds(terms, kinematics, speeds, solution, parameters, prepared, q, u)

    return rate


def _from_bodies(scene: type[Scene], solution: Callable) -> Callable:
    kinematics, speeds, qdot, bodies = scene.kinematics, scene.speeds, scene.qdot, scene.bodies
    start, stop = scene.angle_coordinates.start, scene.angle_coordinates.stop

    def rate(parameters, q, u, partition):
        prepared = angles(q[start:stop])
        return rates_from_bodies(
            kinematics, speeds, qdot, bodies, solution, parameters, prepared, q, u
        )

    return rate


def _from_chain(scene: type[Scene], solution: Callable) -> Callable:
    chain, chain_velocity = scene.chain, scene.chain_velocity
    start, stop = scene.angle_coordinates.start, scene.angle_coordinates.stop

    def rate(parameters, q, x, partition):
        prepared = angles(q[start:stop])
        return rates_from_chain(chain, chain_velocity, solution, parameters, prepared, q, x)

    return rate


_COMPOSERS = {
    "terms": _from_terms,
    "speeds": _from_speeds,
    "bodies": _from_bodies,
    "chain": _from_chain,
}
