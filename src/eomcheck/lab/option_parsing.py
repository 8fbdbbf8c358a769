"""Options shared by studies and commands: their help, parsed and checked."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from typing import Annotated, TypeVar

from eomcheck.errors import MOST_COUNTED, InputError, whole_number

T = TypeVar("T")

MOST_LINKS = 100_000

SCENE_HELP = (
    "Kind of scene, all of them, ROBOT.urdf or .sdf (:floating with a free base), ROBOT.xml, or "
    "your own: "
    "FILE.py:CLASS."
)
ONE_HELP = (
    "Scene: its key, ROBOT.urdf or .sdf (:floating with a free base), ROBOT.xml, your own, "
    "FILE.py:CLASS, or a snake: paper (the paper's robot), coil, pattern."
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
ISOLATED_HELP = (
    "Run each optional library in a process and an environment of its own, which is made the first "
    "time: it need not be installed."
)
Isolated = Annotated[bool, ISOLATED_HELP]


def parse_whole_numbers(text: str) -> list[int]:
    """Return the sorted whole numbers of "3", "1..12" or "1..12,20,50".

    Raises:
        InputError: the text is none of these.
    """
    numbers: set[int] = set()
    for part in text.split(","):
        low, high = parse_interval(part)
        numbers |= set(range(low, high + 1))
    return sorted(numbers)


def parse_interval(text: str) -> tuple[int, int]:
    """Return the interval (low, high) of "3" or "1..12".

    Raises:
        InputError: the text is neither, or too large.
    """
    match = re.fullmatch(r"(\d+)(?:\.\.(\d+))?", text.strip())
    if match is None:
        raise InputError(f"links = {text!r}, expected a number or a range such as 1..12")
    low, high = int(match[1]), int(match[2] or match[1])
    if low < 1:
        raise InputError(f"links = {text!r}, expected whole numbers of at least 1")
    if low > high:
        raise InputError(f"links = {text!r}, expected first <= last")
    if high > MOST_LINKS:
        raise InputError(f"links = {text!r}, expected at most {MOST_LINKS}")
    return low, high


def split_list(texts: Iterable[str] | None) -> list[str] | None:
    """Return the names of an option given as "a,b" or repeated; None if it is not given.

    A name in a file (with a colon in it) is never split.

    Raises:
        InputError: there is no name in `texts`: an empty selection would check nothing.
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
        name: name of the option in an error.
        texts: values of the option.
        kind: converts a text to a number.

    Raises:
        InputError: a text is no number.
    """
    numbers = []
    for text in split_list(texts) or []:
        try:
            numbers.append(kind(text))
        except ValueError:
            whole = "whole numbers" if kind is int else "numbers"
            raise InputError(f"{name} = {text!r}, expected {whole} such as 1,2") from None
    return numbers


def parse_parameters(texts: Iterable[str] | None) -> dict[str, list[float] | None]:
    """Return the parameters of "name=1,0.5", by name; None for "name=none".

    Raises:
        InputError: a text is neither, or one name is given twice.
    """
    parameters: dict[str, list[float] | None] = {}
    for text in texts or ():
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            raise InputError(f"set = {text!r}, expected NAME=VALUE such as mass=2 or mass=1,2,3")
        if name in parameters:
            raise InputError(f"set: {name} is given twice, expected {name}=1,2,3 for a list")
        if not value.strip(", "):
            raise InputError(f"set = {text!r}, expected a number after {name}=")
        parameters[name] = None if value == "none" else parse_numbers(name, [value])
    return parameters


def no_more_than(links: int | None) -> int | None:
    """Return a number of links unchanged, if it is not too large.

    Raises:
        InputError: it is more than `MOST_LINKS`.
    """
    if links is not None and links > MOST_LINKS:
        raise InputError(f"links = {links}, expected at most {MOST_LINKS}")
    return links


def check_count(**numbers: int) -> None:
    """Raise InputError unless every number is 1 to `MOST_COUNTED`."""
    for name, value in numbers.items():
        whole_number(name, value, 1, MOST_COUNTED)
