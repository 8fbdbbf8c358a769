"""Tables and sentences on a terminal."""

from __future__ import annotations

from collections.abc import Iterable

from rich.markup import escape
from rich.text import Text

from eomcheck.console import WIDTH_KNOWN, console
from eomcheck.lab.show.sheet import Sheet
from eomcheck.output import harmless


def print_sheets(sheets: Iterable[Sheet]) -> None:
    """Print tables below each other, with their titles and notes."""
    for sheet in sheets:
        if sheet.title:
            console.print(f"\n[bold]{escape(harmless(sheet.title))}[/]")
        if sheet.rows:
            console.print(sheet.text(console.width))
        if sheet.note:
            say(sheet.note)


def say(text: str, style: str = "") -> None:
    """Print a sentence in lines that fit where somebody said how wide they may be.

    Elsewhere, and of text that has lines of its own, such as code, lines are as long as they are.
    """
    console.print(Text(harmless(text), style), soft_wrap=not WIDTH_KNOWN or "\n" in text)
