"""Tables in Markdown, of which nothing is read as markup that is not meant to be."""

from __future__ import annotations

from collections.abc import Iterable

from eomcheck.lab.show.cell import Cell
from eomcheck.output import printable


def escaped(text: str) -> str:
    """Return `text` for a Markdown table, nothing in it read as markup; a name is code."""
    if isinstance(text, Cell) and text.kind == "name":
        name = printable(text)
        return f"`{name}`" if not set(name) & set("`|") else escaped(str(name))
    return "".join(f"\\{c}" if c in "\\`*_{}[]<>|$~" else c for c in printable(text))


def markdown_table(
    columns: Iterable[str], rows: Iterable[Iterable[str]], numbers: Iterable[bool] = ()
) -> str:
    """Return a table in Markdown, whose cells are Markdown already; numbers end at the right."""
    heading = list(columns)
    ends = ["---:" if at_right else "---" for at_right in numbers] or ["---"] * len(heading)
    lines = [heading, ends, *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)
