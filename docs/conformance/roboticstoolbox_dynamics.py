"""Robotics Toolbox: inverse dynamics of flipped joints and of fixed links, and `coriolis`.

`rne`, and so `inertia`, `gravload` and `accel`, takes a joint that turns about the negative of an
axis for one about the axis, and two links that are fixed to the same one for a chain. `coriolis`
raises for an `ERobot`: it copies the links, and the copies have the parents of the originals.
"""

import numpy as np
import roboticstoolbox as rtb
from roboticstoolbox import ET, ETS, Link


def link(name, parent, *elements):
    return Link(
        ETS([ET.tx(1.0), *elements]), name=name, parent=parent, m=1.0, r=[1, 0, 0], I=np.eye(3)
    )


for flip, coupling in ((False, 3.0), (True, -3.0)):
    base = Link(ETS(), name="base")
    first = link("first", base, ET.Rz())
    robot = rtb.ERobot([base, first, link("second", first, ET.Rz(flip=flip))])
    print(f"flip={flip}: M[0, 1] = {robot.inertia(np.zeros(2))[0, 1]}, expected {coupling}")

base = Link(ETS(), name="base")
first = link("first", base, ET.Rz())
robot = rtb.ERobot([base, first, link("left", first), link("right", first)])
# Each mass of 1 kg at 1 m from the axis, or at 2 m, with a moment of 1 kg m² each.
print(f"fixed links: M = {robot.inertia(np.zeros(1)).item()}, expected {1 + 4 + 4 + 3}")
try:
    robot.coriolis(np.zeros(1), np.ones(1))
except ValueError as error:
    print("coriolis raises", str(error)[:40])
