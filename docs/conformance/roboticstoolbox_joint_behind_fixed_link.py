"""Robotics Toolbox: inverse dynamics of a joint behind a link that is fixed to another one.

`rne`, and so `inertia`, `gravload` and `accel`, leaves out where the fixed link is: here 1 m from
the first joint. `fkine` and Jacobians are right.
"""

import numpy as np
import roboticstoolbox as rtb
from roboticstoolbox import ET, ETS, Link

base = Link(ETS(), name="base")
first = Link(ETS([ET.Rz()]), name="first", parent=base)
fixed = Link(ETS([ET.tx(1.0)]), name="fixed", parent=first)
# A mass of 1 kg, 1 m from the second joint: 2 m from the first one.
second = Link(ETS([ET.Rz()]), name="second", parent=fixed, m=1.0, r=[1, 0, 0])
robot = rtb.ERobot([base, first, fixed, second])
print("origin of the second link:", robot.fkine(np.zeros(2), end="second").t, "expected [1 0 0]")
print("M =", robot.inertia(np.zeros(2)).tolist(), "expected [[4, 2], [2, 1]]")
