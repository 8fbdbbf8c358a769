"""Comparison with a scene or an engine: each quantity that both have."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from eomcheck.errors import InputError
from eomcheck.testing.answers import Answers, BrokenError
from eomcheck.testing.derived import bias, drift, inertia, why_no_bias
from eomcheck.testing.measured import Measured
from eomcheck.testing.of_answers import axes
from eomcheck.testing.of_terms import proportional
from eomcheck.testing.point import Point
from eomcheck.testing.registry import Blind, Sides, Skipped, claim, has_any

FORCES = ("Q", "gravity", "U", "R")
"""What forces are summed from."""

QUANTITIES: dict[str, tuple[str, Callable[[Point], Measured | None]]] = {
    "M": ("M", inertia),
    "bias": ("bias", bias),
    "forces": ("Q", lambda at: at.forces()),
    "T": ("T", lambda at: at.of("T")),
    "a": ("a", lambda at: at.of("a")),
    "gamma": ("gamma", drift),
    "qdd": ("qdd", lambda at: at.of("qdd")),
}
"""Name -> (what has its shape, how it is had). U is known up to a constant only: forces tell it."""

FOLLOWS = {"M": "T", "bias": "C|M|T", "gamma": "a"}
"""Name -> what it follows from where it is not given."""


def _has(at: Point, name: str) -> bool:
    if name == "forces":
        return any(at.has(one) for one in FORCES)
    return at.has(name)


def _shared(at: Point, theirs: Point, name: str) -> bool:
    """Return whether a quantity is given by both, or by one of them and follows in the other.

    Where both give what it follows from, that is compared, and this would say the same again.
    """
    given = _has(at, name), _has(theirs, name)
    if all(given) or not any(given) or name not in FOLLOWS:
        return all(given)
    sources = FOLLOWS[name]
    other = theirs if given[0] else at
    both = any(at.has(one) and theirs.has(one) for one in sources.split("|"))
    return has_any(other, sources) and not both


def _reference_at(at: Point) -> Point:
    """Return the reference at the same state."""
    assert at.reference is not None
    return Point(Answers(at.reference), at.q, at.v, at.seed)


def check_reference(points: list[Point]) -> None:
    """Raise InputError if the reference has no answer at all to what is compared.

    What it answers in some states, or of some quantities, is compared; the rest is told as not
    looked at. But nothing compared is no pass.
    """
    broken: BrokenError | None = None
    for at in points:
        theirs = _reference_at(at)
        for name, (_, of) in QUANTITIES.items():
            if not _shared(at, theirs, name):
                continue
            try:
                of(theirs)
            except BrokenError as error:
                broken = broken or error
            else:
                return
    if broken is not None:
        assert points[0].reference is not None
        what = f"against = {points[0].reference.name}: it does not answer in any state"
        raise InputError(f"{what}: {broken}")


@claim(
    "reference",
    "each quantity is that of the reference",
    "",
    ("against",),
    blind=(
        Blind("", "a number that all functions share, such as a mass, a length or g", ("against",)),
        Blind(
            "", "a velocity or a load of wrong sign in the derivation", ("against",), derived=True
        ),
    ),
)
def reference(at: Point) -> Iterator[Sides | Skipped]:
    """Each quantity is what the scene or the engine says."""
    assert at.reference is not None
    for name, (shaped, of) in QUANTITIES.items():
        here, theirs = at, _reference_at(at)
        if not _shared(at, theirs, name):
            continue
        if name == "qdd":
            consistent = at.consistent()
            if consistent is None:
                yield Skipped(
                    f"{name} ~ {at.reference.name}", "no consistent state is found nearby"
                )
                continue
            here = consistent
            theirs = Point(theirs.answers, here.q, here.v, at.seed)
        try:
            expected = of(theirs)
        except BrokenError as broken:
            yield Skipped(f"{name} ~ {at.reference.name}", f"the reference breaks: {broken}")
            continue
        found = of(here)
        if found is None or expected is None:
            yield Skipped(
                f"{name} ~ {at.reference.name}", why_no_bias(here if found is None else theirs)
            )
            continue
        yield Sides(
            f"{name} ~ {at.reference.name}", found, expected, axes(at, shaped), proportional
        )
