"""The claims that are identities of rational functions: both sides of each, at a `Point`.

Every function yields the two sides of what a claim says, in whatever numbers the point has: random
elements of a field prove the identity, bounds tell its degree.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from eomcheck.claims import identities
from eomcheck.claims.claim import CLAIMS, numbered, pairs
from eomcheck.claims.point import Point
from eomcheck.errors import RefusedError
from eomcheck.evaluation.point import Quantities, Solution
from eomcheck.formulations import Formulation
from eomcheck.numbers.contract import Array
from eomcheck.numbers.dual import constant, duals, rate

Names = tuple[tuple[str, ...], ...]
Formulations = tuple[Formulation, ...]


class Sides(NamedTuple):
    """found = expected, about `subject`; `names` along each axis."""

    subject: str
    found: Any
    expected: Any
    names: Names


class Skipped(NamedTuple):
    """What could not be looked at, and why."""

    subject: str
    reason: str


Identity = Callable[[Point, Formulations], Iterator[Sides | Skipped]]

IDENTITIES: dict[str, Identity] = {}
"""Id of a claim -> its sides."""


def _always(at: Quantities) -> bool:
    """Return True."""
    return True


def _constrained(at: Quantities) -> bool:
    """Return whether there are constraints."""
    return at.terms.a is not None


NO_RATE = "`prepare` uses more than angles, roots and the clock, and its rate is not known"


def identity(
    claim: str, when: Callable[[Quantities], bool] = _always, rate_of: str | None = None
) -> Callable[[Identity], Identity]:
    """Register the decorated function as the two sides of `claim`.

    Args:
        claim: its id.
        when: where not, it says nothing.
        rate_of: the subject of the sides, if they need a rate of what `prepare` makes.
    """

    def register(sides: Identity) -> Identity:
        def look_at(at: Point, formulations: Formulations) -> Iterator[Sides | Skipped]:
            if when(at):
                if rate_of is None or at.can_move:
                    yield from sides(at, formulations)
                else:
                    yield Skipped(rate_of, NO_RATE)

        IDENTITIES[claim] = look_at
        return sides

    return register


Key = tuple[str, str]
"""Claim and subject."""


def look_at(at: Point, formulations: Formulations) -> Iterator[tuple[Key, Sides | Skipped]]:
    """Yield the sides of every identity at a point, in the order of `CLAIMS`."""
    for claim in CLAIMS:
        if claim in IDENTITIES:
            for sides in IDENTITIES[claim](at, formulations):
                yield (claim, sides.subject), sides


def _zeros(size: int) -> Array:
    return np.zeros(size, object)


def _speed_names(at: Point) -> tuple[str, ...]:
    return numbered("u_", at.scene.p)


# ---- Terms against energies and constraints ------------------------------------------------------


@identity("mass-matrix")
def mass_matrix(at: Point, _: Formulations) -> Iterator[Sides | Skipped]:
    """M v is the rate of T along any change of v; M itself is symmetric."""
    M, v = at.terms.M, at.free.v
    names = (at.scene.coordinate_names,)
    found, expected = [], []
    for direction in at.directions:
        T, _ = at.scene.energies(at.parameters, at.prepared, at.q, duals(v, direction))
        found.append(direction @ M @ v)
        expected.append(rate(T))
    yield Sides("M v", np.array(found, object), np.array(expected, object), (at.direction_names,))
    yield Sides("M", M, M.T, names * 2)


@identity("kinetic-energy")
def kinetic_energy(at: Point, _: Formulations) -> Iterator[Sides | Skipped]:
    """vᵀ M v = 2 T for every v."""
    v = at.free.v
    T, _ = at.scene.energies(at.parameters, at.prepared, at.q, v)
    yield Sides("T", v @ at.terms.M @ v, 2 * T, ())


@identity("bias", rate_of="B")
def bias(at: Point, _: Formulations) -> Iterator[Sides | Skipped]:
    """B is what Lagrange's equations leave at q̈ = 0, along any virtual displacement."""
    v, B = at.free.v, at.free.terms.B
    prepared, q = at.moving(v)
    steady = constant(prepared), constant(q)
    found, expected = [], []
    for direction in at.directions:
        T, _ = at.scene.energies(at.parameters, *steady, duals(v, direction))
        T_aside, _ = at.scene.energies(at.parameters, *at.moving(direction, clock=False), v)
        found.append(0 if B is None else direction @ B)
        expected.append(rate(rate(T)) - rate(T_aside))
    yield Sides("B", np.array(found, object), np.array(expected, object), (at.direction_names,))


@identity("generalized-forces", rate_of="Q")
def generalized_forces(at: Point, _: Formulations) -> Iterator[Sides | Skipped]:
    """Q is minus the rates of U and, by the change of velocity, of R along any displacement."""
    Q = at.terms.Q
    found, expected = [], []
    for direction in at.directions:
        _, U = at.scene.energies(at.parameters, *at.moving(direction, clock=False), at.v)
        R = at.dissipation(duals(at.v, direction))
        if U is None and R is None and Q is None:
            return
        found.append(0 if Q is None else direction @ Q)
        expected.append((0 if U is None else -rate(U)) - (0 if R is None else rate(R)))
    yield Sides("Q", np.array(found, object), np.array(expected, object), (at.direction_names,))


@identity("constraint-jacobian")
def constraint_jacobian(at: Point, _: Formulations) -> Iterator[Sides | Skipped]:
    """The constraints are a v + b for every v, and none is forgotten."""
    v, a, b = at.free.v, at.terms.a, at.free.terms.b
    expected = at.scene.constraint(at.parameters, at.prepared, at.q, v)
    if a is None and expected is None:
        return
    found = _zeros(at.scene.r) if a is None else a @ v if b is None else a @ v + b
    expected = _zeros(at.scene.r) if expected is None else expected
    yield Sides("a", found, expected, (at.scene.constraint_names,))


@identity("position-rate", lambda at: at.scene.position_residual is not None, rate_of="Φ")
def position_rate(at: Point, _: Formulations) -> Iterator[Sides | Skipped]:
    """Holonomic constraints are the rates of what vanishes at closed positions, for every v."""
    scene, v = at.scene, at.free.v
    assert scene.position_residual is not None
    found = rate(scene.position_residual(at.parameters, *at.moving(v)))
    expected = scene.constraint(at.parameters, at.prepared, at.q, v)[scene.holonomic]
    yield Sides("Φ", found, expected, (scene.constraint_names[scene.holonomic],))


@identity("constraint-drift", _constrained, rate_of="gamma")
def constraint_drift(at: Point, _: Formulations) -> Iterator[Sides | Skipped]:
    """gamma is the rate of the constraints at v̇ = 0, for every v."""
    free = at.free
    moved = at.scene.constraint(at.parameters, *at.moving(free.v), free.v)
    yield Sides("gamma", free.terms.gamma, rate(moved), (at.scene.constraint_names,))


# ---- Generalized speeds --------------------------------------------------------------------------


@identity("null-space-embedding", _constrained)
def null_space_embedding(at: Point, _: Formulations) -> Iterator[Sides | Skipped]:
    """The w of the embedding method spans the null space of a, for both partitions."""
    a, names = at.terms.a, (at.scene.constraint_names, numbered("v_2,", at.scene.p))
    for subject, partition in (("em", at.partition), ("em, drawn", at.other_partition)):
        if partition is None:
            continue
        try:
            w = identities.embedding(at, partition)
        except RefusedError as refusal:
            yield Skipped(subject, str(refusal))
        else:
            yield Sides(subject, a @ w, np.zeros((len(a), w.shape[1]), object), names)


@identity("null-space-speeds", _constrained)
def null_space_speeds(at: Point, _: Formulations) -> Iterator[Sides | Skipped]:
    """The w′ of the generalized speeds spans the null space of a."""
    a, W = at.terms.a, at.speeds.W
    names = (at.scene.constraint_names, _speed_names(at))
    yield Sides("ml, kane", a @ W, np.zeros((len(a), W.shape[1]), object), names)


@identity("speeds-velocity")
def speeds_velocity(at: Point, _: Formulations) -> Iterator[Sides | Skipped]:
    """The generalized speeds of v = w′ u + x′ are u, and that v satisfies the constraints."""
    found = at.scene.speeds_of(at.parameters, at.prepared, at.q, at.v)
    yield Sides("ml, kane", found, at.u, (_speed_names(at),))
    if at.scene.qdot is not None:
        yield Sides("q̇", at.qdot, at.v, (at.scene.coordinate_names,))
    a, b = at.terms.a, at.terms.b
    # Without b and x′ this is a w′ = 0.
    if a is not None and not (b is None and at.speeds.offset is None):
        left = a @ at.v if b is None else a @ at.v + b
        yield Sides("a q̇ + b", left, _zeros(len(a)), (at.scene.constraint_names,))


@identity("speeds-remainder")
def speeds_remainder(at: Point, _: Formulations) -> Iterator[Sides | Skipped]:
    """The part of q̈ left at u̇ = 0 is ẇ′u + ẋ′ and satisfies the constraints differentiated."""
    if at.terms.a is not None:
        names = (at.scene.constraint_names,)
        yield Sides("ml, kane", at.terms.a @ at.speeds.rest, -at.terms.gamma, names)
    if at.speeds.W is None:
        return
    if not at.can_move:
        yield Skipped("rest", NO_RATE)
    else:
        prepared, q = at.moving(at.v)
        shared = at.scene.kinematics(at.parameters, prepared, q, duals(at.u, _zeros(at.scene.p)))
        W, _, offset = at.scene.speeds(at.parameters, prepared, shared)
        expected = rate(W) @ at.u if offset is None else rate(W) @ at.u + rate(offset)
        yield Sides("rest", at.speeds.rest, expected, (at.scene.coordinate_names,))


@identity("active-forces")
def active_forces(at: Point, _: Formulations) -> Iterator[Sides | Skipped]:
    """Kane's active forces, from the bodies, are Lagrange's, projected."""
    if at.terms.Q is not None and at.bodies.force is not None:
        expected = identities.projected_forces(at)
        yield Sides("kane", at.bodies.force, expected, (_speed_names(at),))


@identity("kane-ml-mass")
def kane_ml_mass(at: Point, _: Formulations) -> Iterator[Sides | Skipped]:
    """Kane's and the modified Lagrange method have the same mass matrix."""
    found, expected = identities.kane_mass(at), identities.ml_system(at)[0]
    yield Sides("kane ~ ml", found, expected, (_speed_names(at),) * 2)


@identity("kane-ml-force")
def kane_ml_force(at: Point, _: Formulations) -> Iterator[Sides | Skipped]:
    """Kane's and the modified Lagrange method have the same right-hand side."""
    found, expected = identities.kane_force(at), identities.ml_system(at)[1]
    yield Sides("kane ~ ml", found, expected, (_speed_names(at),))


# ---- Whole accelerations -------------------------------------------------------------------------


def _solutions(at: Point, formulations: Formulations) -> Iterator[tuple[Formulation, Solution]]:
    for formulation in formulations:
        solution = at.solved(formulation)
        if solution is not None:
            yield formulation, solution


@identity("equations-residual")
def equations_residual(at: Point, formulations: Formulations) -> Iterator[Sides | Skipped]:
    """Each q̈ satisfies Eq. (5): with its own λ, or on every motion that the constraints allow."""
    M, a = at.terms.M, at.terms.a
    for f, (vdot, multipliers) in _solutions(at, formulations):
        inertia, names = M @ vdot, at.scene.coordinate_names
        if a is None:
            yield Sides(f.key, inertia, at.F, (names,))
        elif multipliers is not None:
            yield Sides(f.key, inertia, at.F + a.T @ multipliers, (names,))
        else:
            W = at.speeds.W
            yield Sides(f.key, W.T @ inertia, W.T @ at.F, (_speed_names(at),))


@identity("constraint-acceleration", _constrained)
def constraint_acceleration(at: Point, formulations: Formulations) -> Iterator[Sides | Skipped]:
    """Each q̈ satisfies the constraints differentiated."""
    for f, (vdot, _) in _solutions(at, formulations):
        yield Sides(f.key, at.terms.a @ vdot, -at.terms.gamma, (at.scene.constraint_names,))


@identity("equivalence")
def equivalence(at: Point, formulations: Formulations) -> Iterator[Sides | Skipped]:
    """All formulations give the same acceleration, pair by pair, whatever the partition."""
    names = (at.scene.coordinate_names,)
    solutions = tuple(_solutions(at, formulations))
    for (f, x), (g, y) in pairs(solutions):
        yield Sides(f"{f.key} ~ {g.key}", x.vdot, y.vdot, names)
    for f in formulations:
        if not f.partitioned or at.other_partition is None:
            continue
        if (other := at.solved(f, other=True)) is None:
            continue
        # Its own result by the paper's partition, or any other if that refuses.
        own = [x for g, x in solutions if g is f] or [x for _, x in solutions[:1]]
        for x in own:
            yield Sides(f"{f.key}, drawn", x.vdot, other.vdot, names)


@identity("multipliers", _constrained)
def multipliers(at: Point, formulations: Formulations) -> Iterator[Sides | Skipped]:
    """All formulations that have multipliers have the same, pair by pair."""
    solutions = tuple(_solutions(at, formulations))
    for f, x in solutions:
        yield Sides(f.key, int(x.multipliers is not None), int(f.multipliers), ())
    having = tuple((f, x) for f, x in solutions if x.multipliers is not None)
    for (f, x), (g, y) in pairs(having):
        names = (at.scene.constraint_names,)
        yield Sides(f"{f.key} ~ {g.key}", x.multipliers, y.multipliers, names)


@identity("power-balance")
def power_balance(at: Point, formulations: Formulations) -> Iterator[Sides | Skipped]:
    """Ideal constraints do no work: along each q̈ the energy loses what the dampers take."""
    R = at.dissipation(duals(at.v, at.v))
    if R is None and not at.scene.conserves_energy:
        return
    if not at.can_move:
        yield Skipped("all", NO_RATE)
        return
    prepared, q = at.moving(at.v)
    for f, (vdot, _) in _solutions(at, formulations):
        T, U = at.scene.energies(at.parameters, prepared, q, duals(at.v, vdot))
        lost = (0 if U is None else -rate(U)) - (0 if R is None else rate(R))
        yield Sides(f.key, rate(T), lost, ())
