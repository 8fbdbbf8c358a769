"""A `Point`: every variable of a scene free, in any exact kind of number."""

from __future__ import annotations

from functools import cached_property
from typing import Any, Protocol

import numpy as np

from eomcheck.arithmetic.dual import Dual, dual_angles, duals, rate
from eomcheck.errors import RefusedError
from eomcheck.formulations import Formulation, Partition
from eomcheck.model import Angles, Arithmetic, Array, Scene
from eomcheck.quantities import Quantities, Solution


class Variables(Arithmetic, Protocol):
    """An arithmetic that has variables to give: random elements, or symbols."""

    def vector(self, size: int) -> Array:
        """Return new variables (size,)."""
        ...


class Point(Quantities):
    """A scene with every parameter, angle and speed a variable; v = W u + offset.

    Args:
        scene: decides sizes and what is absent; its numbers do not matter.
        arithmetic: what gives the variables.
        partition: a second partition of the coordinates, beside the paper's.
    """

    def __init__(self, scene: Scene, arithmetic: Variables, partition: Partition | None = None):
        super().__init__(scene, arithmetic, arithmetic.vector(scene.n), arithmetic.vector(1)[0])
        self.u = arithmetic.vector(scene.p)
        self.other_partition = partition
        self.directions = [arithmetic.vector(scene.n)]
        self._free_velocity = arithmetic.vector(scene.n)
        self._solutions: dict[tuple[str, bool], Solution | RefusedError] = {}

    @cached_property
    def free(self) -> Quantities:
        """The same point with a velocity of its own, which need not satisfy the constraints."""
        free = Quantities(self.scene, self.arithmetic, self.q, self.t)
        free.parameters, free.prepared, free.v = self.parameters, self.prepared, self._free_velocity
        return free

    def look_along_axes(self) -> None:
        """Replace the direction of a virtual displacement by each coordinate in turn."""
        # Not of literals: half a literal 1 would be no element of a field.
        n, zero = self.scene.n, 0 * self.q[0]
        self.directions = [np.array([zero + int(i == j) for j in range(n)]) for i in range(n)]

    @property
    def direction_names(self) -> tuple[str, ...]:
        """Names of the directions."""
        return self.scene.coordinate_names if len(self.directions) > 1 else ("any direction",)

    def solved(self, formulation: Formulation, other: bool = False) -> Solution | None:
        """Return what `formulation` says, by the other partition on request; None if it refuses."""
        result = self._solve(formulation, other)
        return None if isinstance(result, RefusedError) else result

    def refusal(self, formulation: Formulation) -> RefusedError | None:
        """Return why `formulation` refuses, or None."""
        result = self._solve(formulation, False)
        return result if isinstance(result, RefusedError) else None

    def _solve(self, formulation: Formulation, other: bool) -> Solution | RefusedError:
        key = (formulation.key, other)
        if key not in self._solutions:
            try:
                partition = self.other_partition if other else self.partition
                self._solutions[key] = self.solution(formulation, partition)
            except RefusedError as refusal:
                self._solutions[key] = refusal
        return self._solutions[key]

    @cached_property
    def prepared(self) -> Any:
        """What is not rational in q and t; the angles among it are remembered."""
        self._recorder = _Recorder(self.arithmetic)
        return self.keep(self.scene.prepare(self._recorder, self.q, self.t))

    @cached_property
    def can_move(self) -> bool:
        """Whether all that is prepared from q and t is angles, which can be differentiated."""
        try:
            self.moving(0 * self.q)
        except (TypeError, AttributeError, NotImplementedError):
            return False
        return True

    def moving(self, qdot: Array, clock: bool = True) -> tuple[Any, Array]:
        """Return (prepared, q) while q changes at `qdot`, in dual numbers.

        Args:
            qdot: rates of the coordinates (n,).
            clock: whether time passes, or q changes at a fixed time.
        """
        self.prepared  # noqa: B018  (its angles are needed)
        q, t = duals(self.q, qdot), Dual(self.t, int(clock))
        return self.keep(self.scene.prepare(_Replay(self._recorder.made), q, t)), q


class _Recorder:
    """An arithmetic that remembers the angles it made."""

    def __init__(self, arithmetic: Arithmetic):
        self._arithmetic = arithmetic
        self.made: list[Angles] = []

    def numbers(self, x: Array) -> Array:
        return self._arithmetic.numbers(x)

    def angles(self, x: Array) -> Angles:
        self.made.append(self._arithmetic.angles(x))
        return self.made[-1]


class _Replay:
    """An arithmetic that makes the same angles again, in the same order, while they turn."""

    def __init__(self, made: list[Angles]):
        self._made = iter(made)

    def numbers(self, x: Array) -> Array:
        raise NotImplementedError("nobody told the rate of what is prepared")

    def angles(self, x: Array) -> Angles:
        return dual_angles(next(self._made), rate(x))
