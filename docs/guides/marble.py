"""A marble on a turntable: the table follows a clock, and the marble rolls on it."""

from eomcheck.descriptions.build import mechanism
from eomcheck.descriptions.elements import Joint, Link, drive, rolling_ball

RADIUS = 0.01
MOMENT = 0.4 * 0.02 * RADIUS**2  # of a homogeneous ball of 20 g

Marble = mechanism(
    "Marble",
    [
        Link("ground"),
        Link("table", mass=1.0, moments=(0.01, 0.01, 0.02)),
        Link("marble", mass=0.02, moments=(MOMENT, MOMENT, MOMENT)),
    ],
    [Joint("α", "revolute", "ground", "table"), Joint("m", "floating", "ground", "marble")],
    [drive("clock", "α", rate=7.0), *rolling_ball("rolls", "marble", "table", RADIUS)],
    dependent=("α", "m_z", "m_x", "m_y"),
    pose={"m_x": 0.1, "m_z": RADIUS},
)
