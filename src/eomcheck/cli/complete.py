"""What a shell is told when a name is half typed: keys as they stand in the sources, read as text.

Nothing is imported for that, so it takes no longer than the command line takes to start.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from importlib.metadata import entry_points
from pathlib import Path

ROOT = Path(__file__).parents[1]

WRITTEN = {
    "scene": ("scenes", r'^    key = "([\w-]+)"'),
    "formulation": ("formulations", r'^    key="(\w+)",'),
    "engine": ("engines", r"^class (?!Tree)(\w+)Engine\(\w*Engine\):"),
    "robot": ("", r'^    "(\w+)": lambda links'),
}
"""What is named -> the folder of its files, and how a file says the key."""


def keys(word: str) -> list[str]:
    """Return the keys of all that a word of `WRITTEN` names, and those that packages announce."""
    folder, pattern = WRITTEN[word]
    found = [
        key.lower()
        for file in sorted((ROOT / folder).glob("*.py"))
        for key in re.findall(pattern, file.read_text(encoding="utf-8"), re.MULTILINE)
    ]
    announced = [point.name for point in entry_points(group=f"eomcheck.{word}s")]
    return [*found, *announced]


def completing(*words: str, more: Sequence[str] = ()) -> Callable[[str], list[str]]:
    """Return what completes a key, or the last one of keys with commas between.

    Args:
        words: of what, see `WRITTEN`.
        more: other names that can stand there.
    """

    def complete(incomplete: str) -> list[str]:
        before, comma, last = incomplete.rpartition(",")
        known = [key for word in words for key in keys(word)]
        names = (name for name in (*known, *more) if name.startswith(last))
        return [f"{before}{comma}{name}" for name in names]

    return complete
