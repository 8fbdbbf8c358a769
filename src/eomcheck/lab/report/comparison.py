"""What came of comparing libraries on one robot description: tables of differences, and a file."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path

from eomcheck.console import console
from eomcheck.files import write_text
from eomcheck.lab.comparing import OURS
from eomcheck.lab.comparison import Comparison
from eomcheck.lab.show.cell import Cell
from eomcheck.lab.show.sheet import Sheet
from eomcheck.lab.show.terminal import print_sheets, say
from eomcheck.output import counted

MOST_LINES = 4
"""Of what a library says while it reads a file."""


def library_sheet(found: Comparison) -> Sheet:
    """Return the table of libraries: how far from us they are, where, and why."""
    rows = []
    for i, (key, version) in enumerate(found.versions.items()):
        verdict = Cell(found.verdict(key), "failed" if found.differs(key) else "passed")
        apart = [
            Cell("fault", "failed") if (key, name) in found.faults else _cell(table[0, i + 1])
            for name, table in found.apart.items()
        ]
        rows.append([Cell(version, "name"), *apart, verdict])
    nothing = "-" * len(found.apart)
    rows += [
        [Cell(key, "name"), *nothing, Cell(found.verdict(key), "open")] for key in found.refused
    ]
    size = counted(found.scene.n, "coordinate"), counted(found.states, "state")
    title = f"{found.scene.name}: {', '.join(size)}"
    heads = ["library", *found.apart, "verdict"]
    note = "Largest difference from eomcheck, relative to the largest entry."
    return Sheet("libraries", title, heads, rows, note=note)


def pair_sheets(found: Comparison) -> Iterator[Sheet]:
    """Yield one table for each quantity: libraries by libraries, the largest difference of two."""
    names = [OURS, *found.versions]
    for quantity, table in found.apart.items():
        rows = [
            [Cell(name, "name"), *(_cell(x) if i != j else "" for j, x in enumerate(row))]
            for i, (name, row) in enumerate(zip(names, table, strict=True))
        ]
        yield Sheet(
            quantity, f"{quantity}, each library beside each other", ["library", *names], rows
        )


def sentences(found: Comparison) -> Iterator[str]:
    """Yield what is to be said of each library that differs or gave no answer."""
    for key, version in found.versions.items():
        if found.differs(key):
            where = "; ".join(one.detail for one in found.of(key)) or "where it answers, it agrees"
            why = "; ".join(one.sentence for one in found.why[key]) or "no reason known"
            yield f"{version} differs: {where}. Why: {why}."
            if found.said[key]:
                more = len(found.said[key]) - MOST_LINES
                said = " / ".join(found.said[key][:MOST_LINES])
                yield f"    It said: {said}" + (
                    f" (and {counted(more, 'line')} more)" if more > 0 else ""
                )
    for key, why in found.refused.items():
        yield f"{key} {'was left out' if key in found.missing else 'gave no answer'}: {why}"


def _cell(x: float) -> str:
    return "-" if math.isnan(x) else f"{x:.0e}" if x else "0"


def print_comparison(found: Comparison, pairs: bool = False) -> None:
    """Print how far libraries are from us, and from each other if asked for."""
    print_sheets([library_sheet(found), *(pair_sheets(found) if pairs else ())])
    for said in sentences(found):
        say(said)
    if found.agree:
        console.print("all that answered agree to rounding")


def write_comparison(found: Comparison, path: Path) -> None:
    """Write all that was found as JSON."""
    plain = {
        "scene": found.scene.name,
        "coordinates": list(found.scene.coordinate_names),
        "states": found.states,
        "versions": found.versions,
        "refused": found.refused,
        "libraries": [OURS, *found.versions],
        "apart": {
            name: [[x if math.isfinite(x) else None for x in row] for row in table.tolist()]
            for name, table in found.apart.items()
        },
        "faults": [[*where, what] for where, what in found.faults.items()],
        "findings": [one.as_dict() for one in found.findings.values()],
        "why": {key: [one.sentence for one in why] for key, why in found.why.items()},
        "said": found.said,
    }
    write_text(path, json.dumps(plain, ensure_ascii=False, indent=1) + "\n")
