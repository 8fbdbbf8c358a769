"""Brax does not turn the axis of a sliding joint with the link that carries it.

`dynamics.transform_com` rotates the angular part of a joint's motion to the axes of the world and
not the linear one. So the mass matrix, forces and accelerations of a slide behind a hinge are wrong
unless the hinge is at 0. MuJoCo compiles the same model.
"""

import warnings

import jax
import mujoco
import numpy as np

jax.config.update("jax_enable_x64", True)
with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    from brax.generalized import dynamics, pipeline
    from brax.io import mjcf

    XML = """<mujoco><worldbody><body>
      <joint name="turn" axis="0 0 1"/><geom size="0.1" mass="1"/>
      <body pos="0.2 0 0"><joint name="slide" type="slide" axis="1 0 0"/>
        <geom size="0.1" pos="0 0.3 0" mass="2"/>
    </body></body></worldbody></mujoco>"""
    system = mjcf.loads(XML)
model = mujoco.MjModel.from_xml_string(XML)
data, M = mujoco.MjData(model), np.zeros((2, 2))
for turn in (0.0, 0.7):
    data.qpos[:], data.qvel[:] = (turn, 0.3), (1.0, 2.0)
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, M)
    state = pipeline.init(system, data.qpos.copy(), data.qvel.copy())
    bias = dynamics.inverse(system, state)
    print(f"turn = {turn}: M", np.round(state.mass_mx, 4).tolist(), "bias", np.round(bias, 4))
    print("      MuJoCo: M", np.round(M, 4).tolist(), "bias", np.round(data.qfrc_bias, 4))
