"""Timings and tolerance measurements as tables and JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from statistics import median
from typing import Any

from rich.table import Table

from eomcheck import __version__
from eomcheck.console import console
from eomcheck.studies.motion import END, TOLERANCE, MotionTime
from eomcheck.studies.rhs import TRIGONOMETRY, Timing
from eomcheck.studies.run_time import slope
from eomcheck.tolerance import C


def seconds_text(value: float) -> str:
    """Return a time with its unit."""
    for unit, scale in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if value >= scale:
            return f"{value / scale:.3g} {unit}"
    return f"{value / 1e-9:.3g} ns"


def print_rhs(records: list[Timing]) -> None:
    """Print medians, their ratio to sines and cosines alone, and the slope of log t over log N."""
    links = sorted({record.links for record in records})
    by_key = {(record.what, record.links): record for record in records}
    table = Table(header_style="bold", show_lines=True)
    table.add_column("right-hand side", no_wrap=True)
    for n in links:
        table.add_column(f"N = {n}" if n else records[0].scene, justify="right")
    table.add_column("slope, N >= 100", justify="right")
    table.add_column("compiling", justify="right")
    for what in dict.fromkeys(record.what for record in records):
        cells, large, compiling = [], [], 0.0
        for n in links:
            record = by_key.get((what, n))
            if record is None:
                cells.append("")
                continue
            ratio = record.seconds / by_key[TRIGONOMETRY, n].seconds
            cells.append(f"{seconds_text(record.seconds)}\n[dim]{ratio:.3g} ×[/]")
            compiling = max(compiling, record.compile_seconds)
            if n >= 100:
                large.append((n, record.seconds))
        fitted = f"{slope(large):.3f}" if len(large) > 1 else ""
        table.add_row(what, *cells, fitted, seconds_text(compiling))
    console.print(table)
    console.print(
        "Median time of one right-hand side; below it, the ratio to the sines and cosines of the N "
        "angles alone."
    )


def write_records(path: Path, what: str, records: Iterable[Any]) -> None:
    """Write the Records of a study to `path` as JSON; what is not finite becomes null."""
    rows = [{name: _finite(value) for name, value in row.items()} for row in map(asdict, records)]
    document = {"eomcheck": __version__, what: rows}
    path.write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def print_motions(records: list[MotionTime]) -> None:
    """Print the time of a motion by compiled and by Python integrators, and their ratio."""
    table = Table(header_style="bold")
    table.add_column("formulation", no_wrap=True)
    for name in ("CyRK", "right-hand sides", "each", "SciPy", "ratio"):
        table.add_column(name, justify="right", no_wrap=True)
    for record in records:
        table.add_row(
            record.formulation,
            seconds_text(record.seconds),
            f"{record.right_hand_sides:,}",
            seconds_text(record.seconds / record.right_hand_sides),
            seconds_text(record.seconds_in_python),
            f"{record.seconds_in_python / record.seconds:.3g}",
        )
    console.print(table)
    console.print(
        f"Best time of {END:g} s of the paper's robot by DOP853, rtol = atol = {TOLERANCE:.0e}, "
        "with the same compiled right-hand side."
    )


def print_tolerance(ratios: dict[str, list[float]]) -> None:
    """Print median and largest observed / (κ ε scale) per claim beside C."""
    table = Table(header_style="bold")
    for column in ("claim", "findings", "median", "largest"):
        table.add_column(column, justify="left" if column == "claim" else "right")
    for claim, values in ratios.items():
        table.add_row(claim, str(len(values)), f"{median(values):.2g}", f"{max(values):.2g}")
    console.print(table)
    top = max(max(values) for values in ratios.values())
    console.print(f"observed / (κ ε scale): largest {top:.3g}; the constant C is {C:g}.")
