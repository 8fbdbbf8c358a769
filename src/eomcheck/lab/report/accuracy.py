"""Certified digits as a table."""

from __future__ import annotations

import math
from collections.abc import Iterable
from statistics import median

from rich.table import Table

from eomcheck.console import console
from eomcheck.evaluation.tolerance import C
from eomcheck.lab.show.layout import numbers, table, words
from eomcheck.lab.studies.accuracy import Delivered


def digits_table(digits: dict[str, list[float]]) -> Table:
    """Return fewest and median certified digits of v̇ per formulation."""
    said = numbers("states solved", "certified digits: fewest", "median", no_wrap=True)
    rows = [
        (key, str(len(values)), f"{min(values):.1f}", f"{median(values):.1f}")
        for key, values in digits.items()
    ]
    return table([*words("formulation"), *said], rows)


def print_accuracy(records: Iterable[Delivered]) -> None:
    """Print, per formulation, what doubles delivered, and what the constant C rests on."""
    counts = numbers("solved", "refused", "κ infinite")
    digits = numbers("certified digits: fewest", "median", "ulps: median")
    ratios = numbers("condition: median", "largest", "error / (κ ε scale): median", "largest")
    bounds = numbers("largest error / bound", "in machine code", "no number")
    shown = table([*words("formulation"), *counts, *digits, *ratios, *bounds])
    top = 0.0
    records = list(records)
    moving = [r for r in records if r.refused is not None or r.relative != 0.0]
    exact = len(records) - len(moving)
    keys = tuple(dict.fromkeys(r.key for r in records))
    for key in keys:
        mine = [r for r in moving if r.key == key]
        solved = [r for r in mine if r.refused is None]
        if not solved:
            shown.add_row(key, "0", str(len(mine)))
            continue
        foreseen = [r.ratio for r in solved if not math.isnan(r.ratio)]
        top = max(top, *foreseen) if foreseen else top
        shown.add_row(
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
            f"{max(r.of_bound for r in solved):.2g}",
            f"{max(r.machine_of_bound for r in solved if not math.isnan(r.machine_of_bound)):.2g}",
            str(sum(math.isnan(r.machine_of_bound) for r in solved)),
        )
    states = len(records) // max(len(keys), 1)
    console.print(shown)
    console.print(
        f"{states} states; errors against the enclosed truth. {exact} results that are "
        "exact, as at rest without forces, are left out; where κ is infinite no error is foreseen. "
        f"Largest error / (κ ε scale): {top:.3g}; the constant C of the tolerances is {C:g}."
    )
    for record in records:
        if record.state:
            console.print(f"beyond its bound: {record.key}, {record.state}", highlight=False)
