"""Pinocchio on a robot's file, which it reads by a parser of its own.

The other engines build their models from `Scene.tree`: what our reader of URDF files makes wrong
is then wrong on both sides. This one shares nothing with it but the names of joints.

    eomcheck validate --scene arm.urdf --engine eomcheck.engines.parsed:ParsedByPinocchio
"""

from __future__ import annotations

from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from eomcheck.engines.base import Engine, VelocityMap
from eomcheck.errors import required
from eomcheck.mechanics.described.mechanism import Mechanism
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.contract import Array


class Of(NamedTuple):
    """A joint of Pinocchio's model with one coordinate."""

    coordinate: int
    ratio: float
    shift: float
    circle: bool
    """Whether Pinocchio holds it as cosine and sine."""


class ParsedByPinocchio(Engine):
    """A robot with the parameters of its file, as Pinocchio reads it."""

    key = "pinocchio_urdf"
    reads_parameters = False

    def __init__(self, scene: Scene):
        super().__init__(scene)
        assert isinstance(scene, Mechanism)
        made = scene.made
        self._pin = pin = required("pinocchio")
        base = (pin.JointModelFreeFlyer(),) if made.floating else ()
        self.model = pin.buildModelFromUrdf(made.source, *base)
        self.data = self.model.createData()
        self.gravity = np.zeros(3)
        if (g := getattr(scene, "gravity", None)) is not None:
            self.gravity[: g.size] = g
        self.free = bool(made.floating)
        names = list(self.model.names)[2 if self.free else 1 :]
        mimics = {
            joint.get("name", ""): mimic.attrib
            for joint in ElementTree.parse(made.source).iter("joint")
            for mimic in joint.iter("mimic")
        }
        self.joints = [self._joint(name, mimics) for name in names]

    def _joint(self, name: str, mimics: dict[str, dict[str, str]]) -> Of:
        """Return a joint, which Pinocchio moves by itself, as what it follows."""
        ratio, shift, at = 1.0, 0.0, name
        while at in mimics:
            said = mimics[at]
            shift += ratio * float(said.get("offset", 0.0))
            ratio *= float(said.get("multiplier", 1.0))
            at = said["joint"]
        of = self.model.joints[self.model.getJointId(name)]
        return Of(self.scene.coordinate_names.index(at), ratio, shift, of.nq == 2)

    @classmethod
    def version(cls) -> str:
        """Return name and version of the library."""
        return f"pinocchio {required('pinocchio').__version__}, its own parser"

    @classmethod
    def represents(cls, scene: Scene) -> bool:
        """Return whether the scene is a file as it is, of joints with one coordinate."""
        if not (isinstance(scene, Mechanism) and scene.made.source and scene.as_described):
            return False
        first = 6 if scene.made.floating else 0
        # What has more coordinates has names of its own for them.
        return set(scene.made.several) <= {slot.name for slot in scene.plan.slots[:first]}

    def velocity_map(self, q: Array, v: Array) -> VelocityMap:
        """Return Pinocchio's configuration, and its velocity: of the base along its own axes."""
        x: list[float] = []
        S = np.zeros((len(self.joints) + 6 * self.free, self.scene.n))
        rest = np.zeros(len(S))
        if self.free:
            x += self._base(q, v, S, rest)
        for row, one in enumerate(self.joints, 6 * self.free):
            here = one.ratio * q[one.coordinate] + one.shift
            x += [np.cos(here), np.sin(here)] if one.circle else [here]
            S[row, one.coordinate] = one.ratio
        return VelocityMap(np.array(x), S, rest)

    def _base(self, q: Array, v: Array, S: Array, rest: Array) -> list[float]:
        """Fill in the free base, moved along x, y, z and turned about z, y, x; return its place."""
        axes, pin = np.eye(3), self._pin
        yaw, pitch, roll = (
            np.array(pin.AngleAxis(float(angle), axis).matrix())
            for angle, axis in zip(q[3:6], (axes[2], axes[1], axes[0]), strict=True)
        )
        R = yaw @ pitch @ roll
        S[:3, :3] = R.T
        S[3:6, 3:6] = np.column_stack([roll.T @ pitch.T @ axes[2], roll.T @ axes[1], axes[0]])
        turned = S[3:6, 3:6] * v[3:6]
        omega = turned.sum(axis=1)
        rest[:3] = -np.cross(omega, R.T @ v[:3])
        rest[3:6] = -np.cross(turned[:, 2], turned[:, 0] + turned[:, 1])
        rest[3:6] -= np.cross(turned[:, 1], turned[:, 0])
        return [*q[:3], *pin.Quaternion(R).coeffs()]

    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M by the composite rigid body algorithm, which fills its upper half."""
        upper = np.triu(np.array(self._pin.crba(self.model, self.data, q)))
        return upper + upper.T - np.diag(np.diagonal(upper))

    def bias(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return B by the recursive Newton-Euler algorithm, without gravity."""
        self.model.gravity.linear = np.zeros(3)
        return np.array(self._pin.nonLinearEffects(self.model, self.data, q, v))

    def forces(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return Q of gravity, and of the dampers of the file."""
        self.model.gravity.linear = self.gravity
        weight = np.array(self._pin.computeGeneralizedGravity(self.model, self.data, q))
        return -weight - self.model.damping * v
