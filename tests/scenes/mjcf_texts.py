"""Random MJCF texts: joints of every kind with springs, dampers, rotors, turned inertials."""

from __future__ import annotations

import numpy as np

AXES = ("1 0 0", "0 1 0", "0 0 1", "-1 0 0", "0 -1 0", "0 0 -1")


def mjcf_text(random: np.random.Generator, bodies: int) -> str:
    """Return the MJCF of a random tree of so many bodies, one of some pairs of joints coupled."""
    texts: list[str] = []
    children: dict[int, list[int]] = {}
    parents = [int(random.integers(-1, i)) if i else -1 for i in range(bodies)]
    scalar: list[str] = []
    for i, parent in enumerate(parents):
        children.setdefault(parent, []).append(i)
        texts.append(_body(random, i, parent == -1, scalar))

    def nested(i: int) -> str:
        inside = "".join(map(nested, children.get(i, ())))
        return f"{texts[i]}{inside}</body>"

    coupled = ""
    if len(scalar) > 1 and random.random() < 0.5:
        first, second = scalar[-1], scalar[0]
        ratio, shift = random.uniform(-2, 2), random.uniform(-0.3, 0.3)
        coupled = (
            f'<equality><joint joint1="{first}" joint2="{second}" '
            f'polycoef="{shift!r} {ratio!r} 0 0 0"/></equality>'
        )
    world = "".join(map(nested, children[-1]))
    return (
        '<mujoco><compiler angle="radian" balanceinertia="false"/>'
        f'<option gravity="{_numbers(random, 3, 9.0)}"/>'
        f"<worldbody>{world}</worldbody>{coupled}</mujoco>"
    )


def _numbers(random: np.random.Generator, count: int, size: float = 0.5) -> str:
    return " ".join(map(repr, random.uniform(-size, size, count).tolist()))


def _body(random: np.random.Generator, i: int, grounded: bool, scalar: list[str]) -> str:
    kinds = ["hinge", "slide", "hinge", "slide", "ball"] + ["free"] * grounded
    kind = kinds[int(random.integers(len(kinds)))]
    joints = [f'<joint name="j{i}" type="{kind}"/>']
    if kind in ("hinge", "slide"):
        joints = []
        for number in range(1 + int(random.integers(2))):
            name = f"j{i}_{number}"
            scalar.append(name)
            joints.append(_scalar(random, name, kind))
    A = np.eye(3) + random.uniform(-0.5, 0.5, (3, 3))
    points = A @ A.T
    inertia = random.uniform(0.05, 0.5) * (np.trace(points) * np.eye(3) - points)
    entries = " ".join(repr(float(inertia[k])) for k in ((0, 0), (1, 1), (2, 2)))
    entries += " " + " ".join(repr(float(inertia[k])) for k in ((0, 1), (0, 2), (1, 2)))
    return (
        f'<body name="b{i}" pos="{_numbers(random, 3)}" euler="{_numbers(random, 3)}">'
        f'{"".join(joints)}<inertial pos="{_numbers(random, 3)}" '
        f'mass="{random.uniform(0.2, 3)!r}" fullinertia="{entries}"/>'
    )


def _scalar(random: np.random.Generator, name: str, kind: str) -> str:
    skew = random.random() < 0.4
    axis = _numbers(random, 3, 1.0) if skew else AXES[int(random.integers(len(AXES)))]
    more = ""
    if random.random() < 0.6:
        more += f' stiffness="{random.uniform(0.5, 9)!r}" springref="{random.uniform(-1, 1)!r}"'
    if random.random() < 0.4:
        more += f' damping="{random.uniform(0.1, 2)!r}"'
    if random.random() < 0.4:
        more += f' armature="{random.uniform(0.05, 1)!r}"'
    if random.random() < 0.5:
        more += f' ref="{random.uniform(-0.7, 0.7)!r}"'
    where = f'axis="{axis}" pos="{_numbers(random, 3, 0.2)}"'
    return f'<joint name="{name}" type="{kind}" {where}{more}/>'
