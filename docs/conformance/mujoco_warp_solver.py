"""MuJoCo Warp refuses a file that asks for the solver PGS, which has no part in its dynamics.

Without constraints no solver is needed.
"""

import mujoco
import mujoco_warp

MJCF = """<mujoco><option solver="{}"/><worldbody><body><joint axis="0 0 1"/>
<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body></worldbody></mujoco>"""

for solver in ("Newton", "PGS"):
    try:
        mujoco_warp.put_model(mujoco.MjModel.from_xml_string(MJCF.format(solver)))
        print(solver, "is read")
    except NotImplementedError as error:
        print(solver, error)
