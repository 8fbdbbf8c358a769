"""Brax: its generalized pipeline, with derivatives by JAX's forward mode.

Brax is handed a model that MuJoCo has compiled, of a URDF or of a tree, and copies it. It reads an
MJCF by its own `load`, which merges bodies without joints and then has MuJoCo compile the rest.
A body has three joints at most, all at one point, or a free one, with coordinates and velocities as
in MuJoCo; a spatial motion has the angular part first, about the centre of mass of all bodies. Its
`dynamics.inverse` takes no accelerations: it is the bias. Springs, dampers and gravity are left out
where a result has none of them, contacts and limits everywhere.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from eomcheck.engines.jax_engine import InFloat64, JaxEngine, derivatives_along
from eomcheck.engines.mujoco import MujocoEngine, MujocoFile
from eomcheck.engines.mujoco_copy import MujocoCopy, MujocoCopyOfFile, MujocoCopyOfMjcf
from eomcheck.engines.tree_engine import (
    BodyWithJoints,
    TreeInputs,
    TreeLink,
    bodies_with_mass,
)
from eomcheck.errors import EngineError, required
from eomcheck.numbers.generic import Array

STACK = 3
"""Largest number of joints of a body."""


@cache
def _functions() -> dict[str, Callable[..., Any]]:
    """Return the compiled functions of a system and a state, by name."""
    jax = required("jax", "brax")
    kinematics, math = required("brax.kinematics", "brax"), required("brax.math", "brax")
    base = required("brax.generalized.base", "brax")
    constraint = required("brax.generalized.constraint", "brax")
    dynamics = required("brax.generalized.dynamics", "brax")
    integrator = required("brax.generalized.integrator", "brax")
    mass = required("brax.generalized.mass", "brax")

    def moved(system, q, v):
        x, xd = kinematics.forward(system, q, v)
        return dynamics.transform_com(system, base.State.init(q, v, x, xd))

    def state(system, q, v):
        s = mass.matrix_inv(system, moved(system, q, v), 0)
        masses = system.link.inertia.mass
        return {
            "M": s.mass_mx,
            "inverse": s.mass_mx_inv,
            "bias": dynamics.inverse(system, s),
            "com": masses @ s.root_com / masses.sum(),
            "poses": (jax.vmap(math.quat_to_3x3)(s.x.rot), s.x.pos),
            "velocities": (s.xd.vel, s.xd.ang),
        }

    def forces(system, q, v):
        s = moved(system, q, jax.numpy.zeros_like(v))
        return dynamics.forward(system, s.replace(qd=v), jax.numpy.zeros_like(v))

    def forward(system, q, v, tau):
        s = mass.matrix_inv(system, moved(system, q, v), 0)
        s = s.replace(qf_smooth=dynamics.forward(system, s, tau))
        return integrator.integrate(system, s).qdd

    def jacobian(system, q, point, link):
        s = moved(system, q, jax.numpy.zeros(system.qd_size()))
        motion = constraint.point_jacobian(system, s.root_com, s.cdof, point, link)
        return motion.vel, motion.ang

    compiled = {
        "state": state,
        "forces": forces,
        "forward": forward,
        "jacobian": jacobian,
        "forward_derivatives": derivatives_along(forward),
    }
    return {name: jax.jit(function) for name, function in compiled.items()}


class BraxEngine(JaxEngine, MujocoCopy):
    """Tree of rigid bodies as a Brax system, in float32."""

    key = "brax"
    extra = "brax"
    module = "brax.io.mjcf"
    oldest = "0.14"

    @classmethod
    def holds(cls, links: list[TreeLink]) -> bool:
        """Return whether MuJoCo holds it, and each body has few joints, all at one point."""
        return super().holds(links) and all(map(_is_stack, bodies_with_mass(links) or ()))

    def _load(self, library: Any, model: Any) -> None:
        """Copy a compiled model of MuJoCo.

        Raises:
            EngineError: a body has no joint.
        """
        if len(set(model.jnt_bodyid)) < model.nbody - 1:
            raise EngineError(f"{self.key} needs a joint of every body")
        with self._precision():
            # Models of one topology share what is compiled: their names are no part of it.
            system = library.load_model(model).replace(mj_model=None, link_names=[])
            system = system.replace(enable_fluid=False)
            zero = np.zeros_like(model.dof_damping)
            undamped = system.dof.replace(stiffness=zero, damping=zero)
            self._weightless = system.replace(gravity=np.zeros(3), dof=undamped)
            self._under_weight = system.replace(gravity=self._gravity, dof=undamped)
            self._complete = system.replace(gravity=self._gravity)
        self._model = model

    def _call(self, name: str, system: Any, q: Array, *arguments: Any) -> Any:
        return self._computed(_functions, name, system, self._ordered(q), *arguments)

    def _state(self, q: Array, v: Array, system: Any = None) -> dict[str, Any]:
        system = self._weightless if system is None else system
        return self._call("state", system, q, self._in_own_order(v))

    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M (n, n) by `mass.matrix`."""
        return self._in_tree_order(self._state(q, np.zeros(self._n))["M"])

    def bias(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return B (n,) by `dynamics.inverse` of a system without gravity."""
        return self._state(q, v)["bias"][self._place]

    # ---- Conformance quantities ------------------------------------------------------------------

    def inverse_mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M⁻¹ (n, n) by `mass.matrix_inv`, not by its iterations."""
        return self._in_tree_order(self._state(q, np.zeros(self._n))["inverse"])

    def gravity(self, q: Array, t: float = 0.0) -> Array:
        """Return ∂U/∂q (n,) by `dynamics.inverse` at rest."""
        return self._state(q, np.zeros(self._n), self._under_weight)["bias"][self._place]

    def forward_dynamics(self, q: Array, v: Array, tau: Array, t: float = 0.0) -> Array:
        """Return v̇ (n,) by `dynamics.forward` and `integrator.integrate`."""
        state = self._in_own_order(v), self._in_own_order(tau)
        return self._call("forward", self._under_weight, q, *state)[self._place]

    def forward_dynamics_derivatives(
        self, q: Array, v: Array, tau: Array, t: float = 0.0
    ) -> tuple[Array, Array, Array]:
        """Return ∂v̇/∂q, ∂v̇/∂v and ∂v̇/∂τ by `jax.jacfwd` of the same."""
        state = self._in_own_order(v), self._in_own_order(tau), self._rates(self._ordered(q))
        parts = self._call("forward_derivatives", self._under_weight, q, *state)
        by_q, by_v, by_tau = map(self._in_tree_order, parts)
        return by_q, by_v, by_tau

    def center_of_mass(self, q: Array, t: float = 0.0) -> Array:
        """Return c (3,), the mean of `root_com`, weighted by mass."""
        return self._state(q, np.zeros(self._n))["com"]

    def _seat(self, f: str) -> tuple[int, Array, Array]:
        """Return the link that has the frame of a link, and its orientation and position there."""
        frame = next(frame for frame in self.frames if frame.name == f)
        site = self._model.site(f)
        return int(site.bodyid[0]) - 1, frame.R, frame.p

    def frame_placement(self, f: str, q: Array, t: float = 0.0) -> tuple[Array, Array]:
        """Return (R, p) of `State.x`."""
        link, turn, at = self._seat(f)
        axes, origins = self._state(q, np.zeros(self._n))["poses"]
        return axes[link] @ turn, origins[link] + axes[link] @ at

    def frame_velocity(self, f: str, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return the velocity (6,) of `State.xd`."""
        link, _, at = self._seat(f)
        state = self._state(q, v)
        velocity, omega = (x[link] for x in state["velocities"])
        arm = state["poses"][0][link] @ at
        return np.concatenate((velocity + np.cross(omega, arm), omega))

    def frame_jacobian(self, f: str, q: Array, t: float = 0.0) -> Array:
        """Return J (6, n) by `constraint.point_jacobian`."""
        link, _, p = self._seat(f)[0], *self.frame_placement(f, q)
        linear, angular = self._call("jacobian", self._weightless, q, p, link)
        return np.vstack((linear.T, angular.T))[:, self._place]


def _is_stack(mounted: BodyWithJoints) -> bool:
    """Return whether the joints of a body are few and at one point."""
    points = np.array([joint.position for joint in mounted.joints])
    return len(points) <= STACK and not np.ptp(points, axis=0).any()


class Brax64Engine(InFloat64, BraxEngine):
    """Tree of rigid bodies as a Brax system, in float64."""

    key = "brax64"


class BraxFile(MujocoCopyOfFile, BraxEngine):
    """URDF that MuJoCo reads, as a Brax system in float32."""

    key = "brax_file"

    def _prepare(self, builder: MujocoEngine) -> None:
        assert isinstance(builder, MujocoFile)
        builder.merges_under_free_base = True

    def _links(self) -> list[str]:
        """Return the names of Brax's links."""
        return [self._model.body(i).name for i in range(1, self._model.nbody)]

    def has_frame(self, f: str) -> bool:
        """Return whether there is a link of this name."""
        return f in self._links()

    def _seat(self, f: str) -> tuple[int, Array, Array]:
        return self._links().index(f), np.eye(3), np.zeros(3)

    def forces(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return Q (m,) by `dynamics.forward`: gravity, springs and dampers."""
        return self._call("forces", self._complete, q, self._in_own_order(v))[self._place]

    def free_acceleration(self, q: Array, v: Array) -> Array:
        """Return ẍ (m,) by `dynamics.forward` and `integrator.integrate`."""
        arguments = self._in_own_order(v), np.zeros(self._n)
        return self._call("forward", self._complete, q, *arguments)[self._place]


class Brax64File(InFloat64, BraxFile):
    """URDF that MuJoCo reads, as a Brax system in float64."""

    key = "brax64_file"


class BraxMjcf(MujocoCopyOfMjcf, BraxFile):
    """MJCF that Brax reads, in float32."""

    key = "brax_mjcf"

    def _load(self, library: Any, model: Any) -> None:
        """Have Brax read the file by itself: MuJoCo's reading names the joints alone."""
        own = library.load_mjmodel(self.file)
        if own.ngeom:  # it raises IndexError without
            library.validate_model(own)
        super()._load(library, own)

    def set_up(self, inputs: TreeInputs) -> None:
        """Read the file."""
        super().set_up(inputs)
        theirs, own = self._builder.model, self._model
        order = _matched_joints(theirs, own)
        self._place = _entries(own.jnt_dofadr, own.nv, order)
        self._position_place = _entries(own.jnt_qposadr, own.nq, order)

    def _ordered(self, values: Array) -> Array:
        ordered = np.zeros(len(values))
        ordered[self._position_place] = values
        return ordered

    def _rates(self, x: Array) -> Array:
        rates = np.zeros((len(x), self._n))
        placed = np.ix_(self._position_place, self._place)
        rates[placed] = self._builder.position_rates(x[self._position_place])
        return rates


def _matched_joints(first: Any, second: Any) -> list[int]:
    """Return the joint of the second model for each of the first, by its name or its body's.

    Brax moves the joints behind a body that it merges to the end.

    Raises:
        EngineError: they have different joints.
    """
    keys = []
    for model in (first, second):
        joints, numbers = defaultdict(list), {}
        for j, body in enumerate(model.jnt_bodyid):
            numbers[body] = numbers.get(body, -1) + 1
            key = model.joint(j).name or (model.body(body).name, numbers[body])
            joints[key].append(j)
        keys.append(joints)
    if {k: len(x) for k, x in keys[0].items()} != {k: len(x) for k, x in keys[1].items()}:
        raise EngineError("brax has other joints than the file")
    pairs = [pair for k in keys[0] for pair in zip(keys[0][k], keys[1][k], strict=True)]
    return [there for _, there in sorted(pairs)]


def _entries(starts: Array, count: int, order: list[int]) -> Array:
    """Return the index of each entry of joints that are in another order.

    Args:
        starts: index of the first entry of each joint.
        count: number of entries.
        order: the joints in the other order.
    """
    ends = np.append(starts[1:], count)
    return np.concatenate([np.arange(starts[j], ends[j]) for j in order])


class Brax64Mjcf(InFloat64, BraxMjcf):
    """MJCF that Brax reads, in float64."""

    key = "brax64_mjcf"
