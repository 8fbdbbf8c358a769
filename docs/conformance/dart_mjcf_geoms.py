"""DART takes the mass of a body of an MJCF from its first `geom` alone, and no `settotalmass`.

It warns of the first. In MuJoCo the masses of all geoms are added, and scaled to the total.
"""

import tempfile
from pathlib import Path

import dartpy

MJCF = """<mujoco>{more}<worldbody><body name="rod"><joint name="turn" axis="0 1 0"/>
<geom type="box" size=".1 .1 .1" mass="2"/><geom type="box" size=".1 .1 .1" mass="3" pos="1 0 0"/>
</body></worldbody></mujoco>"""

for more, expected in (("", 5.0), ('<compiler settotalmass="10"/>', 10.0)):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "rod.xml")
        path.write_text(MJCF.format(more=more))
        world = dartpy.utils.MjcfParser.readWorld(dartpy.common.Uri(path.as_uri()))
    print(f"mass {world.getSkeleton(0).getMass()}, expected {expected}")
