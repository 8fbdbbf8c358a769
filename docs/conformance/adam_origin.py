"""adam cannot read a URDF in which an `<origin>` is left out.

In a URDF the origin of a joint or of an inertial is optional, and the identity where it is missing.
"""

from adam.numpy import KinDynComputations

ORIGIN = '<origin xyz="0 0 0" rpy="0 0 0"/>'
INERTIA = '<mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
URDF = """<robot name="one"><link name="ground"/>
  <link name="body"><inertial>{of_inertial}{inertia}</inertial></link>
  <joint name="turn" type="continuous">{of_joint}<axis xyz="0 0 1"/>
    <parent link="ground"/><child link="body"/></joint></robot>"""

for of_joint, of_inertial in ((ORIGIN, ORIGIN), ("", ORIGIN), (ORIGIN, "")):
    urdf = URDF.format(of_joint=of_joint, of_inertial=of_inertial, inertia=INERTIA)
    try:
        KinDynComputations(urdf, ["turn"])
        print("read")
    except AttributeError as error:
        print("without that of the", "inertial:" if of_joint else "joint:", error)
