"""What is printed fits into a terminal of any width: no line is too long, nothing is cut."""

from __future__ import annotations

import re
from collections.abc import Iterable
from io import StringIO

from rich.cells import cell_len
from rich.console import Console

from eomcheck.lab.show.table import ResultTable

WIDTHS = (40, 80, 140)


def check_fits(text: str, width: int) -> None:
    """Check that nothing is too long, cut, or squeezed to nothing."""
    for line in text.splitlines():
        assert cell_len(line) <= width, line
    ours = re.sub(r"[\])}A-Z]\.\.\.|\(\.\.\.\)", "", text)  # "and so on" of click, and of a call
    assert "…" not in ours and "..." not in ours
    assert not re.search("[│┃] ?[│┃]", text), "a column without any room"


def check_sheets_fit(sheets: Iterable[ResultTable]) -> None:
    """Check that tables fit in all widths, and that words that are cells are in them whole."""
    for sheet in sheets:
        words = {cell for row in sheet.rows for cell in row if re.fullmatch(r"[\w.+-]{2,}", cell)}
        for width in WIDTHS if sheet.rows else ():
            console = Console(file=StringIO(), width=width, color_system=None)
            console.print(sheet.text(width))
            printed = console.file.getvalue()  # type: ignore[attr-defined]
            check_fits(printed, width)
            assert words <= set(re.findall(r"[\w.+-]{2,}", printed)), sheet.name
