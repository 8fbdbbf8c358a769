"""Derivatives of accelerations and multipliers by q, v and τ, exact by dual numbers.

The functions of a scene and a formulation are run on dual numbers (`eomcheck.numbers.dual`):
forward automatic differentiation, in any scalar type, in float64 in several directions at once. No
difference quotient is formed. A solve A x = b is differentiated as A x′ = b′ - A′ x.

Derivatives of constrained scenes are those of v̇ and λ as the KKT system

    M v̇ = F + aᵀλ,  a v̇ = -gamma

defines them at every (q, v), consistent or not. Formulations in generalized speeds or quasi-
velocities (ml, kane, banded) are functions of (q, u(q, v)): they drop the part of v that violates
the constraints. Their derivatives equal those of the others along variations that keep the
constraints to first order: a δq = 0 for holonomic rows, δ(a v + b) = 0 for all. Redundant
constraints are those of the state; λ is the smallest, and aᵀλ does not depend on this choice.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from eomcheck.errors import RefusedError
from eomcheck.evaluation.dynamics import with_redundancy_hint
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import (
    acceleration_sensitivity,
    check_consistent,
    measured_sensitivity,
    perturbed_samples,
    solution_of,
)
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.evaluation.tolerance import UNDERFLOW, allowed_error
from eomcheck.formulations import Formulation, Partition, au, formulation_for
from eomcheck.mechanics.scene import FUNCTIONS, Scene, checked_scene, finite_array
from eomcheck.numbers.dual import duals, rate
from eomcheck.numbers.generic import FLOAT64, Array, as_objects, generic, map_record

# ---- Directions -------------------------------------------------------------------------------


@dataclass(frozen=True)
class SceneFunctions:
    """The functions of a scene, its sizes and its support: hashable, as the key of a trace."""

    functions: tuple[tuple[str, Callable | None], ...]
    n: int
    r: int
    mask: tuple[tuple[bool, ...], ...] | None

    def __getattr__(self, name: str) -> Any:
        for key, function in self.functions:
            if key == name:
                return function
        raise AttributeError(name)

    @property
    def support(self) -> Array | None:
        """Mask of the generalized speeds that can move each body, see `Scene.support`."""
        return None if self.mask is None else np.array(self.mask)


def scene_functions(scene: Scene) -> SceneFunctions:
    """Return the functions of `scene`."""
    functions = tuple((x, getattr(scene, x)) for x in sorted(FUNCTIONS) if hasattr(scene, x))
    mask = None if scene.support is None else tuple(map(tuple, scene.support.tolist()))
    return SceneFunctions(functions, scene.n, scene.r, mask)


class Direction(NamedTuple):
    """Rates of q, v and tau, along which a quantity is differentiated: (n,), or k (k, n)."""

    q: Any
    v: Any
    tau: Any


class _DualQuantities(Quantities):
    """Quantities in dual numbers; arrays that are constant may be float64 in a user's scene."""

    def finished(self, record: Any) -> Any:
        return map_record(_dual_array, record)


def _dual_array(x: Any) -> Any:
    return np.asarray(x, object) if isinstance(x, np.ndarray) and x.ndim else x


def quantities_along(
    scene: Any, parameters: Any, q: Array, v: Array, tau: Array, *along: Any
) -> Quantities:
    """Return the quantities of a scene in dual numbers.

    Args:
        scene: the scene, or its functions.
        parameters: its parameters, which are constant.
        q: coordinates (n,).
        v: velocities (n,).
        tau: forces (n,).
        along: precomputed values and their rates, and the rates of q, v and tau, (n,) each.
    """
    prepared, prepared_rates, *rates = along
    q, v, tau = map(duals, (q, v, tau), rates)
    at = _DualQuantities(scene, FLOAT64, q)  # which computes nothing: all numbers are there
    at.parameters, at.prepared = as_objects(parameters), map_record(duals, prepared, prepared_rates)
    at.v, at.tau = v, tau
    return at


def _solution_rates(formulation: Formulation, partition: Partition, *inputs: Any) -> Any:
    """Return the rates of v̇ and λ; `inputs` as of `quantities_along`."""
    return map_record(rate, tuple(quantities_along(*inputs).solution(formulation, partition)))


def _inverse_rates(vdot: Array, *inputs: Any) -> Any:
    """Return the rates of M v̇ - F (n,) at constant v̇; `inputs` as of `quantities_along`."""
    at = quantities_along(*inputs)
    return rate(at.terms.M @ vdot - at.F)


def _differentiated(
    at: Quantities, key: str, function: Callable, constants: tuple, directions: Direction
) -> Any:
    """Return the results of a function of `constants` and the arguments of `quantities_along`.

    They are stacked, one for each of k directions; `key` names the matrices that are solved.
    """
    tau = np.zeros(at.scene.n, at.q.dtype) if at.tau is None else at.tau
    shared = *constants, scene_functions(at.scene), at.parameters, at.q, at.v, tau
    varied = *at.rates_along(directions.q), *directions
    return at.run_for_each(key, function, shared, varied)


def solutions_along(
    at: Quantities,
    formulation: Formulation,
    directions: Direction,
    partition: Partition | None = None,
    key: str = "solutions",
) -> tuple[Any, Any]:
    """Return the derivatives of v̇ (k, n) and of λ (k, r), or None, along k directions.

    Args:
        at: the state, in any scalar type; its `tau` counts.
        formulation: the formulation.
        directions: rates (k, n) in the numbers of `at`.
        partition: the partition, by default the paper's.
        key: name under which the matrices are recorded.

    Raises:
        RefusedError: as `Quantities.rates`.
    """
    constants = formulation, at.partition if partition is None else partition
    return _differentiated(at, key, _solution_rates, constants, directions)


def solution_along(
    at: Quantities,
    formulation: Formulation,
    direction: Direction,
    partition: Partition | None = None,
) -> tuple[Any, Any]:
    """Return the derivatives of v̇ (n,) and of λ (r,), or None, along a direction (n,) each.

    See `solutions_along`.
    """
    both = solutions_along(at, formulation, _as_stack(direction), partition)
    return map_record(lambda x: x[0], both)


def _as_stack(direction: Direction) -> Direction:
    return Direction(*(np.reshape(x, (1, -1)) for x in direction))


def unit_directions(n: int, parts: Sequence[str] = Direction._fields) -> Direction:
    """Return the directions of the entries of q, v and tau, or of some of these, in order."""
    order = {part: i for i, part in enumerate(parts)}
    directions = np.zeros((len(Direction._fields), len(order), n, n))
    for i, part in enumerate(Direction._fields):
        if part in order:
            directions[i, order[part]] = np.eye(n)
    return Direction(*directions.reshape(len(directions), -1, n))


AT_ONCE = 16
"""Number of directions that are differentiated at once: more take more memory, and no less time."""


def for_each_direction(
    at: Quantities, directions: Direction, function: Callable[[str, Direction], Any]
) -> Any:
    """Return the results of a function of a key and `AT_ONCE` directions, for all of them.

    In all directions the same noise perturbs them: to draw it anew would take most of the time.
    """
    results = []
    for first in range(0, len(directions.q), AT_ONCE):
        part = Direction(*(x[first : first + AT_ONCE] for x in directions))
        with at.computing("direction"):
            results.append(function(f"directions from {first}", part))
    return map_record(lambda *parts: np.concatenate(parts), *results)


def _violation_rates(*inputs: Any) -> Any:
    """Return the rates of a v + b (r,); `inputs` as of `quantities_along`."""
    at = quantities_along(*inputs)
    *_, a, _, b = at.terms
    return rate(a @ at.v if b is None else a @ at.v + b)


def _constraint_rates(vdot: Array, multipliers: Array, *inputs: Any) -> Any:
    """Return the rates of a v̇ + gamma (r,) and of aᵀλ (n,) at constant v̇ and λ.

    `inputs` are those of `quantities_along`.
    """
    *_, a, gamma, _ = quantities_along(*inputs).terms
    return rate(a @ vdot + gamma), rate(a.T @ multipliers)


def constraint_rates_along(
    at: Quantities, vdot: Array, multipliers: Array, directions: Direction, key: str
) -> tuple[Any, Any]:
    """Return the derivatives of a v̇ + gamma (k, r) and of aᵀλ (k, n), v̇ and λ constant.

    Args:
        at: the state, in any scalar type, of a scene with constraints.
        vdot: v̇ (n,).
        multipliers: λ (r,).
        directions: k directions.
        key: name of this computation at the state.
    """
    return _differentiated(at, key, _constraint_rates, (vdot, multipliers), directions)


@generic
def _nearest(one, a, direction, violation):
    """Return the x (n,) next to a direction with a x = -violation; `one` is the unit matrix."""
    return au.solution(one, direction, a, violation, None, None)[0]


def tangent_directions(
    at: Quantities, directions: Direction, partition: Partition | None = None
) -> Direction:
    """Return the k directions next to others that keep the constraints to first order.

    That is, a δq = 0 for holonomic rows and δ(a v + b) = 0 for all.

    Args:
        at: the state, in any scalar type.
        directions: any k directions.
        partition: one that names redundant rows, which do not count.

    Raises:
        RefusedError: the constraints are dependent.
    """
    a = at.terms.a
    if a is None:
        return directions
    rows = np.arange(at.scene.r)
    kept = rows if partition is None or partition.kept is None else partition.kept
    dq, one = directions.q, np.eye(at.scene.n, dtype=int).astype(a.dtype)
    if at.scene.position_residual is not None:
        closed = np.intersect1d(kept, rows[at.scene.holonomic])
        still = np.zeros((len(dq), len(closed)), int).astype(dq.dtype)
        dq = at.run_for_each("tangent q", _nearest, (one, a[closed]), (dq, still))
    along_q = directions._replace(q=dq, v=0 * directions.q)
    violation = _differentiated(at, "violation", _violation_rates, (), along_q)
    varied = directions.v, violation[:, kept]
    return directions._replace(
        q=dq, v=at.run_for_each("tangent v", _nearest, (one, a[kept]), varied)
    )


def tangent_direction(
    at: Quantities, direction: Direction, partition: Partition | None = None
) -> Direction:
    """Return the direction (n,) next to another one that keeps the constraints to first order.

    See `tangent_directions`.
    """
    tangent = tangent_directions(at, _as_stack(direction), partition)
    return Direction(*(x[0] for x in tangent))


def _unit_directions(at: Quantities) -> Direction:
    return unit_directions(at.scene.n)


Directions = Callable[[Any], Direction]
"""Function of an evaluation, or of its perturbed samples, that returns directions."""


# ---- Derivatives at a state ----------------------------------------------------------------------


@dataclass(frozen=True)
class Derivatives:
    """Derivatives of the acceleration and the multipliers of one state by a formulation.

    Entry (i, j) is the derivative of entry i of v̇ or λ by entry j of q, v or τ.

    Attributes:
        q: ∂v̇/∂q (n, n) at constant v and t.
        v: ∂v̇/∂v (n, n).
        tau: ∂v̇/∂τ (n, n), τ being generalized forces in addition to the scene's own.
        multipliers_q: ∂λ/∂q (r, n), or None if the formulation has no multipliers.
        multipliers_v: ∂λ/∂v (r, n), or None.
        multipliers_tau: ∂λ/∂τ (r, n), or None.
        error_bound: bound on the rounding error of every entry of `q`, `v` and `tau`, absolute.
            Infinite if a matrix is so ill-conditioned that no bound can be measured.
        error_bounds: the bound of each array by itself, by the name of its field.
    """

    q: Array
    v: Array
    tau: Array
    multipliers_q: Array | None
    multipliers_v: Array | None
    multipliers_tau: Array | None
    error_bound: float
    error_bounds: dict[str, float]


ANY_VELOCITY_HINT = "; au and others in terms of v are differentiated at any v"


def derivatives(scene: Scene, key: str, q, v, tau=None, t: float = 0.0) -> Derivatives:
    """Return the derivatives of v̇ and λ of `scene` by one formulation, with an error bound.

    They are exact but for rounding, by dual numbers. At constraints they are those of the KKT
    system at every (q, v), consistent or not; formulations in generalized speeds or quasi-
    velocities drop the violating part of v, and equal the others along variations that keep the
    constraints to first order (see `eomcheck.evaluation.derivatives`).

    Args:
        scene: the scene.
        key: the formulation, a key of `eomcheck.FORMULATIONS`.
        q: coordinates (n,).
        v: velocities q̇ (n,).
        tau: generalized forces (n,) in addition to the scene's own; None for none.
        t: time, s.

    Returns:
        ∂v̇/∂q, ∂v̇/∂v, ∂v̇/∂τ and those of λ, if the formulation has multipliers.

    Raises:
        InputError: wrong shapes, values that are not finite, a formulation that does not apply to
            the scene.
        UnknownNameError: no such formulation.
        InconsistentVelocityError: v violates the constraints, and the formulation reads generalized
            speeds or quasi-velocities.
        RefusedError: the formulation cannot handle this state; the message names redundant
            constraints, if there are any. Or a derivative overflows.
    """
    formulation = formulation_for(checked_scene(scene), key)
    at = Evaluation(scene, q, v, t)
    at.tau = np.zeros(scene.n) if tau is None else finite_array("tau", tau, (scene.n,))
    if formulation.uses != "terms":
        check_consistent(at, ANY_VELOCITY_HINT)
    try:
        solution_of(at, formulation)
    except RefusedError as refusal:
        raise with_redundancy_hint(at, refusal) from None
    arrays = derivative_arrays(at, formulation)
    sensitivities = derivative_sensitivities(at, formulation, arrays)
    bounds = {name: _error_bound(sensitivities[name]) for name in arrays}
    fields: dict[str, Any] = {name: arrays.get(name) for name in ARRAYS}
    return Derivatives(
        **fields,
        error_bound=max(bounds[name] for name in Direction._fields),
        error_bounds=bounds,
    )


ARRAYS = (*Direction._fields, *(f"multipliers_{name}" for name in Direction._fields))
"""Names of the arrays in `Derivatives`."""


def _error_bound(sensitivity: float) -> float:
    # Underflow on the way is smaller than any effect of perturbed inputs.
    return max(allowed_error(sensitivity), UNDERFLOW)


def derivative_arrays(
    at: Evaluation, formulation: Formulation, directions: Directions = _unit_directions
) -> dict[str, Array]:
    """Return the arrays of `Derivatives` by name, without those of absent multipliers.

    Args:
        at: the state, or a batch of states: arrays are NaN where one is refused or overflows.
        formulation: the formulation.
        directions: n directions for each of q, v and tau, by default those of their entries.

    Raises:
        RefusedError: as `Evaluation.acceleration`, or a derivative overflows.
    """
    arrays = arrays_by_name(_rows_of(at, formulation, directions), at.scene.n)
    if at.states:
        return {name: x.T for name, x in arrays.items()}
    for name, x in arrays.items():
        if not np.isfinite(x).all():
            message = (
                f"the derivative {name} by {formulation.key} overflows: doubles cannot hold it"
            )
            raise RefusedError(name, float("nan"), 0.0, message)
    return {name: np.ascontiguousarray(x.T) for name, x in arrays.items()}


def arrays_by_name(rows: Sequence[Any], n: int) -> dict[str, Any]:
    """Return the rows of each array of `Derivatives`, transposed: (n, n) or (n, r).

    Args:
        rows: the derivatives of v̇ (3n, n) and of λ (3n, r), or None.
        n: number of coordinates.
    """
    both = zip(("", "multipliers_"), rows, strict=True)
    return {
        prefix + part: x[i * n : i * n + n]
        for prefix, x in both
        if x is not None
        for i, part in enumerate(Direction._fields)
    }


def _rows_of(
    at: Evaluation, formulation: Formulation, directions: Directions = _unit_directions
) -> tuple[Any, Any]:
    """Return the derivatives of v̇ (3n, n) and of λ (3n, r), or None, by q, v and tau in turn."""
    partition = at.partition_for(formulation, pivoted=False)

    def function(key: str, part: Direction) -> Any:
        return solutions_along(at, formulation, part, partition, f"{formulation.key}, {key}")

    with np.errstate(all="ignore"):
        return for_each_direction(at, directions(at), function)


def derivative_sensitivities(
    at: Evaluation,
    formulation: Formulation,
    arrays: dict[str, Array],
    directions: Directions = _unit_directions,
) -> dict[str, float]:
    """Return κ · scale of each array of `Derivatives`, by name.

    It is infinite where that of the acceleration is (`acceleration_sensitivity`).

    Args:
        at: the state.
        formulation: the formulation.
        arrays: the result of `derivative_arrays`.
        directions: those of `arrays`.

    Raises:
        RefusedError: as `Evaluation.acceleration`.
    """
    if not np.isfinite(acceleration_sensitivity(at, formulation)):
        return dict.fromkeys(arrays, np.inf)

    def rows(e: Evaluation) -> dict[str, Any]:
        return arrays_by_name(_rows_of(e, formulation, directions), at.scene.n)

    return _sensitivities(at, arrays, rows)


def _sensitivities(
    at: Evaluation,
    arrays: dict[str, Array],
    rows: Callable[[Evaluation], dict[str, Any]],
) -> dict[str, float]:
    """Return κ · scale of arrays, by name; `rows` returns their transposes in perturbed samples."""
    samples = perturbed_samples(at)
    with np.errstate(all="ignore"):
        try:
            with samples.computing("quantity"):
                perturbed = rows(samples)
            # Inputs alone: their perturbations and those of operations may cancel by chance.
            with samples.noise.disabled():
                inputs = rows(samples)
        except (RefusedError, np.linalg.LinAlgError):
            return dict.fromkeys(arrays, np.inf)
        return {
            name: max(
                measured_sensitivity(at, x.T, perturbed[name], solved=True),
                measured_sensitivity(at, x.T, inputs[name]),
            )
            for name, x in arrays.items()
        }


# ---- Inverse dynamics ----------------------------------------------------------------------------


@dataclass(frozen=True)
class InverseDynamicsDerivatives:
    """Derivatives of τ = M v̇ + B - Q at constant v̇; M itself is ∂τ/∂v̇.

    Attributes:
        q: ∂τ/∂q (n, n) at constant v and t.
        v: ∂τ/∂v (n, n).
        error_bound: bound on the rounding error of every entry, absolute.
        error_bounds: the bound of each array by itself, by the name of its field.
    """

    q: Array
    v: Array
    error_bound: float
    error_bounds: dict[str, float]


def inverse_dynamics_derivatives(
    scene: Scene, q, v, vdot, t: float = 0.0
) -> InverseDynamicsDerivatives:
    """Return the derivatives of τ = M v̇ + B - Q, without forces of constraints.

    It takes O(n³) operations: the terms of the scene are run on dual numbers along 2n directions,
    and each run forms M whole. Any scene has terms, with all its forces Q. For bodies on a tree, of
    forces the weight alone, the recursion of Newton and Euler takes O(n) a direction:
    `eomcheck.evaluation.conformance.ConformancePoint.torque_derivatives`.

    Args:
        scene: the scene.
        q: coordinates (n,).
        v: velocities (n,).
        vdot: accelerations (n,).
        t: time, s.

    Returns:
        ∂τ/∂q and ∂τ/∂v, (n, n) each.

    Raises:
        InputError: wrong shapes or values that are not finite.
    """
    at = Evaluation(checked_scene(scene), q, v, t)
    vdot = finite_array("vdot", vdot, (scene.n,))
    arrays = inverse_arrays(at, vdot)
    sensitivities = inverse_sensitivities(at, vdot, arrays)
    bounds = {name: _error_bound(x) for name, x in sensitivities.items()}
    return InverseDynamicsDerivatives(
        **arrays, error_bound=max(bounds.values()), error_bounds=bounds
    )


def inverse_arrays(at: Evaluation, vdot: Array) -> dict[str, Array]:
    """Return ∂τ/∂q and ∂τ/∂v (n, n) at v̇ (n,), by the names "q" and "v"."""
    return {name: np.ascontiguousarray(x.T) for name, x in _inverse_rows(at, vdot).items()}


def inverse_sensitivities(
    at: Evaluation, vdot: Array, arrays: dict[str, Array]
) -> dict[str, float]:
    """Return κ · scale of the result of `inverse_arrays`, by name; v̇ is perturbed as well.

    Args:
        at: the state.
        vdot: v̇ (n,).
        arrays: the result of `inverse_arrays`.
    """

    def rows(samples: Any) -> dict[str, Any]:
        return _inverse_rows(samples, samples.finished(samples.noise.repeated(vdot)))

    return _sensitivities(at, arrays, rows)


def _inverse_rows(at: Evaluation, vdot: Any) -> dict[str, Any]:
    """Return the transposes of ∂τ/∂q and ∂τ/∂v."""
    parts, n = ("q", "v"), at.scene.n

    def function(key: str, directions: Direction) -> Any:
        return _differentiated(at, key, _inverse_rates, (vdot,), directions)

    with np.errstate(all="ignore"):
        rows = for_each_direction(at, unit_directions(n, parts), function)
    return {part: rows[i * n : i * n + n] for i, part in enumerate(parts)}
