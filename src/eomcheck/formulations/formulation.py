"""Formulations as data: facts about each, and one generic function, `solution`.

The inputs of `solution` come from one of four functions of a scene (`uses`):

- "terms": `solution(M, F, a, gamma, v, partition) -> (vdot, multipliers or None)`
- "speeds": `solution(M, F, W, rest) -> udot`
- "bodies": `solution(*Bodies) -> udot`; a `sparse` one also takes the scene's `support` as its last
  argument
- "chain": `solution(*Chain) -> (xdot, joint forces)`

From "speeds" and "bodies" v̇ = W u̇ + rest, from "chain" it is the scene's `chain_acceleration`.
F = Q - B. Any of a, gamma, gyroscopic, force may be `None`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from eomcheck.mechanics.scene import Scene

Choice = tuple[tuple[int, ...] | None, ...]
"""A `Partition` as hashable tuples."""


class Partition(NamedTuple):
    """A choice of r dependent and n - r independent coordinates (El and Em), as column indices.

    For dependent constraints also a choice of ρ independent rows that imply the others (UK).
    """

    dependent: Any
    """Indices of dependent coordinates (r,), integers."""
    independent: Any
    """Indices of independent coordinates (n-r,), integers."""
    kept: Any = None
    """Indices of independent constraints (ρ,), integers; None if all are independent."""
    redundant: Any = None
    """Indices of the constraints that the kept ones imply, integers; None if there are none."""

    @property
    def choice(self) -> Choice:
        """The partition as tuples, which can be compared and hashed."""
        return tuple(None if part is None else tuple(map(int, part)) for part in self)

    @classmethod
    def chosen(cls, choice: Choice) -> Partition:
        """Return the partition with this `choice`."""
        return cls(*(None if part is None else np.array(part, int) for part in choice))


@dataclass(frozen=True)
class Formulation:
    """A method that computes accelerations, as data.

    Attributes:
        key: short name, used everywhere.
        name: name in the paper, if it is there.
        equations: the paper's equations, "" for a formulation that is not in the paper.
        order: coefficients of the order of the final system: (i, j) of i n + j r (paper, Table I),
            or (i, j, k) of i n + j r + k s for a chain of bodies with s quasi-velocities.
        level: level at which constraints enter, "acceleration" or "velocity".
        multipliers: whether this implementation returns multipliers.
        multipliers_in_paper: the entry of Table I about multipliers; None where it has none.
        state: the integrated state vector: "q, v, μ" with μ the integrals of the multipliers,
            "q, v", "q, v2" with the independent velocities, "q, u", or "q, x" with the quasi-
            velocities of a chain.
        uses: function of the scene that provides the inputs of `solution`, see the module.
        partitioned: whether it partitions the coordinates; a pivoted partition is then an option.
        limits: its limitations, in one or two sentences, N = 1 and N = 2 of the snake included.
        solution: the generic function.
        redundant: whether constraint rows may be dependent; its partition names the dependent ones.
        sparse: whether `solution` takes the mask of speeds that move each body, `Scene.support`.
    """

    key: str
    name: str
    equations: str
    order: tuple[int, int] | tuple[int, int, int]
    level: Literal["acceleration", "velocity"]
    multipliers: bool
    multipliers_in_paper: bool | None
    state: Literal["q, v, μ", "q, v", "q, v2", "q, u", "q, x"]
    uses: Literal["terms", "speeds", "bodies", "chain"]
    partitioned: bool
    limits: str
    solution: Callable[..., Any]
    redundant: bool = False
    sparse: bool = False

    @property
    def in_paper(self) -> bool:
        """Whether it is one of the paper's seven."""
        return bool(self.equations)

    @property
    def in_speeds(self) -> bool:
        """Whether it uses the scene's generalized speeds."""
        return self.state == "q, u"

    @property
    def linear(self) -> bool:
        """Whether its matrices are all banded or of a size independent of the number of bodies."""
        return self.uses in ("bodies", "chain")

    def applies_to(self, scene: Scene | type[Scene]) -> bool:
        """Return whether `scene` has the functions that the formulation uses."""
        return scene.offers(self.uses)

    def unknowns(self, n: int, r: int, s: int = 0) -> int:
        """Return the number of equations of the final system (Table I).

        Args:
            n: number of coordinates.
            r: number of constraints.
            s: number of quasi-velocities of a chain.
        """
        return sum(i * size for i, size in zip(self.order, (n, r, s), strict=False))

    @property
    def order_text(self) -> str:
        """The order as printed in Table I, such as "2n + r"."""
        text = ""
        for i, size in sorted(zip(self.order, "nrs", strict=False), key=lambda term: -term[0]):
            if i:
                sign = (" - " if i < 0 else " + ") if text else ""
                text += sign + ("" if abs(i) == 1 else str(abs(i))) + size
        return text
