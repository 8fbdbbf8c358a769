"""What states were looked at, and the digits that are right in them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from statistics import median

from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.show.table import Sheet
from eomcheck.lab.store.groups import group
from eomcheck.lab.store.kept import Kept
from eomcheck.safe_output import counted


def digits_sheet(rows: Iterable[Kept]) -> Sheet:
    """Return the certified digits of v̇ of each formulation on each scene: fewest and median."""
    certified = group([row for row in rows if row.digits is not None], lambda row: row.subject)
    scenes = list(dict.fromkeys(row.scene for found in certified.values() for row in found))
    made = []
    for key in (key for key in FORMULATIONS if key in certified):
        on = group(certified[key], lambda row: row.scene)
        cells = (_digits([row.digits or 0.0 for row in on.get(scene, [])]) for scene in scenes)
        made.append((key, str(len(certified[key])), *cells))
    title = "Decimal digits of q̈ in doubles that are right, against its true value: fewest (median)"
    return Sheet("digits", title, ("formulation", "states solved", *scenes), made)


def _digits(digits: list[float]) -> str:
    return f"{min(digits):.1f} ({median(digits):.1f})" if digits else "·"


def strata_sheet(strata: Mapping[str, Mapping[str, Mapping[str, int]]]) -> Sheet:
    """Return the strata that were drawn from.

    Args:
        strata: key of a kind of scene -> name of a stratum -> way -> number of states.
    """
    rows = [
        (scene, name, ", ".join(_ways(ways)))
        for scene, of in strata.items()
        for name, ways in of.items()
    ]
    return Sheet("strata", "Drawn states by stratum", ("scene", "stratum", "states"), rows)


def _ways(ways: Mapping[str, int]) -> Iterator[str]:
    """Yield each way with its states in brackets, the first time with the word for them."""
    for i, (way, states) in enumerate(ways.items()):
        yield f"{way} ({states if i else counted(states, 'state')})"
