"""DART's free joint keeps ten digits of a small rotation.

Positions of `FreeJoint` begin with a rotation vector. Below 1e-3 rad its matrix is the sum of three
terms of the exponential series, and the fourth is up to 1.7e-10. From 1e-3 rad on all digits are
right.
"""

import dartpy
import numpy as np

skeleton = dartpy.dynamics.Skeleton()
joint, body = skeleton.createFreeJointAndBodyNodePair()
for angle in (1e-4, 9.99e-4, 1e-3, 1e-2):
    skeleton.setPositions(np.array([angle, 0.0, 0.0, 0.0, 0.0, 0.0]))
    R = body.getWorldTransform().rotation()
    error, skew = abs(R[2, 1] - np.sin(angle)), np.abs(R.T @ R - np.eye(3)).max()
    print(f"{angle:.2e} rad: sine off by {error:.0e}, R^T R - 1 is {skew:.0e}")
