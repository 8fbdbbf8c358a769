"""The families that cases are drawn from."""

from __future__ import annotations

from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene

Case = tuple[Scene, State]

ORDINARY, WIDE, SPECIAL, FAST = "ordinary", "wide", "special", "fast"
FAMILIES = ORDINARY, WIDE, SPECIAL, FAST
"""What a case is drawn from: the ranges of its kind; magnitudes of 16 decades; numbers at or next
to 0, ±π/2 and each other; speeds of 300 decades and angles of many turns."""

DECADES = 8.0
"""Magnitudes of `WIDE` parameters go from 10^-8 to 10^8."""
SPEEDS = 150.0
"""Components of `FAST` velocities go from 10^-150 to 10^150."""
FAR = 1e9
"""Coordinates of `FAST` states, m or rad, at most."""
