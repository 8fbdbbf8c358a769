"""Robotics Toolbox for Python: its `ERobot`, by a recursive Newton-Euler algorithm in Python.

Jacobians have the linear part first, along the axes of the world. It has no free base, no energies,
no centre of mass, no momentum and no regressor, and velocities of frames by the Jacobian alone. Its
`coriolis` raises for every `ERobot` of several links, and damages the robot: it is not asked.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from eomcheck.engines.file_engine import FileEngine, RobotDescription, is_free
from eomcheck.engines.tree_engine import TreeEngine, TreeLink, homogeneous
from eomcheck.errors import required
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array


class RoboticsToolboxEngine(TreeEngine):
    """Tree of rigid bodies as an `ERobot`."""

    key = "roboticstoolbox"
    module = extra = "roboticstoolbox"
    oldest = "1.5"
    any_inertia = True

    @classmethod
    def distribution(cls) -> str:
        """Return "roboticstoolbox-python", the name of its wheels."""
        return "roboticstoolbox-python"

    @classmethod
    def holds(cls, links: list[TreeLink]) -> bool:
        """Return whether any link has mass: others the toolbox takes for kinematics alone."""
        return any(link.mass > 0 for link in links)

    robot: Any
    """The `ERobot`."""

    def _build(self, library: Any, links: list[TreeLink]) -> None:
        self.robot = self._assembled(library, links)
        self._seats = {frame.name: f"frame of {frame.name}" for frame in self.frames}
        self._place = np.array([self.robot.link_dict[link.name].jindex for link in links])

    def _assembled(self, library: Any, links: list[TreeLink]) -> Any:
        """Return a robot of the links, and of a link without mass for each frame."""
        element, chain = library.ET, library.ETS
        ground = library.Link(chain(), name="ground")
        bodies = []
        for link in links:
            kind = ("t" if link.slides else "R") + link.kind[1]
            seat = element.SE3(homogeneous(link.rotation, link.offset))
            bodies.append(
                library.Link(
                    chain([seat, getattr(element, kind)()]),
                    name=link.name,
                    parent=bodies[link.parent] if link.parent >= 0 else ground,
                    m=link.mass,
                    r=link.center,
                    I=link.inertia,
                    Jm=link.armature,
                )
            )
        frames = []
        for frame in self.frames:
            carrier = bodies[frame.joint] if frame.joint >= 0 else ground
            seat, name = element.SE3(homogeneous(frame.R, frame.p)), f"frame of {frame.name}"
            frames.append(library.Link(chain([seat]), name=name, parent=carrier))
        return library.ERobot([ground, *bodies, *frames])

    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M (n, n) by `inertia`."""
        return self._in_tree_order(self.robot.inertia(self._in_own_order(q)))

    def bias(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return B (n,) by `rne`, without gravity."""
        return self._inverse(np.zeros(3), q, v, np.zeros(self._n))

    def _inverse(self, gravity: Array, q: Array, v: Array, vdot: Array) -> Array:
        """Return the forces (n,) of inverse dynamics under gravity (3,)."""
        state = map(self._in_own_order, (q, v, vdot))
        return self.robot.rne(*state, gravity=gravity)[self._place]

    # ---- Conformance quantities ------------------------------------------------------------------

    def inverse_dynamics(self, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return τ (n,) by `rne`."""
        return self._inverse(self._gravity, q, v, vdot)

    def forward_dynamics(self, q: Array, v: Array, tau: Array, t: float = 0.0) -> Array:
        """Return v̇ (n,) by `accel`."""
        state = map(self._in_own_order, (q, v, tau))
        return self.robot.accel(*state, gravity=self._gravity)[self._place]

    def gravity(self, q: Array, t: float = 0.0) -> Array:
        """Return ∂U/∂q (n,) by `gravload`."""
        return self.robot.gravload(self._in_own_order(q), gravity=self._gravity)[self._place]

    def frame_placement(self, f: str, q: Array, t: float = 0.0) -> tuple[Array, Array]:
        """Return (R, p) by `fkine`."""
        pose = self.robot.fkine(self._in_own_order(q), end=self._seat(f))
        return pose.R, pose.t

    def _moving(self, f: str) -> Array:
        """Return the indices of the joints between the ground and a link."""
        return np.array(self.robot.ets(end=self._seat(f)).jindices, int)

    def frame_jacobian(self, f: str, q: Array, t: float = 0.0) -> Array:
        """Return J (6, n) by `jacob0`, of the joints between the ground and the link."""
        jacobian, moving = np.zeros((6, self._n)), self._moving(f)
        if len(moving):
            jacobian[:, moving] = self.robot.jacob0(self._in_own_order(q), end=self._seat(f))
        return jacobian[:, self._place]

    def frame_bias(self, f: str, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return J̇ v (6,) by `hessian0`, the derivatives of J by q."""
        moving, own = self._moving(f), self._in_own_order(v)
        if not len(moving):
            return np.zeros(6)
        rates = self.robot.hessian0(self._in_own_order(q), end=self._seat(f))
        return np.tensordot(rates, own[moving], (0, 0)) @ own[moving]


# ---- Model read from a URDF ----------------------------------------------------------------------


class RoboticsToolboxFile(FileEngine, RoboticsToolboxEngine):
    """URDF read by `URDF_file` of the toolbox, its base fixed."""

    key = "roboticstoolbox_file"

    @classmethod
    def represents(cls, scene: Scene) -> bool:
        """Return whether the scene is a robot with the parameters of its file and a fixed base."""
        return super().represents(scene) and not is_free(scene)

    def _read(self, library: Any, description: RobotDescription) -> None:
        reader = required("roboticstoolbox.models.URDF.URDFRobot", self.extra)
        self.robot = library.ERobot(reader.URDF_file(io.StringIO(description.text))[0])
        moving = sorted((x for x in self.robot.links if x.isjoint), key=lambda link: link.jindex)
        self._moved, self._joints = moving, [link._joint_name for link in moving]
        self._seats = {x.name: x.name for x in self.frames if x.name in self.robot.link_dict}
        self._friction = [link.B for link in moving]
        for link in moving:
            link.B = 0.0

    @contextmanager
    def _rubbing(self) -> Iterator[None]:
        """Turn on the viscous friction that was read."""
        for link, friction in zip(self._moved, self._friction, strict=True):
            link.B = friction
        try:
            yield
        finally:
            for link in self._moved:
                link.B = 0.0

    def forces(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return Q (m,) of gravity and of the friction that it reads."""
        with self._rubbing():
            friction = [link.friction(x) for link, x in zip(self._moved, v, strict=True)]
        return np.array(friction) - self.gravity(q)

    def free_acceleration(self, q: Array, v: Array) -> Array:
        """Return ẍ (m,) by `accel`."""
        with self._rubbing():
            return self.forward_dynamics(q, v, np.zeros(self._n))
