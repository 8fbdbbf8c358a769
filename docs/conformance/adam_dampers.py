"""adam leaves the dampers of a URDF out of its accelerations, which have no other forces.

The hinge of 2 kg m² has a damper of 3 N m s/rad and turns with 2 rad/s about an upright axis: its
acceleration is -3 rad/s².
"""

import numpy as np
from adam.numpy import KinDynComputations

URDF = """<robot name="r"><link name="ground"/>
<link name="arm"><inertial><origin xyz="0 0 0" rpy="0 0 0"/><mass value="1"/>
<inertia ixx="2" iyy="2" izz="2" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="ground"/><child link="arm"/>
<origin xyz="0 0 0" rpy="0 0 0"/><axis xyz="0 0 1"/><dynamics damping="3"/></joint></robot>"""

dynamics = KinDynComputations(URDF, ["hinge"])
at = np.eye(4), np.zeros(1), np.zeros(6), np.array([2.0])
M, forces = dynamics.mass_matrix(*at[:2]), dynamics.bias_force(*at)
print("M of the hinge", M[6, 6], "forces on it", forces[6], "expected 2.0 and 6.0")
