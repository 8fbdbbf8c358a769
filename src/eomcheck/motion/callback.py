"""Right-hand sides as C callbacks: what a compiled integrator calls, with no Python in between.

A callback gets three addresses: of the derivatives, of the state y, and of the arguments. The
arguments hold the address of a `Table`, a block of integers that says where everything else is.
State vectors (paper, Eqs. (6), (8), (14), (19); `Formulation.state`):

- "q, v, μ": velocities, and the integrals μ of the multipliers, μ̇ = λ
- "q, v": velocities
- "q, v2": the independent velocities of the partition
- "q, u": generalized speeds
- "q, x": quasi-velocities of a chain
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numba import carray, types  # pyright: ignore[reportPrivateImportUsage]
from numba.extending import intrinsic, overload, register_jitable

from eomcheck.arithmetic.float64 import angles, compiled_callback
from eomcheck.formulations import Formulation, Partition
from eomcheck.formulations.em import velocity_of_independent
from eomcheck.model import Scene
from eomcheck.motion.right_hand_side import (
    rates_from_bodies,
    rates_from_chain,
    rates_from_speeds,
    rates_from_terms,
)

SIGNATURE = types.void(
    types.CPointer(types.float64),
    types.float64,
    types.CPointer(types.float64),
    types.CPointer(types.float64),
)

CALLS, FAILED = 0, 1
"""Places in the block of counts: right-hand sides evaluated, those that were not finite."""

HEADER = 9
"""Integers of a `Table` before those of the parameters: addresses of the counts and of the time of
the first failure, n, number of speeds, size of the state, address and size of each half of the
partition."""


class Table:
    """What a callback reads, as a block of integers in memory that stays where it is.

    Args:
        parameters: a NamedTuple of arrays of doubles, any of them None.
        partition: the partition that El and Em use.
        n: number of coordinates.
        speeds: number of entries of v, v2, u or x in the state.
        size: number of entries of the whole state.
    """

    def __init__(self, parameters: Any, partition: Partition, n: int, speeds: int, size: int):
        self.counts = np.zeros(2, np.int64)
        self.failure_time = np.full(1, np.nan)
        halves = [np.ascontiguousarray(half, np.int64) for half in partition]
        fields = [None if x is None else np.ascontiguousarray(x, np.float64) for x in parameters]
        entries = [self.counts.ctypes.data, self.failure_time.ctypes.data]
        entries += [n, speeds, size]
        for half in halves:
            entries += [half.ctypes.data, half.size]
        for field in fields:
            entries += [] if field is None else [field.ctypes.data, *field.shape]
        self._block = np.array(entries, np.int64)
        self._alive = halves, fields  # the block only holds their addresses
        self.arguments = np.array([self._block.ctypes.data], np.int64).view(np.float64)

    def reset(self) -> None:
        """Set all counts to zero."""
        self.counts[:] = 0
        self.failure_time[:] = np.nan


def shapes_of(parameters: Any) -> str:
    """Return the number of dimensions of each field, "-" for None, as one word."""
    return "".join("-" if x is None else str(np.ndim(x)) for x in parameters)


def _pointer_to(target: Any) -> Any:
    """Return the compiled function that turns an address, an integer, into a pointer."""
    pointer = types.CPointer(target)

    def at(typingctx, address):
        def codegen(context, builder, signature, arguments):
            return builder.inttoptr(arguments[0], context.get_value_type(pointer))

        return pointer(address), codegen

    return intrinsic(at)


_doubles_at = _pointer_to(types.float64)
_integers_at = _pointer_to(types.int64)


def parameters_at(block, kind, shapes):
    """Return the record `kind` whose arrays the integers of `block` point to; compiled only."""
    raise NotImplementedError


@overload(parameters_at, prefer_literal=True)
def _parameters_at(block, kind, shapes):
    if not isinstance(shapes, types.StringLiteral):
        return None
    fields, place = [], HEADER
    for dimensions in shapes.literal_value:
        if dimensions == "-":
            fields.append("None")
            continue
        count = int(dimensions)
        sizes = "".join(f"block[{place + 1 + i}], " for i in range(count))
        fields.append(f"carray(doubles_at(block[{place}]), ({sizes}))")
        place += 1 + count
    source = f"def record(block, kind, shapes):\n    return kind({', '.join(fields)})\n"
    names: dict[str, Any] = {"carray": carray, "doubles_at": _doubles_at}
    exec(source, names)
    return names["record"]


def callback(scene: Scene, formulation: Formulation, parameters: Any) -> Any:
    """Return the compiled callback, a numba `CFunc`, for scenes of this kind and structure."""
    return _callback(type(scene), formulation, type(parameters), shapes_of(parameters))


@cache
def _callback(scene: type[Scene], formulation: Formulation, kind: type, shapes: str) -> Any:
    compose = _COMPOSERS[formulation.uses, formulation.state]
    return compiled_callback(compose(scene, formulation.solution, kind, shapes), SIGNATURE)


@register_jitable
def _block_at(arguments):
    address = carray(arguments, (1,)).view(np.int64)[0]
    # Nobody asks for the size of the block: every reader knows its places.
    return carray(_integers_at(address), (HEADER,))


@register_jitable
def _state_at(block, y):
    """Return (q, speeds)."""
    n, speeds = block[2], block[3]
    state = carray(y, (n + speeds,))
    return state[:n], state[n:]


@register_jitable
def _partition_at(block):
    first = carray(_integers_at(block[5]), (block[6],))
    return Partition(first, carray(_integers_at(block[7]), (block[8],)))


@register_jitable
def _store(block, t, ydot, qdot, rate):
    """Write the derivatives of q and of the speeds, and count; return where integrals go."""
    n, speeds, size = block[2], block[3], block[4]
    out = carray(ydot, (size,))
    counts = carray(_integers_at(block[0]), (2,))
    counts[CALLS] += 1
    total = 0.0  # stays 0 unless something is not finite
    for i in range(n):
        out[i] = qdot[i]
        total += 0.0 * qdot[i]
    for i in range(speeds):
        out[n + i] = rate[i]
        total += 0.0 * rate[i]
    if total != 0.0:
        if counts[FAILED] == 0:
            carray(_doubles_at(block[1]), (1,))[0] = t
        counts[FAILED] += 1
    return out[n + speeds :]


@register_jitable
def _integrate(integrals, multipliers):
    """Write λ as the rates of its integrals, if the state has any."""
    if multipliers is not None:
        for i in range(integrals.size):
            integrals[i] = multipliers[i]


def _with_velocities(scene: type[Scene], solution: Callable, kind: type, shapes: str) -> Callable:
    terms = scene.terms
    start, stop = scene.angle_coordinates.start, scene.angle_coordinates.stop

    def rate(ydot, t, y, arguments):
        block = _block_at(arguments)
        q, v = _state_at(block, y)
        parameters, prepared = parameters_at(block, kind, shapes), angles(q[start:stop])
        partition = _partition_at(block)
        qdot, vdot, lambda_ = rates_from_terms(
            terms, solution, parameters, prepared, q, v, partition
        )
        _integrate(_store(block, t, ydot, qdot, vdot), lambda_)

    return rate


def _with_independent(scene: type[Scene], solution: Callable, kind: type, shapes: str) -> Callable:
    terms, constraints = scene.terms, scene.constraints
    start, stop = scene.angle_coordinates.start, scene.angle_coordinates.stop

    def rate(ydot, t, y, arguments):
        block = _block_at(arguments)
        q, v2 = _state_at(block, y)
        parameters, prepared = parameters_at(block, kind, shapes), angles(q[start:stop])
        partition = _partition_at(block)
        a, b = constraints(parameters, prepared, q)
        v = velocity_of_independent(a, b, v2, partition)
        qdot, vdot, _ = rates_from_terms(terms, solution, parameters, prepared, q, v, partition)
        _store(block, t, ydot, qdot, vdot[partition.independent])

    return rate


def _with_speeds(scene: type[Scene], solution: Callable, kind: type, shapes: str) -> Callable:
    terms, kinematics, speeds = scene.terms, scene.kinematics, scene.speeds
    start, stop = scene.angle_coordinates.start, scene.angle_coordinates.stop

    def rate(ydot, t, y, arguments):
        block = _block_at(arguments)
        q, u = _state_at(block, y)
        parameters, prepared = parameters_at(block, kind, shapes), angles(q[start:stop])
        qdot, udot = rates_from_speeds(
            terms, kinematics, speeds, solution, parameters, prepared, q, u
        )
        _store(block, t, ydot, qdot, udot)

    return rate


def _with_bodies(scene: type[Scene], solution: Callable, kind: type, shapes: str) -> Callable:
    kinematics, speeds, qdot, bodies = scene.kinematics, scene.speeds, scene.qdot, scene.bodies
    start, stop = scene.angle_coordinates.start, scene.angle_coordinates.stop

    def rate(ydot, t, y, arguments):
        block = _block_at(arguments)
        q, u = _state_at(block, y)
        parameters, prepared = parameters_at(block, kind, shapes), angles(q[start:stop])
        v, udot = rates_from_bodies(
            kinematics, speeds, qdot, bodies, solution, parameters, prepared, q, u
        )
        _store(block, t, ydot, v, udot)

    return rate


def _with_chain(scene: type[Scene], solution: Callable, kind: type, shapes: str) -> Callable:
    chain, chain_velocity = scene.chain, scene.chain_velocity
    start, stop = scene.angle_coordinates.start, scene.angle_coordinates.stop

    def rate(ydot, t, y, arguments):
        block = _block_at(arguments)
        q, x = _state_at(block, y)
        parameters, prepared = parameters_at(block, kind, shapes), angles(q[start:stop])
        qdot, xdot = rates_from_chain(chain, chain_velocity, solution, parameters, prepared, q, x)
        _store(block, t, ydot, qdot, xdot)

    return rate


_COMPOSERS = {
    ("terms", "q, v, μ"): _with_velocities,
    ("terms", "q, v"): _with_velocities,
    ("terms", "q, v2"): _with_independent,
    ("speeds", "q, u"): _with_speeds,
    ("bodies", "q, u"): _with_bodies,
    ("chain", "q, x"): _with_chain,
}
