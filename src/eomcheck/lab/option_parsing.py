"""Options shared by studies and commands: their help, parsed and checked."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from typing import Annotated, TypeVar

from eomcheck.errors import MOST_COUNTED, InputError, whole_number

T = TypeVar("T")

MOST_LINKS = 100_000

SCENE_HELP = (
    "Kind of scene, all of them, ROBOT.urdf (:floating with a free base), ROBOT.xml, or your own: "
    "FILE.py:CLASS."
)
ONE_HELP = (
    "Scene: its key, ROBOT.urdf (:floating with a free base), ROBOT.xml, your own, FILE.py:CLASS, "
    "or a snake: paper (the paper's robot), coil, pattern."
)
SET_HELP = (
    "Parameter that is other than usual, NAME=VALUE, NAME=1,0.5 or NAME=none; repeat for more."
)

Links = Annotated[str, "Number of links of the random snakes, N or N..M."]
Kind = Annotated[str, SCENE_HELP]
One = Annotated[str, ONE_HELP]
Set = Annotated[list[str] | None, SET_HELP]
Examples = Annotated[int, "Number of random snakes and states."]
Repeats = Annotated[int, "Timed runs; the median counts."]
Seed = Annotated[int, "Seed of the draws."]


def parse_whole_numbers(text: str) -> list[int]:
    """Return the numbers of "3", "1..12" or "1..12,20,50".

    Raises:
        InputError: none of these.
    """
    numbers: set[int] = set()
    for part in text.split(","):
        low, high = parse_interval(part)
        numbers |= set(range(low, high + 1))
    return sorted(numbers)


def parse_interval(text: str) -> tuple[int, int]:
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


def split_list(texts: Iterable[str] | None) -> list[str] | None:
    """Return what was given as "a,b" or repeated as one list; None of nothing given.

    A name in a file (with a colon in it) is never taken apart.

    Raises:
        InputError: what was given names nothing: an empty selection would check nothing.
    """
    if not texts:
        return None
    texts = list(texts)
    parts = (part for text in texts for part in ([text] if ":" in text else text.split(",")))
    names = [part.strip() for part in parts if part.strip()]
    if not names:
        raise InputError(
            f"{' '.join(texts)!r} names nothing, expected at least one, or several: a,b"
        )
    return names


def parse_numbers(
    name: str, texts: Iterable[str] | None, kind: Callable[[str], T] = float
) -> list[T]:
    """Return the numbers given as "1,0.5" or repeated, in order.

    Args:
        name: what they are called in an error.
        texts: what was given.
        kind: makes a number of its text.

    Raises:
        InputError: one of them is none.
    """
    found = []
    for text in split_list(texts) or []:
        try:
            found.append(kind(text))
        except ValueError:
            whole = "whole numbers" if kind is int else "numbers"
            raise InputError(f"{name} = {text!r}, expected {whole} such as 1,2") from None
    return found


def parse_parameters(texts: Iterable[str] | None) -> dict[str, list[float] | None]:
    """Return the parameters that were given as "name=1,0.5", None of "name=none".

    Raises:
        InputError: none of these, or one name is given twice.
    """
    found: dict[str, list[float] | None] = {}
    for text in texts or ():
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            raise InputError(f"set = {text!r}, expected NAME=VALUE such as mass=2 or mass=1,2,3")
        if name in found:
            raise InputError(f"set: {name} is given twice, expected {name}=1,2,3 for a list")
        if not value.strip(", "):
            raise InputError(f"set = {text!r}, expected a number after {name}=")
        found[name] = None if value == "none" else parse_numbers(name, [value])
    return found


def no_more_than(links: int | None) -> int | None:
    """Return a number of links.

    Raises:
        InputError: it is more than is ever looked at.
    """
    if links is not None and links > MOST_LINKS:
        raise InputError(f"links = {links}, expected at most {MOST_LINKS}")
    return links


def check_count(**numbers: int) -> None:
    """Raise InputError unless every number is 1 to `MOST_COUNTED`."""
    for name, value in numbers.items():
        whole_number(name, value, 1, MOST_COUNTED)
