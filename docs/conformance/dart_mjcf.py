"""DART reads no moments of inertia from an MJCF: each body has 1 kg m² about each axis.

`MjcfParser` sets the mass and the centre of mass alone, so that M, and all that depends on it, is
wrong for every file. A body without `pos` is moved to its centre of mass if that is given.
"""

import tempfile
from pathlib import Path

import dartpy
import numpy as np

MJCF = """<mujoco><worldbody><body name="rod" {pos}><joint name="turn" axis="0 1 0"/>
<inertial pos="0.5 0 0" mass="2" diaginertia="0.1 0.2 0.3"/><geom type="box" size=".5 .1 .1"/>
</body></worldbody></mujoco>"""

for pos in ('pos="0 0 0"', ""):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "rod.xml")
        path.write_text(MJCF.format(pos=pos))
        world = dartpy.utils.MjcfParser.readWorld(dartpy.common.Uri(path.as_uri()))
    rod = world.getSkeleton(0)
    moments = np.diag(rod.getBodyNode("rod").getInertia().getMoment())
    place = rod.getBodyNode("rod").getWorldTransform().translation()
    print(f"moments {moments.tolist()}, expected [0.1, 0.2, 0.3]; ", end="")
    print(f"body at {place.tolist()}, expected [0, 0, 0]")
