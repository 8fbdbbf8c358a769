"""Certified digits as a table."""

from __future__ import annotations

import math
from collections.abc import Iterable
from statistics import median

from rich.table import Table

from eomcheck.console import console
from eomcheck.studies.accuracy import Delivered
from eomcheck.tolerance import C


def digits_table(digits: dict[str, list[float]]) -> Table:
    """Return fewest and median certified digits of v̇ per formulation."""
    table = Table(header_style="bold")
    table.add_column("formulation", no_wrap=True)
    for name in ("states solved", "certified digits: fewest", "median"):
        table.add_column(name, justify="right", no_wrap=True)
    for key, values in digits.items():
        table.add_row(key, str(len(values)), f"{min(values):.1f}", f"{median(values):.1f}")
    return table


def print_accuracy(records: Iterable[Delivered]) -> None:
    """Print, per formulation, what doubles delivered, and what the constant C rests on."""
    table = Table(header_style="bold")
    table.add_column("formulation", no_wrap=True)
    for name in (
        "solved",
        "refused",
        "κ infinite",
        "certified digits: fewest",
        "median",
        "ulps: median",
        "condition: median",
        "largest",
        "error / (κ ε scale): median",
        "largest",
    ):
        table.add_column(name, justify="right")
    top = 0.0
    records = list(records)
    moving = [r for r in records if r.refused is not None or r.relative != 0.0]
    exact = len(records) - len(moving)
    keys = tuple(dict.fromkeys(r.key for r in records))
    for key in keys:
        mine = [r for r in moving if r.key == key]
        solved = [r for r in mine if r.refused is None]
        if not solved:
            table.add_row(key, "0", str(len(mine)))
            continue
        foreseen = [r.ratio for r in solved if not math.isnan(r.ratio)]
        top = max(top, *foreseen) if foreseen else top
        table.add_row(
            key,
            str(len(solved)),
            str(len(mine) - len(solved)),
            str(len(solved) - len(foreseen)),
            f"{min(r.digits for r in solved):.1f}",
            f"{median(r.digits for r in solved):.1f}",
            f"{median(r.ulps for r in solved):.2g}",
            f"{median(r.condition for r in solved):.2g}",
            f"{max(r.condition for r in solved):.2g}",
            f"{median(foreseen):.2g}" if foreseen else "",
            f"{max(foreseen):.2g}" if foreseen else "",
        )
    states = len(records) // max(len(keys), 1)
    console.print(table)
    console.print(
        f"{states} states; errors against the enclosed truth. {exact} results that are "
        "exact, as at rest without forces, are left out; where κ is infinite no error is foreseen. "
        f"Largest error / (κ ε scale): {top:.3g}; the constant C of the tolerances is {C:g}."
    )
