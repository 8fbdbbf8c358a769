"""The chain pendulum as SymPy's KanesMethod derives it, from points, frames and bodies."""

from functools import cache

import numpy as np
import sympy as sp
from sympy.physics import mechanics as me

import eomcheck
from eomcheck.scenes import ChainPendulum


@cache
def derived(n):
    """Return M, -B and Q of n links as functions of (q, v, mass, length, inertia, gravity)."""
    q, v = me.dynamicsymbols(f"q:{n}"), me.dynamicsymbols(f"v:{n}")
    m, L, inertia = (sp.symbols(f"{name}:{n}") for name in ("m", "L", "I"))
    g, ground, joint = sp.Symbol("g"), me.ReferenceFrame("N"), me.Point("O")
    joint.set_vel(ground, 0)
    links, weights = [], []
    for i in range(n):
        link = ground.orientnew(f"A{i}", "Axis", (q[i], ground.z))
        link.set_ang_vel(ground, v[i] * ground.z)
        center, tip = (joint.locatenew(f"{x}{i}", L[i] / x * link.x) for x in (2, 1))
        for point in (center, tip):
            point.v2pt_theory(joint, ground, link)
        about = me.inertia(link, 0, 0, inertia[i]), center
        links.append(me.RigidBody(f"B{i}", center, link, m[i], about))
        weights.append((center, -m[i] * g * ground.y))
        joint = tip
    kane = me.KanesMethod(ground, q, v, [v[i] - q[i].diff() for i in range(n)])
    kane.kanes_equations(links, weights)
    without = kane.forcing.subs(g, 0)
    terms = kane.mass_matrix, without, kane.forcing - without
    return [sp.lambdify((q, v, m, L, inertia, g), term) for term in terms]


class Kanes(eomcheck.Engine):
    @classmethod
    def version(cls):
        return f"sympy {sp.__version__}"

    @classmethod
    def represents(cls, scene):
        return isinstance(scene, ChainPendulum) and scene.links <= 3

    def of(self, which, q, v):
        at, gravity = self.scene, 0.0 if self.scene.gravity is None else self.scene.gravity
        return derived(at.links)[which](q, v, at.mass, at.length, at.inertia, float(gravity))

    def mass_matrix(self, q, t=0.0):
        return self.of(0, q, np.zeros_like(q))

    def bias(self, q, v, t=0.0):
        return -self.of(1, q, v)[:, 0]

    def forces(self, q, v, t=0.0):
        return self.of(2, q, v)[:, 0]
