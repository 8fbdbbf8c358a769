"""MJX: MuJoCo's equations of motion in JAX, compiled, with derivatives by its forward mode.

MuJoCo reads the file or builds the model, and MJX copies it. JAX computes in float32 unless told
otherwise: there are engines of both precisions. Constraints, springs, dampers and limits are
switched off. A free base is moved by w as in MuJoCo; derivatives by its position are along w, to
first order of the quaternion's own update.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, ClassVar

import numpy as np

from eomcheck.engines.engine import VelocityMap
from eomcheck.engines.file_engine import BaseVelocity, FileEngine, RobotDescription
from eomcheck.engines.jax_engine import JaxEngine
from eomcheck.engines.mujoco import MjcfFile, MujocoEngine, MujocoFile
from eomcheck.engines.tree_engine import TreeInputs, TreeLink
from eomcheck.errors import required
from eomcheck.numbers.generic import Array


@cache
def _functions() -> dict[str, Callable[..., Any]]:
    """Return the compiled functions of a model, its data and a state, by name."""
    jax, mjx = required("jax", "mjx"), required("mujoco.mjx", "mjx")

    def moved(mx, dx, q, v):
        return mjx.fwd_velocity(mx, mjx.fwd_position(mx, dx.replace(qpos=q, qvel=v)))

    def state(mx, dx, q, v):
        d = moved(mx, dx, q, v)
        d = mjx.subtree_vel(mx, d)
        own = d._impl
        return {
            "M": mjx.full_m(mx, d),
            "bias": d.qfrc_bias,
            "com": d.subtree_com[0],
            "com_velocity": own.subtree_linvel[0],
            "angular_momentum": own.subtree_angmom[0],
            "poses": (d.xpos, d.xmat, d.site_xpos, d.site_xmat),
        }

    def inverse(mx, dx, q, v, vdot):
        return mjx.inverse(mx, dx.replace(qpos=q, qvel=v, qacc=vdot)).qfrc_inverse

    def forward(mx, dx, q, v, tau):
        return mjx.forward(mx, dx.replace(qpos=q, qvel=v, qfrc_applied=tau)).qacc

    def jacobian(mx, dx, q, point, body):
        d = mjx.fwd_position(mx, dx.replace(qpos=q))
        return mjx.jac(mx, d, point, body)

    def derivatives(of):
        def along(mx, dx, q, v, third, rates):
            def moved(w, *x):
                return of(mx, dx, q + rates @ w, *x)

            return jax.jacfwd(moved, (0, 1, 2))(jax.numpy.zeros_like(v), v, third)

        return along

    compiled = {
        "state": state,
        "inverse": inverse,
        "forward": forward,
        "jacobian": jacobian,
        "inverse_derivatives": derivatives(inverse),
        "forward_derivatives": derivatives(forward),
    }
    return {name: jax.jit(function) for name, function in compiled.items()}


class MjxEngine(JaxEngine):
    """Tree of rigid bodies as an MJX model, in float32."""

    key = "mjx"
    extra = "mjx"
    module = "mujoco.mjx"
    oldest = "3.17"
    built_by: ClassVar[type[MujocoEngine]] = MujocoEngine

    @classmethod
    def distribution(cls) -> str:
        """Return "mujoco-mjx", the name of its wheels."""
        return "mujoco-mjx"

    @classmethod
    def holds(cls, links: list[TreeLink]) -> bool:
        """Return whether MuJoCo holds it."""
        return MujocoEngine.holds(links)

    def _build(self, library: Any, links: list[TreeLink]) -> None:
        self._take(library)

    _builder: MujocoEngine

    def _take(self, library: Any) -> None:
        """Copy the model that MuJoCo builds."""
        self._builder = builder = object.__new__(self.built_by)
        builder.set_up(self.inputs._replace(r=0))
        model, off = builder.model, builder._mj.mjtDisableBit
        for bit in ("CONSTRAINT", "SPRING", "DAMPER", "ACTUATION"):
            model.opt.disableflags |= int(getattr(off, f"mjDSBL_{bit}"))
        with self._precision():
            self._mx, self._dx = library.put_model(model), library.make_data(model)
            heavy = self._mx.opt.replace(gravity=np.asarray(self._gravity))
            self._under_gravity = self._mx.replace(opt=heavy)
        self._place = builder._place

    def _call(self, name: str, model: Any, *arguments: Any) -> Any:
        """Return the result of a compiled function."""
        return self._computed(_functions, name, model, self._dx, *arguments)

    def _ordered(self, values: Array) -> Array:
        """Return coordinates, in the order of the tree, in MuJoCo's order."""
        return self._in_own_order(values)

    def _state(self, q: Array, v: Array, model: Any = None) -> dict[str, Any]:
        model = self._mx if model is None else model
        return self._call("state", model, self._ordered(q), self._in_own_order(v))

    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M (n, n) by `mjx.full_m`."""
        M = self._state(q, np.zeros(self._n))["M"]
        return M[np.ix_(self._place, self._place)]

    def bias(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return B (n,), the `qfrc_bias`; gravity is zero in the model."""
        return self._state(q, v)["bias"][self._place]

    # ---- Conformance quantities ------------------------------------------------------------------

    def _dynamics(self, name: str, q: Array, v: Array, third: Array, *more: Any) -> Any:
        state = self._ordered(q), self._in_own_order(v), self._in_own_order(third)
        return self._call(name, self._under_gravity, *state, *more)

    def inverse_dynamics(self, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return τ (n,) by `mjx.inverse`."""
        return self._dynamics("inverse", q, v, vdot)[self._place]

    def forward_dynamics(self, q: Array, v: Array, tau: Array, t: float = 0.0) -> Array:
        """Return v̇ (n,) by `mjx.forward`, τ as `qfrc_applied`."""
        return self._dynamics("forward", q, v, tau)[self._place]

    def gravity(self, q: Array, t: float = 0.0) -> Array:
        """Return ∂U/∂q (n,), the `qfrc_bias` at rest."""
        return self._state(q, np.zeros(self._n), self._under_gravity)["bias"][self._place]

    def center_of_mass(self, q: Array, t: float = 0.0) -> Array:
        """Return c (3,), the `subtree_com` of the world."""
        return self._state(q, np.zeros(self._n))["com"]

    def center_of_mass_velocity(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return ċ (3,), the `subtree_linvel` of the world by `mjx.subtree_vel`."""
        return self._state(q, v)["com_velocity"]

    def momentum(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return h (6,): mass times `subtree_linvel`, and `subtree_angmom` of the world."""
        state = self._state(q, v)
        mass = float(self._builder.model.body_subtreemass[0])
        return np.concatenate((mass * state["com_velocity"], state["angular_momentum"]))

    def has_frame(self, f: str) -> bool:
        """Return whether there is a site or body of this name."""
        return self._builder.has_frame(f)

    def _frame(self, f: str, q: Array) -> tuple[int, Array, Array]:
        """Return the body of a link, the orientation and the position of its frame."""
        builder = self._builder
        frame = builder._frame(f, q, np.zeros(self._n))
        positions, axes, sites, site_axes = self._state(q, np.zeros(self._n))["poses"]
        if frame.kind == builder._mj.mjtObj.mjOBJ_SITE:
            positions, axes = sites, site_axes
        R = axes[frame.number].reshape(3, 3)
        return frame.body, R, positions[frame.number]

    def frame_placement(self, f: str, q: Array, t: float = 0.0) -> tuple[Array, Array]:
        """Return (R, p) of `xmat` and `xpos`, or those of a site."""
        _, R, p = self._frame(f, q)
        return R, p

    def frame_jacobian(self, f: str, q: Array, t: float = 0.0) -> Array:
        """Return J (6, n) by `mjx.jac`."""
        body, _, p = self._frame(f, q)
        linear, angular = self._call("jacobian", self._mx, self._ordered(q), p, body)
        return np.vstack((linear.T, angular.T))[:, self._place]

    def _derivatives(self, name: str, q: Array, v: Array, third: Array) -> tuple[Array, ...]:
        own = np.ix_(self._place, self._place)
        return tuple(
            x[own]
            for x in self._dynamics(
                name, q, v, third, self._builder.position_rates(self._ordered(q))
            )
        )

    def inverse_dynamics_derivatives(
        self, q: Array, v: Array, vdot: Array, t: float = 0.0
    ) -> tuple[Array, Array]:
        """Return ∂τ/∂q and ∂τ/∂v by `jax.jacfwd` of `mjx.inverse`."""
        by_q, by_v, _ = self._derivatives("inverse_derivatives", q, v, vdot)
        return by_q, by_v

    def forward_dynamics_derivatives(
        self, q: Array, v: Array, tau: Array, t: float = 0.0
    ) -> tuple[Array, Array, Array]:
        """Return ∂v̇/∂q, ∂v̇/∂v and ∂v̇/∂τ by `jax.jacfwd` of `mjx.forward`."""
        by_q, by_v, by_tau = self._derivatives("forward_derivatives", q, v, tau)
        return by_q, by_v, by_tau


class Mjx64Engine(MjxEngine):
    """Tree of rigid bodies as an MJX model, in float64."""

    key = "mjx64"
    unit_roundoff = 2.0**-53


class MjxFile(FileEngine, MjxEngine):
    """URDF that MuJoCo reads, in MJX in float32."""

    key = "mjx_file"
    built_by = MujocoFile
    base_velocity = BaseVelocity("ground", "base")

    def _read(self, library: Any, description: RobotDescription) -> None:
        self._take(library)
        assert isinstance(self._builder, MujocoFile)
        self._joints = self._builder.joints()

    def set_up(self, inputs: TreeInputs) -> None:
        """Read the file."""
        super().set_up(inputs)
        self._place = self._builder._place

    def _ordered(self, values: Array) -> Array:
        return values


class Mjx64File(MjxFile):
    """URDF that MuJoCo reads, in MJX in float64."""

    key = "mjx64_file"
    unit_roundoff = 2.0**-53


class MjxMjcf(MjxFile):
    """MJCF that MuJoCo reads, in MJX in float32."""

    key = "mjx_mjcf"
    format = "mjcf"
    built_by = MjcfFile

    def _described(self) -> RobotDescription:
        return MjcfFile._described(self)  # type: ignore[arg-type]

    def velocity_map(self, q: Array, v: Array) -> VelocityMap:
        """Return that of MuJoCo."""
        return self._builder.velocity_map(q, v)

    def velocity_map_derivatives(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return those of MuJoCo."""
        return self._builder.velocity_map_derivatives(q, v)


class Mjx64Mjcf(MjxMjcf):
    """MJCF that MuJoCo reads, in MJX in float64."""

    key = "mjx64_mjcf"
    unit_roundoff = 2.0**-53
