"""The chain pendulum as SymPy's KanesMethod derives it from bodies, points and frames."""

from functools import cache

import numpy as np
import sympy as sp
from sympy.physics import mechanics as me

import eomcheck
from eomcheck.scenes import ChainPendulum


@cache
def derived(n):
    """Return functions of (q, v, numbers): the mass matrix, the bias and the forces, for n links."""
    q, u = me.dynamicsymbols(f"q:{n}"), me.dynamicsymbols(f"u:{n}")
    (m, L, inertia), g = (sp.symbols(f"{name}:{n}") for name in "mLI"), sp.Symbol("g")
    ground, joint = me.ReferenceFrame("N"), me.Point("O")
    joint.set_vel(ground, 0)
    bodies, loads = [], []
    for i in range(n):
        frame = ground.orientnew(f"A{i}", "Axis", (q[i], ground.z))
        frame.set_ang_vel(ground, u[i] * ground.z)
        center = joint.locatenew(f"C{i}", L[i] / 2 * frame.x)
        tip = joint.locatenew(f"P{i}", L[i] * frame.x)
        for point in (center, tip):
            point.v2pt_theory(joint, ground, frame)
        bodies.append(me.RigidBody(f"B{i}", center, frame, m[i], (me.inertia(frame, 0, 0, inertia[i]), center)))
        loads.append((center, -m[i] * g * ground.y))
        joint = tip
    rates = [a - b.diff() for a, b in zip(u, q, strict=True)]
    kane = me.KanesMethod(ground, q, u, kd_eqs=rates)
    kane.kanes_equations(bodies, loads)
    forces = kane.forcing.subs(g, 0), kane.forcing - kane.forcing.subs(g, 0)
    return [sp.lambdify((q, u, m, L, inertia, g), x) for x in (kane.mass_matrix, -forces[0], forces[1])]


class Kanes(eomcheck.Engine):
    """Frames, points and bodies, by SymPy."""

    @classmethod
    def version(cls):
        return f"sympy {sp.__version__}"

    @classmethod
    def represents(cls, scene):
        return isinstance(scene, ChainPendulum) and scene.n <= 4

    def _asked(self, which, q, v):
        scene = self.scene
        gravity = 0.0 if scene.gravity is None else float(scene.gravity)
        numbers = scene.mass, scene.length, scene.inertia, gravity
        return np.asarray(derived(scene.n)[which](q, v, *numbers), float)

    def mass_matrix(self, q, t=0.0):
        return self._asked(0, q, np.zeros_like(q))

    def bias(self, q, v, t=0.0):
        return self._asked(1, q, v)[:, 0]

    def forces(self, q, v, t=0.0):
        return self._asked(2, q, v)[:, 0]
