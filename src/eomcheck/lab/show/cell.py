"""The text of a cell of a table, and what more is known of it."""

from __future__ import annotations

from typing import Self

from rich.text import Text

from eomcheck.output import harmless


class Cell(str):
    """The text of a cell that is more than text.

    Attributes:
        kind: "name" of something registered, or what a cell says is "passed", "failed", "open" or
            "none".
        link: where it leads in a page.
        said: what a page says on demand.
    """

    kind: str
    link: str
    said: str

    def __new__(cls, text: str, kind: str = "", link: str = "", said: str = "") -> Self:
        """Make it of its text."""
        made = super().__new__(cls, text)
        made.kind, made.link, made.said = kind, link, said
        return made


LOOKS = {"failed": "bold red", "open": "yellow", "passed": "green", "none": "dim"}
"""Kind of a cell -> how a terminal shows it."""


def styled(cell: str) -> Text:
    """Return a cell as a terminal shows it."""
    return Text(harmless(cell), LOOKS.get(cell.kind, "") if isinstance(cell, Cell) else "")
