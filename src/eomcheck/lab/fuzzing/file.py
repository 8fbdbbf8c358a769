"""The file of finds, in which those of one cause are kept once."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from eomcheck.errors import InputError
from eomcheck.files import write_text
from eomcheck.lab.fuzzing.finds import Find


def read_finds(path: Path) -> list[Find]:
    """Return the finds in a file.

    Raises:
        InputError: it cannot be read, or holds something else.
    """
    if not path.exists():
        return []
    try:
        return [_read(one) for one in json.loads(path.read_text(encoding="utf-8"))]
    except (OSError, TypeError, KeyError, ValueError) as error:
        raise InputError(f"{str(path)!r} holds no finds: {error}") from None


def _read(one: dict[str, Any]) -> Find:
    fields = set(Find.__dataclass_fields__)
    if unknown := set(one) - fields:
        raise ValueError(f"unknown: {', '.join(sorted(unknown))}")
    return Find(**one)


def write_finds(path: Path, finds: Iterable[Find]) -> None:
    """Write finds into a file, those of one cause once."""
    kept = [
        {k: x for k, x in asdict(one).items() if x != "" and not (k == "t_end" and x == 0.0)}
        for one in told_apart(finds)
    ]
    write_text(path, "[\n" + ",\n".join(json.dumps(one) for one in kept) + "\n]\n")


def told_apart(finds: Iterable[Find]) -> list[Find]:
    """Return the first find of each cause."""
    found: dict[Any, Find] = {}
    for i, one in enumerate(finds):
        found.setdefault(one.key if one.claim else i, one)
    return list(found.values())
