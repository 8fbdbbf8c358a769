"""Genesis: rigid bodies of its `RigidSolver`, in float64, on the CPU.

M, forces and accelerations are those of a step, which is taken at each state that is asked, by the
integrator "Euler", without constraints; its length has no part in them. A tree is handed over as a
URDF. By default Genesis adds 0.1 kg m² (kg) of armature to every joint of a URDF: that is set to 0.
By default it also merges links that are fixed to each other, and writes the file anew for that,
with fewer digits: that is switched off. Dampers are implicit in its own accelerations, so those of
a file are solved from M, B and forces. One process computes in one precision. Kernels are compiled
for minutes when they are new.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from eomcheck.engines.file_engine import (
    BaseVelocity,
    FileEngine,
    RobotDescription,
    is_free,
    rotation_of_quaternion,
)
from eomcheck.engines.pybullet import urdf_of_links
from eomcheck.engines.tree_engine import TreeEngine, TreeLink
from eomcheck.errors import required
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array

NO_LIMIT = 1e100
"""Largest force of a joint, N or N m: those of a file, its `effort`, would cut forces off."""


class GenesisEngine(TreeEngine):
    """Tree of rigid bodies as an entity of Genesis."""

    key = extra = module = "genesis"
    oldest = "1.4"

    @classmethod
    def distribution(cls) -> str:
        """Return "genesis-world", the name of its wheels."""
        return "genesis-world"

    @classmethod
    def _library(cls) -> Any:
        library = super()._library()
        if not library._initialized:
            library.init(backend=library.cpu, precision="64", logging_level="error")
            required("torch", cls.extra).set_flush_denormal(False)  # it is turned on by `init`
        return library

    def _build(self, library: Any, links: list[TreeLink]) -> None:
        self._take(library, urdf_of_links(links))
        joints = [self._entity.get_joint(f"joint_of_{link.name}") for link in links]
        self._place = np.array([joint.dofs_idx_local[0] for joint in joints])
        self._seats = {
            frame.name: (links[frame.joint].name, frame.R, frame.p)
            for frame in self.frames
            if frame.joint >= 0
        }

    def _take(self, library: Any, text: str) -> None:
        """Build a scene of one URDF."""
        options, rigid = library.options.SimOptions(dt=0.01), library.options.RigidOptions
        self._scene = library.Scene(
            show_viewer=False,
            sim_options=options,
            rigid_options=rigid(
                enable_collision=False,
                enable_joint_limit=False,
                disable_constraint=True,
                integrator=library.integrator.Euler,
            ),
        )
        morph = library.morphs.URDF(
            file=text, fixed=True, merge_fixed_links=False, default_armature=0.0
        )
        self._entity = self._scene.add_entity(morph)
        self._scene.build()
        limit = np.full(self._entity.n_dofs, NO_LIMIT)
        self._entity.set_dofs_force_range(-limit, limit)
        self._damping = _numbers(self._entity.get_dofs_damping())
        self._step(np.zeros(self._entity.n_dofs), np.zeros(self._entity.n_dofs))

    def _move_to(self, q: Array, v: Array) -> None:
        """Set a state in Genesis' order."""
        self._entity.set_dofs_position(q)
        self._entity.set_dofs_velocity(v)

    def _step(
        self,
        q: Array,
        v: Array,
        tau: Array | None = None,
        *,
        weight: bool = False,
        damped: bool = False,
    ) -> None:
        """Take a step from a state in Genesis' order.

        Args:
            q: coordinates.
            v: velocities.
            tau: forces of the joints; none by default.
            weight: whether there is gravity.
            damped: whether there are dampers.
        """
        self._scene.sim.set_gravity(self._gravity * weight)
        self._entity.set_dofs_damping(self._damping * damped)
        self._entity.control_dofs_force(np.zeros(len(q)) if tau is None else tau)
        self._move_to(q, v)
        self._scene.step(update_visualizer=False)

    def _forces(self, q: Array, v: Array, **options: Any) -> Array:
        """Return the sum of all forces and of minus the bias, `get_dofs_force` of a step."""
        self._step(self._in_own_order(q), self._in_own_order(v), **options)
        return _numbers(self._entity.get_dofs_force())[self._place]

    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M (n, n) by `get_mass_mat`."""
        self._step(self._in_own_order(q), np.zeros(self._n))
        return self._in_tree_order(_numbers(self._entity.get_mass_mat()))

    def bias(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return B (n,), minus the `get_dofs_force` of a step without weight and dampers."""
        return -self._forces(q, v)

    # ---- Conformance quantities ------------------------------------------------------------------

    def gravity(self, q: Array, t: float = 0.0) -> Array:
        """Return ∂U/∂q (n,), minus the `get_dofs_force` of a step at rest."""
        return -self._forces(q, np.zeros(self._n), weight=True)

    def forward_dynamics(self, q: Array, v: Array, tau: Array, t: float = 0.0) -> Array:
        """Return v̇ (n,) by `get_dofs_acc` of a step."""
        state = self._in_own_order(q), self._in_own_order(v), self._in_own_order(tau)
        self._step(*state, weight=True)
        return _numbers(self._entity.get_dofs_acc())[self._place]

    def kinetic_energy(self, q: Array, v: Array, t: float = 0.0) -> float:
        """Return T by `get_kinetic_energy`."""
        self._move_to(self._in_own_order(q), self._in_own_order(v))
        return float(self._entity.get_kinetic_energy())

    def potential_energy(self, q: Array, t: float = 0.0) -> float:
        """Return U by `get_potential_energy`."""
        self._scene.sim.set_gravity(self._gravity)
        self._move_to(self._in_own_order(q), np.zeros(self._n))
        return float(self._entity.get_potential_energy())

    def _posed(self, f: str, q: Array, v: Array) -> tuple[Any, Array, Array, Array, Array]:
        """Set a state; return a link, its axes and origin, and a frame's axes and origin there."""
        self._move_to(self._in_own_order(q), self._in_own_order(v))
        name, turn, at = self._seat(f)
        link = self._entity.get_link(name)
        R = rotation_of_quaternion(_numbers(link.get_quat()))
        return link, R, _numbers(link.get_pos()), turn, at

    def frame_placement(self, f: str, q: Array, t: float = 0.0) -> tuple[Array, Array]:
        """Return (R, p) by `get_quat` and `get_pos` of a link."""
        _, R, p, turn, at = self._posed(f, q, np.zeros(self._n))
        return R @ turn, p + R @ at

    def frame_velocity(self, f: str, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return the velocity (6,) by `get_vel` and `get_ang` of a link."""
        link, R, _, _, at = self._posed(f, q, v)
        omega = _numbers(link.get_ang())
        return np.concatenate((_numbers(link.get_vel()) + np.cross(omega, R @ at), omega))

    def frame_jacobian(self, f: str, q: Array, t: float = 0.0) -> Array:
        """Return J (6, n) by `get_jacobian` of a point of a link."""
        link, _, _, _, at = self._posed(f, q, np.zeros(self._n))
        return _numbers(self._entity.get_jacobian(link, at))[:, self._place]


def _numbers(tensor: Any) -> Array:
    """Return a tensor of Torch as an array."""
    return tensor.detach().numpy().astype(np.float64)


class GenesisFile(FileEngine, GenesisEngine):
    """URDF with a fixed base, read by Genesis."""

    key = "genesis_file"
    base_velocity = BaseVelocity("ground", "ground")

    @classmethod
    def represents(cls, scene: Scene) -> bool:
        """Return whether the scene is a robot with the parameters of its file and a fixed base."""
        return super().represents(scene) and not is_free(scene)

    def _read(self, library: Any, description: RobotDescription) -> None:
        self._take(library, description.text)
        moving = [joint for joint in self._entity.joints if joint.n_dofs == 1]
        moving.sort(key=lambda joint: joint.dofs_idx_local[0])
        self._joints = [joint.name for joint in moving]
        names = {link.name for link in self._entity.links}
        self._seats = {
            frame.name: (frame.name, np.eye(3), np.zeros(3))
            for frame in self.frames
            if frame.name in names
        }

    def forces(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return Q (m,): `get_dofs_force` of a step, less that without weight and dampers."""
        return self._forces(q, v, weight=True, damped=True) - self._forces(q, v)
