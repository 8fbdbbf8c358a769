"""Reader of MJCF files: compiled by MuJoCo, then elements of a description and a `Mechanism`.

Defaults, classes, inertias that follow from shapes and the many ways to write an orientation are
left to MuJoCo, which comes with an extra. A file is compiled only after its size has been checked
and everything that no equation needs has been removed. MuJoCo's model is converted to elements of a
description: the equations are those of any other description, independent of MuJoCo. Its equalities
become constraints by declaration, which hold exactly here.

A body may have several joints in a row, each about a point of its own: between them are links
without inertia, and so before the body where the point of its last joint is not its origin. These
are no bodies of the file and have no frames. The frame of a body is that of the file.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from eomcheck.calls import call, require_supervision
from eomcheck.descriptions.doubtful_numbers import (
    axis_warning,
    body_warnings,
    degree_warning,
    joined,
)
from eomcheck.descriptions.elements import (
    Constraint,
    Joint,
    Link,
    Triple,
    coupling,
    drive,
    pin,
    weld,
)
from eomcheck.descriptions.joint_tree import check_coordinates
from eomcheck.descriptions.mechanism_class import Mechanism
from eomcheck.descriptions.urdf_reader import (
    MAX_FILE_ELEMENTS,
    Element,
    Format,
    Robot,
    Unreadable,
    errors_naming,
    finite_number,
    floating_pose,
    gravity_of,
    identifier,
    ignored_summary,
    number_attribute,
    path_of,
    robot_class,
    root_of,
)
from eomcheck.descriptions.vector_algebra import (
    IDENTITY,
    Quaternion,
    conjugate,
    multiply_quaternions,
    rotation_matrix,
)
from eomcheck.errors import message_of, required
from eomcheck.numbers.generic import Array

# ---- File ----------------------------------------------------------------------------------------

MJCF = Format("MJCF", ("mujoco", "mujocoinclude"), deepest=500)

DEFORMABLE = "a deformable body, expected rigid ones"

NOT_UNDERSTOOD = {
    "composite": "which MuJoCo 4 does not have either, expected bodies, joints and <replicate>",
    "flex": DEFORMABLE,
    "flexcomp": DEFORMABLE,
}
"""Element that adds bodies that are not rigid, or more than it contains -> reason to refuse it."""

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
"""Collection of a model without effect on bodies -> its name in the summary of ignored parts."""

LARGEST_SIZE = 2000
"""Largest size of height fields and user data, for which MuJoCo allocates memory while it reads."""

FINEST = 100
"""Largest parameter of a generated mesh; 300 by 300 faces take MuJoCo 9 s."""

SIZES = {"hfield": ("nrow", "ncol"), "size": ("nuser_",)}
"""Element -> prefixes of its attributes that are such sizes."""

MOST_FILES = 100
"""Largest number of included files, this one among them."""


class CompiledFile(NamedTuple):
    """MuJoCo's model of a file."""

    model: Any
    """The model, without ignored parts."""
    ignored: Counter[str]
    """Counts of those parts."""
    warnings: str
    """Sentences on doubtful numbers that the model does not show; "" without any."""


def compile_model(path: Path) -> CompiledFile:
    """Return MuJoCo's model of a file.

    Raises:
        InputError: it cannot be read, is no MJCF, or MuJoCo refuses it.
        EngineError: MuJoCo is not installed.
    """
    roots = [root for _, root in _files(path)]
    for root in roots:
        _check(root, path)
    copies = 1 + sum(_expanded(root, "attach") for root in roots)
    for tags in ("body",), JOINTS:
        count = copies * sum(_expanded(root, *tags) for root in roots)
        if tags == JOINTS and copies == 1:
            _check_coordinates(path, count)  # at least one coordinate each
        elif count > MAX_FILE_ELEMENTS:
            what = f"{count} of <{tags[0]}>, replicated and attached"
            raise Unreadable(f"{str(path)!r} has {what}, expected at most {MAX_FILE_ELEMENTS}")
    require_supervision()
    library = required("mujoco", "mujoco")
    try:
        compiled = call(f"MuJoCo, reading {path.name},", _compile_model, library, path, slow=True)
    except Unreadable:
        raise
    except Exception as error:  # exceptions of MuJoCo's own and of Python
        raise Unreadable(f"{str(path)!r} is refused by MuJoCo: {message_of(error)}") from None
    return CompiledFile(*compiled, _number_warnings(roots))


def _expanded(element: Element, *tags: str) -> int:
    """Return the number of elements of some tags in bodies, with those that are replicated."""
    if element.tag in ("default", "tendon", "equality", "actuator", "sensor", "contact"):
        return 0
    inside = sum(_expanded(child, *tags) for child in element)
    if element.tag == "replicate":
        inside *= max(1, int(number_attribute(element, "count", "", 1.0)))
    return inside + (element.tag in tags)


def _number_warnings(roots: list[Element]) -> str:
    """Return sentences on doubtful axes and angles, which MuJoCo's model has converted."""
    elements = [element for root in roots for element in root.iter()]
    axes = [(_name(x), x.get("axis", "")) for x in elements if x.tag == "joint" and x.get("axis")]
    units = {x.get("angle") for x in elements if x.tag == "compiler"}
    angles = [(_name(x), x.get("euler", "")) for x in elements if x.get("euler")]
    return joined(degree_warning(angles if units & {"radian"} else ()), axis_warning(axes))


def _name(element: Element) -> str:
    """Return the name of an element, its class or its tag."""
    return element.get("name") or element.get("class") or element.tag


def _check_coordinates(path: Path, coordinates: int) -> None:
    """Check the number of coordinates before MuJoCo takes minutes over a large file.

    Raises:
        InputError: it is above the limit.
    """
    with errors_naming(path):
        check_coordinates(coordinates)


def _compile_model(library: Any, path: Path) -> tuple[Any, Counter[str]]:
    """Return the compiled model of a file, and the counts of its parts that are left out."""
    spec = _read(library, path)
    kinds = library.mjtJoint
    several = {kinds.mjJNT_FREE: 6, kinds.mjJNT_BALL: 3}
    _check_coordinates(path, sum(several.get(joint.type, 1) for joint in spec.joints))
    out = _strip(library, spec, str(path))
    return spec.compile(), out


def _read(library: Any, path: Path) -> Any:
    """Return MuJoCo's specification of a file; copied if its name does not end in .xml."""
    if path.suffix == ".xml":
        return library.MjSpec.from_file(str(path))
    spec = library.MjSpec.from_string(path.read_text(encoding="utf-8"))
    spec.modelfiledir = str(path.parent)
    return spec


def included_files(path: Path) -> list[Path]:
    """Return a file and all that it includes, at any depth."""
    return [file for file, _ in _files(path)]


def _files(path: Path) -> Iterator[tuple[Path, Element]]:
    """Yield a file and all that it includes, at any depth, each with its root."""
    pending, visited, attached = [path], set[Path](), set[Path]()
    while pending:
        file = pending.pop()
        if file in visited & attached:  # a model may be attached several times
            continue
        if file in visited:
            raise Unreadable(f"{str(path)!r} includes {file.name!r} twice")
        visited.add(file)
        if len(visited) > MOST_FILES:
            raise Unreadable(f"{str(path)!r} includes more than {MOST_FILES} files")
        root = root_of(file, MJCF)
        pending += [path.parent / element.get("file", "") for element in root.iter("include")]
        models = [path.parent / x.get("file", "") for x in root.iter("model") if x.get("file")]
        pending, attached = pending + models, attached | {*models}
        yield file, root


def _check(root: Element, path: Path) -> None:
    counts = Counter(element.tag for element in root.iter())
    if strange := sorted(NOT_UNDERSTOOD & counts.keys()):
        raise Unreadable(f"{str(path)!r} holds <{strange[0]}>, {NOT_UNDERSTOOD[strange[0]]}")
    for tag in ("body", "joint"):
        if counts[tag] > MAX_FILE_ELEMENTS:
            count = f"{counts[tag]} elements <{tag}>"
            raise Unreadable(f"{str(path)!r} has {count}, expected at most {MAX_FILE_ELEMENTS}")
    where = repr(str(path))
    for mesh in root.iter("mesh"):
        for value in mesh.get("params", "").split():
            if not abs(finite_number(value, f"{where}: params of <mesh>")) <= FINEST:
                size = f"a parameter of <mesh> is {value}"
                raise Unreadable(f"{where}: {size}, expected at most {FINEST}")
    for tag, beginnings in SIZES.items():
        for element in root.iter(tag):
            for name in element.attrib:
                if (
                    name.startswith(beginnings)
                    and number_attribute(element, name, where) > LARGEST_SIZE
                ):
                    size = f"{name} of <{tag}> is {element.get(name)}"
                    raise Unreadable(f"{str(path)!r}: {size}, expected at most {LARGEST_SIZE}")


def _strip(library: Any, spec: Any, path: str) -> Counter[str]:
    """Remove from a specification all that no equation needs: its meshes are then not searched for.

    Returns:
        Counts of the removed parts that would affect a motion.

    Raises:
        InputError: it has an equality that is not understood.
    """
    out: Counter[str] = Counter()
    kinds = library.mjtEq
    understood = kinds.mjEQ_CONNECT, kinds.mjEQ_WELD, kinds.mjEQ_JOINT, kinds.mjEQ_TENDON
    coupled = {
        name
        for equality in spec.equalities
        if equality.type == kinds.mjEQ_TENDON
        for name in (equality.name1, equality.name2)
    }
    for equality in spec.equalities:
        if equality.type not in understood:
            what = kinds(equality.type).name.removeprefix("mjEQ_").lower()
            refusal = f"is of the kind {what}, expected connect, weld, joint, tendon"
            raise Unreadable(f"{path!r}: equality {equality.name!r} {refusal}")
    out["drag of a fluid"] += bool(spec.option.density or spec.option.viscosity)
    spec.option.density = spec.option.viscosity = 0.0
    for name, called in FORCELESS.items():
        parts = [x for x in getattr(spec, name) if name != "tendons" or x.name not in coupled]
        if called:
            out[called] += len(parts)
        for part in parts:
            spec.delete(part)
    for body in spec.bodies:
        if body.plugin.active:
            plugin = body.plugin.plugin_name
            raise Unreadable(f"{path!r}: body {body.name!r} has forces of the plugin {plugin!r}")
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
    used_meshes = {geom.meshname for geom in spec.geoms}
    for mesh in list(spec.meshes):
        if mesh.name not in used_meshes:
            spec.delete(mesh)
    for name in ("materials", "textures", "hfields"):
        for part in list(getattr(spec, name)):
            spec.delete(part)
    spec.nuserdata = spec.nkey = 0
    spec.memory = -1
    return out


# ---- Equalities ----------------------------------------------------------------------------------

CONNECT, WELD, JOINT, TENDON = range(4)

SITE = 6
"""MuJoCo's number of the object type "site"."""


class EqualityContext(NamedTuple):
    """Parts of a model that equalities refer to."""

    model: Any
    where: str
    """Path of the file, for error messages."""
    bodies: list[str]
    """Names of the bodies' links; the ground first."""
    joints: list[str]
    reference: dict[str, float]
    """Reference coordinate of joints that have one, at which the file draws them."""


def equality_constraint(context: EqualityContext, i: int) -> Constraint:
    """Return equality number i of a model.

    Raises:
        InputError: it is between other objects, or not linear.
    """
    m = context.model
    name, kind = m.equality(i).name or f"equality{i}", int(m.eq_type[i])
    first, second, data = int(m.eq_obj1id[i]), int(m.eq_obj2id[i]), m.eq_data[i]
    if kind == TENDON:
        return _tendon_constraint(context, name, first, second, data)
    if kind == JOINT:
        second_joint = None if second < 0 else context.joints[second]
        return _joint_constraint(context, name, context.joints[first], second_joint, data)
    if m.eq_objtype[i] == SITE:
        a, b = m.site_pos[first], m.site_pos[second]
        there = conjugate(quaternion_of(m.site_quat[second]))
        turn = multiply_quaternions(quaternion_of(m.site_quat[first]), there)
        first, second = int(m.site_bodyid[first]), int(m.site_bodyid[second])
    elif kind == CONNECT:
        a, b, turn = data[:3], data[3:6], IDENTITY
    else:
        a, b, turn = data[3:6], data[:3], data[6:10]
    ends = context.bodies[first], context.bodies[second]
    points = triple_of(a), triple_of(b)
    if kind == CONNECT:
        return pin(name, *ends, *points)
    return weld(name, *ends, *points, quaternion_of(turn))


def _joint_constraint(
    context: EqualityContext, name: str, joint: str, leader: str | None, data: Array
) -> Constraint:
    """Return the coupling of two joints, or the drive of one without a leader."""
    for coupled in (joint, leader):
        if coupled is not None and coupled not in context.reference:
            several = f"joint {coupled!r}, which has several coordinates"
            raise Unreadable(f"{context.where}: equality {name!r} is of {several}")
    position = context.reference[joint] + data[0]
    if leader is None:
        return drive(name, joint, float(position))
    if np.any(data[2:5]):
        raise Unreadable(f"{context.where}: equality {name!r} is not linear")
    shift = position - data[1] * context.reference[leader]
    return coupling(name, joint, leader, float(data[1]), float(shift))


WRAP_JOINT = 1
"""MuJoCo's number of the wrap type of fixed tendons."""


def _tendon_constraint(
    context: EqualityContext, name: str, first: int, second: int, data: Array
) -> Constraint:
    """Return the coupling of the joints of fixed tendons, whose lengths are linear in these.

    The first tendon's length changes from that at `qpos0` by data[0], plus data[1] times the change
    of the second's.
    """
    m, factors = context.model, dict[str, float]()
    if second >= 0 and np.any(data[2:5]):
        raise Unreadable(f"{context.where}: equality {name!r} is not linear")
    constant = float(data[0])
    for tendon, sign in ((first, 1.0), (second, -float(data[1]))):
        if tendon < 0:
            continue
        constant += sign * float(m.tendon_length0[tendon])
        start = int(m.tendon_adr[tendon])
        for wrap in range(start, start + int(m.tendon_num[tendon])):
            joint = context.joints[int(m.wrap_objid[wrap])]
            if m.wrap_type[wrap] != WRAP_JOINT or joint not in context.reference:
                what = "is of a tendon in space, or of a joint with several coordinates"
                raise Unreadable(f"{context.where}: equality {name!r} {what}")
            factors[joint] = factors.get(joint, 0.0) + sign * float(m.wrap_prm[wrap])
    joints = sorted(filter(factors.get, factors), key=lambda x: -abs(factors[x]))
    if not joints:
        raise Unreadable(f"{context.where}: equality {name!r} constrains no joint")
    joint, *others = joints
    shift = constant / factors[joint]
    if not others:
        return drive(name, joint, shift)
    (other, ratio), *more = ((x, -factors[x] / factors[joint]) for x in others)
    return coupling(name, joint, other, ratio, shift, tuple(more))


def triple_of(a: Any) -> Triple:
    """Return three numbers of an array as a tuple."""
    x, y, z = (float(part) for part in a)
    return x, y, z


def quaternion_of(a: Any) -> Quaternion:
    """Return four numbers of an array as a tuple."""
    w, x, y, z = (float(part) for part in a)
    return w, x, y, z


# ---- Elements ------------------------------------------------------------------------------------

GROUND = "world"
"""MuJoCo's name of the ground, which no other body has."""

FREE_JOINT, BALL_JOINT, SLIDE, HINGE = range(4)
"""MuJoCo's numbers of joint types."""


def read_mjcf(path: Path) -> Robot:
    """Return the contents of an MJCF file.

    Raises:
        InputError, EngineError: see `from_mjcf`.
    """
    compiled = compile_model(path)
    robot = _MjcfReader(path, compiled.model, compiled.ignored).model()
    doubts = body_warnings(robot.links, robot.joints, {})
    return robot._replace(warnings=joined(*doubts, compiled.warnings))


class _MjcfReader:
    """Converter of a MuJoCo model to elements of a description."""

    def __init__(self, path: Path, model: Any, out: Counter[str]):
        self.where, self.m, self.out, self.path = repr(str(path)), model, out, path
        self.bodies = _names([model.body(i).name for i in range(model.nbody)], "body")
        self.names = _names([model.joint(i).name for i in range(model.njnt)], "joint")
        self.reference: dict[str, float] = {}
        """Joint with one coordinate -> coordinate at which the file draws it."""
        self.links, self.joints = [Link(GROUND)], []
        self.pose: dict[str, float] = {}
        off = int(model.opt.disableflags)
        self.off = {name: bool(off & bit) for name, bit in DISABLED.items()}

    def model(self) -> Robot:
        """Return the whole model."""
        m = self.m
        self._refuse()
        for body in range(1, m.nbody):
            self._add_body(body)
        held = not (self.off["equality"] or self.off["constraint"])
        context = EqualityContext(m, self.where, self.bodies, self.names, self.reference)
        constraints = [
            equality_constraint(context, i) for i in range(m.neq) if held and m.eq_active0[i]
        ]
        self.out["limits of joints"] += int(np.count_nonzero(m.jnt_limited))
        self.out["friction of joints"] += int(np.count_nonzero(m.dof_frictionloss))
        x, y, z = m.opt.gravity.tolist()
        return Robot(
            identifier(self.path.stem),
            tuple(self.links),
            tuple(self.joints),
            ignored_summary(self.out),
            constraints=tuple(constraints),
            gravity=None if self.off["gravity"] or not any((x, y, z)) else (x, y, z),
            pose=self.pose,
            compiled=m,
            bodies=tuple(self.bodies),
        )

    def _refuse(self) -> None:
        """Refuse forces that are not linear, and other parts outside of a description."""
        for name in ("jnt_stiffnesspoly", "dof_dampingpoly"):
            if np.any(getattr(self.m, name, 0)):
                raise Unreadable(f"{self.where}: springs or dampers that are not linear")
        if getattr(self.m, "nplastic", 0):
            raise Unreadable(f"{self.where}: joints that yield are not understood here")

    def _add_body(self, body: int) -> None:
        m, name = self.m, self.bodies[body]
        parent = int(m.body_parentid[body])
        place, turn = m.body_pos[body], m.body_quat[body]
        before, point = self.bodies[parent], np.zeros(3)
        first, count = int(m.body_jntadr[body]), int(m.body_jntnum[body])
        for joint in range(first, first + count):
            last = joint == first + count - 1
            at_origin = not m.jnt_pos[joint].any()
            after = name if last and at_origin else f"{name} after {self.names[joint]}"
            if after != name:
                self.links.append(Link(after))
            if m.jnt_type[joint] == FREE_JOINT:
                place, turn = np.zeros(3), np.array(IDENTITY)
            step = m.jnt_pos[joint] - point
            self._add_joint(joint, before, after, place + rotation_matrix(tuple(turn)) @ step, turn)
            before, point = after, m.jnt_pos[joint]
            place, turn = np.zeros(3), np.array(IDENTITY)
        if before != name:  # a site is part of its body
            self._add_fixed(name, before, place - point, turn)
        self.links.append(self._link(body))

    def _add_fixed(self, name: str, before: str, place: Array, turn: Array) -> None:
        """Add the joint that fixes a body to the link before it."""
        about = triple_of(place), quaternion_of(turn)
        self.joints.append(Joint(f"{name} fixed", "fixed", before, name, *about))

    def _link(self, body: int) -> Link:
        m = self.m
        R = rotation_matrix(quaternion_of(m.body_iquat[body]))
        name, mass = self.bodies[body], float(m.body_mass[body])
        center = triple_of(m.body_ipos[body])
        return Link.with_inertia(name, mass, center, R @ np.diag(m.body_inertia[body]) @ R.T)

    def _add_joint(self, joint: int, before: str, after: str, place: Array, turn: Array) -> None:
        m, name = self.m, self.names[joint]
        kind, dof, index = int(m.jnt_type[joint]), int(m.jnt_dofadr[joint]), m.jnt_qposadr[joint]
        stiffness = 0.0 if self.off["spring"] else float(m.jnt_stiffness[joint])
        if kind in (FREE_JOINT, BALL_JOINT):
            count = 6 if kind == FREE_JOINT else 3
            dampers = m.dof_damping[dof : dof + count]
            if np.ptp(dampers) > 0.0:
                raise Unreadable(
                    f"{self.where}: joint {name!r} is free or a ball, with dampers {dampers}: "
                    "expected the same of all its velocities"
                )
            rest = m.qpos_spring[index : index + count + 1]
            damping = 0.0 if self.off["damper"] else float(dampers[0])
            if kind == FREE_JOINT:  # a ball joint starts at 0
                at = quaternion_of(m.qpos0[index + 3 : index + 7])
                self.pose |= floating_pose(name, m.qpos0[index : index + 3], at)
            called = "floating" if kind == FREE_JOINT else "spherical"
            self.joints.append(
                Joint(
                    name,
                    called,
                    before,
                    after,
                    triple_of(place),
                    quaternion_of(turn),
                    damping=damping or None,
                    stiffness=stiffness or None,
                    rest_position=triple_of(rest[:3]) if kind == FREE_JOINT and stiffness else 0.0,
                    rest_orientation=quaternion_of(rest[-4:]) if stiffness else IDENTITY,
                    armature=float(m.dof_armature[dof]) or None,
                )
            )
            return
        axis, reference = m.jnt_axis[joint], float(m.qpos0[index])
        self.reference[name] = reference
        if reference:  # the file draws the joint at another coordinate than 0
            self.pose[name] = reference
            if kind == SLIDE:
                place = place - reference * (rotation_matrix(quaternion_of(turn)) @ axis)
            else:
                back = np.cos(reference / 2), *(-np.sin(reference / 2) * axis)
                turn = np.array(
                    multiply_quaternions(quaternion_of(turn), quaternion_of(np.array(back)))
                )
        damping = 0.0 if self.off["damper"] else float(m.dof_damping[dof])
        self.joints.append(
            Joint(
                name,
                "prismatic" if kind == SLIDE else "revolute",
                before,
                after,
                triple_of(place),
                quaternion_of(turn),
                triple_of(axis),
                damping=damping or None,
                stiffness=stiffness or None,
                rest_position=float(m.qpos_spring[index]) if stiffness else 0.0,
                armature=float(m.dof_armature[dof]) or None,
            )
        )


DISABLED = {
    "constraint": 1 << 0,
    "equality": 1 << 1,
    "spring": 1 << 5,
    "damper": 1 << 6,
    "gravity": 1 << 7,
}
"""Option of a file that can be disabled -> MuJoCo's bit."""


def _names(file_names: list[str], called: str) -> list[str]:
    """Return a name for each object, numbered if the file has none."""
    taken = set(file_names)
    names = []
    for i, name in enumerate(file_names):
        new = name or f"{called}{i}"
        while not name and new in taken:
            new += "_"
        taken.add(new)
        names.append(new)
    return names


# ---- Scene ---------------------------------------------------------------------------------------

FILES: Any = "the file's own"


def from_mjcf(path: str | os.PathLike[str], *, gravity: Triple | str | None = FILES) -> Mechanism:
    """Return the robot in an MJCF file, with the parameters of the file.

    Its coordinates are those of the file's joints, in their order, except that coordinates
    determined by constraints come first; a free joint has three slides along axes of the ground,
    then turns about z, y and x, a ball joint such turns. Equalities between bodies, sites and
    joints are constraints that hold exactly. Its `source.ignored` names the parts of the file that
    are left out.

    Args:
        path: the file.
        gravity: acceleration, m/s², or None without; by default that of the file.

    Returns:
        A scene, an instance of a `Mechanism` class of its own.

    Raises:
        InputError: the file cannot be read, is no MJCF, is refused by MuJoCo, has an element that
            is not understood here, or more than 200 coordinates.
        EngineError: MuJoCo is not installed.
    """
    return mjcf_kind(path, gravity=gravity)()


def mjcf_kind(
    path: str | os.PathLike[str], *, gravity: Triple | str | None = FILES
) -> type[Mechanism]:
    """Return the scene class of a file, of which `from_mjcf` returns the default scene."""
    file = path_of(path, "an MJCF")
    changed = not isinstance(gravity, str)
    pulls = gravity_of(gravity) if changed else None
    robot = read_mjcf(file)
    robot = robot._replace(gravity=pulls if changed else robot.gravity)
    options = f", gravity={pulls!r}" if changed else ""
    return robot_class(robot, "mjcf", path, options)
