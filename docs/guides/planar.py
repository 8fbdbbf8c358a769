"""An engine of one's own: rigid bodies in the plane, by numpy alone. M = Σ m Jᵀ J + i wᵀ w."""

import numpy as np

from eomcheck import Engine


class Planar(Engine):
    """Bodies on a tree of joints, one after another from the ground outwards."""

    reads_parameters = False  # it builds its model from scene.tree()
    solves_like = "au"

    def __init__(self, scene):
        super().__init__(scene)
        self.tree = scene.tree()

    @classmethod
    def version(cls):
        return f"planar {np.__version__}"

    @classmethod
    def represents(cls, scene):
        tree = scene.tree()
        if tree is not None and not {"px", "py", "rz"}.issuperset(tree.joint):
            return False  # it leaves the plane
        return tree is not None and list(tree.joint) == sorted(tree.joint)  # slides, then hinges

    def velocity_map(self, q, v):  # the joint coordinates are x = T q
        T = self.tree.coordinates
        return T @ q, T, np.zeros(len(T))

    def bodies(self, x, w):
        """Yield mass, inertia, J (2, n) of the centre of mass, J̇ w (2,), and ω as spin @ w."""
        tree, placed = self.tree, {-1: (0.0, np.zeros((2, len(w))), np.zeros(2), np.zeros(len(w)))}
        for j, (parent, kind) in enumerate(zip(tree.parent, tree.joint, strict=True)):
            angle, J, rest, spin = placed[parent]
            own = np.eye(len(w))[j]
            J, rest = shifted(J, rest, spin, w, rotation(angle) @ tree.offset[j][:2])
            if kind == "rz":
                angle, spin = angle + x[j], spin + own
            else:  # it slides along x or y, and nothing before it turns
                J = J + np.outer(np.eye(2)["xy".index(kind[1])], own)
            placed[j] = angle, J, rest, spin
            J, rest = shifted(J, rest, spin, w, rotation(angle) @ tree.center[j][:2])
            yield tree.mass[j], tree.inertia[j][2, 2], J, rest, spin

    def mass_matrix(self, q, t=0.0):
        bodies = self.bodies(q, np.zeros(len(q)))
        return sum(m * J.T @ J + i * np.outer(spin, spin) for m, i, J, _, spin in bodies)

    def bias(self, q, v, t=0.0):
        return sum(m * J.T @ rest for m, _, J, rest, _ in self.bodies(q, v))

    def acceleration(self, q, v, Q, a, gamma, t=0.0):
        M, F = self.mass_matrix(q, t), Q - self.bias(q, v, t)
        if a is None:
            return np.linalg.solve(M, F), None
        whole = np.block([[M, -a.T], [a, np.zeros((len(a), len(a)))]])
        x = np.linalg.solve(whole, np.concatenate([F, -gamma]))
        return x[: len(q)], x[len(q) :]


def rotation(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def across(arm):
    return np.array([-arm[1], arm[0]])


def shifted(J, rest, spin, w, arm):
    """Return J and J̇ w of the point that is `arm` away on the same body."""
    return J + np.outer(across(arm), spin), rest - (spin @ w) ** 2 * arm
