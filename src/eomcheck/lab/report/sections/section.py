"""What a section is: a few sentences, interactive charts and tables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from eomcheck.lab.show.sheet import Sheet


class Section(NamedTuple):
    """A section of a report.

    Attributes:
        id: its anchor.
        title: its heading.
        text: what it shows and how to read it.
        tables: its tables.
        charts: makes its charts, of which only HTML has any.
    """

    id: str
    title: str
    text: str
    tables: Sequence[Sheet]
    charts: Callable[[], Sequence[Any]] = tuple


__all__ = ["Section", "Sheet"]
