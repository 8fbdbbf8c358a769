"""What a library writes to the terminal while it reads a file: kept, and told where it explains."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress

OUTPUT, ERRORS = 1, 2
"""Descriptors that compiled code writes to, whatever Python's own are."""


@contextmanager
def listening() -> Iterator[list[str]]:
    """Yield a list that after the block has all lines that were written, each once."""
    lines: list[str] = []
    _flush()
    with tempfile.TemporaryFile() as kept:
        before = {stream: os.dup(stream) for stream in (OUTPUT, ERRORS)}
        for stream in before:
            os.dup2(kept.fileno(), stream)
        try:
            yield lines
        finally:
            _flush()
            for stream, original in before.items():
                os.dup2(original, stream)
                os.close(original)
            kept.seek(0)
            text = kept.read().decode("utf-8", "replace")
            lines += dict.fromkeys(x.strip() for x in text.splitlines() if x.strip())


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        with suppress(AttributeError, OSError, ValueError):
            stream.flush()
