"""DART's inverse of M is not that of its M where a weld joint stands between joints that move.

`getInvMassMatrix` of two hinges is right; with a body between them that is welded to the first it
loses all coupling of the two. `ZeroDofJoint::addChildBiasForceForInvMassMatrix` and its like, of
the recursion behind it, are empty ("TODO"). Fixed joints of a URDF are such joints.
`computeForwardDynamics` is right: its accelerations from rest under unit forces are the inverse.
"""

import dartpy
import numpy as np

for kinds in (["Revolute", "Revolute"], ["Revolute", "Weld", "Revolute"]):
    skeleton, body = dartpy.dynamics.Skeleton(), None
    skeleton.setGravity(np.zeros(3))
    for kind in kinds:
        joint, body = getattr(skeleton, f"create{kind}JointAndBodyNodePair")(body)
        seat = dartpy.math.Isometry3(np.eye(3), np.array([1.0, 0.0, 0.0]))
        joint.setTransformFromParentBodyNode(seat)
        body.setInertia(dartpy.dynamics.Inertia(1.0, np.array([0.5, 0.0, 0.0]), np.eye(3)))
    skeleton.setPositions(np.array([0.3, 0.7]))
    columns = []
    for unit in np.eye(2):
        skeleton.setForces(unit)
        skeleton.computeForwardDynamics()
        columns.append(skeleton.getAccelerations())
    print(", ".join(kinds))
    print("getInvMassMatrix       ", skeleton.getInvMassMatrix().round(4).tolist())
    print("inverse of getMassMatrix", np.linalg.inv(skeleton.getMassMatrix()).round(4).tolist())
    print("computeForwardDynamics ", np.array(columns).T.round(4).tolist())
