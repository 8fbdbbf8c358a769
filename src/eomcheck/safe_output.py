"""Printable text, and a standard output whose errors fail no command.

Characters that cannot be encoded are transliterated (`theta` for θ), control characters are
replaced, and output that cannot be written is dropped. The results of a command are its exit code
and its files: a reader that has gone (`| head -1`) or a terminal without Greek letters change
neither; after other errors, such as a full disk, the exit code is 2.
"""

from __future__ import annotations

import codecs
import errno
import io
import sys
import unicodedata
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

ERROR_HANDLER = "eomcheck.names"
"""Name of the codec error handler that transliterates characters missing in an encoding."""

ASCII_TEXT = {
    **{"\u0307": "dot", "\u0308": "ddot", "µ": "u", "×": "x", "·": ".", "−": "-", "–": "-"},
    **{"—": "-", "′": "'"},
    **{"≤": "<=", "≥": ">=", "→": "->", "≠": "!=", "≈": "~", "∞": "inf", "∂": "d", "√": "sqrt"},
    **{"²": "^2", "³": "^3", "°": "deg", "ε": "eps", "‖": "||", "±": "+-"},
}
"""Character -> its ASCII text. Not listed: Greek letters, written by their names, and characters
that Unicode decomposes, such as subscripts and letters with accents."""

DIRECTION_CONTROLS = frozenset({"LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI"})
"""Bidirectional classes of characters that begin or end a change of the direction of text."""


def to_ascii(character: str) -> str:
    """Return an ASCII transliteration of a character: `theta` for θ, "?" if there is none."""
    if character in ASCII_TEXT:
        return ASCII_TEXT[character]
    unicode_name = unicodedata.name(character, "")
    if unicode_name.startswith("BOX DRAWINGS"):
        crossing = " AND " in unicode_name
        return "+" if crossing else "-" if unicode_name.endswith("HORIZONTAL") else "|"
    if unicodedata.combining(character):
        return ""
    form = unicodedata.normalize("NFKD", character)
    if form != character:
        return "".join(x if x.isascii() else to_ascii(x) for x in form)
    kind, _, name = unicode_name.partition(" LETTER ")
    name = name.rpartition(" ")[2]
    letters = {"GREEK SMALL": name.lower(), "GREEK CAPITAL": name.capitalize()}
    return letters.get(kind, "?")


def counted(count: int, what: str) -> str:
    """Return a number with its noun: "1 state", "2 states", "3 identities"."""
    ends_in_consonant_y = what[-1:] == "y" and what[-2:-1] not in "aeiou"
    plural = f"{what[:-1]}ies" if ends_in_consonant_y else f"{what}s"
    return f"{count} {what if count == 1 else plural}"


def listed(names: Sequence[str], most: int, noun: str = "", separator: str = ", ") -> str:
    """Return the first names as a text, and the number of others: "a, b and 2 more".

    Args:
        names: all names.
        most: largest number of names that are listed.
        noun: noun of the others, see `counted`, by default "more".
        separator: text between two names.
    """
    text, others = separator.join(names[:most]), len(names) - most
    if others <= 0:
        return text
    return f"{text} and {counted(others, noun) if noun else f'{others} more'}"


def printable(text: str) -> str:
    """Return a text in one line, its control characters replaced by "\ufffd"."""
    return "".join(" " if x.isspace() else "\ufffd" if is_control(x) else x for x in text)


def without_control_characters(text: str) -> str:
    """Return a text with "\ufffd" for control characters other than line breaks and tabs."""
    return "".join("\ufffd" if is_control(x) and x not in "\n\t" else x for x in text)


def is_control(character: str) -> bool:
    """Return whether a character controls a terminal, a line or text direction, or is invalid."""
    kind = unicodedata.category(character)
    return (
        kind in ("Cc", "Cs", "Zl", "Zp")
        or unicodedata.bidirectional(character) in DIRECTION_CONTROLS
    )


def _transliterate(error: UnicodeError) -> tuple[str, int]:
    """Return the ASCII text of what cannot be encoded, and where to continue."""
    assert isinstance(error, UnicodeEncodeError)
    return "".join(map(to_ascii, error.object[error.start : error.end])), error.end


codecs.register_error(ERROR_HANDLER, _transliterate)


class _Output(io.RawIOBase):
    """A raw file whose writes never fail.

    `first_error` is the first error of the file beneath, if any; nothing is written after it.
    """

    def __init__(self, raw: io.RawIOBase):
        self.raw = raw
        self.first_error: OSError | None = None

    def writable(self) -> bool:
        return True

    def fileno(self) -> int:
        return self.raw.fileno()

    def isatty(self) -> bool:
        return self.raw.isatty()

    def write(self, data, /) -> int | None:
        try:
            return self.raw.write(data) if self.first_error is None else len(data)
        except OSError as error:
            self.first_error = error
            return len(data)


@contextmanager
def unfailing_output() -> Iterator[None]:
    """Return a context in which standard output loses text rather than raises.

    Neither write errors nor characters that cannot be encoded raise there. On standard error
    characters do not raise either, and still do not after the block; write errors do. Nothing
    changes where standard output is no text layer over a file, such as a `StringIO`.

    Raises:
        SystemExit: with 2, after the block, if output was lost for another reason than that its
            reader has gone.
    """
    original = sys.stdout
    buffer = getattr(original, "buffer", None)
    raw = getattr(buffer, "raw", buffer)
    if not isinstance(original, io.TextIOWrapper) or not isinstance(raw, io.RawIOBase):
        yield
        return
    original.flush()
    output = _Output(raw)
    at_once = original.line_buffering or original.write_through
    sys.stdout = io.TextIOWrapper(
        io.BufferedWriter(output), original.encoding, ERROR_HANDLER, line_buffering=at_once
    )
    if isinstance(sys.stderr, io.TextIOWrapper):
        sys.stderr.reconfigure(errors=ERROR_HANDLER)
    try:
        yield
    finally:
        sys.stdout.flush()
        sys.stdout = original
        if output.first_error is not None and output.first_error.errno != errno.EPIPE:
            print(
                f"eomcheck: standard output cannot be written: {output.first_error.strerror}",
                file=sys.stderr,
            )
            sys.exit(2)
