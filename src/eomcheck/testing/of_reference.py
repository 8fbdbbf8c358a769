"""Comparison with a scene or an engine: each quantity that both have."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from eomcheck.testing.answers import Answers, BrokenError
from eomcheck.testing.measured import Measured
from eomcheck.testing.of_answers import axes
from eomcheck.testing.of_terms import proportional
from eomcheck.testing.point import Point
from eomcheck.testing.registry import Blind, Sides, Skipped, claim

FORCES = ("Q", "gravity", "U", "R")
"""What forces are summed from."""

QUANTITIES: dict[str, tuple[str, Callable[[Point], Measured]]] = {
    "M": ("M", lambda at: at.of("M")),
    "bias": ("bias", lambda at: at.B()),
    "forces": ("Q", lambda at: at.forces()),
    "T": ("T", lambda at: at.of("T")),
    "a": ("a", lambda at: at.of("a")),
    "gamma": ("gamma", lambda at: at.of("gamma")),
    "qdd": ("qdd", lambda at: at.of("qdd")),
}
"""Name -> (what has its shape, how it is had). U is known up to a constant only: forces tell it."""


def _has(at: Point, name: str) -> bool:
    if name == "forces":
        return any(at.has(one) for one in FORCES)
    return at.has(name)


@claim(
    "reference",
    "each quantity is that of the reference",
    "",
    ("against",),
    blind=(
        Blind("", "a number that all functions share, such as a mass, a length or g", ("against",)),
    ),
)
def reference(at: Point) -> Iterator[Sides | Skipped]:
    """Each quantity is what the scene or the engine says."""
    assert at.reference is not None
    other = Answers(at.reference)
    for name, (shaped, of) in QUANTITIES.items():
        theirs = Point(other, at.q, at.v, at.seed)
        here = at
        if not _has(at, name) or not _has(theirs, name):
            continue
        if name == "qdd":
            consistent = at.consistent()
            if consistent is None:
                yield Skipped(
                    f"{name} ~ {at.reference.name}", "no consistent state is found nearby"
                )
                continue
            here, theirs = consistent, Point(other, consistent.q, consistent.v, at.seed)
        try:
            expected = of(theirs)
        except BrokenError as broken:
            yield Skipped(f"{name} ~ {at.reference.name}", f"the reference breaks: {broken}")
            continue
        found = of(here)
        yield Sides(
            f"{name} ~ {at.reference.name}", found, expected, axes(at, shaped), proportional
        )
