"""Genesis gives a link without inertial that moves 1e-15 kg, its `gs.EPS`.

By the format of URDF such a link has no mass. Here it is 1 m from a hinge that turns 1e-6 kg m²:
M has nine digits. With the finger tips of hands, which are nearer and lighter, it has thirteen.
"""

import genesis as gs

URDF = """<robot name="one"><link name="ground"/><link name="body"><inertial>
<mass value="1e-3"/><inertia ixx="1e-6" iyy="1e-6" izz="1e-6" ixy="0" ixz="0" iyz="0"/></inertial>
</link>{}<joint name="turn" type="revolute"><parent link="ground"/><child link="body"/>
<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>"""
TIP = """<link name="tip"/><joint name="end" type="fixed"><parent link="body"/><child link="tip"/>
<origin xyz="1 0 0"/></joint>"""

gs.init(backend=gs.cpu, precision="64", logging_level="error")
for tip in ("", TIP):
    scene = gs.Scene(show_viewer=False)
    morph = gs.morphs.URDF(
        file=URDF.format(tip), fixed=True, merge_fixed_links=False, default_armature=0.0
    )
    robot = scene.add_entity(morph)
    scene.build()
    scene.step()
    masses = [link.desc.mass for link in robot.links]
    print("masses", masses, f"M = {float(robot.get_mass_mat()):.12g} kg m², expected 1e-06 kg m²")
