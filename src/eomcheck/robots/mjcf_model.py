"""What MuJoCo's model of an MJCF file says of a robot, in the words of a description.

A body may have several joints in a row, each about a point of its own: between them are links
without inertia. The frame of a link is that of the body, moved to the point of its last joint.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from eomcheck.mechanics.described.quaternions import ONE, multiplied, roll_pitch_yaw_of, rotation
from eomcheck.mechanics.described.words import COORDINATES, Constraint, Joint, Link, Triple
from eomcheck.numbers.generic import Array
from eomcheck.robots.mjcf_equalities import Read, equality, quaternion_of, triple_of
from eomcheck.robots.mjcf_file import compiled
from eomcheck.robots.urdf_robot import identifier, left_out
from eomcheck.robots.urdf_xml import Unreadable

GROUND = "world"
"""What MuJoCo calls it, and no other body."""

FREE_JOINT, BALL_JOINT, SLIDE, HINGE = range(4)
"""MuJoCo's numbers for kinds of joints."""

STEEPEST = 1.2
"""rad; a pose that is turned further about y is left at 0, near where such angles are singular."""


class Model(NamedTuple):
    """What a file says."""

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    constraints: tuple[Constraint, ...]
    gravity: Triple | None
    pose: dict[str, float]
    left_out: str
    compiled: Any
    """MuJoCo's own model."""

    @property
    def coordinates(self) -> list[str]:
        """Names of the coordinates, in the order of the file."""
        return [one.name + part for one in self.joints for part in COORDINATES[one.kind]]


def read_mjcf(path: Path) -> Model:
    """Return what an MJCF file says.

    Raises:
        InputError, EngineError: see `from_mjcf`.
    """
    model, out = compiled(path)
    return _Reading(path, model, out).model()


class _Reading:
    """A model of MuJoCo's while it is read."""

    def __init__(self, path: Path, model: Any, out: Counter[str]):
        self.where, self.m, self.out, self.path = repr(str(path)), model, out, path
        self.bodies = _names([model.body(i).name for i in range(model.nbody)], "body")
        self.names = _names([model.joint(i).name for i in range(model.njnt)], "joint")
        self.reference: dict[str, float] = {}
        """Coordinate at which a joint of one coordinate is where the file draws it."""
        self.links, self.joints = [Link(GROUND)], []
        self.anchors: list[Array] = [np.zeros(3)]
        """Origin of a body's link in the frame of the body."""
        self.pose: dict[str, float] = {}
        off = int(model.opt.disableflags)
        self.off = {name: bool(off & bit) for name, bit in DISABLED.items()}

    def model(self) -> Model:
        """Return all of it."""
        m = self.m
        self._refuse()
        for body in range(1, m.nbody):
            self._add_body(body)
        held = not (self.off["equality"] or self.off["constraint"])
        read = Read(m, self.where, self.bodies, self.names, self.anchors, self.reference)
        constraints = [equality(read, i) for i in range(m.neq) if held and m.eq_active0[i]]
        self.out["limits of joints"] += int(np.count_nonzero(m.jnt_limited))
        self.out["friction of joints"] += int(np.count_nonzero(m.dof_frictionloss))
        x, y, z = m.opt.gravity.tolist()
        return Model(
            identifier(self.path.stem),
            tuple(self.links),
            tuple(self.joints),
            tuple(constraints),
            None if self.off["gravity"] or not any((x, y, z)) else (x, y, z),
            self.pose,
            left_out(self.out),
            m,
        )

    def _refuse(self) -> None:
        """Refuse forces that are not linear, and what else is no part of a description."""
        for name in ("jnt_stiffnesspoly", "dof_dampingpoly"):
            if np.any(getattr(self.m, name, 0)):
                raise Unreadable(f"{self.where}: springs or dampers that are not linear")
        if getattr(self.m, "nplastic", 0):
            raise Unreadable(f"{self.where}: joints that yield are not understood here")

    def _add_body(self, body: int) -> None:
        m, name = self.m, self.bodies[body]
        parent = int(m.body_parentid[body])
        place, turn = m.body_pos[body] - self.anchors[parent], m.body_quat[body]
        before, anchor = self.bodies[parent], np.zeros(3)
        first, count = int(m.body_jntadr[body]), int(m.body_jntnum[body])
        for joint in range(first, first + count):
            last = joint == first + count - 1
            after = name if last else f"{name} after {self.names[joint]}"
            if not last:
                self.links.append(Link(after))
            if m.jnt_type[joint] == FREE_JOINT:
                place, turn = np.zeros(3), np.array(ONE)
            step = m.jnt_pos[joint] - anchor
            self._add_joint(joint, before, after, place + rotation(tuple(turn)) @ step, turn)
            before, anchor = after, m.jnt_pos[joint]
            place, turn = np.zeros(3), np.array(ONE)
        if not count:  # it is part of the body that it is on
            self.joints.append(
                Joint(f"{name} fixed", "fixed", before, name, triple_of(place), quaternion_of(turn))
            )
        self.anchors.append(anchor)
        self.links.append(self._link(body, anchor))

    def _link(self, body: int, anchor: Array) -> Link:
        m = self.m
        R = rotation(quaternion_of(m.body_iquat[body]))
        I = R @ np.diag(m.body_inertia[body]) @ R.T  # noqa: E741
        center = triple_of(m.body_ipos[body] - anchor)
        moments, products = triple_of(np.diagonal(I)), (I[0, 1], I[0, 2], I[1, 2])
        return Link(
            self.bodies[body], float(m.body_mass[body]), center, moments, triple_of(products)
        )

    def _add_joint(self, joint: int, before: str, after: str, place: Array, turn: Array) -> None:
        m, name = self.m, self.names[joint]
        kind, dof, at = int(m.jnt_type[joint]), int(m.jnt_dofadr[joint]), m.jnt_qposadr[joint]
        stiffness = 0.0 if self.off["spring"] else float(m.jnt_stiffness[joint])
        if kind in (FREE_JOINT, BALL_JOINT):
            count = 6 if kind == FREE_JOINT else 3
            damping = 0.0 if self.off["damper"] else m.dof_damping[dof : dof + count]
            if np.any(damping) or stiffness or m.dof_armature[dof : dof + count].any():
                raise Unreadable(
                    f"{self.where}: joint {name!r} is free or a ball, with damping, stiffness or "
                    "armature: these are for joints with one coordinate"
                )
            self._start(name, m.qpos0[at : at + count + 1])
            called = "floating" if kind == FREE_JOINT else "spherical"
            self.joints.append(
                Joint(name, called, before, after, triple_of(place), quaternion_of(turn))
            )
            return
        axis, rest = m.jnt_axis[joint], float(m.qpos0[at])
        self.reference[name] = rest
        if rest:  # the coordinate is not 0 where the file draws the joint
            self.pose[name] = rest
            if kind == SLIDE:
                place = place - rest * (rotation(quaternion_of(turn)) @ axis)
            else:
                back = np.cos(rest / 2), *(-np.sin(rest / 2) * axis)
                turn = np.array(multiplied(quaternion_of(turn), quaternion_of(np.array(back))))
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
                relaxed=float(m.qpos_spring[at]) if stiffness else 0.0,
                armature=float(m.dof_armature[dof]) or None,
            )
        )

    def _start(self, name: str, told: Array) -> None:
        """Keep where a free joint is at first; a ball joint is at 0."""
        if len(told) < 7:
            return
        self.pose |= {f"{name}_{axis}": float(x) for axis, x in zip("xyz", told, strict=False)}
        turns = roll_pitch_yaw_of(rotation(quaternion_of(told[3:])))
        if abs(turns[1]) <= STEEPEST:
            names = "roll", "pitch", "yaw"
            self.pose |= {f"{name}_{n}": float(x) for n, x in zip(names, turns, strict=True)}


DISABLED = {
    "constraint": 1 << 0,
    "equality": 1 << 1,
    "spring": 1 << 5,
    "damper": 1 << 6,
    "gravity": 1 << 7,
}
"""What an option of the file may switch off -> MuJoCo's bit."""


def _names(given: list[str], called: str) -> list[str]:
    """Return a name for each, numbered where the file has none."""
    known = set(given)
    found = []
    for i, name in enumerate(given):
        new = name or f"{called}{i}"
        while not name and new in known:
            new += "_"
        known.add(new)
        found.append(new)
    return found
