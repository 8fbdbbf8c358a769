"""Newton refuses the constraint solver PGS of an MJCF file, as in `humanoid.xml` of Gymnasium.

PGS is one of the three solvers that MuJoCo knows. Nothing that is asked here depends on it, and
with `parse_mujoco_options=False` the file is read.
"""

import newton

MJCF = """
<mujoco><option solver="PGS"/>
<worldbody><body><joint/><geom size="0.1"/></body></worldbody></mujoco>
"""

for options in (True, False):
    builder = newton.ModelBuilder()
    try:
        builder.add_mjcf(MJCF, parse_mujoco_options=options)
        print("read, mass", round(builder.body_mass[0], 3), "kg")
    except ValueError as error:
        print("ValueError:", error)
