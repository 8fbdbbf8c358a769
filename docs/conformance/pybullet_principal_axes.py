"""PyBullet keeps ten digits of an inertia that is tilted about three axes.

Bullet turns each inertia to its principal axes by an iteration that ends early, and forgets what is
left beside the diagonal. About z the inertia is 2.5 kg m² in all three.
"""

import tempfile
from pathlib import Path

import pybullet

URDF = """<robot name="r"><link name="ground"/>
<link name="arm"><inertial><mass value="1"/>
<inertia ixx="1" iyy="2" izz="2.5" ixy="{}" ixz="{}" iyz="{}"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="ground"/><child link="arm"/>
<axis xyz="0 0 1"/></joint></robot>"""

pybullet.connect(pybullet.DIRECT)
for products in ((0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.1, 0.2, 0.3)):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "r.urdf")
        path.write_text(URDF.format(*products))
        flags = pybullet.URDF_USE_INERTIA_FROM_FILE
        robot = pybullet.loadURDF(str(path), useFixedBase=True, flags=flags)
    ((M,),) = pybullet.calculateMassMatrix(robot, [0.0])
    print(f"products {products}: M {M:.15g} expected 2.5, off by {abs(M - 2.5):.0e}")
