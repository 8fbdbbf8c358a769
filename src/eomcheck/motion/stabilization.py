"""Constraint stabilization: Baumgarte's feedback, and projection of the velocity.

A formulation whose constraints enter at acceleration level only enforces that the rate of
c = a v + b is 0, so that the errors of the steps accumulate in c. Two remedies, both off by
default:

- feedback (Baumgarte 1972): ċ = -rate c in the place of ċ = 0, so that gamma becomes gamma + rate c
  and c decays with exp(-rate t);
- projection (Eich 1993; Ascher, Chin and Reich 1994): at intervals v is changed by the δv that
  is smallest in the norm of the mass matrix among those that bring c to 0,

      M δv = aᵀ λ,  a δv = -c.

  This is the formulation's own system at F = 0 and gamma = c: no other matrix is solved. c is
  linear in v, so that one such change is enough.

In a chain c are the gaps of the joints, A_k x_{k-1} + C_k x_k, and the same holds for x. A gap is a
vector in the plane, along axes that turn; as a vector it decays with exp(-rate t).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from eomcheck.errors import InputError, RefusedError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.formulations import Formulation, Partition
from eomcheck.formulations.banded import joint_gaps
from eomcheck.mechanics.scene import Scene
from eomcheck.motion.integrators import Steps
from eomcheck.numbers.generic import Array, generic


@generic
def drift_with_feedback(a, gamma, b, v, rate):
    """Return gamma + rate (a v + b) (r,), rate in 1/s; gamma itself without a rate."""
    if rate is None:
        return gamma
    if b is None:
        return gamma + rate * (a @ v)
    return gamma + rate * (a @ v + b)


@generic
def joint_drift_with_feedback(before, after, rest, x, rate):
    """Return d_k + rate (A_k x_{k-1} + C_k x_k) (n_b-1, 2), rate in 1/s; d without a rate."""
    if rate is None:
        return rest
    return rest + rate * joint_gaps(before, after, x)


def feed_back(at: Quantities, formulation: Formulation, rate: Any) -> None:
    """Add feedback at this rate, 1/s, to the constraint drift of `at`, in any scalar type."""
    if formulation.uses == "chain":
        before, after, rest = at.chain.before, at.chain.after, at.chain.rest
        at.chain = at.chain._replace(
            rest=joint_drift_with_feedback(before, after, rest, at.x, rate)
        )
    else:
        a, gamma, b = at.terms.a, at.terms.gamma, at.terms.b
        at.terms = at.terms._replace(gamma=drift_with_feedback(a, gamma, b, at.v, rate))


def is_number(value: Any) -> bool:
    """Return whether a value is a real number, and no truth value."""
    return isinstance(value, int | float | np.floating) and not isinstance(value, bool)


def check_stabilization(
    scene: Scene, formulation: Formulation, baumgarte: float | None, projection: float | None
) -> None:
    """Check that both options, if not None, are positive numbers and apply.

    Raises:
        InputError: they are not, or do not: there is no constraint, or the formulation cannot leave
            the constraints at velocity level.
    """
    for name, value, unit in (("baumgarte", baumgarte, "1/s"), ("projection", projection, "s")):
        if value is None:
            continue
        if not (is_number(value) and 0 < value < math.inf):
            raise InputError(f"{name} = {value!r}, expected a positive number, {unit}")
        if formulation.level == "velocity":
            raise InputError(
                f"{name} = {value!r} does not apply to {formulation.key}, whose velocities satisfy "
                "the constraints by themselves"
            )
        if scene.r == 0:
            raise InputError(f"{name} = {value!r} does not apply: {scene.name} has no constraint")


def project_speeds(
    scene: Scene, formulation: Formulation, partition: Partition, t: float, q: Array, speeds: Array
) -> Array:
    """Return the nearest speeds, v (n,) or x (s,), that satisfy the constraints at q.

    Nearest in the norm of the mass matrix.

    Raises:
        RefusedError: a matrix is singular to working precision.
    """
    if formulation.uses == "chain":
        at = Evaluation(scene, q, np.zeros(scene.n), t)
        at.x = speeds
        mass, _, before, after, _ = at.chain
        gaps = at.call(joint_gaps, before, after, speeds)
        return speeds + formulation.solution(mass, None, before, after, gaps)[0]
    M, _, _, a, _, b = Evaluation(scene, q, speeds, t).terms
    zero = np.zeros(scene.n)
    c = drift_with_feedback(a, np.zeros(scene.r), b, speeds, 1.0)
    return speeds + formulation.solution(M, zero, a, c, zero, partition)[0]


Piece = Callable[[float, float, Array, float, "Array | None", int], Steps]
"""Integrator of one piece: (start, end, state, first step, output times, most steps) -> `Steps`."""


def integrate_in_pieces(
    piece: Piece,
    project: Callable[[float, Array], Array],
    y: Array,
    t_end: float,
    interval: float,
    first_step: float,
    output_times: Array | None,
    max_steps: int,
) -> Steps:
    """Integrate from 0 to `t_end` in pieces of `interval`, s, and project after each.

    The state at the end of a piece is the projected one. The first step of a piece is 0.9 mean
    steps of the previous piece; a multistep method restarts with order 1.
    """
    count = max(1, math.ceil(t_end / interval * (1 - 1e-12)))
    ends = [min(k * interval, t_end) for k in range(1, count)] + [t_end]
    t, steps = 0.0, 0
    found_t, found_y = [], []
    success, message = True, ""
    for end in ends:
        piece_times = None
        if output_times is not None:
            inside = (output_times > t if t > 0 else output_times >= 0) & (output_times <= end)
            piece_times = np.union1d(output_times[inside], [end])
        result = piece(t, end, y, first_step, piece_times, max_steps and max_steps - steps)
        steps += result.steps
        times, states = result.t, result.y
        success, message = result.success, result.message
        if success and np.isfinite(states[-1]).all():
            try:
                y = project(end, states[-1])
            except RefusedError as refusal:
                success, message = False, f"the velocity cannot be projected: {refusal}"
            states[-1] = y
        keep = np.isin(times, output_times) if output_times is not None else times > t
        if t == 0.0 and output_times is None:
            keep[0] = True
        found_t.append(times[keep])
        found_y.append(states[keep])
        if not success:
            break
        if max_steps and steps >= max_steps and end < t_end:
            success, message = False, f"{max_steps} steps were not enough"
            break
        # CyRK refuses a first step that, rounded, is longer than the piece.
        first_step = 0.9 * min((end - t) / max(result.steps, 1), t_end - end)
        t = end
    return Steps(np.concatenate(found_t), np.concatenate(found_y), steps, success, message)
