"""DART: its `Skeleton`, by recursive Newton-Euler and articulated bodies.

Spatial vectors of DART have the angular part first; accelerations of frames are classical. Every
link of a URDF is a body here, fixed ones too. DART has no constraints outside of the steps of its
simulation, no rotors, no Coriolis matrix (a vector alone), no momentum matrix, no derivatives and
no regressor.

Its time step is set to 0: forward dynamics adds time step times damping to M otherwise.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from eomcheck.descriptions.mechanism_class import Mechanism
from eomcheck.engines.file_engine import (
    BaseVelocity,
    FileEngine,
    FreeBase,
    RobotDescription,
    capture_output,
)
from eomcheck.engines.tree_engine import TreeEngine, TreeLink
from eomcheck.errors import EngineError, required
from eomcheck.mechanics.records import TreeFrame
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array


class DartEngine(TreeEngine):
    """Tree of rigid bodies as a DART skeleton."""

    key = "dart"
    module, extra = "dartpy", "dart"
    oldest = "6.20"
    any_inertia = True

    @classmethod
    def distribution(cls) -> str:
        """Return "dartpy", the name of its wheels."""
        return "dartpy"

    @classmethod
    def holds(cls, links: list[TreeLink]) -> bool:
        """Return whether there are no rotors."""
        return not any(link.armature for link in links)

    def _build(self, library: Any, links: list[TreeLink]) -> None:
        parts = library.dynamics
        skeleton, bodies, joints = parts.Skeleton(), [], []
        with capture_output():  # it warns of each body without mass
            for link in links:
                kind = "Prismatic" if link.slides else "Revolute"
                properties = getattr(parts, f"{kind}JointProperties")()
                properties.mName, properties.mAxis = f"joint of {link.name}", link.axis
                seat = library.math.Isometry3(link.rotation, link.offset)
                properties.mT_ParentBodyToJoint = seat
                parent = bodies[link.parent] if link.parent >= 0 else None
                create = getattr(skeleton, f"create{kind}JointAndBodyNodePair")
                joint, body = create(parent, properties)
                body.setInertia(parts.Inertia(link.mass, link.center, link.inertia))
                joints.append(joint)
                bodies.append(body)
        self._seats = {x.name: (bodies[x.joint], x) for x in self.frames if x.joint >= 0}
        self._take(skeleton)
        self._place = np.array([joint.getIndexInSkeleton(0) for joint in joints])

    def _take(self, skeleton: Any) -> None:
        """Keep the model, without gravity and without a time step."""
        self.skeleton = skeleton
        skeleton.setGravity(np.zeros(3))
        skeleton.setTimeStep(0.0)
        self._world = required("dartpy").dynamics.Frame.World()

    def _move_to(self, q: Array, v: Array, vdot: Array | None = None) -> None:
        """Set the state of the skeleton, and its accelerations, 0 unless given."""
        skeleton = self.skeleton
        skeleton.setPositions(self._in_own_order(q))
        skeleton.setVelocities(self._in_own_order(v))
        rates = np.zeros(self._n) if vdot is None else self._in_own_order(vdot)
        skeleton.setAccelerations(rates)

    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M (n, n) by `getMassMatrix`."""
        self._move_to(q, np.zeros(self._n))
        return self._in_tree_order(self.skeleton.getMassMatrix())

    def bias(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return B (n,) by `getCoriolisForces`."""
        self._move_to(q, v)
        return self.skeleton.getCoriolisForces()[self._place]

    # ---- Conformance quantities ------------------------------------------------------------------

    @contextmanager
    def _weight(self) -> Iterator[None]:
        """Turn gravity on."""
        self.skeleton.setGravity(self._gravity)
        try:
            yield
        finally:
            self.skeleton.setGravity(np.zeros(3))

    @contextmanager
    def _undamped(self) -> Iterator[None]:
        """Set the dampers of joints to 0."""
        dofs = [self.skeleton.getDof(i) for i in range(self._n)]
        before = [dof.getDampingCoefficient() for dof in dofs]
        for dof in dofs:
            dof.setDampingCoefficient(0.0)
        try:
            yield
        finally:
            for dof, damping in zip(dofs, before, strict=True):
                dof.setDampingCoefficient(damping)

    def inverse_dynamics(self, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return τ (n,) by `computeInverseDynamics`, without dampers and springs."""
        self._move_to(q, v, vdot)
        with self._weight():
            self.skeleton.computeInverseDynamics(False, False, False)
            return self.skeleton.getForces()[self._place]

    def forward_dynamics(self, q: Array, v: Array, tau: Array, t: float = 0.0) -> Array:
        """Return v̇ (n,) by `computeForwardDynamics`, without dampers."""
        with self._undamped():
            return self._accelerated(q, v, tau)

    def _accelerated(self, q: Array, v: Array, tau: Array) -> Array:
        """Return v̇ (n,) by `computeForwardDynamics` under weight and forces τ of the joints."""
        self._move_to(q, v)
        with self._weight():
            self.skeleton.setForces(self._in_own_order(tau))
            self.skeleton.computeForwardDynamics()
            return self.skeleton.getAccelerations()[self._place]

    def inverse_mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M⁻¹ (n, n) by `getInvMassMatrix`."""
        self._move_to(q, np.zeros(self._n))
        return self._in_tree_order(self.skeleton.getInvMassMatrix())

    def gravity(self, q: Array, t: float = 0.0) -> Array:
        """Return ∂U/∂q (n,) by `getGravityForces`."""
        self._move_to(q, np.zeros(self._n))
        with self._weight():
            return self.skeleton.getGravityForces()[self._place]

    def kinetic_energy(self, q: Array, v: Array, t: float = 0.0) -> float:
        """Return T by `computeKineticEnergy`."""
        self._move_to(q, v)
        return self.skeleton.computeKineticEnergy()

    def potential_energy(self, q: Array, t: float = 0.0) -> float:
        """Return U by `computePotentialEnergy`, 0 for bodies at the origin."""
        self._move_to(q, np.zeros(self._n))
        with self._weight():
            return self.skeleton.computePotentialEnergy()

    def center_of_mass(self, q: Array, t: float = 0.0) -> Array:
        """Return c (3,) by `getCOM`; bodies that are welded to the ground have no mass here."""
        self._move_to(q, np.zeros(self._n))
        return self.skeleton.getCOM()

    def center_of_mass_jacobian(self, q: Array, t: float = 0.0) -> Array:
        """Return ∂ċ/∂v (3, n) by `getCOMLinearJacobian`."""
        self._move_to(q, np.zeros(self._n))
        return self.skeleton.getCOMLinearJacobian()[:, self._place]

    def center_of_mass_velocity(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return ċ (3,) by `getCOMLinearVelocity`."""
        self._move_to(q, v)
        return self.skeleton.getCOMLinearVelocity()

    def center_of_mass_acceleration(self, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return c̈ (3,) by `getCOMLinearAcceleration`."""
        self._move_to(q, v, vdot)
        return self.skeleton.getCOMLinearAcceleration()

    def momentum(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return h (6,), the sum of `getLinearMomentum` and `getAngularMomentum` of the bodies.

        Both are along the axes of the body, and so is the point of the latter.
        """
        self._move_to(q, v)
        center, total = self.skeleton.getCOM(), np.zeros((2, 3))
        for body in self.skeleton.getBodyNodes():
            pose = body.getWorldTransform()
            R = pose.rotation()
            point = R.T @ (center - pose.translation())
            total += [R @ body.getLinearMomentum(), R @ body.getAngularMomentum(point)]
        return total.ravel()

    def frame_placement(self, f: str, q: Array, t: float = 0.0) -> tuple[Array, Array]:
        """Return (R, p) by `getWorldTransform`."""
        self._move_to(q, np.zeros(self._n))
        body, frame = self._seat(f)
        pose = body.getWorldTransform()
        R = pose.rotation()
        return R @ frame.R, pose.translation() + R @ frame.p

    def _moving(self, body: Any, kind: str, frame: TreeFrame) -> Array:
        """Return the linear velocity or acceleration of a link's origin, then the angular one."""
        world = self._world, self._world
        linear = getattr(body, f"getLinear{kind}")(frame.p, *world)
        return np.concatenate((linear, getattr(body, f"getAngular{kind}")(*world)))

    def frame_velocity(self, f: str, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return the velocity (6,) by `getLinearVelocity` and `getAngularVelocity`."""
        self._move_to(q, v)
        body, frame = self._seat(f)
        return self._moving(body, "Velocity", frame)

    def frame_jacobian(self, f: str, q: Array, t: float = 0.0) -> Array:
        """Return J (6, n) by `getWorldJacobian`, whose angular rows are first."""
        self._move_to(q, np.zeros(self._n))
        body, frame = self._seat(f)
        jacobian = self.skeleton.getWorldJacobian(body, frame.p)
        return np.roll(jacobian, 3, axis=0)[:, self._place]

    def frame_acceleration(self, f: str, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return the acceleration (6,) by `getLinearAcceleration` and `getAngularAcceleration`."""
        self._move_to(q, v, vdot)
        body, frame = self._seat(f)
        return self._moving(body, "Acceleration", frame)

    def frame_bias(self, f: str, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return J̇ v (6,) with J̇ by `getJacobianClassicDeriv`, whose angular rows are first."""
        self._move_to(q, v)
        body, frame = self._seat(f)
        rate = self.skeleton.getJacobianClassicDeriv(body, frame.p, self._world)
        return np.roll(rate @ self._in_own_order(v), 3)


def _massless(library: Any) -> Any:
    """Return the inertia of a body without mass."""
    return library.dynamics.Inertia(0.0, np.zeros(3), np.zeros((3, 3)))


# ---- Model read from a URDF ----------------------------------------------------------------------


class DartFile(FileEngine, DartEngine):
    """URDF read by `dartpy.utils.DartLoader`, a link without `inertial` without mass."""

    key = "dart_file"
    base_velocity = BaseVelocity("ground", "ground", turns_first=True)

    def _read(self, library: Any, description: RobotDescription) -> None:
        if self.base and description.root == "world":
            raise EngineError(f"{self.key} makes a link called world the ground")
        options = library.utils.DartLoaderOptions()
        kinds = library.utils.DartLoaderRootJointType
        options.mDefaultRootJointType = kinds.FLOATING if self.base else kinds.FIXED
        massless = _massless(library)
        options.mDefaultInertia = massless  # otherwise of 1 kg and 1 kg m²
        loader = library.utils.DartLoader()
        loader.setOptions(options)
        skeleton = loader.parseSkeletonString(description.text, library.common.Uri(""))
        if skeleton is None:
            raise EngineError(f"{self.key} cannot read the file")
        self._take(skeleton)
        self._index(massless)

    def _index(self, massless: Any) -> None:
        """Keep the bodies of links, the names of joints, and dampers; no mass that cannot move."""
        skeleton = self.skeleton
        for body in skeleton.getBodyNodes():
            if not body.getNumDependentGenCoords():
                body.setInertia(massless)
        bodies = {body.getName(): body for body in skeleton.getBodyNodes()}
        self._seats = {x.name: (bodies[x.name], x) for x in self.frames if x.name in bodies}
        moving = [joint for joint in skeleton.getJoints() if joint.getNumDofs() == 1]
        moving.sort(key=lambda joint: joint.getIndexInSkeleton(0))
        self._joints = [joint.getName() for joint in moving]
        dofs = (skeleton.getDof(i) for i in range(skeleton.getNumDofs()))
        self._damping = np.array([dof.getDampingCoefficient() for dof in dofs])

    def pose(self, base: FreeBase) -> Array:
        """Return the rotation vector and the position."""
        w, *u = base.quaternion * np.copysign(1.0, base.quaternion[0])
        length = np.linalg.norm(u)
        factor = 2.0 * np.arctan2(length, w) / length if length else 2.0
        return np.concatenate([factor * np.array(u), base.position])

    def forces(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return Q (m,): gravity, and the damping of its joints."""
        return -self.gravity(q) - self._damping * v

    def free_acceleration(self, q: Array, v: Array) -> Array:
        """Return ẍ (m,) by `computeForwardDynamics`."""
        return self._accelerated(q, v, np.zeros(self._n))


# ---- Model read from an MJCF file ----------------------------------------------------------------


class DartMjcf(DartFile):
    """MJCF read by `dartpy.utils.MjcfParser`, of one skeleton without free and ball joints."""

    key = "dart_mjcf"
    format = "mjcf"

    @classmethod
    def represents(cls, scene: Scene) -> bool:
        """Return whether each joint of the file has one coordinate."""
        if not (isinstance(scene, Mechanism) and scene.source.format == "mjcf"):
            return False
        return scene.as_described and not scene.source.compound_coordinates

    def _read(self, library: Any, description: RobotDescription) -> None:
        world = library.utils.MjcfParser.readWorld(library.common.Uri(self.file.as_uri()))
        if world is None:
            raise EngineError(f"{self.key} cannot read the file")
        every = (world.getSkeleton(i) for i in range(world.getNumSkeletons()))
        moving = [skeleton for skeleton in every if skeleton.getNumDofs()]
        if len(moving) != 1:
            raise EngineError(f"{self.key} makes {len(moving)} skeletons of the file, expected one")
        self._take(moving[0])
        self._index(_massless(library))
