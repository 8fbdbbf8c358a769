"""Reader and writer of URDF files: the robot in a file as elements of a description, as a scene.

The XML of a robot is untrusted input: of bounded size, no entity expanded, every number checked.
`Robot` and the functions on XML, numbers and the scene class are those of all readers.
The reader is independent, on the XML parser of the standard library, so that models that other
libraries build from the same file can be compared with it. Contents of a file besides rigid bodies
and ideal joints are left out, and named in one sentence; unknown elements are refused.
"""

from __future__ import annotations

import math
import os
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np

from eomcheck.atomic_write import check_regular
from eomcheck.descriptions.build import mechanism_source
from eomcheck.descriptions.doubtful_numbers import (
    LinkSize,
    axis_warning,
    body_warnings,
    degree_warning,
    joined,
)
from eomcheck.descriptions.elements import (
    COORDINATES,
    ORIGIN,
    Constraint,
    Joint,
    Link,
    Triple,
)
from eomcheck.descriptions.mechanism_class import Mechanism
from eomcheck.descriptions.vector_algebra import (
    IDENTITY,
    Quaternion,
    multiply_quaternions,
    roll_pitch_yaw,
    roll_pitch_yaw_of,
    rotation_matrix,
)
from eomcheck.errors import InputError, did_you_mean
from eomcheck.mechanics.scene import finite_array
from eomcheck.numbers.generic import FLOAT64

# ---- XML -----------------------------------------------------------------------------------------

LARGEST = 20_000_000
"""Largest size of a file, bytes."""

MOST_ELEMENTS, DEEPEST = 200_000, 60

Element = ElementTree.Element


class Unreadable(InputError):
    """A robot description that is invalid or not understood."""


class Format(NamedTuple):
    """Expected contents of a file."""

    name: str
    roots: tuple[str, ...]
    """Tags that its root may have."""
    deepest: int = DEEPEST
    """Largest depth of nested elements."""

    @property
    def article(self) -> str:
        """Article before the name, which is read letter by letter."""
        return "a" if self.name[0] in "UJ" else "an"


URDF = Format("URDF", ("robot",))


def root_of(path: Path, expected: Format = URDF) -> Element:
    """Return the root of a file, <robot> of a URDF.

    Raises:
        InputError: it is no file, cannot be read, is empty, too large or no XML, declares entities,
            or has other contents.
    """
    check_regular(path)
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST + 1)
    except OSError as error:
        why = error.strerror or type(error).__name__
        raise Unreadable(f"{str(path)!r} cannot be read: {why}") from None
    if len(data) > LARGEST:
        raise Unreadable(f"{str(path)!r} has more than {LARGEST // 10**6} million bytes")
    if not data.strip():
        raise Unreadable(f"{str(path)!r} is empty")
    try:
        _check_xml(data, str(path), expected.deepest)
        root = _parsed(data)
    except (expat.ExpatError, ElementTree.ParseError, LookupError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise Unreadable(f"{str(path)!r} is no XML: {error}") from None
    if space := root.tag.rpartition("}")[0]:
        # A namespace by default is that of the format, whatever its name.
        for element in root.iter():
            if isinstance(element.tag, str):
                element.tag = element.tag.removeprefix(f"{space}}}")
    if root.tag not in expected.roots:
        wanted = f"expected <{expected.roots[0]}>: no {expected.name}"
        raise Unreadable(f"{str(path)!r} holds <{root.tag}>, {wanted}")
    return root


def _parsed(data: bytes) -> Element:
    """Return the root of a text; prefixes without a namespace, which others accept, stay."""
    try:
        return ElementTree.fromstring(data)
    except ElementTree.ParseError as error:
        if not str(error).startswith("unbound prefix"):
            raise
    builder, parser = ElementTree.TreeBuilder(), expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = builder.start, builder.end
    parser.CharacterDataHandler = builder.data
    parser.Parse(data, True)
    return builder.close()


def _check_xml(data: bytes, name: str, deepest: int) -> None:
    """Check for entities and deep nesting, which could grow while parsed, before parsing."""
    parser, count, depth = expat.ParserCreate(), 0, 0

    def declared(*_: object) -> None:
        raise Unreadable(f"{name!r} declares a document type: entities are not expanded here")

    def opened(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count, depth
        count, depth = count + 1, depth + 1
        if count > MOST_ELEMENTS or depth > deepest:
            raise Unreadable(
                f"{name!r} has more than {MOST_ELEMENTS} elements, or more than {deepest} inside "
                "each other"
            )
        if tag.startswith("xacro:") or any("${" in value for value in attributes.values()):
            raise Unreadable(f"{name!r} is a template for xacro: have it expanded first")

    def closed(_: str) -> None:
        nonlocal depth
        depth -= 1

    parser.StartDoctypeDeclHandler = declared
    parser.StartElementHandler, parser.EndElementHandler = opened, closed
    parser.Parse(data, True)


# ---- Attributes ----------------------------------------------------------------------------------


def text_attribute(element: Element, name: str, where: str) -> str:
    """Return a required attribute."""
    value = element.get(name)
    if value is None or not value.strip():
        raise Unreadable(f"{where}: <{element.tag}> has no attribute {name!r}")
    return value.strip()


def number_attribute(
    element: Element, name: str, where: str, default: float | None = None
) -> float:
    """Return an attribute as a number."""
    if default is not None and element.get(name) is None:
        return default
    return finite_number(
        text_attribute(element, name, where), f"{where}: {name} of <{element.tag}>"
    )


def triple_attribute(
    element: Element, name: str, where: str, default: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Return an attribute of three numbers."""
    value = element.get(name)
    if value is None:
        return default
    what = f"{where}: {name} of <{element.tag}>"
    parts = value.split()
    if len(parts) != 3:
        raise Unreadable(f"{what} is {value!r}, expected three numbers")
    x, y, z = (finite_number(part, what) for part in parts)
    return x, y, z


def finite_number(value: str, name: str) -> float:
    """Return a finite number of its text.

    Raises:
        InputError: it is none.
    """
    try:
        if "_" in value:
            raise ValueError
        number = float(value)
    except ValueError:
        raise Unreadable(f"{name} is {value!r}, expected a number") from None
    if not math.isfinite(number):
        raise Unreadable(f"{name} is {value!r}, expected a finite number")
    return number


def not_below_zero(number: float, name: str, where: str) -> float:
    """Return a number.

    Raises:
        InputError: it is negative.
    """
    if number < 0:
        raise Unreadable(f"{where}: {name} = {number:g}, expected a number not below 0")
    return number


def single_child(element: Element, tag: str, where: str) -> Element | None:
    """Return the only child with this tag; None without any."""
    children = element.findall(tag)
    if len(children) > 1:
        raise Unreadable(f"{where} has {len(children)} of <{tag}>, expected one")
    return children[0] if children else None


CHANGES_DYNAMICS = re.compile("loop|constraint|spring|bushing|tendon|mass|inertia|link|joint")
"""Words in the name of an unknown element that may change the equations of motion."""


def ignored_tags(
    element: Element,
    allowed: frozenset[str],
    where: str,
    read: frozenset[str] = frozenset(),
    expected: Format = URDF,
) -> Iterator[str]:
    """Yield the tags of children, those that are read included: others are left out.

    As every other reader does, unknown elements are left out, unless their name may be that of one
    that changes the equations of motion.

    Args:
        element: the element.
        allowed: tags that are known, and those of other readers.
        where: place of the element, for messages.
        read: tags that are read.
        expected: format of the file.

    Raises:
        InputError: an unknown one resembles one that is read, or may change the dynamics.
    """
    for child in element:
        name = local_name(child.tag)
        of_others = name in read and name != child.tag  # in a namespace of its own
        if of_others or name not in allowed | read:
            hint = "" if of_others else did_you_mean(name, read)
            if of_others or hint or CHANGES_DYNAMICS.search(name.lower()):
                known = f"which is no part of {expected.article} {expected.name} known here"
                called = re.sub(r"^\{.*\}", "", child.tag) if of_others else name
                raise Unreadable(f"{where} holds <{called}>, {known}{hint}")
        yield name


def local_name(tag: Any) -> str:
    """Return the name of an element without its namespace; "comment" for one without a name."""
    return re.split("[}:]", tag)[-1] if isinstance(tag, str) else "comment"


# ---- Elements ------------------------------------------------------------------------------------

KINDS = {
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
    "fixed": "fixed",
    "floating": "floating",
    "planar": "planar",
    "spherical": "spherical",
}

WORLD = "world"
"""Name of the ground, a link that a file may leave out, as for Drake and Gazebo."""

MAX_FILE_ELEMENTS = 5000
"""Largest number of links or joints of a file, fixed ones included."""

READ = frozenset({"link", "joint"})
OF_ROBOT = frozenset(
    {
        "material",
        "transmission",
        "gazebo",
        "sensor",
        "ros2_control",
        "mujoco",
        "deformable",
        "frame",
    }
)
OF_LINK = frozenset(
    {"visual", "collision", "contact", "self_collision_checking", "collision_checking",
     "self_filter", "surface", "kinematic", "gravity", "origin", "gazebo"}
)  # fmt: skip
OF_JOINT = frozenset({"limit", "safety_controller", "calibration", "joint_properties", "gazebo"})


class Robot(NamedTuple):
    """The contents of a robot file as elements of a description."""

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    ignored: str
    """Sentence on the parts of the file that are left out; "" without any."""
    warnings: str = ""
    """Sentences on doubtful numbers of the file; "" without any."""
    constraints: tuple[Constraint, ...] = ()
    gravity: Triple | None = None
    """Gravity by the file; a URDF has none."""
    pose: Mapping[str, float] = MappingProxyType({})
    """Coordinates q at t = 0 that are not 0, by name."""
    compiled: Any = None
    """MuJoCo's compiled model of an MJCF."""
    bodies: tuple[str, ...] = ()
    """Names of the links that the file has, if joints needed more of them; frames are of these."""

    @property
    def coordinates(self) -> list[str]:
        """Names of the coordinates of all joints, in the order of the file."""
        return [joint.name + part for joint in self.joints for part in COORDINATES[joint.kind]]


def read_urdf(path: Path) -> Robot:
    """Return the contents of a URDF file.

    Raises:
        InputError: see `from_urdf`.
    """
    root, where = root_of(path), str(path)
    links, joints = root.findall("link"), root.findall("joint")
    for what, elements in (("links", links), ("joints", joints)):
        if len(elements) > MAX_FILE_ELEMENTS:
            raise Unreadable(
                f"{where!r} has {len(elements)} {what}, expected at most {MAX_FILE_ELEMENTS}"
            )
    if not links:
        raise Unreadable(f"{where!r} has no link")
    out = Counter(tag for tag in ignored_tags(root, OF_ROBOT, repr(where), READ) if tag not in READ)
    name = identifier(root.get("name", "") or path.stem)
    read_links = tuple(_link(link, where, out) for link in links)
    read_joints = tuple(_joint(joint, where, out) for joint in joints)
    if WORLD not in {link.name for link in read_links} and any(
        joint.parent == WORLD for joint in read_joints
    ):
        read_links = Link(WORLD), *read_links
    shapes = {link.get("name", "").strip(): _shapes(link) for link in links}
    warnings = joined(
        *body_warnings(read_links, read_joints, shapes),
        degree_warning(_angles(links, joints)),
        axis_warning(
            (joint.get("name", ""), axis.get("xyz", "1 0 0"))
            for joint in joints
            for axis in joint.findall("axis")
        ),
    )
    return Robot(name, read_links, read_joints, ignored_summary(out), warnings)


def _angles(links: list[Element], joints: list[Element]) -> Iterator[tuple[str, str]]:
    """Yield name and angles of the origins of joints and inertials."""
    for element in (*joints, *links):
        for path in "origin", "inertial/origin":
            for origin in element.findall(path):
                yield element.get("name", ""), origin.get("rpy", "")


def _shapes(link: Element) -> LinkSize:
    """Return the size of the shapes of a link; not whole with meshes, or without any."""
    shapes = [*link.findall("visual"), *link.findall("collision")]
    reaches = [_reach(shape) for shape in shapes]
    known = [reach for reach in reaches if reach is not None]
    return LinkSize(max(known, default=0.0), bool(shapes) and len(known) == len(shapes))


def _reach(shape: Element) -> float | None:
    """Return the largest distance of a shape from the origin of its link, m; None of a mesh."""
    kind = shape.find("geometry/*")
    if kind is None:
        return None
    try:
        center, _ = _origin(shape, "")
        return shape_reach(kind.tag, center, lambda name: kind.get(name, ""))
    except Unreadable:  # shapes are not read otherwise
        return None


def shape_reach(kind: str, center: Triple, text: Callable[[str], str]) -> float | None:
    """Return the largest distance of a shape from the origin of its link, m; None of a mesh.

    Args:
        kind: tag of its element.
        center: its centre, m.
        text: function of the name of a size that returns its text.

    Raises:
        InputError: a size is no number.
    """

    def sizes(*names: str) -> list[float]:
        return [finite_number(part, "") for name in names for part in text(name).split()]

    match kind:
        case "box":
            half = math.hypot(*sizes("size")) / 2
        case "sphere":
            half = math.hypot(*sizes("radius"))
        case "ellipsoid":
            half = max(sizes("radii"), default=0.0)
        case "cylinder" | "capsule" | "cone":
            radius, length = (math.hypot(*sizes(name)) for name in ("radius", "length"))
            half = math.hypot(radius, length / 2 + (radius if kind == "capsule" else 0.0))
        case _:
            return None
    return math.hypot(*center) + half


def identifier(name: str) -> str:
    """Return a Python identifier for the name of a robot."""
    name = re.sub(r"\W+", "_", name).strip("_") or "robot"
    return name if name.isidentifier() else f"robot_{name}"


def ignored_summary(counts: Counter[str]) -> str:
    """Return a sentence that counts the parts of a file that are ignored; "" without any."""
    nonzero = sorted((tag, count) for tag, count in counts.items() if count)
    counted = ", ".join(f"{_PLURAL.get(tag, tag)} ({count})" for tag, count in nonzero)
    return f"Ignored: {counted}." if counted else ""


_PLURAL = {
    "limit": "limits of joints",
    "friction": "friction of joints",
    "transmission": "transmissions",
    "material": "materials",
    "visual": "shapes to be seen",
    "collision": "shapes to collide",
    "contact": "contacts",
    "gazebo": "settings of Gazebo",
    "frame": "frames",
    "sensor": "sensors",
    "safety_controller": "safety controllers",
    "calibration": "calibrations",
}


def _link(element: Element, file: str, out: Counter[str]) -> Link:
    name = text_attribute(element, "name", repr(file))
    where = f"{file!r}: link {name!r}"
    read = frozenset({"inertial"})
    out.update(tag for tag in ignored_tags(element, OF_LINK, where, read) if tag not in read)
    inertial = single_child(element, "inertial", where)
    if inertial is None:
        return Link(name)
    parts = frozenset({"mass", "inertia", "origin"})
    inside = ignored_tags(inertial, frozenset(), f"{where}: <inertial>", parts)
    out.update(tag for tag in inside if tag not in parts)
    mass, inertia = (single_child(inertial, tag, where) for tag in ("mass", "inertia"))
    if mass is None or inertia is None:
        missing = "mass" if mass is None else "inertia"
        raise Unreadable(f"{where}: <inertial> has no <{missing}>")
    center, turn = _origin(inertial, where)
    heavy = number_attribute(mass, "value", where)
    if heavy < 0:
        expected = "expected a number that is not negative"
        raise Unreadable(f"{where}: mass = {heavy:g} kg, {expected}")
    xx, yy, zz, xy, xz, yz = (
        number_attribute(inertia, f"i{axes}", where)
        for axes in ("xx", "yy", "zz", "xy", "xz", "yz")
    )
    link = Link(name, heavy, center, (xx, yy, zz), (xy, xz, yz))
    if turn == IDENTITY:
        return link
    R = rotation_matrix(turn)
    return Link.with_inertia(name, heavy, center, R @ link.inertia @ R.T)


def _joint(element: Element, file: str, out: Counter[str]) -> Joint:
    name = text_attribute(element, "name", repr(file))
    where = f"{file!r}: joint {name!r}"
    tags = frozenset({"parent", "child", "origin", "axis", "dynamics", "mimic"})
    out.update(tag for tag in ignored_tags(element, OF_JOINT, where, tags) if tag not in tags)
    kind = text_attribute(element, "type", where)
    if kind not in KINDS:
        raise Unreadable(f"{where} has the type {kind!r}, expected one of: {', '.join(KINDS)}")
    ends = [single_child(element, tag, where) for tag in ("parent", "child")]
    for tag, end in zip(("parent", "child"), ends, strict=True):
        if end is None:
            raise Unreadable(f"{where} has no <{tag}>")
    parent, child = (text_attribute(end, "link", where) for end in ends if end is not None)
    place, turn = _origin(element, where)
    axis = single_child(element, "axis", where)
    more: dict[str, Any] = {}
    if axis is not None:
        more["axis"] = triple_attribute(axis, "xyz", where, (1.0, 0.0, 0.0))
    else:
        more["axis"] = (1.0, 0.0, 0.0)
    dynamics = single_child(element, "dynamics", where)
    mimic = single_child(element, "mimic", where)
    if dynamics is not None and kind != "fixed":
        damping = number_attribute(dynamics, "damping", where, 0.0)
        more["damping"] = not_below_zero(damping, "damping", where) or None
        if number_attribute(dynamics, "friction", where, 0.0):
            out["friction"] += 1
    if mimic is not None and kind != "fixed":
        ratio, shift = (
            number_attribute(mimic, what, where, default)
            for what, default in (("multiplier", 1.0), ("offset", 0.0))
        )
        more["mimics"] = text_attribute(mimic, "joint", where), ratio, shift
    return Joint(name, KINDS[kind], parent, child, place, turn, **more)


def _origin(element: Element, where: str) -> tuple[Triple, Quaternion]:
    origin = single_child(element, "origin", where)
    if origin is None:
        return ORIGIN, IDENTITY
    turn = roll_pitch_yaw(*triple_attribute(origin, "rpy", where, ORIGIN))
    return triple_attribute(origin, "xyz", where, ORIGIN), multiply_quaternions(IDENTITY, turn)


# ---- Scene ---------------------------------------------------------------------------------------

FLOATING = "floating"


def from_urdf(
    path: str | os.PathLike[str],
    *,
    floating: bool = False,
    gravity: Triple | None = (0.0, 0.0, -9.81),
) -> Mechanism:
    """Return the robot in a URDF file, with the parameters of the file.

    Its coordinates are those of the file's joints, in their order; fixed joints have none, nor have
    joints that mimic others. Its `source.ignored` names the parts of the file that are left out,
    `source.warnings` the numbers that no physical body has: they are used unchanged.

    Args:
        path: the file.
        floating: whether its root is free to move: three slides, then turns about z, y and x, come
            first. Otherwise the root is fixed to the ground.
        gravity: acceleration, m/s², or None without.

    Returns:
        A scene, an instance of a `Mechanism` class of its own.

    Raises:
        InputError: the file cannot be read, is no URDF, contradicts itself, has more than
            200 coordinates, or a joint that moves nothing.
    """
    return urdf_kind(path, floating=floating, gravity=gravity)()


def urdf_kind(
    path: str | os.PathLike[str],
    *,
    floating: bool = False,
    gravity: Triple | None = (0.0, 0.0, -9.81),
) -> type[Mechanism]:
    """Return the scene class of a file, of which `from_urdf` returns the default scene."""
    file, gravity = path_of(path, "a URDF"), gravity_of(gravity)
    robot = read_urdf(file)
    if not (robot.joints or floating):
        name = str(path)
        raise Unreadable(f"{name!r} has no joint; {f'{name}:{FLOATING}'!r} sets its link free")
    options = (", floating=True" if floating else "") + (
        "" if gravity == (0.0, 0.0, -9.81) else f", gravity={gravity!r}"
    )
    links, joints = _floating(robot) if floating else (robot.links, robot.joints)
    robot = robot._replace(links=links, joints=joints, gravity=gravity)
    return robot_class(robot, "urdf", path, options, joints[0].name if floating else "")


def robot_class(
    robot: Robot, format: str, path: Any, options: str, floating: str = "", model: str = ""
) -> type[Mechanism]:
    """Return the scene class of a robot.

    Args:
        robot: contents of its file.
        format: format of the file, the end of the name of the function that reads it.
        path: the file, as it was named.
        options: further arguments of this function as code, such as ", floating=True".
        floating: name of the link that is free by request.
        model: name of the model that was chosen among those of the file.

    Raises:
        InputError: the robot contradicts itself.
    """
    name = f"{robot.name}_{FLOATING}" if floating else robot.name
    with errors_naming(path):
        elements = name, robot.links, robot.joints, robot.constraints
        more: dict[str, Any] = {"gravity": robot.gravity, "pose": {**robot.pose}}
        source = mechanism_source(*elements, **more)
        if robot.constraints:
            dependent = _dependent_coordinates(source.scene_class()())
            source = mechanism_source(*elements, **more, dependent=dependent)
        if robot.bodies:
            source = source.with_frames_of(robot.bodies)
        source = source.of_file(format, path, options, robot.ignored, robot.warnings)
        return source._replace(floating=floating, model=model).scene_class()


def _dependent_coordinates(scene: Mechanism) -> list[str]:
    """Return the names of dependent coordinates, as many as there are constraints."""
    from scipy.linalg import qr

    q = scene.initial_state()[0]
    # Perturbed from the pose, which may be a singular configuration: many are drawn stretched.
    q = q + 0.1 * np.sin(1.0 + np.arange(scene.n))
    parameters = scene.float64_parameters
    a, _ = scene.constraints(parameters, scene.prepare(FLOAT64, parameters, q, 0.0), q)
    factors: Any = qr(a, mode="r", pivoting=True)
    order = factors[-1]
    return [scene.coordinate_names[i] for i in order[: scene.r]]


STEEPEST = 1.2
"""Largest pitch of an initial pose, rad; a steeper one, near the singularity, is left at 0."""


def floating_pose(name: str, place: Iterable[float], turn: Quaternion) -> dict[str, float]:
    """Return the coordinates of a floating joint in a pose, by name; see `Robot.pose`."""
    pose = {f"{name}_{axis}": float(x) for axis, x in zip("xyz", place, strict=True)}
    turns = roll_pitch_yaw_of(rotation_matrix(turn))
    if abs(turns[1]) <= STEEPEST:
        names = "roll", "pitch", "yaw"
        pose |= {f"{name}_{n}": float(x) for n, x in zip(names, turns, strict=True)}
    return pose


def path_of(path: Any, what: str) -> Path:
    """Return the path of a robot file.

    Raises:
        InputError: it is something else.
    """
    try:
        return Path(path)
    except TypeError:
        raise InputError(f"path = {path!r}, expected the path of {what} file") from None


@contextmanager
def errors_naming(path: Any) -> Iterator[None]:
    """Name the file in errors of its description inside the block."""
    try:
        yield
    except Unreadable:
        raise
    except InputError as error:
        raise Unreadable(f"{str(path)!r}: {error}") from None


def gravity_of(gravity: Triple | None) -> Triple | None:
    """Return gravity as three numbers, or None.

    Raises:
        InputError: it is something else.
    """
    if gravity is None:
        return None
    x, y, z = finite_array("gravity", gravity, (3,)).tolist()
    return x, y, z


def _floating(robot: Robot) -> tuple[tuple[Link, ...], tuple[Joint, ...]]:
    """Return links and joints with the root on a floating joint of its name, which comes first."""
    children = {joint.child for joint in robot.joints}
    roots = [link.name for link in robot.links if link.name not in children]
    if len(roots) != 1:
        return robot.links, robot.joints  # refused later
    ground = "the ground"
    joint = Joint(roots[0], "floating", ground, roots[0])
    return (Link(ground), *robot.links), (joint, *robot.joints)


# ---- Writer --------------------------------------------------------------------------------------


def urdf_text(description: Any, name: str = "robot") -> str:
    """Return the URDF of a tree, every number with all its digits.

    Parts that URDF cannot represent are not in it: gravity, springs, rotors, constraints. Revolute
    joints are written as continuous ones, which need no limits; joints that slide need limits,
    which mean nothing here.

    Args:
        description: `links` and `joints` of a robot.
        name: name of the robot.
    """
    robot = ElementTree.Element("robot", name=name)
    for link in description.links:
        _add_link(robot, link)
    for joint in description.joints:
        _add_joint(robot, joint)
    ElementTree.indent(robot)  # some parsers truncate long lines
    return ElementTree.tostring(robot, encoding="unicode") + "\n"


def _add_link(robot: ElementTree.Element, link: Link) -> None:
    element = _child(robot, "link", name=link.name)
    if not link.has_inertia:
        return
    inertial = _child(element, "inertial")
    _child(inertial, "origin", xyz=_text(link.center), rpy="0 0 0")
    _child(inertial, "mass", value=repr(float(link.mass)))
    entries = (*link.moments, *link.products)
    names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    _child(
        inertial,
        "inertia",
        **{name: repr(float(x)) for name, x in zip(names, entries, strict=True)},
    )


def _add_joint(robot: ElementTree.Element, joint: Joint) -> None:
    kind = {"revolute": "continuous"}.get(joint.kind, joint.kind)
    element = _child(robot, "joint", name=joint.name, type=kind)
    _child(element, "parent", link=joint.parent)
    _child(element, "child", link=joint.child)
    _child(
        element,
        "origin",
        xyz=_text(joint.origin),
        rpy=_text(roll_pitch_yaw_of(rotation_matrix(joint.orientation))),
    )
    if joint.kind not in ("fixed", "floating", "spherical"):
        size = math.hypot(*joint.axis)  # not all parsers normalize it
        _child(element, "axis", xyz=_text(tuple(x / size for x in joint.axis)))
    if joint.kind == "prismatic":
        _child(element, "limit", lower="-10", upper="10", effort="1e3", velocity="1e3")
    if joint.damping is not None:
        _child(element, "dynamics", damping=repr(float(joint.damping)), friction="0")
    if joint.mimics is not None:
        leader, ratio, shift = joint.mimics
        _child(
            element, "mimic", joint=leader, multiplier=repr(float(ratio)), offset=repr(float(shift))
        )


def _child(element: ElementTree.Element, tag: str, **attributes: str) -> ElementTree.Element:
    return ElementTree.SubElement(element, tag, attributes)


def _text(numbers: tuple[float, ...]) -> str:
    return " ".join(repr(float(x)) for x in numbers)
