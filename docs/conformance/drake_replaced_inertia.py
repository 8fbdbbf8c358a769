"""Drake replaces moments of inertia that no body can have by others, with a warning.

Of moments about three axes none is larger than the sum of the others. With 1, 1 and 3 kg m² the
mass matrix of a hinge about z is not 3.
"""

from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

URDF = """<robot name="r"><link name="ground"/>
<link name="arm"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="{}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="ground"/><child link="arm"/>
<axis xyz="0 0 1"/></joint></robot>"""

for moment in (2.0, 3.0):
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModelsFromString(URDF.format(moment), "urdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("ground"))
    plant.Finalize()
    context = plant.CreateDefaultContext()
    print("M", plant.CalcMassMatrixViaInverseDynamics(context).item(), "expected", moment)
