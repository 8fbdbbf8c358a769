"""What leaving out saves, as a table."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from eomcheck.console import console
from eomcheck.lab.report.operations import grouped
from eomcheck.lab.show.layout import numbers, table, words, write_json
from eomcheck.lab.studies.absent import Saving


def print_savings(savings: Iterable[Saving]) -> None:
    """Print a table per structure: counts and times, with terms absent and with zeros."""
    structures: dict[str, list[Saving]] = {}
    for saving in savings:
        structures.setdefault(saving.structure, []).append(saving)
    console.print(
        "One right-hand side, outside of solves: additions, multiplications and divisions, with "
        "what a scene has not\nleft out, and with explicit zeros in its place.\n"
    )
    for structure, found in structures.items():
        console.print(f"[bold]{escape(structure)}[/], without {', '.join(found[0].absent)}")
        console.print(_table(found), "")


def _table(found: list[Saving]) -> Table:
    timed = ("left out, µs", "zeros, µs") if found[0].seconds is not None else ()
    rows = []
    for saving in found:
        absent, zeros = saving.operations
        times = [f"{1e6 * x:.3g}" for x in saving.seconds or ()]
        counts = map(grouped, (absent, zeros, zeros - absent))
        rows.append((saving.formulation, *counts, *times))
    counted = numbers("left out", "zeros", "saved", *timed)
    return table([*words("formulation", no_wrap=False), *counted], rows)


def write_savings(path: Path, savings: Iterable[Saving]) -> None:
    """Write the Records to `path` as JSON."""
    write_json(path, {"savings": [asdict(saving) for saving in savings]})
