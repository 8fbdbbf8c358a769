"""The Jacobian of the centre of mass of iDynTree loses digits with the distance from the base.

`getCenterOfMassJacobian` divides by the inertia of all links about the base (6, 6). Its condition
number grows with the square of the distance of the centre of mass, until all entries are NaN. Here
a body slides along x and y: a velocity of 1 m/s of a joint is one of its centre of mass.
"""

import warnings

import numpy as np

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import idyntree.bindings as idt

moments, inertia = idt.RotationalInertia(), idt.SpatialInertia()
for i in range(3):
    for j in range(3):
        moments.setVal(i, j, 0.1 * (i == j))
inertia.fromRotationalInertiaWrtCenterOfMass(1.0, idt.Position.Zero(), moments)
model, links = idt.Model(), []
for name, content in (("ground", None), ("cart", None), ("body", inertia)):
    link = idt.Link()
    link.setInertia(content or idt.SpatialInertia.Zero())
    links.append(model.addLink(name, link))
for k, axis in enumerate(np.eye(3)[:2]):
    joint = idt.PrismaticJoint()
    joint.setAttachedLinks(links[k], links[k + 1])
    joint.setRestTransform(idt.Transform.Identity())
    line = idt.Axis(idt.Direction(*axis), idt.Position.Zero())
    joint.setAxis(line, links[k + 1], links[k])
    model.addJoint(f"slide {k}", joint)
model.setDefaultBaseLink(links[0])
dynamics, J = idt.KinDynComputations(), idt.MatrixDynSize(3, 8)
dynamics.loadRobotModel(model)
for distance in (1.0, 1e3, 1e6, 1e9):
    dynamics.setRobotState(np.array([0.3, 0.7]) * distance, np.zeros(2), np.zeros(3))
    dynamics.getCenterOfMassJacobian(J)
    print(f"{distance:.0e} m:", J.toNumPy()[:2, 6:].tolist(), "expected [[1, 0], [0, 1]]")
