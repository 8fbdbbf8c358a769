"""MuJoCo Warp: MuJoCo's equations of motion in kernels of Warp, in float32, here on the CPU.

MuJoCo reads the file or builds the model, and MuJoCo Warp copies it. Constraints, contacts and
actuators are switched off, and springs and dampers where a result has none of them. The velocity
`cvel` and the acceleration `cacc` of a body are of its point at the centre of mass of its tree, the
angular part first; they are moved to the origin of the link here.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from eomcheck.engines.mujoco_copy import MujocoCopy, MujocoCopyOfFile, MujocoCopyOfMjcf
from eomcheck.engines.warp_engine import WarpEngine
from eomcheck.numbers.generic import Array

STATE = "fwd_position", "fwd_velocity"
"""Functions that compute positions, M, velocities and the bias of a state."""


class MujocoWarpEngine(WarpEngine, MujocoCopy):
    """Tree of rigid bodies as a model of MuJoCo Warp."""

    key = "mujoco_warp"
    extra = "mujoco-warp"
    module = "mujoco_warp"
    oldest = "4.0"

    def _load(self, library: Any, model: Any) -> None:
        self._mjw, warp = library, self._warp()
        self._without("CONSTRAINT", "ACTUATION")
        complete = model.opt.disableflags
        self._without("SPRING", "DAMPER")
        self._flags = model.opt.disableflags, complete
        self._entries = np.repeat(np.arange(model.nv), model.M_rownnz), np.array(model.M_colind)
        with self._on_cpu():
            self._model, self._data = library.put_model(model), library.make_data(model)
            self._unit, self._solution = (warp.zeros((1, model.nv), dtype=float) for _ in "ux")
            self._linear, self._angular = (warp.zeros((1, 3, model.nv), dtype=float) for _ in "la")
        # Warp compiles here, which may take longer than other calls.
        q, v = np.array(model.qpos0), np.zeros(model.nv)
        self._compute(q, v, *STATE, "factor_m", "rne_postconstraint", "subtree_vel")
        self._compute(q, v, "energy_pos", "energy_vel", "inverse", "forward")
        self._columns(0, np.zeros(3))
        self._inverse_column(0)

    def _compute(
        self,
        q: Array,
        v: Array,
        *functions: str,
        weight: bool = False,
        passive: bool = False,
        **more: Array,
    ) -> Any:
        """Set a state in MuJoCo's order, call functions of the library and return their data.

        Args:
            q: coordinates.
            v: velocities.
            *functions: names of the functions.
            weight: whether there is gravity.
            passive: whether there are springs and dampers.
            **more: further data that is set, by name.
        """
        model, data = self._model, self._data
        model.opt.disableflags = self._flags[passive]
        with self._on_cpu():
            model.opt.gravity.fill_(self._warp().vec3(*(self._gravity * weight)))
            for name, values in {"qpos": q, "qvel": v, **more}.items():
                getattr(data, name).assign(values[None].astype(np.float32))
            for function in functions:
                getattr(self._mjw, function)(model, data)
        return data

    def _at(self, q: Array, v: Array | None, *functions: str, **options: Any) -> Any:
        """Call functions at a state in the order of the tree, at rest if there are no v."""
        v = np.zeros(self._n) if v is None else v
        return self._compute(self._ordered(q), self._in_own_order(v), *functions, **options)

    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M (n, n), the `Data.M` of `crb`."""
        M = np.zeros((self._n, self._n))
        M[self._entries] = M.T[self._entries] = _numbers(self._at(q, None, *STATE).M)
        return self._in_tree_order(M)

    def bias(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return B (n,), the `qfrc_bias` of `rne`; gravity is zero in the model."""
        return _numbers(self._at(q, v, *STATE).qfrc_bias)[self._place]

    # ---- Conformance quantities ------------------------------------------------------------------

    def inverse_dynamics(self, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return τ (n,) by `inverse`."""
        data = self._at(q, v, "inverse", weight=True, qacc=self._in_own_order(vdot))
        return _numbers(data.qfrc_inverse)[self._place]

    def forward_dynamics(self, q: Array, v: Array, tau: Array, t: float = 0.0) -> Array:
        """Return v̇ (n,) by `forward`, τ as `qfrc_applied`."""
        return self._accelerated(q, v, tau, passive=False)

    def _accelerated(self, q: Array, v: Array, tau: Array, passive: bool) -> Array:
        forces = {"qfrc_applied": self._in_own_order(tau)}
        data = self._at(q, v, "forward", weight=True, passive=passive, **forces)
        return _numbers(data.qacc)[self._place]

    def inverse_mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M⁻¹ (n, n) by `solve_m`, from the factors of M."""
        self._at(q, None, *STATE, "factor_m")
        return self._in_tree_order(np.array([self._inverse_column(j) for j in range(self._n)]))

    def _inverse_column(self, j: int) -> Array:
        """Return a column of the inverse of M."""
        with self._on_cpu():
            self._unit.assign(np.eye(self._unit.shape[1], dtype=np.float32)[[j]])
            self._mjw.solve_m(self._model, self._data, self._solution, self._unit)
        return _numbers(self._solution)

    def gravity(self, q: Array, t: float = 0.0) -> Array:
        """Return ∂U/∂q (n,), the `qfrc_bias` at rest."""
        return _numbers(self._at(q, None, *STATE, weight=True).qfrc_bias)[self._place]

    def kinetic_energy(self, q: Array, v: Array, t: float = 0.0) -> float:
        """Return T by `energy_vel`."""
        return float(_numbers(self._at(q, v, *STATE, "energy_vel").energy)[1])

    def potential_energy(self, q: Array, t: float = 0.0) -> float:
        """Return U by `energy_pos`, without springs."""
        return float(_numbers(self._at(q, None, *STATE, "energy_pos", weight=True).energy)[0])

    def center_of_mass(self, q: Array, t: float = 0.0) -> Array:
        """Return c (3,), the `subtree_com` of the world."""
        return _numbers(self._at(q, None, *STATE).subtree_com)[0]

    def center_of_mass_velocity(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return ċ (3,), the `subtree_linvel` of the world by `subtree_vel`."""
        return _numbers(self._at(q, v, *STATE, "subtree_vel").subtree_linvel)[0]

    def momentum(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return h (6,): mass times `subtree_linvel`, and `subtree_angmom` of the world."""
        linear = float(self._builder.model.body_subtreemass[0]) * self.center_of_mass_velocity(q, v)
        return np.concatenate((linear, _numbers(self._data.subtree_angmom)[0]))

    def _frame(self, f: str) -> tuple[int, Array, Array]:
        """Return the body of a link, the axes and the origin of its frame in the state set."""
        builder, data = self._builder, self._data
        kind = builder._frame_kind
        number = builder._mj.mj_name2id(builder.model, kind, f)
        if kind == builder._mj.mjtObj.mjOBJ_SITE:
            body = int(builder.model.site_bodyid[number])
            return body, _numbers(data.site_xmat)[number], _numbers(data.site_xpos)[number]
        return number, _numbers(data.xmat)[number], _numbers(data.xpos)[number]

    def frame_placement(self, f: str, q: Array, t: float = 0.0) -> tuple[Array, Array]:
        """Return (R, p) of `xmat` and `xpos`, or those of a site."""
        self._at(q, None, *STATE)
        _, R, p = self._frame(f)
        return R, p

    def _motion(self, f: str, name: str) -> Array:
        """Return a motion (6,) of a body in the data, moved to the origin of a frame."""
        body, _, p = self._frame(f)
        root = self._builder.model.body_rootid[body]
        arm = p - _numbers(self._data.subtree_com)[root]
        angular, linear = np.split(_numbers(getattr(self._data, name))[body], 2)
        return np.concatenate((linear + np.cross(angular, arm), angular))

    def frame_velocity(self, f: str, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return the velocity (6,) of `cvel`."""
        self._at(q, v, *STATE)
        return self._motion(f, "cvel")

    def frame_acceleration(self, f: str, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return the acceleration (6,) of `cacc` by `rne_postconstraint`, spatial there."""
        self._at(q, v, *STATE, "rne_postconstraint", qacc=self._in_own_order(vdot))
        acceleration, velocity = (self._motion(f, name) for name in ("cacc", "cvel"))
        acceleration[:3] += np.cross(velocity[3:], velocity[:3])
        return acceleration

    def frame_jacobian(self, f: str, q: Array, t: float = 0.0) -> Array:
        """Return J (6, n) by `jac`."""
        self._at(q, None, *STATE)
        body, _, p = self._frame(f)
        return self._columns(body, p)[:, self._place]

    def _columns(self, body: int, point: Array) -> Array:
        """Return the Jacobian (6, n) of a point of a body in the state set, in MuJoCo's order."""
        warp = self._warp()
        with self._on_cpu():
            own = warp.array([warp.vec3(*point)], dtype=warp.vec3), warp.array([body], dtype=int)
            self._mjw.jac(self._model, self._data, self._linear, self._angular, *own)
        return np.vstack((_numbers(self._linear), _numbers(self._angular)))


def _numbers(array: Any) -> Array:
    """Return the first world of an array of Warp in float64."""
    return array.numpy()[0].astype(np.float64)


class MujocoWarpFile(MujocoCopyOfFile, MujocoWarpEngine):
    """URDF that MuJoCo reads, as a model of MuJoCo Warp."""

    key = "mujoco_warp_file"

    def forces(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return Q (m,): gravity, and `qfrc_passive` of springs and dampers."""
        weight = self.gravity(q)
        return _numbers(self._at(q, v, *STATE, passive=True).qfrc_passive) - weight

    def free_acceleration(self, q: Array, v: Array) -> Array:
        """Return ẍ (m,) by `forward`."""
        return self._accelerated(q, v, np.zeros(self._n), passive=True)


class MujocoWarpMjcf(MujocoCopyOfMjcf, MujocoWarpFile):
    """MJCF that MuJoCo reads, as a model of MuJoCo Warp."""

    key = "mujoco_warp_mjcf"
