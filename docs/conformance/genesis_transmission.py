"""Genesis stops at a URDF with a `transmission` whose type is an attribute, as in Drake's acrobot.

It expects an element `type`, as ROS has it; no equation of motion has a part of a transmission.
"""

import genesis as gs

URDF = """<robot name="one"><link name="ground"/><link name="body"><inertial>
<mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="turn" type="continuous"><parent link="ground"/><child link="body"/>
<axis xyz="0 1 0"/></joint>{transmission}</robot>"""
TRANSMISSION = """<transmission type="SimpleTransmission" name="drive"><actuator name="motor"/>
<joint name="turn"/><mechanicalReduction>1</mechanicalReduction></transmission>"""

gs.init(backend=gs.cpu, precision="64", logging_level="critical")
for name, transmission in (("without", ""), ("with", TRANSMISSION)):
    scene = gs.Scene(show_viewer=False)
    file = URDF.format(transmission=transmission)
    try:
        scene.add_entity(gs.morphs.URDF(file=file, fixed=True))
        print(name, "transmission: read")
    except AttributeError as error:
        print(name, "transmission:", error)
