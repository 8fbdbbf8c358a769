"""DART refuses an MJCF with meshes, unless it has a `meshdir` and all inertias are given.

Without `meshdir` it takes `arm.stl` for `/arm.stl`. In MuJoCo it is beside the file, and an inertia
that is not given is that of the mesh.
"""

import tempfile
from pathlib import Path

import dartpy

MJCF = """<mujoco>{}<asset><mesh name="arm" file="arm.stl"/></asset><worldbody>
<body name="b"><joint axis="0 0 1"/>{}<geom type="mesh" mesh="arm"/></body></worldbody></mujoco>"""
CORNERS = "0 0 0", "1 0 0", "0 1 0", "0 0 1"
FACES = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))
FACET = "facet normal 0 0 0\nouter loop\n{}endloop\nendfacet\n"
STL = "".join(FACET.format("".join(f"vertex {CORNERS[i]}\n" for i in face)) for face in FACES)

INERTIAL = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
for meshdir, inertial in (("./", INERTIAL), ("", INERTIAL), ("./", "")):
    compiler = f'<compiler meshdir="{meshdir}"/>' if meshdir else ""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "arm.xml")
        path.write_text(MJCF.format(compiler, inertial))
        path.with_suffix(".stl").write_text(f"solid arm\n{STL}endsolid arm\n")
        world = dartpy.utils.MjcfParser.readWorld(dartpy.common.Uri(path.as_uri()))
    given = f"meshdir {meshdir!r}, inertial {'given' if inertial else 'left out'}"
    print(f"{given}: {'refused' if world is None else 'read'}, expected read", flush=True)
