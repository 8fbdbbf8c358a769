"""Printable text, and a standard output that fails no command.

Characters that cannot be encoded are written otherwise (`theta` for θ), control characters are
replaced, and what nobody reads is lost. The results of a command are its exit code and its files: a
reader that has gone (`| head -1`), a full disk or a terminal without Greek letters change neither.
"""

from __future__ import annotations

import codecs
import errno
import io
import sys
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager

NAMES = "eomcheck.names"
"""The error handler of encodings that writes names for characters which they do not have."""

WRITTEN = {
    **{"\u0307": "dot", "\u0308": "ddot", "µ": "u", "×": "x", "·": ".", "−": "-", "–": "-"},
    **{"—": "-", "′": "'"},
    **{"≤": "<=", "≥": ">=", "→": "->", "≠": "!=", "≈": "~", "∞": "inf", "∂": "d", "√": "sqrt"},
    **{"²": "^2", "³": "^3", "°": "deg", "ε": "eps", "‖": "||", "±": "+-"},
}
"""Characters -> what is written for them; Greek letters have names, others a plain form or none."""

TURNING = frozenset({"LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI"})
"""Bidirectional classes of characters that make the text behind them run the other way."""


def to_ascii(character: str) -> str:
    """Return a character in ASCII: `theta` for θ, "?" where nothing comes near."""
    if character in WRITTEN:
        return WRITTEN[character]
    called = unicodedata.name(character, "")
    if called.startswith("BOX DRAWINGS"):
        crossing = " AND " in called
        return "+" if crossing else "-" if called.endswith("HORIZONTAL") else "|"
    if unicodedata.combining(character):
        return ""
    form = unicodedata.normalize("NFKD", character)
    if form != character:
        return "".join(x if x.isascii() else to_ascii(x) for x in form)
    kind, _, name = called.partition(" LETTER ")
    name = name.rpartition(" ")[2]
    known = {"GREEK SMALL": name.lower(), "GREEK CAPITAL": name.capitalize()}
    return known.get(kind, "?")


def counted(count: int, what: str) -> str:
    """Return "1 state", "2 states", "3 identities"."""
    many = f"{what.removesuffix('y')}ies" if what.endswith("ty") else f"{what}s"
    return f"{count} {what if count == 1 else many}"


def printable(text: str) -> str:
    """Return a text in one line: without line breaks, and "\ufffd" for other control characters."""
    return "".join(" " if x.isspace() else "\ufffd" if is_control(x) else x for x in text)


def without_control_characters(text: str) -> str:
    """Return a text of lines and tabs with "\ufffd" for other control characters."""
    return "".join("\ufffd" if is_control(x) and x not in "\n\t" else x for x in text)


def is_control(character: str) -> bool:
    """Whether a character controls a terminal, a line or the direction of text, or is none."""
    kind = unicodedata.category(character)
    return kind in ("Cc", "Cs", "Zl", "Zp") or unicodedata.bidirectional(character) in TURNING


def _in_names(error: UnicodeError) -> tuple[str, int]:
    assert isinstance(error, UnicodeEncodeError)
    return "".join(map(to_ascii, error.object[error.start : error.end])), error.end


codecs.register_error(NAMES, _in_names)


class _Output(io.RawIOBase):
    """A file that takes everything; `lost` is why it could not pass it on."""

    def __init__(self, raw: io.RawIOBase):
        self.raw = raw
        self.lost: OSError | None = None

    def writable(self) -> bool:
        return True

    def fileno(self) -> int:
        return self.raw.fileno()

    def isatty(self) -> bool:
        return self.raw.isatty()

    def write(self, data, /) -> int | None:
        try:
            return self.raw.write(data) if self.lost is None else len(data)
        except OSError as error:
            self.lost = error
            return len(data)


@contextmanager
def unfailing_output() -> Iterator[None]:
    """Have standard output take everything inside the block, and standard error every character.

    Raises:
        SystemExit: with 2, after the block, where output was lost that had a reader.
    """
    before = sys.stdout
    buffer = getattr(before, "buffer", None)
    raw = getattr(buffer, "raw", buffer)
    if not isinstance(before, io.TextIOWrapper) or not isinstance(raw, io.RawIOBase):
        yield
        return
    before.flush()
    output = _Output(raw)
    at_once = before.line_buffering or before.write_through
    sys.stdout = io.TextIOWrapper(
        io.BufferedWriter(output), before.encoding, NAMES, line_buffering=at_once
    )
    if isinstance(sys.stderr, io.TextIOWrapper):
        sys.stderr.reconfigure(errors=NAMES)
    try:
        yield
    finally:
        sys.stdout.flush()
        sys.stdout = before
        if output.lost is not None and output.lost.errno != errno.EPIPE:
            print(
                f"eomcheck: standard output cannot be written: {output.lost.strerror}",
                file=sys.stderr,
            )
            sys.exit(2)
