"""PyBullet's inverse dynamics leaves out the damper of a URDF that its own simulation has.

The hinge has a damper of 3 N m s/rad and turns with 2 rad/s about an upright axis: to keep it
turning takes 6 N m.
"""

import tempfile
from pathlib import Path

import pybullet

URDF = """<robot name="r"><link name="ground"/>
<link name="arm"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="ground"/><child link="arm"/>
<axis xyz="0 0 1"/><dynamics damping="3"/></joint></robot>"""

pybullet.connect(pybullet.DIRECT)
with tempfile.TemporaryDirectory() as folder:
    path = Path(folder, "r.urdf")
    path.write_text(URDF)
    robot = pybullet.loadURDF(str(path), useFixedBase=True)
print("damping read:", pybullet.getJointInfo(robot, 0)[6])
print("torque", pybullet.calculateInverseDynamics(robot, [0.0], [2.0], [0.0]), "expected (6.0,)")
