"""Newton leaves out the defaults of an MJCF whose outermost `default` has its class, "main", named.

MuJoCo calls the outermost class "main" in any case, and files that it saves name it. Here armature
is lost; damping, densities of geoms and all else that defaults give are as well.
"""

import newton

MJCF = """<mujoco><default{name}><joint armature="0.7"/></default><worldbody><body name="rod">
<joint name="turn" axis="0 1 0"/><geom type="box" size=".1 .1 .1"/></body></worldbody></mujoco>"""

for name in ("", ' class="main"'):
    builder = newton.ModelBuilder()
    builder.add_mjcf(MJCF.format(name=name))
    armature = builder.finalize(device="cpu").joint_armature.numpy().tolist()
    print(f"<default{name}>: armature {armature}, expected [0.7]")
