"""A chain of links that hangs on a pin, derived by hand: the engine on trial in "In your CI"."""

import numpy as np

import eomcheck
from eomcheck.scenes import ChainPendulum


class ByHand(eomcheck.Engine):
    """The chain pendulum of absolute angles, in closed form."""

    solves_like = "au"

    def __init__(self, scene):
        super().__init__(scene)
        mass, length = scene.mass, scene.length
        behind = np.cumsum(mass[::-1])[::-1] - mass  # the mass that hangs on the end of each link
        lever = length * (behind + mass / 2)
        # Of two links the nearer to the pin carries the other, whose lever is what counts.
        far = np.maximum.outer(np.arange(scene.n), np.arange(scene.n))
        near = np.minimum.outer(np.arange(scene.n), np.arange(scene.n))
        self.coupling = length[near] * lever[far]
        np.fill_diagonal(self.coupling, scene.inertia + length**2 * (behind + mass / 4))

    @classmethod
    def version(cls):
        return "by hand 1.0"

    @classmethod
    def represents(cls, scene):
        return isinstance(scene, ChainPendulum)

    def mass_matrix(self, q, t=0.0):
        return self.coupling * np.cos(np.subtract.outer(q, q))

    def bias(self, q, v, t=0.0):
        return self.coupling * np.sin(np.subtract.outer(q, q)) @ v**2

    def acceleration(self, q, v, Q, a, gamma, t=0.0):
        return np.linalg.solve(self.mass_matrix(q), Q - self.bias(q, v)), None
