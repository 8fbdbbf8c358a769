"""Claims about single terms and positions of bodies: M, B, Q, a, b, gamma, T and U.

Terms written by hand are compared with derivatives of T, U, R and the constraints by automatic
differentiation (dual numbers), along virtual displacements, and with engines.

M and T may be derived from the same wrong velocity V, and then agree. Independent of that velocity
are the positions of bodies, their heights (the derivatives of U by mass and gravity), and rigid
motions of the whole scene, which leave T unchanged.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import numpy as np

from eomcheck.claims.case import Case
from eomcheck.claims.finding import Finding
from eomcheck.claims.registry import (
    Comparison,
    EvaluationContext,
    GenericPoint,
    along_directions,
    case_claim,
    claim,
    names_of_term,
    product_size,
)
from eomcheck.claims.user_scenes import undefined_result
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import sensitivity_of
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.evaluation.tolerance import HUGE, NOTICEABLE, allowed_error, largest
from eomcheck.mechanics import records
from eomcheck.mechanics.records import Symmetry
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.batch_arrays import as_float64, batch_size
from eomcheck.numbers.dual import Dual, constant, duals, rate, value
from eomcheck.numbers.generic import Array, NotRationalError, as_objects, map_entries, map_record

# ---- Single terms --------------------------------------------------------------------------------


@case_claim("finite-terms", "M, Q, B, a, gamma are finite", "(2)-(5)", "term that is not finite")
def finite_terms(case: Case) -> Iterator[Finding]:
    """Every term is finite, unless the state itself is so large that it overflows.

    A user-supplied function that returns NaN fails too, where the terms do not depend on it.
    """
    at = case.at
    with_inputs = [x for x in at.parameters if x is not None] + [at.q, at.v]
    overflow = max(largest(x) for x in with_inputs) > HUGE
    for name, term in at.terms._asdict().items():
        if term is not None and not (overflow and not np.isfinite(term).all()):
            zero = np.zeros(np.shape(term))
            bad = np.where(np.isfinite(term), 0.0, np.inf)
            yield case.compare(name, bad, zero, 0.0, names=names_of_term(at.scene, name))
    if case.finite and not overflow and (why := undefined_result(at.scene, at)):
        yield case.finding("functions", np.inf, 0.0, "failed", "property-tested", why)


@claim("mass-matrix", "M = ∂²T/∂q̇²", "(5), (25)", "mass matrix", asks="mass_matrix")
def mass_matrix(at: GenericPoint, context: EvaluationContext) -> Iterator[Comparison]:
    """M v is the derivative of T by v in any direction, and M is symmetric."""
    M, v = at.terms.M, at.free.v

    def change(direction: Array) -> tuple[Any, Any]:
        T, _ = at.scene.energies(at.parameters, at.prepared, at.q, duals(v, direction))
        return direction @ M @ v, rate(T)

    yield from along_directions(context, "M v", change)
    yield Comparison("M", M, M.T, (at.scene.coordinate_names,) * 2)


@claim("bias", "B = d/dt ∂T/∂q̇ - ∂T/∂q at q̈ = 0", "(5), (25)", "bias", rate_of="B", asks="bias")
def bias(at: GenericPoint, context: EvaluationContext) -> Iterator[Comparison]:
    """B is the left side of Lagrange's equations at q̈ = 0, along any virtual displacement."""
    v, B = at.free.v, at.free.terms.B
    prepared, q = at.prepared_duals(v)
    steady = constant(prepared), constant(q)

    def work(direction: Array) -> tuple[Any, Any]:
        T, _ = at.scene.energies(at.parameters, *steady, duals(v, direction))
        T_aside, _ = at.scene.energies(at.parameters, *at.prepared_duals(direction, clock=False), v)
        return 0 if B is None else direction @ B, rate(rate(T)) - rate(T_aside)

    return along_directions(context, "B", work)


@claim(
    "generalized-forces",
    "Q = -∂U/∂q - ∂R/∂q̇",
    "(26)-(27)",
    "generalized forces",
    rate_of="Q",
    asks="forces",
    needs="forces",
)
def generalized_forces(at: GenericPoint, context: EvaluationContext) -> Iterator[Comparison]:
    """Q is minus the derivatives of U by q and of R by v, along any virtual displacement."""
    Q = at.terms.Q

    def work(direction: Array) -> tuple[Any, Any] | None:
        _, U = at.scene.energies(at.parameters, *at.prepared_duals(direction, clock=False), at.v)
        R = at.dissipation(duals(at.v, direction))
        if U is None and R is None and Q is None:
            return None
        expected = (0 if U is None else -rate(U)) - (0 if R is None else rate(R))
        return 0 if Q is None else direction @ Q, expected

    return along_directions(context, "Q", work)


def _constraints(subject: str, at: Quantities) -> Iterator[Comparison]:
    """Yield the comparison a v + b = c, unless both sides are absent."""
    v, a, b = at.v, at.terms.a, at.terms.b
    expected = at.call(at.scene.constraint, at.parameters, at.prepared, at.q, v)
    if a is None and expected is None:
        return
    zero = np.zeros(at.scene.r, object)
    actual = zero if a is None else a @ v if b is None else a @ v + b
    expected = zero if expected is None else expected
    terms = product_size(expected) if a is None else product_size(a, v) + product_size(b)
    yield Comparison(subject, actual, expected, (at.scene.constraint_names,), terms)


@claim(
    "constraint-jacobian",
    "a = ∂c/∂q̇",
    "(2), (28)",
    "constraint Jacobian",
    asks="constraint_jacobian",
    needs="constraints",
)
def constraint_jacobian(at: Quantities, context: EvaluationContext) -> Iterator[Comparison]:
    """The constraints are a v + b for every v, and none is left out."""
    return _constraints("a", context.free)


@claim(
    "constraint-velocity",
    "a q̇ + b = c(q, q̇, t)",
    "(2)",
    "constraints at velocity level",
    provable=False,
    needs="constraints",
)
def constraint_velocity(at: Quantities, context: EvaluationContext) -> Iterator[Comparison]:
    """The constraints are a v + b, without any engine."""
    return _constraints("c", context.free)


def _rate_along_q(
    function: Callable, parameters: Any, prepared: Any, rates: Any, q: Array, qdot: Array
) -> Any:
    """Return the rate of residuals or positions from precomputed values, their rates, q and q̇."""
    changing = map_record(duals, prepared, rates)
    return rate(function(as_objects(parameters), changing, duals(q, qdot)))


@claim(
    "position-rate",
    "dΦ/dt = a q̇ + b, Φ = 0 where closed",
    "(2)",
    "rate of closed positions",
    rate_of="Φ",
    needs="loop closures (`Scene.position_residual`)",
)
def position_rate(at: Quantities, context: EvaluationContext) -> Iterator[Comparison]:
    """Holonomic constraints are the rates of the loop-closure residuals Φ."""
    scene, rows = at.scene, at.scene.holonomic
    residual, names = scene.position_residual, scene.constraint_names[rows]
    if residual is None or at.terms.a is None:
        return

    def rates(qdot: Array, clock: bool = True) -> Array:
        arguments = at.parameters, *at.prepared_and_rates(qdot, clock), at.q, qdot
        return at.run(_rate_along_q, residual, *arguments)

    if context.exact:
        v = context.free.v
        expected = scene.constraint(at.parameters, at.prepared, at.q, v)[rows]
        yield Comparison("Φ", rates(v), expected, (names,))
        return
    # At a consistent velocity every rate is 0: use each coordinate direction instead.
    over_coordinates = np.array([rates(axis, False) for axis in context.directions]).T
    yield Comparison("∂Φ/∂q", over_coordinates, at.terms.a[rows], (names, scene.coordinate_names))
    if scene.depends_on_time:
        b = (np.zeros(scene.r) if at.terms.b is None else at.terms.b)[rows]
        yield Comparison("∂Φ/∂t", rates(np.zeros(scene.n)), b, (names,), may_vanish=True)


@claim(
    "constraint-drift",
    "gamma = ȧ q̇ + ḃ",
    "(3)",
    "constraint drift",
    rate_of="gamma",
    asks="constraint_drift",
    needs="constraints",
)
def constraint_drift(at: GenericPoint, context: EvaluationContext) -> Iterator[Comparison]:
    """The drift gamma is the rate of the constraints at v̇ = 0, for every v."""
    free = at.free
    if at.terms.a is None:
        return
    changing = at.scene.constraint(at.parameters, *at.prepared_duals(free.v), free.v)
    yield Comparison("gamma", free.terms.gamma, rate(changing), (at.scene.constraint_names,))


@claim("kinetic-energy", "½ q̇ᵀ M q̇ = T", "(5), (25)", "kinetic energy")
def kinetic_energy(at: Quantities, context: EvaluationContext) -> Iterator[Comparison]:
    """The quadratic form vᵀ M v is 2 T for every v."""
    v = context.free.v
    momentum = at.terms.M @ v
    T, _ = at.call(at.scene.energies, at.parameters, at.prepared, at.q, v)
    yield Comparison("T", v @ momentum, 2 * T, (), product_size(v, momentum))


# ---- Velocities of bodies ------------------------------------------------------------------------


def _linear_along(velocities: Callable, *arguments: Any) -> Any:
    """Return ∂V/∂v (n_b, d) along a direction, from (parameters, prepared, q, v, direction)."""
    *constants, v, direction = arguments
    return rate(velocities(*as_objects(tuple(constants)), duals(v, direction))[0])


def _angular_along(velocities: Callable, *arguments: Any) -> Any:
    """Return ∂ω/∂v (n_b, e) along a direction; see `_linear_along`."""
    *constants, v, direction = arguments
    return rate(velocities(*as_objects(tuple(constants)), duals(v, direction))[1])


def _rate_of_height(
    axis: int,
    potential: Callable,
    parameters: Any,
    prepared: Any,
    rates: Any,
    q: Array,
    qdot: Array,
    masses: Array,
) -> Array:
    """Return the rates (2,) of ∂²U/∂g∂m along `masses` (n_b,), and of ∂U/∂g: of heights, m/s.

    Dual numbers are nested by derivative: that by q is outermost, that by the mass follows.

    Args:
        axis: component of gravity.
        potential: function of a scene.
        parameters: of the scene, `mass` and `gravity` among them.
        prepared: precomputed values of the scene.
        rates: their rates.
        q: coordinates (n,).
        qdot: their rates (n,).
        masses: changes of the masses (n_b,).
    """
    parameters = as_objects(parameters)
    mass = map_entries(lambda m, change: Dual(Dual(m, change)), parameters.mass, masses)
    along = np.array([int(i == axis) for i in range(len(parameters.gravity))], object)
    gravity = map_entries(lambda g, change: Dual(Dual(Dual(g, change))), parameters.gravity, along)
    weighed = parameters._replace(mass=mass, gravity=gravity)
    of_q = rate(potential(weighed, map_record(duals, prepared, rates), duals(q, qdot)))
    return np.array([rate(rate(of_q)), rate(value(of_q))], object)


@cache
def potential_function(energies: Callable) -> Callable:
    """Return U as a function of (parameters, prepared, q), for a scene that defines `energies`."""

    def potential(parameters: Any, prepared: Any, q: Array) -> Any:
        return energies(parameters, prepared, q, np.zeros(np.shape(q), object))[1]

    return potential


class _Heights:
    """The heights of bodies, as derivatives of U by masses and gravity.

    They exist if the scene has parameters `mass` and `gravity`. A gravity of d components
    determines the whole position, a single number the height along one, unknown direction.
    """

    def __init__(self, e: Quantities, numbers: type):
        self._e, self._numbers = e, numbers
        gravity: Any = getattr(e.parameters, "gravity", None)
        mass: Any = getattr(e.parameters, "mass", None)
        exist = np.ndim(gravity) == np.ndim(mass) == 1  # None has no dimension
        self.bodies = np.shape(mass)[0] if exist else 0
        self.components = np.shape(gravity)[0] if self.bodies else 0

    def rates(self, moving: tuple, masses: Array) -> list[Array]:
        """Return the rates (2,) of `_rate_of_height` for each component of gravity.

        Args:
            moving: precomputed values, their rates, q (n,) and q̇ (n,).
            masses: changes of the masses (n_b,).
        """
        e, axes = self._e, range(self.components)
        scene = e.scene
        U = (
            scene.potential
            if "energies" in scene.derived_functions
            else potential_function(scene.energies)
        )
        arguments = U, e.parameters, *moving, masses
        return [e.run(_rate_of_height, axis, *arguments) for axis in axes]

    def moving(self, qdot: Array) -> tuple:
        """Return the first argument of `rates` for q changing along a direction (n,)."""
        e = self._e
        return *e.prepared_and_rates(qdot, False), e.q, qdot

    def of_each(self, qdot: Array) -> list[list[Any]]:
        """Return the rates of the heights of each body along a direction (n,)."""
        moving, units = self.moving(qdot), np.eye(self.bodies, dtype=self._numbers)
        return [[x[0] for x in self.rates(moving, unit)] for unit in units]


def _weighs_bodies_only(at: Quantities, heights: _Heights, direction: Array, exact: bool) -> bool:
    """Return whether gravity acts in U in proportion to the masses of the bodies alone.

    Otherwise other parameters have weight too, and a derivative by a mass need not be a height.
    """
    for pair in heights.rates(heights.moving(direction), at.parameters.mass):
        of_masses, of_all = pair
        of_others = of_masses - of_all
        try:
            weighs = not (of_others == 0 if exact else abs(of_others) <= NOTICEABLE * abs(of_all))
        except NotRationalError:
            continue  # degree bounds equal nothing; they bound sides that may be skipped
        if weighs:
            return False
    return True


def _moving_along(context: Any, at: Quantities) -> tuple[Array, type]:
    """Return a direction (n,) with components of all coordinates, and the type of its literals."""
    shares = [(-1) ** i * (i + 1) for i in range(at.scene.n)]
    if context.exact:
        direction: Any = sum(x * k for x, k in zip(context.directions, shares, strict=False))
        return direction, object
    literals: Any = object if batch_size(at.q) else np.float64
    return np.array(shares, literals), literals


@claim(
    "position-velocity",
    "V² = ṙ² of each body",
    "(25), (26)",
    "velocity of a centre of mass",
    rate_of="r",
    needs="positions of its bodies",
)
def position_velocity(at: Quantities, context: EvaluationContext) -> Iterator[Comparison]:
    """V of a body is the rate of its position: by `positions`, and by the heights in U."""
    direction, literals = _moving_along(context, at)
    heights, positions = _Heights(at, literals), at.scene.positions
    if positions is None and heights.components < 2:
        return
    V = at.run(
        _linear_along, at.scene.velocities, at.parameters, at.prepared, at.q, at.v, direction
    )
    if positions is not None:
        arguments = at.parameters, *at.prepared_and_rates(direction, False), at.q, direction
        r = at.run(_rate_along_q, positions, *arguments)
        for k in range(len(V)):
            yield Comparison(f"body {k + 1}", _squared(V[k]), _squared(r[k]), SQUARE)
    if not heights.components == V.shape[1] > 1:
        return
    # A batch, also of perturbed samples, follows the decision at the states themselves.
    decides = context.exact or not batch_size(at.q)
    if not decides or _weighs_bodies_only(at, heights, direction, context.exact):
        for k, rates in enumerate(heights.of_each(direction)):
            yield Comparison(f"body {k + 1}, U", _squared(V[k]), _squared(rates), SQUARE)


SQUARE = (("V²",),)


def _squared(a: Any) -> Array:
    """Return the squared length of a vector, as an array (1,)."""
    square = np.empty(1, object)
    square[0] = sum(x * x for x in a)
    return square


def _along_each(at: Evaluation, along: Callable) -> Array:
    """Return ∂V/∂v (n_b, d, n) or ∂ω/∂v (n_b, e, n), see `_linear_along`."""
    arguments = at.scene.velocities, at.parameters, at.prepared, at.q, at.v
    axes = np.eye(at.scene.n)
    return np.stack([as_float64(at.run(along, *arguments, x)) for x in axes], -1)


def _moves(e: Evaluation) -> tuple[Array, Array]:
    """Return ∂V/∂v (n_b, d, n) and the rates of heights (n_b, components, n)."""
    heights, axes = _Heights(e, np.float64), np.eye(e.scene.n)
    h = np.stack([as_float64(heights.of_each(x)) for x in axes], -1)
    return _along_each(e, _linear_along), h


@case_claim(
    "height-velocity",
    "|ḣ| ≤ |V| of each body",
    "(25), (26)",
    "velocity of a centre of mass",
    needs="weights in fewer directions than the bodies move in",
)
def height_velocity(case: Case) -> Iterator[Finding]:
    """The height of a body in U changes no faster than the body moves, whatever the velocity."""
    at = case.at
    heights = _Heights(at, np.float64)
    if not heights.components:
        return
    d = np.shape(at.run(at.scene.velocities, at.parameters, at.prepared, at.q, at.v)[0])[1]
    if heights.components == d > 1:
        return  # U determines the whole position, see `position_velocity`
    direction, _ = _moving_along(case, at)
    if not _weighs_bodies_only(at, heights, direction, exact=False):
        return
    J, h = at.cached(_moves)
    if not (np.isfinite(J).all() and np.isfinite(h).all()):
        return
    for k in range(heights.bodies):
        sizes = np.sqrt((J[k] ** 2).sum(axis=0) + (h[k] ** 2).sum(axis=0))
        scale = np.divide(1.0, sizes, out=np.zeros_like(sizes), where=sizes > 0)

        def left(e: Evaluation, k: int = k, scale: Array = scale) -> Array:
            J, h = (x[k] * scale for x in e.cached(_moves))
            return J.T @ J - h.T @ h

        worst = np.linalg.eigh(left(at))[1][:, 0] * scale
        rise, speed = (float(((x[k] @ worst) ** 2).sum()) for x in (h, J))
        n = at.scene.n
        sensitivity = 2.0 * n
        if rise - speed > allowed_error(sensitivity):  # a larger sensitivity only allows more
            sensitivity += n * sensitivity_of(at, left)
        # The velocity is scaled to entries of one size: no body moves faster than 1.
        sides = np.array([max(rise, speed)]), np.array([speed])
        yield case.compare(f"body {k + 1}", *sides, sensitivity, names=HEIGHT, scale=1.0)


HEIGHT = (("ḣ² of its height in U",),)


# ---- Motions of the whole scene ------------------------------------------------------------------

SHIFT = *records.SHIFT, 1.5
"""Translation of the whole scene along x, y, z, m."""
PLACE = re.compile("([xyz])(_.*|[0-9]*)")
"""Names of Cartesian coordinates in fixed directions: x, y_2, z1."""
ELSEWHERE = 0.7
"""Displacement of the other coordinates in the test whether directions turn with them, rad or m."""


def _cartesian_coordinates(scene: Scene) -> dict[str, list[int]]:
    """Return the indices of coordinates called x, y and z, or x_1, y_1 and so on, by direction.

    Empty if some point has an x and no y: x may be a position along a rail.
    """
    angles = set(range(scene.n)[scene.angle_coordinates])
    points: dict[str, dict[str, int]] = {}
    for i, name in enumerate(scene.coordinate_names):
        match = PLACE.fullmatch(name)
        if i not in angles and match is not None:
            points.setdefault(match[2], {})[match[1]] = i
    if any(not {"x", "y"} <= axes.keys() for axes in points.values()):
        return {}
    return {
        axis: [indices[axis] for indices in points.values() if axis in indices] for axis in "xyz"
    }


def _in_turning_frame(at: Evaluation, J: Array, cartesian: list[int]) -> bool:
    """Return whether the directions of Cartesian coordinates turn: they are none in fixed axes.

    Directions that differ at another position, with the same lengths and angles between them, have
    turned.

    Args:
        at: the state.
        J: ∂V/∂v (n_b, d, n) there.
        cartesian: indices of the Cartesian coordinates.
    """
    other_coordinates = np.setdiff1d(np.arange(at.scene.n), cartesian)
    q = at.q.copy()
    q[other_coordinates] += ELSEWHERE
    elsewhere = _along_each(Evaluation(at.scene, q, at.v, at.t), _linear_along)
    before, after = J[..., cartesian], elsewhere[..., cartesian]

    def differ(a: Array, b: Array) -> Array:
        return np.abs(a - b).max(axis=(1, 2)) > NOTICEABLE * np.abs(a).max(axis=(1, 2))

    turned = differ(before, after) & ~differ(*(x.swapaxes(1, 2) @ x for x in (before, after)))
    return bool(turned.any())


def tried_motions(at: Evaluation) -> Iterator[Symmetry]:
    """Yield the rigid motions of a whole scene that leave T unchanged but are not in `symmetries`.

    Coordinates called x, y and z are taken as Cartesian coordinates in fixed directions. No motion
    is yielded if the clock drives bodies, if some body does not move with these coordinates or
    turns with them, or if they belong to a frame that turns; no rotation in the plane if lengths
    are among the other coordinates, if bodies do not turn with the angles, or if the angles that
    turn them are not determined.
    """
    scene, q, v, coordinates = at.scene, at.q, at.v, _cartesian_coordinates(at.scene)
    if not coordinates:
        return
    V, omega = at.run(scene.velocities, at.parameters, at.prepared, q, np.zeros_like(v))
    if np.any(V) or np.any(omega):
        return  # driven by the clock
    J, turns = (_along_each(at, along) for along in (_linear_along, _angular_along))
    if not (np.isfinite(J).all() and np.isfinite(turns).all()):
        return
    cartesian = [i for indices in coordinates.values() for i in indices]
    if turns[:, :, cartesian].any() or not J[:, :, cartesian].any(axis=(1, 2)).all():
        return
    if _in_turning_frame(at, J, cartesian):
        return
    shifted = q.copy()
    for axis, shift in zip("xyz", SHIFT, strict=True):
        shifted[coordinates[axis]] += shift
    yield Symmetry("translation", scene, shifted, v, np.eye(scene.n))
    angles = np.arange(scene.n)[scene.angle_coordinates]
    level = J.shape[1] == 2 and turns.shape[1] == 1 and not coordinates["z"]
    if not level or len(angles) + len(cartesian) < scene.n:
        return
    heading, _, rank, _ = np.linalg.lstsq(turns[:, 0, angles], np.ones(len(turns)))
    if rank < len(angles) or largest(turns[:, 0, angles] @ heading - 1.0) > NOTICEABLE:
        return  # some body does not turn, or at another rate, or its angles are not determined
    image = np.eye(scene.n)
    c, s = np.cos(records.TURN), np.sin(records.TURN)
    for x, y in zip(coordinates["x"], coordinates["y"], strict=True):
        image[np.ix_((x, y), (x, y))] = [[c, -s], [s, c]]
    turned = image @ q
    turned[angles] += records.TURN * heading
    yield Symmetry("rotation", scene, turned, image @ v, image)


def _kinetic_energy(e: Evaluation) -> Any:
    """Return T of the scene at an evaluation."""
    return e.run(e.scene.energies, e.parameters, e.prepared, e.q, e.v)[0]


@case_claim(
    "moved-energy",
    "T stays as the scene is moved",
    "(25)",
    "kinetic energy",
    needs="a motion of the whole scene",
)
def moved_energy(case: Case) -> Iterator[Finding]:
    """T is the same for the scene turned, shifted or mirrored, see `tried_motions`."""
    at = case.at
    declared = tuple(at.scene.symmetries(at.q, at.v))
    names = {symmetry.name for symmetry in declared}
    for symmetry in (*declared, *(x for x in tried_motions(at) if x.name not in names)):
        mapped = Evaluation(symmetry.scene, symmetry.q, symmetry.v, at.t)
        actual, expected = (np.array([float(_kinetic_energy(e))]) for e in (mapped, at))
        sensitivity = float(expected[0])
        if not abs(actual[0] - expected[0]) <= allowed_error(sensitivity):
            # A larger sensitivity only allows more.
            each_way = (sensitivity_of(e, _kinetic_energy, coordinates=True) for e in (at, mapped))
            sensitivity = sum(each_way)
        finding = case.compare(symmetry.name, actual, expected, sensitivity, names=(("T",),))
        if finding.verdict == "failed" and symmetry.name not in names:
            finding = finding.because("coordinates called x, y, z are places in fixed directions")
        yield finding
