"""MJX: MuJoCo's equations of motion in JAX, compiled, with derivatives by its forward mode.

MuJoCo reads the file or builds the model, and MJX copies it. JAX computes in float32 unless told
otherwise: there are engines of both precisions. Constraints and limits are switched off, springs
and dampers where a result has none of them. A free base is moved by w as in MuJoCo; derivatives by
its position are along w, to first order of the quaternion's own update.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from eomcheck.engines.jax_engine import InFloat64, JaxDynamics, derivatives_along
from eomcheck.engines.mujoco_copy import MujocoCopy, MujocoCopyOfFile, MujocoCopyOfMjcf
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

    def forces(mx, dx, q, v):
        return mjx.forward(mx, dx.replace(qpos=q, qvel=v)).qfrc_passive

    compiled = {
        "state": state,
        "inverse": inverse,
        "forward": forward,
        "jacobian": jacobian,
        "forces": forces,
        "inverse_derivatives": derivatives_along(inverse),
        "forward_derivatives": derivatives_along(forward),
    }
    return {name: jax.jit(function) for name, function in compiled.items()}


def _nameless(mx: Any) -> Any:
    """Return a model without names: those of one topology share what is compiled."""
    names = {name: getattr(mx, name) for name in vars(mx) if name.startswith("name_")}
    return mx.replace(names=b"", **{name: np.zeros_like(x) for name, x in names.items()})


class MjxEngine(JaxDynamics, MujocoCopy):
    """Tree of rigid bodies as an MJX model, in float32."""

    key = "mjx"
    extra = "mjx"
    module = "mujoco.mjx"
    oldest = "3.17"

    @classmethod
    def distribution(cls) -> str:
        """Return "mujoco-mjx", the name of its wheels."""
        return "mujoco-mjx"

    def _load(self, library: Any, model: Any) -> None:
        self._without("CONSTRAINT", "ACTUATION")
        with self._precision():
            self._dx = library.make_data(model)
            complete = _nameless(library.put_model(model))
            self._without("SPRING", "DAMPER")
            self._mx = _nameless(library.put_model(model))
            self._under_gravity, self._complete = (
                one.replace(opt=one.opt.replace(gravity=np.asarray(self._gravity)))
                for one in (self._mx, complete)
            )

    def _call(self, name: str, model: Any, *arguments: Any) -> Any:
        """Return the result of a compiled function."""
        return self._computed(_functions, name, model, self._dx, *arguments)

    def _state(self, q: Array, v: Array, model: Any = None) -> dict[str, Any]:
        model = self._mx if model is None else model
        return self._call("state", model, self._ordered(q), self._in_own_order(v))

    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M (n, n) by `mjx.full_m`."""
        return self._in_tree_order(self._state(q, np.zeros(self._n))["M"])

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

    def _rates_at(self, q: Array) -> Array:
        return self._rates(self._ordered(q))


class Mjx64Engine(InFloat64, MjxEngine):
    """Tree of rigid bodies as an MJX model, in float64."""

    key = "mjx64"


class MjxFile(MujocoCopyOfFile, MjxEngine):
    """URDF that MuJoCo reads, in MJX in float32."""

    key = "mjx_file"

    def forces(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return Q (m,): gravity, and `qfrc_passive` of springs and dampers."""
        return self._call("forces", self._complete, q, v) - self.gravity(q)

    def free_acceleration(self, q: Array, v: Array) -> Array:
        """Return ẍ (m,) of `mjx.forward`."""
        return self._call("forward", self._complete, q, v, np.zeros(self._n))


class Mjx64File(InFloat64, MjxFile):
    """URDF that MuJoCo reads, in MJX in float64."""

    key = "mjx64_file"


class MjxMjcf(MujocoCopyOfMjcf, MjxFile):
    """MJCF that MuJoCo reads, in MJX in float32."""

    key = "mjx_mjcf"


class Mjx64Mjcf(InFloat64, MjxMjcf):
    """MJCF that MuJoCo reads, in MJX in float64."""

    key = "mjx64_mjcf"
