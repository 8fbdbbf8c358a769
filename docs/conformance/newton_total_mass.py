"""Newton leaves out `settotalmass` of an MJCF file, its issue 3689.

The mass of 2 kg is to be scaled to 14 kg, as MuJoCo scales that of `half_cheetah.xml`.
"""

import newton

MJCF = """
<mujoco><compiler settotalmass="14"/><worldbody><body><joint type="slide"/>
<inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/></body></worldbody></mujoco>
"""

builder = newton.ModelBuilder()
builder.add_mjcf(MJCF)
print("mass:", builder.body_mass[0], "kg, expected 14.0 kg")
