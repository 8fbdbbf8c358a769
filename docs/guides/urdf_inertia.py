"""MuJoCo with a model that it reads from a URDF, the inertia of each link along tilted axes."""

import math

import mujoco
import numpy as np

from eomcheck import Engine
from eomcheck.scenes import ChainPendulum

TILT = 1.0
"""rad, about x."""


def urdf(chain):
    """Return the chain; moments 1.5 J, 2 J, J along tilted axes make I = J (1 + sin²) about z."""
    parts, before, place = ['<robot name="chain"><link name="ground"/>'], "ground", 0.0
    links = zip(chain.mass.tolist(), chain.length.tolist(), chain.inertia.tolist(), strict=True)
    for i, (m, length, moment) in enumerate(links):
        J = moment / (1 + math.sin(TILT) ** 2)
        parts.append(f"""
<link name="link{i}"><inertial>
  <origin xyz="{length / 2!r} 0 0" rpy="{TILT} 0 0"/><mass value="{m!r}"/>
  <inertia ixx="{1.5 * J!r}" iyy="{2 * J!r}" izz="{J!r}" ixy="0" ixz="0" iyz="0"/>
</inertial></link>
<joint name="joint{i}" type="continuous"><parent link="{before}"/><child link="link{i}"/>
  <origin xyz="{place!r} 0 0"/><axis xyz="0 0 1"/>
</joint>""")
        before, place = f"link{i}", length
    return "".join([*parts, "</robot>"])


class FromUrdf(Engine):
    """A chain of links as MuJoCo reads it from a URDF; its angles are relative."""

    @classmethod
    def version(cls):
        return f"mujoco {mujoco.__version__}"

    @classmethod
    def represents(cls, scene):
        return isinstance(scene, ChainPendulum)

    def __init__(self, scene):
        super().__init__(scene)
        self.model = mujoco.MjModel.from_xml_string(urdf(scene))
        self.model.opt.gravity[:] = 0.0
        self.data = mujoco.MjData(self.model)

    def velocity_map(self, q, v):
        S = np.eye(len(q)) - np.eye(len(q), k=-1)
        return S @ q, S, np.zeros(len(q))

    def _forward(self, x, rate):
        self.data.qpos[:], self.data.qvel[:] = x, rate
        mujoco.mj_fwdPosition(self.model, self.data)
        mujoco.mj_fwdVelocity(self.model, self.data)

    def mass_matrix(self, q, t=0.0):
        self._forward(q, np.zeros_like(q))
        columns = np.zeros((len(q), len(q)))
        for column, unit in zip(columns, np.eye(len(q)), strict=True):
            mujoco.mj_mulM(self.model, self.data, column, unit)
        return columns

    def bias(self, q, v, t=0.0):
        self._forward(q, v)
        return self.data.qfrc_bias.copy()
