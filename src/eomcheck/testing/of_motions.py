"""Claims about whole accelerations: they satisfy the equations, and energy is accounted for."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from eomcheck.evaluation.tolerance import C
from eomcheck.numbers.contract import Array
from eomcheck.numbers.pivots import EPS
from eomcheck.testing.derived import bias, inertia, why_no_bias
from eomcheck.testing.measured import Measured, exact
from eomcheck.testing.of_energies import kinetic_rate
from eomcheck.testing.of_terms import rows, same
from eomcheck.testing.point import Point
from eomcheck.testing.registry import Blind, Sides, Skipped, claim

HOW = {
    -1.0: "it is not in q̈, or it is in two of the other functions",
    1.0: "it is twice in q̈",
    -2.0: "its sign is another one in q̈",
}
"""How often a force is in M q̈ + B more than it should be -> what that looks like."""


@claim(
    "motion",
    "M q̈ + B + g + ∂R/∂v = Q + aᵀλ",
    "equations of motion",
    ("M|T", "qdd"),
    consistent=True,
    blind=(
        Blind("qdd", "whether q̈ belongs to the terms", ("M|T", "against")),
        Blind("R", "damping of wrong sign or size", ("qdd & M|T", "against")),
        Blind("Q", "applied forces of wrong sign or size", ("qdd & M|T", "against")),
    ),
)
def motion(at: Point) -> Iterator[Sides | Skipped]:
    """Accelerations satisfy the equations of motion, in the directions the constraints leave.

    M and B as given, else as T, C or M say.
    """
    subject, B = "M q̈ + B ~ forces", bias(at)
    if B is None:
        yield Skipped(subject, why_no_bias(at))
        return
    inertial, forces = inertia(at) @ at.of("qdd") + B, at.forces()
    names, free = rows(at), exact(np.eye(len(at.v)))
    if at.has("a"):
        free = exact(at.free().T)
        names = tuple(f"free direction {i}" for i in range(free.shape[0]))
        inertial, forces = free @ inertial, free @ forces

    def say(found: Array, expected: Array, allowed: float, worst: tuple[int, ...]) -> str:
        for name, part in at.parts().items():
            of = free @ part
            for factor, what in HOW.items():
                if same(found - expected, factor * of.value, allowed + abs(factor) * C * of.error):
                    return f"off by {name}: {what}"
        return ""

    yield Sides(subject, inertial, forces, (names,), say)


@claim(
    "power-balance",
    "d(T + U)/dt = v·Q - v·∂R/∂v",
    "power balance",
    ("qdd", "T|M"),
    without=("b",),
    consistent=True,
    natural=True,
)
def power_balance(at: Point) -> Iterator[Sides]:
    """Energy changes by what forces and dampers do; constraints do no work."""
    qdd, forces, v = at.of("qdd"), at.forces(), exact(at.v)
    found = kinetic_rate(at, qdd)
    yield Sides("Ṫ ~ v·forces", found, v @ forces + of_violation(at, qdd, forces), ())


def of_violation(at: Point, qdd: Measured, forces: Measured) -> Measured:
    """Return what constraint forces do because v keeps the constraints to rounding only: 0, or so.

    v violates them by what is left of a v, and by what rounds in that.
    """
    if not at.has("a"):
        return exact(0.0)
    a, speed = at.of("a").value, np.abs(at.v)
    left = np.abs(a @ at.v) + EPS * np.abs(a) @ speed
    violation = np.abs(np.linalg.pinv(a)) @ left + EPS * speed
    size = (inertia(at) @ qdd).size + forces.size
    return Measured(np.zeros(()), np.asarray(size @ violation), np.zeros(()))


@claim(
    "acceleration-even",
    "q̈(q, -v) = q̈(q, v)",
    "acceleration",
    ("qdd",),
    without=("R", "Q", "b"),
    natural=True,
    consistent=True,
)
def acceleration_even(at: Point) -> Iterator[Sides]:
    """Without damping a motion can run backwards."""
    yield Sides("q̈", at.moved(-at.v).of("qdd"), at.of("qdd"), (rows(at),))


@claim(
    "acceleration-quadratic",
    "q̈(2v) - q̈(0) = 4 (q̈(v) - q̈(0))",
    "acceleration",
    ("qdd",),
    without=("R", "Q", "b"),
    natural=True,
    consistent=True,
)
def acceleration_quadratic(at: Point) -> Iterator[Sides]:
    """Without damping accelerations are those at rest and a quadratic part."""
    rest = at.moved(np.zeros(len(at.v))).of("qdd")
    found = at.moved(2.0 * at.v).of("qdd") - rest
    yield Sides("q̈", found, 4.0 * (at.of("qdd") - rest), (rows(at),))
