"""Genesis adds 0.1 kg m² of armature to every joint of a URDF, unless `default_armature` says less.

It is the default of the option, and in its documentation; the mass matrix is another one by it.
"""

import genesis as gs

URDF = """<robot name="one"><link name="ground"/><link name="body"><inertial>
<origin xyz="0.3 0 0.1" rpy="0 0 0"/><mass value="2"/>
<inertia ixx="0.01" iyy="0.02" izz="0.015" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="turn" type="revolute"><parent link="ground"/><child link="body"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>"""

gs.init(backend=gs.cpu, precision="64", logging_level="error")
for options in ({}, {"default_armature": 0.0}):
    scene = gs.Scene(show_viewer=False)
    robot = scene.add_entity(gs.morphs.URDF(file=URDF, fixed=True, **options))
    scene.build()
    scene.step()
    print(options, "M =", float(robot.get_mass_mat()), "kg m², expected 0.22 kg m²")
