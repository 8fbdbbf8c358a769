"""Patch of the inertials of a robot file, so that its bodies are those of another robot.

The bodies of the first robot are expressed in the frames of the links of the second one. Only
numbers in the text of the second file are replaced: the patch is a unified diff, for `patch -p0`.
Links that are fixed to each other are one body, and one link of it is mended.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple
from xml.parsers import expat

import numpy as np

from eomcheck.descriptions.elements import Link
from eomcheck.descriptions.joint_tree import ROUNDED, RigidBody, merged_body, point_inertia
from eomcheck.descriptions.mjcf_reader import included_files, read_mjcf
from eomcheck.descriptions.urdf_reader import Robot, read_urdf
from eomcheck.descriptions.vector_algebra import roll_pitch_yaw, rotation_matrix
from eomcheck.errors import InputError
from eomcheck.lab.robot_comparison import BodyPair, RobotComparison, body_pairs
from eomcheck.mechanics.records import TreeFrame
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array

BODY = frozenset({"mass", "center of mass", "inertia"})
"""Differences that a patch mends."""

READERS = {"urdf": read_urdf, "mjcf": read_mjcf}


def inertial_patch(first: Scene, second: Scene, comparison: RobotComparison) -> str:
    """Return the patch of the second robot's file, a unified diff; "" if its bodies do not differ.

    Args:
        first: the robot whose bodies are right.
        second: the robot whose file is mended.
        comparison: their comparison.

    Raises:
        InputError: the second robot has no file, or a body that no number in it mends.
    """
    file, robot = file_and_robot(second)
    if file is None or robot is None:
        of_format = getattr(getattr(second, "source", None), "format", "").upper()
        if of_format:
            raise InputError(f"the file of {second.name} is an {of_format}, and is not patched")
        raise InputError(f"{second.name} has no file to patch")
    differ = {x.where for x in comparison.differences if x.what in BODY}
    pairs = [pair for pair in body_pairs(first, second, comparison) if pair.name in differ]
    _, right = file_and_robot(first)
    links = [mended_link(pair, right, robot) for pair in pairs]
    is_urdf = robot.compiled is None
    files = [XmlFile(path) for path in ([file] if is_urdf else included_files(file))]
    for link in links:
        (_mend_urdf if is_urdf else _mend_mjcf)(files, link)
    return "".join(file.diff() for file in files)


def file_and_robot(scene: Scene) -> tuple[Path | None, Robot | None]:
    """Return the file of a scene and its contents; None without a file."""
    source = getattr(scene, "source", None)
    if source is None or source.format not in READERS:
        return None, None
    path = Path(source.file)
    return path, READERS[source.format](path)


# ---- Links ---------------------------------------------------------------------------------------


def mended_link(pair: BodyPair, first: Robot | None, second: Robot) -> Link:
    """Return the link of a body that is mended, with its new inertia about its centre of mass.

    Of several links that are fixed to each other it is the only one that differs from that of the
    same name in the first robot, and otherwise the heaviest.

    Raises:
        InputError: no inertia of this link makes the body that of the first robot.
    """
    links = {link.name: link for link in second.links}
    frames = {frame.name: frame for frame in pair.frames if frame.name in links}
    if not frames:
        raise InputError(f"{pair.name}: the second file has no link of it")
    ours = {} if first is None else {link.name: link for link in first.links}
    own = [links[x] for x in frames if links[x].has_inertia] or [links[next(iter(frames))]]
    differ = [link for link in own if link.name in ours and ours[link.name] != link]
    chosen = differ[0] if len(differ) == 1 else max(own, key=lambda link: link.mass)
    others = [_placed(link, frames[link.name]) for link in own if link is not chosen]
    rest, frame = _without(pair.body, others), frames[chosen.name]
    if rest is None:
        names = ", ".join(repr(link.name) for link in own if link is not chosen)
        raise InputError(
            f"{pair.name}: no inertia of {chosen.name!r} makes it that of the first robot, beside "
            f"those of {names}"
        )
    x, y, z = (frame.R.T @ (rest.center - frame.p)).tolist()
    return Link.with_inertia(chosen.name, rest.mass, (x, y, z), frame.R.T @ rest.inertia @ frame.R)


def _placed(link: Link, frame: TreeFrame) -> RigidBody:
    """Return the body of a link along the axes in which its frame is given."""
    center = frame.p + frame.R @ np.array(link.center)
    return RigidBody(link.mass, center, frame.R @ link.inertia @ frame.R.T)


def _without(whole: RigidBody, parts: list[RigidBody]) -> RigidBody | None:
    """Return a body less parts of it; None if that is no body."""
    if not parts:
        return whole
    part = merged_body(parts)
    mass = whole.mass - part.mass
    if mass <= 0.0:
        return None
    center = (whole.mass * whole.center - part.mass * part.center) / mass
    # Of the parts together, about their common centre of mass, by Steiner.
    inertia = whole.inertia - part.inertia
    for point, m in (center, mass), (part.center, part.mass):
        inertia = inertia - point_inertia(m, point - whole.center)
    least = float(np.linalg.eigvalsh(inertia)[0])
    possible = least >= -ROUNDED * float(np.abs(whole.inertia).max())
    return RigidBody(mass, center, inertia) if possible else None


# ---- Texts ---------------------------------------------------------------------------------------

ATTRIBUTE = rb"""(\s%s\s*=\s*)(?:"[^"]*"|'[^']*')"""
"""Pattern of an attribute in a start tag, for its name."""


class XmlElement(NamedTuple):
    """An element in the text of a file, with offsets in bytes."""

    tag: str
    attributes: dict[str, str]
    parent: int
    """Index of its parent, -1 for the root."""
    start: int
    head: int
    """End of its start tag."""


class XmlFile:
    """The text of a file, in which numbers are replaced.

    Args:
        path: the file, whose XML is well-formed.

    Raises:
        InputError: its encoding is not UTF-8.
    """

    def __init__(self, path: Path):
        self.path, self.data = path, path.read_bytes()
        try:
            self.data.decode("utf-8")
        except UnicodeDecodeError:
            raise InputError(f"{str(path)!r} is not in UTF-8, and is not patched") from None
        self.elements = list(self._elements())
        self._edits: list[tuple[int, int, bytes]] = []

    def _elements(self) -> Iterator[XmlElement]:
        parser, found, stack = expat.ParserCreate(), list[XmlElement](), list[int]()

        def opened(tag: str, attributes: dict[str, str]) -> None:
            start = parser.CurrentByteIndex
            head = re.compile(rb"""(?:"[^"]*"|'[^']*'|[^"'>])*>""").match(self.data, start)
            end = start if head is None else head.end()
            parent = stack[-1] if stack else -1
            stack.append(len(found))
            found.append(XmlElement(tag.rpartition(":")[2], attributes, parent, start, end))

        parser.StartElementHandler = opened
        parser.EndElementHandler = lambda tag: stack.pop()
        parser.Parse(self.data, True)
        return iter(found)

    def named(self, tag: str, name: str) -> int | None:
        """Return the index of the element of a tag and name; None without one."""
        places = enumerate(self.elements)
        return next(
            (i for i, x in places if (x.tag, x.attributes.get("name")) == (tag, name)), None
        )

    def child(self, i: int, tag: str) -> int | None:
        """Return the index of the first child of a tag; None without one."""
        places = enumerate(self.elements)
        return next((k for k, x in places if (x.parent, x.tag) == (i, tag)), None)

    def set(self, i: int, values: Mapping[str, str], without: Iterable[str] = ()) -> None:
        """Set attributes of an element, and remove others."""
        element = self.elements[i]
        text = self.data[element.start : element.head]
        for name in without:
            text = re.sub(ATTRIBUTE % name.encode(), b"", text)
        for name, value in values.items():
            pattern, new = ATTRIBUTE % name.encode(), value.encode()
            if re.search(pattern, text):
                text = re.sub(pattern, lambda x, new=new: x[1] + b'"' + new + b'"', text)
            else:
                end = re.search(rb"\s*/?>$", text)
                assert end is not None
                more = b' %s="%s"' % (name.encode(), new)
                text = text[: end.start()] + more + text[end.start() :]
        self._edits.append((element.start, element.head, text))

    def insert(self, i: int, child: str) -> None:
        """Insert a child at the beginning of an element."""
        element = self.elements[i]
        head = self.data[element.start : element.head]
        line = self.data[: element.start].rpartition(b"\n")[2]
        indent = line if not line.strip() else b""
        newline = b"\r\n" if b"\r\n" in self.data else b"\n"
        text = b"".join(newline + indent + b"  " + x.encode() for x in child.splitlines())
        if head.endswith(b"/>"):
            close = newline + indent + b"</%s>" % element.tag.encode()
            self._edits.append((element.start, element.head, head[:-2] + b">" + text + close))
        else:
            self._edits.append((element.head, element.head, text))

    def diff(self) -> str:
        """Return the unified diff of the changes; "" without any."""
        data = self.data
        for start, end, text in sorted(self._edits, reverse=True):
            data = data[:start] + text + data[end:]
        before, after = (x.decode("utf-8").split("\n") for x in (self.data, data))
        lines = [
            [*(f"{line}\n" for line in x[:-1]), *([x[-1]] if x[-1] else [])]
            for x in (before, after)
        ]
        name = str(self.path)
        parts = difflib.unified_diff(*lines, fromfile=name, tofile=name)
        return "".join(
            x if x.endswith("\n") else f"{x}\n\\ No newline at end of file\n" for x in parts
        )


# ---- Inertials -----------------------------------------------------------------------------------


def _numbers(x: Iterable[float]) -> str:
    return " ".join(repr(float(y)) for y in x)


def _changed(texts: Sequence[str], numbers: Sequence[float], size: float) -> list[str]:
    """Return numbers as text: as in the file where they differ by rounding relative to `size`."""
    return [
        text if abs(float(text) - x) <= ROUNDED * size else repr(float(x))
        for text, x in zip(texts, numbers, strict=True)
    ]


def _mend_urdf(files: list[XmlFile], link: Link) -> None:
    """Replace the inertial of a link of a URDF, along the axes that its `rpy` turns to."""
    (file,) = files
    place = file.named("link", link.name)
    assert place is not None
    inertial = file.child(place, "inertial")
    names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    if inertial is None:
        entries = zip(names, (*link.moments, *link.products), strict=True)
        inertia = " ".join(f'{name}="{float(x)!r}"' for name, x in entries)
        file.insert(
            place,
            f'<inertial>\n  <origin xyz="{_numbers(link.center)}" rpy="0 0 0"/>\n'
            f'  <mass value="{float(link.mass)!r}"/>\n  <inertia {inertia}/>\n</inertial>',
        )
        return
    origin, R = file.child(inertial, "origin"), np.eye(3)
    if origin is None:
        if any(link.center):
            file.insert(inertial, f'<origin xyz="{_numbers(link.center)}" rpy="0 0 0"/>')
    else:
        turn = [float(x) for x in file.elements[origin].attributes.get("rpy", "0 0 0").split()]
        R = rotation_matrix(roll_pitch_yaw(*turn))
        texts = file.elements[origin].attributes.get("xyz", "0 0 0").split()
        gyration = float(np.sqrt(np.trace(link.inertia) / link.mass)) if link.mass else 0.0
        size = max(map(abs, link.center)) + gyration
        file.set(origin, {"xyz": " ".join(_changed(texts, link.center, size))})
    turned: Array = R.T @ link.inertia @ R
    places = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    new = {"mass": {"value": float(link.mass)}}
    new["inertia"] = {name: float(turned[at]) for name, at in zip(names, places, strict=True)}
    for tag, values in new.items():
        child = file.child(inertial, tag)
        assert child is not None
        old = [file.elements[child].attributes.get(name, "0") for name in values]
        texts = _changed(old, [*values.values()], max(map(abs, values.values())))
        file.set(child, dict(zip(values, texts, strict=True)))


ORIENTATIONS = "quat", "axisangle", "xyaxes", "zaxis", "euler"
"""Attributes of MJCF, each an orientation."""


def _mend_mjcf(files: list[XmlFile], link: Link) -> None:
    """Replace the inertial of a body of an MJCF, or give it one, along the axes of the body.

    Raises:
        InputError: the body is not written out, or the compiler of the file sets inertias.
    """
    compilers = (x.attributes for file in files for x in file.elements if x.tag == "compiler")
    for attributes in compilers:
        if attributes.get("inertiafromgeom") == "true" or "settotalmass" in attributes:
            raise InputError("the compiler of the file sets masses or inertias: it is not patched")
    place, file = next(
        ((i, x) for x in files if (i := x.named("body", link.name)) is not None), (None, None)
    )
    if file is None or place is None:
        raise InputError(f"body {link.name!r} is not written out in the file, and is not patched")
    values = {
        "pos": _numbers(link.center),
        "mass": repr(float(link.mass)),
        "fullinertia": _numbers((*link.moments, *link.products)),
    }
    inertial = file.child(place, "inertial")
    if inertial is None:
        text = " ".join(f'{name}="{value}"' for name, value in values.items())
        file.insert(place, f"<inertial {text}/>")
    else:
        file.set(inertial, values, (*ORIENTATIONS, "diaginertia"))
