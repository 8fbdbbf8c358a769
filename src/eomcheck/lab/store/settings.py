"""Settings of a cell: plain data, and the text under which a Record is found."""

from __future__ import annotations

import json
from typing import Any

from eomcheck.errors import InputError

Settings = dict[str, Any]
"""What a study varies -> its value in this cell; values are numbers, text, None, lists, dicts."""


def json_of(what: str, given: object) -> str:
    """Return JSON (with Python's Infinity and NaN), sorted.

    Raises:
        InputError: something in `given` would not come back as it is; the message says `what`.
    """
    if not isinstance(given, dict) or not all(isinstance(name, str) for name in given):
        raise InputError(f"{what} = {given!r}, expected a dict with names as keys")
    try:
        return json.dumps(given, ensure_ascii=False, sort_keys=True, separators=(",", ":"))
    except (TypeError, ValueError) as error:
        raise InputError(f"{what} = {given!r}: {error}") from None


def key_of(settings: Settings) -> str:
    """Return the canonical JSON of settings: names sorted, and 1.0 is 1."""
    return json_of("settings", canonical(settings))


def canonical(value: Any) -> Any:
    """Return a value of which every equal one has the same JSON: whole floats as integers."""
    match value:
        case dict():
            return {name: canonical(entry) for name, entry in value.items()}
        case list() | tuple():
            return [canonical(entry) for entry in value]
        case float() if value.is_integer() and abs(value) <= 2**53:
            return int(value)
        case _:
            return value
