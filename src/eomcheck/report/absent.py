"""What leaving out saves, as a table."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from eomcheck import __version__
from eomcheck.console import console
from eomcheck.report.operations import grouped
from eomcheck.studies.absent import Saving


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
    timed = found[0].seconds is not None
    table = Table(header_style="bold")
    table.add_column("formulation")
    for name in ("left out", "zeros", "saved", *(("left out, µs", "zeros, µs") if timed else ())):
        table.add_column(name, justify="right")
    for saving in found:
        absent, zeros = saving.operations
        times = [f"{1e6 * x:.3g}" for x in saving.seconds or ()]
        counts = map(grouped, (absent, zeros, zeros - absent))
        table.add_row(saving.formulation, *counts, *times)
    return table


def write_savings(path: Path, savings: Iterable[Saving]) -> None:
    """Write the Records to `path` as JSON."""
    document = {"eomcheck": __version__, "savings": [asdict(saving) for saving in savings]}
    path.write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
