"""Genesis refuses moments of inertia that no body can have.

Of moments about three axes none is larger than the sum of the others: 1, 1 and 3 kg m² are not. By
`recompute_inertia=True`, which its message names, they would be those of the shapes of the link.
"""

import genesis as gs

URDF = """<robot name="one"><link name="ground"/><link name="body"><inertial>
<mass value="1"/><inertia ixx="1" iyy="1" izz="{}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="turn" type="revolute"><parent link="ground"/><child link="body"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>"""

gs.init(backend=gs.cpu, precision="64", logging_level="error")
for moment in (2.0, 3.0):
    scene = gs.Scene(show_viewer=False)
    try:
        scene.add_entity(gs.morphs.URDF(file=URDF.format(moment), fixed=True))
        print(moment, "read")
    except gs.GenesisException as error:
        print(moment, str(error).partition(" Please")[0])
