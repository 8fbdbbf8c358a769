"""Interactive charts: panels of lines, of which one is shown, as the reader chooses.

Colours are not in the figures: the page gives each formulation its own, in light and dark, and
dims the others where one is highlighted.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from textwrap import wrap
from typing import TYPE_CHECKING, Any, NamedTuple

from eomcheck.errors import EngineError
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.show.templating import EXTRA

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

try:
    import plotly.graph_objects as go
    from plotly.offline import get_plotlyjs
except ImportError as error:
    raise EngineError(f"the library 'plotly' is not installed ({error}); {EXTRA}") from None

SYMBOLS = dict(
    zip(
        FORMULATIONS,
        (
            *("circle", "square", "diamond", "triangle-up", "triangle-down"),
            *("cross", "star", "x", "hexagon", "triangle-left"),
        ),
        strict=False,
    )
)
"""The markers of `figures.MARKERS`, as plotly calls them."""


class Axis(NamedTuple):
    """An axis: its title with the unit, in logarithms, of categories in order, over a range."""

    title: str
    log: bool = False
    categories: Sequence[str] = ()
    range: tuple[float, float] | None = None
    ticks: Sequence[int] = ()

    def layout(self) -> dict[str, Any]:
        """Return it as plotly's layout."""
        made: dict[str, Any] = {"title": {"text": self.title}, "automargin": True}
        if self.categories:
            made |= {"type": "category", "categoryarray": list(self.categories)}
        elif self.log:
            made |= {"type": "log", "exponentformat": "power"}
        elif self.range:
            made["range"] = self.range
        if self.ticks:
            made["tickvals"] = list(self.ticks)
        return made


LINKS = Axis("number of links N", log=True, ticks=(1, 2, 3, 5, 7, 10, 20, 30, 50, 70, 100, 1000))


class Panel:
    """One figure of a chart."""

    def __init__(self, x: Axis, y: Axis):
        self.figure: Figure = go.Figure(
            layout={
                "template": go.layout.Template(),
                "xaxis": x.layout(),
                "yaxis": y.layout(),
                "showlegend": False,
                "hovermode": "closest",
                "margin": {"l": 50, "r": 12, "t": 12, "b": 45},
            }
        )

    def line(
        self,
        key: str,
        x: Sequence[Any],
        y: Sequence[Any],
        said: Sequence[Sequence[str]],
        dashed: bool = False,
        hollow: Sequence[bool] = (),
    ) -> None:
        """Add a line of a formulation; `said` are the lines of text at each point."""
        symbol = SYMBOLS[key]
        symbols = [f"{symbol}-open" if flag else symbol for flag in hollow] or symbol
        self._add(
            key,
            {"x": list(x), "y": list(y)},
            said,
            mode="lines+markers",
            line={"width": 1.6, "dash": "dot" if dashed else "solid"},
            marker={"symbol": symbols, "size": 8},
        )

    def crosses(
        self, key: str, x: Sequence[Any], height: float, said: Sequence[Sequence[str]]
    ) -> None:
        """Add crosses of a formulation, all at one height."""
        at = {"x": list(x), "y": [height] * len(x)}
        self._add(key, at, said, mode="markers", marker={"symbol": "x-thin-open", "size": 7})

    def _add(self, key: str, at: dict[str, list], said: Sequence[Sequence[str]], **style: Any):
        if not said:
            return
        text = ["<br>".join(_wrapped(lines)) for lines in said]
        self.figure.add_scatter(
            **at,
            **style,
            name=key,
            meta={"formulation": key},
            hovertext=text,
            hovertemplate="%{hovertext}<extra></extra>",
        )


def _wrapped(lines: Sequence[str]) -> list[str]:
    """Return lines of a width that a telephone has room for, as plotly's markup."""
    return [escape(part, quote=False) for line in lines for part in wrap(line, 44)]


@dataclass
class Chart:
    """A figure with lists to choose from.

    Attributes:
        id: its name in the page.
        title: what it shows.
        choices: name of a list -> what can be chosen in it.
        panels: what was chosen in each list -> the panel to show.
    """

    id: str
    title: str
    choices: dict[str, list[str]]
    panels: dict[tuple[str, ...], Panel] = field(default_factory=dict)

    def panel(self, chosen: tuple[str, ...], x: Axis, y: Axis) -> Panel:
        """Add the panel that is shown for these choices."""
        self.panels[chosen] = made = Panel(x, y)
        return made

    def json(self) -> str:
        """Return the figures as JSON that can stand in a page: the choices, one a line, as keys."""
        figures = {
            "\n".join(chosen): json.loads(panel.figure.to_json() or "{}")
            for chosen, panel in self.panels.items()
        }
        return json.dumps(figures, ensure_ascii=False, allow_nan=False).replace("<", "\\u003c")


def plotly_js() -> str:
    """Return the source of plotly.js, for the page to hold."""
    return get_plotlyjs()
