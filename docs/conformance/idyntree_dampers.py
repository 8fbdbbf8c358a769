"""iDynTree leaves the dampers of a URDF out of its forces.

The hinge has a damper of 3 N m s/rad and turns with 2 rad/s about an upright axis: to keep it
turning takes 6 N m.
"""

import idyntree.bindings as idyntree
import numpy as np

URDF = """<robot name="r"><link name="ground"/>
<link name="arm"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="ground"/><child link="arm"/>
<axis xyz="0 0 1"/><dynamics damping="3"/></joint></robot>"""

loader = idyntree.ModelLoader()
loader.loadModelFromString(URDF)
dynamics = idyntree.KinDynComputations()
dynamics.loadRobotModel(loader.model())
still = np.zeros(6)
dynamics.setRobotState(np.eye(4), [0.0], still, [2.0], np.array([0.0, 0.0, -9.81]))
torques = idyntree.FreeFloatingGeneralizedTorques(dynamics.model())
contacts = idyntree.LinkWrenches(dynamics.model())
dynamics.inverseDynamics(still, [0.0], contacts, torques)
print("torque", torques.jointTorques().toNumPy(), "expected [6.]")
print("damping read:", dynamics.model().getJoint(0).getDamping(0))
