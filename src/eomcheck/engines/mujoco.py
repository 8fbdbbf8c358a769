"""MuJoCo: mass matrix by composite rigid bodies, bias by recursive Newton-Euler.

In MuJoCo every moving body has mass, so the joints of links without mass are mounted on the body
that they carry. Constraints are soft: rows of a become tendons of constant coefficients, enforced
by MuJoCo's own solver as stiffly as its settings allow.

In a model read from a URDF, limits, contacts and constraints are switched off. An MJCF file is read
as MuJoCo's own model, without the elements that `from_mjcf` leaves out.

A frame of MuJoCo is a site, or the frame of a body. Links that are fixed to others are merged with
them while it reads a URDF, and then have no frame (`has_frame`). Spatial vectors have the angular
part first, which is moved behind the linear one here.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np

from eomcheck.descriptions.elements import COORDINATES
from eomcheck.descriptions.mjcf_reader import BALL_JOINT, FREE_JOINT, read_mjcf
from eomcheck.engines.engine import EngineAcceleration, VelocityMap
from eomcheck.engines.file_engine import (
    BaseVelocity,
    CompoundJoint,
    FileEngine,
    RobotDescription,
    free_base,
)
from eomcheck.engines.tree_engine import (
    BodyWithJoints,
    TreeLink,
    TreeSolverEngine,
    bodies_with_mass,
)
from eomcheck.errors import EngineError
from eomcheck.numbers.generic import Array

STIFFEST = 0.9999
"""Largest impedance that MuJoCo accepts: 1e-4 of the unconstrained response remains."""


STEP = 2.0**-20
"""Step of `mjd_inverseFD`, whose differences are one-sided."""


class _FrameState(NamedTuple):
    """Frame of a link in a state of MuJoCo's data."""

    kind: Any
    """Type of the object that has it, `mjtObj`."""
    number: int
    """Index among objects of that type."""
    body: int
    """Index of the body to which it is fixed."""
    R: Array
    """Orientation (3, 3)."""
    p: Array
    """Position of the link's origin (3,), m."""


class MujocoEngine(TreeSolverEngine):
    """Tree of rigid bodies as a MuJoCo model."""

    key = "mujoco"
    module = extra = "mujoco"
    oldest = "3.3.7"
    compliant = True

    @classmethod
    def holds(cls, links: list[TreeLink]) -> bool:
        """Return whether every link without mass carries exactly one other."""
        return super().holds(links) and bodies_with_mass(links) is not None

    def _build(self, library: Any, links: list[TreeLink]) -> None:
        self._mj = library
        spec = library.MjSpec()
        carried = bodies_with_mass(links) or []
        placed = [spec.worldbody]
        for mounted in carried:
            body = self._add_body(placed[mounted.parent + 1], mounted)
            placed.append(body)
            for frame in self.frames:
                if frame.joint >= 0 and links[frame.joint].name == mounted.body.name:
                    body.add_site(name=frame.name, pos=frame.p, quat=self._quaternion(frame.R))
        for row in range(self.inputs.r):
            self._add_constraint(spec, f"row_{row}", links)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # warnings about bodies without inertia so far
            self.model = model = spec.compile()
        model.opt.gravity[:] = 0.0
        model.opt.tolerance = 0.0
        for mounted in carried:
            # Not by `fullinertia`: it rejects singular ones, and an orientation without `ipos`.
            moments, axes = mounted.body.principal
            body = model.body(mounted.body.name).id
            model.body_inertia[body] = moments
            model.body_iquat[body] = self._quaternion(axes)
        self.data = library.MjData(model)
        library.mj_setConst(model, self.data)
        self._place = np.array([model.joint(link.name).dofadr[0] for link in links])

    def _quaternion(self, rotation: Array) -> Array:
        quaternion = np.zeros(4)
        self._mj.mju_mat2Quat(quaternion, np.ascontiguousarray(rotation).ravel())
        return quaternion

    def _add_body(self, parent: Any, mounted: BodyWithJoints) -> Any:
        kinds = self._mj.mjtJoint
        body = parent.add_body(name=mounted.body.name, pos=mounted.offset)
        body.quat = self._quaternion(mounted.rotation)
        body.mass, body.ipos, body.inertia = mounted.body.mass, mounted.body.center, np.ones(3)
        body.explicitinertial = True
        if hasattr(body, "simple"):  # not yet in 3.3
            body.simple = 0  # a simple body could not be changed after compilation, as inertia is
        for joint in mounted.joints:
            kind = kinds.mjJNT_SLIDE if joint.slides else kinds.mjJNT_HINGE
            body.add_joint(name=joint.name, type=kind, pos=joint.position, axis=joint.axis)
        return body

    def _add_constraint(self, spec: Any, name: str, links: list[TreeLink]) -> None:
        """Add the constraint that a linear combination of the joints is 0, coefficients set later.

        MuJoCo's reference acceleration is -k d r, with the impedance d, k = stiffness / d² and the
        residual r. A stiffness of d makes that -r: the offset in r determines the acceleration.
        """
        tendon = spec.add_tendon(name=name)
        for link in links:
            tendon.wrap_joint(link.name, 1.0)
        equality = spec.add_equality(name=name, type=self._mj.mjtEq.mjEQ_TENDON, name1=name)
        equality.objtype = self._mj.mjtObj.mjOBJ_TENDON
        equality.solref = [-STIFFEST, 0.0]
        equality.solimp = [STIFFEST, STIFFEST, 1.0, 0.5, 2.0]
        equality.data[1] = 0.0

    def _move_to(self, x: Array, rate: Array) -> None:
        self.data.qpos[self._place], self.data.qvel[self._place] = x, rate

    def _forward(self, x: Array, rate: Array) -> None:
        self._move_to(x, rate)
        self._mj.mj_fwdPosition(self.model, self.data)
        self._mj.mj_fwdVelocity(self.model, self.data)

    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M (n, n) by the composite rigid body algorithm."""
        self._forward(q, np.zeros(self._n))
        M = np.zeros((self._n, self._n))
        if hasattr(self.data, "qM"):  # before 4.0
            self._mj.mj_fullM(self.model, M, self.data.qM)
        else:
            self._mj.mj_fullM(self.model, self.data, M)
        return self._in_tree_order(M)

    def bias(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return B (n,) by the recursive Newton-Euler algorithm; gravity is zero in the model."""
        self._forward(q, v)
        return self.data.qfrc_bias[self._place]

    def solved(
        self, q: Array, v: Array, Q: Array, a: Array | None, gamma: Array | None
    ) -> EngineAcceleration:
        """Return v̇ and λ by MuJoCo's own solver, from the scene's Q, a and gamma."""
        if a is not None and gamma is not None:
            self.model.wrap_prm[:] = a.ravel()
            self.model.eq_data[:, 0] = a @ q - gamma
            self._mj.mj_setConst(self.model, self.data)
        self._move_to(q, v)
        self.data.qfrc_applied[self._place] = Q
        self._mj.mj_forward(self.model, self.data)
        self.data.qfrc_applied[:] = 0.0
        multipliers = None if a is None else self.data.efc_force.copy()
        return EngineAcceleration(self.data.qacc[self._place], multipliers)

    # ---- Conformance quantities ------------------------------------------------------------------

    @contextmanager
    def _weight_alone(self) -> Iterator[None]:
        """Turn gravity on, and constraints, springs, dampers and actuators off."""
        option, bits = self.model.opt, self._mj.mjtDisableBit
        flags = option.disableflags
        for bit in ("CONSTRAINT", "SPRING", "DAMPER", "ACTUATION"):
            option.disableflags |= int(getattr(bits, f"mjDSBL_{bit}"))
        option.gravity[:] = self._gravity
        try:
            yield
        finally:
            option.gravity[:] = 0.0
            option.disableflags = flags

    def inverse_dynamics(self, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return τ (n,) by `mj_inverse`, without passive and constraint forces."""
        with self._weight_alone():
            self._move_to(q, v)
            self.data.qacc[self._place] = vdot
            self._mj.mj_inverse(self.model, self.data)
        return self.data.qfrc_inverse[self._place]

    def forward_dynamics(self, q: Array, v: Array, tau: Array, t: float = 0.0) -> Array:
        """Return v̇ (n,) by `mj_forward`, τ as `qfrc_applied`; without constraints."""
        with self._weight_alone():
            self._move_to(q, v)
            self.data.qfrc_applied[self._place] = tau
            self._mj.mj_forward(self.model, self.data)
            self.data.qfrc_applied[:] = 0.0
        return self.data.qacc[self._place]

    def inverse_mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M⁻¹ (n, n) by `mj_solveM`, from MuJoCo's factors of M."""
        self._forward(q, np.zeros(self._n))
        inverse = np.zeros((self._n, self._n))
        self._mj.mj_solveM(self.model, self.data, inverse, np.eye(self._n))
        return self._in_tree_order(inverse)

    def gravity(self, q: Array, t: float = 0.0) -> Array:
        """Return ∂U/∂q (n,), the `qfrc_bias` at rest."""
        with self._weight_alone():
            self._forward(q, np.zeros(self._n))
        return self.data.qfrc_bias[self._place]

    def kinetic_energy(self, q: Array, v: Array, t: float = 0.0) -> float:
        """Return T by `mj_energyVel`."""
        self._forward(q, v)
        self._mj.mj_energyVel(self.model, self.data)
        return float(self.data.energy[1])

    def potential_energy(self, q: Array, t: float = 0.0) -> float:
        """Return U by `mj_energyPos`, 0 for bodies at the origin; without springs."""
        with self._weight_alone():
            self._forward(q, np.zeros(self._n))
            self._mj.mj_energyPos(self.model, self.data)
        return float(self.data.energy[0])

    def center_of_mass(self, q: Array, t: float = 0.0) -> Array:
        """Return c (3,), the `subtree_com` of the world; fixed bodies have no mass here."""
        self._forward(q, np.zeros(self._n))
        return self.data.subtree_com[0]

    def center_of_mass_jacobian(self, q: Array, t: float = 0.0) -> Array:
        """Return ∂ċ/∂v (3, n) by `mj_jacSubtreeCom` of the world."""
        self._forward(q, np.zeros(self._n))
        jacobian = np.zeros((3, self._n))
        self._mj.mj_jacSubtreeCom(self.model, self.data, jacobian, 0)
        return jacobian[:, self._place]

    def center_of_mass_velocity(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return ċ (3,), the `subtree_linvel` of the world by `mj_subtreeVel`."""
        self._forward(q, v)
        self._mj.mj_subtreeVel(self.model, self.data)
        return self.data.subtree_linvel[0]

    def momentum(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return h (6,) by `mj_subtreeVel`: mass times `subtree_linvel`, and `subtree_angmom`.

        The latter is about the centre of mass.
        """
        linear = self._mj.mj_getTotalmass(self.model) * self.center_of_mass_velocity(q, v)
        return np.concatenate((linear, self.data.subtree_angmom[0]))

    def momentum_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return A (6, n): mass times `mj_jacSubtreeCom`, and `mj_angmomMat`.

        The latter is about the centre of mass.
        """
        linear = self._mj.mj_getTotalmass(self.model) * self.center_of_mass_jacobian(q)
        angular = np.zeros((3, self._n))
        self._mj.mj_angmomMat(self.model, self.data, angular, 0)
        return np.vstack((linear, angular[:, self._place]))

    @property
    def _frame_kind(self) -> Any:
        """Type of the objects that have the frames of links, `mjtObj`."""
        return self._mj.mjtObj.mjOBJ_SITE

    def has_frame(self, f: str) -> bool:
        """Return whether there is a site of this name."""
        return self._mj.mj_name2id(self.model, self._frame_kind, f) >= 0

    def _frame(self, f: str, q: Array, v: Array) -> _FrameState:
        """Return the frame of a link at a state, which MuJoCo is set to."""
        self._forward(q, v)
        kind, data = self._frame_kind, self.data
        index = self._mj.mj_name2id(self.model, kind, f)
        if index < 0:
            raise EngineError(f"{self.key} has no frame of link {f!r}")
        if kind == self._mj.mjtObj.mjOBJ_SITE:
            body, R, p = self.model.site_bodyid[index], data.site_xmat[index], data.site_xpos[index]
        else:
            body, R, p = index, data.xmat[index], data.xpos[index]
        return _FrameState(kind, index, int(body), R.reshape(3, 3).copy(), p.copy())

    def frame_placement(self, f: str, q: Array, t: float = 0.0) -> tuple[Array, Array]:
        """Return (R, p) of MuJoCo's forward kinematics."""
        frame = self._frame(f, q, np.zeros(self._n))
        return frame.R, frame.p

    def frame_velocity(self, f: str, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return the velocity (6,) by `mj_objectVelocity`, angular first there."""
        return self._motion(self._mj.mj_objectVelocity, self._frame(f, q, v))

    def _motion(self, function: Any, frame: _FrameState) -> Array:
        """Return a velocity or acceleration (6,) by MuJoCo, along the axes of the world."""
        result = np.zeros(6)
        function(self.model, self.data, frame.kind, frame.number, result, 0)
        return np.roll(result, 3)

    def frame_jacobian(self, f: str, q: Array, t: float = 0.0) -> Array:
        """Return J (6, n) by `mj_jac`."""
        return self._columns(self._mj.mj_jac, self._frame(f, q, np.zeros(self._n)))

    def _columns(self, function: Any, frame: _FrameState) -> Array:
        """Return a Jacobian (6, n), or its rate, by MuJoCo."""
        linear, angular = np.zeros((2, 3, self._n))
        function(self.model, self.data, linear, angular, frame.p, frame.body)
        return np.vstack((linear, angular))[:, self._place]

    def frame_acceleration(self, f: str, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return the acceleration (6,) by `mj_objectAcceleration`, angular first there.

        Its linear part is classical. MuJoCo adds -g to it: gravity is zero in the model.
        """
        frame = self._frame(f, q, v)
        self.data.qacc[self._place] = vdot
        self._mj.mj_rnePostConstraint(self.model, self.data)
        return self._motion(self._mj.mj_objectAcceleration, frame)

    def frame_bias(self, f: str, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return J̇ v (6,) with J̇ by `mj_jacDot`."""
        return self._columns(self._mj.mj_jacDot, self._frame(f, q, v)) @ v

    def position_rates(self, x: Array) -> Array:
        """Return the derivative (n_x, n) of MuJoCo's coordinates by its velocities, at x (n_x,)."""
        model = self.model
        rates, i, j = np.zeros((model.nq, model.nv)), 0, 0
        for kind in model.jnt_type:
            if kind == FREE_JOINT:
                rates[i : i + 3, j : j + 3] = np.eye(3)
                i, j = i + 3, j + 3
            if kind in (FREE_JOINT, BALL_JOINT):
                w, *u = x[i : i + 4]
                rates[i, j : j + 3] = -0.5 * np.array(u)
                cross = np.array([[0, -u[2], u[1]], [u[2], 0, -u[0]], [-u[1], u[0], 0]])
                rates[i + 1 : i + 4, j : j + 3] = 0.5 * (w * np.eye(3) + cross)
                i, j = i + 4, j + 3
            else:
                rates[i, j] = 1.0
                i, j = i + 1, j + 1
        return rates

    derivatives_by_differences = True

    def inverse_dynamics_derivatives(
        self, q: Array, v: Array, vdot: Array, t: float = 0.0
    ) -> tuple[Array, Array]:
        """Return ∂τ/∂q and ∂τ/∂v by `mjd_inverseFD`, which returns them transposed."""
        by_q, by_v = np.zeros((2, self._n, self._n))
        with self._weight_alone():
            self._move_to(q, v)
            self.data.qacc[self._place] = vdot
            state = self.model, self.data, STEP, False
            self._mj.mjd_inverseFD(*state, by_q, by_v, *[None] * 5)
        return self._in_tree_order(by_q.T), self._in_tree_order(by_v.T)


# ---- Model read from a URDF ----------------------------------------------------------------------

SEVERAL = {FREE_JOINT: "floating", BALL_JOINT: "spherical"}
"""Type of a joint with several velocities -> its kind."""

PARTS_OF_PLANAR = dict(zip(("TX", "TY", "RZ"), COORDINATES["planar"], strict=True))
"""Ending of the names of MuJoCo's joints for a planar one -> that of the coordinate."""


class MujocoFile(FileEngine, MujocoEngine):
    """URDF read by `mujoco.MjSpec.from_string`, with the same result as `MjModel`."""

    key = "mujoco_file"
    merges_under_free_base = False
    """Whether links that are fixed to others are merged with them also where the base is free."""

    compliant = False
    base_velocity = BaseVelocity("ground", "base")
    compounds = frozenset({"planar", "spherical"})

    def _read(self, library: Any, description: RobotDescription) -> None:
        self._mj = library
        spec = library.MjSpec.from_string(description.text)
        if self.base:
            if description.root == "world":
                raise EngineError(f"{self.key} makes a link called world the ground")
            # Before 4.0 the root would be merged into the ground.
            spec.compiler.fusestatic = self.merges_under_free_base
            spec.body(description.root).add_freejoint()
        self.model = model = spec.compile()
        model.opt.gravity[:] = 0.0
        off = library.mjtDisableBit
        model.opt.disableflags |= int(off.mjDSBL_CONSTRAINT)
        self.data = library.MjData(model)
        # The first joint is that of a free base.
        names, self._joints = self.inputs.coordinate_names, []
        for i in range(bool(self.base), model.njnt):
            name = model.joint(i).name
            if model.jnt_type[i] == BALL_JOINT:
                self._joints += [name + part for part in COORDINATES["spherical"]]
                continue
            joint, _, part = name.rpartition("_")
            own = joint + PARTS_OF_PLANAR.get(part, "")
            self._joints.append(own if name not in names and own in names else name)
        self._find_compounds()

    def _find_compounds(self) -> None:
        """Find the balls and free joints of the model, besides a free base."""
        model = self.model
        self._compounds = tuple(
            CompoundJoint(slice(first, first + len(COORDINATES[SEVERAL[kind]])), SEVERAL[kind])
            for kind, first in zip(model.jnt_type, model.jnt_dofadr, strict=True)
            if kind in SEVERAL and first >= self.base
        )

    def velocity_map(self, q: Array, v: Array) -> VelocityMap:
        """Return (x, S, Ṡ v), with quaternions and body-fixed angular velocities.

        They belong to free and ball joints. A free joint also has the velocity of its origin along
        the axes of the ground.
        """
        x, S, rest = super().velocity_map(q, v)
        more, still = len(x) - self._n, np.zeros(self._n)
        parts, first = x[:more].tolist(), 0
        x = x[more:]
        for joint in self._compounds:
            base = free_base(*joint.state(x, still))
            slides = base.position if joint.kind == "floating" else ()
            parts += [*x[first : joint.own.start], *slides, *base.quaternion]
            first = joint.own.stop
        return VelocityMap(np.array([*parts, *x[first:]]), S, rest)

    def _move_to(self, x: Array, rate: Array) -> None:
        self.data.qpos[:], self.data.qvel[:] = x, rate

    def _under_gravity(self, q: Array, v: Array) -> None:
        self.model.opt.gravity[:] = self._gravity
        self._move_to(q, v)
        self._mj.mj_forward(self.model, self.data)
        self.model.opt.gravity[:] = 0.0

    def forces(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return Q (m,): gravity, and the dampers and springs of its joints."""
        weight = self.gravity(q)  # at v, subtracting the bias would lose digits
        self._under_gravity(q, v)
        return self.data.qfrc_passive - weight

    def free_acceleration(self, q: Array, v: Array) -> Array:
        """Return ẍ (m,) of `mj_forward`."""
        self._under_gravity(q, v)
        return self.data.qacc.copy()

    @property
    def _frame_kind(self) -> Any:
        return self._mj.mjtObj.mjOBJ_XBODY


# ---- Model read from an MJCF file ----------------------------------------------------------------


class MjcfFile(MujocoFile):
    """MJCF read by `mujoco.MjSpec`, in its own coordinates: quaternions of free and ball joints."""

    key = "mujoco_mjcf"
    format = "mjcf"

    def _read(self, library: Any, description: RobotDescription) -> None:
        self._mj = library
        robot = read_mjcf(self.file)
        model, self._joints = robot.compiled, robot.coordinates
        model.opt.disableflags |= int(library.mjtDisableBit.mjDSBL_CONSTRAINT)
        model.opt.disableflags &= ~int(library.mjtDisableBit.mjDSBL_GRAVITY)
        model.opt.gravity[:] = 0.0
        self.model, self.data = model, library.MjData(model)
        root = model.body_weldid  # of a body that is moved by commands (mocap) that body itself
        fixed = (root == 0) | (model.body_mocapid[root] >= 0)
        if model.body_mass[fixed].any():  # MuJoCo counts it in the centre of mass of the world
            model.body_mass[fixed] = 0.0
            library.mj_setConst(model, self.data)
        damped = zip(self._joints, model.dof_damping, strict=True)
        names = frozenset(name for name, damping in damped if damping)
        self.description = description._replace(damped=names)
        self._find_compounds()
