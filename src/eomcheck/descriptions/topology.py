"""Topology of a mechanism, in whole numbers: slots and closures, the structure without parameters.

A slot is a joint with one coordinate, and the frame that it moves; a closure is a constraint that
names frames and parameters by index. A `TopologyPlan` holds what follows from a `Topology` alone:
which slots are on the way to each frame, and which coordinates move each body.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

ROLLING = frozenset({"touching", "rolling"})
"""Kinds of closures that are about what rolls on a plane."""


class ScalarJoint(NamedTuple):
    """A joint with one coordinate, or one that follows another's: the frame that it moves.

    All numbers but those of `sense` and `kind` are places: of slots, coordinates, parameters.
    """

    parent: int
    """An earlier slot, or -1: the ground."""
    kind: str
    """Slides along ("p") or turns about ("r") an axis of its own frame: "px" ... "rz"."""
    coordinate: int
    sense: int = 1
    """1 or -1: along its axis it is so many times the joint's coordinate."""
    mimics: int | None = None
    """Place of the `ratio` and `shift` by which the joint's follows from it; None if it is that."""
    orientation: int | None = None
    """Orientation of its seat; None where it is that of the frame before."""
    offset: int | None = None
    """Position of its seat; None at the origin of the frame before."""
    body: int | None = None
    """None where it only carries others."""
    spring: int | None = None
    damper: int | None = None
    rotor: int | None = None
    """Its armature."""
    absolute: bool = False
    """Whether it turns against the axes of the ground and not those of the frame before."""
    torque: int | None = None
    """A constant one, or a force, along its coordinate."""
    symmetric: bool = False
    """Whether all that it turns is alike all round its axis: the first derivation does not turn
    its frame then, the second does."""
    name: str = ""

    @property
    def slides(self) -> bool:
        """Whether it is prismatic; otherwise it is revolute."""
        return self.kind[0] == "p"

    @property
    def axis(self) -> int:
        """Which of its axes: 0, 1 or 2."""
        return "xyz".index(self.kind[1])


class ConstraintSpec(NamedTuple):
    """A constraint by declaration; what `kind` asks of the rest is said in `closures`."""

    kind: str
    name: str
    points: tuple[tuple[int, int], ...] = ()
    """Frames, -1 for the ground, and places among the `points`."""
    directions: tuple[tuple[int, int], ...] = ()
    """Frames, and places among the `directions`."""
    coordinates: tuple[int, ...] = ()
    number: int | None = None
    """Place among the `lengths` (radii too), the `couplings`, the `drives` or the `springs`."""
    factor: int | None = None
    """Place among the `factors`: so many times its rows are taken."""


class Topology(NamedTuple):
    """What all mechanisms of a kind have in common."""

    joints: tuple[ScalarJoint, ...]
    coordinates: tuple[str, ...]
    """Their names."""
    planar: bool = False
    """Whether nothing leaves the plane z = 0: then no third component is there."""
    constraints: tuple[ConstraintSpec, ...] = ()
    springs: tuple[ConstraintSpec, ...] = ()
    """Those between two points, each with a place among the `springs`."""


class RigidSegment(NamedTuple):
    """A part of the way from the ground to a point that turns as one."""

    start: int
    """Slot at whose origin it starts."""
    end: int | None
    """Slot at whose origin it ends; None at the point."""
    arm: bool
    """Whether it is a single arm, from one origin to the next."""


class TopologyPlan:
    """What follows from a topology, found once."""

    def __init__(self, topology: Topology):
        self.topology = topology
        self.joints = slots = topology.joints
        self.n = len(topology.coordinates)
        self.d, self.e = (2, 1) if topology.planar else (3, 3)
        carriers = (k for k, slot in enumerate(slots) if slot.body is not None)
        self.carriers = tuple(sorted(carriers, key=lambda k: slots[k].body or 0))
        """The slots of the bodies, in their order."""
        self.rotors = tuple(k for k, slot in enumerate(slots) if slot.rotor is not None)
        self.hinges = tuple(k for k, slot in enumerate(slots) if not slot.slides)
        self.hinge_index = {k: place for place, k in enumerate(self.hinges)}
        """Slot -> place among the hinges."""
        rolling = (one for one in topology.constraints if one.kind in ROLLING)
        self.disks = tuple(dict.fromkeys(x for one in rolling if len(x := one.directions[1:]) == 2))
        """Pairs of an axis and a normal, each a frame and a place among the `directions`."""
        self.disk_index: dict[Any, int] = {pair: place for place, pair in enumerate(self.disks)}
        self.from_ground: list[tuple[int, ...]] = []
        """Slots on the way to each from the ground, itself the last."""
        for k, slot in enumerate(slots):
            before = self.from_ground[slot.parent] if slot.parent >= 0 else ()
            self.from_ground.append((*before, k))
        self.turned_by: list[tuple[int, ...]] = []
        """Slots whose axes turn each of the frames, itself the last."""
        for k in range(len(slots)):
            before = (
                self.turned_by[self.orientation_parent(k)]
                if self.orientation_parent(k) >= 0
                else ()
            )
            self.turned_by.append((*before, k))
        self.movers = tuple(tuple(self._movers(k)) for k in range(len(slots)))
        """Per frame the slots that move a point of it, a hinge with the `RigidSegment`s that it
        turns.
        """
        self.support = np.zeros((self.bodies, self.n), bool)
        """Which coordinates can move each body."""
        for b, k in enumerate(self.carriers):
            self.support[b, [slots[i].coordinate for i, _ in self.movers[k]]] = True
        for b, k in enumerate(self.rotors, len(self.carriers)):
            self.support[b, slots[k].coordinate] = True

    def orientation_parent(self, k: int) -> int:
        """Return the slot against whose frame slot k turns; -1 for the ground."""
        return -1 if self.joints[k].absolute else self.joints[k].parent

    def _movers(self, k: int) -> Iterator[tuple[int, tuple[RigidSegment, ...]]]:
        way = self.from_ground[k]
        # The arm to the first slot stays; arm j > 0 turns with slot j - 1, the last is the point's.
        turning = [set(self.turned_by[i]) for i in way]
        for i in sorted({*way, *(i for some in turning for i in some)}):
            if self.joints[i].slides:
                if i in way:
                    yield i, ()
                continue
            runs: list[RigidSegment] = []
            for j, some in enumerate(turning):
                if i in some:
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
        """Return the slots between the ground and slot k, itself the last; none for -1."""
        return self.from_ground[k] if k >= 0 else ()
