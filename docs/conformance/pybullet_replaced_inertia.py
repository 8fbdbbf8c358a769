"""PyBullet sets moments of inertia that no body can have to zero, with a warning.

Of moments about three axes none is larger than the sum of the others. With 1, 1 and 3 kg m² the
mass matrix of a hinge about z is 0.
"""

import tempfile
from pathlib import Path

import pybullet

URDF = """<robot name="r"><link name="ground"/>
<link name="arm"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="{}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="ground"/><child link="arm"/>
<axis xyz="0 0 1"/></joint></robot>"""

pybullet.connect(pybullet.DIRECT)
for moment in (2.0, 3.0):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "r.urdf")
        path.write_text(URDF.format(moment))
        flags = pybullet.URDF_USE_INERTIA_FROM_FILE
        robot = pybullet.loadURDF(str(path), useFixedBase=True, flags=flags)
    print("M", pybullet.calculateMassMatrix(robot, [0.0]), "expected", moment)
