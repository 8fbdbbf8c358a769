"""Ticks of axes by matplotlib, so that numbers stand apart."""

from __future__ import annotations

import numpy as np
from matplotlib.axis import XAxis, YAxis
from matplotlib.ticker import (
    EngFormatter,
    FixedFormatter,
    FixedLocator,
    LogLocator,
    MaxNLocator,
    NullFormatter,
    NullLocator,
    StrMethodFormatter,
)

from eomcheck.lab.show.panel import Axis


def tick(drawn: XAxis | YAxis, axis: Axis) -> None:
    """Choose ticks once the limits are known, so that the numbers of a narrow panel stand apart."""
    low, high = drawn.get_view_interval()
    if axis.categories:
        # As many as there is room for, the last one among them.
        step = -(-len(axis.categories) // 4)
        places = range(len(axis.categories) - 1, -1, -step)
        drawn.set_ticks(places, [axis.categories[place] for place in places], fontsize=8)
    elif axis.ticks:
        ticks = [tick for tick in axis.ticks if low <= tick <= high]
        drawn.set_major_locator(FixedLocator(ticks))
        drawn.set_major_formatter(FixedFormatter([f"{tick:g}" for tick in ticks]))
        drawn.set_minor_locator(NullLocator())
    elif axis.log:
        decades = np.log10(high / low)
        subs = (1.0, 2.0, 5.0) if decades < 1 else (1.0, 3.0) if decades < 2 else (1.0,)
        # Within a factor of four LogLocator would take as many ticks as it likes.
        narrow = decades < np.log10(4)
        drawn.set_major_locator(MaxNLocator(3) if narrow else LogLocator(subs=subs, numticks=5))
        drawn.set_minor_formatter(NullFormatter())
        if decades < 2:
            drawn.set_major_formatter(StrMethodFormatter("{x:g}"))
    if axis.unit:
        drawn.set_major_formatter(EngFormatter(axis.unit))
