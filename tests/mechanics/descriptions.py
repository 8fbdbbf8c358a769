"""Small mechanisms by description, with every kind of joint and constraint."""

from __future__ import annotations

from typing import Any

from eomcheck.descriptions.build import mechanism
from eomcheck.descriptions.elements import (
    Joint,
    Link,
    coupling,
    distance,
    drive,
    hinge,
    knife_edge,
    on_line,
    on_plane,
    on_quadric,
    perpendicular,
    pin,
    rolling_ball,
    rolling_circle,
    rolling_disk,
    weld,
)
from eomcheck.descriptions.mechanism_class import Mechanism


def rod(name: str, center=(0.5, 0.0, 0.0)) -> Link:
    return Link(name, 1.0, center, (0.7, 0.8, 0.9), (0.01, 0.02, -0.015))


def bent(name: str) -> Link:
    return rod(name, (0.5, 0.1, 0.2))


def turning(name: str, parent: str, child: str, place=(0.0, 0.0, 0.0), **more: Any) -> Joint:
    return Joint(name, "revolute", parent, child, place, **more)


GROUND = Link("ground")
PLANE = {"gravity": (0.0, -9.81, 0.0)}

Arm = mechanism(
    "Arm",
    [GROUND, bent("a"), bent("b"), bent("c")],
    [
        turning("α", "ground", "a", axis=(0.0, 0.0, -1.0)),
        turning("β", "a", "b", (1.0, 0.0, 0.1), orientation=(1.0, 1.0, 0.0, 0.0),
                axis=(1.0, 1.0, 0.0), damping=0.3),
        Joint("γ", "prismatic", "b", "c", (1.0, 0.0, 0.1), axis=(0.0, 1.0, 0.0), stiffness=3.0,
              rest_position=0.1, armature=0.4),
    ],
)  # fmt: skip

Branched = mechanism(
    "Branched",
    [GROUND, bent("a"), bent("b"), bent("c"), bent("d"), Link("bracket", 0.2, (0.1, 0.0, 0.0))],
    [
        turning("α", "ground", "a", axis=(0.0, 1.0, 0.0)),
        turning("γ", "bracket", "c", (0.0, 0.5, 0.0), axis=(1.0, 0.0, 0.0)),
        turning("β", "a", "b", (1.0, 0.0, 0.1)),
        Joint("glued", "fixed", "a", "bracket", (0.3, 0.0, 0.0), (1.0, 0.0, 0.5, 0.0)),
        Joint("δ", "prismatic", "c", "d", (0.0, 0.5, 0.0), axis=(1.0, 2.0, 2.0)),
    ],
)

Free = mechanism("Free", [GROUND, bent("a"), bent("b")],
    [Joint("base", "floating", "ground", "a"), turning("β", "a", "b", (1.0, 0.0, 0.0))],
)  # fmt: skip

Ball = mechanism("Ball", [GROUND, bent("a"), bent("b")],
    [Joint("hip", "spherical", "ground", "a", (0.0, 0.2, 0.0)),
     Joint("foot", "planar", "a", "b", (1.0, 0.0, 0.0), axis=(0.0, 1.0, 1.0))],
)  # fmt: skip

Following = mechanism(
    "Following",
    [GROUND, rod("a"), rod("b"), rod("c")],
    [
        turning("α", "ground", "a", axis=(0.0, -1.0, 0.0)),
        turning("β", "a", "b", (1.0, 0.0, 0.0), axis=(0.0, 0.0, -1.0), mimics=("α", -0.7, 0.3),
                stiffness=2.0, damping=0.1),
        Joint("γ", "prismatic", "b", "c", (1.0, 0.0, 0.0), axis=(1.0, 1.0, 0.0),
              mimics=("β", 2.0, 0.1), damping=0.2),
    ],
)  # fmt: skip

FourBar = mechanism(
    "FourBar",
    [GROUND, rod("a"), rod("b"), rod("c")],
    [turning("α", "ground", "a"), turning("β", "a", "b", (0.8, 0.0, 0.0)),
     turning("γ", "b", "c", (1.2, 0.0, 0.0))],
    [pin("window", "c", "ground", (1.0, 0.0, 0.0), (1.5, 0.0, 0.0))],
    dependent=("β", "γ"),
    pose={"α": 1.3, "β": -1.0, "γ": -1.6},
    **PLANE,
)  # fmt: skip


def beside(name: str, kind: str, constraint: Any, first: tuple[str, ...] = ()) -> type[Mechanism]:
    """Return the class of an arm and a second body on a joint of its own, constrained to it."""
    joints = [turning("α", "ground", "a", axis=(0.0, 1.0, 0.0)),
              Joint("β", kind, "ground", "b", (2.0, 0.0, 0.0))]  # fmt: skip
    return mechanism(name, [GROUND, bent("a"), bent("b")], joints, [constraint], dependent=first)


AT = (1.0, 0.2, 0.0)
SIX = tuple(f"β_{part}" for part in ("x", "y", "z", "yaw", "pitch", "roll"))

Rodded = beside("Rodded", "spherical", distance("rod", "a", "b", 2.0, AT, AT))
Welded = beside(
    "Welded", "floating", weld("weld", "b", "a", (0.1, 0.0, 0.0), AT, (1.0, 0.3, 0.0, 0.0)), SIX
)
Hinged = beside(
    "Hinged",
    "floating",
    hinge("hinge", "b", "a", (0.0, 0.1, 0.0), AT, (0.0, 0.3, 1.0), (0.0, 0.0, 1.0)),
    ("β_x", "β_y", "β_z", "β_yaw", "β_roll"),
)
OnTable = beside(
    "OnTable", "floating", on_plane("table", "b", "a", (0.1, 0.2, 1.0), AT, (0.0, 0.1, 0.0)),
    ("β_z",),
)  # fmt: skip
OnBowl = beside(
    "OnBowl", "floating", on_quadric("bowl", "b", "a", (1.5, 0.7, -0.2), 0.1, (0.1, 0.2, -1.0), AT,
                                     (0.0, 0.1, 0.0), (1.0, 0.2, 0.1, 0.3)), ("β_z",),
)  # fmt: skip
Geared = beside("Geared", "revolute", coupling("gear", "α", "β", 0.5, 0.2))
Driven = beside("Driven", "revolute", drive("motor", "α", 0.1, 2.0, 0.3))

Skate = mechanism("Skate", [GROUND, rod("a")], [Joint("p", "planar", "ground", "a")],
    [knife_edge("blade", "a", (0.0, 1.0, 0.0), (0.2, 0.0, 0.0))],
    dependent=("p_turn",), gravity=None,
)  # fmt: skip

Lifted = mechanism("Lifted", [GROUND, bent("a"), bent("b")],
    [Joint("p", "floating", "ground", "a"),
     turning("β", "a", "b", (1.0, 0.0, 0.0), axis=(1.0, 2.0, 0.0), armature=0.3, damping=0.1)],
    [knife_edge("blade", "a", (0.0, 1.0, 0.0), (0.2, 0.0, 0.0)), drive("lift", "p_z", 0.0, 0.5)],
    dependent=("p_z", "p_y"),
)  # fmt: skip

FREE = tuple(f"b_{part}" for part in ("x", "y", "z", "yaw", "pitch", "roll"))
TABLE = turning("α", "ground", "table", axis=(0.1, 0.2, 1.0)), Joint("b", "floating", "ground", "b")
ABOVE = (0.1, 0.0, 0.0), (0.0, 0.0, 0.2)

Marble = mechanism("Marble", [GROUND, bent("table"), bent("b")], TABLE,
    rolling_ball("ball", "b", "table", 0.5, *ABOVE, (0.1, 0.2, 1.0)), dependent=FREE[:3],
    pose={"b_z": 0.5, "b_roll": 1.3},
)  # fmt: skip

Coin = mechanism("Coin", [GROUND, bent("table"), bent("b")], TABLE,
    rolling_disk("rim", "b", "table", 0.5, *ABOVE, (1.0, 0.2, 0.1), (0.1, 0.2, 1.0)),
    dependent=FREE[:3], pose={"b_z": 0.5, "b_roll": 0.3},
)  # fmt: skip

Hoop = mechanism("Hoop", [GROUND, rod("a")], [Joint("p", "planar", "ground", "a")],
    rolling_circle("hoop", "a", "ground", 0.5, (1.0, 0.3, 0.0)), dependent=("p_x", "p_y"),
    pose={"p_y": 0.5}, **PLANE,
)  # fmt: skip

Bead = mechanism("Bead", [GROUND, bent("a"), bent("b")],
    [turning("α", "ground", "a", axis=(0.0, 1.0, 0.0)), Joint("b", "floating", "ground", "b")],
    [*on_line("wire", "b", "a", (0.1, 0.2, 1.0), AT, (0.0, 0.1, 0.0)),
     perpendicular("upright", "b", (1.0, 0.0, 0.2), "a", (0.0, 1.0, 0.3))],
    dependent=("b_x", "b_y", "b_yaw"),
)  # fmt: skip

TREES = {kind.key: kind for kind in (Arm, Branched, Free, Ball, Following)}
CLOSED = {
    kind.key: kind
    for kind in (
        FourBar,
        Rodded,
        Welded,
        Hinged,
        OnTable,
        OnBowl,
        Geared,
        Driven,
        Skate,
        Lifted,
        Marble,
        Coin,
        Hoop,
        Bead,
    )
}
ALL = TREES | CLOSED
