"""How a mechanism hangs together, in whole numbers: what of it is structure and no parameter."""

from __future__ import annotations

from typing import NamedTuple


class Slot(NamedTuple):
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
    follows: int | None = None
    """Place of the `ratio` and `shift` by which the joint's follows from it; None if it is that."""
    turn: int | None = None
    """Orientation of its seat; None where it is that of the frame before."""
    offset: int | None = None
    """Position of its seat; None at the origin of the frame before."""
    body: int | None = None
    """None where it only carries others."""
    spring: int | None = None
    damper: int | None = None
    rotor: int | None = None
    """Its armature."""
    name: str = ""

    @property
    def slides(self) -> bool:
        """Whether it is prismatic; otherwise it is revolute."""
        return self.kind[0] == "p"

    @property
    def axis(self) -> int:
        """Which of its axes: 0, 1 or 2."""
        return "xyz".index(self.kind[1])


class Closure(NamedTuple):
    """A constraint by declaration; what `kind` asks of the rest is said in `closures`."""

    kind: str
    name: str
    points: tuple[tuple[int, int], ...] = ()
    """Frames, -1 for the ground, and places among the `points`."""
    directions: tuple[tuple[int, int], ...] = ()
    """Frames, and places among the `directions`."""
    coordinates: tuple[int, ...] = ()
    number: int | None = None
    """Place among the `lengths`, the `couplings` or the `drives`."""


class Topology(NamedTuple):
    """What all mechanisms of a kind have in common."""

    slots: tuple[Slot, ...]
    coordinates: tuple[str, ...]
    """Their names."""
    planar: bool = False
    """Whether nothing leaves the plane z = 0: then no third component is there."""
    closures: tuple[Closure, ...] = ()


class Plan:
    """What follows from a topology, found once."""

    def __init__(self, topology: Topology):
        self.topology = topology
        self.slots = slots = topology.slots
        self.n = len(topology.coordinates)
        self.d, self.e = (2, 1) if topology.planar else (3, 3)
        self.carriers = tuple(k for k, slot in enumerate(slots) if slot.body is not None)
        """The slots of the bodies, in their order."""
        self.rotors = tuple(k for k, slot in enumerate(slots) if slot.rotor is not None)
        self.hinges = tuple(k for k, slot in enumerate(slots) if not slot.slides)
        self.hinge = {k: place for place, k in enumerate(self.hinges)}
        """Slot -> place among the hinges."""
        self.from_ground: list[tuple[int, ...]] = []
        """Slots on the way to each from the ground, itself the last."""
        for k, slot in enumerate(slots):
            before = self.from_ground[slot.parent] if slot.parent >= 0 else ()
            self.from_ground.append((*before, k))

    @property
    def bodies(self) -> int:
        """Number of bodies, rotors among them: they come last."""
        return len(self.carriers) + len(self.rotors)

    def on_the_way(self, k: int) -> tuple[int, ...]:
        """Return the slots between the ground and slot k, itself the last; none for -1."""
        return self.from_ground[k] if k >= 0 else ()
