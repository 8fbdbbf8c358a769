"""What is to be proved: structures of scenes, by numbers of links."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from eomcheck.errors import MOST_COUNTED, whole_number
from eomcheck.formulations import formulations_among
from eomcheck.mechanics.scene import Scene
from eomcheck.scene_lookup import ALL, kinds_of

LINKS = (*range(1, 13), 20, 50, 100)
"""Numbers of links that are proved by default."""


@dataclass(frozen=True)
class ProofJobs:
    """What is to be proved, and how.

    Attributes:
        scenes: one per structure.
        formulations: keys; a scene is proved by those of them that apply to it.
        points: random points per identity.
        seed: of the draws, or None for one by the operating system.
    """

    scenes: tuple[Scene, ...]
    formulations: tuple[str, ...]
    points: int
    seed: int | None


def proof_jobs(
    scene: str,
    links: Iterable[int] | None,
    points: int,
    seed: int | None,
    formulations: Iterable[str] | None,
) -> ProofJobs:
    """Return the jobs for the kinds of scenes that `scene` stands for.

    Args:
        scene: a name, see `eomcheck.scene_lookup.kinds_of`.
        links: numbers of links, for kinds that have one; by default `LINKS`.
        points: random points per identity.
        seed: of the draws, or None for one by the operating system.
        formulations: keys, by default all that apply.

    Raises:
        InputError: `points` below 1, no such number of links, or a formulation that does not apply.
        UnknownNameError: no such scene or formulation.
    """
    kinds = kinds_of(scene)
    points = whole_number("points", points, most=MOST_COUNTED)
    chosen = tuple(formulation.key for formulation in formulations_among(kinds, formulations))
    scenes = tuple(
        one
        for kind in kinds
        for count in numbers_of_links(kind, links, scene)
        for one in kind.structures(count)
    )
    return ProofJobs(scenes, chosen, points, seed)


def numbers_of_links(
    kind: type[Scene], links: Iterable[int] | None, name: str
) -> Iterable[int | None]:
    """Return the numbers of links to look at; None, and no number, for a kind that has none.

    Raises:
        InputError: `links` are given for a scene, called by its `name`, that has none.
    """
    if kind.has_links:
        most = kind.most_links
        few = [count for count in LINKS if most is None or count <= most]
        return few if links is None else links
    return (None,) if links is None or name == ALL else links
