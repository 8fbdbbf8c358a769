"""A small robot for tests, with what libraries read in different ways as far as one wants it."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from eomcheck.engines import PinocchioFile
from eomcheck.engines.answers import Answers
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import from_mjcf

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


def hinges(path: Path, **changes: str) -> Path:
    """Write the arm with a hinge in place of its slide, a base with mass and a link on its hand.

    Args:
        path: the file.
        **changes: those of `arm`.
    """
    more = body("tip") + joint("grip", "hand", "tip", "fixed", "1 0 0")
    text = arm(path, more=more, **changes).read_text(encoding="utf-8")
    base = '<link name="base"><inertial><origin xyz="0.1 0 0.2" rpy="0.4 -0.3 0.2"/>'
    base += '<mass value="3"/><inertia ixx="0.2" iyy="0.3" izz="0.4" ixy="0" ixz="0" iyz="0"/>'
    text = text.replace("prismatic", "revolute")
    path.write_text(text.replace('<link name="base"/>', f"{base}</inertial></link>"))
    return path


TILTED = """<mujoco><option gravity="1 2 -9"/><worldbody>
  <body name="upper" pos=".1 .2 .3" euler="20 30 40"><joint name="turn" axis="0 1 0" armature=".3"/>
    <geom type="box" size=".1 .2 .3" mass="2" pos=".05 0 .1"/>
    <body name="fore" pos="0 .1 .4"><joint name="slide" type="slide" axis="1 2 2" armature=".2"/>
      <geom type="box" size=".02 .03 .5" mass="1" pos="0 .2 .4"/>
      <body name="hand" pos=".1 0 .2" euler="10 -20 0">
        <geom type="box" size=".1 .2 .1" mass=".5" pos="0 0 .2"/></body></body></body>
  </worldbody></mujoco>"""


def tilted(path: Path, *, rotors: bool = False) -> Scene:
    """Return a hinge, a slide and a link that is fixed, all tilted, and gravity along no axis.

    Args:
        path: file that is written.
        rotors: whether the joints have armature.
    """
    text = TILTED if rotors else re.sub(' armature="[^"]*"', "", TILTED)
    path.write_text(text, encoding="utf-8")
    return from_mjcf(path)


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
