"""adam: its `KinDynComputations` in JAX or NumPy, with the ground as a base that does not move.

All models have a free base: of a fixed one the part of the joints is used. Velocities are in its
`MIXED_REPRESENTATION`: linear ones of the origin of a frame, then angular, both along the axes of
the world. It has no inverse dynamics with accelerations, no energies and no velocities, and forward
dynamics of free bases alone. It reads URDFs without prismatic joints; a tree is handed over as one.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any
from xml.etree import ElementTree

import numpy as np

from eomcheck.engines.file_engine import BaseVelocity, FileEngine, FreeBase, RobotDescription
from eomcheck.engines.jax_engine import InFloat64, JaxEngine
from eomcheck.engines.pybullet import urdf_of_links
from eomcheck.engines.tree_engine import TreeEngine, TreeLink
from eomcheck.errors import required
from eomcheck.numbers.generic import Array

BASE, POSE = 6, 12
"""Numbers of velocities and of coordinates of the base, which come first."""


class AdamNumpyEngine(TreeEngine):
    """Tree of rigid bodies in adam's NumPy."""

    key = "adam_numpy"
    module, extra = "adam.numpy", "adam"
    oldest = "0.5"

    @classmethod
    def distribution(cls) -> str:
        """Return "adam-robotics", the name of its wheels."""
        return "adam-robotics"

    @classmethod
    def holds(cls, links: list[TreeLink]) -> bool:
        """Return whether no joint is prismatic: adam stops at those."""
        return super().holds(links) and not any(link.slides for link in links)

    def _build(self, library: Any, links: list[TreeLink]) -> None:
        names = [f"joint_of_{link.name}" for link in links]
        self._dynamics = self._made(library, urdf_of_links(links), names)
        self._place = np.arange(len(links))
        self._seats = {
            frame.name: (links[frame.joint].name, frame.R, frame.p)
            for frame in self.frames
            if frame.joint >= 0
        }

    def _made(self, library: Any, text: str, joints: list[str] | None) -> Any:
        """Return the library's object of a URDF."""
        gravity = np.concatenate((self._gravity, np.zeros(3)))
        return library.KinDynComputations(text, joints, gravity=gravity)

    def _evaluated(self, name: str, frame: str, *arguments: Any) -> Array:
        """Return the result of a method, of the frame of a link if it is named."""
        of = (frame,) if frame else ()
        return np.array(getattr(self._dynamics, name)(*of, *arguments))

    @property
    def _held(self) -> int:
        """Number of velocities of the library that are no coordinates: those of a held base."""
        return BASE - self.base

    def _ask(self, name: str, q: Array, v: Array | None = None, frame: str = "") -> Array:
        """Return the result of a method at q, and at w where it takes velocities."""
        H = np.eye(4)
        if self.base:
            pose, q = np.split(q, [POSE])
            H[:3, 3], H[:3, :3] = pose[:3], pose[3:].reshape(3, 3)
        state: tuple[Array, ...] = H, q
        if v is not None:
            state += tuple(np.split(self._padded(v), [BASE]))
        return self._evaluated(name, frame, *state)

    def _padded(self, v: Array) -> Array:
        """Return velocities with those of a held base, 0."""
        return np.concatenate((np.zeros(self._held), v))

    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M (n, n) by `mass_matrix`."""
        return self._ask("mass_matrix", q)[self._held :, self._held :]

    def bias(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return B (n,) by `coriolis_term`."""
        return self._ask("coriolis_term", q, v)[self._held :]

    # ---- Conformance quantities ------------------------------------------------------------------

    def gravity(self, q: Array, t: float = 0.0) -> Array:
        """Return ∂U/∂q (n,) by `gravity_term`."""
        return self._ask("gravity_term", q)[self._held :]

    def center_of_mass(self, q: Array, t: float = 0.0) -> Array:
        """Return c (3,) by `CoM_position`."""
        return self._ask("CoM_position", q)

    def center_of_mass_jacobian(self, q: Array, t: float = 0.0) -> Array:
        """Return ∂ċ/∂v (3, n) by `CoM_jacobian`."""
        return self._ask("CoM_jacobian", q)[:, self._held :]

    def momentum_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return A (6, n) by `centroidal_momentum_matrix`."""
        return self._ask("centroidal_momentum_matrix", q)[:, self._held :]

    def frame_placement(self, f: str, q: Array, t: float = 0.0) -> tuple[Array, Array]:
        """Return (R, p) by `forward_kinematics`."""
        link, turn, at = self._seats[f]
        H = self._ask("forward_kinematics", q, frame=link)
        return H[:3, :3] @ turn, H[:3, 3] + H[:3, :3] @ at

    def _at_frame(self, f: str, q: Array, columns: Array) -> Array:
        """Return a Jacobian (6, m) of the origin of a link's frame, from that of the link."""
        link, _, at = self._seats[f]
        arm = self._ask("forward_kinematics", q, frame=link)[:3, :3] @ at
        linear, angular = np.split(columns, 2)
        return np.vstack((linear + np.cross(angular.T, arm).T, angular))

    def frame_jacobian(self, f: str, q: Array, t: float = 0.0) -> Array:
        """Return J (6, n) by `jacobian`."""
        J = self._ask("jacobian", q, frame=self._seats[f][0])
        return self._at_frame(f, q, J)[:, self._held :]

    def frame_bias(self, f: str, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return J̇ v (6,) with J̇ by `jacobian_dot`."""
        link, _, at = self._seats[f]
        bias = self._ask("jacobian_dot", q, v, frame=link) @ self._padded(v)
        omega = (self._ask("jacobian", q, frame=link) @ self._padded(v))[3:]
        arm = self._ask("forward_kinematics", q, frame=link)[:3, :3] @ at
        bias[:3] += np.cross(bias[3:], arm) + np.cross(omega, np.cross(omega, arm))
        return bias


class AdamNumpyFile(FileEngine, AdamNumpyEngine):
    """URDF read by `KinDynComputations`, in NumPy."""

    key = "adam_numpy_file"
    base_velocity = BaseVelocity("ground", "ground")

    def _read(self, library: Any, description: RobotDescription) -> None:
        held = () if self.base else [frame.name for frame in self.frames if frame.joint < 0]
        self._dynamics = self._made(library, _without_mass(description.text, held), None)
        model = self._dynamics.rbdalgos.model
        self._joints = list(model.actuated_joints)
        names = (*model.links, *model.frames)
        self._seats = {name: (name, np.eye(3), np.zeros(3)) for name in names}

    def pose(self, base: FreeBase) -> Array:
        """Return the position and the rotation matrix."""
        return np.concatenate([base.position, base.R.ravel()])

    def forces(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return Q (m,) of gravity."""
        return -self.gravity(q, t)


def _without_mass(text: str, links: tuple[str, ...] | list[str]) -> str:
    """Return a URDF without the inertia of links that do not move: adam counts it as moving."""
    robot = ElementTree.fromstring(text)
    for link in robot.findall("link"):
        if link.get("name") in links:
            for inertial in link.findall("inertial"):
                link.remove(inertial)
    return ElementTree.tostring(robot, encoding="unicode")


class AdamEngine(JaxEngine, AdamNumpyEngine):
    """Tree of rigid bodies in adam's JAX, in float32."""

    key = "adam"
    module = "adam.jax"

    def _made(self, library: Any, text: str, joints: list[str] | None) -> Any:
        gravity = np.concatenate((self._gravity, np.zeros(3)))
        self._compiled: dict[tuple[str, str], Callable[..., Any]] = {}
        with self._precision():
            return library.KinDynComputations(text, joints, dtype=self._dtype, gravity=gravity)

    def _evaluated(self, name: str, frame: str, *arguments: Any) -> Array:
        return self._computed(self._functions, name, frame, *arguments)

    def _functions(self) -> dict[str, Callable[..., Any]]:
        """Return the methods by name, each compiled once for a frame."""
        return {name: partial(self._run, name) for name in dir(self._dynamics)}

    def _run(self, name: str, frame: str, *arguments: Any) -> Any:
        if (name, frame) not in self._compiled:
            method = getattr(self._dynamics, name)
            of = partial(method, frame) if frame else method
            self._compiled[name, frame] = required("jax", self.extra).jit(of)
        return self._compiled[name, frame](*arguments)


class Adam64Engine(InFloat64, AdamEngine):
    """Tree of rigid bodies in adam's JAX, in float64."""

    key = "adam64"


class AdamFile(AdamEngine, AdamNumpyFile):
    """URDF read by `KinDynComputations`, in JAX in float32."""

    key = "adam_file"


class Adam64File(InFloat64, AdamFile):
    """URDF read by `KinDynComputations`, in JAX in float64."""

    key = "adam64_file"
