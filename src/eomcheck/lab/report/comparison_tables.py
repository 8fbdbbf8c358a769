"""Tables of a comparison of libraries on one robot description, and its JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path

from eomcheck.atomic_write import write_text
from eomcheck.claims.finding import unresolved_finding
from eomcheck.console import console
from eomcheck.lab.library_comparison import QUANTITIES, REFERENCE_NAME, LibraryComparison
from eomcheck.lab.show.table import Cell, ResultTable, print_tables, say
from eomcheck.safe_output import counted

NOBODY = (
    "The two derivations of eomcheck agree in these states, but share one reading of the file: "
    "either reading may be wrong."
)

MOST_LINES = 4
"""Largest number of lines quoted of a library's messages on reading a file."""


def library_table(found: LibraryComparison) -> ResultTable:
    """Return the table of libraries: their largest differences from eomcheck, and the verdict."""
    rows = []
    for i, (key, version) in enumerate(found.versions.items()):
        good = "open" if key in found.undecided_libraries else "passed"
        verdict = Cell(found.verdict(key), "failed" if found.differs(key) else good)
        apart = [
            Cell("fault", "failed") if (key, name) in found.faults else _cell(table[0, i + 1])
            for name, table in found.differences.items()
        ]
        rows.append([Cell(version, "name"), *apart, verdict])
    nothing = "-" * len(found.differences)
    rows += [
        [Cell(key, "name"), *nothing, Cell(found.verdict(key), "open")] for key in found.refused
    ]
    size = counted(found.scene.n, "coordinate"), counted(found.states, "state")
    title = f"{found.scene.name}: {', '.join(size)}"
    heads = ["library", *found.differences, "verdict"]
    note = (
        "Largest difference from eomcheck, relative to the largest entry; where entries cancel to "
        "less than a thousandth of the terms that they are summed from, to these."
    )
    return ResultTable("libraries", title, heads, rows, note=note)


def pair_tables(found: LibraryComparison) -> Iterator[ResultTable]:
    """Yield one table per quantity: libraries × libraries, their largest difference."""
    names = [REFERENCE_NAME, *found.versions]
    for quantity, table in found.differences.items():
        rows = [
            [Cell(name, "name"), *(_cell(x) if i != j else "" for j, x in enumerate(row))]
            for i, (name, row) in enumerate(zip(names, table, strict=True))
        ]
        yield ResultTable(
            quantity, f"{quantity}, each library beside each other", ["library", *names], rows
        )


def sentences(found: LibraryComparison) -> Iterator[str]:
    """Yield sentences on each library that differs or gave no answer."""
    for key, version in found.versions.items():
        if found.differs(key):
            where = (
                "; ".join(one.detail for one in found.failures_of(key))
                or "where it answers, it agrees"
            )
            why = "; ".join(one.sentence for one in found.explanations[key]) or "no reason known"
            yield f"{version} differs: {where}. Why: {why}."
            if found.messages[key]:
                more = len(found.messages[key]) - MOST_LINES
                quoted = " / ".join(found.messages[key][:MOST_LINES])
                yield f"    It said: {quoted}" + (
                    f" (and {counted(more, 'line')} more)" if more > 0 else ""
                )
    for (key, claim), left in found.unresolved_entries.items():
        yield f"{found.versions[key]}: {claim} is {unresolved_finding(left).detail}"
    if found.self_failures:
        worst = max(found.self_failures, key=lambda one: one.ratio)
        yield f"The two derivations of eomcheck differ from each other: {worst.detail}"
    elif found.failed:
        yield NOBODY
    alike: dict[tuple[str, int], list[str]] = {}
    for (key, method), count in found.inconclusive_counts.items():
        alike.setdefault((method, count), []).append(key)
    for (method, count), keys in alike.items():
        names = " and ".join(name for name, asks in QUANTITIES.items() if asks == method)
        where = f"inconclusive in {count} of {counted(found.states, 'state')}"
        yield f"{names} of {', '.join(keys)}: {where}, rounding explains any difference there"
    if found.skipped:
        where = f"{len(found.skipped)} of {counted(found.states, 'state')}"
        yield f"q̈ is not compared in {where}: {found.skipped[0]}"
    for key, why in found.refused.items():
        yield f"{key} {'was left out' if key in found.missing else 'gave no answer'}: {why}"


def _cell(x: float) -> str:
    return "-" if math.isnan(x) else f"{x:.0e}" if x else "0"


def print_comparison(found: LibraryComparison, pairs: bool = False) -> None:
    """Print the differences of libraries from eomcheck and, on demand, from each other."""
    print_tables([library_table(found), *(pair_tables(found) if pairs else ())])
    for sentence in sentences(found):
        say(sentence)
    if found.agree:
        caveats = (
            [f"{', '.join(found.undecided_libraries)} undecided"]
            if found.undecided_libraries
            else []
        )
        caveats += ["without q̈"] if len(found.skipped) >= found.states else []
        who = "all others" if found.undecided_libraries else "all that answered"
        where = " where decided" if any(map(found.undecided_claims, found.versions)) else ""
        console.print(", ".join([f"{who} agree to rounding{where}", *caveats]))


def write_comparison(found: LibraryComparison, path: Path) -> None:
    """Write the whole comparison as JSON."""
    plain = {
        "scene": found.scene.name,
        "coordinates": list(found.scene.coordinate_names),
        "states": found.states,
        "versions": found.versions,
        "refused": found.refused,
        "libraries": [REFERENCE_NAME, *found.versions],
        "apart": {
            name: [[x if math.isfinite(x) else None for x in row] for row in table.tolist()]
            for name, table in found.differences.items()
        },
        "decided": {key: key not in found.undecided_libraries for key in found.versions},
        "faults": [[*where, what] for where, what in found.faults.items()],
        "findings": [one.as_dict() for one in found.findings.values()],
        "why": {key: [one.sentence for one in why] for key, why in found.explanations.items()},
        "said": found.messages,
        "hidden": [
            [*where, unresolved_finding(left).detail]
            for where, left in found.unresolved_entries.items()
        ],
        "skipped": found.skipped,
        "own": [one.as_dict() for one in found.self_failures],
    }
    write_text(path, json.dumps(plain, ensure_ascii=False, indent=1) + "\n")
