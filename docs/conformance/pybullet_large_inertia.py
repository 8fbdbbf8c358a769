"""PyBullet's mass matrix fails for a large tilted inertia: it takes rounding for a skew part.

Bullet turns the inertia to its principal axes and back, and then requires I(2,0) = I(0,2) to a
difference that is absolute. The inertia here is that of a link of KUKA's KR 210; a tenth of it is
accepted.
"""

import tempfile
from pathlib import Path

import pybullet

URDF = """<robot name="r"><link name="ground"><inertial><mass value="0"/>
<inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="arm"><inertial><origin xyz="0.5 0.1 0.2"/><mass value="{}"/>
<inertia ixx="{}" ixy="{}" ixz="{}" iyy="{}" iyz="{}" izz="{}"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="ground"/><child link="arm"/>
<axis xyz="0 1 0"/></joint></robot>"""
NUMBERS = 958.62, 180.42, -0.83462, 0.32549, 177.68, -20.82, 20.495

pybullet.connect(pybullet.DIRECT)
for factor in (0.1, 1.0):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "r.urdf")
        path.write_text(URDF.format(*(factor * x for x in NUMBERS)))
        flags = pybullet.URDF_USE_INERTIA_FROM_FILE
        robot = pybullet.loadURDF(str(path), useFixedBase=True, flags=flags)
    try:
        print(factor, pybullet.calculateMassMatrix(robot, [0.1]))
    except SystemError as error:  # "invalid inertia tensor for body 0 I(2,0)!=I(0,2)"
        print(factor, error)
