"""Drake refuses a fixed joint that mimics another one, which needs no coordinate to follow."""

from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

URDF = """<robot name="r"><link name="ground"/><link name="arm"/><link name="end"/>
<joint name="hinge" type="continuous"><parent link="ground"/><child link="arm"/>
<axis xyz="0 0 1"/></joint>
<joint name="weld" type="fixed"><parent link="arm"/><child link="end"/>{}</joint></robot>"""

for mimic in ("", '<mimic joint="hinge"/>'):
    plant = MultibodyPlant(0.0)
    try:
        Parser(plant).AddModelsFromString(URDF.format(mimic), "urdf")
        print("read:", mimic or "without mimic")
    except RuntimeError as error:
        print(mimic, error)
