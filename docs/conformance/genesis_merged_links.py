"""Genesis changes the joints of a URDF, unless `merge_fixed_links` is off: it is on by default.

It writes the file anew without fixed joints, also where there are none. In that text axes have
eight decimals, and a pitch within 1.4e-6 rad of a right angle, as 1.570796 is, is a right angle.
"""

import genesis as gs
import numpy as np

AXIS = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)
URDF = f"""<robot name="one"><link name="ground"/><link name="body"><inertial>
<mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="turn" type="revolute"><origin xyz="0 0 0" rpy="0 1.570796 0"/><parent link="ground"/>
<child link="body"/><axis xyz="{AXIS[0]} {AXIS[1]} {AXIS[2]}"/>
<limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>"""

gs.init(backend=gs.cpu, precision="64", logging_level="error")
for options in ({}, {"merge_fixed_links": False}):
    scene = gs.Scene(show_viewer=False)
    robot = scene.add_entity(gs.morphs.URDF(file=URDF, fixed=True, **options))
    w, _, y, _ = robot.get_link("body").desc.quat
    pitch = 2.0 * np.arctan2(y, w)
    axis = robot.get_joint("turn").desc.dofs_motion_ang[0]
    print(options, f"pitch {pitch:.9f}, expected 1.570796000; ", end="")
    print(f"axis off by {np.abs(axis - AXIS).max():.0e}")
