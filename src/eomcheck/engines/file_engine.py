"""`FileEngine`: base class of engines whose library reads a robot description by its own parser.

A `FileEngine` is a `TreeEngine` with a model that the library builds from the file, so that a
comparison checks eomcheck's reader too. `RobotDescription` is the text of a URDF or SDF for such
libraries, with its irregularities. The output that a library writes to the terminal while it reads
a file is captured, and reported where it explains a difference.

A free base is moved by three slides along x, y, z of the ground, then by turns about z, y and x,
and its velocity is their rates. Libraries have a rotation, and six velocities w = S v of a frame
that is fixed to the base: the velocity of its origin and the angular velocity, in either order and
each along the axes of the ground or of the frame (`BaseVelocity`, `FreeBase`).
"""

from __future__ import annotations

import os
import sys
import tempfile
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Set
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, ClassVar, NamedTuple
from xml.etree import ElementTree

import numpy as np

from eomcheck.descriptions.doubtful_numbers import has_impossible_inertia
from eomcheck.descriptions.elements import Joint, Link
from eomcheck.descriptions.mechanism_class import Mechanism
from eomcheck.descriptions.mjcf_reader import GROUND
from eomcheck.descriptions.sdf_reader import SDF, read_sdf
from eomcheck.descriptions.urdf_reader import WORLD, Element, read_urdf, root_of
from eomcheck.engines.engine import EngineAcceleration, VelocityMap
from eomcheck.engines.tree_engine import TreeEngine, TreeInputs, tree_inputs
from eomcheck.errors import EngineError
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.dual import duals, rate
from eomcheck.numbers.generic import Array
from eomcheck.safe_output import listed

# ---- Free base -----------------------------------------------------------------------------------

FREE = 6
"""Number of coordinates of a free base, which come first."""

AXES = "ground", "base"


class BaseVelocity(NamedTuple):
    """Convention of a library for the velocity of a free base."""

    linear: str
    """Axes of the velocity of its origin, one of `AXES`."""
    angular: str
    """Axes of the angular velocity, one of `AXES`."""
    turns_first: bool = False
    """Whether the angular velocity comes before the linear one."""

    def __str__(self) -> str:
        linear, angular = (
            f"{what} velocity along the axes of the {axes}"
            for what, axes in (("linear", self.linear), ("angular", self.angular))
        )
        first, last = (angular, linear) if self.turns_first else (linear, angular)
        return f"{first}, then {last}"


class FreeBase(NamedTuple):
    """Pose of a frame that is fixed to a free base, and its velocity as a function of v = q̇."""

    position: Array
    """Position of its origin (3,), m."""
    R: Array
    """Axes of the frame, columns (3, 3)."""
    linear: Array
    """Jacobian (3, 6) of the velocity of the origin along the axes of the ground, per v."""
    linear_rest: Array
    """Acceleration of the origin at v̇ = 0 (3,), m/s²."""
    angular: Array
    """Jacobian (3, 6) of the angular velocity along the axes of the ground, per v."""
    angular_rest: Array
    """Angular acceleration at v̇ = 0 (3,), rad/s²."""

    def velocity(self, convention: BaseVelocity, v: Array) -> tuple[Array, Array]:
        """Return S (6, 6) and Ṡ v (6,) of the velocity in a library's convention."""
        omega, parts = self.angular @ v, {}
        for name, axes in (("linear", convention.linear), ("angular", convention.angular)):
            S, rest = getattr(self, name), getattr(self, f"{name}_rest")
            if axes == "base":  # axes that turn
                rest = self.R.T @ (rest - _cross(omega, S @ v))
                S = self.R.T @ S
            parts[name] = S, rest
        order = ("angular", "linear") if convention.turns_first else ("linear", "angular")
        S, rest = zip(*(parts[name] for name in order), strict=True)
        return np.vstack(S), np.concatenate(rest)

    @property
    def quaternion(self) -> Array:
        """Orientation as a quaternion w, x, y, z, of length 1."""
        return _quaternion(self.R)


def free_base(q: Array, v: Array, at: Array | None = None, turn: Array | None = None) -> FreeBase:
    """Return the pose and the velocity of a frame that is fixed to the base of a scene.

    Args:
        q: slides of the base along x, y, z, then turns about z, y, x (6,).
        v: their rates (6,).
        at: origin of the frame, in that of the base (3,), m; by default that of the base.
        turn: axes of the frame, in that of the base, columns (3, 3); by default those of the base.
    """
    x, y, z = range(3)
    yaw, pitch, roll = _about(q[3], z), _about(q[4], y), _about(q[5], x)
    tilted = yaw @ pitch
    R = tilted @ roll
    turns = np.column_stack([np.eye(3)[z], yaw[:, y], tilted[:, x]])
    rates = turns * v[3:]
    omega = rates.sum(axis=1)
    first, second, third = rates.T
    alpha = _cross(first, second) + _cross(first + second, third)
    arm = np.zeros(3) if at is None else R @ at
    swung = _cross(turns, arm)
    return FreeBase(
        q[:3] + arm,
        R if turn is None else R @ turn,
        np.hstack([np.eye(3), swung]),
        _cross(alpha, arm) + _cross(omega, _cross(omega, arm)),
        np.hstack([np.zeros((3, 3)), turns]),
        alpha,
    )


def base_derivatives(
    frame: Callable[[Array, Array], FreeBase], convention: BaseVelocity, q: Array, v: Array
) -> tuple[Array, Array]:
    """Return ∂(S v)/∂q and ∂(Ṡ v)/∂q (6, 6) of the velocity of a free base, by dual numbers.

    Args:
        frame: function of q and v that returns the base.
        convention: that of the library for its velocity.
        q: coordinates of the base (6,).
        v: their rates (6,).
    """
    along, more = np.zeros((2, FREE, FREE))
    # Both are sums of terms with a velocity of the base.
    for k, unit in enumerate(np.eye(FREE) if v.any() else ()):
        base = frame(duals(q, unit), v.astype(object))
        S, rest = base.velocity(convention, v.astype(object))
        along[:, k], more[:, k] = (rate(x).astype(float) for x in (S @ v, rest))
    return along, more


def _about(angle: Any, axis: int) -> Array:
    """Return the rotation about the axis of this index, by an angle that may be a dual number."""
    cos, sin = np.cos(angle), np.sin(angle)
    R, i, j = np.eye(3, dtype=np.asarray(cos).dtype), (axis + 1) % 3, (axis + 2) % 3
    R[i, i] = R[j, j] = cos
    R[i, j], R[j, i] = -sin, sin
    return R


def _cross(a: Array, b: Array) -> Array:
    """Return a × b of a vector, or columns, a and a vector b: `np.cross` takes 20 times as long."""
    x, y, z = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    return np.array([x, y, z])


def _quaternion(R: Array) -> Array:
    """Return the quaternion w, x, y, z of a rotation, of length 1."""
    K = np.empty((4, 4))
    K[0, 0] = np.trace(R)
    K[0, 1:] = K[1:, 0] = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    K[1:, 1:] = R + R.T - np.trace(R) * np.eye(3)
    # K + 1 is 4 times the outer product of the quaternion with itself.
    outer = K + np.eye(4)
    column = outer[:, int(np.argmax(np.diagonal(outer)))]
    return column / np.linalg.norm(column)


def rotation_of_quaternion(quaternion: Array) -> Array:
    """Return the rotation (3, 3) of a quaternion w, x, y, z of length 1."""
    w, u = quaternion[0], quaternion[1:]
    across = np.cross(np.eye(3), u)
    return np.eye(3) + 2.0 * (w * across + across @ across)


# ---- Captured output -----------------------------------------------------------------------------

OUTPUT, ERRORS = 1, 2
"""File descriptors that compiled code writes to, independent of `sys.stdout` and `sys.stderr`."""


@contextmanager
def capture_output() -> Iterator[list[str]]:
    """Yield a list that after the block holds all lines that were written, each once."""
    lines: list[str] = []
    _flush()
    with tempfile.TemporaryFile() as captured:
        before = {stream: os.dup(stream) for stream in (OUTPUT, ERRORS)}
        for stream in before:
            os.dup2(captured.fileno(), stream)
        try:
            yield lines
        finally:
            _flush()
            for stream, original in before.items():
                os.dup2(original, stream)
                os.close(original)
            captured.seek(0)
            text = captured.read().decode("utf-8", "replace")
            lines += dict.fromkeys(x.strip() for x in text.splitlines() if x.strip())


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        with suppress(AttributeError, OSError, ValueError):
            stream.flush()


# ---- Robot descriptions --------------------------------------------------------------------------

SHAPES = "visual", "collision"

OF_GAZEBO = (*SHAPES, "sensor", "plugin", "include", "light", "actor", "state")
"""Parts of an SDF that may name other files, or are outside of the model."""


class RobotDescription(NamedTuple):
    """A file without shapes: mesh files are often missing, and no equation of motion needs them."""

    text: str
    """URDF or SDF as XML."""
    root: str
    """Name of the link that no joint moves."""
    follows: dict[str, tuple[str, float, float]]
    """Joint -> the joint that it follows, ratio and shift."""
    damped: frozenset[str]
    """Joints with viscous damping."""
    massless: tuple[str, ...]
    """Links without mass that have moments of inertia nevertheless."""
    empty: tuple[str, ...]
    """Links that joints move and that have neither mass nor moments of inertia."""
    impossible: tuple[str, ...]
    """Links with moments of inertia that no body has: one exceeds the sum of the others."""


NO_URDF = RobotDescription("", GROUND, {}, frozenset(), (), (), ())
"""Description of a file of another format than URDF and SDF."""


def file_of(scene: Scene, format: str = "urdf") -> Path | None:
    """Return the file of a robot that has the parameters of its file; None for any other scene.

    Args:
        scene: the robot.
        format: a key of `SUFFIXES`; None is returned for a file of another format.
    """
    if not (isinstance(scene, Mechanism) and scene.source.format == format and scene.as_described):
        return None
    return Path(scene.source.file)


class CompoundJoint(NamedTuple):
    """A joint with several coordinates in a library, as a part of a free base."""

    own: slice
    """Its velocities among those of the library."""
    kind: str
    """Its kind, a key of `PARTS_OF_BASE`."""

    def state(self, x: Array, rates: Array) -> Array:
        """Return coordinates and rates (2, 6) of the free base that it is a part of."""
        state = np.zeros((2, FREE))
        state[:, PARTS_OF_BASE[self.kind].coordinates] = x[self.own], rates[self.own]
        return state


class PartOfBase(NamedTuple):
    """Coordinates and velocities of a joint among those of a free base, linear ones first."""

    coordinates: list[int]
    velocities: list[int]


PARTS_OF_BASE = {
    "floating": PartOfBase([*range(FREE)], [*range(FREE)]),
    "spherical": PartOfBase([3, 4, 5], [3, 4, 5]),
    "planar": PartOfBase([0, 1, 3], [0, 1, 5]),
}
"""Kind of joint with several coordinates -> the part of a free base that it is."""


def compound_joints(scene: Mechanism) -> dict[str, str]:
    """Return the kinds of the joints with several coordinates by name, a free base left out."""
    first = FREE if is_free(scene) else 0
    base = {slot.name for slot in scene.plan.joints[:first]}
    names = [name for name in scene.source.compound_coordinates if name not in base]
    kinds: dict[str, str] = {}
    for name in names:
        joint, _, part = name.rpartition("_")
        if part == "turn":
            kinds[joint] = "planar"
        elif part == "roll":
            kinds[joint] = "floating" if f"{joint}_z" in names else "spherical"
    return kinds


def is_free(scene: Scene) -> bool:
    """Return whether a robot's base is free by request (`floating`)."""
    return isinstance(scene, Mechanism) and bool(scene.source.floating)


def read_description(path: Path, format: str = "urdf", floating: bool = False) -> RobotDescription:
    """Read a URDF or an SDF.

    Args:
        path: the file.
        format: "urdf" or "sdf".
        floating: whether the root is free, which an SDF without joints needs.

    Raises:
        InputError: see `eomcheck.scenes.from_urdf` and `from_sdf`.
    """
    if format == "urdf":
        robot, xml, parts = read_urdf(path), root_of(path), SHAPES
        names, follows = tuple(link.name for link in robot.links), dict(_mimics(xml))
    else:
        robot, xml, parts = read_sdf(path, floating=floating), root_of(path, SDF), OF_GAZEBO
        names, follows = robot.bodies, dict(_sdf_mimics(xml.iter("joint")))
    children = {x.child for x in robot.joints if format == "urdf" or not _places_root(x)}
    root = next((name for name in names if name not in children), WORLD)
    for element in [*xml.iter()]:
        for part in [x for kind in parts for x in element.findall(kind)]:
            element.remove(part)
    links = [link for link in robot.links if link.name in names]
    return RobotDescription(
        ElementTree.tostring(xml, encoding="unicode"),
        root,
        follows,
        frozenset(joint.name for joint in robot.joints if _damped(joint)),
        tuple(link.name for link in links if link.mass == 0 and any(link.moments)),
        tuple(link.name for link in links if link.name in children and not _heavy(link)),
        tuple(link.name for link in links if has_impossible_inertia(link)),
    )


def _mimics(xml: Element) -> Iterator[tuple[str, tuple[str, float, float]]]:
    """Yield the joints that follow others, read independently: eomcheck's reader is under test.

    Each is a pair: joint, (the joint that it follows, ratio, shift).
    """
    for joint in xml.findall("joint"):
        mimic = joint.find("mimic")
        if mimic is not None and joint.get("type") != "fixed":
            ratio, shift = float(mimic.get("multiplier", 1)), float(mimic.get("offset", 0))
            yield joint.get("name", ""), (mimic.get("joint", ""), ratio, shift)


def _sdf_mimics(joints: Iterable[Element]) -> Iterator[tuple[str, tuple[str, float, float]]]:
    """Yield the joints of an SDF with one axis that follow others, as `_mimics` does."""
    joints = [*joints]
    several = {x.get("name") for x in joints if x.get("type") in ("universal", "revolute2")}
    for joint in joints:
        mimic = joint.find("axis/mimic")
        if mimic is not None and joint.get("type") in ("revolute", "continuous", "prismatic"):
            defaults = {"multiplier": 1.0, "offset": 0.0, "reference": 0.0}
            ratio, shift, at = (float(mimic.findtext(x) or y) for x, y in defaults.items())
            leader = mimic.get("joint", "")
            if leader in several:
                leader = f"{leader}_{mimic.get('axis', 'axis')}"
            yield joint.get("name", ""), (leader, ratio, shift - ratio * at)


def _places_root(joint: Joint) -> bool:
    """Return whether a joint of an SDF is none of the file, but holds its root or sets it free."""
    return joint.parent == WORLD and joint.name in (joint.child, f"{joint.child} fixed")


def _damped(joint: Joint) -> bool:
    return bool(joint.damping)


def _heavy(link: Link) -> bool:
    return link.mass > 0 or any(link.moments)


def few(names: Iterable[str]) -> str:
    """Return at most three names and the number of others, as text."""
    names = sorted(names) if isinstance(names, Set) else list(names)
    return listed(names, 3)


# ---- Engines -------------------------------------------------------------------------------------


class FileEngine(TreeEngine):
    """Engine of a robot description as the library itself reads the file.

    Its coordinates are those of the library's joints, in the library's order: x = S q + shift, S
    constant. A joint that follows another one is a coordinate of its own in most libraries. The
    coordinates of a free base come first; `pose` returns them.

    Attributes:
        file: the file of the robot.
        description: the robot in it.
        base: number of coordinates of a free base, 6 or 0.
        library_output: lines that the library wrote while it read the file.
    """

    reads_file = True

    format: ClassVar[str] = "urdf"
    """Format of the files that it reads, a key of `SUFFIXES`."""

    base_velocity: ClassVar[BaseVelocity]
    """Convention of the library for the velocity of a free base."""

    undamped: ClassVar[bool] = False
    """Whether its accelerations leave out the dampers of the file."""

    compounds: ClassVar[frozenset[str]] = frozenset()
    """Kinds of joints with several coordinates in a URDF that it maps, besides a free base."""

    _joints: list[str]

    _compounds: tuple[CompoundJoint, ...] = ()
    """Joints whose velocities are not the rates of their coordinates; `_read` sets them."""

    @classmethod
    def inputs_of(cls, scene: Scene) -> TreeInputs:
        """Return the file of a robot, its frames and gravity; EngineError for other scenes."""
        if not (isinstance(scene, Mechanism) and cls.represents(scene)):
            raise EngineError(f"{cls.key} cannot represent {scene.name} by its file")
        inputs = tree_inputs(scene, scene.tree())
        return inputs._replace(file=str(scene.source.file), floating=is_free(scene))

    def set_up(self, inputs: TreeInputs) -> None:
        """Read the file."""
        self.inputs, self.file = inputs, Path(inputs.file)
        self.description = self._described()
        self.base = FREE if inputs.floating else 0
        self._gravity = np.asarray(inputs.tree.gravity, np.float64)
        self.frames = tuple(x._replace(R=np.eye(3), p=np.zeros(3)) for x in inputs.tree.frames)
        library = self._library()
        with capture_output() as self.library_output:
            self._read(library, self.description)
        self.coordinates, self.shift = self._coordinate_map(self.joints())
        self._n, self._place = len(self.shift), np.arange(len(self.shift))

    def _coordinate_map(self, joints: list[str]) -> tuple[Array, Array]:
        """Return S (m, n) and shift (m,), x = S q + shift, for joints of these names.

        Raises:
            EngineError: it has another joint than the file, or lacks one.
        """
        names, base = self.inputs.coordinate_names, self.base
        columns = {name: i for i, name in enumerate(names)}
        S, shift = np.zeros((base + len(joints), len(names))), np.zeros(base + len(joints))
        S[:base, :base] = np.eye(base)
        for i, name in enumerate(joints, base):
            factor, leader = 1.0, name
            while leader in self.description.follows:
                leader, ratio, offset = self.description.follows[leader]
                shift[i] += factor * offset
                factor *= ratio
            if leader not in columns:
                raise EngineError(f"{self.key} has a joint {name!r} that the file does not move")
            S[i, columns[leader]] = factor
        for name, column in zip(names, S.T, strict=True):
            if not column.any():
                raise EngineError(f"{self.key} has no joint {name!r}, which the file moves")
        return S, shift

    @classmethod
    def represents(cls, scene: Scene) -> bool:
        """Return whether the scene is a robot with the parameters of a file of this format.

        One with joints of several coordinates only where the adapter maps them (`compounds`).
        """
        if not isinstance(scene, Mechanism) or file_of(scene, cls.format) is None:
            return False
        return cls.format == "mjcf" or {*compound_joints(scene).values()} <= cls.compounds

    def leaves_out(self, method: str) -> str:
        """Return the part of the file that a result leaves out, as text; "" where none is known.

        Args:
            method: name of the method with that result.
        """
        undamped = self.undamped and not self.follow  # dampers are in what `eliminated` solves
        if method == "acceleration" and undamped and self.description.damped:
            return f"its accelerations leave out the damping of {few(self.description.damped)}"
        dropped = [line for line in self.library_output if "inertia" in line.lower()]
        return f"while it read the file it wrote {dropped[0]!r}" if dropped else ""

    def _described(self) -> RobotDescription:
        """Return the description of the robot in its file; `NO_URDF` of an MJCF."""
        if self.format == "mjcf":
            return NO_URDF
        return read_description(self.file, self.format, self.inputs.floating)

    @abstractmethod
    def _read(self, library: Any, description: RobotDescription) -> None:
        """Build the library's model by its own parser, the base fixed unless `base` is not 0.

        It sets `_joints`, see `joints`.
        """

    def joints(self) -> list[str]:
        """Return the names of its joints, one for each entry of its velocity after the base's."""
        return self._joints

    def velocity_map(self, q: Array, v: Array) -> VelocityMap:
        """Return (S q + shift, S, 0); a free base comes first, with its `pose`, own S and Ṡ v.

        So have joints with several coordinates (`_compounds`); their x are those of the scene.
        """
        x, S = self.coordinates @ q + self.shift, np.eye(self._n)
        rates, rest = self.coordinates @ v, np.zeros(self._n)
        for joint in self._compounds:
            state = joint.state(x, rates)
            whole, more = free_base(*state).velocity(self.base_velocity, state[1])
            part = PARTS_OF_BASE[joint.kind]
            S[joint.own, joint.own] = whole[np.ix_(part.velocities, part.coordinates)]
            rest[joint.own] = more[part.velocities]
        if self.base:
            base = self.base_frame(q, v)
            S[:FREE, :FREE], rest[:FREE] = base.velocity(self.base_velocity, v[:FREE])
            x = np.concatenate([self.pose(base), x[FREE:]])
        return VelocityMap(x, S @ self.coordinates, rest)

    def velocity_map_derivatives(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return ∂(S v)/∂q and ∂(Ṡ v)/∂q (m, n), by dual numbers; those of joints are 0."""
        along, more = np.zeros((2, self._n, self._n))
        x, rates = self.coordinates @ q + self.shift, self.coordinates @ v
        for joint in self._compounds:
            parts = base_derivatives(free_base, self.base_velocity, *joint.state(x, rates))
            block = np.ix_(*reversed(PARTS_OF_BASE[joint.kind]))
            along[joint.own, joint.own], more[joint.own, joint.own] = (y[block] for y in parts)
        if self.base:
            parts = base_derivatives(self.base_frame, self.base_velocity, q[:FREE], v[:FREE])
            along[:FREE, :FREE], more[:FREE, :FREE] = parts
        return along @ self.coordinates, more @ self.coordinates

    def base_frame(self, q: Array, v: Array) -> FreeBase:
        """Return the frame that represents a free base in the library; q and v are the scene's."""
        return free_base(q[:FREE], v[:FREE])

    def free_base(self, q: Array, v: Array) -> tuple[FreeBase, BaseVelocity] | None:
        """Return `base_frame` and the convention of its velocity; None for a fixed base."""
        return (self.base_frame(q, v), self.base_velocity) if self.base else None

    def pose(self, base: FreeBase) -> Array:
        """Return the library's coordinates of a free base."""
        return np.concatenate([base.position, base.quaternion])

    def acceleration(
        self,
        q: Array,
        v: Array,
        Q: Array,
        a: Array | None,
        gamma: Array | None,
        t: float = 0.0,
    ) -> EngineAcceleration:
        """Return ẍ (m,) under the library's own forces; λ by the scene's a and gamma, if any.

        Most libraries leave joints that follow others, and constraints, to soft solvers.
        """
        if self.follow or a is not None:
            return self.eliminated(q, v, self.forces(q, v, t), a, gamma, t)
        return EngineAcceleration(self.free_acceleration(q, v))

    def free_acceleration(self, q: Array, v: Array) -> Array:
        """Return ẍ (m,) from M, B and Q, unless overridden by an algorithm of the library."""
        return np.linalg.solve(self.mass_matrix(q), self.forces(q, v) - self.bias(q, v))
