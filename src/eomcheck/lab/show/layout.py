"""What tables, figures and files look like: headings, columns, legends, Markdown, JSON."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.table import Column, Table

from eomcheck import __version__


def words(*names: str, no_wrap: bool = True) -> list[Column]:
    """Return columns of words, which begin at the left."""
    return [Column(name, no_wrap=no_wrap) for name in names]


def numbers(*names: str, no_wrap: bool = False) -> list[Column]:
    """Return columns of numbers, which end at the right."""
    return [Column(name, justify="right", no_wrap=no_wrap) for name in names]


def table(columns: Iterable[Column], rows: Iterable[Iterable[str]] = (), **options: Any) -> Table:
    """Return a table of columns with these rows, to which others can be added.

    Args:
        columns: made by `words` and `numbers`.
        rows: one cell a column, or fewer.
        options: those of `rich.table.Table`.
    """
    made = Table(*columns, header_style="bold", **options)
    for row in rows:
        made.add_row(*row)
    return made


def seconds_text(value: float) -> str:
    """Return a time with its unit."""
    for unit, scale in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if value >= scale:
            return f"{value / scale:.3g} {unit}"
    return f"{value / 1e-9:.3g} ns"


def grouped(value: int) -> str:
    """Return a whole number with its digits in groups of three."""
    return f"{value:,}".replace(",", " ")


def write_markdown_table(path: Path, rows: Sequence[Sequence[str]]) -> None:
    """Write a table in Markdown, its first row being the heading."""
    heading, *others = rows
    lines = [heading, ["---"] * len(heading), *others]
    path.write_text("".join(f"| {' | '.join(line)} |\n" for line in lines), encoding="utf-8")


def write_json(path: Path, document: Mapping[str, Any]) -> None:
    """Write a document as JSON, with the version that made it."""
    text = json.dumps({"eomcheck": __version__, **document}, indent=1, ensure_ascii=False)
    path.write_text(text + "\n", encoding="utf-8")
