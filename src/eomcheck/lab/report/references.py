"""Reference solutions as a table."""

from __future__ import annotations

from collections.abc import Iterable

from eomcheck.console import console
from eomcheck.lab.show.layout import numbers, table, words
from eomcheck.motion.stored import Reference

COLUMNS = (
    "reference",
    "to t, s",
    "uncertainty",
    "energy drift: Taylor",
    "extrapolation",
    "steps: Taylor",
    "extrapolation",
    "seconds: Taylor",
    "extrapolation",
)


def row(reference: Reference) -> tuple[str, ...]:
    """Return the entries of `COLUMNS` for one reference."""
    runs = reference.runs
    return (
        reference.name,
        f"{reference.times[-1]:g}",
        f"{reference.uncertainty:.1g}",
        *("" if run.drift is None else f"{run.drift:.1g}" for run in runs),
        *(str(run.facts["steps"]) for run in runs),
        *(f"{run.facts['seconds']:.0f}" for run in runs),
    )


def print_references(references: Iterable[Reference]) -> None:
    """Print how well each reference is known, and what it took."""
    first, *others = COLUMNS
    console.print(table([*words(first), *numbers(*others)], map(row, references)))
