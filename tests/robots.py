"""A small robot for tests, with what libraries read in different ways as far as one wants it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from eomcheck.engines import PinocchioFile
from eomcheck.engines.answers import Answers
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.mechanics.scene import Scene

LINK = """
<link name="{name}"><inertial><origin xyz="{at}" rpy="{turn}"/><mass value="{mass}"/>
<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0.01" ixz="-0.02" iyz="0.015"/></inertial></link>"""

JOINT = """
<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="{at}" rpy="{turn}"/><axis xyz="{axis}"/>
<limit lower="-2" upper="2" effort="10" velocity="10"/>{more}</joint>"""


def arm(path: Path, *, more: str = "", damping: str = "", last: str = "") -> Path:
    """Write an arm: a hinge, a slide, a hinge without limits, its links tilted; return `path`.

    Args:
        path: the file.
        more: links and joints that are added.
        damping: of the slide.
        last: links in the place of the last one, "hand".
    """
    damped = f'<dynamics damping="{damping}"/>' if damping else ""
    hand = {"name": "hand", "at": "0 0.1 0.05", "turn": "1 0 0", "mass": 0.7}
    upper = {"name": "upper", "at": "0.2 0 0.1", "turn": "0.3 -0.2 0.5", "mass": 2.5}
    fore = {"name": "fore", "at": "0 0 0.3", "turn": "0 0.4 0", "mass": 1.2}
    parts = [
        '<robot name="arm"><link name="base"/>',
        LINK.format(**upper, xx=0.3, yy=0.25, zz=0.2),
        LINK.format(**fore, xx=0.2, yy=0.2, zz=0.1),
        last or LINK.format(**hand, xx=0.1, yy=0.2, zz=0.15),
        joint("shoulder", "base", "upper", "revolute", "0 1 0"),
        joint("slide", "upper", "fore", "prismatic", "0 0 1", damped),
        joint("wrist", "fore", "hand", "continuous", "0.6 0 0.8"),
        more,
        "</robot>",
    ]
    path.write_text("".join(parts), encoding="utf-8")
    return path


def joint(
    name: str,
    parent: str,
    child: str,
    kind: str,
    axis: str,
    more: str = "",
    at: str = "0.1 0.2 0.3",
) -> str:
    """Return a joint."""
    where = {"at": at, "turn": "0.2 0.1 -0.3"}
    return JOINT.format(
        name=name, parent=parent, child=child, kind=kind, axis=axis, more=more, **where
    )


def body(name: str, **numbers: float) -> str:
    """Return a link."""
    usual = {"mass": 0.5, "xx": 0.1, "yy": 0.12, "zz": 0.14}
    return LINK.format(name=name, at="0.1 0 0", turn="0 0 0", **(usual | numbers))


def difference_from_pinocchio(scene: Scene, states: int) -> float:
    """Return the largest difference of M, B and Q of a robot from those that Pinocchio reads.

    It is relative to the largest entry of each; the states are random.
    """
    answers, random = Answers(PinocchioFile(scene)), np.random.default_rng(0)
    differences = []
    for _ in range(states):
        q, v = random.uniform(-1.2, 1.2, scene.n), random.uniform(-3.0, 3.0, scene.n)
        M, Q, B, *_ = Evaluation(scene, q, v).terms
        for ours, theirs in (
            (M, answers.mass_matrix(q)),
            (B, answers.bias(q, v)),
            (Q, answers.forces(q, v)),
        ):
            differences.append(np.abs(ours - theirs).max() / np.abs(theirs).max())
    return float(np.max(differences))
