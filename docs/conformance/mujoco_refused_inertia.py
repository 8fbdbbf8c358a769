"""MuJoCo refuses moments of inertia that no body can have, unless they are to be balanced.

Of moments about three axes none is larger than the sum of the others: 1, 1 and 3 kg m² are not.
Balanced ones are others.
"""

import mujoco
import numpy as np

MJCF = """<mujoco><compiler balanceinertia="{}"/><worldbody><body><joint axis="0 0 1"/>
<inertial pos="0 0 0" mass="1" diaginertia="1 1 {}"/></body></worldbody></mujoco>"""

for balanced, moment in (("false", 2.0), ("false", 3.0), ("true", 3.0)):
    try:
        model = mujoco.MjModel.from_xml_string(MJCF.format(balanced, moment))
    except ValueError as error:
        print(balanced, moment, error)
        continue
    data, M = mujoco.MjData(model), np.zeros((1, 1))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, M)
    print(balanced, moment, "M", M.item())
