"""Pinocchio reads the dampers of a URDF, and leaves them out of its dynamics.

The hinge of 2 kg m² has a damper of 3 N m s/rad and turns with 2 rad/s about an upright axis: left
alone its acceleration is -3 rad/s², and to keep it turning takes 6 N m.
"""

import numpy as np
import pinocchio

URDF = """<robot name="r"><link name="ground"/>
<link name="arm"><inertial><mass value="1"/>
<inertia ixx="2" iyy="2" izz="2" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="ground"/><child link="arm"/>
<axis xyz="0 0 1"/><limit effort="1" velocity="9"/><dynamics damping="3"/></joint></robot>"""

model = pinocchio.buildModelFromXML(URDF)
data, q, v, none = model.createData(), pinocchio.neutral(model), np.array([2.0]), np.zeros(1)
print("damping read:", model.damping)
print("acceleration", pinocchio.aba(model, data, q, v, none), "expected [-3.]")
print("torque", pinocchio.rnea(model, data, q, v, none), "expected [6.]")
