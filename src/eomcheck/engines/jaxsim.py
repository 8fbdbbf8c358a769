"""JaxSim: its free-floating dynamics in JAX, with the ground as a base that does not move.

A model is made of JaxSim's own descriptions of links, joints and frames, from a tree. It reads a
URDF only where the command `gz sdf` is installed, which its wheels do not have: no file is read
here. Velocities are in its mixed representation: linear ones of the origin of a frame, then
angular, both along the axes of the world; the first six of a result are those of the base and left
out. Its gravity is along z of the world, so that the tree is turned, and results are turned back.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from eomcheck.engines.jax_engine import InFloat64, JaxDynamics, derivatives_along
from eomcheck.engines.tree_engine import TreeLink, homogeneous
from eomcheck.errors import required
from eomcheck.numbers.generic import Array

BASE = 6
"""Number of velocities of the base, which come first."""

GROUND = "ground"
"""Name of the link that is the base."""

FRAME = "frame_"
"""Beginning of the names of frames, which may not be those of links."""

NO_MASS = 1e-30
"""Mass of links without mass, kg: JaxSim divides by it, and in any sum it is lost."""


@cache
def _functions() -> dict[str, Callable[..., Any]]:
    """Return the compiled functions of a model, q, v and more, by name."""
    jax, js = required("jax", "jaxsim"), required("jaxsim.api", "jaxsim")
    model_of, com, frame = js.model, js.com, js.frame

    def joints(array):
        return array[BASE:, BASE:] if array.ndim == 2 else array[BASE:]

    def state(model, q, v):
        return js.data.JaxSimModelData.build(model=model, joint_positions=q, joint_velocities=v)

    def of_state(function, part=lambda array: array):
        return lambda model, q, v: part(function(model=model, data=state(model, q, v)))

    def of_frame(function):
        def at_frame(model, q, v, index):
            return function(model=model, data=state(model, q, v), frame_index=index)

        return at_frame

    def inverse(model, q, v, vdot):
        data = state(model, q, v)
        return model_of.inverse_dynamics(model=model, data=data, joint_accelerations=vdot)[1]

    def forward(model, q, v, tau):
        return model_of.forward_dynamics(model=model, data=state(model, q, v), joint_forces=tau)[1]

    functions = {
        "mass_matrix": of_state(model_of.free_floating_mass_matrix, joints),
        "bias": of_state(model_of.free_floating_bias_forces, joints),
        "gravity": of_state(model_of.free_floating_gravity_forces, joints),
        "coriolis_matrix": of_state(model_of.free_floating_coriolis_matrix, joints),
        "kinetic_energy": of_state(model_of.kinetic_energy),
        "potential_energy": of_state(model_of.potential_energy),
        "center": of_state(com.com_position),
        "center_velocity": of_state(com.com_linear_velocity),
        "momentum": of_state(com.centroidal_momentum),
        "momentum_matrix": of_state(com.centroidal_momentum_jacobian),
        "inverse": inverse,
        "forward": forward,
        "inverse_derivatives": derivatives_along(inverse),
        "forward_derivatives": derivatives_along(forward),
        "placement": of_frame(frame.transform),
        "velocity": of_frame(frame.velocity),
        "jacobian": of_frame(frame.jacobian),
        "jacobian_rate": of_frame(frame.jacobian_derivative),
    }
    return {name: jax.jit(function) for name, function in functions.items()}


class JaxsimEngine(JaxDynamics):
    """Tree of rigid bodies in JaxSim, in float32."""

    key = "jaxsim"
    extra = module = "jaxsim"
    oldest = "0.9"
    coriolis_skew = True

    def _build(self, library: Any, links: list[TreeLink]) -> None:
        self._turn = _turned_down(self._gravity)
        build = required("jaxsim.api", self.extra).model.JaxSimModel.build
        weight = float(np.linalg.norm(self._gravity))
        with self._precision():
            description = self._description(links)
            self._under_gravity, self._weightless = (
                build(description, gravity=-g) for g in (weight, 0.0)
            )
        names = list(self._weightless.joint_names())
        self._place = np.array([names.index(f"joint_of_{link.name}") for link in links])
        own = enumerate(self._weightless.frame_names(), self._weightless.number_of_links())
        self._seats = {name.removeprefix(FRAME): index for index, name in own}

    def _description(self, links: list[TreeLink]) -> Any:
        """Return JaxSim's description of a tree."""
        parsers = required("jaxsim.parsers.descriptions", self.extra)
        kinds, inertia = parsers.JointType, required("jaxsim.math", self.extra).Inertia.to_sixd
        ground = inertia(mass=NO_MASS, com=np.zeros(3), I=np.zeros((3, 3)))
        described = {-1: parsers.LinkDescription(name=GROUND, mass=NO_MASS, inertia=ground)}
        joints = []
        for j, link in enumerate(links):
            mass = max(link.mass, NO_MASS)
            own = inertia(mass=mass, com=link.center, I=link.inertia)
            described[j] = parsers.LinkDescription(name=link.name, mass=mass, inertia=own)
            turn = self._turn if link.parent < 0 else np.eye(3)
            joints.append(
                parsers.JointDescription(
                    name=f"joint_of_{link.name}",
                    axis=link.axis,
                    pose=homogeneous(turn @ link.rotation, turn @ link.offset),
                    jtype=kinds.Prismatic if link.slides else kinds.Revolute,
                    parent=described[link.parent],
                    child=described[j],
                )
            )
        frames = [
            parsers.LinkDescription(
                name=FRAME + frame.name,
                mass=0.0,
                inertia=np.zeros((3, 3)),
                parent_name=links[frame.joint].name,
                pose=homogeneous(frame.R, frame.p),
            )
            for frame in self.frames
            if frame.joint >= 0
        ]
        return parsers.ModelDescription.build_model_from(
            name="tree",
            links=list(described.values()),
            joints=joints,
            frames=frames,
            fixed_base=True,
            base_link_name=GROUND,
        )

    def _ask(self, name: str, q: Array, v: Array | None, *more: Any, weight: bool = False) -> Any:
        """Return the result of a function, at rest if there are no velocities."""
        model = self._under_gravity if weight else self._weightless
        v = np.zeros(self._n) if v is None else v
        state = self._in_own_order(q), self._in_own_order(v)
        return self._computed(_functions, name, model, *state, *more)

    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M (n, n) by `free_floating_mass_matrix`."""
        return self._in_tree_order(self._ask("mass_matrix", q, None))

    def bias(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return B (n,) by `free_floating_bias_forces` of a model without gravity."""
        return self._ask("bias", q, v)[self._place]

    # ---- Conformance quantities ------------------------------------------------------------------

    def _dynamics(self, name: str, q: Array, v: Array, third: Array, *more: Any) -> Any:
        return self._ask(name, q, v, self._in_own_order(third), *more, weight=True)

    def inverse_dynamics(self, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return τ (n,) by `inverse_dynamics`."""
        return self._dynamics("inverse", q, v, vdot)[self._place]

    def forward_dynamics(self, q: Array, v: Array, tau: Array, t: float = 0.0) -> Array:
        """Return v̇ (n,) by `forward_dynamics`, articulated bodies."""
        return self._dynamics("forward", q, v, tau)[self._place]

    def gravity(self, q: Array, t: float = 0.0) -> Array:
        """Return ∂U/∂q (n,) by `free_floating_gravity_forces`."""
        return self._ask("gravity", q, None, weight=True)[self._place]

    def coriolis_matrix(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return C (n, n) by `free_floating_coriolis_matrix`."""
        return self._in_tree_order(self._ask("coriolis_matrix", q, v))

    def kinetic_energy(self, q: Array, v: Array, t: float = 0.0) -> float:
        """Return T by `kinetic_energy`."""
        return float(self._ask("kinetic_energy", q, v))

    def potential_energy(self, q: Array, t: float = 0.0) -> float:
        """Return U by `potential_energy`."""
        return float(self._ask("potential_energy", q, None, weight=True))

    def center_of_mass(self, q: Array, t: float = 0.0) -> Array:
        """Return c (3,) by `com_position`."""
        return self._turn.T @ self._ask("center", q, None)

    def center_of_mass_velocity(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return ċ (3,) by `com_linear_velocity`."""
        return self._turn.T @ self._ask("center_velocity", q, v)

    def momentum(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return h (6,) by `centroidal_momentum`."""
        return self._turned_back(self._ask("momentum", q, v))

    def momentum_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return A (6, n) by `centroidal_momentum_jacobian`."""
        return self._columns(self._ask("momentum_matrix", q, None))

    def _turned_back(self, motion: Array) -> Array:
        """Return a linear and an angular part (6, ...) along the axes of the tree's ground."""
        return np.concatenate([self._turn.T @ part for part in np.split(motion, 2)])

    def _columns(self, array: Array) -> Array:
        """Return the columns of joints of an array (6, 6 + n), in the order of the tree."""
        return self._turned_back(array)[:, BASE:][:, self._place]

    def frame_placement(self, f: str, q: Array, t: float = 0.0) -> tuple[Array, Array]:
        """Return (R, p) by `frame.transform`."""
        H = self._ask("placement", q, None, self._seat(f))
        return self._turn.T @ H[:3, :3], self._turn.T @ H[:3, 3]

    def frame_velocity(self, f: str, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return the velocity (6,) by `frame.velocity`."""
        return self._turned_back(self._ask("velocity", q, v, self._seat(f)))

    def frame_jacobian(self, f: str, q: Array, t: float = 0.0) -> Array:
        """Return J (6, n) by `frame.jacobian`."""
        return self._columns(self._ask("jacobian", q, None, self._seat(f)))

    def frame_bias(self, f: str, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return J̇ v (6,) with J̇ by `frame.jacobian_derivative`."""
        return self._columns(self._ask("jacobian_rate", q, v, self._seat(f))) @ v


def _turned_down(gravity: Array) -> Array:
    """Return a rotation (3, 3) that turns gravity into the direction of -z."""
    size = np.linalg.norm(gravity)
    if not size:
        return np.eye(3)
    up = -gravity / size
    if up[2] == 1.0:
        return np.eye(3)
    # Two reflections: one exchanges `up` and z, the other keeps z.
    axis = up - np.array([0.0, 0.0, 1.0])
    reflection = np.eye(3) - 2.0 * np.outer(axis, axis) / (axis @ axis)
    return np.diag([1.0, -1.0, 1.0]) @ reflection


class Jaxsim64Engine(InFloat64, JaxsimEngine):
    """Tree of rigid bodies in JaxSim, in float64."""

    key = "jaxsim64"
