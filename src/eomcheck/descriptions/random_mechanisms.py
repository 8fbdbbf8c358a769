"""Random mechanisms: scene classes of which every sample has another topology (`RANDOM`)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cache
from typing import Any, Self

import numpy as np

from eomcheck.descriptions.constraint_rows import KINDS
from eomcheck.descriptions.mechanism_class import Mechanism
from eomcheck.descriptions.random_constraints import (
    row_count_with_contact,
    with_random_constraint,
    with_random_pose,
)
from eomcheck.descriptions.random_trees import (
    PLANE,
    SPACE,
    JointBudget,
    RandomDescription,
    joint_budgets,
    levels_of,
    random_tree,
    tree_factors,
)
from eomcheck.errors import InputError, RefusedError, whole_number
from eomcheck.mechanics.records import Range
from eomcheck.mechanics.scene import Choices, Factors, GeneratorChoices, Scene

CONSTRAINTS, MOTION = "constraints", "motion"
NOTHING = "nothing"

MAX_RANDOM_LINKS = 30
"""Largest number of links of a random scene: at six coordinates per link, 200 are allowed."""

PROVED = 3
"""Number of scenes of each number of links that `structures` yields."""


class RandomScene(Mechanism):
    """A mechanism that was sampled together with its description; each has a class of its own.

    All random numbers are in the description, so that its parameters have no sampling ranges.
    """

    has_links = True
    most_links = MAX_RANDOM_LINKS

    @property
    def links(self) -> int:
        """Number of links N, the ground not counted."""
        return len(self.source.description.joints)

    @property
    def name(self) -> str:
        """The key with N."""
        return f"{self.key}[{self.links}]"

    @property
    def structure(self) -> str:
        """The structural variant: name, joints with their parents, constraints, optional terms."""
        description: RandomDescription = self.source.description
        indices = {link.name: str(i) for i, link in enumerate(description.links)}
        joints = " ".join(f"{joint.kind}-{indices[joint.parent]}" for joint in description.joints)
        levels = self.topology
        more = [name for name, way in levels.items() if way in ("present", "oblique", PLANE)]
        return "; ".join(
            [f"{self.name}: {joints}"]
            + [f"{c.kind} {'-'.join(indices[x] for x, _ in c.points)}".strip()
               for c in description.constraints]
            + [", ".join(more)] * bool(more)
        )  # fmt: skip

    @property
    def topology(self) -> dict[str, str]:
        """Levels of its topology, computed from its description; see `topologies`."""
        return levels_of(self.source.description, self.source.topology.planar)

    @classmethod
    def ranges(cls, links: int | None = None) -> dict[str, Range]:
        """Return no sampling ranges."""
        return {}

    @classmethod
    def example(cls) -> Scene:
        """Return the one scene that is always checked first, for every such class."""
        return _example(_base(cls))

    @classmethod
    def structures(cls, links: int | None = None) -> Iterator[Any]:
        """Yield a few scenes with so many links, always the same; no two are alike.

        Raises:
            InputError: there are no scenes with so many links.
        """
        links = checked_links(links)
        random = np.random.default_rng(links)
        variants: set[str] = set()
        choices = GeneratorChoices(random)
        # Entries with more kinds of constraints have more weight.
        entries = [x for x in cls.topologies(links) for _ in x.get(CONSTRAINTS, ("",))]
        while len(variants) < PROVED:
            ways = {name: choices.one_of(o) for name, o in choices.one_of(entries).items()}
            try:
                scene = cls.of_topology(links, ways, choices)()
            except RefusedError:
                continue
            if scene.structure not in variants:
                variants.add(scene.structure)
                yield scene

    @classmethod
    def of_description(cls, description: RandomDescription) -> type[Self]:
        """Return the scene class of a description."""
        source = description.source(_class_name(cls.key))
        return source._replace(base=_base(cls), description=description).scene_class()  # type: ignore


class RandomTree(RandomScene):
    """A random tree of rigid bodies."""

    key = "random-trees"

    @classmethod
    def topologies(cls, links: int | None = None) -> Sequence[Factors]:
        """Return the possible topologies of trees of so many links."""
        links = checked_links(links)
        return [tree_factors(room, links) for room in joint_budgets(links)]

    @classmethod
    def of_topology(
        cls, links: int | None, levels: Mapping[str, str], choices: Choices
    ) -> type[Self]:
        """Return the class of one random tree."""
        return cls.of_description(random_tree(levels, checked_links(links), choices))


class RandomMechanism(RandomScene):
    """A random tree with loops, wheels, couplings or drives, their rows independent."""

    key = "random-mechanisms"

    @property
    def topology(self) -> dict[str, str]:
        """Levels of its topology, the kind of its first constraint among them."""
        first = self.source.description.constraints[:1]
        return super().topology | {CONSTRAINTS: first[0].kind if first else NOTHING}

    @classmethod
    def topologies(cls, links: int | None = None) -> Sequence[Factors]:
        """Return the possible topologies of mechanisms of so many links.

        With a clock-driven constraint the initial state is never one of rest.
        """
        links = checked_links(links)
        factors = []
        for room in joint_budgets(links):
            ways, fitting = tree_factors(room, links), _fitting(room)
            still = tuple(kind for kind in fitting if kind != "drive")
            if still:
                factors.append(ways | {CONSTRAINTS: still})
            if "drive" in fitting:
                factors.append(ways | {CONSTRAINTS: fitting, MOTION: ("moving",)})
        return factors

    @classmethod
    def of_topology(
        cls, links: int | None, levels: Mapping[str, str], choices: Choices
    ) -> type[Self]:
        """Return the class of one random mechanism.

        Raises:
            RefusedError: no independent constraints are found.
        """
        kind, planar = levels[CONSTRAINTS], levels[SPACE] == PLANE
        least = row_count_with_contact(kind, planar) + 1
        turning = kind == "square"
        grown = random_tree(levels, checked_links(links), choices, least, turning=turning)
        grown = with_random_pose(grown, choices)
        closed = with_random_constraint(grown, kind, planar, choices)
        if kind == "drive" or not choices.one_of((False, False, True)):
            return cls.of_description(closed)
        remaining = len(closed.coordinates) - row_count_with_contact(kind, planar)
        among = [
            c
            for c in _kinds(planar)
            if row_count_with_contact(c, planar) < remaining and c != "drive"
        ]
        if among:
            with suppress(RefusedError):  # one constraint is enough
                closed = with_random_constraint(closed, choices.one_of(among), planar, choices)
        return cls.of_description(closed)


def _kinds(planar: bool) -> list[str]:
    return [kind for kind in KINDS if row_count_with_contact(kind, planar) > 0]


def _fitting(room: JointBudget) -> tuple[str, ...]:
    """Return the kinds of constraints that fit in the budget and leave one degree of freedom."""
    planar = room.space == PLANE
    return tuple(
        kind for kind in _kinds(planar) if row_count_with_contact(kind, planar) < room.coordinates
    )


def checked_links(links: object, name: str = "links") -> int:
    """Return a number of links as an int.

    Raises:
        InputError: no random scene has so many.
    """
    number = whole_number(name, links)
    if number > MAX_RANDOM_LINKS:
        raise InputError(
            f"{name} = {number}, expected at most {MAX_RANDOM_LINKS} of a random scene"
        )
    return number


def _class_name(key: str) -> str:
    return "".join(part.capitalize() for part in key.split("-"))


@cache
def _example(kind: type[RandomScene]) -> Scene:
    return next(kind.structures(3))


def _base(kind: type[RandomScene]) -> type[RandomScene]:
    """Return the base class of all scenes of a random class."""
    return next(base for base in kind.__mro__ if "source" not in vars(base))


RANDOM: dict[str, type[Scene]] = {
    kind.key: type(kind.example()) for kind in (RandomTree, RandomMechanism)
}
"""Key -> class of its example, for only such a class has equations."""

__all__ = ["RANDOM", "RandomMechanism", "RandomTree"]
