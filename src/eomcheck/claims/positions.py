"""Claims about positions of bodies and T: errors shared by both derivations of a scene.

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
from eomcheck.claims.registry import Comparison, EvaluationContext, case_claim, claim
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import sensitivity_of
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.evaluation.tolerance import NOTICEABLE, allowed_error, largest
from eomcheck.mechanics import records
from eomcheck.mechanics.records import Symmetry
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.dual import Dual, duals, rate, value
from eomcheck.numbers.generic import Array, NotRationalError, as_objects, map_entries, map_record
from eomcheck.numbers.lanes import lanes_in

# ---- Velocities of bodies ------------------------------------------------------------------------


def _linear_along(velocities: Callable, *arguments: Any) -> Any:
    """Return ∂V/∂v (n_b, d) along a direction, from (parameters, prepared, q, v, direction)."""
    *constants, v, direction = arguments
    return rate(velocities(*as_objects(tuple(constants)), duals(v, direction))[0])


def _angular_along(velocities: Callable, *arguments: Any) -> Any:
    """Return ∂ω/∂v (n_b, e) along a direction; see `_linear_along`."""
    *constants, v, direction = arguments
    return rate(velocities(*as_objects(tuple(constants)), duals(v, direction))[1])


def _rate_along_q(
    positions: Callable, parameters: Any, prepared: Any, rates: Any, q: Array, qdot: Array
) -> Any:
    """Return the rates of positions (n_b, d), m/s, from precomputed values, their rates, q, q̇."""
    changing = map_record(duals, prepared, rates)
    return rate(positions(as_objects(parameters), changing, duals(q, qdot)))


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
        left = of_masses - of_all
        try:
            weighs = not (left == 0 if exact else abs(left) <= NOTICEABLE * abs(of_all))
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
    literals: Any = object if lanes_in(at.q) else np.float64
    return np.array(shares, literals), literals


@claim(
    "position-velocity",
    "V² = ṙ² of each body",
    "(25), (26)",
    "velocity of a centre of mass",
    rate_of="r",
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
    # Perturbed samples and SIMD lanes follow the decision at the state itself.
    decides = context.exact or not (getattr(at, "is_perturbed", False) or lanes_in(at.q))
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
    return np.stack([np.asarray(at.run(along, *arguments, x), np.float64) for x in axes], -1)


def _moves(e: Evaluation) -> tuple[Array, Array]:
    """Return ∂V/∂v (n_b, d, n) and the rates of heights (n_b, components, n)."""
    heights, axes = _Heights(e, np.float64), np.eye(e.scene.n)
    h = np.stack([np.asarray(heights.of_each(x), np.float64) for x in axes], -1)
    return _along_each(e, _linear_along), h


@case_claim(
    "height-velocity", "|ḣ| ≤ |V| of each body", "(25), (26)", "velocity of a centre of mass"
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
    return {axis: [of[axis] for of in points.values() if axis in of] for axis in "xyz"}


def _in_turning_frame(at: Evaluation, J: Array, cartesian: list[int]) -> bool:
    """Return whether the directions of Cartesian coordinates turn: they are none in fixed axes.

    Directions that differ at another position, with the same lengths and angles between them, have
    turned.

    Args:
        at: the state.
        J: ∂V/∂v (n_b, d, n) there.
        cartesian: indices of the Cartesian coordinates.
    """
    others = np.setdiff1d(np.arange(at.scene.n), cartesian)
    q = at.q.copy()
    q[others] += ELSEWHERE
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
    scene, q, v, places = at.scene, at.q, at.v, _cartesian_coordinates(at.scene)
    if not places:
        return
    V, omega = at.run(scene.velocities, at.parameters, at.prepared, q, np.zeros_like(v))
    if np.any(V) or np.any(omega):
        return  # driven by the clock
    J, turns = (_along_each(at, along) for along in (_linear_along, _angular_along))
    if not (np.isfinite(J).all() and np.isfinite(turns).all()):
        return
    cartesian = [i for of in places.values() for i in of]
    if turns[:, :, cartesian].any() or not J[:, :, cartesian].any(axis=(1, 2)).all():
        return
    if _in_turning_frame(at, J, cartesian):
        return
    shifted = q.copy()
    for axis, shift in zip("xyz", SHIFT, strict=True):
        shifted[places[axis]] += shift
    yield Symmetry("translation", scene, shifted, v, np.eye(scene.n))
    angles = np.arange(scene.n)[scene.angle_coordinates]
    level = J.shape[1] == 2 and turns.shape[1] == 1 and not places["z"]
    if not level or len(angles) + len(cartesian) < scene.n:
        return
    heading, _, rank, _ = np.linalg.lstsq(turns[:, 0, angles], np.ones(len(turns)))
    if rank < len(angles) or largest(turns[:, 0, angles] @ heading - 1.0) > NOTICEABLE:
        return  # some body does not turn, or at another rate, or its angles are not determined
    image = np.eye(scene.n)
    c, s = np.cos(records.TURN), np.sin(records.TURN)
    for x, y in zip(places["x"], places["y"], strict=True):
        image[np.ix_((x, y), (x, y))] = [[c, -s], [s, c]]
    turned = image @ q
    turned[angles] += records.TURN * heading
    yield Symmetry("rotation", scene, turned, image @ v, image)


def _kinetic_energy(e: Evaluation) -> Any:
    return e.run(e.scene.energies, e.parameters, e.prepared, e.q, e.v)[0]


@case_claim("moved-energy", "T stays as the scene is moved", "(25)", "kinetic energy")
def moved_energy(case: Case) -> Iterator[Finding]:
    """T is the same for the scene turned, shifted or mirrored, see `tried_motions`."""
    at = case.at
    declared = tuple(at.scene.symmetries(at.q, at.v))
    names = {symmetry.name for symmetry in declared}
    for symmetry in (*declared, *(x for x in tried_motions(at) if x.name not in names)):
        there = Evaluation(symmetry.scene, symmetry.q, symmetry.v, at.t)
        actual, expected = (np.array([float(_kinetic_energy(e))]) for e in (there, at))
        sensitivity = float(expected[0])
        if not abs(actual[0] - expected[0]) <= allowed_error(sensitivity):
            # A larger sensitivity only allows more.
            each_way = (sensitivity_of(e, _kinetic_energy, coordinates=True) for e in (at, there))
            sensitivity = sum(each_way)
        finding = case.compare(symmetry.name, actual, expected, sensitivity, names=(("T",),))
        if finding.verdict == "failed" and symmetry.name not in names:
            finding = finding.because("coordinates called x, y, z are places in fixed directions")
        yield finding
