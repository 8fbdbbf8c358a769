"""Atomic writes of files, locks between processes, and checks of paths.

A file is written beside the old one and replaces it when it is whole: an exception or the end of
the process leaves the old file as it was.
"""

from __future__ import annotations

import os
import secrets
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

from eomcheck.errors import InputError, UnwrittenError


def _cannot(path: Path, error: OSError) -> UnwrittenError:
    return UnwrittenError(f"{str(path)!r} cannot be written: {error.strerror or error}")


def _replaced(path: Path) -> bool:
    """Return whether a new file replaces `path`; devices and pipes are written to instead."""
    return path.is_file() or not path.exists()


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield the path of a new file, of the same suffix, that becomes `path` after the block.

    If an exception or the end of the process ends the block early, the old file stays as it was.

    Raises:
        UnwrittenError: it cannot be written completely.
    """
    target = path.resolve()
    beside = target.with_name(f".{secrets.token_hex(8)}{target.suffix}")
    try:
        if not _replaced(target):
            yield path
            return
        yield beside
        with beside.open("rb+") as written:
            os.fsync(written.fileno())
        if target.exists():
            beside.chmod(target.stat().st_mode & 0o777)
        beside.replace(target)
    except OSError as error:
        raise _cannot(path, error) from None
    finally:
        beside.unlink(missing_ok=True)


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Lock the folder of `path`, so that one process at a time reads and replaces a file in it.

    The lock is on the folder, since replacing a file would discard a lock on it. Without `flock`,
    or if the folder cannot be locked, nothing is locked.
    """
    with ExitStack() as stack:
        with suppress(ImportError, OSError):
            import fcntl

            folder = os.open(path.resolve().parent, os.O_RDONLY)
            stack.callback(os.close, folder)
            fcntl.flock(folder, fcntl.LOCK_EX)
        yield


def check_regular(path: Path) -> None:
    """Raise InputError if `path` exists and is no regular file: a pipe or device may never end."""
    if path.exists() and not path.is_file():
        raise InputError(f"{str(path)!r} is not a regular file")


def read_text(path: Path) -> str:
    """Return the text of a regular file in UTF-8.

    Raises:
        InputError: it is a folder, a pipe or a device.
        OSError, UnicodeDecodeError: it cannot be read.
    """
    check_regular(path)
    return path.read_text(encoding="utf-8")


def read_as(path: Path, format: str, parse: Callable[[str], Any]) -> Any:
    """Return the contents of a regular file in UTF-8 by a parser of its format.

    Raises:
        InputError: it cannot be read, or the parser refuses it.
    """
    try:
        return parse(read_text(path))
    except OSError as error:
        raise InputError(f"{str(path)!r} cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:  # of UTF-8 too
        raise InputError(f"{str(path)!r} is not {format}: {error}") from None


def write_text(path: Path, text: str) -> None:
    """Write a text in UTF-8 to the file `path` atomically, see `replacing`."""
    with replacing(path) as beside:
        beside.write_text(text, encoding="utf-8", newline="")


def check_writable(path: Path | None) -> None:
    """Raise InputError if `path` cannot be written; None stands for no file."""
    if path is None or (path.exists() and not path.is_file() and not path.is_dir()):
        return
    if path.is_dir():
        raise InputError(f"{str(path)!r} is a folder, expected a file")
    if not path.absolute().parent.is_dir():
        raise InputError(f"folder {str(path.parent)!r} does not exist, for {str(path)!r}")
    try:
        if path.exists():
            with path.open("ab"):
                pass
        new = path.resolve().with_name(f".{secrets.token_hex(8)}")
        new.touch(exist_ok=False)
        new.unlink()
    except OSError as error:
        raise _cannot(path, error) from None
