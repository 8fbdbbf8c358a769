"""Newton puts all joints of an MJCF body at the `pos` of the first one.

A slide has its `pos` 1 m below the hinge that follows it on the same body, as in `hopper.xml` and
`walker2d_v5.xml` of Gymnasium. The hinge turns a point mass of 2 kg at a distance of 0.5 m, so its
entry of the mass matrix is 0.5 kg m², 2 kg (0.5 m)². Newton, for which it is 1 m lower, has 4.5.
"""

import newton

MJCF = """
<mujoco><worldbody><body>
<joint name="slide" type="slide" axis="1 0 0" pos="0 0 -1"/>
<joint name="hinge" type="hinge" axis="0 1 0" pos="0 0 0"/>
<inertial pos="0 0 0.5" mass="2" diaginertia="1e-3 1e-3 1e-3"/></body></worldbody></mujoco>
"""

builder = newton.ModelBuilder()
builder.add_mjcf(MJCF)
model = builder.finalize(device="cpu")
state = model.state()
newton.eval_fk(model, state.joint_q, state.joint_qd, state)
M = newton.eval_mass_matrix(model, state).numpy()[0]
print("entry of the hinge:", M[1, 1].round(3), "kg m², expected", 2 * 0.5**2 + 1e-3)
