"""jinja2, set up for the templates of this folder."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from eomcheck.errors import required
from eomcheck.lab.show.markdown import escaped
from eomcheck.output import harmless

if TYPE_CHECKING:
    from jinja2 import Environment

EXTRA = "it comes with the extra `report`"


def environment() -> Environment:
    """Return the environment; HTML is escaped, Markdown is not.

    Raises:
        EngineError: jinja2 is not installed.
    """
    jinja2 = required("jinja2", "report")
    made = jinja2.Environment(
        loader=jinja2.PackageLoader("eomcheck.lab.report"),
        autoescape=jinja2.select_autoescape(["html.j2"], default=False),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        finalize=lambda value: harmless(value) if type(value) is str else value,
    )
    made.filters["number"] = number
    made.filters["md"] = escaped
    return made


def render(template: str, **values: Any) -> str:
    """Return a template filled in."""
    return environment().get_template(template).render(**values)


def number(value: float) -> str:
    """Return a number with two digits, such as "3.1e-14"."""
    return "0" if value == 0 else f"{value:.1e}" if abs(value) < 0.01 else f"{value:.3g}"
