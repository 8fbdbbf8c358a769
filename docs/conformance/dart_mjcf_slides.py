"""DART makes one joint of the slides of a body of an MJCF, and loses the names of all but one.

Slides along x and y become a `TranslationalJoint2D`. With a hinge behind them all three joints stay
as they are.
"""

import tempfile
from pathlib import Path

import dartpy

MJCF = """<mujoco><worldbody><body name="cart">
<joint name="along" type="slide" axis="1 0 0"/><joint name="across" type="slide" axis="0 1 0"/>{}
<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body></worldbody></mujoco>"""

for more, names in (("", []), ('<joint name="turn" axis="0 0 1"/>', ["turn"])):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "cart.xml")
        path.write_text(MJCF.format(more))
        world = dartpy.utils.MjcfParser.readWorld(dartpy.common.Uri(path.as_uri()))
    joints = [joint.getName() for joint in world.getSkeleton(0).getJoints()]
    print("joints", joints, "expected", ["along", "across", *names])
