"""Brax rounds and loses poses behind a body without joints when it reads an MJCF.

`mjcf.load` merges such bodies into their parents. It writes positions with six decimals, and it
moves nothing where the body is turned but not shifted, or turned by anything but `quat`.
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

XML = """<mujoco><worldbody><body {}>
  <body pos="0.123456789 0.2 0.3"><joint axis="0 0 1"/><geom size="0.1" mass="1"/></body>
</body></worldbody></mujoco>"""
for mount in ('pos="1 0 0"', 'quat="0.6 0.8 0 0"', 'pos="1 0 0" euler="90 0 0"'):
    xml = XML.format(mount)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        system = mjcf.loads(xml)
    x, _ = kinematics.forward(system, np.zeros(1), np.zeros(1))
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    print(mount, "origin:", x.pos[0], "MuJoCo:", data.xpos[-1])
