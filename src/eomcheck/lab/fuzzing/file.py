"""The corpus: a file of failures, in which those of one cause are kept once."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from eomcheck.atomic_write import locked, read_text, write_text
from eomcheck.errors import InputError, message_of
from eomcheck.lab.fuzzing.finds import Find
from eomcheck.mechanics.scene import finite_array


def read_finds(path: Path) -> list[Find]:
    """Return the finds in a file.

    Raises:
        InputError: it cannot be read, or holds something else.
    """
    if not path.exists():
        return []
    try:
        rows = json.loads(read_text(path))
        if not isinstance(rows, list):
            raise TypeError("expected a list")
        return [_read(one) for one in rows]
    except (OSError, TypeError, KeyError, ValueError, RecursionError) as error:
        raise InputError(f"{str(path)!r} holds no finds: {message_of(error)}") from None


KINDS = {"float": (int, float), "str": str, "dict[str, Any]": dict, "list[float]": list}
"""Annotation of a field of `Find` -> what it may be in JSON."""


def _read(one: Any) -> Find:
    """A failure of its row.

    Raises:
        TypeError, ValueError: a field is missing, unknown, of another type, or not finite.
    """
    if not isinstance(one, dict):
        raise TypeError(f"{one!r}, expected names and values")
    if unknown := set(one) - set(Find.__dataclass_fields__):
        raise ValueError(f"unknown: {', '.join(sorted(unknown))}")
    for name, value in one.items():
        kind = KINDS[Find.__annotations__[name]]
        if not isinstance(value, kind) or isinstance(value, bool):
            raise TypeError(f"{name} = {value!r}, expected {Find.__annotations__[name]}")
    find = Find(**one)
    for name in ("q", "v"):
        finite_array(name, getattr(find, name), (len(getattr(find, name)),))
    for name in ("t", "t_end"):
        finite_array(name, getattr(find, name), ())
    if find.t_end < 0.0:
        raise ValueError(f"t_end = {find.t_end}, expected a time that is not negative")
    return find


def write_finds(path: Path, finds: Iterable[Find]) -> None:
    """Write finds into a file, those of one cause once."""
    kept = [
        {k: x for k, x in asdict(one).items() if x != "" and not (k == "t_end" and x == 0.0)}
        for one in told_apart(finds)
    ]
    write_text(path, "[\n" + ",\n".join(json.dumps(one) for one in kept) + "\n]\n")


def add_finds(path: Path, finds: Iterable[Find]) -> None:
    """Add finds to those in a file; two processes that do so at once lose none.

    Raises:
        InputError: the file cannot be read.
        UnwrittenError: it cannot be written.
    """
    with locked(path):
        write_finds(path, [*read_finds(path), *finds])


def told_apart(finds: Iterable[Find]) -> list[Find]:
    """Return the first find of each cause."""
    found: dict[Any, Find] = {}
    for i, one in enumerate(finds):
        found.setdefault(one.key if one.claim else i, one)
    return list(found.values())
