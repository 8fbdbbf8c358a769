"""PyBullet rounds the frame of a link, and its frame alone, to single precision.

`getLinkState` returns the pose of a link's centre of mass [0:2] with all digits of a double. The
pose of the link's own frame [4:6] is composed from it and the inertial frame [2:4] in float32, as
`b3Transform` of Bullet is. Here the centre of mass is the origin of the link, so that both are the
same point.
"""

import tempfile
from pathlib import Path

import numpy as np
import pybullet

URDF = """<robot name="r"><link name="ground"><inertial><mass value="0"/>
<inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="arm"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="ground"/><child link="arm"/>
<origin xyz="0.1 0.2 0.3"/><axis xyz="0 0 1"/></joint></robot>"""

pybullet.connect(pybullet.DIRECT)
with tempfile.TemporaryDirectory() as folder:
    path = Path(folder, "r.urdf")
    path.write_text(URDF)
    robot = pybullet.loadURDF(str(path), useFixedBase=True)
pybullet.resetJointState(robot, 0, 0.7)
state = pybullet.getLinkState(robot, 0, computeForwardKinematics=1)
true = np.array([0.1, 0.2, 0.3])
turn = np.array([0.0, 0.0, np.sin(0.35), np.cos(0.35)])
for name, position, quaternion in (("centre of mass", *state[:2]), ("link frame", *state[4:6])):
    error = np.abs(np.array(position) - true).max(), np.abs(np.array(quaternion) - turn).max()
    print(f"{name:14}: position off by {error[0]:.0e} m, quaternion by {error[1]:.0e}")
