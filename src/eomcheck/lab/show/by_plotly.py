"""Charts as interactive figures of a page, drawn by plotly.

Colours are not in the figures: the page gives each formulation its own, in light and dark, and
dims the others where one is highlighted.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from html import escape
from textwrap import wrap
from typing import TYPE_CHECKING, Any

from eomcheck.errors import EngineError
from eomcheck.lab.show.chart import Axis, Chart, Line, Panel
from eomcheck.lab.show.style import STYLES
from eomcheck.lab.show.templating import EXTRA

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

try:
    import plotly.graph_objects as go
    from plotly.offline import get_plotlyjs
except ImportError as error:
    raise EngineError(f"the library 'plotly' is not installed ({error}); {EXTRA}") from None


def json_of(chart: Chart) -> str:
    """Return the figures as JSON that can stand in a page: the choices, one a line, as keys."""
    figures = {
        "\n".join(chosen): json.loads(figure_of(panel).to_json() or "{}")
        for chosen, panel in chart.panels.items()
    }
    return json.dumps(figures, ensure_ascii=False, allow_nan=False).replace("<", "\\u003c")


def figure_of(panel: Panel) -> Figure:
    """Return one panel as a figure."""
    figure = go.Figure(
        layout={
            "template": go.layout.Template(),
            "xaxis": _axis(panel.x),
            "yaxis": _axis(panel.y),
            "showlegend": False,
            "hovermode": "closest",
            "margin": {"l": 50, "r": 12, "t": 12, "b": 45},
        }
    )
    for line in panel.lines:
        if line.x:
            _add(figure, line)
    return figure


def _axis(axis: Axis) -> dict[str, Any]:
    made: dict[str, Any] = {"title": {"text": axis.title}, "automargin": True}
    if axis.categories:
        made |= {"type": "category", "categoryarray": list(axis.categories)}
    elif axis.log:
        made |= {"type": "log", "exponentformat": "power"}
    elif axis.range:
        made["range"] = axis.range
    if axis.unit:
        made |= {"exponentformat": "SI", "ticksuffix": axis.unit}
    if axis.ticks:
        made["tickvals"] = list(axis.ticks)
    return made


def _add(figure: Figure, line: Line) -> None:
    style = STYLES[line.key]
    symbols = [f"{style.symbol}-open" if flag else style.symbol for flag in line.hollow]
    look: dict[str, Any] = {"mode": "markers", "marker": {"symbol": "x-thin-open", "size": 7}}
    if line.look == "line":
        dash = "dot" if line.dashed or style.dashed else "solid"
        look = {
            "mode": "lines+markers" if line.joined else "markers",
            "line": {"width": 1.6, "dash": dash},
            "marker": {"symbol": symbols or style.symbol, "size": 8},
        }
    figure.add_scatter(
        x=list(line.x),
        y=list(line.y),
        name=line.key,
        meta={"formulation": line.key},
        hovertext=["<br>".join(_wrapped(lines)) for lines in line.said] or None,
        hovertemplate="%{hovertext}<extra></extra>" if line.said else None,
        **look,
    )


def _wrapped(lines: Sequence[str]) -> list[str]:
    """Return lines of a width that a telephone has room for, as plotly's markup."""
    return [escape(part, quote=False) for line in lines for part in wrap(line, 44)]


def plotly_js() -> str:
    """Return the source of plotly.js, for the page to hold."""
    return get_plotlyjs()
