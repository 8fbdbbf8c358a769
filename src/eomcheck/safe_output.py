"""Printable text, and a standard output whose errors fail no command.

Characters that cannot be encoded are transliterated (`theta` for θ), control characters are
replaced, and output without a reader is dropped. The results of a command are its exit code and its
files: a reader that has gone (`| head -1`), a full disk or a terminal without Greek letters change
neither.
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
"""Name of the codec error handler that transliterates characters missing in an encoding."""

WRITTEN = {
    **{"\u0307": "dot", "\u0308": "ddot", "µ": "u", "×": "x", "·": ".", "−": "-", "–": "-"},
    **{"—": "-", "′": "'"},
    **{"≤": "<=", "≥": ">=", "→": "->", "≠": "!=", "≈": "~", "∞": "inf", "∂": "d", "√": "sqrt"},
    **{"²": "^2", "³": "^3", "°": "deg", "ε": "eps", "‖": "||", "±": "+-"},
}
"""Character -> its ASCII text; Greek letters are written by name, others by their plain form."""

TURNING = frozenset({"LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI"})
"""Bidirectional classes of the characters that change the direction of the text after them."""


def to_ascii(character: str) -> str:
    """Return an ASCII transliteration of a character: `theta` for θ, "?" if there is none."""
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
    """Return a number with its noun: "1 state", "2 states", "3 identities"."""
    many = f"{what.removesuffix('y')}ies" if what.endswith("ty") else f"{what}s"
    return f"{count} {what if count == 1 else many}"


def printable(text: str) -> str:
    """Return a text in one line, its control characters replaced by "\ufffd"."""
    return "".join(" " if x.isspace() else "\ufffd" if is_control(x) else x for x in text)


def without_control_characters(text: str) -> str:
    """Return a text with "\ufffd" for control characters other than line breaks and tabs."""
    return "".join("\ufffd" if is_control(x) and x not in "\n\t" else x for x in text)


def is_control(character: str) -> bool:
    """Return whether a character controls a terminal, a line or text direction, or is invalid."""
    kind = unicodedata.category(character)
    return kind in ("Cc", "Cs", "Zl", "Zp") or unicodedata.bidirectional(character) in TURNING


def _in_names(error: UnicodeError) -> tuple[str, int]:
    assert isinstance(error, UnicodeEncodeError)
    return "".join(map(to_ascii, error.object[error.start : error.end])), error.end


codecs.register_error(NAMES, _in_names)


class _Output(io.RawIOBase):
    """A raw file whose writes never fail; `lost` is the first error of the file beneath, if any."""

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
    """Make writes to standard output and error never fail inside the block.

    On standard output neither write errors nor unencodable characters raise, on standard error no
    unencodable characters.

    Raises:
        SystemExit: with 2, after the block, if output was lost for another reason than that its
            reader has gone.
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
