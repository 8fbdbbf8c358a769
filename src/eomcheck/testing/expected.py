"""The file of expected failures: a line a test, its id and then the reason."""

from __future__ import annotations

from pathlib import Path

from eomcheck.atomic_write import read_text
from eomcheck.errors import InputError


def expected_failures(path: Path) -> dict[str, str]:
    """Return id -> reason, as the file lists them.

    A line holds an id, white space and the reason. Empty lines and those that begin with "#" say
    nothing.

    Raises:
        InputError: there is no such file, it is not text, a line has no reason, or an id is there
            twice.
    """
    try:
        lines = read_text(path).splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"expected_failures = {str(path)!r} cannot be read: {error}") from None
    found: dict[str, str] = {}
    for number, line in enumerate(lines, 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        id, *reason = line.split(maxsplit=1)
        where = f"{str(path)!r}, line {number}"
        if not reason:
            raise InputError(f"{where}: {id!r} has no reason, expected an id and a reason")
        if id in found:
            raise InputError(f"{where}: {id!r} is there twice")
        found[id] = reason[0].rstrip()
    return found
