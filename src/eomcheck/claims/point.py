"""A `Point`: every variable of a scene free, in any exact kind of number."""

from __future__ import annotations

from functools import cached_property
from typing import Protocol

import numpy as np

from eomcheck.errors import RefusedError
from eomcheck.evaluation.point import Quantities, Solution
from eomcheck.formulations import Formulation, Partition
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.contract import Arithmetic, Array


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
    def can_move(self) -> bool:
        """Whether all that is prepared is angles and roots, which can be differentiated."""
        try:
            self.moving(0 * self.q)
        except (TypeError, AttributeError, NotImplementedError):
            return False
        return True
