"""Timings and tolerance measurements as tables and JSON."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from statistics import median
from typing import Any

from eomcheck.console import console
from eomcheck.evaluation.tolerance import C
from eomcheck.lab.run_time import slope
from eomcheck.lab.show.layout import numbers, seconds_text, table, words, write_json
from eomcheck.lab.studies.motion import END, TOLERANCE, MotionTime
from eomcheck.lab.studies.rhs import TRIGONOMETRY, Timing


def print_rhs(records: list[Timing]) -> None:
    """Print medians, their ratio to sines and cosines alone, and the slope of log t over log N."""
    links = sorted({record.links for record in records})
    by_key = {(record.what, record.links): record for record in records}
    columns = (f"N = {n}" if n else records[0].scene for n in links)
    sizes = numbers(*columns, "slope, N >= 100", "making it")
    shown = table([*words("right-hand side"), *sizes], show_lines=True)
    for what in dict.fromkeys(record.what for record in records):
        cells, large, making = [], [], 0.0
        for n in links:
            record = by_key.get((what, n))
            if record is None:
                cells.append("")
                continue
            ratio = record.seconds / by_key[TRIGONOMETRY, n].seconds
            cells.append(f"{seconds_text(record.seconds)}\n[dim]{ratio:.3g} ×[/]")
            making = max(making, record.compile_seconds)
            if n >= 100:
                large.append((n, record.seconds))
        fitted = f"{slope(large):.3f}" if len(large) > 1 else ""
        shown.add_row(what, *cells, fitted, seconds_text(making))
    console.print(shown)
    console.print(
        "Median time of one right-hand side; below it, the ratio to the sines and cosines of the N "
        "angles alone."
    )


def write_records(path: Path, what: str, records: Iterable[Any]) -> None:
    """Write the Records of a study to `path` as JSON; what is not finite becomes null."""
    rows = [{name: _finite(value) for name, value in row.items()} for row in map(asdict, records)]
    write_json(path, {what: rows})


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def print_motions(records: list[MotionTime]) -> None:
    """Print the time of a motion by CyRK and by SciPy, and their ratio."""
    rows = [
        (
            record.formulation,
            seconds_text(record.seconds),
            f"{record.right_hand_sides:,}",
            seconds_text(record.seconds / record.right_hand_sides),
            seconds_text(record.seconds_in_python),
            f"{record.seconds_in_python / record.seconds:.3g}",
        )
        for record in records
    ]
    timed = numbers("CyRK", "right-hand sides", "each", "SciPy", "ratio", no_wrap=True)
    console.print(table([*words("formulation"), *timed], rows))
    console.print(
        f"Best time of {END:g} s of the paper's robot by DOP853, rtol = atol = {TOLERANCE:.0e}, "
        "with the same right-hand side in machine code."
    )


def print_tolerance(ratios: dict[str, list[float]]) -> None:
    """Print median and largest observed / (κ ε scale) per claim beside C."""
    rows = [
        (claim, str(len(values)), f"{median(values):.2g}", f"{max(values):.2g}")
        for claim, values in ratios.items()
    ]
    columns = *words("claim", no_wrap=False), *numbers("findings", "median", "largest")
    console.print(table(columns, rows))
    top = max(max(values) for values in ratios.values())
    console.print(f"observed / (κ ε scale): largest {top:.3g}; the constant C is {C:g}.")
