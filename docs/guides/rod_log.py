"""Log of a rod that swings under a torque: semi-implicit Euler, to standard output."""

import sys
from math import cos, sin

STEP, DAMPING = 0.002, float(sys.argv[1]) if sys.argv[1:] else 0.1
q, v = 0.5, 0.0
print("t,q[swing],v[swing],a[swing],tau[swing]")
for k in range(500):
    t = k * STEP
    tau = cos(3.0 * t)
    a = (tau - DAMPING * v - 2.0 * 9.81 * 0.5 * sin(q)) / (0.17 + 2.0 * 0.5**2)
    print(f"{t:.6g},{q:.9g},{v:.9g},{a:.9g},{tau:.9g}")
    v += STEP * a
    q += STEP * v
