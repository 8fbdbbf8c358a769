"""Charts as interactive plotly figures for an HTML page.

Colors are not in the figures: the page assigns one to each formulation, in light and dark mode, and
dims the others when one is highlighted.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from html import escape
from itertools import pairwise
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np

from eomcheck.errors import EngineError
from eomcheck.lab.show.chart import STYLES, Axis, Chart, Heat, Line, Panel
from eomcheck.lab.show.table import EXTRA, seconds_text

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


try:
    import plotly.graph_objects as go
    from plotly.offline import get_plotlyjs
except ImportError as error:
    raise EngineError(f"the library 'plotly' is not installed ({error}); {EXTRA}") from None


def chart_json(chart: Chart) -> str:
    """Return the figures of a chart as JSON that can be embedded in HTML; keys are choices, one a
    line.
    """
    figures = {
        "\n".join(chosen): json.loads(figure_of(panel).to_json() or "{}")
        for chosen, panel in chart.panels.items()
    }
    return json.dumps(figures, ensure_ascii=False, allow_nan=False).replace("<", "\\u003c")


def figure_of(panel: Panel | Heat) -> Figure:
    """Return the plotly figure of one panel."""
    figure = go.Figure(
        layout={
            "template": go.layout.Template(),
            "showlegend": False,
            "hovermode": "closest",
            "margin": {"l": 50, "r": 12, "t": 12, "b": 45},
        }
    )
    if isinstance(panel, Heat):
        _add_heat(figure, panel)
        return figure
    for name in "xy":
        axis = getattr(panel, name)
        ticks = _ticks(axis, [x for line in panel.lines for x in getattr(line, name)])
        figure.update_layout({f"{name}axis": _axis(axis) | ticks})
    if panel.equal:
        figure.update_yaxes(scaleanchor="x")
    for line in panel.lines:
        if line.x:
            _add(figure, line)
    return figure


def _add_heat(figure: Figure, heat: Heat) -> None:
    edges = heat.edges
    low, high = heat.colors.range or (None, None)
    centres = [(a + b) / 2 for a, b in pairwise(edges)]
    # Rows by number: plotly 7 draws no heat map with fewer rows than its axis has categories.
    for row, (key, boxes) in enumerate(heat.rows.values()):
        figure.add_heatmap(
            x=edges,
            y=[row - 0.5, row + 0.5],
            z=[[None if box is None else box.value for box in boxes]],
            coloraxis="coloraxis",
            **_trace_options(key, [[() if box is None else box.hover_text for box in boxes]]),
        )
        for mark, symbol in (("hatched", "x-thin-open"), ("framed", "square-open")):
            marked = [x for x, b in zip(centres, boxes, strict=True) if b and getattr(b, mark)]
            if marked:
                marker = {"symbol": symbol, "size": 7}
                figure.add_scatter(
                    x=marked,
                    y=[row] * len(marked),
                    mode="markers",
                    marker=marker,
                    **_trace_options(key, ()),
                )
    ticks = {"tickvals": [k + 0.5 for k in range(len(heat.columns))]}
    bar = {"thickness": 12, "title": {"text": heat.colors.title, "side": "right"}}
    figure.update_layout(
        xaxis={"ticktext": list(heat.columns), "automargin": True, **ticks},
        yaxis={
            "tickvals": list(range(len(heat.rows))),
            "ticktext": list(heat.rows),
            "autorange": "reversed",
            "automargin": True,
        },
        coloraxis={"colorscale": "YlOrRd", "cmin": low, "cmax": high, "colorbar": bar},
    )


def _axis(axis: Axis) -> dict[str, Any]:
    layout: dict[str, Any] = {"title": {"text": axis.title}, "automargin": True}
    if axis.categories:
        layout |= {"type": "category", "categoryarray": list(axis.categories)}
    elif axis.log:
        layout |= {"type": "log", "exponentformat": "power"}
    elif axis.range:
        layout["range"] = axis.range
    if axis.unit:
        layout |= {"exponentformat": "SI", "ticksuffix": axis.unit}
    if axis.ticks:
        layout["tickvals"] = list(axis.ticks)
    return layout


MOST_TICKS = 9
"""Largest number of labels on a logarithmic axis of a page."""


def _ticks(axis: Axis, values: Sequence[Any]) -> dict[str, Any]:
    """Return the ticks of a logarithmic axis: powers of ten, or also 2 and 5 times these where the
    values lie within two decades; none where these are too few.
    """
    drawn = [x for x in values if isinstance(x, float | int) and 0 < x < np.inf]
    if not axis.log or axis.ticks or not drawn:
        return {}
    low, high = 0.9 * min(drawn), 1.1 * max(drawn)
    exponents = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    powers = [k for k in exponents if low <= 10.0**k <= high]
    if len(powers) > 2:
        powers = powers[:: -(-len(powers) // MOST_TICKS)]
        ticks = {10.0**k: _power(k) for k in powers}
    else:
        multiples = [float(f"{m}e{k}") for k in exponents for m in (1, 2, 5)]
        ticks = {x: f"{x:g}" for x in multiples if low <= x <= high}
    if len(ticks) < 2:
        return {}
    texts = [seconds_text(x) for x in ticks] if axis.unit == "s" else list(ticks.values())
    return {"tickvals": list(ticks), "ticktext": texts, "ticksuffix": ""}


def _power(exponent: int) -> str:
    """Return a power of ten as plotly's markup: as a number from 0.1 to 100."""
    if -1 <= exponent <= 2:
        return f"{10.0**exponent:g}"
    return f"10<sup>{exponent}</sup>".replace("-", "−")


def _add(figure: Figure, line: Line) -> None:
    style = STYLES[line.key]
    symbols = [f"{style.symbol}-open" if flag else style.symbol for flag in line.hollow]
    dash = "dot" if line.dashed or style.dashed or line.appearance == "dotted" else "solid"
    marks = {"crosses": "x-thin-open", "rings": "circle-open"}.get(line.appearance)
    lines = line.joined and not marks
    whole = "lines+markers" if style.symbol else "lines"
    mode = {"thin": "lines", "dotted": "lines"}.get(line.appearance, whole)
    figure.add_scatter(
        x=list(line.x),
        y=list(line.y),
        mode=mode if lines else "markers",
        line={"width": style.width + 0.4, "dash": dash},
        marker={"symbol": marks or symbols or style.symbol or None, "size": 7 if marks else 8},
        **_trace_options(line.key, line.hover_text),
    )


def _trace_options(key: str, hover_text: Sequence) -> dict[str, Any]:
    """Return the plotly options of a trace: its key, and the hover text of each point (or row of
    points).
    """

    def text(lines: Sequence) -> Any:
        nested = bool(lines) and not isinstance(lines[0], str)
        return [*map(text, lines)] if nested else "<br>".join(_wrapped(lines))

    options = {"name": key, "meta": {"formulation": key}}
    if not hover_text:
        return options
    return options | {"hovertext": text(hover_text), "hovertemplate": "%{hovertext}<extra></extra>"}


def _wrapped(lines: Sequence[str]) -> list[str]:
    """Return lines wrapped to the width of a telephone, escaped as plotly's markup."""
    return [escape(part, quote=False) for line in lines for part in wrap(line, 44)]


def plotly_js() -> str:
    """Return the source of plotly.js, to be embedded in the page."""
    return get_plotlyjs()
