"""Newton: mass matrix, Jacobians and inverse dynamics of Warp kernels, in float32, on the CPU.

Bodies move as `eval_fk` says: a body of Newton has the velocity of its centre of mass, and so has
a row of `eval_jacobian`; both are moved to the origin of the link here. A free base has the
position of its origin, a quaternion x, y, z, w, and the velocity of its centre of mass, along the
axes of the ground. Accelerations are those of `SolverFeatherstone`, without drives and limits.

`finalize` replaces moments of inertia that it takes for too small or for those of no body; a tree
is built without that, and a file read with it, as users do.
"""

from __future__ import annotations

import warnings
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from eomcheck.descriptions.mjcf_reader import SLIDE, read_mjcf
from eomcheck.engines.engine import VelocityMap
from eomcheck.engines.file_engine import (
    FREE,
    BaseVelocity,
    FileEngine,
    FreeBase,
    RobotDescription,
    free_base,
)
from eomcheck.engines.tree_engine import TreeLink
from eomcheck.engines.warp_engine import WarpEngine
from eomcheck.errors import EngineError
from eomcheck.numbers.generic import Array


class _Seat(NamedTuple):
    """Body of Newton to which the frame of a link is fixed."""

    body: int
    """Index of the body."""
    joint: int
    """Index of the joint that moves it, whose rows of the Jacobian are its own."""
    R: Array
    """Axes of the frame in the body's (3, 3)."""
    p: Array
    """Origin of the frame in the body's (3,), m."""


class NewtonEngine(WarpEngine):
    """Tree of rigid bodies as an articulation of Newton's `ModelBuilder`."""

    key = extra = module = "newton"
    oldest = "1.8"
    any_inertia = True
    _free: tuple[tuple[int, int], ...] = ()
    """First velocity and body of each free joint."""

    @classmethod
    def holds(cls, links: list[TreeLink]) -> bool:
        """Return True: rotors are armature, and bodies need no mass."""
        return True

    def _build(self, library: Any, links: list[TreeLink]) -> None:
        warp = self._warp()
        builder = library.ModelBuilder()
        joints = []
        for link in links:
            body = builder.add_link(
                mass=link.mass, com=link.center, inertia=link.inertia, label=link.name
            )
            add = builder.add_joint_prismatic if link.slides else builder.add_joint_revolute
            turn = warp.quat_from_matrix(warp.mat33(link.rotation))
            seat = warp.transform(warp.vec3(link.offset), turn)
            axis, armature = warp.vec3(link.axis), link.armature
            # Links are numbered as bodies are.
            joints.append(add(link.parent, body, parent_xform=seat, axis=axis, armature=armature))
        builder.add_articulation(joints)
        self._take(library, builder, validated=False)
        self._place = np.arange(self._n)
        self._seats = {
            frame.name: _Seat(frame.joint, frame.joint, frame.R, frame.p)
            for frame in self.frames
            if frame.joint >= 0
        }

    def _take(self, library: Any, builder: Any, validated: bool = True) -> None:
        """Finish a model, and make room for its state and results.

        Args:
            library: Newton.
            builder: builder of the model.
            validated: whether Newton replaces moments of inertia that it takes for none.
        """
        self._newton, warp = library, self._warp()
        with self._on_cpu():
            self._model = model = builder.finalize(skip_validation_inertia=not validated)
            self._state, self._after = model.state(), model.state()
            self._control = model.control()
            size = model.max_dofs_per_articulation
            self._mass = warp.zeros((model.articulation_count, size, size), dtype=float)
            self._forces = {
                name: warp.zeros(model.joint_dof_count, dtype=float)
                for name in ("coriolis_force", "gravity_force", "joint_qdd", "joint_f")
            }
            model.set_gravity(tuple(self._gravity))
            model.joint_limit_ke.zero_()
            model.joint_limit_kd.zero_()
            model.joint_target_ke.zero_()
            model.joint_target_kd.zero_()
            if getattr(model, "joint_mimic_joint", None) is not None:
                model.joint_mimic_joint.fill_(-1)  # joints that follow others are eliminated here
            springs = {
                "joint_damping": model.joint_damping,
                "joint_stiffness": model.joint_stiffness,
            }
            self._springs = {name: (x, x.numpy().copy()) for name, x in springs.items()}
            self._solver = library.solvers.SolverFeatherstone(model, angular_damping=0.0)
            # Warp compiles here, which may take longer than other calls.
            library.eval_fk(model, self._state.joint_q, self._state.joint_qd, self._state)
            self._solver.step(self._state, self._after, self._control, None, 0.0)
        self._centers = model.body_com.numpy().astype(np.float64)
        firsts, velocities = model.articulation_start.numpy(), model.joint_qd_start.numpy()
        self._trees = [
            (slice(velocities[start], velocities[end]), range(start, end))
            for start, end in pairwise(firsts.tolist())
        ]

    # ---- State -----------------------------------------------------------------------------------

    def _move_to(self, q: Array, v: Array) -> None:
        """Set the state of Newton, bodies too."""
        state = self._state
        state.joint_q.assign(q.astype(np.float32))
        state.joint_qd.assign(v.astype(np.float32))
        self._newton.eval_fk(self._model, state.joint_q, state.joint_qd, state)

    def _passive(self, name: str, q: Array, v: Array) -> Any:
        """Return a result (n,) of `eval_inverse_dynamics_passive`, an array of Warp."""
        self._move_to(q, v)
        result = self._forces[name]
        self._newton.eval_inverse_dynamics_passive(self._model, self._state, **{name: result})
        return result

    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M (n, n) by `eval_mass_matrix`."""
        self._move_to(q, np.zeros(self._n))
        self._newton.eval_mass_matrix(self._model, self._state, self._mass)
        M = np.zeros((self._n, self._n))
        for part, (own, _) in zip(self._mass.numpy(), self._trees, strict=True):
            size = own.stop - own.start
            M[own, own] = part[:size, :size]
        return M

    def bias(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return B (n,), the Coriolis force of `eval_inverse_dynamics_passive`."""
        return self._passive("coriolis_force", q, v).numpy().astype(np.float64)

    # ---- Conformance quantities ------------------------------------------------------------------

    def gravity(self, q: Array, t: float = 0.0) -> Array:
        """Return ∂U/∂q (n,), the gravity force of `eval_inverse_dynamics_passive`."""
        forces = self._passive("gravity_force", q, np.zeros(self._n))
        return forces.numpy().astype(np.float64)

    def inverse_dynamics(self, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return τ (n,) by `eval_inverse_dynamics_force`."""
        self._passive("gravity_force", q, v)
        self._passive("coriolis_force", q, v)
        self._newton.eval_mass_matrix(self._model, self._state, self._mass)
        self._forces["joint_qdd"].assign(vdot.astype(np.float32))
        arguments = self._forces | {"mass_matrix": self._mass}
        self._newton.eval_inverse_dynamics_force(self._model, self._state, **arguments)
        return self._forces["joint_f"].numpy().astype(np.float64)

    def forward_dynamics(self, q: Array, v: Array, tau: Array, t: float = 0.0) -> Array:
        """Return v̇ (n,) of `SolverFeatherstone`, without springs and dampers."""
        return self._solved(q, v, tau, springs=False)

    def _solved(self, q: Array, v: Array, tau: Array, springs: bool) -> Array:
        """Return v̇ (n,), the `joint_qdd` of a step of `SolverFeatherstone`."""
        self._step(q, v, tau, springs)
        vdot = self._solver.joint_qdd.numpy().astype(np.float64)
        for first, body in self._free:
            # The solver has the acceleration of a point of the body at the origin of the ground.
            R, p = self._pose(body)
            linear, angular = slice(first, first + 3), slice(first + 3, first + FREE)
            vdot[linear] += np.cross(vdot[angular], p + R @ self._centers[body])
            vdot[linear] += np.cross(v[angular], v[linear])
        return vdot

    def _step(self, q: Array, v: Array, tau: Array, springs: bool) -> None:
        """Have the solver take a step of no length, with springs and dampers or without."""
        self._move_to(q, v)
        for values, own in self._springs.values():
            values.assign(own * springs)
        self._control.joint_f.assign(tau.astype(np.float32))
        self._solver.step(self._state, self._after, self._control, None, 0.0)

    def _pose(self, body: int) -> tuple[Array, Array]:
        """Return the axes and the origin of a body at the state that is set."""
        x = self._state.body_q.numpy()[body]
        warp = self._warp()
        R = np.array(warp.quat_to_matrix(warp.quat(*x[3:]))).reshape(3, 3)
        return R.astype(np.float64), x[:3].astype(np.float64)

    def _frame(self, f: str, q: Array, v: Array) -> tuple[_Seat, Array, Array]:
        """Return the seat of a frame, the axes of its body and the frame's origin from the body's
        centre of mass, along the axes of the world (3,), m."""
        self._move_to(q, v)
        seat = self._seats[f]
        R, _ = self._pose(seat.body)
        return seat, R, R @ (seat.p - self._centers[seat.body])

    def frame_placement(self, f: str, q: Array, t: float = 0.0) -> tuple[Array, Array]:
        """Return (R, p) of `State.body_q`."""
        seat, R, _ = self._frame(f, q, np.zeros(self._n))
        return R @ seat.R, self._pose(seat.body)[1] + R @ seat.p

    def frame_velocity(self, f: str, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return the velocity (6,) of `State.body_qd`, there of the centre of mass."""
        seat, _, arm = self._frame(f, q, v)
        velocity, omega = np.split(self._state.body_qd.numpy()[seat.body].astype(np.float64), 2)
        return np.concatenate((velocity + np.cross(omega, arm), omega))

    def frame_jacobian(self, f: str, q: Array, t: float = 0.0) -> Array:
        """Return J (6, n) by `eval_jacobian`, there of the centre of mass."""
        seat, _, arm = self._frame(f, q, np.zeros(self._n))
        every = self._newton.eval_jacobian(self._model, self._state).numpy()
        rows = np.zeros((6, self._n))
        for part, (own, joints) in zip(every, self._trees, strict=True):
            if seat.joint in joints:
                row = 6 * (seat.joint - joints.start)
                rows[:, own] = part[row : row + 6, : own.stop - own.start]
        return np.vstack((rows[:3] + np.cross(rows[3:].T, arm).T, rows[3:]))


# ---- Model read from a URDF ----------------------------------------------------------------------


class NewtonFile(FileEngine, NewtonEngine):
    """URDF read by `ModelBuilder.add_urdf`."""

    key = "newton_file"
    base_velocity = BaseVelocity("ground", "ground")

    def _read(self, library: Any, description: RobotDescription) -> None:
        builder = library.ModelBuilder()
        builder.validate_inertia_detailed = True  # it names the bodies whose inertia it replaces
        with warnings.catch_warnings():
            warnings.simplefilter("always")
            builder.add_urdf(description.text, floating=bool(self.base))
            self._take(library, builder)
        model, prefix = self._model, f"{self._model.articulation_label[0]}/"
        counts = np.diff(model.joint_qd_start.numpy())
        labels = zip(model.joint_label, counts, strict=True)
        self._joints = [label.removeprefix(prefix) for label, count in labels if count == 1]
        bodies = {label.removeprefix(prefix): i for i, label in enumerate(model.body_label)}
        self._find_seats(bodies)
        if self.base:
            self._free = ((0, bodies[description.root]),)

    def _find_seats(self, bodies: dict[str, int]) -> None:
        """Find the seats of links, from the name of each to the index of its body."""
        joints = {int(body): i for i, body in enumerate(self._model.joint_child.numpy())}
        self._seats = {
            frame.name: _Seat(body, joints[body], frame.R, np.zeros(3))
            for frame in self.frames
            if (body := bodies.get(frame.name)) is not None
        }

    def base_frame(self, q: Array, v: Array) -> FreeBase:
        """Return the axes of the base at its centre of mass, whose velocity Newton has."""
        return free_base(q[:FREE], v[:FREE], self._base_center)

    @property
    def _base_center(self) -> Array:
        """Centre of mass of the base in its frame (3,), m."""
        return self._centers[self._free[0][1]]

    def pose(self, base: FreeBase) -> Array:
        """Return the position of the origin of the base, and its quaternion x, y, z, w."""
        origin = base.position - base.R @ self._base_center
        return np.concatenate([origin, np.roll(base.quaternion, -1)])

    def forces(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return Q (m,): gravity, and what springs and dampers add to `joint_tau` of the solver."""
        weight, torques = self.gravity(q), []
        if not any(own.any() for _, own in self._springs.values()):
            return -weight
        for springs in (True, False):
            self._step(q, v, np.zeros(self._n), springs)
            torques.append(self._solver.joint_tau.numpy().astype(np.float64))
        return torques[0] - torques[1] - weight

    def free_acceleration(self, q: Array, v: Array) -> Array:
        """Return ẍ (m,) of `SolverFeatherstone`."""
        return self._solved(q, v, np.zeros(self._n), springs=True)


# ---- Model read from an MJCF file ----------------------------------------------------------------


class _Turning(NamedTuple):
    """Free or ball joint of Newton, of several coordinates."""

    own: slice
    """Its velocities."""
    of_base: slice
    """Which of the six of a free base they are."""
    body: int
    """Body that it moves, whose centre of mass has the linear velocity."""


class NewtonMjcf(NewtonFile):
    """MJCF read by `ModelBuilder.add_mjcf`; MuJoCo tells the names and the order of its joints.

    Joints of one body become one of Newton's, slides before turns. A ball joint has a quaternion
    x, y, z, w and the angular velocity along the axes of its seat. The coordinate of a joint is
    measured from its `ref`.
    """

    key = "newton_mjcf"
    format = "mjcf"

    def _read(self, library: Any, description: RobotDescription) -> None:
        robot = read_mjcf(self.file)
        mujoco, names = robot.compiled, robot.coordinates
        builder = library.ModelBuilder()
        builder.validate_inertia_detailed = True
        with warnings.catch_warnings():
            warnings.simplefilter("always")
            builder.add_mjcf(str(self.file))
            self._take(library, builder)
        model = self._model
        if (model.body_count, model.joint_dof_count) != (mujoco.nbody - 1, mujoco.nv):
            raise EngineError(f"{self.key} has other bodies or joints than MuJoCo")
        self._joints = [names[dof] for dof in self._find_joints(mujoco)]
        self._find_seats({mujoco.body(i + 1).name: i for i in range(model.body_count)})

    def _find_joints(self, mujoco: Any) -> list[int]:
        """Find free and ball joints, and references of others.

        Returns:
            The index in MuJoCo's order of each velocity.
        """
        model, kinds = self._model, self._newton.JointType
        order, free, reference = [], [], []
        self._turning = []
        starts = model.joint_qd_start.numpy()
        for i, (body, kind) in enumerate(
            zip(model.joint_child.numpy(), model.joint_type.numpy(), strict=True)
        ):
            first, count = mujoco.body_jntadr[body + 1], mujoco.body_jntnum[body + 1]
            joints = list(range(first, first + count))
            if not joints:
                continue
            # Slides come first; the sort is stable.
            joints.sort(key=lambda joint: mujoco.jnt_type[joint] != SLIDE)
            dofs, begin = [mujoco.jnt_dofadr[joint] for joint in joints], len(order)
            if kind in (kinds.FREE, kinds.BALL):
                count = int(starts[i + 1] - starts[i])
                dofs = list(range(dofs[0], dofs[0] + count))
                part = slice(FREE - count, FREE)
                self._turning.append(_Turning(slice(begin, begin + count), part, int(body)))
                reference += [0.0] * count
            else:
                reference += [mujoco.qpos0[mujoco.jnt_qposadr[joint]] for joint in joints]
            if kind == kinds.FREE:
                free.append((begin, int(body)))
            order += dofs
        self._free, self._reference = tuple(free), np.array(reference)
        return order

    def _coordinate_map(self, joints: list[str]) -> tuple[Array, Array]:
        S, shift = super()._coordinate_map(joints)
        return S, shift - self._reference

    def velocity_map(self, q: Array, v: Array) -> VelocityMap:
        """Return (x, S, Ṡ v), with quaternions of free and ball joints."""
        q, v, x = self.coordinates @ q + self.shift, self.coordinates @ v, []
        S, rest, first = np.eye(self._n), np.zeros(self._n), 0
        for joint in self._turning:
            own, part = joint.own, joint.of_base
            frame, rates = self._turning_frame(joint, q[own], v[own])
            whole, more = frame.velocity(self.base_velocity, rates)
            S[own, own], rest[own] = whole[part, part], more[part]
            x += [*q[first : own.start], *self._position(joint, frame)]
            x += np.roll(frame.quaternion, -1).tolist()
            first = own.stop
        return VelocityMap(np.array([*x, *q[first:]]), S @ self.coordinates, rest)

    def _turning_frame(self, joint: _Turning, q: Array, v: Array) -> tuple[FreeBase, Array]:
        """Return the frame that a free or ball joint moves, and the rates of all of a free base."""
        state = np.zeros((2, FREE))
        state[:, joint.of_base] = q, v
        center = self._centers[joint.body] if joint.of_base.start == 0 else None
        return free_base(state[0], state[1], center), state[1]

    def _position(self, joint: _Turning, frame: FreeBase) -> Array:
        """Return the coordinates of a free joint that are a position; none of a ball."""
        if joint.of_base.start:
            return np.zeros(0)
        return frame.position - frame.R @ self._centers[joint.body]
