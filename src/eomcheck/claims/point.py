"""A `Point`: every variable of a scene free, in any exact kind of number."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property
from typing import Any, ClassVar, Protocol

import numpy as np

from eomcheck.claims.registry import NoRateError
from eomcheck.errors import RefusedError
from eomcheck.evaluation.scene_quantities import Quantities, Solution
from eomcheck.formulations import Formulation, Partition
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Arithmetic, Array


class Variables(Arithmetic, Protocol):
    """An arithmetic that has variables to give: random elements, or symbols."""

    def vector(self, size: int) -> Array:
        """Return new variables (size,)."""
        ...


class Point(Quantities):
    """A scene with every parameter, angle and speed a variable; v = W u + offset.

    It is looked at as it is: see `eomcheck.claims.registry.Look`.

    Args:
        scene: decides sizes and what is absent; its numbers do not matter.
        arithmetic: what gives the variables.
        formulations: those to look at.
        partition: a second partition of the coordinates, beside the paper's.
    """

    exact: ClassVar[bool] = True
    has_speeds: ClassVar[bool] = True
    speeds_told: ClassVar[bool] = True

    def __init__(
        self,
        scene: Scene,
        arithmetic: Variables,
        formulations: tuple[Formulation, ...] = (),
        partition: Partition | None = None,
    ):
        super().__init__(scene, arithmetic, arithmetic.vector(scene.n), arithmetic.vector(1)[0])
        self.u = arithmetic.vector(scene.p)
        self.formulations, self.other_partition = formulations, partition
        self.directions = [arithmetic.vector(scene.n)]
        self._variables = arithmetic
        self._free_velocity = arithmetic.vector(scene.n)
        self._results: dict[tuple[str, bool], Solution | RefusedError] = {}

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

    @property
    def partitions(self) -> Iterator[tuple[str, Partition]]:
        """The paper's partition and the other one."""
        yield "em", self.partition
        if self.other_partition is not None:
            yield "em, drawn", self.other_partition

    @cached_property
    def added_row(self) -> tuple[Array, Partition]:
        """Any sum of the constraints; the row left out was drawn with the other partition."""
        r = self.scene.r
        rows = np.arange(r), np.array([r])
        if self.other_partition is not None and self.other_partition.kept is not None:
            rows = self.other_partition.kept, self.other_partition.redundant
        partition = self.partition._replace(kept=rows[0], redundant=rows[1])
        return self._variables.vector(r), partition

    @property
    def solutions(self) -> tuple[tuple[Formulation, Solution], ...]:
        """What the formulations say that do not refuse."""
        results = ((f, self._result(f)) for f in self.formulations)
        return tuple((f, x) for f, x in results if isinstance(x, Solution))

    @property
    def others(self) -> tuple[tuple[Formulation, Solution, Solution], ...]:
        """Partitioned formulations, a result by the paper's partition, theirs by the other one."""
        if self.other_partition is None:
            return ()
        solutions = self.solutions
        by_other = ((f, self._result(f, True)) for f in self.formulations if f.partitioned)
        # Its own result by the paper's partition, or any other if that refuses.
        return tuple(
            (f, dict(solutions).get(f, solutions[0][1]), y)
            for f, y in by_other
            if solutions and isinstance(y, Solution)
        )

    def refusal(self, formulation: Formulation) -> RefusedError | None:
        """Return why `formulation` refuses, or None."""
        result = self._result(formulation)
        return result if isinstance(result, RefusedError) else None

    def _result(self, formulation: Formulation, other: bool = False) -> Solution | RefusedError:
        key = (formulation.key, other)
        if key not in self._results:
            try:
                partition = self.other_partition if other else self.partition
                self._results[key] = self.solution(formulation, partition)
            except RefusedError as refusal:
                self._results[key] = refusal
        return self._results[key]

    def sensitivity(self, quantity: Callable[[Any], Any]) -> float:
        """Return 0: nothing is rounded."""
        return 0.0

    vdot_sensitivity = multiplier_sensitivity = sensitivity

    def moving(self, qdot: Array, clock: bool = True) -> tuple[Any, Array]:
        """Return (prepared, q) while q changes at `qdot`, see `Quantities`.

        Raises:
            NoRateError: more is prepared than angles and roots, and cannot be differentiated.
        """
        try:
            return super().moving(qdot, clock)
        except (TypeError, AttributeError, NotImplementedError) as error:
            raise NoRateError from error
