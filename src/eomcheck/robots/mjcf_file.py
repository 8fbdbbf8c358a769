"""An MJCF file as MuJoCo compiles it, once it is known to be of bounded size and stripped bare."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from eomcheck.calls import call, foreign
from eomcheck.errors import InputError, message_of, required
from eomcheck.mechanics.described.frames import check_coordinates
from eomcheck.robots.urdf_robot import MOST
from eomcheck.robots.urdf_xml import Element, Format, Unreadable, decimal, number, root_of

MJCF = Format("MJCF", ("mujoco", "mujocoinclude"), deepest=500)

NOT_UNDERSTOOD = frozenset(
    {"attach", "composite", "extension", "flex", "flexcomp", "model", "plugin", "replicate"}
)
"""Elements that bring more than they say, or bodies that are not rigid."""

JOINTS = "joint", "freejoint"

FORCELESS = {
    "sensors": "sensors",
    "actuators": "actuators",
    "tendons": "tendons",
    "keys": "keyframes",
    "skins": "",
    "pairs": "",
    "excludes": "",
    "tuples": "",
    "numerics": "",
    "texts": "",
}
"""What a model has that no body is made of -> what it is called where it is left out."""

LARGEST_SIZE = 2000
"""Of fields of heights and of data of users, for which MuJoCo makes room while it reads."""

FINEST = 100
"""Largest parameter of a mesh that MuJoCo makes; 300 by 300 faces take it 9 s."""

SIZES = {"hfield": ("nrow", "ncol"), "size": ("nuser_",)}
"""Element -> how its attributes begin that are such sizes."""

MOST_FILES = 100
"""Files that may be included, this one among them."""


def compiled(path: Path) -> tuple[Any, Counter[str]]:
    """Return MuJoCo's model of a file without what is left out, and how much of that there was.

    Raises:
        InputError: it cannot be read, is no MJCF, or MuJoCo refuses it.
        EngineError: MuJoCo is not installed.
    """
    joints = 0
    for root in _roots(path):
        _check(root, path)
        joints += sum(len(body.findall(tag)) for body in root.iter("body") for tag in JOINTS)
    _check_coordinates(path, joints)  # at least a coordinate each
    foreign()
    library = required("mujoco", "mujoco")
    try:
        return call(f"MuJoCo, reading {path.name},", _compiled, library, path, slow=True)
    except Unreadable:
        raise
    except Exception as error:  # its own kinds, and those of Python
        raise Unreadable(f"{str(path)!r} is refused by MuJoCo: {message_of(error)}") from None


def _check_coordinates(path: Path, coordinates: int) -> None:
    """Check the number of coordinates before MuJoCo takes minutes over a large file."""
    try:
        check_coordinates(coordinates)
    except InputError as error:
        raise Unreadable(f"{str(path)!r}: {error}") from None


def _compiled(library: Any, path: Path) -> tuple[Any, Counter[str]]:
    spec = _read(library, path)
    kinds = library.mjtJoint
    several = {kinds.mjJNT_FREE: 6, kinds.mjJNT_BALL: 3}
    _check_coordinates(path, sum(several.get(joint.type, 1) for joint in spec.joints))
    out = _strip(library, spec, str(path))
    return spec.compile(), out


def _read(library: Any, path: Path) -> Any:
    """Return a file as MuJoCo reads it, which by itself reads only what is called .xml."""
    if path.suffix == ".xml":
        return library.MjSpec.from_file(str(path))
    spec = library.MjSpec.from_string(path.read_text(encoding="utf-8"))
    spec.modelfiledir = str(path.parent)
    return spec


def _roots(path: Path) -> Iterator[Element]:
    """Yield the root of a file and of all that it includes, wherever that is included."""
    left, seen = [path], set[Path]()
    while left:
        one = left.pop()
        if one in seen:
            raise Unreadable(f"{str(path)!r} includes {one.name!r} twice")
        seen.add(one)
        if len(seen) > MOST_FILES:
            raise Unreadable(f"{str(path)!r} includes more than {MOST_FILES} files")
        root = root_of(one, MJCF)
        left += [path.parent / element.get("file", "") for element in root.iter("include")]
        yield root


def _check(root: Element, path: Path) -> None:
    counts = Counter(element.tag for element in root.iter())
    if strange := sorted(NOT_UNDERSTOOD & counts.keys()):
        raise Unreadable(f"{str(path)!r} holds <{strange[0]}>, which is not understood here")
    for tag in ("body", "joint"):
        if counts[tag] > MOST:
            found = f"{counts[tag]} elements <{tag}>"
            raise Unreadable(f"{str(path)!r} has {found}, expected at most {MOST}")
    where = repr(str(path))
    for mesh in root.iter("mesh"):
        for value in mesh.get("params", "").split():
            if not abs(decimal(value, f"{where}: params of <mesh>")) <= FINEST:
                size = f"a parameter of <mesh> is {value}"
                raise Unreadable(f"{where}: {size}, expected at most {FINEST}")
    for tag, beginnings in SIZES.items():
        for element in root.iter(tag):
            for name in element.attrib:
                if name.startswith(beginnings) and number(element, name, where) > LARGEST_SIZE:
                    size = f"{name} of <{tag}> is {element.get(name)}"
                    raise Unreadable(f"{str(path)!r}: {size}, expected at most {LARGEST_SIZE}")


def _strip(library: Any, spec: Any, path: str) -> Counter[str]:
    """Take out of a model what no equation needs: no mesh of it is then looked for.

    What is counted is what a motion would notice.

    Raises:
        InputError: it has an equality that is not understood.
    """
    out: Counter[str] = Counter()
    kinds = library.mjtEq
    for one in spec.equalities:
        if one.type not in (kinds.mjEQ_CONNECT, kinds.mjEQ_WELD, kinds.mjEQ_JOINT):
            what = kinds(one.type).name.removeprefix("mjEQ_").lower()
            said = f"is of the kind {what}, expected connect, weld, joint"
            raise Unreadable(f"{path!r}: equality {one.name!r} {said}")
    out["drag of a fluid"] += bool(spec.option.density or spec.option.viscosity)
    spec.option.density = spec.option.viscosity = 0.0
    for name, called in FORCELESS.items():
        parts = list(getattr(spec, name))
        if called:
            out[called] += len(parts)
        for part in parts:
            spec.delete(part)
    by_shape = spec.compiler.inertiafromgeom == library.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    for body in spec.bodies:
        out["compensation of gravity"] += bool(body.gravcomp)
        body.gravcomp = 0.0
        needed = by_shape or not body.explicitinertial
        for geom in list(body.geoms):
            out["shapes to collide"] += bool(geom.contype or geom.conaffinity)
            geom.material = geom.hfieldname = ""
            if not needed or body is spec.worldbody or body.name == "world":
                spec.delete(geom)
    for light in spec.lights:
        light.texture = ""
    for site in spec.sites:
        site.material = ""
    kept = {geom.meshname for geom in spec.geoms}
    for mesh in list(spec.meshes):
        if mesh.name not in kept:
            spec.delete(mesh)
    for name in ("materials", "textures", "hfields"):
        for part in list(getattr(spec, name)):
            spec.delete(part)
    spec.nuserdata = spec.nkey = 0
    spec.memory = -1
    return out
