"""Numbers as text, and documents as JSON."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from eomcheck import __version__
from eomcheck.files import write_text


def seconds_text(value: float) -> str:
    """Return a time with its unit."""
    for unit, scale in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if value >= scale:
            return f"{value / scale:.3g} {unit}"
    return f"{value / 1e-9:.3g} ns"


def grouped(value: int) -> str:
    """Return a whole number with its digits in groups of three."""
    return f"{value:,}".replace(",", " ")


def ranges(numbers: Iterable[int], to: str = " to ", then: str = ", ") -> str:
    """Return whole numbers as "1 to 4, 20"."""
    runs: list[list[int]] = []
    for number in sorted(set(numbers)):
        if runs and number == runs[-1][1] + 1:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    return then.join(f"{low}" if low == high else f"{low}{to}{high}" for low, high in runs)


def write_json(path: Path, document: Mapping[str, Any]) -> None:
    """Write a document as JSON, with the version that made it."""
    text = json.dumps({"eomcheck": __version__, **document}, indent=1, ensure_ascii=False)
    write_text(path, text + "\n")
