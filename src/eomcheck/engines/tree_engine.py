"""`TreeEngine`: base class of engines that build their model from a scene's tree of rigid bodies.

The model is built from `TreeLink`s, one per joint of the tree and in its order: a joint with one
coordinate, its pose on the parent link, and the body that it moves. Only this module knows the
encoding of a `Tree`.
"""

from __future__ import annotations

import re
from abc import abstractmethod
from functools import cache, cached_property
from importlib import metadata
from typing import Any, ClassVar, NamedTuple

import numpy as np

from eomcheck.descriptions.tree_model import tree_model
from eomcheck.descriptions.tree_quantities import PER_BODY, moved_parameters
from eomcheck.descriptions.vector_algebra import as_vector
from eomcheck.engines.engine import Engine, EngineAcceleration, VelocityMap
from eomcheck.errors import EngineError, required
from eomcheck.mechanics.records import Tree, TreeFrame
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array

# ---- Links ---------------------------------------------------------------------------------------


class TreeLink(NamedTuple):
    """Joint with one coordinate, and the body behind it.

    The joint's frame moves with the body; at coordinate 0 it coincides with the joint's seat, a
    frame that is fixed to the parent.
    """

    name: str
    """Name, unique in its tree."""
    parent: int
    """Index of the link that it is mounted on, always an earlier one, or -1: the ground."""
    kind: str
    """Joint type "px" ... "rz": slides along ("p") or turns about ("r") an axis of its frame."""
    rotation: Array
    """Orientation of the seat in the frame of the parent (3, 3)."""
    offset: Array
    """Position of the seat in the frame of the parent (3,), m."""
    mass: float
    """Mass, kg, 0 for a link that only carries others."""
    center: Array
    """Centre of mass in the joint's frame (3,), m."""
    inertia: Array
    """Inertia about the centre of mass, along the axes of the joint's frame (3, 3), kg m²."""
    armature: float = 0.0
    """Rotor inertia that is added to the joint's coordinate, kg m² or kg."""

    @property
    def turns_without_mass(self) -> bool:
        """Whether it has inertia but no mass, which most libraries ignore or reject."""
        return self.mass == 0 and bool(self.inertia.any())

    @property
    def slides(self) -> bool:
        """Whether the joint is prismatic; otherwise it is revolute."""
        return self.kind[0] == "p"

    @property
    def axis(self) -> Array:
        """Axis of the joint in its own frame (3,), of length 1."""
        return np.eye(3)["xyz".index(self.kind[1])]

    @property
    def principal(self) -> tuple[Array, Array]:
        """Principal moments (3,), kg m², and their axes, columns of a rotation (3, 3).

        For libraries that would compute them themselves, and lose digits or the axes.
        """
        moments, axes = np.linalg.eigh(self.inertia)
        axes[:, 0] *= np.sign(np.linalg.det(axes))
        return moments, axes


def tree_links(tree: Tree) -> list[TreeLink]:
    """Return the links of a tree, each after its parent."""
    return [
        TreeLink(
            name=f"link_{j}",
            parent=tree.parent[j],
            kind=tree.joint[j],
            rotation=np.array(tree.rotation[j], np.float64),
            offset=np.asarray(tree.offset[j], np.float64),
            mass=float(tree.mass[j]),
            center=np.asarray(tree.center[j], np.float64),
            inertia=np.array(tree.inertia[j], np.float64),
            armature=float(tree.armature[j]),
        )
        for j in range(len(tree.joint))
    ]


class MountedJoint(NamedTuple):
    """Joint in the frame of the body that it moves, while all joints are at 0."""

    name: str
    slides: bool
    position: Array
    """Position in the body's frame (3,), m."""
    axis: Array
    """Axis in the body's frame (3,), of length 1."""


class BodyWithJoints(NamedTuple):
    """Body with mass and all joints that move it: those of links without mass, then its own."""

    body: TreeLink
    parent: int
    """Index of the body that the first joint is mounted on, or -1: the ground."""
    rotation: Array
    """Orientation in the frame of the parent (3, 3) while all joints are at 0."""
    offset: Array
    """Position in the frame of the parent (3,) while all joints are at 0, m."""
    joints: tuple[MountedJoint, ...]


def bodies_with_mass(links: list[TreeLink]) -> list[BodyWithJoints] | None:
    """Return the bodies that have mass, each with all joints between it and the body before.

    For libraries in which every moving body needs mass. None where a link without mass does not
    carry exactly one other, so that no body can have its joint.
    """
    carries = [sum(child.parent == j for child in links) for j in range(len(links))]
    if any(link.mass == 0 and number != 1 for link, number in zip(links, carries, strict=True)):
        return None
    bodies: list[BodyWithJoints] = []
    indices = {-1: -1}
    for j, link in enumerate(links):
        if link.mass > 0:
            indices[j] = len(bodies)
            chain, first = [link], link.parent
            while first != -1 and links[first].mass == 0:
                chain.insert(0, links[first])
                first = links[first].parent
            bodies.append(_body_of_chain(indices[first], chain))
    return bodies


def _body_of_chain(parent: int, chain: list[TreeLink]) -> BodyWithJoints:
    """Return the body of the last link of `chain`, moved by the joints of all."""
    seats = [(chain[0].rotation, chain[0].offset)]
    for link in chain[1:]:
        rotation, offset = seats[-1]
        seats.append((rotation @ link.rotation, offset + rotation @ link.offset))
    rotation, offset = seats[-1]
    joints = (
        MountedJoint(
            link.name, link.slides, rotation.T @ (o - offset), rotation.T @ turned @ link.axis
        )
        for link, (turned, o) in zip(chain, seats, strict=True)
    )
    return BodyWithJoints(chain[-1], parent, rotation, offset, tuple(joints))


# ---- Engines -------------------------------------------------------------------------------------

UNSTATED = "0"
"""Oldest version of a library where an adapter states none."""

SUFFIXES = {"urdf": "_file", "mjcf": "_mjcf", "sdf": "_sdf"}
"""Format of a file -> suffix of the key of an engine that reads such files."""


def requirements_of(distribution: str, extra: str | None) -> list[str]:
    """Return the requirements of an extra of eomcheck, that of a library first.

    Without an extra only that of the library, as eomcheck requires it; its name where it does not.
    """
    lines = metadata.requires("eomcheck") or ()
    parts = (line.partition(";") for line in lines)
    wanted = "" if extra is None else f'extra=="{extra}"'
    found = [name.strip() for name, _, condition in parts if _condition(condition) == wanted]
    own = [x for x in found if re.match(rf"{re.escape(distribution)}(?![\w.-])", x)]
    others = [x for x in found if x not in own] if extra is not None else []
    return [*(own or [distribution]), *others]


@cache
def _installed_version(distribution: str) -> str:
    """Return the version of an installed distribution, which takes a search of files."""
    return metadata.version(distribution)


def _condition(text: str) -> str:
    """Return the condition of a requirement without spaces, in double quotes."""
    return text.replace(" ", "").replace("'", '"')


def without_suffix(key: str) -> str:
    """Return the key of an engine without the suffix of one that reads files."""
    return re.sub(f"({'|'.join(SUFFIXES.values())})$", "", key)


def library_key(kind: type[Engine]) -> str:
    """Return the key of an engine class; of one that reads files that without its suffix."""
    return without_suffix(kind.key)


TOUCHING = 1e-12
"""Relative tolerance of the triangle inequality of principal moments: for a thin rod or plate one
moment is the sum of the others."""


class TreeInputs(NamedTuple):
    """Scene as an engine of a tree needs it, in plain data that another process can read."""

    name: str
    """Name of the scene."""
    n: int
    """Number of coordinates."""
    r: int
    """Number of constraints."""
    coordinate_names: tuple[str, ...]
    """Names of the coordinates."""
    tree: Tree
    bodies: tuple[str, ...]
    """Names of the links of bodies, in the order of the parameters of a regressor."""
    file: str = ""
    """File of the robot, "" for an engine that reads none."""
    floating: bool = False
    """Whether its base is free by request."""


def tree_inputs(scene: Scene, tree: Tree) -> TreeInputs:
    """Return a scene with this tree as plain data."""
    model = tree_model(scene)
    bodies = () if model is None else model.bodies
    return TreeInputs(scene.name, scene.n, scene.r, tuple(scene.coordinate_names), tree, bodies)


class TreeEngine(Engine):
    """Engine of a tree of rigid bodies, in coordinates of its joints x = T q + shift.

    A subclass returns the results of its library in these, in the order of the links (rule 4).
    Joints that follow others are independent in the model: M, B and Q are projected along T, and v̇
    is solved from the library's M and B.
    """

    module: ClassVar[str]
    """Module to import."""

    oldest: ClassVar[str] = UNSTATED
    """Oldest version of the library that the adapter supports."""

    any_inertia: ClassVar[bool] = False
    """Whether it accepts moments of inertia that no body has."""

    solves_like = "gw"
    reads_parameters = False

    base = 0
    """Number of coordinates of a free base, which come first: that of a tree is fixed."""

    inputs: TreeInputs

    def __init__(self, scene: Scene):
        super().__init__(scene)
        self.set_up(self.inputs_of(scene))

    @classmethod
    def inputs_of(cls, scene: Scene) -> TreeInputs:
        """Return the part of a scene that the model is built from.

        Raises:
            EngineError: the engine cannot represent the scene.
        """
        tree = scene.tree()
        if tree is None or not cls.represents(scene):
            raise EngineError(f"{cls.key} cannot represent {scene.name} as a tree of bodies")
        return tree_inputs(scene, tree)

    def set_up(self, inputs: TreeInputs) -> None:
        """Build the model from `inputs`; called once, maybe in a process that has no scene."""
        tree, self.inputs = inputs.tree, inputs
        self.coordinates: Array = tree.coordinates
        """Matrix T (m, n), x = T q + shift for the m joints of the tree."""
        self.shift: Array = tree.shift
        """Joint coordinates x where q = 0 (m,)."""
        self.frames: tuple[TreeFrame, ...] = tree.frames
        """Frames of the links, fixed to joints."""
        self._gravity: Array = np.asarray(tree.gravity, np.float64)
        self._n = len(tree.joint)
        self._build(self._library(), self.links(tree))

    @classmethod
    def _library(cls) -> Any:
        return required(cls.module, cls.extra)

    @classmethod
    def distribution(cls) -> str:
        """Return the name under which the library is installed."""
        return cls.extra or cls.module

    @classmethod
    def requirements(cls, version: str = "") -> list[str]:
        """Return the library and what else its extra installs, as requirements.

        Args:
            version: version of the library; "" for any that eomcheck supports. Of one that is
                named the others may have any version too.
        """
        name, needed = cls.distribution(), requirements_of(cls.distribution(), cls.extra)
        if not version:
            return needed
        others = [re.split(r"[<>=!~]", one)[0] for one in needed]
        return [f"{name}=={version}", *(one for one in others if one != name)]

    @classmethod
    def version(cls) -> str:
        """Return name and version of the library."""
        name = cls.extra or library_key(cls)
        version = getattr(cls._library(), "__version__", None)
        return f"{name} {version or _installed_version(cls.distribution())}"

    @classmethod
    def represents(cls, scene: Scene) -> bool:
        """Return whether the scene is described as a tree that the library can hold."""
        tree = scene.tree()
        if tree is None or not all_move(tree) or np.any(tree.gimbal_armature):
            return False
        links = cls.links(tree)
        return cls.holds(links) and (cls.any_inertia or all(map(cls.takes, links)))

    @classmethod
    def links(cls, tree: Tree) -> list[TreeLink]:
        """Return the links that the model is built from."""
        return tree_links(tree)

    @classmethod
    def takes(cls, link: TreeLink) -> bool:
        """Return whether the moments of inertia of a link are those of some body.

        None is negative and none exceeds the sum of the others; many libraries reject or replace
        other moments. In the plane moments about other axes do not count, and all are the same.
        """
        low, middle, high = link.principal[0]
        return bool(low >= -TOUCHING * high and low + middle >= high * (1 - TOUCHING))

    @classmethod
    def holds(cls, links: list[TreeLink]) -> bool:
        """Return whether the library can hold such a tree.

        By default none with rotors, nor with a link that has inertia but no mass.
        """
        return not any(link.armature or link.turns_without_mass for link in links)

    @abstractmethod
    def _build(self, library: Any, links: list[TreeLink]) -> None:
        """Build the library's model, without gravity and forces."""

    _seats: dict[str, Any]
    """Link -> what methods of the library take for its frame, where a name does not do."""

    def has_frame(self, f: str) -> bool:
        """Return whether there is a frame of this link, one of `_seats` if these are known."""
        return f in getattr(self, "_seats", (f,))

    def _seat(self, f: str) -> Any:
        """Return the entry of a link in `_seats`.

        Raises:
            EngineError: there is no such frame.
        """
        if f not in self._seats:
            raise EngineError(f"{self.key} has no frame of link {f!r}")
        return self._seats[f]

    _place: Array
    """Index of each of its velocities in the library's own order; `_build` sets it."""

    def _in_own_order(self, values: Array) -> Array:
        """Return values (n,) of its velocities in the library's own order."""
        ordered = np.zeros(self._n)
        ordered[self._place] = values
        return ordered

    def _in_tree_order(self, matrix: Array) -> Array:
        """Return a matrix (n, n) in the library's own order in that of its velocities here."""
        return matrix[np.ix_(self._place, self._place)]

    def velocity_map(self, q: Array, v: Array) -> VelocityMap:
        """Return (T q + shift, T, 0)."""
        return VelocityMap(self.coordinates @ q + self.shift, self.coordinates, np.zeros(self._n))

    def velocity_map_derivatives(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return zeros: T does not depend on q."""
        return np.zeros(self.coordinates.shape), np.zeros(self.coordinates.shape)

    @cached_property
    def body_frames(self) -> list[TreeFrame]:
        """The frames of bodies, in the order of the parameters of a regressor."""
        return [frame for frame in self.frames if frame.name in self.inputs.bodies]

    @cached_property
    def body_parameters(self) -> list[Array]:
        """The matrices of `parameters_at_joint` of the frames of bodies."""
        return [parameters_at_joint(frame) for frame in self.body_frames]

    @property
    def follow(self) -> bool:
        """Whether some joints follow others."""
        return self._n > self.inputs.n

    def eliminated(
        self, q: Array, v: Array, Q: Array, a: Array | None, gamma: Array | None, t: float
    ) -> EngineAcceleration:
        """Return ẍ (m,) and λ by the library's M and B, joints that follow others eliminated.

        All arguments are in the coordinates of the joints, as those of `acceleration`.
        """
        T = self.coordinates
        M, F = T.T @ self.mass_matrix(q, t) @ T, T.T @ (Q - self.bias(q, v, t))
        free = np.linalg.solve(M, F)
        if a is None or gamma is None:
            return EngineAcceleration(T @ free, None)
        rows = a @ T
        responses = np.linalg.solve(M, rows.T)
        multipliers = np.linalg.solve(rows @ responses, -gamma - rows @ free)
        return EngineAcceleration(T @ (free + responses @ multipliers), multipliers)


class TreeSolverEngine(TreeEngine):
    """Engine of a tree whose library also solves for constrained accelerations."""

    def acceleration(
        self,
        q: Array,
        v: Array,
        Q: Array,
        a: Array | None,
        gamma: Array | None,
        t: float = 0.0,
    ) -> EngineAcceleration:
        """Return v̇ and λ as `solved`, or by `eliminated` where joints follow others."""
        if self.follow:
            return self.eliminated(q, v, Q, a, gamma, t)
        return self.solved(q, v, Q, a, gamma)

    @abstractmethod
    def solved(
        self, q: Array, v: Array, Q: Array, a: Array | None, gamma: Array | None
    ) -> EngineAcceleration:
        """Return v̇ (n,) and λ (r,) by the library, from Q, a and gamma of the scene."""


def homogeneous(R: Array, p: Array) -> Array:
    """Return the homogeneous matrix (4, 4) of an orientation and a position."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = R, p
    return pose


def parameters_at_joint(frame: TreeFrame) -> Array:
    """Return X (10, 10): parameters about the joint's origin, along its axes, are X π.

    π are the parameters of a body about the origin of its link's frame (`Engine.regressor`).
    """
    x, y, z = map(as_vector, frame.R.T)
    columns = [moved_parameters(unit, as_vector(frame.p), (x, y, z)) for unit in np.eye(PER_BODY)]
    return np.array(columns, np.float64).T


def all_move(tree: Tree) -> bool:
    """Return whether T has full column rank: each coordinate moves the tree in a way of its own."""
    return bool(np.linalg.matrix_rank(tree.coordinates) == tree.coordinates.shape[1])
