"""Quantities of a scene and its formulations at one point, in any scalar type, each on first use.

A quantity is a result of a function of the scene (terms, speeds, bodies) or of a formulation (the
acceleration). `Quantities` calls the scene's functions and passes their results to the formulation.
It is the same code for float64, balls, elements of a finite field, degree bounds and counters.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from functools import cached_property, partial, wraps
from typing import Any, NamedTuple, TypeVar

import numpy as np

from eomcheck.errors import InputError, RefusedError
from eomcheck.formulations import Formulation, Partition
from eomcheck.mechanics.records import Bodies, Chain, Speeds, Terms, velocity_from_speeds
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.dual import Dual, ReplayArithmetic, duals, rate, value
from eomcheck.numbers.generic import (
    Arithmetic,
    Array,
    NotRationalError,
    RecordingArithmetic,
    generic,
    map_entries,
    map_record,
)

T = TypeVar("T")


class Solution(NamedTuple):
    """Result of a formulation: v̇ (n,), or the rates of other speeds, and λ (r,) or None."""

    vdot: Any
    multipliers: Any


@generic
def net_force(M, Q, B):
    """Return F = Q - B (n,); Q or B is None if it is absent."""
    if Q is None:
        if B is None:
            return np.zeros(M.shape[:-1], M.dtype)
        return -B
    if B is None:
        return Q
    return Q - B


@generic
def loaded(force, tau):
    """Return a force (k,) and additional forces tau (k,); either is None if it is absent."""
    if tau is None:
        return force
    if force is None:
        return tau
    return force + tau


@generic
def along_speeds(W, tau):
    """Return Wᵀ tau (p,), the forces along generalized speeds; tau itself without W."""
    if tau is None or W is None:
        return tau
    return np.ascontiguousarray(W.T) @ tau


@generic
def rate_of_velocity(udot, W, rest):
    """Return v̇ = W u̇ + rest (n,); u̇ itself without W."""
    if W is None:
        return udot
    return W @ udot + rest


def with_literals(record: Any, literal: Callable[[int], Any]) -> Any:
    """Return a record in which literal integers are converted to numbers of an arithmetic.

    Raises:
        NotRationalError: an array of float64 that are not whole numbers.
    """

    def number(x: Any) -> Any:
        return literal(x) if isinstance(x, int) else x

    def numbers(part: Any) -> Any:
        if not isinstance(part, np.ndarray):
            return number(part)
        if part.dtype == object:
            return map_entries(number, part)
        if (part != np.rint(part)).any():
            raise NotRationalError(f"an array of doubles, {part.ravel()[:3]} ...")
        return map_entries(lambda x: literal(int(x)), part)

    return map_record(numbers, record)


def cached_quantity(function: Callable[[Any], T]) -> cached_property[T]:
    """Return a cached property, computed by `function` in the context `computing` of its name."""

    @wraps(function)
    def computed(at: Any) -> T:
        with at.computing(function.__name__):
            return function(at)

    return cached_property(computed)


class Quantities:
    """The quantities of `scene` at one point, in the numbers of `arithmetic`.

    Either `v` or `u` is to be set from outside; the other one then follows from it. `tau`,
    generalized forces (n,) in addition to the scene's own, may be set too, before anything is
    computed.

    Args:
        scene: the scene.
        arithmetic: the arithmetic of the scalar type.
        q: coordinates (n,), numbers of `arithmetic`.
        t: time, s, a number of `arithmetic`.
    """

    tau: Any = None

    def __init__(self, scene: Scene, arithmetic: Arithmetic, q: Array, t: Any = 0.0):
        self.scene, self.arithmetic, self.q, self.t = scene, arithmetic, q, t
        self._cache: dict[Callable[[Any], Any], Any] = {}

    def cached(self, function: Callable[[Any], T]) -> T:
        """Return function(self), computed on first use."""
        if function not in self._cache:
            with self.computing(function.__qualname__):
                self._cache[function] = function(self)
        return self._cache[function]

    def elsewhere(self, q: Array) -> Quantities:
        """Return the quantities of the scene at other coordinates q (n,), in float64 only."""
        raise NotImplementedError

    def computing(self, name: str) -> AbstractContextManager:
        """Return the context in which the quantity `name` is computed."""
        return nullcontext()

    def call(self, function: Callable, *arguments) -> Any:
        """Call a generic function."""
        return function(*arguments)

    def run(self, function: Callable, *arguments) -> Any:
        """Call a generic function of scalar operations, such as those of a scene."""
        return self.call(function, *arguments)

    def run_for_each(self, key: str, function: Callable, shared: tuple, varied: tuple) -> Any:
        """Return the results of a generic function for k values of its last arguments, stacked.

        Args:
            key: name under which matrices that it solves are recorded.
            function: the function.
            shared: its first arguments.
            varied: its last arguments, records of arrays (k, ...).
        """
        results = [
            self.run(function, *shared, *map_record(lambda x, i=i: x[i], varied))
            for i in range(number_of_values(varied))
        ]
        return map_record(lambda *parts: np.stack(parts), *results)

    def call_solving(self, name: str, function: Callable, *arguments) -> tuple[Any, bool]:
        """Call a generic function that solves matrices, and record these under `name`.

        Returns:
            Its result, and whether the matrices are well-conditioned.
        """
        return self.call(function, *arguments), True

    def finished(self, record: Any) -> Any:
        """Return `record`, a new result, in the form in which it is cached."""
        return self.in_numbers(record)

    def constants(self, record: Any) -> Any:
        """Return `record`, numbers that are the same in every state, as parameters are cached."""
        return self.finished(record)

    def rounded_sum(self, T: Array, q: Array, shift: Array) -> Any:
        """Return coordinates T q + shift (k,), which are rounded where they are sums."""
        return T @ q + shift

    def in_numbers(self, record: Any) -> Any:
        """Return `record` with its literals as numbers of the arithmetic."""
        literal = getattr(self.arithmetic, "literal", None)
        return record if literal is None else with_literals(record, literal)

    @cached_quantity
    def parameters(self) -> Any:
        """The scene's parameters."""
        return self.finished(self.scene.parameters(self.arithmetic))

    @cached_quantity
    def prepared(self) -> Any:
        """The precomputed values that are not rational in q and t: sines, cosines, roots."""
        prepared, self._angles_and_roots = self.prepare()
        return self.in_numbers(prepared)

    @property
    def angles_and_roots(self) -> Sequence[Any]:
        """The angles and roots of which the precomputed values are made, in the order of calls."""
        self.prepared  # noqa: B018  (they are recorded with it)
        return self._angles_and_roots

    def prepare(self) -> tuple[Any, Sequence[Any]]:
        """Return the precomputed values of q and t, and the angles and roots they are made of."""
        recorder = RecordingArithmetic(self.prepare_arithmetic)
        return self.scene.prepare(recorder, self.parameters, self.q, self.t), recorder.recorded

    @property
    def prepare_arithmetic(self) -> Arithmetic:
        """The arithmetic that computes sines, cosines and roots."""
        return self.arithmetic

    def prepared_duals(self, qdot: Array, clock: bool = True) -> tuple[Any, Array]:
        """Return the precomputed values and q in dual numbers, with q̇ = `qdot`.

        Args:
            qdot: rates of the coordinates (n,).
            clock: whether ṫ = 1, otherwise 0: q changes at a fixed time.
        """
        self.prepared  # noqa: B018  (its angles and roots are needed)
        q, t = duals(self.q, qdot), Dual(self.t, int(clock))
        replay = ReplayArithmetic(self._angles_and_roots)
        return self.in_numbers(self.scene.prepare(replay, self.parameters, q, t)), q

    def prepared_and_rates(self, qdot: Array, clock: bool = True) -> tuple[Any, Any]:
        """Return the precomputed values and their rates; see `prepared_duals`."""
        prepared, _ = self.prepared_duals(qdot, clock)
        return values_and_rates(prepared)

    def rates_along(self, qdots: Array) -> tuple[Any, Any]:
        """Return the precomputed values and their rates along k velocities (k, n), stacked.

        The clock stands still.
        """
        both = [self.prepared_and_rates(qdot, clock=False) for qdot in qdots]
        return map_record(lambda *parts: np.stack(parts), *both)

    @cached_quantity
    def v(self) -> Array:
        """Velocities (n,), computed from u."""
        return self.velocity

    @cached_quantity
    def u(self) -> Array:
        """Generalized speeds (p,), computed from v."""
        return self.run(self.scene.speeds_of, self.parameters, self.prepared, self.q, self.v)

    @cached_quantity
    def terms(self) -> Terms:
        """The terms M, Q, B, a, gamma, b."""
        arguments = self.parameters, self.prepared, self.q, self.v
        return self.finished(self.run(self.scene.terms, *arguments))

    @cached_quantity
    def F(self) -> Array:
        """The net force F = Q + tau - B (n,)."""
        M, Q, B, *_ = self.terms
        return loaded(net_force(M, Q, B), self.tau)

    @cached_quantity
    def kinematics(self) -> Any:
        """The intermediate values that speeds and bodies share."""
        arguments = self.parameters, self.prepared, self.q, self.u
        return self.finished(self.run(self.scene.kinematics, *arguments))

    @cached_quantity
    def speeds(self) -> Speeds:
        """W, rest and offset of generalized speeds."""
        arguments = self.parameters, self.prepared, self.kinematics
        return self.finished(self.run(self.scene.speeds, *arguments))

    @cached_quantity
    def bodies(self) -> Bodies:
        """Partial velocities, inertias, forces and bias accelerations of the bodies."""
        arguments = self.parameters, self.prepared, self.kinematics
        return self.finished(self.run(self.scene.bodies, *arguments))

    @cached_quantity
    def x(self) -> Array:
        """Quasi-velocities (s,) of a chain, computed from v."""
        arguments = self.parameters, self.prepared, self.q, self.v
        return self.finished(self.run(self.scene.quasi_velocities, *arguments))

    @cached_quantity
    def chain(self) -> Chain:
        """The bodies as a chain."""
        arguments = self.parameters, self.prepared, self.q, self.x
        return self.finished(self.run(self.scene.chain, *arguments))

    def dissipation(self, v: Array) -> Any:
        """Return R at velocities v (n,) of any scalar type; None without dissipation."""
        function = self.scene.dissipation
        return None if function is None else function(self.parameters, self.prepared, self.q, v)

    @cached_quantity
    def velocity(self) -> Array:
        """The velocity W u + offset (n,), equal to v if v is consistent."""
        with np.errstate(all="ignore"):
            return velocity_from_speeds(self.u, self.speeds.W, self.speeds.offset)

    @cached_quantity
    def qdot(self) -> Array:
        """The velocity W u + offset (n,) by `Scene.qdot`, without W, if the scene has it."""
        if self.scene.qdot is None:
            return self.velocity
        return self.run(self.scene.qdot, self.parameters, self.prepared, self.kinematics)

    @cached_quantity
    def partition(self) -> Partition:
        """The paper's partition: the first r columns of a are dependent."""
        columns, r = np.arange(self.scene.n), self.scene.r
        return Partition(columns[:r], columns[r:])

    def refuse_partition(self) -> None:
        """Raise RefusedError if there are more constraints than coordinates to split."""
        n, r = self.scene.n, self.scene.r
        if r > n:
            message = f"{r} constraints on {n} coordinates leave nothing to solve"
            raise RefusedError("a_1", 0.0, 0.0, message)

    def speeds_read(self, formulation: Formulation) -> Array:
        """Return the speeds that the functions of `formulation` read beside q: v, u or x."""
        if formulation.uses == "terms":
            return self.v
        return self.x if formulation.uses == "chain" else self.u

    def rates(self, formulation: Formulation, partition: Partition | None = None) -> Solution:
        """Return the rates of the speeds that `formulation` reads, v̇, u̇ or ẋ, and λ or None.

        The partition is the paper's by default. For a chain the second item is the joint forces
        instead of λ.

        Raises:
            RefusedError: a matrix is singular, or the generalized speeds do not exist.
        """
        if formulation.uses == "terms":
            M, _, _, a, gamma, _ = self.terms
            partition = self.partition if partition is None else partition
            read = M, self.F, a, gamma, self.v, partition
            return Solution(*self.call(formulation.solution, *read))
        if formulation.uses == "speeds":
            W, rest, _ = self.speeds
            return Solution(self.call(formulation.solution, self.terms.M, self.F, W, rest), None)
        if formulation.uses == "bodies":
            bodies, more = self.bodies, (self.scene.support,) if formulation.sparse else ()
            if self.tau is not None:
                force = loaded(bodies.force, along_speeds(self.speeds.W, self.tau))
                bodies = bodies._replace(force=force)
            return Solution(self.call(formulation.solution, *bodies, *more), None)
        chain = self.chain
        if self.tau is not None:
            chain = chain._replace(force=loaded(chain.force, self._chain_load[0]))
        return Solution(*self.call(formulation.solution, *chain))

    @cached_property
    def _chain_load(self) -> tuple[Array, Array]:
        """The forces f (s,) and the change of λ (r,) by `tau`, see `Scene.chain_load`.

        Raises:
            InputError: the scene does not have them.
        """
        if self.scene.chain_load is None:
            raise InputError(
                f"tau: the chain of the scene {self.scene.key} takes no forces, for it gives no "
                "chain_load"
            )
        return self.call(self.scene.chain_load, self.parameters, self.prepared, self.tau)

    def solution(self, formulation: Formulation, partition: Partition | None = None) -> Solution:
        """Return v̇ and λ by `formulation`; see `rates`."""
        rates, multipliers = self.rates(formulation, partition)
        if formulation.uses == "terms":
            return Solution(rates, multipliers)
        if formulation.uses == "chain":
            common = self.parameters, self.prepared
            vdot = self.call(self.scene.chain_acceleration, *common, self.x, rates)
            forces = self.chain, self.x, multipliers
            lambda_ = self.call(self.scene.chain_multipliers, *common, *forces)
            return Solution(vdot, lambda_ if self.tau is None else lambda_ + self._chain_load[1])
        return Solution(self.rate_of_velocity(rates), None)

    def rate_of_velocity(self, udot: Array) -> Array:
        """Return v̇ (n,) of u̇ (p,)."""
        W, rest, _ = self.speeds
        return rate_of_velocity(udot, W, rest)


def number_of_values(varied: Any) -> int:
    """Return the length of the arrays of a record, which are all as long."""
    lengths: list[int] = []
    map_record(lambda x: lengths.append(len(x)), varied)
    return lengths[0]


def values_and_rates(record: Any) -> tuple[Any, Any]:
    """Return the values of dual numbers in a record, and their derivatives."""
    return map_record(partial(map_entries, value), record), map_record(
        partial(map_entries, rate), record
    )
