"""Claims about whole accelerations: they satisfy the equations, and energy is accounted for."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from eomcheck.numbers.pivots import EPS
from eomcheck.testing.measured import Measured, exact
from eomcheck.testing.of_energies import inertia_of, kinetic_rate
from eomcheck.testing.of_terms import rows
from eomcheck.testing.point import Point
from eomcheck.testing.registry import Blind, Sides, Skipped, claim

UNFOUND = Skipped("qdd", "no state is found nearby that keeps the constraints")


@claim(
    "motion",
    "M q̈ + B + g + ∂R/∂v = Q + aᵀλ",
    "equations of motion",
    ("M", "bias", "qdd"),
    blind=(
        Blind("qdd", "whether q̈ belongs to the terms", ("M", "T", "against")),
        Blind("R", "damping of wrong sign or size", ("qdd", "against")),
        Blind("Q", "applied forces of wrong sign or size", ("qdd", "against")),
    ),
)
def motion(at: Point) -> Iterator[Sides | Skipped]:
    """Accelerations satisfy the equations of motion, in the directions the constraints leave."""
    here = at.consistent()
    if here is None:
        yield UNFOUND
        return
    inertia, forces = here.of("M") @ here.of("qdd") + here.B(), here.forces()
    if not at.has("a"):
        yield Sides("M q̈ + B ~ forces", inertia, forces, (rows(at),))
        return
    free = exact(here.free().T)
    names = tuple(f"free direction {i}" for i in range(free.shape[0]))
    yield Sides("M q̈ + B ~ forces", free @ inertia, free @ forces, (names,))


@claim(
    "power-balance",
    "d(T + U)/dt = v·Q - v·∂R/∂v",
    "power balance",
    ("qdd", "T|M"),
    without=("b",),
    natural=True,
)
def power_balance(at: Point) -> Iterator[Sides | Skipped]:
    """Energy changes by what forces and dampers do; constraints do no work."""
    here = at.consistent()
    if here is None:
        yield UNFOUND
        return
    qdd, forces, v = here.of("qdd"), here.forces(), exact(here.v)
    found = kinetic_rate(here, qdd)
    yield Sides("Ṫ ~ v·forces", found, v @ forces + of_violation(here, qdd, forces), ())


def of_violation(at: Point, qdd: Measured, forces: Measured) -> Measured:
    """Return what constraint forces do because v keeps the constraints to rounding only: 0, or so.

    v violates them by what is left of a v, and by what rounds in that.
    """
    if not at.has("a"):
        return exact(0.0)
    a, speed = at.of("a").value, np.abs(at.v)
    left = np.abs(a @ at.v) + EPS * np.abs(a) @ speed
    violation = np.abs(np.linalg.pinv(a)) @ left + EPS * speed
    size = (inertia_of(at) @ qdd).size + forces.size
    return Measured(np.zeros(()), np.asarray(size @ violation), np.zeros(()))


@claim(
    "acceleration-even",
    "q̈(q, -v) = q̈(q, v)",
    "acceleration",
    ("qdd",),
    without=("R", "Q", "b"),
    natural=True,
)
def acceleration_even(at: Point) -> Iterator[Sides | Skipped]:
    """Without damping a motion can run backwards."""
    here = at.consistent()
    if here is None:
        yield UNFOUND
        return
    yield Sides("q̈", here.moved(-here.v).of("qdd"), here.of("qdd"), (rows(at),))


@claim(
    "acceleration-quadratic",
    "q̈(2v) - q̈(0) = 4 (q̈(v) - q̈(0))",
    "acceleration",
    ("qdd",),
    without=("R", "Q", "b"),
    natural=True,
)
def acceleration_quadratic(at: Point) -> Iterator[Sides | Skipped]:
    """Without damping accelerations are those at rest and a quadratic part."""
    here = at.consistent()
    if here is None:
        yield UNFOUND
        return
    rest = here.moved(np.zeros(len(at.v))).of("qdd")
    found = here.moved(2.0 * here.v).of("qdd") - rest
    yield Sides("q̈", found, 4.0 * (here.of("qdd") - rest), (rows(at),))
