"""Robotics Toolbox reads axes of joints that are not along x, y or z, and dampers, wrongly.

It turns the frame of the joint about the axis by one radian, the length of the axis, and then takes
z of that frame. It reads `friction`, which is dry, as viscous, and no `damping`.
"""

import io

import numpy as np
import roboticstoolbox as rtb
from roboticstoolbox.models.URDF.URDFRobot import URDF_file

URDF = """<robot name="r"><link name="base"/><link name="arm"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="base"/><child link="arm"/>
<axis xyz="{axis}"/><dynamics damping="0.5" friction="0.2"/></joint></robot>"""

for axis in ("0 0 1", "0.6 0 0.8"):
    robot = rtb.ERobot(URDF_file(io.StringIO(URDF.format(axis=axis)))[0])
    print(f"axis {axis}: read as", robot.jacob0(np.zeros(1), end="arm")[3:, 0].round(3).tolist())
force = robot.rne(np.zeros(1), np.ones(1), np.zeros(1), gravity=[0, 0, 0])
print(f"torque at 1 rad/s: {force[0]}, expected 0.5 by damping")
