"""PyBullet: Bullet's multibody code, with a model that is read from a temporary URDF.

In a model read from the URDF of a robot, the base is fixed or free. A free base is represented by
the principal axes of its body. PyBullet is called as if these were momentarily the axes of the
ground, and its accelerations are those of the centre of mass along them: v̇ + ω × v, where v̇ is
the rate of the velocity along the axes of the base.

Frames of PyBullet are at the centre of mass of a link, along the principal axes of its inertia. The
frames of links follow from these: `getLinkState` also returns them, but in single precision.
"""

from __future__ import annotations

import tempfile
import weakref
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np

from eomcheck.atomic_write import write_text
from eomcheck.descriptions.vector_algebra import roll_pitch_yaw_of
from eomcheck.engines.file_engine import (
    FREE,
    BaseVelocity,
    FileEngine,
    FreeBase,
    RobotDescription,
    free_base,
)
from eomcheck.engines.tree_engine import TreeEngine, TreeLink
from eomcheck.mechanics.records import TreeFrame
from eomcheck.numbers.generic import Array

BASE = 7
"""Number of entries of a free base's pose; PyBullet counts joints after it even if it is fixed."""


class _LinkState(NamedTuple):
    """Motion of a link's centre of mass in PyBullet, along the axes of the world."""

    R: Array
    """Principal axes of the inertia, columns (3, 3)."""
    p: Array
    """Centre of mass (3,), m."""
    axes: Array
    """The same axes in the frame of the link (3, 3)."""
    center: Array
    """The same point in the frame of the link (3,), m."""
    velocity: Array
    """Velocity of the centre of mass (3,), m/s."""
    omega: Array
    """Angular velocity (3,), rad/s."""


class PybulletEngine(TreeEngine):
    """Tree of rigid bodies as a PyBullet multibody."""

    key = "pybullet"
    module = extra = "pybullet"
    _unit = 1.0

    @classmethod
    def takes(cls, link: TreeLink) -> bool:
        """Return whether all or none of the moments of a link are positive.

        PyBullet ignores all moments of a thin rod, of which one is 0.
        """
        moments = link.principal[0]
        return super().takes(link) and bool(moments[0] > 0 or not moments.any())

    def _build(self, library: Any, links: list[TreeLink]) -> None:
        self._unit = _unit_of_mass(links)
        index = {name: i for i, name in self._load(urdf_of_links(links, self._unit)).items()}
        self._place = np.array([index[f"joint_of_{link.name}"] for link in links])
        self._seats = {
            frame.name: (self._links[links[frame.joint].name], frame)
            for frame in self.frames
            if frame.joint >= 0
        }

    def _load(self, urdf: str, fixed: bool = True) -> dict[int, str]:
        """Load the text of a URDF into a world of its own; return index -> name of its joints."""
        self._bullet = self._library()
        # The number of connections is limited: one is closed when the engine is deleted.
        self._client = self._bullet.connect(self._bullet.DIRECT)
        weakref.finalize(self, self._bullet.disconnect, self._client)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "robot.urdf")
            write_text(path, urdf)
            # Without this flag moments of inertia are estimated from the shape, and there is none.
            flags = self._bullet.URDF_USE_INERTIA_FROM_FILE
            self._body = self._ask("loadURDF", str(path), useFixedBase=fixed, flags=flags)
        indices = range(self._ask("getNumJoints", self._body))
        joints = [self._ask("getJointInfo", self._body, i) for i in indices]
        self._links = {info[12].decode(): info[0] for info in joints}
        self._links[self._ask("getBodyInfo", self._body)[0].decode()] = -1
        moving = {info[3]: info[0] for info in joints if info[3] >= BASE}
        self._moving = [moving[i] for i in sorted(moving)]
        return {info[3] - BASE: info[1].decode() for info in joints if info[3] >= BASE}

    def _ask(self, function: str, *arguments: Any, **options: Any) -> Any:
        """Return the result of a function of PyBullet in the world of this engine."""
        return getattr(self._bullet, function)(*arguments, physicsClientId=self._client, **options)

    def _ordered(self, x: Array) -> list[float]:
        return self._in_own_order(x).tolist()

    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M (n, n)."""
        M = self._ask("calculateMassMatrix", self._body, self._ordered(q))
        return self._unit * self._in_tree_order(np.array(M))

    def bias(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return B (n,) by inverse dynamics; a new world has no gravity."""
        state = self._ordered(q), self._ordered(v), [0.0] * self._n
        forces = self._ask("calculateInverseDynamics", self._body, *state)
        return self._unit * np.array(forces)[self._place]

    # ---- Conformance quantities ------------------------------------------------------------------

    def inverse_dynamics(self, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return τ (n,) by `calculateInverseDynamics` under gravity."""
        self._ask("setGravity", *self._gravity)
        state = self._ordered(q), self._ordered(v), self._ordered(vdot)
        forces = self._ask("calculateInverseDynamics", self._body, *state)
        self._ask("setGravity", 0.0, 0.0, 0.0)
        return self._unit * np.array(forces)[self._place]

    def gravity(self, q: Array, t: float = 0.0) -> Array:
        """Return ∂U/∂q (n,) by `calculateInverseDynamics` at rest."""
        return self.inverse_dynamics(q, np.zeros(self._n), np.zeros(self._n), t)

    def _base_axes(self, x: Array) -> Array:
        """Return the axes of the base, along which Jacobians are (3, 3)."""
        return np.eye(3)

    def _reset(self, q: Array, v: Array) -> None:
        """Set the world of PyBullet to a state."""
        for joint, x, rate in zip(self._moving, self._ordered(q), self._ordered(v), strict=True):
            self._ask("resetJointState", self._body, joint, x, rate)

    def _link(self, f: str, q: Array, v: Array) -> tuple[TreeFrame, _LinkState]:
        """Return the frame of a link, fixed to one of PyBullet's, and the motion of that."""
        self._reset(q, v)
        index, frame = self._seats[f]
        if index < 0:
            state = *self._ask("getBasePositionAndOrientation", self._body), *self._inertial(-1)
            state = *state, *self._ask("getBaseVelocity", self._body)
        else:
            every = self._ask("getLinkState", self._body, index, 1, 1)
            state = *every[:4], *every[6:8]
        p, turn, center, axes, velocity, omega = state
        R, axes = self._rotation(turn), self._rotation(axes)
        return frame, _LinkState(R, *map(np.array, (p, axes, center, velocity, omega)))

    def _inertial(self, index: int) -> tuple[Any, Any]:
        """Return centre of mass and quaternion of the principal axes, in the frame of a link."""
        info = self._ask("getDynamicsInfo", self._body, index)
        return info[3], info[4]

    def _rotation(self, quaternion: Any) -> Array:
        return np.array(self._bullet.getMatrixFromQuaternion(quaternion)).reshape(3, 3)

    def frame_placement(self, f: str, q: Array, t: float = 0.0) -> tuple[Array, Array]:
        """Return (R, p), from the pose of the centre of mass by `getLinkState`."""
        frame, link = self._link(f, q, np.zeros(self._n))
        R = link.R @ link.axes.T
        return R @ frame.R, link.p + R @ (frame.p - link.center)

    def frame_velocity(self, f: str, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return the velocity (6,), from that of the centre of mass by `getLinkState`."""
        frame, link = self._link(f, q, v)
        arm = link.R @ (link.axes.T @ (frame.p - link.center))
        return np.concatenate((link.velocity + np.cross(link.omega, arm), link.omega))

    def frame_jacobian(self, f: str, q: Array, t: float = 0.0) -> Array:
        """Return J (6, n) by `calculateJacobian`.

        Its point is along the principal axes of the link, from the link's origin, and from the
        centre of mass for the base. Its rows are along the principal axes of the base, whose
        columns come first, angular before linear ones.
        """
        frame, link = self._link(f, q, np.zeros(self._n))
        index, joints = self._seats[f][0], self._ordered(q)
        origin = link.center if index < 0 else np.zeros(3)
        point, rest = (link.axes.T @ (frame.p - origin)).tolist(), [0.0] * len(joints)
        parts = self._ask("calculateJacobian", self._body, index, point, joints, rest, rest)
        R = self._base_axes(q)
        return np.vstack([(R @ np.array(part))[:, self._place] for part in parts])


def _unit_of_mass(links: list[TreeLink]) -> float:
    """Return a power of two, kg, in which the largest moment of inertia is below 1.

    Bullet rotates inertias, and rejects one that is not symmetric to 1e-15, however large it is.
    """
    largest = max(max(link.principal[0]) for link in links)
    return 2.0 ** np.ceil(np.log2(largest)) if largest > 0 else 1.0


def urdf_of_links(links: list[TreeLink], unit: float = 1.0) -> str:
    """Return the links as a URDF, every number with all its digits; masses in a unit, kg."""
    robot = ElementTree.Element("robot", name="tree")
    _add_body(robot, "ground", 0.0, np.zeros(3), np.zeros(3), np.eye(3))
    for link in links:
        moments, axes = link.principal
        _add_body(robot, link.name, link.mass / unit, link.center, moments / unit, axes)
        parent = "ground" if link.parent < 0 else links[link.parent].name
        kind = "prismatic" if link.slides else "continuous"
        joint = ElementTree.SubElement(robot, "joint", name=f"joint_of_{link.name}", type=kind)
        ElementTree.SubElement(joint, "parent", link=parent)
        ElementTree.SubElement(joint, "child", link=link.name)
        rpy = _text(roll_pitch_yaw_of(link.rotation))
        ElementTree.SubElement(joint, "origin", xyz=_text(link.offset), rpy=rpy)
        ElementTree.SubElement(joint, "axis", xyz=_text(link.axis))
        if link.slides:
            limits: dict[str, str] = dict.fromkeys(("lower", "upper", "effort", "velocity"), "1")
            ElementTree.SubElement(joint, "limit", limits)  # required, but not enforced
    ElementTree.indent(robot)  # Bullet cuts long lines off
    return ElementTree.tostring(robot, encoding="unicode")


def _add_body(
    robot: Any, name: str, mass: float, center: Array, moments: Array, axes: Array
) -> None:
    inertial = ElementTree.SubElement(ElementTree.SubElement(robot, "link", name=name), "inertial")
    # Along principal axes: Bullet would rotate to them itself, to 1e-11 only.
    rpy = _text(roll_pitch_yaw_of(axes))
    ElementTree.SubElement(inertial, "origin", xyz=_text(center), rpy=rpy)
    ElementTree.SubElement(inertial, "mass", value=repr(float(mass)))
    about = {f"i{axis}{axis}": repr(float(x)) for axis, x in zip("xyz", moments, strict=True)}
    ElementTree.SubElement(inertial, "inertia", about | dict.fromkeys(("ixy", "ixz", "iyz"), "0"))


def _text(numbers: Iterable[float]) -> str:
    return " ".join(repr(float(x)) for x in numbers)


# ---- Model read from a URDF ----------------------------------------------------------------------

POSE = 16
"""Number of entries of `pose`: position, quaternion x, y, z, w, rotation."""

NOWHERE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
"""Position and quaternion x, y, z, w of a base that coincides with the ground."""


class PybulletFile(FileEngine, PybulletEngine):
    """URDF read by `pybullet.loadURDF`."""

    key = "pybullet_file"
    base_velocity = BaseVelocity("base", "base", turns_first=True)

    def _read(self, library: Any, description: RobotDescription) -> None:
        moving = self._load(description.text, not self.base)
        self._joints = [moving[i] for i in sorted(moving)]
        center, axes = self._inertial(-1)
        self._center, self._axes = np.array(center), self._rotation(axes)
        links = {frame.name: frame for frame in self.frames if frame.name in self._links}
        self._seats = {name: (self._links[name], frame) for name, frame in links.items()}

    def base_frame(self, q: Array, v: Array) -> FreeBase:
        """Return the frame of the principal axes of the base, at its centre of mass."""
        return free_base(q[:FREE], v[:FREE], self._center, self._axes)

    def pose(self, base: FreeBase) -> Array:
        """Return position, quaternion and rotation of the axes."""
        return np.concatenate([base.position, np.roll(base.quaternion, -1), base.R.ravel()])

    def _split(self, x: Array) -> tuple[Array, list[float]]:
        """Return the rotation of the axes of the base, and the coordinates of the joints."""
        pose, joints = np.split(x, [POSE if self.base else 0])
        return pose[BASE:].reshape(3, 3) if self.base else self._axes, joints.tolist()

    def _base_axes(self, x: Array) -> Array:
        return self._split(x)[0]

    def _reset(self, q: Array, v: Array) -> None:
        R, joints = self._split(q)
        rates = v.tolist()
        if self.base:
            position, turn = np.split(q[:BASE], [3])
            self._ask("resetBasePositionAndOrientation", self._body, position, turn)
            self._ask("resetBaseVelocity", self._body, R @ v[3:FREE], R @ v[:3])
            rates = rates[FREE:]
        for joint, x, rate in zip(self._moving, joints, rates, strict=True):
            self._ask("resetJointState", self._body, joint, x, rate)

    def _ordered(self, x: Array) -> list[float]:
        return self._split(x)[1]

    def _inverse(self, joints: list[float], rate: Array, acceleration: Array) -> Array:
        """Return forces (m,) by inverse dynamics, the axes of the base those of the ground.

        Args:
            joints: coordinates of the joints.
            rate: velocities (m,).
            acceleration: accelerations (m,), of a free base those of its centre of mass.
        """
        pose = [*NOWHERE, *joints] if self.base else joints
        state = pose, rate.tolist(), acceleration.tolist()
        forces = self._ask("calculateInverseDynamics", self._body, *state)
        # With a free base forces come before moments, though angular velocities come first.
        return np.concatenate([forces[3:6], forces[:3], forces[6:]] if self.base else [forces])

    def _with_gravity(self, g: Array, q: Array, v: Array, vdot: Array) -> Array:
        """Return forces (m,) by inverse dynamics in a world with gravity g (3,)."""
        R, joints = self._split(q)
        acceleration = vdot.copy()
        if self.base:
            acceleration[3:6] += np.cross(v[:3], v[3:6])
        self._ask("setGravity", *(R.T @ g))
        forces = self._inverse(joints, v, acceleration)
        self._ask("setGravity", 0.0, 0.0, 0.0)
        return forces

    def bias(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return B (m,) by inverse dynamics."""
        return self._with_gravity(np.zeros(3), q, v, np.zeros(self._n))

    def inverse_dynamics(self, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return τ (m,) by `calculateInverseDynamics`, which leaves out dampers and springs."""
        return self._with_gravity(self._gravity, q, v, vdot)

    def forces(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return Q (m,) of gravity."""
        return -self.gravity(q, t)
