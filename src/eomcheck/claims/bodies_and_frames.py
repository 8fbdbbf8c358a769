"""Claims about conformance quantities: centre of mass, momentum, frames, Coriolis, regressor.

Each quantity is the rate of another, a product with v, or equal to a term of the scene. Rates are
those of dual numbers, along q̇ = v and v̇ any acceleration. The tree of bodies is a derivation of
its own: what it has in common with the terms of the scene is independent evidence of both.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from eomcheck.claims.registry import Comparison, EvaluationContext, claim, product_size
from eomcheck.claims.terms_and_positions import potential_function
from eomcheck.descriptions.described_scene import Described, parse_description
from eomcheck.evaluation.conformance import AXIS_NAMES, SPATIAL_NAMES, ConformancePoint
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.dual import Dual, duals, rate
from eomcheck.numbers.generic import Array, as_objects, map_entries, map_record

TREE = "a tree of bodies (`Scene.tree`)"
"""Requirement of claims about conformance quantities."""

EVERY = 4
"""Only each such state of a run is checked: these claims are proved for all states."""

tree_claim = partial(claim, needs=TREE, batchable=False, every=EVERY)
"""Decorator of a claim about the tree of bodies."""


def _point(at: Quantities, context: EvaluationContext) -> ConformancePoint | None:
    """Return the point at a velocity that need not be consistent; None for a scene without a tree.

    The acceleration is the sum of all directions: random in exact numbers, ones in float64.
    """
    points = at.cached(_points)
    if not points:
        points.append(ConformancePoint(context.free, np.sum(context.directions, axis=0), at))
    return points[0] if points[0].has_tree else None


def _points(at: Quantities) -> list[ConformancePoint]:
    """Return the list that keeps the point of all claims here."""
    return []


@tree_claim(
    "center-of-mass-rates",
    "c, ċ = J v, c̈ are rates of each other",
    "",
    "centre of mass",
)
def center_of_mass(at: Quantities, context: EvaluationContext) -> Iterator[Comparison]:
    """The velocity of the centre of mass is J v and the rate of its position; likewise c̈."""
    point = _point(at, context)
    if point is None:
        return
    center, rates = point.center, point.result("center_of_mass", rates=True)
    names = (AXIS_NAMES,)
    yield Comparison("J v", center.jacobian @ point.at.v, center.velocity, names, may_vanish=True)
    yield Comparison("ċ", center.velocity, rates.position, names, may_vanish=True)
    yield Comparison("c̈", center.acceleration, rates.velocity, names, may_vanish=True)


@tree_claim("momentum-rates", "h = A v, and ḣ is its rate", "", "momentum")
def momentum(at: Quantities, context: EvaluationContext) -> Iterator[Comparison]:
    """The momentum is A v, and its rate that of dual numbers."""
    point = _point(at, context)
    if point is None:
        return
    values, rates = point.momentum, point.result("momentum", rates=True)
    yield Comparison(
        "A v", values.matrix @ point.at.v, values.momentum, (SPATIAL_NAMES,), may_vanish=True
    )
    yield Comparison("ḣ", values.rate, rates.momentum, (SPATIAL_NAMES,), may_vanish=True)


@tree_claim("frame-rates", "V = J v, V̇ = J v̇ + J̇ v, rates of R and p", "", "frames")
def frame_motion(at: Quantities, context: EvaluationContext) -> Iterator[Comparison]:
    """The velocity of a frame is J v and the rate of its placement; its acceleration that of it."""
    point = _point(at, context)
    if point is None:
        return
    links, rates = point.links, point.result("link_motions", rates=True)
    names = point.model.links, SPATIAL_NAMES
    yield Comparison("J v", links.jacobian @ point.at.v, links.velocity, names, may_vanish=True)
    yield Comparison("ṗ", links.velocity[:, :3], rates.p, (names[0], AXIS_NAMES), may_vanish=True)
    turned = np.stack([_turned(w, R) for w, R in zip(links.velocity[:, 3:], links.R, strict=True)])
    yield Comparison("Ṙ", turned, rates.R, (names[0], AXIS_NAMES, AXIS_NAMES), may_vanish=True)
    yield Comparison("V̇", links.acceleration, rates.velocity, names, may_vanish=True)
    sides = links.jacobian @ point.vdot + links.bias, links.acceleration
    yield Comparison("J v̇ + J̇ v", *sides, names, may_vanish=True)


def _turned(omega: Any, R: Any) -> Any:
    """Return ω× R."""
    x, y, z = omega
    return np.stack([y * R[2] - z * R[1], z * R[0] - x * R[2], x * R[1] - y * R[0]])


def _weight_power(
    potential: Callable,
    description: Callable | None,
    parameters: Any,
    prepared: Any,
    rates: Any,
    q: Array,
    qdot: Array,
) -> Any:
    """Return dU/dt of the weight in a scene's U, while q moves by q̇.

    The weight is the part of U in proportion to gravity or, where that is no parameter, to the
    masses. Dual numbers are nested by derivative: that by q is outermost.

    Args:
        potential: U by (parameters, prepared, q).
        description: function that returns the `Description` of a described scene, whose gravity
            need not be a parameter; otherwise None.
        parameters: of the scene.
        prepared: precomputed values of the scene.
        rates: their rates.
        q: coordinates (n,).
        qdot: their rates (n,).
    """
    parameters = as_objects(parameters)
    if description is not None:
        parsed = parse_description(description, parameters)
        potential, parameters = parsed.functions["potential"], parsed.parameters
    name = "mass" if getattr(parameters, "gravity", None) is None else "gravity"
    weighed = parameters._replace(**{name: _scalable(getattr(parameters, name))})
    U = potential(weighed, map_record(duals, prepared, rates), duals(q, qdot))
    return rate(rate(U))


def _scalable(numbers: Any) -> Any:
    """Return numbers (1 + ε) as duals, without a rate outside; None stays None."""

    def entry(x: Any) -> Any:
        return None if x is None else Dual(Dual(x, x))

    return map_entries(entry, np.asarray(numbers, object)) if np.ndim(numbers) else entry(numbers)


@tree_claim("weight-gradient", "dU/dt = vᵀ ∂U/∂q of weight", "", "gravity")
def weight(at: Quantities, context: EvaluationContext) -> Iterator[Comparison]:
    """The potential energy of weight changes by its gradient, and as in the scene's U or Q."""
    point = _point(at, context)
    if point is None:
        return
    rates = point.result("weight", rates=True)
    yield Comparison("∂U/∂q", point.weight.gradient @ point.at.v, rates.U, (), may_vanish=True)
    scene, direction = at.scene, point.at.v + point.vdot
    weighs = any(getattr(at.parameters, name, None) is not None for name in ("gravity", "mass"))
    if not (weighs or isinstance(scene, Described)):
        return
    if context.exact and not point.has_own_numbers:
        return  # its variables are not the parameters of the scene
    moving = *at.prepared_and_rates(direction, False), at.q, direction
    power = at.run(_weight_power, *_potential_of(scene), at.parameters, *moving)
    gradient = point.weight.gradient
    size = product_size(gradient, direction)
    yield Comparison("U", gradient @ direction, power, (), size, may_vanish=True)


def _potential_of(scene: Scene) -> tuple[Callable, Callable | None]:
    """Return the function U of a scene, and its description if it is a described one."""
    derived = "energies" in scene.derived_functions
    potential = scene.potential if derived else potential_function(scene.energies)
    return potential, type(scene).description if isinstance(scene, Described) else None


def _rate_of_M(terms: Callable, parameters: Any, prepared: Any, rates: Any, q: Any, v: Any) -> Any:
    """Return Ṁ along q̇ = v."""
    arguments = map_record(duals, prepared, rates), duals(q, v), as_objects(v)
    return rate(terms(as_objects(parameters), *arguments).M)


@tree_claim("coriolis-identities", "C v = B, Ṁ = C + Cᵀ", "", "Coriolis matrix")
def coriolis_matrix(at: Quantities, context: EvaluationContext) -> Iterator[Comparison]:
    """The Coriolis matrix of the tree gives the scene's B, and Ṁ - 2 C is skew-symmetric."""
    point = _point(at, context)
    if point is None or (context.exact and not point.has_own_numbers):
        return  # its variables are not the parameters of the scene
    free, C = point.at, point.coriolis_matrix
    names = at.scene.coordinate_names
    size = product_size(C, free.v)  # rows may vanish
    yield Comparison("C v", C @ free.v, point.bias, (names,), size, may_vanish=True)
    arguments = free.parameters, *point.prepared_and_rates, free.q, free.v
    Mdot = free.run(_rate_of_M, at.scene.terms, *arguments)
    size = product_size(C)  # its diagonal vanishes where angles are absolute
    yield Comparison("Ṁ", C + C.T, Mdot, (names, names), size, may_vanish=True)


@tree_claim("regressor-identity", "Y π = τ = M v̇ + B + ∂U/∂q", "", "regressor")
def regressor(at: Quantities, context: EvaluationContext) -> Iterator[Comparison]:
    """The regressor times the bodies' parameters is inverse dynamics under weight alone.

    So is τ by the recursion of Newton and Euler, by which derivatives are formed.
    """
    point = _point(at, context)
    if point is None or (context.exact and not point.has_own_numbers):
        return
    Y, parameters, rotors = point.regressor
    torques = Y @ parameters + rotors
    expected = point.inertia_force + point.weight.gradient
    names = (at.scene.coordinate_names,)
    yield Comparison("Y π", torques, expected, names, may_vanish=True)
    recursive = point.result("inverse_dynamics")
    yield Comparison("τ", recursive, expected, names, may_vanish=True)
