"""Texts of SDF files for tests: trees in random conventions of poses, frames and axes."""

from __future__ import annotations

from typing import Any

import numpy as np

from eomcheck.descriptions.elements import Joint, Link
from eomcheck.descriptions.random_trees import RandomDescription
from eomcheck.descriptions.vector_algebra import roll_pitch_yaw_of, rotation_matrix

Matrix = Any

KINDS = {"revolute": ("revolute", "continuous"), "prismatic": ("prismatic",), "fixed": ("fixed",)}


def transform(R: Matrix, p: Matrix) -> Matrix:
    """Return the matrix (4, 4) of a pose."""
    return np.block([[np.asarray(R), np.reshape(p, (3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]])


def sdf_text(random: np.random.Generator, tree: RandomDescription, minor: int) -> str:
    """Return the SDF of a tree of hinges, slides and fixed joints, in version 1.`minor`.

    The frames of links, of joints and of inertials are drawn, and so is the frame that each pose
    is in, as far as the version has such frames.
    """
    return _Writer(random, minor).text(tree)


class _Writer:
    """Writer of one file."""

    def __init__(self, random: np.random.Generator, minor: int):
        self.random, self.minor = random, minor
        self.frames: dict[str, Matrix] = {}
        """Frames of the model that poses may be in, as seen from the world."""

    def text(self, tree: RandomDescription) -> str:
        ground = tree.links[0].name
        self.model = self.drawn()
        true = {ground: np.eye(4)}
        for joint in self.ordered(tree):
            seat = transform(rotation_matrix(joint.orientation), joint.origin)
            true[joint.child] = true[joint.parent] @ seat
        written = {name: X @ self.drawn() if name != ground else X for name, X in true.items()}
        parts = []
        for link in tree.links[1:]:
            parts.append(self.link(link, true[link.name], written[link.name]))
            self.frames[link.name] = written[link.name]
        if self.minor >= 7:
            for i in range(2):
                to, X = self.base(), self.drawn()
                name = f' attached_to="{to}"' if to else ""
                pose = self.pose(X, self.where(to))
                parts.append(f'<frame name="extra{i}"{name}>{pose}</frame>')
                self.frames[f"extra{i}"] = X
        parts += [self.joint(x, ground, true[x.child], written[x.child]) for x in tree.joints]
        pose = self.numbers(self.model)
        x, y, z = tree.gravity or (0.0, 0.0, 0.0)
        gravity = f"<gravity>{x!r} {y!r} {z!r}</gravity>"
        gravity = gravity if self.minor >= 6 else f"<physics>{gravity}</physics>"
        model = f'<model name="tree">{pose}{"".join(parts)}</model>'
        world = f'<world name="w">{gravity}{model}</world>'
        return f'<?xml version="1.0"?><sdf version="1.{self.minor}">{world}</sdf>'

    @staticmethod
    def ordered(tree: RandomDescription) -> list[Joint]:
        """Return the joints, each after those that carry it."""
        placed, left, order = {tree.links[0].name}, list(tree.joints), []
        while left:
            order += (ready := [joint for joint in left if joint.parent in placed])
            placed |= {joint.child for joint in ready}
            left = [joint for joint in left if joint.child not in placed]
        return order

    def drawn(self) -> Matrix:
        """Return a random pose, or none."""
        if self.random.random() < 0.3:
            return np.eye(4)
        R = rotation_matrix(tuple(self.random.normal(size=4)))
        return transform(R, self.random.uniform(-1.0, 1.0, 3))

    def base(self) -> str:
        """Return the name of a frame, "" for the one by default."""
        names = ["", "__model__", *self.frames] if self.minor >= 7 else [""]
        return names[int(self.random.integers(len(names)))]

    def where(self, name: str) -> Matrix:
        return self.frames.get(name, self.model)

    def pose(self, X: Matrix, default: Matrix, *, framed: bool = True) -> str:
        """Return the element of a pose as seen from the world, in some frame."""
        name = self.base() if framed else ""
        base = self.where(name) if name else default
        told = f' relative_to="{name}"' if name else ""
        return self.numbers(np.linalg.solve(base, X), told)

    def numbers(self, X: Matrix, told: str = "") -> str:
        """Return the element of a pose."""
        angles, place = roll_pitch_yaw_of(X[:3, :3]), [*map(repr, X[:3, 3].tolist())]
        way = int(self.random.integers(3)) if self.minor >= 9 else 0
        if way == 1:
            told += ' degrees="true"'
            place += map(repr, np.degrees(angles).tolist())
        elif way == 2:
            told += ' rotation_format="quat_xyzw"'
            place += map(repr, quaternion(X[:3, :3]))
        else:
            place += map(repr, angles)
        return f"<pose{told}>{' '.join(place)}</pose>"

    def link(self, link: Link, true: Matrix, written: Matrix) -> str:
        """Return a link whose frame in the file is another one than in the tree."""
        central = true @ transform(np.eye(3), link.center)
        central = central @ transform(self.drawn()[:3, :3], np.zeros(3))
        turn = true[:3, :3].T @ central[:3, :3]
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = (turn.T @ link.inertia @ turn).tolist()
        names = {"ixx": xx, "iyy": yy, "izz": zz, "ixy": xy, "ixz": xz, "iyz": yz}
        entries = "".join(f"<{name}>{x!r}</{name}>" for name, x in names.items())
        inertial = self.pose(central, written, framed=False)
        return (
            f'<link name="{link.name}">{self.pose(written, self.model)}<inertial>{inertial}'
            f"<mass>{link.mass!r}</mass><inertia>{entries}</inertia></inertial></link>"
        )

    def joint(self, joint: Joint, ground: str, true: Matrix, child: Matrix) -> str:
        """Return a joint whose frame is turned, and of a slide elsewhere, too."""
        frame = true @ transform(self.drawn()[:3, :3], np.zeros(3))
        if joint.kind == "prismatic":
            frame = frame @ self.drawn()
        parent = "world" if joint.parent == ground else joint.parent
        kinds = KINDS[joint.kind]
        kind = kinds[int(self.random.integers(len(kinds)))]
        return (
            f'<joint name="{joint.name}" type="{kind}">{self.pose(frame, child)}'
            f"<parent>{parent}</parent><child>{joint.child}</child>"
            f"{'' if kind == 'fixed' else self.axis(joint, true, frame)}</joint>"
        )

    def axis(self, joint: Joint, true: Matrix, frame: Matrix) -> str:
        """Return the axis of a joint along the axes of some frame."""
        along = true[:3, :3] @ (np.array(joint.axis) / np.linalg.norm(joint.axis))
        axes, told, more = frame, "", ""
        if self.minor >= 7:
            if name := self.base():
                axes, told = self.where(name), f' expressed_in="{name}"'
        elif self.minor == 4 or self.random.random() < 0.5:
            axes = self.model
            more = "<use_parent_model_frame>1</use_parent_model_frame>" * (self.minor > 4)
        x, y, z = (axes[:3, :3].T @ along).tolist()
        damping = f"<damping>{joint.damping!r}</damping>" if joint.damping is not None else ""
        mimic = ""
        if joint.mimics is not None:
            leader, ratio, shift = joint.mimics
            at = float(self.random.uniform(-1.0, 1.0))
            mimic = (
                f'<mimic joint="{leader}"><multiplier>{ratio!r}</multiplier>'
                f"<offset>{shift + ratio * at!r}</offset><reference>{at!r}</reference></mimic>"
            )
        return (
            f"<axis><xyz{told}>{x!r} {y!r} {z!r}</xyz>{more}<dynamics>{damping}</dynamics>"
            f"{mimic}</axis>"
        )


def quaternion(R: Matrix) -> list[float]:
    """Return the quaternion x, y, z, w of a rotation."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(R).as_quat().tolist()
