"""A table as data, which goes to a terminal of any width, to Markdown, HTML and CSV."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Sequence
from io import StringIO
from typing import NamedTuple

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.padding import Padding
from rich.table import Column, Table
from rich.text import Text

from eomcheck.console import console

_NUMBER = re.compile(r"[<>~≤+−-]?(\d|∞|inf|nan|never)")


class Sheet(NamedTuple):
    """A table.

    Attributes:
        name: that of its file and its anchor.
        title: what it shows.
        columns: headings.
        rows: cells of text, one a column.
        widths: of the columns to each other, where they hold sentences.
        note: a sentence below it.
        detail: whether only a terminal shows it, beside a table that says the same in short.
    """

    name: str
    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    widths: Sequence[int] = ()
    note: str = ""
    detail: bool = False

    def of_numbers(self, column: int) -> bool:
        """Return whether all that stands in a column are numbers, which end at the right."""
        cells = [row[column] for row in self.rows if row[column] not in ("", "-", "·")]
        return bool(cells) and all(_NUMBER.match(cell) for cell in cells)

    def markdown(self) -> str:
        """Return the table in Markdown."""
        lines = [self.columns, ["---"] * len(self.columns), *self.rows]
        return "".join(f"| {' | '.join(line)} |\n" for line in lines)

    def csv(self) -> str:
        """Return the table as comma-separated values (RFC 4180)."""
        text = StringIO(newline="")
        csv.writer(text).writerows([self.columns, *self.rows])
        return text.getvalue()

    def text(self, width: int) -> RenderableType:
        """Return the table for a terminal of so many columns.

        Where it does not fit, words wrap, and where they do not fit either, each row becomes a
        list of its cells, one a line.
        """
        if self.widths:
            return self._sentences() if width >= 100 else self._listed()
        widths = self._fitted(width - 3 * len(self.columns) - 1)
        if widths is None:
            return self._listed()
        table = Table(header_style="bold")
        for i, head in enumerate(self.columns):
            end = "right" if self.of_numbers(i) else "left"
            table.add_column(escape(head), justify=end, width=widths[i])
        for row in self.rows:
            table.add_row(*map(escape, row))
        return table

    def _fitted(self, room: int) -> list[int] | None:
        """Return the widths of the columns in so much room, the widest ones narrowed; or None."""
        least = [self._least(i) for i in range(len(self.columns))]
        if sum(least) > room:
            return None
        widths = [max(map(len, column)) for column in zip(self.columns, *self.rows, strict=True)]
        while sum(widths) > room:
            wide = max((i for i, w in enumerate(widths) if w > least[i]), key=widths.__getitem__)
            widths[wide] -= 1
        return widths

    def _least(self, column: int) -> int:
        """Return the width that a column needs: that of its longest word, or its longest number."""
        cells = [row[column] for row in self.rows]
        whole, words = (cells, []) if self.of_numbers(column) else ([], cells)
        apart = [word for text in (self.columns[column], *words) for word in text.split()]
        return max(map(len, (*whole, *apart)), default=0)

    def _sentences(self) -> Table:
        columns = [
            Column(escape(head), ratio=share)
            for head, share in zip(self.columns, self.widths, strict=True)
        ]
        table = Table(*columns, header_style="bold", show_lines=True, expand=True)
        for row in self.rows:
            table.add_row(*map(escape, row))
        return table

    def _listed(self) -> Group:
        first, *heads = self.columns
        lines: list[RenderableType] = []
        for name, *cells in self.rows:
            lines.append(Text(f"{first} {name}".strip(), style="bold"))
            told = [(head, cell) for head, cell in zip(heads, cells, strict=True) if cell]
            texts = (Text(f"{head}: {cell}" if head else cell) for head, cell in told)
            lines += [Padding(text, (0, 0, 0, 2), expand=False) for text in texts]
        return Group(*lines)


def print_sheets(sheets: Iterable[Sheet]) -> None:
    """Print tables below each other, with their titles and notes."""
    for sheet in sheets:
        console.print(f"\n[bold]{escape(sheet.title)}[/]")
        if sheet.rows:
            console.print(sheet.text(console.width))
        if sheet.note:
            console.print(escape(sheet.note), soft_wrap=True, highlight=False)
