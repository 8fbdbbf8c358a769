"""The default gravity of adam in NumPy is rounded to float32, also where it computes in float64."""

from adam.numpy import KinDynComputations

URDF = """<robot name="one"><link name="ground"/><link name="body"><inertial>
  <origin xyz="0 0 0" rpy="0 0 0"/><mass value="1"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="turn" type="continuous"><origin xyz="0 0 0" rpy="0 0 0"/><axis xyz="0 0 1"/>
    <parent link="ground"/><child link="body"/><limit effort="1" velocity="1"/></joint></robot>"""

print(KinDynComputations(URDF, ["turn"]).g[2], "expected -9.80665")
