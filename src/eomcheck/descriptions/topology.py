"""Topology of a mechanism in whole numbers: scalar joints and constraints without their parameters.

A scalar joint is a joint with one coordinate, and the frame that it moves; a constraint names its
frames and parameters by index. A `TopologyPlan` holds data that depend on a `Topology` alone: the
scalar joints on the path to each frame, and the coordinates that move each body.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

ROLLING = frozenset({"touching", "rolling"})
"""Kinds of constraints of bodies that roll on a plane."""


class ScalarJoint(NamedTuple):
    """A joint with one coordinate, or one that mimics another's: the frame that it moves.

    All numbers but `sense` are indices: of scalar joints, coordinates, parameters.
    """

    parent: int
    """Index of an earlier scalar joint, or -1: the ground."""
    kind: str
    """Motion, a slide along ("p") or turn about ("r") an axis of its frame: "px" ... "rz"."""
    coordinate: int
    sense: int = 1
    """Sign of the axis, 1 or -1: along it the coordinate is so many times the joint's."""
    mimics: int | None = None
    """Index of the `ratio` and `shift` to the coordinate that it mimics; None if it is its own."""
    orientation: int | None = None
    """Index of the orientation at coordinate 0 in the parent frame; None for the identity."""
    offset: int | None = None
    """Index of the position at coordinate 0 in the parent frame; None for the origin."""
    body: int | None = None
    """Index of the body it carries; None if there is none."""
    spring: int | None = None
    damper: int | None = None
    rotor: int | None = None
    """Index of its armature; None without a rotor."""
    absolute: bool = False
    """Whether it turns against the axes of the ground and not those of the previous frame."""
    torque: int | None = None
    """Index of a constant torque or force along its coordinate."""
    symmetric: bool = False
    """Whether its whole subtree is rotationally symmetric about its axis: the first derivation then
    does not turn its frame, the second does.
    """
    name: str = ""

    @property
    def slides(self) -> bool:
        """Whether it is prismatic; otherwise it is revolute."""
        return self.kind[0] == "p"

    @property
    def axis(self) -> int:
        """Index of its axis: 0, 1 or 2."""
        return "xyz".index(self.kind[1])


class ConstraintSpec(NamedTuple):
    """A constraint by declaration; the requirements of each `kind` are in `constraint_rows`."""

    kind: str
    name: str
    points: tuple[tuple[int, int], ...] = ()
    """Frames, -1 for the ground, and indices into the `points`."""
    directions: tuple[tuple[int, int], ...] = ()
    """Frames, and indices into the `directions`."""
    coordinates: tuple[int, ...] = ()
    number: int | None = None
    """Index into the `lengths` (radii too), the `couplings`, the `drives` or the `springs`."""
    factor: int | None = None
    """Index into the `factors`, by which its rows are multiplied."""


class Topology(NamedTuple):
    """The topology that all mechanisms of a class share."""

    joints: tuple[ScalarJoint, ...]
    coordinates: tuple[str, ...]
    """Names of the coordinates."""
    planar: bool = False
    """Whether all motion stays in the plane z = 0: third components are then absent."""
    constraints: tuple[ConstraintSpec, ...] = ()
    springs: tuple[ConstraintSpec, ...] = ()
    """Springs between two points, each with an index into the `springs`."""


class RigidSegment(NamedTuple):
    """A part of the path from the ground to a point that turns as one rigid segment."""

    start: int
    """Index of the scalar joint at whose origin it starts."""
    end: int | None
    """Index of the scalar joint at whose origin it ends; None at the point."""
    arm: bool
    """Whether it is a single arm, from one origin to the next."""


class TopologyPlan:
    """Precomputed data that follow from a topology."""

    def __init__(self, topology: Topology):
        self.topology = topology
        self.joints = slots = topology.joints
        self.n = len(topology.coordinates)
        self.d, self.e = (2, 1) if topology.planar else (3, 3)
        carriers = (k for k, slot in enumerate(slots) if slot.body is not None)
        self.carriers = tuple(sorted(carriers, key=lambda k: slots[k].body or 0))
        """Scalar joints of the bodies, in their order."""
        self.rotors = tuple(k for k, slot in enumerate(slots) if slot.rotor is not None)
        self.hinges = tuple(k for k, slot in enumerate(slots) if not slot.slides)
        self.hinge_index = {k: place for place, k in enumerate(self.hinges)}
        """Scalar joint -> index among the hinges."""
        rolling = (c for c in topology.constraints if c.kind in ROLLING)
        self.disks = tuple(dict.fromkeys(x for c in rolling if len(x := c.directions[1:]) == 2))
        """Pairs of an axis and a normal, each a frame and an index into the `directions`."""
        self.disk_index: dict[Any, int] = {pair: place for place, pair in enumerate(self.disks)}
        self.from_ground: list[tuple[int, ...]] = []
        """Scalar joints on the path from the ground to each one, itself the last."""
        for k, slot in enumerate(slots):
            before = self.from_ground[slot.parent] if slot.parent >= 0 else ()
            self.from_ground.append((*before, k))
        self.turned_by: list[tuple[int, ...]] = []
        """Scalar joints that turn the axes of each frame, itself the last."""
        for k in range(len(slots)):
            before = (
                self.turned_by[self.orientation_parent(k)]
                if self.orientation_parent(k) >= 0
                else ()
            )
            self.turned_by.append((*before, k))
        self.movers = tuple(tuple(self._movers(k)) for k in range(len(slots)))
        """Scalar joints that move a point of each frame, hinges with their `RigidSegment`s."""
        self.support = np.zeros((self.bodies, self.n), bool)
        """Mask of the coordinates that can move each body, bool (n_b, n)."""
        for b, k in enumerate(self.carriers):
            self.support[b, [slots[i].coordinate for i, _ in self.movers[k]]] = True
        for b, k in enumerate(self.rotors, len(self.carriers)):
            self.support[b, slots[k].coordinate] = True

    def orientation_parent(self, k: int) -> int:
        """Return the scalar joint against whose frame scalar joint k turns; -1 for the ground."""
        return -1 if self.joints[k].absolute else self.joints[k].parent

    def _movers(self, k: int) -> Iterator[tuple[int, tuple[RigidSegment, ...]]]:
        way = self.from_ground[k]
        # Arm 0, to the first joint, is fixed; arm j > 0 turns with joint j - 1; the last ends in
        # the point.
        turning = [set(self.turned_by[i]) for i in way]
        for i in sorted({*way, *(i for t in turning for i in t)}):
            if self.joints[i].slides:
                if i in way:
                    yield i, ()
                continue
            runs: list[RigidSegment] = []
            for j, turned in enumerate(turning):
                if i in turned:
                    end = way[j + 1] if j + 1 < len(way) else None
                    if runs and runs[-1].end == way[j]:
                        runs[-1] = RigidSegment(runs[-1].start, end, False)
                    else:
                        runs.append(RigidSegment(way[j], end, True))
            yield i, tuple(runs)

    @property
    def bodies(self) -> int:
        """Number of bodies, rotors among them: they come last."""
        return len(self.carriers) + len(self.rotors)

    def path_to(self, k: int) -> tuple[int, ...]:
        """Return the scalar joints between the ground and k, itself the last; none for -1."""
        return self.from_ground[k] if k >= 0 else ()
