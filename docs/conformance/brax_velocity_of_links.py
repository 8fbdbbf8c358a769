"""Velocities of links of Brax are wrong for joints beside the origin, and for several joints.

`kinematics.forward` leaves out the velocity of the origin about a joint at another point, and adds
the rates of the joints of one body along axes of different frames, as a TODO of it says.
"""

import warnings

import jax
import mujoco
import numpy as np

jax.config.update("jax_enable_x64", True)
with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    from brax import kinematics
    from brax.io import mjcf

HINGE = '<joint pos="{}" axis="{}"/>'
BODY = "<mujoco><worldbody><body>{}<geom size='0.1' mass='1'/></body></worldbody></mujoco>"
cases = {
    "a hinge at (0.5, 0, 0)": HINGE.format("0.5 0 0", "0 0 1"),
    "hinges about x and z": HINGE.format("0 0 0", "1 0 0") + HINGE.format("0 0 0", "0 0 1"),
}
for name, joints in cases.items():
    model = mujoco.MjModel.from_xml_string(BODY.format(joints))
    data, expected = mujoco.MjData(model), np.zeros(6)
    data.qpos[:], data.qvel[:] = 0.7, 1.0
    mujoco.mj_forward(model, data)
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, 1, expected, 0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        system = mjcf.load_model(model)
    _, xd = kinematics.forward(system, data.qpos.copy(), data.qvel.copy())
    print(name, "ang, vel:", np.round(xd.ang[0], 4), np.round(xd.vel[0], 4))
    print("   MuJoCo:", np.round(expected[:3], 4), np.round(expected[3:], 4))
