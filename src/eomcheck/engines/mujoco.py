"""MuJoCo: mass matrix by composite rigid bodies, bias by recursive Newton-Euler.

MuJoCo moves no body without mass, so the joints of links that only carry sit on the body that they
carry. Constraints are soft: rows of a become tendons of constant coefficients, held by MuJoCo's own
solver as stiffly as its settings allow.
"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from eomcheck.engines.base import EngineAcceleration
from eomcheck.engines.tree import TreeEngine
from eomcheck.engines.walk import Carried, Link, bodies_with_mass
from eomcheck.numbers.generic import Array

STIFFEST = 0.9999
"""The largest impedance that MuJoCo takes: of a constraint's own response it leaves 1e-4."""


class MujocoEngine(TreeEngine):
    """A scene that is a tree of rigid bodies, as a model of MuJoCo's."""

    module = extra = "mujoco"
    compliant = True

    @classmethod
    def holds(cls, links: list[Link]) -> bool:
        """Return whether every link without mass carries exactly one other."""
        return super().holds(links) and bodies_with_mass(links) is not None

    def _build(self, library: Any, links: list[Link]) -> None:
        self._mj = library
        spec = library.MjSpec()
        carried = bodies_with_mass(links) or []
        placed = [spec.worldbody]
        for one in carried:
            placed.append(self._add_body(placed[one.parent + 1], one))
        for row in range(self.scene.r):
            self._add_constraint(spec, f"row_{row}", links)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of bodies that have no inertia yet
            self.model = model = spec.compile()
        model.opt.gravity[:] = 0.0
        model.opt.tolerance = 0.0
        for one in carried:
            # Not by `fullinertia`, which takes no singular ones, and no orientation without `ipos`.
            moments, axes = one.body.principal
            body = model.body(one.body.name).id
            model.body_inertia[body] = moments
            model.body_iquat[body] = self._quaternion(axes)
        self.data = library.MjData(model)
        library.mj_setConst(model, self.data)
        self._place = np.array([model.joint(link.name).dofadr[0] for link in links])

    def _quaternion(self, rotation: Array) -> Array:
        quaternion = np.zeros(4)
        self._mj.mju_mat2Quat(quaternion, np.ascontiguousarray(rotation).ravel())
        return quaternion

    def _add_body(self, parent: Any, one: Carried) -> Any:
        kinds = self._mj.mjtJoint
        body = parent.add_body(name=one.body.name, pos=one.offset)
        body.quat = self._quaternion(one.rotation)
        body.mass, body.ipos, body.inertia = one.body.mass, one.body.center, np.ones(3)
        body.explicitinertial = True
        body.simple = 0  # of which nothing may be changed once it is compiled, as inertia is
        for joint in one.joints:
            kind = kinds.mjJNT_SLIDE if joint.slides else kinds.mjJNT_HINGE
            body.add_joint(name=joint.name, type=kind, pos=joint.position, axis=joint.axis)
        return body

    def _add_constraint(self, spec: Any, name: str, links: list[Link]) -> None:
        """Add a linear combination of the joints that is to be 0, its coefficients still unknown.

        MuJoCo aims at the acceleration -k d r, d its impedance and k = stiffness / d². A stiffness
        of d makes that -r: the acceleration is chosen by the offset in r.
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
        self._mj.mj_fullM(self.model, self.data, M)
        return M[np.ix_(self._place, self._place)]

    def bias(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return B (n,) by the recursive Newton-Euler algorithm; gravity is zero in the model."""
        self._forward(q, v)
        return self.data.qfrc_bias[self._place]

    def acceleration(
        self,
        q: Array,
        v: Array,
        Q: Array,
        a: Array | None,
        gamma: Array | None,
        t: float = 0.0,
    ) -> EngineAcceleration:
        """Return v̇ and λ by MuJoCo's own solver, from our Q, a and gamma."""
        if self.follow:
            return self.eliminated(q, v, Q, a, gamma, t)
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
