"""PyBullet takes the point of `calculateJacobian` along the principal axes, not in the link frame.

`help(pybullet.calculateJacobian)`: "localPosition: coordinates defined in the link frame". Its
origin is that of the link frame, but its axes are those of the `inertial` element, turned by its
rpy. Here they are turned by 90 degrees about z, and the point lies on the x axis of the link, about
whose z axis the link turns: the velocity of the point is along y, and is reported along x.
"""

import tempfile
from pathlib import Path

import pybullet

URDF = """<robot name="r"><link name="ground"><inertial><mass value="0"/>
<inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="arm"><inertial><origin rpy="0 0 1.5707963267948966"/><mass value="1"/>
<inertia ixx="1" iyy="2" izz="2.5" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="ground"/><child link="arm"/>
<axis xyz="0 0 1"/></joint></robot>"""

pybullet.connect(pybullet.DIRECT)
with tempfile.TemporaryDirectory() as folder:
    path = Path(folder, "r.urdf")
    path.write_text(URDF)
    flags = pybullet.URDF_USE_INERTIA_FROM_FILE
    robot = pybullet.loadURDF(str(path), useFixedBase=True, flags=flags)
linear, _ = pybullet.calculateJacobian(robot, 0, [1.0, 0.0, 0.0], [0.0], [0.0], [0.0])
print("point (1, 0, 0) m, 1 rad/s about z: velocity", [round(row[0], 3) for row in linear])
print("expected                                   ", [0.0, 1.0, 0.0])
