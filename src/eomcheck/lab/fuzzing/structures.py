"""Structures of random kinds of scenes: drawn by strata, and written down to come back."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from eomcheck.descriptions.random_mechanisms import CONSTRAINTS, Random
from eomcheck.descriptions.random_trees import ROOT, SPACE
from eomcheck.errors import InputError, RefusedError
from eomcheck.lab.fuzzing.families import DECADES, WIDE
from eomcheck.lab.fuzzing.strata import Stratum, strata_of
from eomcheck.mechanics.random_source import FromGenerator
from eomcheck.mechanics.scene import Scene

ATTEMPTS = 100
"""Structures that are tried until one fits together."""

TOGETHER = ("mass",), ("moments", "products"), ("stiffness",), ("damping",), ("armature",)
"""Parameters that are of all magnitudes in `WIDE` cases; those of a group by one factor a body."""


class Topology(NamedTuple):
    """In which ways scenes of a random kind hang together; a stratum of theirs.

    Attributes:
        links: their number, the ground not counted.
        ways: names of properties, and of each the way.
    """

    links: int
    ways: tuple[tuple[str, str], ...]

    @property
    def name(self) -> str:
        """What reports call it."""
        return ", ".join([f"{self.links} links", *(way for _, way in self.ways)])


def strata_of_any(kind: type[Scene], links: Iterable[int]) -> list[Any]:
    """Return the strata of a kind of scene; of a random one they are topologies.

    Trees are told apart by the space and the joint at the root, mechanisms by their constraint.
    """
    if not issubclass(kind, Random):
        return list(strata_of(kind, links))
    found: dict[Topology, None] = {}
    for count in links:
        for entry in kind.topologies(count):
            if CONSTRAINTS in entry:
                each = [((CONSTRAINTS, way),) for way in entry[CONSTRAINTS]]
            else:
                each = [((SPACE, entry[SPACE][0]), (ROOT, entry[ROOT][0]))]
            found |= dict.fromkeys(Topology(count, ways) for ways in each)
    return list(found)


def structure_drawn(
    kind: type[Scene], stratum: Stratum | Topology, random: np.random.Generator
) -> type[Scene]:
    """Return a kind whose scenes are of one structure of a stratum; itself where there is one.

    Raises:
        InputError: none of those that were tried fits together.
    """
    if isinstance(stratum, Stratum):
        return kind
    choices, asked = FromGenerator(random), dict(stratum.ways)
    entries = [
        entry
        for entry in kind.topologies(stratum.links)
        if all(way in entry.get(name, ()) for name, way in asked.items())
    ]
    for _ in range(ATTEMPTS):
        ways = {name: choices.one_of(of) for name, of in choices.one_of(entries).items()} | asked
        try:
            return kind.of_topology(stratum.links, ways, choices)
        except RefusedError:
            continue
    raise InputError(f"{kind.key}: of {ATTEMPTS} structures none fits together, {stratum.name}")


def varied(scene: Any, family: str, random: np.random.Generator) -> Any:
    """Return a scene of the same structure: itself, or with inertias and springs of any magnitude.

    Geometry stays, for others might not close.
    """
    if family != WIDE:
        return scene
    changed = {}
    for names in TOGETHER:
        there = {
            name: np.asarray(x) for name in names if (x := getattr(scene, name, None)) is not None
        }
        count = max((len(np.atleast_1d(x)) for x in there.values()), default=0)
        factors = 10.0 ** random.uniform(-DECADES, DECADES, count)
        for name, x in there.items():
            of = factors[: len(np.atleast_1d(x))]
            changed[name] = (np.atleast_1d(x).T * of).T.reshape(x.shape)
    return scene.changed(**changed)
