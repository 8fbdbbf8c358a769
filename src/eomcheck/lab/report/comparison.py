"""What came of comparing libraries on one robot description: tables of differences, and a file."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path

from eomcheck.console import console
from eomcheck.files import write_text
from eomcheck.lab.comparing import OURS, Comparison
from eomcheck.lab.show.sheet import Cell, Sheet, print_sheets, say


def difference_sheets(found: Comparison) -> Iterator[Sheet]:
    """Yield one table for each quantity: libraries by libraries, the largest difference of two."""
    names = [OURS, *found.versions]
    for quantity, table in found.apart.items():
        rows = [
            [Cell(name, "name"), *(_cell(x) if i != j else "" for j, x in enumerate(row))]
            for i, (name, row) in enumerate(zip(names, table, strict=True))
        ]
        title = f"{quantity}: largest difference, relative to the largest entry"
        yield Sheet(quantity, title, ["", *names], rows)
    rows = []
    for key, version in found.versions.items():
        failed = [one for (k, _), one in found.findings.items() if k == key and one.verdict == "failed"]
        verdict = Cell("differs", "failed") if failed else Cell("agrees", "passed")
        where = "; ".join(f"{one.claim}: {one.detail}" for one in failed)
        why = "; ".join(found.why.get(key, []))
        rows.append([Cell(version, "name"), verdict, where, why])
    for key, why in found.refused.items():
        rows.append([Cell(key, "name"), Cell("no answer", "open"), "", why])
    title = f"{found.scene.name}: {found.scene.n} coordinates, {found.states} states"
    heads = ["library", "verdict", "where", "why, as far as known"]
    yield Sheet("libraries", title, heads, rows, widths=(3, 2, 6, 6))


def _cell(x: float) -> str:
    return "-" if math.isnan(x) else f"{x:.0e}" if x else "0"


def print_comparison(found: Comparison) -> None:
    """Print the tables."""
    print_sheets(difference_sheets(found))
    failed = sorted({key for (key, _), one in found.findings.items() if one.verdict == "failed"})
    if failed:
        say(f"{', '.join(failed)}: different equations of motion from one file")
    else:
        console.print("all that answer agree to rounding")


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
        "findings": [one.as_dict() for one in found.findings.values()],
        "why": found.why,
    }
    write_text(path, json.dumps(plain, ensure_ascii=False, indent=1) + "\n")
