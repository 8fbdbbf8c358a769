"""Options that many studies have, read and checked."""

from __future__ import annotations

import re
from typing import Annotated

from eomcheck.errors import InputError

MOST_LINKS = 100_000

Links = Annotated[str, "Number of links of the random snakes, N or N..M."]
Kind = Annotated[str, "Kind of scene, all of them, or one in a file: path/to/file.py:Class."]
Examples = Annotated[int, "Number of random snakes and states."]
Repeats = Annotated[int, "Timed runs; the median counts."]
Seed = Annotated[int, "Seed of the draws."]


def whole_numbers(text: str) -> list[int]:
    """Return the numbers of "3", "1..12" or "1..12,20,50".

    Raises:
        InputError: none of these.
    """
    numbers: set[int] = set()
    for part in text.split(","):
        low, high = interval(part)
        numbers |= set(range(low, high + 1))
    return sorted(numbers)


def interval(text: str) -> tuple[int, int]:
    """Return (low, high) of "3" or "1..12".

    Raises:
        InputError: neither.
    """
    match = re.fullmatch(r"(\d+)(?:\.\.(\d+))?", text.strip())
    if match is None:
        raise InputError(f"links = {text!r}, expected a number or a range such as 1..12")
    low, high = int(match[1]), int(match[2] or match[1])
    if not 1 <= low <= high:
        raise InputError(f"links = {text!r}, expected 1 <= first <= last")
    if high > MOST_LINKS:
        raise InputError(f"links = {text!r}, expected at most {MOST_LINKS}")
    return low, high


def at_least_one(**numbers: int) -> None:
    """Raise InputError unless every number is at least 1."""
    for name, value in numbers.items():
        if value < 1:
            raise InputError(f"{name} = {value}, expected at least 1")
