"""Text of documents: numbers with units, JSON files, and filled-in jinja2 templates.

The templates are those of `eomcheck.lab.report`; HTML is escaped, Markdown is not. jinja2 comes
with the extra `report` and is imported when a template is first filled in.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eomcheck import __version__
from eomcheck.atomic_write import write_text
from eomcheck.errors import required
from eomcheck.lab.show.table import escaped
from eomcheck.safe_output import without_control_characters

if TYPE_CHECKING:
    from jinja2 import Environment


# ---- Numbers and JSON ----------------------------------------------------------------------------


def seconds_text(value: float) -> str:
    """Return a time with three digits and its unit, s to ns."""
    for unit, scale in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if value >= scale:
            return f"{value / scale:.3g} {unit}"
    return f"{value / 1e-9:.3g} ns"


def grouped(value: int) -> str:
    """Return a whole number with its digits in groups of three."""
    return f"{value:,}".replace(",", " ")


def ranges(numbers: Iterable[int], to: str = " to ", then: str = ", ") -> str:
    """Return whole numbers as text such as "1 to 4, 20"."""
    runs: list[list[int]] = []
    for number in sorted(set(numbers)):
        if runs and number == runs[-1][1] + 1:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    return then.join(f"{low}" if low == high else f"{low}{to}{high}" for low, high in runs)


def write_json(path: Path, document: Mapping[str, Any]) -> None:
    """Write a document as JSON, with the version of eomcheck."""
    text = json.dumps({"eomcheck": __version__, **document}, indent=1, ensure_ascii=False)
    write_text(path, text + "\n")


# ---- Templates -----------------------------------------------------------------------------------

EXTRA = "it comes with the extra `report`"


def environment() -> Environment:
    """Return the jinja2 environment; HTML is escaped, Markdown is not.

    Raises:
        EngineError: jinja2 is not installed.
    """
    jinja2 = required("jinja2", "report")
    templates = jinja2.Environment(
        loader=jinja2.PackageLoader("eomcheck.lab.report"),
        autoescape=jinja2.select_autoescape(["html.j2"], default=False),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        finalize=lambda value: without_control_characters(value) if type(value) is str else value,
    )
    templates.filters["number"] = number_text
    templates.filters["md"] = escaped
    return templates


def render(template: str, **values: Any) -> str:
    """Return a template filled in with values."""
    return environment().get_template(template).render(**values)


def number_text(value: float) -> str:
    """Return a number with two digits, such as "3.1e-14"."""
    return "0" if value == 0 else f"{value:.1e}" if abs(value) < 0.01 else f"{value:.3g}"
