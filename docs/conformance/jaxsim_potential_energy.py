"""JaxSim's potential energy has the wrong sign: it falls where a mass is raised.

`potential_energy` multiplies mass and height by `model.gravity`, which is -9.8: a model is built
with the negative of its argument. Forces of gravity are right.
"""

import jaxsim.api as js

SDF = """<sdf version="1.7"><model name="one"><link name="body"><inertial><mass>2</mass>
<inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz><ixy>0</ixy><ixz>0</ixz><iyz>0</iyz></inertia>
</inertial></link></model></sdf>"""

model = js.model.JaxSimModel.build_from_model_description(SDF, gravity=10.0)
low, high = (
    js.model.potential_energy(
        model, js.data.JaxSimModelData.build(model=model, base_position=[0.0, 0.0, z])
    )
    for z in (0.0, 1.0)
)
print("energy to raise 2 kg by 1 m:", float(high - low), "J, expected 20.0 J")
