"""Reader of SDF files: one model of Gazebo's format as elements of a description, as a scene.

In SDFormat (1.4 to 1.12) worlds, models, links, joints and frames are *frames* with names. The pose
of each is relative to another one, by default its model, or its child of a joint; a `_Frame` keeps
both, and poses between any two frames follow where all coordinates are 0. Names are resolved in a
*scope*, the model or world that contains them; the links of nested models have names with "::".
Axes of joints are along the axes of the joint's frame, before SDFormat 1.5 those of the model.

A joint moves its child about the origin of its own frame: where that is not the origin of the
child, a link without inertia is between them, and so between the axes of a joint that has two.
These are no links of the file and have no frames. A joint whose child is moved by another one
closes a loop: it becomes a constraint.
"""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from eomcheck.descriptions.doubtful_numbers import (
    LinkSize,
    axis_warning,
    body_warnings,
    default_warning,
    degree_warning,
    joined,
)
from eomcheck.descriptions.elements import ORIGIN, Constraint, Joint, Link, Triple, hinge, pin, weld
from eomcheck.descriptions.mechanism_class import Mechanism
from eomcheck.descriptions.mjcf_reader import FILES, triple_of
from eomcheck.descriptions.urdf_reader import (
    FLOATING,
    MAX_FILE_ELEMENTS,
    MOST_ELEMENTS,
    WORLD,
    Element,
    Format,
    Robot,
    Unreadable,
    finite_number,
    floating_pose,
    gravity_of,
    identifier,
    ignored_summary,
    ignored_tags,
    not_below_zero,
    path_of,
    robot_class,
    root_of,
    shape_reach,
    single_child,
    text_attribute,
)
from eomcheck.descriptions.vector_algebra import (
    IDENTITY,
    Quaternion,
    conjugate,
    is_turned,
    multiply_quaternions,
    of_length_one,
    roll_pitch_yaw,
    rotation_matrix,
)
from eomcheck.errors import did_you_mean
from eomcheck.numbers.generic import Array
from eomcheck.safe_output import listed

# ---- Elements ------------------------------------------------------------------------------------

SDF = Format("SDF", ("sdf",))

OLDEST, NEWEST = 4, 12
MINORS = {str(minor): minor for minor in range(OLDEST, NEWEST + 1)}
"""Minor versions of SDFormat 1 that are read."""

FRAMED = 7
"""First minor version with poses and axes in named frames; before, axes may be the model's."""

GAZEBO_GRAVITY: Triple = (0.0, 0.0, -9.8)
"""Gravity of a world without <gravity>."""

STANDARD_GRAVITY: Triple = (0.0, 0.0, -9.81)
"""Gravity of a model outside of a world, as of a URDF."""

MODEL_FRAME = "__model__"

KINDS = ("revolute", "continuous", "prismatic", "fixed", "ball", "universal", "revolute2", "screw")
"""Types of joints that are read."""

ENDLESS = 1e15
"""Smallest coordinate of a limit that is none."""

LONGEST = 1000
"""Largest number of characters in the names of a model and of those that contain it."""

SCENERY = {
    "actor": "actors",
    "atmosphere": "atmospheres",
    "audio": "sounds",
    "gui": "windows",
    "include": "included models",
    "light": "lights",
    "magnetic_field": "magnetic fields",
    "physics": "settings of physics engines",
    "plugin": "plugins",
    "population": "populations",
    "road": "roads",
    "scene": "looks of the scene",
    "spherical_coordinates": "spherical coordinates",
    "state": "states of the world",
    "wind": "winds",
}
"""Part of a world that is left out -> its name in the summary of ignored parts."""

OF_MODEL = {
    "gripper": "grippers",
    "plugin": "plugins",
    "static": "",
    "self_collide": "",
    "allow_auto_disable": "",
    "enable_wind": "wind",
    "model_state": "states of models",
}
OF_LINK = {
    "audio_sink": "sounds",
    "audio_source": "sounds",
    "battery": "batteries",
    "collision": "shapes to collide",
    "enable_wind": "wind",
    "gravity": "",
    "kinematic": "",
    "light": "lights",
    "must_be_base_link": "",
    "particle_emitter": "particle emitters",
    "projector": "projectors",
    "self_collide": "",
    "sensor": "sensors",
    "velocity_decay": "",
    "visual": "shapes to be seen",
}
OF_JOINT = {
    "gearbox_ratio": "",
    "gearbox_reference_body": "",
    "physics": "settings of physics engines",
    "sensor": "sensors",
    "screw_thread_pitch": "",
    "thread_pitch": "",
}
OF_AXIS = {"initial_position": "initial positions of joints"}
OF_INERTIAL = {"density": "", "auto_inertia_params": "", "fluid_added_mass": ""}

FLAGS = frozenset({"enable_wind"})
"""Elements that act if they are true."""


class RelativePose(NamedTuple):
    """Position, m, and orientation of a frame in another one."""

    place: Array
    turn: Quaternion

    def __matmul__(self, other: RelativePose) -> RelativePose:
        """Return the pose of a frame in the frame of this one."""
        place = self.place + rotation_matrix(self.turn) @ other.place
        return RelativePose(place, multiply_quaternions(self.turn, other.turn))

    @property
    def inverse(self) -> RelativePose:
        """The pose of the other frame in this one."""
        back = conjugate(self.turn)
        return RelativePose(-rotation_matrix(back) @ self.place, back)


class _Frame(NamedTuple):
    """A frame of the file."""

    pose: RelativePose
    base: str
    """Key of the frame in which the pose is."""
    body: str
    """Key of the frame that it is attached to; its own of a link."""
    where: str


class _Scope(NamedTuple):
    """Names inside of a model or of the world, and the keys of their frames."""

    prefix: str
    own: str
    """Key of its own frame."""
    others: tuple[str, str] = ("", "")
    """Name of a model in it, and the prefix of names inside of this model."""

    def key(self, name: str) -> str:
        """Return the key of the frame with a name."""
        name = name.removesuffix(f"::{MODEL_FRAME}")
        model, prefix = self.others
        if name in ("", MODEL_FRAME):
            return self.own
        if model and name == model:
            return prefix or MODEL_FRAME
        if model and name.startswith(f"{model}::"):
            return prefix + name.removeprefix(f"{model}::")
        return name if name == WORLD else self.prefix + name


class _Placed(NamedTuple):
    """An element with a frame."""

    element: Element
    scope: _Scope
    key: str
    where: str


STILL = RelativePose(np.zeros(3), IDENTITY)


def read_sdf(path: Path, model: str | None = None, floating: bool = False) -> Robot:
    """Return one model of an SDF file.

    Args:
        path: the file.
        model: name of the model; by default the only one.
        floating: whether its root is free to move.

    Raises:
        InputError: see `from_sdf`.
    """
    root = root_of(path, SDF)
    version = text_attribute(root, "version", repr(str(path)))
    major, _, minor = version.partition(".")
    if major != "1" or minor not in MINORS:
        wanted = f"expected 1.{OLDEST} to 1.{NEWEST}"
        raise Unreadable(f"{str(path)!r} is of SDFormat {version}, {wanted}")
    chosen, world = model_in(root, path, model)
    return _SdfReader(path, MINORS[minor]).model(chosen, world, floating)


def model_in(root: Element, path: Path, name: str | None) -> tuple[Element, Element | None]:
    """Return a model of a file, and the world that contains it.

    Raises:
        InputError: there is no such model, or no only one.
    """
    worlds = root.findall("world")
    models = [(model, None) for model in root.findall("model")]
    models += [(model, world) for world in worlds for model in world.findall("model")]
    names, file = [model.get("name", "") for model, _ in models], str(path)
    if not models:
        included = root.findall(".//include")
        more = ", only included ones, which are not read" if included else ""
        raise Unreadable(f"{file!r} has no model{more}")
    if name is not None and name not in names:
        known = f"expected one of: {', '.join(names)}"
        raise Unreadable(f"{file!r} has no model {name!r}, {known}{did_you_mean(name, names)}")
    if name is not None and names.count(name) > 1:
        raise Unreadable(f"{file!r} has {names.count(name)} models {name!r}, expected one")
    if name is None and len(models) > 1:
        known = listed([f"{file}:{x}" for x in names], 3)
        raise Unreadable(f"{file!r} has {len(models)} models, name one of them: {known}")
    return models[0 if name is None else names.index(name)]


class _SdfReader:
    """Converter of a model to elements of a description."""

    def __init__(self, path: Path, minor: int):
        self.path, self.minor, self.out = path, minor, Counter[str]()
        self.frames: dict[str, _Frame] = {WORLD: _Frame(STILL, "", WORLD, repr(str(path)))}
        self.depths: dict[str, int] = {WORLD: 0}
        self.steps = 0
        """Number of steps from a frame to the one that it refers to."""
        self.placed: dict[str, list[_Placed]] = {"link": [], "joint": []}
        self.links: list[Link] = [Link(WORLD)]
        self.joints: list[Joint] = []
        self.constraints: list[Constraint] = []
        self.moved: dict[str, str] = {}
        """Link -> the joint whose child it is."""
        self.types: dict[str, str | None] = {}
        """Key of a joint -> its type."""
        self.weightless: list[str] = []
        self.by_default: list[str] = []
        """Links whose mass or inertia is not in the file."""
        self.axes: list[tuple[str, str]] = []
        self.angles: list[tuple[str, str]] = []

    def model(self, model: Element, world: Element | None, floating: bool) -> Robot:
        """Return a model of a world, or of no world."""
        name = text_attribute(model, "name", repr(str(self.path)))
        where = f"{str(self.path)!r}: model {name!r}"
        scope = _Scope(f"{WORLD}::", WORLD, (name, ""))
        if world is not None:
            self._add_world(world, scope)
        self._add_model(model, scope, "", where)
        for tag, elements in self.placed.items():
            if len(elements) > MAX_FILE_ELEMENTS:
                what = f"{len(elements)} of <{tag}>, expected at most {MAX_FILE_ELEMENTS}"
                raise Unreadable(f"{where} has {what}")
        if not self.placed["link"]:
            raise Unreadable(f"{where} has no link")
        self.types = {x.key: x.element.get("type") for x in self.placed["joint"]}
        bodies = [placed.key for placed in self.placed["link"]]
        for link in self.placed["link"]:
            self.links.append(self._link(link))
        for joint in self.placed["joint"]:
            self._add_joint(joint)
        pose = self._hold_root(bodies, where, floating)
        shapes = {x.key: self._shapes(x) for x in self.placed["link"]}
        warnings = joined(
            *body_warnings(self.links, self.joints, shapes),
            default_warning(self.by_default),
            degree_warning(self.angles),
            axis_warning(self.axes),
        )
        return Robot(
            identifier(name),
            tuple(self.links),
            tuple(self.joints),
            ignored_summary(self.out),
            warnings,
            tuple(self.constraints),
            self._gravity(world, where),
            pose,
            bodies=tuple(bodies),
        )

    # ---- Frames ----------------------------------------------------------------------------------

    def _add_world(self, world: Element, scope: _Scope) -> None:
        where = f"{str(self.path)!r}: world"
        self.out["other models"] += len(world.findall("model")) - 1
        self._leave_out(world, SCENERY, frozenset({"model", "joint", "frame", "gravity"}), where)
        for frame in world.findall("frame"):
            self._add_frame(frame, scope, where)
        others = {x.get("name", "") for x in world.findall("model")} - {scope.others[0]}
        for joint in world.findall("joint"):
            ends = {_text(joint, tag, where).partition("::")[0] for tag in ("parent", "child")}
            if ends & others and ends <= others | {WORLD}:
                self.out["joints of other models"] += 1
            else:
                self._add_framed("joint", joint, scope, where)

    def _add_model(self, model: Element, outer: _Scope, key: str, where: str) -> None:
        """Add the frames of a model and of all that it contains."""
        if len(where) > len(str(self.path)) + LONGEST:
            raise Unreadable(
                f"{str(self.path)!r}: the names of a model and of those that contain it have more "
                f"than {LONGEST} characters"
            )
        if _flag(model, "static", where):
            raise Unreadable(f"{where} is static: nothing in it moves")
        if model.find("include") is not None:
            raise Unreadable(f"{where} includes another model, expected it in the file itself")
        read = frozenset({"link", "joint", "frame", "model", "pose", "include"})
        self._leave_out(model, OF_MODEL, read, where)
        own = key or MODEL_FRAME
        scope = _Scope(f"{key}::" if key else "", own)
        for tag in "link", "joint":
            for element in model.findall(tag):
                # Before SDFormat 1.7 a link may have the name of the world, and is the world.
                if self.minor >= FRAMED or (tag, element.get("name")) != ("link", WORLD):
                    self._add_framed(tag, element, scope, where)
        for element in model.findall("frame"):
            self._add_frame(element, scope, where)
        for nested in model.findall("model"):
            name = text_attribute(nested, "name", where)
            inner = f"{where}: model {name!r}"
            self._add_model(nested, scope, scope.key(name), inner)
        first = next((x for tag in ("link", "model") for x in model.findall(tag)), None)
        canonical = model.get("canonical_link") or (first is not None and first.get("name")) or ""
        pose, base = self._pose(model, outer, outer.own, where)
        if seat := model.get("placement_frame", ""):
            pose = pose @ self._within(scope.key(seat), own, where).inverse
        self._add(own, _Frame(pose, base, scope.key(canonical) if canonical else WORLD, where))

    def _add_framed(self, tag: str, element: Element, scope: _Scope, where: str) -> None:
        """Add the frame of a link or a joint."""
        name = text_attribute(element, "name", where)
        key, where = scope.key(name), f"{str(self.path)!r}: {tag} {name!r}"
        self.placed[tag].append(_Placed(element, scope, key, where))
        default, body = scope.own, key
        if tag == "joint":
            default = body = scope.key(_text(element, "child", where))
        self._add(key, _Frame(*self._pose(element, scope, default, where), body, where))

    def _add_frame(self, element: Element, scope: _Scope, where: str) -> None:
        """Add a frame that is fixed to another one."""
        name = text_attribute(element, "name", where)
        where = f"{str(self.path)!r}: frame {name!r}"
        carrier = scope.key(element.get("attached_to", ""))
        pose = self._pose(element, scope, carrier, where)
        self._add(scope.key(name), _Frame(*pose, carrier, where))

    def _add(self, key: str, frame: _Frame) -> None:
        if key in self.frames:
            raise Unreadable(f"{frame.where}: another link, joint or frame has this name")
        self.frames[key] = frame

    def _pose(
        self, element: Element, scope: _Scope, default: str, where: str, name: str = ""
    ) -> tuple[RelativePose, str]:
        """Return the pose of an element, by default of its name, and the key of its frame."""
        pose = single_child(element, "pose", where)
        if pose is None:
            return STILL, default
        base = pose.get("relative_to") or pose.get("frame") or ""
        read, angles = self._pose_of(pose, where)
        if angles:
            self.angles.append((name or element.get("name", ""), angles))
        return read, scope.key(base) if base else default

    def _pose_of(self, pose: Element, where: str) -> tuple[RelativePose, str]:
        """Return the numbers of a pose, and its angles in radians as text."""
        form, text = pose.get("rotation_format", "euler_rpy"), (pose.text or "").split()
        count = {"euler_rpy": 6, "quat_xyzw": 7}.get(form)
        if count is None:
            expected = "expected euler_rpy or quat_xyzw"
            raise Unreadable(f"{where}: rotation_format of <pose> is {form!r}, {expected}")
        text = text or ["0"] * 6 + ["1"] * (count - 6)
        if len(text) != count:
            raise Unreadable(f"{where}: <pose> has {len(text)} numbers, expected {count}")
        x, y, z, *turn = (finite_number(part, f"{where}: <pose>") for part in text)
        if count == 7:
            if not any(turn):
                raise Unreadable(f"{where}: <pose> has a quaternion of length 0")
            i, j, k, w = turn
            return RelativePose(np.array([x, y, z]), of_length_one((w, i, j, k))), ""
        angles = " ".join(text[3:])
        if _is_true(pose.get("degrees", "false"), f"{where}: degrees of <pose>"):
            turn, angles = [math.radians(angle) for angle in turn], ""
        return RelativePose(np.array([x, y, z]), roll_pitch_yaw(turn[0], turn[1], turn[2])), angles

    def _known(self, key: str, where: str) -> _Frame:
        """Return the frame of a key.

        Raises:
            InputError: there is none.
        """
        if key not in self.frames:
            name = _shown(key)
            hint = did_you_mean(name, self.frames)
            raise Unreadable(f"{where} refers to {name!r}, no link, joint, frame or model{hint}")
        return self.frames[key]

    def _step(self, where: str) -> None:
        """Count a step; a file with long chains of frames would take hours otherwise."""
        self.steps += 1
        if self.steps > MOST_ELEMENTS:
            raise Unreadable(
                f"{where}: frames refer to others in chains of more than {MOST_ELEMENTS} in all"
            )

    def _depth(self, key: str, where: str) -> int:
        """Return the number of frames between a frame and the world."""
        chain: dict[str, None] = {}
        while key not in self.depths:
            if key in chain:
                raise Unreadable(f"{where}: the pose of {key!r} is relative to itself")
            chain[key] = None
            self._step(where)
            frame = self._known(key, where)
            key, where = frame.base, frame.where
        depth = self.depths[key]
        for i, name in enumerate(reversed(chain), 1):
            self.depths[name] = depth + i
        return depth + len(chain)

    def _relative(self, key: str, other: str, where: str) -> RelativePose:
        """Return the pose of a frame in another one where all coordinates are 0."""
        depth, other_depth = self._depth(key, where), self._depth(other, where)
        pose = back = STILL
        while key != other:
            self._step(where)
            if depth >= other_depth:
                pose, key, depth = self.frames[key].pose @ pose, self.frames[key].base, depth - 1
            else:
                frame = self.frames[other]
                back, other, other_depth = frame.pose @ back, frame.base, other_depth - 1
        return back.inverse @ pose

    def _within(self, key: str, model: str, where: str) -> RelativePose:
        """Return the pose of a frame in its model, whose own pose is not known yet."""
        self._add(model, _Frame(STILL, WORLD, WORLD, where))
        try:
            return self._relative(key, model, where)
        finally:
            del self.frames[model]
            self.depths = {WORLD: 0}

    def _body(self, key: str, where: str) -> str:
        """Return the link that a frame is attached to, or the world."""
        visited: set[str] = set()
        while (body := self._known(key, where).body) != key:
            if key in visited:
                raise Unreadable(f"{where}: {key!r} is attached to itself")
            visited.add(key)
            self._step(where)
            key = body
        return key

    # ---- Links -----------------------------------------------------------------------------------

    def _leave_out(
        self, element: Element, ignored: dict[str, str], read: frozenset[str], where: str
    ) -> None:
        """Count the parts of an element that are left out."""
        for tag in ignored_tags(element, frozenset(ignored), where, read, SDF):
            if tag not in read and ignored.get(tag, tag):
                self.out[ignored.get(tag, tag)] += tag not in FLAGS or _flag(element, tag, where)

    def _link(self, link: _Placed) -> Link:
        element, where = link.element, link.where
        self._leave_out(element, OF_LINK, frozenset({"inertial", "pose"}), where)
        if _flag(element, "kinematic", where):
            raise Unreadable(f"{where} is kinematic: no force moves it")
        decay = element.find("velocity_decay")
        for kind in "linear", "angular":
            drag = 0.0 if decay is None else _number(decay, kind, where, 0.0)
            self.out["decay of velocities"] += drag != 0.0
        if not _flag(element, "gravity", where, True):
            self.weightless.append(link.key)
        inertial = single_child(element, "inertial", where)
        if inertial is None:
            self.by_default.append(link.key)
            return Link(link.key, 1.0, ORIGIN, (1.0, 1.0, 1.0))
        if _is_true(inertial.get("auto", "false"), f"{where}: auto of <inertial>"):
            raise Unreadable(f"{where}: the inertia follows from shapes, expected its numbers")
        read = frozenset({"mass", "inertia", "pose", "frame"})
        self._leave_out(inertial, OF_INERTIAL, read, f"{where}: <inertial>")
        added = inertial.iterfind("fluid_added_mass/*")
        if any(_number(x, None, where, 0.0) for x in added):
            raise Unreadable(f"{where} has an added mass of a fluid, expected none")
        inertia = single_child(inertial, "inertia", where)
        if inertia is None or inertial.find("mass") is None:
            self.by_default.append(link.key)
        mass = not_below_zero(_number(inertial, "mass", where, 1.0), "mass", where)
        moments = [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]
        if inertia is not None:
            names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
            defaults = zip(names, moments, strict=True)
            moments = [_number(inertia, name, where, default) for name, default in defaults]
        pose, base = self._pose(inertial, link.scope, link.key, where, link.key)
        if base != link.key:
            raise Unreadable(f"{where}: the pose of <inertial> is in another frame than the link")
        xx, yy, zz, xy, xz, yz = moments
        body = Link(link.key, mass, triple_of(pose.place), (xx, yy, zz), (xy, xz, yz))
        if not is_turned(pose.turn):
            return body
        R = rotation_matrix(pose.turn)
        return Link.with_inertia(body.name, mass, body.center, R @ body.inertia @ R.T)

    def _shapes(self, link: _Placed) -> LinkSize:
        """Return the size of the shapes of a link; not whole with meshes, or without any."""
        shapes = [x for tag in ("visual", "collision") for x in link.element.findall(tag)]
        known = [reach for x in shapes if (reach := self._reach(x)) is not None]
        return LinkSize(max(known, default=0.0), bool(shapes) and len(known) == len(shapes))

    def _reach(self, shape: Element) -> float | None:
        """Return the largest distance of a shape from its link, m; None where it is not known."""
        kind, pose = shape.find("geometry/*"), shape.find("pose")
        if kind is None or (pose is not None and pose.get("relative_to")):
            return None
        try:
            place = STILL.place if pose is None else self._pose_of(pose, "")[0].place
            return shape_reach(kind.tag, triple_of(place), lambda name: kind.findtext(name) or "")
        except Unreadable:  # shapes are not read otherwise
            return None

    def _gravity(self, world: Element | None, where: str) -> Triple | None:
        """Return the gravity of the world, None where no link has weight."""
        heavy = [link.name for link in self.links if link.mass > 0]
        if heavy and {*heavy} <= {*self.weightless}:
            return None
        if floats := [name for name in self.weightless if name in heavy]:
            others = next(name for name in heavy if name not in floats)
            unlike = f"expected the same of all links, {others!r} has weight"
            raise Unreadable(f"{where}: link {floats[0]!r} has no gravity, {unlike}")
        if world is None:
            return STANDARD_GRAVITY
        # Before SDFormat 1.6 it is a part of <physics>.
        inside = next(
            (x for x in (world, *world.findall("physics")) if x.find("gravity") is not None), world
        )
        gravity = _triple(inside, "gravity", where, GAZEBO_GRAVITY)
        return gravity if any(gravity) else None

    # ---- Joints ----------------------------------------------------------------------------------

    def _add_joint(self, joint: _Placed) -> None:
        """Add a joint, with links without inertia where it needs them."""
        element, where = joint.element, joint.where
        read = frozenset({"parent", "child", "pose", "axis", "axis2"})
        self._leave_out(element, OF_JOINT, read, where)
        kind = text_attribute(element, "type", where)
        if kind not in KINDS:
            raise Unreadable(f"{where} has the type {kind!r}, expected one of: {', '.join(KINDS)}")
        ends = [joint.scope.key(_text(element, tag, where)) for tag in ("parent", "child")]
        parent, child = (self._body(key, where) for key in ends)
        if child == WORLD:
            raise Unreadable(f"{where} has the child 'world', expected it as the parent")
        if parent == child:
            raise Unreadable(f"{where} is between {parent!r} and itself")
        mount = self._relative(child, parent, where)
        seat, own = (self._relative(joint.key, link, where) for link in (parent, child))
        name = _shown(joint.key)
        axes = [*self._axes(joint, kind, name, own)]
        if child in self.moved:
            self._close(kind, name, (parent, child), mount, (seat, own), axes, where)
            return
        self.moved[child] = name
        if kind in ("fixed", "ball"):
            self._add_rigid(kind, name, (parent, child), mount, seat, own, axes)
            return
        # The frame at the joint has the axes of the child.
        turn, before = mount.turn, parent
        offset = own.place if any(one.kind != "prismatic" for one in axes) else np.zeros(3)
        place = triple_of(seat.place if offset.any() else mount.place)
        for i, one in enumerate(axes):
            last = i == len(axes) - 1 and not offset.any()
            after = child if last else f"{child} after {one.name}"
            if not last:
                self.links.append(Link(after))
            self.joints.append(
                one._replace(parent=before, child=after, origin=place, orientation=_plain(turn))
            )
            before, place, turn = after, ORIGIN, IDENTITY
        if offset.any():
            self._fix(before, child, RelativePose(-offset, IDENTITY))

    def _add_rigid(
        self,
        kind: str,
        name: str,
        links: tuple[str, str],
        mount: RelativePose,
        seat: RelativePose,
        own: RelativePose,
        axes: list[Joint],
    ) -> None:
        """Add a fixed joint, or a ball, whose coordinates are about the axes of its frame."""
        parent, child = links
        moves = kind == "ball" and (own.place.any() or is_turned(own.turn))
        after, pose = (f"{child} after {name}", seat) if moves else (child, mount)
        damping = next((one.damping for one in axes), None)
        called = "spherical" if kind == "ball" else kind
        at = triple_of(pose.place), _plain(pose.turn)
        self.joints.append(Joint(name, called, parent, after, *at, damping=damping))
        if moves:
            self.links.append(Link(after))
            self._fix(after, child, own.inverse)

    def _fix(self, parent: str, child: str, pose: RelativePose) -> None:
        """Add the joint that fixes a link to one before it."""
        at = triple_of(pose.place), _plain(pose.turn)
        self.joints.append(Joint(f"{child} fixed", "fixed", parent, child, *at))

    def _axes(self, joint: _Placed, kind: str, name: str, own: RelativePose) -> Iterator[Joint]:
        """Yield the axes of a joint, along those of its child, as joints that are not mounted."""
        element, where = joint.element, joint.where
        first, second = (single_child(element, tag, where) for tag in ("axis", "axis2"))
        match kind:
            case "fixed":
                return
            case "ball":
                if first is not None:
                    one = self._axis(first, joint, name, "revolute", own)
                    if one.stiffness is not None or one.mimics is not None:
                        wanted = "expected a damper at most"
                        raise Unreadable(f"{where} is a ball with a spring or a leader, {wanted}")
                    yield one
            case "universal" | "revolute2":
                yield self._axis(first, joint, f"{name}_axis", "revolute", own)
                yield self._axis(second, joint, f"{name}_axis2", "revolute", own)
            case "screw":
                turns = self._axis(first, joint, name, "revolute", own)
                slides = Joint(f"{name}_slide", "prismatic", "", "", axis=turns.axis)
                yield turns
                yield slides._replace(mimics=(name, _thread(element, where), 0.0))
            case _:
                slides = kind == "prismatic"
                yield self._axis(first, joint, name, kind if slides else "revolute", own)

    def _axis(
        self, axis: Element | None, joint: _Placed, name: str, kind: str, own: RelativePose
    ) -> Joint:
        """Return one axis of a joint, with its damper, spring and the joint that it follows."""
        where = joint.where
        if axis is None:
            raise Unreadable(f"{where} has no <axis{'2' if name.endswith('_axis2') else ''}>")
        old, of_model = self.minor < FRAMED, "use_parent_model_frame"
        read = frozenset({"xyz", "dynamics", "mimic", "limit"}) | ({of_model} if old else set())
        self._leave_out(axis, OF_AXIS, read, where)
        limit = axis.find("limit")
        if limit is not None and any(map(_bounds, (limit.find("lower"), limit.find("upper")))):
            self.out["limits of joints"] += 1
        xyz, along = single_child(axis, "xyz", where), (0.0, 0.0, 1.0)
        if xyz is not None:
            along = _triple(axis, "xyz", where, along)
            self.axes.append((name, xyz.text or ""))
        turn = own.turn
        if old and _flag(axis, of_model, where, self.minor == OLDEST):
            turn = self._relative(joint.scope.own, self._body_of_child(joint), where).turn
        elif xyz is not None and (frame := xyz.get("expressed_in", "")):
            key = joint.scope.key(frame)
            turn = self._relative(key, self._body_of_child(joint), where).turn
        if is_turned(turn):
            along = triple_of(rotation_matrix(turn) @ np.array(along))
        return self._with_forces(Joint(name, kind, "", "", axis=along), axis, joint)

    def _body_of_child(self, joint: _Placed) -> str:
        key = joint.scope.key(_text(joint.element, "child", joint.where))
        return self._body(key, joint.where)

    def _with_forces(self, one: Joint, axis: Element, joint: _Placed) -> Joint:
        """Return a joint with the damper, the spring and the leader of an axis."""
        where, more = joint.where, dict[str, Any]()
        dynamics = single_child(axis, "dynamics", where)
        if dynamics is not None:
            names = {"damping": "damping", "spring_stiffness": "stiffness"}
            for tag, name in names.items():
                number = not_below_zero(_number(dynamics, tag, where, 0.0), tag, where)
                more[name] = number or None
            if more["stiffness"] is not None:
                more["rest_position"] = _number(dynamics, "spring_reference", where, 0.0)
            self.out["friction of joints"] += _number(dynamics, "friction", where, 0.0) != 0.0
        mimic = single_child(axis, "mimic", where)
        if mimic is not None:
            key = joint.scope.key(text_attribute(mimic, "joint", where))
            which = mimic.get("axis", "axis")
            leader = _shown(key)
            if self.types.get(key) in ("universal", "revolute2"):
                leader += f"_{which}"
            elif which != "axis":
                raise Unreadable(f"{where} follows {which!r} of {leader!r}, which has one axis")
            ratio, offset, reference = (
                _number(mimic, tag, where, default)
                for tag, default in (("multiplier", 1.0), ("offset", 0.0), ("reference", 0.0))
            )
            more["mimics"] = leader, ratio, offset - ratio * reference
        return one._replace(**more)

    def _close(
        self,
        kind: str,
        name: str,
        links: tuple[str, str],
        mount: RelativePose,
        poses: tuple[RelativePose, RelativePose],
        axes: list[Joint],
        where: str,
    ) -> None:
        """Add the constraint of a joint whose child another joint moves: it closes a loop."""
        points = triple_of(poses[0].place), triple_of(poses[1].place)
        forces = any(x is not None for a in axes for x in (a.damping, a.stiffness, a.mimics))
        ends = *links, *points
        match kind:
            case "ball":
                self.out["dampers of balls that close loops"] += forces
                constraint = pin(name, *ends)
            case "fixed":
                constraint = weld(name, *ends, mount.turn)
            case "revolute" | "continuous" if not forces:
                along = axes[0].axis
                of_parent = rotation_matrix(mount.turn) @ np.array(along)
                constraint = hinge(name, *ends, triple_of(of_parent), along)
            case _:
                other = f"the link {links[1]!r}, which {self.moved[links[1]]!r} moves"
                wanted = "expected a fixed joint, a ball or a hinge without forces"
                raise Unreadable(f"{where} closes a loop at {other}, {wanted}")
        self.constraints.append(constraint)

    def _hold_root(self, bodies: list[str], where: str, floating: bool) -> dict[str, float]:
        """Fix the root to the world where it is, or set it free; return its initial pose."""
        held = [joint.name for joint in self.joints if joint.parent == WORLD]
        roots = [name for name in bodies if name not in self.moved]
        if held:
            if floating:
                raise Unreadable(f"{where} is held by joint {held[0]!r}, and is not free")
            return {}
        if len(roots) != 1:
            self.links.pop(0)  # refused later
            return {}
        ground = [x.name for x in self.constraints if WORLD in [link for link, _ in x.points]]
        if ground and not floating:
            file = f"{self.path}:{FLOATING}"
            only = f"only joint {ground[0]!r}, which closes a loop, holds the root {roots[0]!r}"
            raise Unreadable(f"{where}: {only}; {file!r} sets it free")
        (root,) = roots
        pose = self._relative(root, WORLD, where)
        if floating:
            self.joints.insert(0, Joint(root, "floating", WORLD, root))
            return floating_pose(root, pose.place, pose.turn)
        if not self.joints:
            file = f"{self.path}:{FLOATING}"
            raise Unreadable(f"{where} has no joint; {file!r} sets its link free")
        if pose.place.any() or is_turned(pose.turn):
            self._fix(WORLD, root, pose)
        else:
            self.links.pop(0)
        return {}


# ---- Numbers -------------------------------------------------------------------------------------


def _text(element: Element, tag: str, where: str) -> str:
    """Return the text of a required child."""
    child = single_child(element, tag, where)
    text = "" if child is None else (child.text or "").strip()
    if not text:
        raise Unreadable(f"{where} has no <{tag}>")
    return text


def _number(element: Element, tag: str | None, where: str, default: float) -> float:
    """Return the number in a child, or in the element itself; the default without one."""
    child = element if tag is None else single_child(element, tag, where)
    if child is None or not (child.text or "").strip():
        return default
    return finite_number((child.text or "").strip(), f"{where}: <{child.tag}>")


def _triple(element: Element, tag: str, where: str, default: Triple) -> Triple:
    """Return the three numbers in a child; the default without one."""
    child = single_child(element, tag, where)
    parts = [] if child is None else (child.text or "").split()
    if not parts:
        return default
    if len(parts) != 3:
        raise Unreadable(f"{where}: <{tag}> is {' '.join(parts)!r}, expected three numbers")
    x, y, z = (finite_number(part, f"{where}: <{tag}>") for part in parts)
    return x, y, z


def _is_true(text: str, name: str) -> bool:
    """Return the truth of a text."""
    if text.lower() in ("true", "1"):
        return True
    if text.lower() in ("false", "0"):
        return False
    raise Unreadable(f"{name} is {text!r}, expected true or false")


def _flag(element: Element, tag: str, where: str, default: bool = False) -> bool:
    """Return the truth in a child; the default without one."""
    child = single_child(element, tag, where)
    text = "" if child is None else (child.text or "").strip()
    return _is_true(text, f"{where}: <{tag}>") if text else default


def _bounds(limit: Element | None) -> bool:
    """Return whether a limit bounds a coordinate."""
    try:
        return limit is not None and abs(float(limit.text or "inf")) < ENDLESS
    except ValueError:
        return True


def _thread(element: Element, where: str) -> float:
    """Return the advance of a screw, m/rad.

    `screw_thread_pitch` is in meters per turn, right-handed; before, `thread_pitch` in radians per
    meter, left-handed.
    """
    if element.find("screw_thread_pitch") is None and element.find("thread_pitch") is not None:
        pitch = _number(element, "thread_pitch", where, 1.0)
        if not pitch:
            raise Unreadable(f"{where}: <thread_pitch> is 0, expected another number")
        return -1.0 / pitch
    return _number(element, "screw_thread_pitch", where, 1.0) / (2.0 * math.pi)


def _shown(key: str) -> str:
    """Return the name of an element by its key."""
    return key.removeprefix(f"{WORLD}::")


def _plain(turn: Quaternion) -> Quaternion:
    """Return a rotation, the identity itself if it is none."""
    return turn if is_turned(turn) else IDENTITY


# ---- Scene ---------------------------------------------------------------------------------------


def from_sdf(
    path: str | os.PathLike[str],
    *,
    model: str | None = None,
    floating: bool = False,
    gravity: Triple | str | None = FILES,
) -> Mechanism:
    """Return the robot in an SDF file, with the parameters of the file.

    Its coordinates are those of the file's joints, in their order. A joint with two axes has the
    coordinates of two hinges, `NAME_axis` and `NAME_axis2`, a ball joint turns about z, y and x of
    its frame, a screw one turn. A joint of a link that another joint moves already closes a loop, a
    constraint. Its `source.ignored` names the parts of the file that are left out,
    `source.warnings` the numbers that no physical body has: they are used unchanged.

    Args:
        path: the file, of SDFormat 1.4 to 1.12.
        model: name of the model; by default the only one.
        floating: whether its root is free to move: three slides, then turns about z, y and x, come
            first. Otherwise the root is fixed to the world, in its pose in the file.
        gravity: acceleration, m/s², or None without; by default that of the file's world, -9.8
            along z if it has none, and -9.81 of a model without a world.

    Returns:
        A scene, an instance of a `Mechanism` class of its own.

    Raises:
        InputError: the file cannot be read, is no SDF, has several models, contradicts itself, has
            an element that is not understood here, or more than 200 coordinates.
    """
    return sdf_kind(path, model=model, floating=floating, gravity=gravity)()


def sdf_kind(
    path: str | os.PathLike[str],
    *,
    model: str | None = None,
    floating: bool = False,
    gravity: Triple | str | None = FILES,
) -> type[Mechanism]:
    """Return the scene class of a file, of which `from_sdf` returns the default scene."""
    file = path_of(path, "an SDF")
    changed = not isinstance(gravity, str)
    pulls = gravity_of(gravity) if changed else None
    robot = read_sdf(file, model, floating)
    robot = robot._replace(gravity=pulls if changed else robot.gravity)
    options = "" if model is None else f", model={model!r}"
    options += ", floating=True" if floating else ""
    options += f", gravity={pulls!r}" if changed else ""
    base = robot.joints[0].child if floating else ""
    return robot_class(robot, "sdf", path, options, base, model or "")
