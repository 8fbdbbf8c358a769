"""adam stops at every prismatic joint: its motion has twelve numbers instead of six.

`StdJoint.motion_subspace` stacks three arrays of three zeros below the axis, and not three zeros.
"""

from adam.numpy import KinDynComputations

URDF = """<robot name="one"><link name="ground"/><link name="body"><inertial>
  <origin xyz="0 0 0" rpy="0 0 0"/><mass value="1"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="joint" type="{}"><origin xyz="0 0 0" rpy="0 0 0"/><axis xyz="0 0 1"/>
    <parent link="ground"/><child link="body"/><limit effort="1" velocity="1"/></joint></robot>"""

for kind in ("continuous", "prismatic"):
    try:
        KinDynComputations(URDF.format(kind), ["joint"])
        print(kind, "joint: read")
    except ValueError as error:
        print(kind, "joint:", error)
