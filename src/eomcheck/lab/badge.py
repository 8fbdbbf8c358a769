"""Badge of a result: a static SVG with a label and the number of quantities that agree.

The result is a file of `eomcheck validate --json` or `compare --json`. Its findings about an engine
are counted by quantity. No font is measured: the width of each character is that of a table, and
`textLength` makes the text as wide.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape, quoteattr

from eomcheck.atomic_write import read_as, write_text
from eomcheck.errors import InputError
from eomcheck.lab.deviations import Observation, observations_of
from eomcheck.lab.store.record_file import group
from eomcheck.safe_output import counted

GREEN, ORANGE, GRAY = "#1a7f37", "#b35900", "#595959"
"""Colors: all agree, some differ, nothing decided. White text on each has a contrast above 4.5."""

NARROW, WIDE = " .,:;!|'`()[]{}ijlrtfI1-", "mwMW@%"
CHARACTER, SMALL, LARGE = 7.0, 4.2, 10.4
"""Widths of characters in 11 px sans serif, px: most of them, the narrow and the wide ones."""
PADDING, HEIGHT = 6.0, 20
"""Space on either side of a text, and the height of a badge, px."""


def read_observations(path: Path) -> list[Observation]:
    """Return the observations in a result of `validate --json` or `compare --json`.

    Raises:
        InputError: it cannot be read, or is no such result.
    """
    name = repr(str(path))
    contents = read_as(path, "JSON", json.loads)
    findings = contents.get("findings") if isinstance(contents, Mapping) else None
    if not (isinstance(findings, list) and all(map(_is_finding, findings))):
        wanted = "a result of `eomcheck validate --json` or `compare --json`"
        raise InputError(f"{name} has no findings, expected {wanted}")
    return list(observations_of(("", one) for one in findings))


def _is_finding(one: Any) -> bool:
    texts = ("claim", "subject", "verdict", "detail")
    return isinstance(one, Mapping) and all(isinstance(one.get(key), str) for key in texts)


def badge_text(path: Path, engine: str | None) -> tuple[str, str, str]:
    """Return engine, message and color of the badge of a result.

    Args:
        path: the result.
        engine: key of the engine; None where the result is of a single one.

    Raises:
        InputError: see `read_observations`; or the result has nothing on the engine, or several and
            none is chosen.
    """
    by_engine = group(read_observations(path), lambda one: one.engine)
    if engine is None and len(by_engine) > 1:
        raise InputError(f"{str(path)!r} is about {', '.join(by_engine)}: --engine KEY")
    if not by_engine or (engine is not None and engine not in by_engine):
        known = ", ".join(by_engine) or "no engine"
        wanted = f"engine = {engine!r}" if engine else "no engine"
        raise InputError(f"{str(path)!r}: {wanted}, expected one of those judged there: {known}")
    key = next(iter(by_engine)) if engine is None else engine
    decided = [one for one in by_engine[key] if one.differs is not None]
    agree = sum(not one.differs for one in decided)
    if not decided:
        return key, "nothing decided", GRAY
    total = counted(len(decided), "quantity")
    return key, f"{agree} of {total}", GREEN if agree == len(decided) else ORANGE


def width_of(text: str) -> float:
    """Return the width of a text, px."""
    return sum(SMALL if x in NARROW else LARGE if x in WIDE else CHARACTER for x in text)


def badge_svg(label: str, message: str, color: str) -> str:
    """Return the SVG of a badge: label on gray, message on a color.

    Args:
        label: text on the left.
        message: text on the right.
        color: background of the message, "#rrggbb".
    """
    left, right = (width_of(text) + 2 * PADDING for text in (label, message))
    title = f"{label}: {message}"
    texts = "".join(
        f'<text x="{x:.1f}" y="14" textLength="{width_of(text):.1f}">{escape(text)}</text>'
        for x, text in ((left / 2, label), (left + right / 2, message))
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{left + right:.1f}" height="{HEIGHT}" '
        f'role="img" aria-label={quoteattr(title)}>\n'
        f"<title>{escape(title)}</title>\n"
        f'<rect width="{left + right:.1f}" height="{HEIGHT}" rx="3" fill="{color}"/>\n'
        f'<path d="M3 0H{left:.1f}V{HEIGHT}H3a3 3 0 0 1-3-3V3a3 3 0 0 1 3-3z" fill="#3d3d3d"/>\n'
        '<g fill="#fff" text-anchor="middle" font-size="11" '
        f'font-family="Verdana,DejaVu Sans,sans-serif">{texts}</g>\n'
        "</svg>\n"
    )


def write_badge(result: Path, path: Path, label: str | None, engine: str | None) -> str:
    """Write the badge of a result, and return its text.

    Args:
        result: file of `validate --json` or `compare --json`.
        path: SVG to write.
        label: text on the left; by default "eomcheck" and the engine.
        engine: see `badge_text`.

    Raises:
        InputError: see `badge_text`; or the badge cannot be written.
    """
    key, message, color = badge_text(result, engine)
    label = f"eomcheck {key}" if label is None else label
    write_text(path, badge_svg(label, message, color))
    return f"{label}: {message}"
