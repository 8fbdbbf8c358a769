"""How formulations and integrators are told apart in every figure: colour, marker, line."""

from __future__ import annotations

from typing import NamedTuple

from eomcheck.formulations import FORMULATIONS
from eomcheck.motion.integrators import INTEGRATORS

PALETTE = (
    # Okabe and Ito's, told apart by colour-blind readers, without its yellow, too pale on white;
    # then Tol's wine, and two to spare
    *("#000000", "#0072B2", "#E69F00", "#009E73", "#CC79A7"),
    *("#56B4E9", "#D55E00", "#882255", "#999933", "#888888"),
)
WRONG = "#B00020"
"""What must not be: a limit that is passed, an error that nobody told."""


class Style(NamedTuple):
    """How the lines of one formulation or integrator look.

    Attributes:
        color: "#rrggbb", for a white background.
        marker: matplotlib's sign.
        symbol: the same as plotly calls it.
        dashed: whether its lines are.
        width: of its lines, pt.
    """

    color: str
    marker: str
    symbol: str
    dashed: bool = False
    width: float = 1.2


_SIGNS = tuple(
    zip(
        "osD^vP*Xh<",
        (
            *("circle", "square", "diamond", "triangle-up", "triangle-down"),
            *("cross", "star", "x", "hexagon", "triangle-left"),
        ),
        strict=True,
    )
)
STYLES = {
    key: Style(color, *signs)
    for key, color, signs in zip(FORMULATIONS, PALETTE, _SIGNS, strict=False)
} | {
    # Integrators leave black out: some figures show them beside a formulation.
    key: Style(PALETTE[1 + i % (len(PALETTE) - 1)], *_SIGNS[i % len(_SIGNS)], dashed=kind.implicit)
    for i, (key, kind) in enumerate(INTEGRATORS.items())
}
STYLES |= {
    "one sign flipped": Style(WRONG, "x", "x-thin-open"),
    "allowed by rounding": Style(PALETTE[-1], "_", "line-ew-open"),
    "drawn at random": Style(PALETTE[1], "s", "square"),
    "climbed to": Style(PALETTE[6], "o", "circle"),
    "links": Style("#404040", "o", "circle", width=3.0),
    "wheels": Style(PALETTE[6], "", "", width=6.0),
}
"""Key of a formulation, an integrator or what else is drawn -> its style. Implicit integrators are
dashed."""
