"""Table of Records, one line each, in plain columns."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import fields
from typing import Any

from eomcheck.lab.show.table import ResultTable
from eomcheck.lab.store.record_file import Record

GROUPS = ("settings", "counts", "errors", "series", "machine", "versions")
"""Fields of Record that are dictionaries: one column per entry, such as `errors.energy`."""


def _flat(record: Record) -> dict[str, Any]:
    row: dict[str, Any] = {}
    for name in (field.name for field in fields(Record)):
        value = getattr(record, name)
        if name in GROUPS:
            row |= {f"{name}.{entry}": value[entry] for entry in sorted(value)}
        elif name == "quartiles":
            row["quartiles.low"], row["quartiles.high"] = value or (None, None)
        else:
            row[name] = value
    return row


def record_columns(records: Sequence[Record]) -> list[str]:
    """Return the column names of a table, in the order of Record's fields, entries sorted in
    each.
    """
    order = [field.name for field in fields(Record)]
    names = dict.fromkeys(name for record in records for name in _flat(record))

    def rank(name: str) -> tuple[int, str]:
        group, _, entry = name.partition(".")
        return order.index(group), "" if group == "quartiles" else entry

    return sorted(names, key=rank)


def _cell(value: Any) -> str:
    match value:
        case None:
            return ""
        case str():
            return value
        case float():
            return repr(value)  # the shortest text that parses to the same float64
        case _:
            return json.dumps(value, ensure_ascii=False)


def record_table(records: Sequence[Record]) -> ResultTable:
    """Return a table with one line per Record; missing entries are empty."""
    names = record_columns(records)
    rows = [[_cell(row.get(name)) for name in names] for row in map(_flat, records)]
    return ResultTable("records", "", names, rows)
