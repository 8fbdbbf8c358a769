"""Claims about constraints: Jacobian, drift, and accelerations that keep them."""

from __future__ import annotations

from collections.abc import Iterator

from eomcheck.testing.derived import drift, drift_of_jacobian
from eomcheck.testing.measured import contract, exact
from eomcheck.testing.of_terms import proportional, rows
from eomcheck.testing.point import Point
from eomcheck.testing.registry import Blind, Sides, claim


def constraints(at: Point) -> tuple[str, ...]:
    """Return the names of the constraints."""
    return tuple(f"constraint {i}" for i in range(at.answers.sizes.get("r", 0)))


@claim(
    "constraint-jacobian",
    "a = ∂c/∂v, or ∂c/∂q of c(q)",
    "constraint Jacobian",
    ("a", "c"),
    blind=(Blind("a", "whether a belongs to the constraints", ("c", "against")),),
)
def constraint_jacobian(at: Point) -> Iterator[Sides]:
    """a is the derivative of the constraints."""
    c, a = at.raw("c"), at.of("a")
    if at.answers.reads("c") == "qv":
        expected = at.by_v(c).T
    else:
        expected = contract("nr,np->rp", at.by_q(c), at.S())
    yield Sides("a", a, expected, (constraints(at), rows(at)))


@claim("constraint-velocity", "c(q, v) = a v + b", "constraint velocity", ("a", "c"))
def constraint_velocity(at: Point) -> Iterator[Sides]:
    """Constraints at velocity level are a v + b."""
    if at.answers.reads("c") != "qv":
        return
    found = at.of("a") @ exact(at.v)
    if at.has("b"):
        found = found + at.of("b")
    yield Sides("a v + b", found, at.of("c"), (constraints(at),))


@claim(
    "constraint-drift",
    "γ = ȧ v + ḃ",
    "constraint drift",
    ("a", "gamma"),
    blind=(
        Blind("gamma", "whether γ belongs to a", ("a", "against")),
        Blind("a", "whether a depends on q as it should", ("c", "gamma", "qdd", "against")),
    ),
)
def constraint_drift(at: Point) -> Iterator[Sides]:
    """γ is the rate of a v + b at v̇ = 0, for every v."""
    yield Sides("γ", at.of("gamma"), drift_of_jacobian(at), (constraints(at),), proportional)


@claim(
    "constraint-acceleration",
    "a q̈ + γ = 0",
    "acceleration",
    ("a", "qdd"),
    consistent=True,
)
def constraint_acceleration(at: Point) -> Iterator[Sides]:
    """Accelerations keep the constraints; γ as given, else as a and b say."""
    found = at.of("a") @ at.of("qdd")
    yield Sides("a q̈ ~ -γ", found, -drift(at), (constraints(at),), proportional)
