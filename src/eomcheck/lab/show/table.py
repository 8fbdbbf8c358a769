"""Tables as data, and their text; text of documents: numbers with units, JSON files, templates.

A `ResultTable` is a table: headings and rows of cells, no layout. A `Cell` is a string that also
carries its kind ("name", or the verdict "passed", "failed", "open", "none"), a link and a tooltip,
for those outputs that can show them (HTML pages are filled in from the same data). Markdown escapes
all text but intended markup. On a terminal, columns that do not fit wrap; where they cannot, each
row becomes a list of its cells.

The jinja2 templates are those of `eomcheck.lab.report`; HTML is escaped, Markdown is not. jinja2
comes with the extra `report` and is imported when a template is first filled in.
"""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from rich.cells import cell_len
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.padding import Padding
from rich.table import Column, Table
from rich.text import Text

from eomcheck import __version__
from eomcheck.atomic_write import write_text
from eomcheck.console import WIDTH_KNOWN, console
from eomcheck.errors import required
from eomcheck.safe_output import printable, without_control_characters

if TYPE_CHECKING:
    from jinja2 import Environment


# ---- Cells ---------------------------------------------------------------------------------------


class Cell(str):
    """Text of a table cell with a kind, a link and a tooltip.

    Attributes:
        kind: "name" of something registered, or the verdict "passed", "failed", "open" or "none".
        link: address that a page links it to.
        hover_text: tooltip in a page.
    """

    kind: str
    link: str
    hover_text: str

    def __new__(cls, text: str, kind: str = "", link: str = "", hover_text: str = "") -> Self:
        """Make a cell from its text."""
        cell = super().__new__(cls, text)
        cell.kind, cell.link, cell.hover_text = kind, link, hover_text
        return cell


CELL_STYLES = {"failed": "bold red", "open": "yellow", "passed": "green", "none": "dim"}
"""Kind of a cell -> its style on a terminal."""


def styled(cell: str) -> Text:
    """Return a cell as styled terminal text."""
    return Text(
        without_control_characters(cell),
        CELL_STYLES.get(cell.kind, "") if isinstance(cell, Cell) else "",
    )


# ---- Tables --------------------------------------------------------------------------------------

_NUMBER = re.compile(r"[<>~≤+−-]?(\d|∞|inf|nan|never)")
_NO_NUMBER = {"", "-", "·", "?", "FAIL"}
"""Placeholders of missing values in a column of numbers."""
MANY = 4
"""Number of columns above which short cells are listed side by side, not one a line."""


class ResultTable(NamedTuple):
    """Table of results.

    Attributes:
        name: name of its file and its anchor.
        title: its title.
        columns: headings.
        rows: cells of text, one a column.
        widths: relative widths of the columns, if they contain sentences.
        note: a sentence below it.
        detail: whether only a terminal shows it, beside a shorter table of the same content.
    """

    name: str
    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    widths: Sequence[int] = ()
    note: str = ""
    detail: bool = False

    def without(self, *columns: str) -> ResultTable:
        """Return the table without some of its columns."""
        indices = [i for i, head in enumerate(self.columns) if head not in columns]
        rows = [[row[i] for i in indices] for row in self.rows]
        return self._replace(columns=[self.columns[i] for i in indices], rows=rows)

    def of_numbers(self, column: int) -> bool:
        """Return whether a column has only numbers, to be aligned at the right."""
        cells = [row[column] for row in self.rows if row[column] not in _NO_NUMBER]
        return bool(cells) and all(_NUMBER.match(cell) for cell in cells)

    def markdown(self) -> str:
        """Return the table in Markdown, all text escaped; names are code."""
        rows = (map(escaped, row) for row in self.rows)
        numbers = map(self.of_numbers, range(len(self.columns)))
        return markdown_table(map(escaped, self.columns), rows, numbers)

    def csv(self) -> str:
        """Return the table as comma-separated values (RFC 4180, but lines end as in Unix)."""
        text = StringIO(newline="")
        csv.writer(text, lineterminator="\n").writerows([self.columns, *self.rows])
        return text.getvalue()

    def text(self, width: int) -> RenderableType:
        """Return the table for a terminal of `width` columns.

        Where it does not fit, words wrap, then headings break at hyphens, and where they do not fit
        either, each row becomes a list of its cells.
        """
        columns = self._columns(width)
        if columns is None:
            return self._listed(width - 2)
        table = Table(*columns, header_style="bold", show_lines=bool(self.widths))
        for row in self.rows:
            table.add_row(*map(styled, row))
        return table

    def _columns(self, width: int) -> list[Column] | None:
        """Return the columns if they fit, else None."""
        if self.widths:
            shared = self._share_widths(width - 3 * len(self.columns) - 1) if width >= 100 else None
            if shared is None:
                return None
            heads = zip(self.columns, shared, strict=True)
            return [Column(escape(head), width=room) for head, room in heads]
        numbers = [self.of_numbers(i) for i in range(len(self.columns))]
        for heads in (self.columns, [head.replace("-", "-\n") for head in self.columns]):
            widths = self._fit_widths(heads, width - 3 * len(heads) - 1)
            if widths is not None:
                whole = zip(heads, numbers, widths, strict=True)
                return [
                    Column(escape(head), justify="right" if last else "left", width=room)
                    for head, last, room in whole
                ]
        return None

    def _fit_widths(self, heads: Sequence[str], room: int) -> list[int] | None:
        """Return the widths of the columns within `room`, the widest ones narrowed; None if
        impossible.
        """
        least = [self._least(i, head) for i, head in enumerate(heads)]
        texts = ("\n".join(column).split("\n") for column in zip(heads, *self.rows, strict=True))
        return _narrowed([max(map(cell_len, lines)) for lines in texts], least, room)

    def _share_widths(self, room: int) -> list[int] | None:
        """Return widths within `room` in proportion to `widths`, none below its least; None if
        impossible.
        """
        least = [self._least(i, head) for i, head in enumerate(self.columns)]
        shares = [room * share // sum(self.widths) for share in self.widths]
        return _narrowed(list(map(max, least, shares)), least, room)

    def _least(self, column: int, head: str) -> int:
        """Return the least width of a column: its longest word, or its longest number."""
        cells = [row[column] for row in self.rows]
        whole, texts = (cells, []) if self.of_numbers(column) else ([], cells)
        apart = [word for text in (head, *texts) for word in text.split()]
        return max(map(cell_len, (*whole, *apart)), default=0)

    def _listed(self, room: int) -> Group:
        first, *heads = self.columns
        lines: list[RenderableType] = []
        for name, *cells in self.rows:
            lines.append(Text(without_control_characters(f"{first} {name}").strip(), style="bold"))
            filled = [(h, c) for h, c in zip(heads, cells, strict=True) if c not in ("", "·")]
            texts = [Text.assemble(f"{h}: " if h else "", styled(c)) for h, c in filled]
            if len(self.columns) > MANY and not self.widths:
                texts = _filled(texts, room)
            lines += [Padding(text, (0, 0, 0, 2), expand=False) for text in texts]
        return Group(*lines)


def table_of(
    name: str,
    title: str,
    things: Iterable[Any],
    columns: Iterable[tuple[str, Callable[[Any], str]]],
    **more: Any,
) -> ResultTable:
    """Return the table of some things, a row each.

    Args:
        name: name of its file and its anchor.
        title: its title.
        things: what the rows are about.
        columns: headings, each with the function that makes the cell of a thing.
        more: further fields of `ResultTable`.
    """
    heads, cells = zip(*columns, strict=True)
    rows = [tuple(cell(thing) for cell in cells) for thing in things]
    return ResultTable(name, title, heads, rows, **more)


def _narrowed(widths: list[int], least: list[int], room: int) -> list[int] | None:
    """Return widths of columns of which the widest are narrowed until all fit; or None."""
    if sum(least) > room:
        return None
    while sum(widths) > room:
        wide = max((i for i, w in enumerate(widths) if w > least[i]), key=widths.__getitem__)
        widths[wide] -= 1
    return widths


def _filled(texts: Iterable[Text], room: int) -> list[Text]:
    """Return texts joined into lines of width `room`; a text that fits is never broken."""
    lines: list[Text] = []
    for text in texts:
        if lines and lines[-1].cell_len + 2 + text.cell_len <= room:
            lines[-1] = Text("; ").join((lines[-1], text))
        else:
            lines.append(text)
    return lines


# ---- Markdown ------------------------------------------------------------------------------------


def escaped(text: str) -> str:
    """Return `text` for a Markdown table, all markup escaped; a name is code."""
    if isinstance(text, Cell) and text.kind == "name":
        name = printable(text)
        return f"`{name}`" if not set(name) & set("`|") else escaped(str(name))
    return "".join(f"\\{c}" if c in "\\`*_{}[]<>|$~" else c for c in printable(text))


def markdown_table(
    columns: Iterable[str], rows: Iterable[Iterable[str]], numbers: Iterable[bool] = ()
) -> str:
    """Return a table in Markdown from cells in Markdown; numbers are aligned at the right."""
    heading = list(columns)
    ends = ["---:" if at_right else "---" for at_right in numbers] or ["---"] * len(heading)
    lines = [heading, ends, *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def table_of_markdown(name: str, text: str) -> ResultTable:
    """Return the table that `ResultTable.markdown` wrote: cells and names, without a title.

    Raises:
        ValueError: it is no table, or its rows have different numbers of cells.

    >>> table = ResultTable("t", "", ("a", "b"), [(Cell("x_1", "name"), "2 | 3")])
    >>> table_of_markdown("t", table.markdown()).rows
    [['x_1', '2 | 3']]
    """
    lines = [line[2:-2].split(" | ") for line in text.splitlines()]
    columns, _, *rows = [[*map(_read_cell, line)] for line in lines]
    if any(len(row) != len(columns) for row in rows):
        raise ValueError("rows of different lengths")
    return ResultTable(name, "", columns, rows)


def _read_cell(text: str) -> str:
    """Return the text of a cell in Markdown."""
    if text.startswith("`"):
        return Cell(text.strip("`"), "name")
    return re.sub(r"\\(.)", r"\1", text)


# ---- Terminal ------------------------------------------------------------------------------------


def print_tables(sheets: Iterable[ResultTable]) -> None:
    """Print tables below each other, with their titles and notes."""
    for sheet in sheets:
        if sheet.title:
            console.print(f"\n[bold]{escape(without_control_characters(sheet.title))}[/]")
        if sheet.rows:
            console.print(sheet.text(console.width))
        if sheet.note:
            say(sheet.note)


def say(text: str, style: str = "") -> None:
    """Print a sentence, wrapped to the width of the terminal where that is known.

    Elsewhere, and for text with lines of its own, such as code, lines keep their length.
    """
    console.print(
        Text(without_control_characters(text), style), soft_wrap=not WIDTH_KNOWN or "\n" in text
    )


# ---- Numbers and JSON ----------------------------------------------------------------------------


def seconds_text(value: float) -> str:
    """Return a time with three digits and its unit, s to ns."""
    for unit, scale in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if value >= scale:
            return f"{value / scale:.3g} {unit}"
    return f"{value / 1e-9:.3g} ns"


def grouped(value: int) -> str:
    """Return a whole number with its digits in groups of three."""
    return f"{value:,}".replace(",", " ")


def ranges(numbers: Iterable[int], to: str = " to ", then: str = ", ") -> str:
    """Return whole numbers as text such as "1 to 4, 20"."""
    runs: list[list[int]] = []
    for number in sorted(set(numbers)):
        if runs and number == runs[-1][1] + 1:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    return then.join(f"{low}" if low == high else f"{low}{to}{high}" for low, high in runs)


def write_json(path: Path, document: Mapping[str, Any]) -> None:
    """Write a document as JSON, with the version of eomcheck."""
    text = json.dumps({"eomcheck": __version__, **document}, indent=1, ensure_ascii=False)
    write_text(path, text + "\n")


# ---- Templates -----------------------------------------------------------------------------------

EXTRA = "it comes with the extra `report`"


def environment() -> Environment:
    """Return the jinja2 environment; HTML is escaped, Markdown is not.

    Raises:
        EngineError: jinja2 is not installed.
    """
    jinja2 = required("jinja2", "report")
    templates = jinja2.Environment(
        loader=jinja2.PackageLoader("eomcheck.lab.report"),
        autoescape=jinja2.select_autoescape(["html.j2"], default=False),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        finalize=lambda value: without_control_characters(value) if type(value) is str else value,
    )
    templates.filters["number"] = number_text
    templates.filters["md"] = escaped
    return templates


def render(template: str, **values: Any) -> str:
    """Return a template filled in with values."""
    return environment().get_template(template).render(**values)


def number_text(value: float) -> str:
    """Return a number with two digits, such as "3.1e-14"."""
    return "0" if value == 0 else f"{value:.1e}" if abs(value) < 0.01 else f"{value:.3g}"
