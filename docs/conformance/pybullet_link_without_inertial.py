"""PyBullet gives a link without inertial 1 kg, and 1 kg m² about each axis.

By the format of URDF such a link has no mass. The hook here carries nothing else: what turns is
0.5 kg at 2 m, 2 kg m².
"""

import tempfile
from pathlib import Path

import pybullet

URDF = """<robot name="r"><link name="ground"/>
<link name="arm"><inertial><origin xyz="2 0 0"/><mass value="0.5"/>
<inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>{hook}
<joint name="hinge" type="continuous"><parent link="ground"/><child link="arm"/>
<axis xyz="0 0 1"/></joint></robot>"""
HOOK = """<link name="hook"/><joint name="end" type="fixed"><parent link="arm"/>
<child link="hook"/><origin xyz="2 0 0"/></joint>"""

pybullet.connect(pybullet.DIRECT)
for name, hook in (("without hook", ""), ("with hook", HOOK)):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "r.urdf")
        path.write_text(URDF.format(hook=hook))
        flags = pybullet.URDF_USE_INERTIA_FROM_FILE
        robot = pybullet.loadURDF(str(path), useFixedBase=True, flags=flags)
    joints = [0.0] * sum(pybullet.getJointInfo(robot, j)[2] != 4 for j in range(1 + bool(hook)))
    print(name, pybullet.calculateMassMatrix(robot, joints), "expected", 2.0)
