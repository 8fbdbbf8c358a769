"""Conformance quantities: all that a rigid-body library computes, in one table, and our own values.

A `Quantity` has a name, which is that of the method of an engine, its arguments, its shape, how it
maps to other coordinates, and the quantity whose rate it is. What engines are asked, the claims
about it, the documentation and the coverage of a library follow from its line in `QUANTITIES`. Own
values come from a scene's terms and its tree of bodies (`eomcheck.descriptions.tree_model`), in any
scalar type.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from eomcheck.descriptions.tree_model import (
    TreeModel,
    exact_tree,
    exact_tree_numbers,
    joint_coordinates,
    joint_positions,
    link_numbers,
    position_rates,
    summed_angles,
    tree_model,
    tree_numbers,
)
from eomcheck.descriptions.tree_quantities import (
    CenterOfMass,
    LinkMotions,
    LinkNumbers,
    Momentum,
    Regressor,
    Weight,
)
from eomcheck.errors import InputError, RefusedError, registered
from eomcheck.evaluation.derivatives import (
    Direction,
    constraint_rates_along,
    derivative_arrays,
    for_each_direction,
    inverse_arrays,
    unit_directions,
)
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.formulations import FORMULATIONS, au
from eomcheck.mechanics.records import Tree
from eomcheck.mechanics.scene import Scene, checked_scene, finite_array
from eomcheck.numbers.ball import Balls, midpoints_or_zero, precision
from eomcheck.numbers.dual import duals, rate
from eomcheck.numbers.generic import (
    FLOAT64,
    Angles,
    Arithmetic,
    Array,
    as_objects,
    generic,
    map_record,
)
from eomcheck.numbers.linear import solve

# ---- A state -------------------------------------------------------------------------------------


class ConformancePoint:
    """The conformance quantities of a scene at one point (q, v, v̇, t), each on first use.

    Args:
        at: the quantities of the scene at (q, v, t), in any scalar type.
        vdot: acceleration v̇ (n,); by default 0.
        source: quantities at the same q that have the rates of prepared values; by default `at`.
        tau: forces τ (n,) of forward dynamics; by default those of inverse dynamics.
    """

    def __init__(
        self,
        at: Quantities,
        vdot: Array | None = None,
        source: Quantities | None = None,
        tau: Array | None = None,
    ):
        self.tau = tau
        self.at, self._source = at, at if source is None else source
        self.vdot = np.zeros(at.scene.n, at.v.dtype) if vdot is None else vdot
        self._results: dict[tuple[str, bool], Any] = {}

    @cached_property
    def model(self) -> TreeModel:
        """The tree of bodies of the scene.

        Raises:
            InputError: it has none.
        """
        model = self.at.cached(_model)
        if model is None:
            name = self.at.scene.name
            raise InputError(f"{name} has no tree of bodies: its `tree` returns None")
        return model

    @property
    def has_tree(self) -> bool:
        """Whether the scene has a tree of bodies."""
        return self.at.cached(_model) is not None

    # ---- Functions of the tree -------------------------------------------------------------------

    def result(self, name: str, rates: bool = False) -> Any:
        """Return the result of a function of the model, `TreeModel.function`, at this point.

        Args:
            name: name of the function.
            rates: whether the rates of its parts are wanted, while q moves by v and v by v̇.
        """
        key = name, rates
        if key not in self._results:
            self._results[key] = self._in_scene(self._run(name, rates))
        return self._results[key]

    def _run(self, name: str, rates: bool) -> Any:
        at, function = self.at, self.model.function(name)
        v, vdot = self._mapped(at.v), self._mapped(self.vdot)
        arguments = ARGUMENTS[name](self, vdot)
        if rates:
            changing = *self._prepared_and_rates, v, vdot
            return at.run(_rates_of, function, self._numbers, *changing, *arguments)
        return at.run(function, self._numbers, self._prepared, v, *arguments)

    @property
    def _arithmetic(self) -> Arithmetic:
        """The arithmetic of constants of the tree: float64 for perturbed samples too."""
        return FLOAT64 if isinstance(self.at, Evaluation) else self.at.arithmetic

    @cached_property
    def link_numbers(self) -> LinkNumbers:
        """The frames of the links on their scalar joints."""
        return self.at.constants(link_numbers(self.model, self._arithmetic))

    @cached_property
    def body_numbers(self) -> LinkNumbers:
        """The frames of the links of bodies on their scalar joints."""
        bodies = list(self.model.body_links)
        return LinkNumbers(*(x[bodies] for x in self.link_numbers))

    def _mapped(self, x: Array) -> Array:
        """Return rates of the coordinates of the model's joints, from those of the scene."""
        return x if self.model.tree is None else self._coordinates[0] @ x

    @cached_property
    def _coordinates(self) -> tuple[Array, Array]:
        """Matrix T and shift of the coordinates x = T q + shift of the model's joints."""
        assert self.model.tree is not None
        return joint_coordinates(self.model.tree, self._arithmetic)

    def _in_scene(self, record: Any) -> Any:
        """Return a result in the coordinates of the scene, from those of the model's joints."""
        if self.model.tree is None:
            return record
        T, _ = self._coordinates
        if not isinstance(record, tuple):  # a matrix (n, n) or forces (n,)
            return T.T @ (record @ T if record.ndim == 2 else record)
        parts: dict[str, Any] = {}
        for name, part in record._asdict().items():  # type: ignore[attr-defined]
            if name in ("jacobian", "matrix"):
                parts[name] = part @ T
            elif name in ("gradient", "Y", "rotors"):
                parts[name] = T.T @ part
        return record._replace(**parts)  # type: ignore[attr-defined]

    @cached_property
    def _numbers(self) -> Any:
        if self.model.tree is None:
            return self.at.parameters
        if self._exact_tree is not None:
            numbers = exact_tree_numbers(self.model, self._exact_tree, self._arithmetic)
            return self.at.constants(numbers)
        return self.at.constants(tree_numbers(self.model, self._arithmetic))

    @cached_property
    def _exact_tree(self) -> Tree | None:
        """The tree in the numbers of the parameters, exact ones; None if there is none."""
        if self.model.tree is None or self._arithmetic is FLOAT64:
            return None
        return exact_tree(self.at.scene, self.at.parameters)

    @property
    def has_own_numbers(self) -> bool:
        """Whether numbers and angles of the tree are those of the scene, not variables beside."""
        if self.model.tree is None:
            return True
        return self._exact_tree is not None and self._scene_angles is not None

    @cached_property
    def _prepared(self) -> Any:
        if self.model.tree is None:
            return self.at.prepared
        T, shift = self._coordinates
        x = self.at.rounded_sum(T, self.at.q, shift)
        return joint_positions(self.model, self.at.prepare_arithmetic, x, self._scene_angles)

    @cached_property
    def _scene_angles(self) -> Angles | None:
        """The angles of hinges as sums of those of the scene, which are variables; None if not."""
        if not hasattr(self.at.prepare_arithmetic, "vector"):
            return None
        known = (x for x in self._source.angles_and_roots if isinstance(x, Angles))
        return summed_angles(self.model, *self._coordinates, self.at.q, known)

    @cached_property
    def _prepared_and_rates(self) -> tuple[Any, Any]:
        if self.model.tree is None:
            return self.prepared_and_rates
        prepared = self._prepared
        return prepared, position_rates(self.model, prepared, self._mapped(self.at.v))

    @property
    def prepared_and_rates(self) -> tuple[Any, Any]:
        """The prepared values of the scene, and their rates along q̇ = v."""
        return self._source.prepared_and_rates(self.at.v)

    # ---- Derivatives -----------------------------------------------------------------------------

    def _torques_along(self, key: str, directions: Direction) -> Array:
        """Return the derivatives of M v̇ + B + ∂U/∂q (k, n) along k directions, v̇ constant.

        By the recursion of Newton and Euler, in O(n) each.
        """
        at, model = self.at, self.model
        if model.tree is None:
            prepared, rates = at.rates_along(directions.q)
        else:
            one = self._prepared
            each = [(one, position_rates(model, one, self._mapped(x))) for x in directions.q]
            prepared, rates = map_record(lambda *parts: np.stack(parts), *each)
        dv = self._mapped(directions.v.T).T
        function, state = model.function("inverse_dynamics"), (self.vdot, at.v)
        shared = function, self._numbers, *map(self._mapped, state)
        torques = at.run_for_each(key, _torque_rates, shared, (prepared, rates, dv))
        return torques if model.tree is None else torques @ self._coordinates[0]

    @cached_property
    def torque_derivatives(self) -> Array:
        """The derivatives of inverse dynamics by q, then by v (n, 2n), v̇ constant."""
        return self._columns(self._torques_along)

    @cached_property
    def acceleration_derivatives(self) -> Array:
        """The derivatives of forward dynamics by q, v and τ (n, 3n): M⁻¹ [-∂τ/∂q, -∂τ/∂v, 1].

        Raises:
            RefusedError: M is singular to working precision.
        """
        M = self.at.terms.M
        point = ConformancePoint(self.at, self.free_acceleration, self._source)
        unit = 0 * M + np.eye(self.at.scene.n)
        right = np.concatenate((-point.torque_derivatives, unit), axis=1)
        with self._solving():
            return self.at.call(solve, M, right, "M")

    @cached_property
    def constraint_force_derivatives(self) -> Array:
        """The derivatives of λ by q, then by v (r, 2n), of M v̇ + B + ∂U/∂q = τ + aᵀλ.

        Raises:
            RefusedError: M or the constraints are singular to working precision.
        """
        at = self.at
        M, _, _, a, gamma, _ = at.terms
        if a is None:
            return np.zeros((0, 2 * at.scene.n), M.dtype)
        with self._solving():
            vdot, multipliers = at.call(au.solution, M, self._net_force, a, gamma, None, None)
        point = ConformancePoint(at, vdot, self._source)

        def multiplier_rates(key: str, directions: Direction) -> Array:
            state = vdot, multipliers
            violation, pull = constraint_rates_along(at, *state, directions, f"{key}, constraints")
            force = pull - point._torques_along(key, directions)
            with self._solving():
                return at.run_for_each(key, _multipliers, (M, a), (force, violation))

        return self._columns(multiplier_rates)

    def _columns(self, function: Callable[[str, Direction], Array]) -> Array:
        """Return the matrix of columns along the entries of q, then of v.

        `function` returns them (k, ...) from a key and k directions.
        """
        directions = unit_directions(self.at.scene.n, ("q", "v"))
        if not isinstance(self.at, Evaluation):
            directions = Direction(*(x.astype(int).astype(object) for x in directions))
        return for_each_direction(self.at, directions, function).T

    # ---- Own values ------------------------------------------------------------------------------

    @property
    def center(self) -> CenterOfMass:
        """The centre of mass, its Jacobian, velocity and acceleration."""
        return self.result("center_of_mass")

    @property
    def momentum(self) -> Momentum:
        """The momentum, its matrix and its rate."""
        return self.result("momentum")

    @property
    def weight(self) -> Weight:
        """The potential energy of weight and its gradient."""
        return self.result("weight")

    @property
    def links(self) -> LinkMotions:
        """Poses and motions of the frames of all links."""
        return self.result("link_motions")

    @property
    def coriolis_matrix(self) -> Array:
        """The Coriolis matrix (n, n)."""
        return self.result("coriolis_matrix")

    @property
    def regressor(self) -> Regressor:
        """The regressor of inverse dynamics, its parameters and the torques of rotors."""
        return self.result("regressor")

    def link(self, frame: str) -> LinkMotions:
        """Return pose and motion of the frame of one link.

        Raises:
            UnknownNameError: there is no such link.
        """
        places = {name: place for place, name in enumerate(self.model.links)}
        place = registered("frame", frame, places)
        return LinkMotions(*(x[place] for x in self.links))

    @cached_property
    def bias(self) -> Array:
        """The bias B (n,); zeros where the scene has none."""
        B = self.at.terms.B
        return np.zeros(self.at.scene.n, self.at.v.dtype) if B is None else B

    @property
    def mass(self) -> Any:
        """The mass of all bodies, kg."""
        return self.at.parameters.mass.sum()

    @cached_property
    def inverse_mass_matrix(self) -> Array:
        """The inverse of the mass matrix (n, n).

        Raises:
            RefusedError: M is singular to working precision.
        """
        with self._solving():
            return self.at.call(inverse_of, self.at.terms.M)

    @cached_property
    def torques(self) -> Array:
        """The forces M v̇ + B + ∂U/∂q (n,) of inverse dynamics."""
        return self.inertia_force + self.weight.gradient

    @cached_property
    def free_acceleration(self) -> Array:
        """The acceleration M⁻¹ (τ - B - ∂U/∂q) (n,) without constraints.

        Raises:
            RefusedError: M is singular to working precision.
        """
        with self._solving():
            return self.at.call(solve, self.at.terms.M, self._net_force, "M")

    @property
    def _net_force(self) -> Array:
        """The force τ - B - ∂U/∂q (n,) of forward dynamics."""
        tau = self.torques if self.tau is None else self.tau
        return -self.bias - self.weight.gradient + tau

    def _solving(self) -> AbstractContextManager:
        recording = getattr(self.at, "recording_solves", None)
        return nullcontext() if recording is None else recording()

    @cached_property
    def inertia_force(self) -> Array:
        """The torques M v̇ + B (n,) without forces."""
        return self.at.terms.M @ self.vdot + self.bias


ARGUMENTS: dict[str, Callable[[ConformancePoint, Array], tuple[Any, ...]]] = {
    "center_of_mass": lambda point, vdot: (vdot,),
    "momentum": lambda point, vdot: (vdot,),
    "weight": lambda point, vdot: (),
    "link_motions": lambda point, vdot: (vdot, *point.link_numbers),
    "coriolis_matrix": lambda point, vdot: (),
    "inverse_dynamics": lambda point, vdot: (vdot,),
    "regressor": lambda point, vdot: (vdot, *point.body_numbers),
}
"""Function of a model -> its arguments after the parameters, prepared values and v."""


def _torque_rates(
    function: Callable, numbers: Any, vdot: Array, v: Array, prepared: Any, rates: Any, dv: Array
) -> Array:
    """Return the rates of inverse dynamics by a function, along precomputed values and v."""
    state = map_record(duals, prepared, rates), duals(v, dv)
    return rate(function(as_objects(numbers), *state, as_objects(vdot)))


@generic
def _multipliers(M, a, force, violation):
    """Return λ (r,) of M v̇ = force + aᵀλ, a v̇ = -violation."""
    return au.solution(M, force, a, violation, None, None)[1]


@generic
def inverse_of(M):
    """Return the inverse of a matrix (n, n)."""
    return solve(M, np.eye(M.shape[0], dtype=M.dtype), "M")


def _model(at: Quantities) -> TreeModel | None:
    return tree_model(at.scene)


def _rates_of(function: Callable, numbers: Any, *arguments: Any) -> Any:
    """Return the rates of a function's results.

    Arguments are prepared values, their rates, v, v̇, and those of the function that are constant.
    """
    prepared, rates, v, vdot, *constants = arguments
    state = map_record(duals, prepared, rates), duals(v, vdot)
    result = function(as_objects(numbers), *state, *as_objects(tuple(constants)))
    return map_record(rate, result)


# ---- Table ---------------------------------------------------------------------------------------

MAPPINGS = {
    "invariant": "x",
    "force": "Sᵀ x",
    "matrix": "Sᵀ x S",
    "inverse": "S⁻¹ x S⁻ᵀ",
    "jacobian": "x S",
    "bias": "x + J Ṡ v",
    "acceleration": "S⁻¹ (x - Ṡ v)",
    "coriolis": "Sᵀ x S + Sᵀ M Ṡ",
    "rows": "Sᵀ x",
    "derivatives": "by the chain rule, with ∂(S v)/∂q and ∂(Ṡ v)/∂q",
}
"""How a quantity x in an engine's own coordinates, w = S v, becomes that of the scene."""


class Quantity(NamedTuple):
    """A quantity of the table.

    Attributes:
        name: name of the method of an engine.
        symbol: symbol in formulas.
        arguments: arguments of the method without t: "f" (name of a link), "q", "v", "vdot", "tau".
        shape: entries along each axis: a number, "n" velocities, "r" constraints, "2n" by q and v,
            "3n" by q, v and τ, or "p" parameters of bodies.
        mapping: key of `MAPPINGS`.
        unit: SI units.
        about: description, with axes and conventions.
        value: function (point, frame) -> own value; None for derivatives, which have their own.
        rate_of: name of the quantity whose rate it is; "" if none.
        companion: name of the Jacobian J by which a bias maps; "" if it is none.
        needs_tree: whether it needs the scene's tree of bodies.
        out_of_plane: whether it needs products of inertia that the plane leaves out.
    """

    name: str
    symbol: str
    arguments: tuple[str, ...]
    shape: tuple[int | str, ...]
    mapping: str
    unit: str
    about: str
    value: Callable[[ConformancePoint, str], Any]
    rate_of: str = ""
    companion: str = ""
    needs_tree: bool = True
    out_of_plane: bool = False

    def lacks(self, point: ConformancePoint) -> str:
        """Return the reason why a scene does not have it, after its name; "" if it has it."""
        if self.needs_tree and not point.has_tree:
            return "has no tree of bodies: its `tree` returns None"
        if self.out_of_plane and point.model.tilted:
            return "is planar, and its products of inertia leave the plane"
        return ""

    @property
    def of_frame(self) -> bool:
        """Whether it belongs to a link."""
        return "f" in self.arguments

    @property
    def signature(self) -> str:
        """The method of an engine with its arguments, in their order."""
        return f"{self.name}({', '.join((*self.arguments, 't=0.0'))})"

    @property
    def parts(self) -> tuple[tuple[int | str, ...], ...]:
        """The shapes of the arrays that an engine returns, a tuple if there are several.

        Such a tuple may be one array too, its parts side by side: of shape `shape`.
        """
        if self.name == "frame_placement":
            return (3, 3), (3,)
        if self.mapping == DERIVED:
            rows, columns = self.shape
            return ((rows, "n"),) * int(str(columns)[0])
        return (self.shape,)

    def compared(self, point: ConformancePoint, frame: str) -> Any:
        """Return the own value to compare: C v (n,) of a Coriolis matrix, which is not unique."""
        return point.bias if self.mapping == "coriolis" else self.value(point, frame)

    def up_to_constant(self, value: Callable[[Array], Any], q: Array) -> Any:
        """Return value(q), less value(0) of a potential energy, which has a free constant."""
        return value(q) - value(0.0 * q) if self.name == "potential_energy" else value(q)

    def axis_names(self, point: ConformancePoint) -> tuple[tuple[str, ...], ...]:
        """Return the names along each axis, for messages."""
        scene = point.at.scene
        names: list[tuple[str, ...]] = []
        for size in self.shape:
            if size == "n":
                names.append(scene.coordinate_names)
            elif size == "r":
                names.append(scene.constraint_names)
            elif size in ("2n", "3n"):
                names.append(derivative_names(scene.coordinate_names, int(size[0])))
            elif size == "p":
                names.append(names_of_parameters(point.model.bodies))
            else:
                names.append(SIZE_NAMES[int(size)])
        return tuple(names)


AXIS_NAMES = "x", "y", "z"
SPATIAL_NAMES = "x", "y", "z", "ω_x", "ω_y", "ω_z"
"""Names of the rows of a velocity: linear first, then angular."""

SIZE_NAMES = {3: AXIS_NAMES, 4: ("R_x", "R_y", "R_z", "p"), 6: SPATIAL_NAMES}
"""Size of an axis -> names along it; 4 are the columns of [R p]."""

PARAMETER_NAMES = "m", "m c_x", "m c_y", "m c_z", "I_xx", "I_xy", "I_xz", "I_yy", "I_yz", "I_zz"
"""Names of the parameters of a body."""


def derivative_names(coordinates: tuple[str, ...], count: int) -> tuple[str, ...]:
    """Return the names of derivatives by q, by v and, of three, by τ."""
    parts = ("by", "by rate of", "by force on")[:count]
    return tuple(f"{part} {name}" for part in parts for name in coordinates)


def names_of_parameters(bodies: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names of the parameters π of bodies with these names."""
    return tuple(f"{name} of {body}" for body in bodies for name in PARAMETER_NAMES)


Q, V, A, F = "q", "v", "vdot", "f"
DERIVED = "derivatives"

QUANTITIES: dict[str, Quantity] = {
    one.name: one
    for one in (
        Quantity(
            *("inverse_dynamics", "τ", (Q, V, A), ("n",), "force", "N, N m"),
            "generalized forces M v̇ + B + ∂U/∂q, of forces the weight alone",
            lambda x, f: x.torques,
        ),
        Quantity(
            *("forward_dynamics", "v̇", (Q, V, "tau"), ("n",), "acceleration", "m/s², rad/s²"),
            "acceleration M⁻¹ (τ - B - ∂U/∂q) without constraints, of forces τ and the weight",
            lambda x, f: x.free_acceleration,
        ),
        Quantity(
            *("inverse_mass_matrix", "M⁻¹", (Q,), ("n", "n"), "inverse", "1/kg, 1/(kg m²)"),
            "inverse of the mass matrix",
            lambda x, f: x.inverse_mass_matrix,
            needs_tree=False,
        ),
        Quantity(
            *("gravity", "∂U/∂q", (Q,), ("n",), "force", "N, N m"),
            "gradient of the potential energy of weight, on the side of M v̇",
            lambda x, f: x.weight.gradient,
        ),
        Quantity(
            *("coriolis_matrix", "C", (Q, V), ("n", "n"), "coriolis", "kg m/s, kg m²/s"),
            "a matrix C with C v = B, by which it is compared; it is not unique",
            lambda x, f: x.coriolis_matrix,
        ),
        Quantity(
            *("kinetic_energy", "T", (Q, V), (), "invariant", "J"),
            "kinetic energy vᵀ M v / 2, with rotors",
            lambda x, f: x.at.v @ x.at.terms.M @ x.at.v / 2,
            needs_tree=False,
        ),
        Quantity(
            *("potential_energy", "U", (Q,), (), "invariant", "J"),
            "potential energy of weight, up to a constant",
            lambda x, f: x.weight.U,
        ),
        Quantity(
            *("center_of_mass", "c", (Q,), (3,), "invariant", "m"),
            "position of the centre of mass of all bodies",
            lambda x, f: x.center.position,
        ),
        Quantity(
            *("center_of_mass_jacobian", "∂ċ/∂v", (Q,), (3, "n"), "jacobian", "1, m"),
            "derivatives of the velocity of the centre of mass",
            lambda x, f: x.center.jacobian,
        ),
        Quantity(
            *("center_of_mass_velocity", "ċ", (Q, V), (3,), "invariant", "m/s"),
            "velocity of the centre of mass",
            lambda x, f: x.center.velocity,
            rate_of="center_of_mass",
        ),
        Quantity(
            *("center_of_mass_acceleration", "c̈", (Q, V, A), (3,), "invariant", "m/s²"),
            "acceleration of the centre of mass",
            lambda x, f: x.center.acceleration,
            rate_of="center_of_mass_velocity",
        ),
        Quantity(
            *("momentum", "h", (Q, V), (6,), "invariant", "kg m/s, kg m²/s"),
            "linear momentum, then angular about the centre of mass, of the bodies without rotors",
            lambda x, f: x.momentum.momentum,
            out_of_plane=True,
        ),
        Quantity(
            *("momentum_matrix", "A", (Q,), (6, "n"), "jacobian", "kg, kg m²"),
            "derivatives of the momentum by the velocities, h = A v",
            lambda x, f: x.momentum.matrix,
            out_of_plane=True,
        ),
        Quantity(
            *("momentum_rate", "ḣ", (Q, V, A), (6,), "invariant", "N, N m"),
            "rate of the momentum",
            lambda x, f: x.momentum.rate,
            rate_of="momentum",
            out_of_plane=True,
        ),
        Quantity(
            *("frame_placement", "R, p", (F, Q), (3, 4), "invariant", "1, m"),
            "orientation R, columns along the axes of the link, and position p: [R p]",
            lambda x, f: np.concatenate((x.link(f).R, x.link(f).p.reshape(3, 1)), axis=1),
        ),
        Quantity(
            *("frame_velocity", "V", (F, Q, V), (6,), "invariant", "m/s, rad/s"),
            "velocity of the origin, then angular velocity, along the axes of the world",
            lambda x, f: x.link(f).velocity,
            rate_of="frame_placement",
        ),
        Quantity(
            *("frame_jacobian", "J", (F, Q), (6, "n"), "jacobian", "1, m"),
            "derivatives of `frame_velocity` by the velocities",
            lambda x, f: x.link(f).jacobian,
        ),
        Quantity(
            *("frame_acceleration", "V̇", (F, Q, V, A), (6,), "invariant", "m/s², rad/s²"),
            "rate of `frame_velocity`: classical acceleration of the origin, then angular",
            lambda x, f: x.link(f).acceleration,
            rate_of="frame_velocity",
        ),
        Quantity(
            *("frame_bias", "J̇ v", (F, Q, V), (6,), "bias", "m/s², rad/s²"),
            "`frame_acceleration` at v̇ = 0",
            lambda x, f: x.link(f).bias,
            companion="frame_jacobian",
        ),
        Quantity(
            *("inverse_dynamics_derivatives", "∂τ/∂q, ∂τ/∂v", (Q, V, A), ("n", "2n"), DERIVED),
            "N/rad, N s/rad and the like",
            "derivatives of `inverse_dynamics` by q and by v, v̇ constant; M is that by v̇",
            lambda x, f: x.torque_derivatives,
        ),
        Quantity(
            *("forward_dynamics_derivatives", "∂v̇/∂q, ∂v̇/∂v, ∂v̇/∂τ"),
            *((Q, V, "tau"), ("n", "3n"), DERIVED, "1/s², 1/s, 1/kg and the like"),
            "derivatives of `forward_dynamics` by q, v and τ",
            lambda x, f: x.acceleration_derivatives,
        ),
        Quantity(
            *("constraint_force_derivatives", "∂λ/∂q, ∂λ/∂v", (Q, V, "tau"), ("r", "2n"), DERIVED),
            "N/rad, N s/rad and the like",
            "derivatives of λ by q and v, M v̇ + B + ∂U/∂q = τ + aᵀλ and a v̇ + gamma = 0",
            lambda x, f: x.constraint_force_derivatives,
        ),
        Quantity(
            *("regressor", "Y", (Q, V, A), ("n", "p"), "rows", "N/(unit of π)"),
            "matrix Y with τ = Y π + torques of rotors; π of each body, in the order of its "
            "links: m, m c and I xx, xy, xz, yy, yz, zz about the link's origin, along its axes",
            lambda x, f: x.regressor.Y,
        ),
    )
}
"""Name -> quantity, in the order of docs and of blame."""


BITS = 320
"""Working precision of true values, bits: many cancel in a float64 result."""


def enclosed_quantity(
    at: Evaluation, one: Quantity, frame: str, vdot: Array, tau: Array | None = None
) -> Array:
    """Return the true value of a quantity at a state, by ball arithmetic, rounded to float64 once.

    That of a Coriolis matrix is C v; entries that cannot be told from 0 are 0.

    Args:
        at: the state.
        one: the quantity.
        frame: name of the link, "" for a quantity of none.
        vdot: accelerations (n,).
        tau: forces (n,) of forward dynamics; by default those of inverse dynamics.

    Raises:
        RefusedError: a matrix cannot be shown to be invertible.
    """
    balls = Balls()
    with precision(BITS):
        exact = Quantities(
            at.scene, balls, balls.numbers(at.q), balls.numbers(np.array(at.t)).item()
        )
        exact.v = balls.numbers(at.v)
        forces = None if tau is None else balls.numbers(tau)
        point = ConformancePoint(exact, balls.numbers(vdot), tau=forces)
        value = one.compared(point, frame)
        return midpoints_or_zero(np.asarray(value, object))


# ---- Public --------------------------------------------------------------------------------------


def quantity(
    scene: Scene,
    name: str,
    q,
    v=None,
    vdot=None,
    *,
    tau=None,
    frame: str | None = None,
    t: float = 0.0,
) -> Array:
    """Return a quantity of a scene at a state, in float64.

    Inverse and forward dynamics have all forces Q of the scene, springs and dampers too:
    τ = M v̇ + B - Q and v̇ = M⁻¹ (τ + Q - B) are inverse to each other. Their derivatives are those
    of these functions, and `constraint_force_derivatives` are those of M v̇ + B = Q + τ + aᵀλ. All
    else is as in the table of `QUANTITIES`, whose force is the weight alone: `gravity`,
    `potential_energy` and `regressor`.

    Args:
        scene: the scene.
        name: name of the quantity, a key of `QUANTITIES`.
        q: coordinates (n,).
        v: velocities (n,); by default 0.
        vdot: accelerations (n,); by default 0.
        tau: generalized forces (n,) in addition to the scene's own; by default 0.
        frame: name of the link, for quantities of a frame.
        t: time, s.

    Returns:
        Its value; `frame_placement` is [R p] (3, 4), an energy has shape (), and derivatives are
        side by side: [∂/∂q ∂/∂v] (n, 2n), [∂/∂q ∂/∂v ∂/∂τ] (n, 3n).

    Raises:
        InputError: wrong shapes, values that are not finite, a missing `frame`, an argument that
            the quantity does not have, or a scene without a tree of bodies.
        UnknownNameError: no such quantity or link.
        RefusedError: M is singular to working precision, of a quantity that solves with it. Or the
            quantity overflows.

    Example:
        >>> import eomcheck
        >>> arm = eomcheck.SCENES["chain-pendulum"].example()
        >>> eomcheck.quantity(arm, "center_of_mass", [0.0, 0.0, 0.0]).round(6)
        array([1.5, 0. , 0. ])
    """
    one: Quantity = registered("quantity", name, QUANTITIES)
    options = {"v": v, "vdot": vdot, "tau": tau}
    shape = (checked_scene(scene).n,)
    at = Evaluation(scene, q, np.zeros(shape) if v is None else v, t)
    vdot, tau = (
        np.zeros(shape) if options[x] is None else finite_array(x, options[x], shape)
        for x in ("vdot", "tau")
    )
    point = ConformancePoint(at, vdot)
    if what := one.lacks(point):
        raise InputError(f"{scene.name} {what}")
    if one.of_frame and frame is None:
        names = ", ".join(map(repr, point.model.links))
        raise InputError(f"frame = None: {name} needs the name of a link: {names}")
    if frame is not None and not one.of_frame:
        raise InputError(f"frame = {frame!r}: {name} belongs to no link")
    for option, value in options.items():
        if value is not None and option not in one.arguments:
            message = f"{option}: {name} does not depend on it, only on "
            raise InputError(message + ", ".join(x for x in one.arguments if x != "f"))
    at.tau = tau
    with np.errstate(all="ignore"):
        if name in WITH_ALL_FORCES:
            result = WITH_ALL_FORCES[name](at, vdot)
        else:
            result = np.asarray(one.value(point, frame or ""), np.float64)
    if not np.isfinite(result).all():
        message = f"{name} overflows: float64 cannot hold it"
        raise RefusedError(name, float("nan"), 0.0, message)
    return result


def _side_by_side(arrays: dict[str, Array], *names: str) -> Array:
    return np.hstack([arrays[name] for name in names])


def _torques(at: Evaluation, vdot: Array) -> Array:
    return at.terms.M @ vdot - at.F


def _torque_derivatives(at: Evaluation, vdot: Array) -> Array:
    return _side_by_side(inverse_arrays(at, vdot), "q", "v")


def _free_acceleration(at: Evaluation, vdot: Array) -> Array:
    return solve(at.terms.M, at.F, "M")


def _free_acceleration_derivatives(at: Evaluation, vdot: Array) -> Array:
    """Return M⁻¹ [-∂τ/∂q, -∂τ/∂v, 1] (n, 3n), at the acceleration by `at.tau`."""
    torques = _torque_derivatives(at, _free_acceleration(at, vdot))
    return solve(at.terms.M, np.hstack((-torques, np.eye(at.scene.n))), "M")


def _constraint_force_derivatives(at: Evaluation, vdot: Array) -> Array:
    if not at.scene.r:
        return np.zeros((0, 2 * at.scene.n))
    arrays = derivative_arrays(at, FORMULATIONS["au"])
    return _side_by_side(arrays, "multipliers_q", "multipliers_v")


WITH_ALL_FORCES: dict[str, Callable[[Evaluation, Array], Array]] = {
    "inverse_dynamics": _torques,
    "forward_dynamics": _free_acceleration,
    "inverse_dynamics_derivatives": _torque_derivatives,
    "forward_dynamics_derivatives": _free_acceleration_derivatives,
    "constraint_force_derivatives": _constraint_force_derivatives,
}
"""Name -> function of a state with its τ and of v̇: what `quantity` returns with the forces Q."""
