"""What a formulation is: facts as data, and one generic function.

A formulation gets its numbers in one of three ways (`uses`):

- "terms": `solution(M, F, a, gamma, v, partition) -> (vdot, multipliers or None)`
- "speeds": `solution(M, F, W, rest) -> udot`
- "bodies": `solution(*Bodies) -> udot`

and v̇ = W u̇ + rest for the last two. F = Q - B. Any of a, gamma, gyroscopic, force may be `None`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple


class Partition(NamedTuple):
    """A choice of r dependent and n - r independent coordinates (El and Em), as column indices."""

    dependent: Any
    """(r,), integers."""
    independent: Any
    """(n-r,), integers."""


@dataclass(frozen=True)
class Formulation:
    """One way to get accelerations, as data.

    Attributes:
        key: short name, used everywhere.
        name: name in the paper.
        equations: the paper's equations.
        order: coefficients (i, j) of the order i n + j r of the final system (paper, Table I).
        level: at which constraints enter, "acceleration" or "velocity".
        multipliers: whether multipliers come out here.
        multipliers_in_paper: whether Table I says so.
        state: what an integration carries: "q, v, μ" with μ the integrals of the multipliers,
            "q, v", "q, v2" with the independent velocities, or "q, u".
        uses: which numbers `solution` gets, see the module.
        partitioned: whether it splits the coordinates; then a pivoted split is an option.
        limits: what it cannot do, in one or two sentences, N = 1 and N = 2 of the snake included.
        solution: the generic function.
    """

    key: str
    name: str
    equations: str
    order: tuple[int, int]
    level: Literal["acceleration", "velocity"]
    multipliers: bool
    multipliers_in_paper: bool
    state: Literal["q, v, μ", "q, v", "q, v2", "q, u"]
    uses: Literal["terms", "speeds", "bodies"]
    partitioned: bool
    limits: str
    solution: Callable[..., Any]

    @property
    def in_paper(self) -> bool:
        """Whether it is one of the paper's seven: then `equations` begins with a number."""
        return self.equations.startswith("(")

    def unknowns(self, n: int, r: int) -> int:
        """Return the number of equations of the final system (Table I)."""
        return self.order[0] * n + self.order[1] * r

    @property
    def order_text(self) -> str:
        """The order as Table I prints it, such as "2n + r"."""
        i, j = self.order
        first = "n" if i == 1 else f"{i}n"
        return first if j == 0 else f"{first} {'+' if j > 0 else '-'} r"
