"""Pictures of descriptions: every part by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
from tests.mechanics.descriptions import GROUND, PLANE, rod, turning

from eomcheck.descriptions.build import mechanism
from eomcheck.descriptions.elements import Joint, Link, distance
from eomcheck.mechanics.sketch import Arrow, Body, Center, ConstraintMark, Trail, fixed_axes
from eomcheck.mechanics.sketch import JointMark as Pivot


def plain(x: Any) -> Any:
    """Return the numbers of a part as tuples, rounded far above float64 rounding."""
    if isinstance(x, np.ndarray):
        return tuple(np.round(x, 12) + 0.0)
    return tuple(map(plain, x)) if isinstance(x, tuple) else x


def shown(kind: Any, q: list[float]) -> list[tuple[str, Any]]:
    """Return the parts of the sketch of a mechanism, by class, without the axes of the ground."""
    scene = kind.example()
    parts = scene.sketch(np.array(q)).parts
    return [(type(one).__name__, plain(tuple(one))) for one in parts]


def expected(*parts: Any) -> list[tuple[str, Any]]:
    return [(type(one).__name__, plain(tuple(one))) for one in parts]


def test_a_chain_in_the_plane_is_drawn_from_joint_to_joint():
    links = [Link(name, 1.0, (0.5, 0.0, 0.0), (0.7, 0.8, 0.9)) for name in "abc"]
    kind = mechanism(
        "Chain",
        [GROUND, *links],
        [
            turning("first_joint", "ground", "a"),
            turning("knee", "a", "b", (1.0, 0.0, 0.0)),
            Joint("reach", "prismatic", "b", "c", (1.0, 0.0, 0.0), axis=(0.0, 1.0, 0.0)),
        ],
        [distance("rope", "c", "ground", 1.0, at=(0.5, 0.0, 0.0), at_other=(1.0, 0.0, 0.0))],
        **PLANE,
    )
    # The first link points along y, the second along -x, the third is pushed along -y.
    found = shown(kind, [np.pi / 2, np.pi / 2, 0.25])
    at = np.array([[0.0, 0.0], [0.0, 1.0], [-1.0, 0.75]])
    middle = np.array([[0.0, 0.5], [-0.5, 1.0], [-1.5, 0.75]])
    size = 1.5
    assert found == expected(
        *fixed_axes(0.15 * size, 2),
        Pivot(at[0], True, "first joint", None),
        Center(middle[0]),
        Body((at[0], at[1])),
        Pivot(at[1], False, "knee", None),
        Center(middle[1]),
        Body((at[1], at[2])),
        Arrow("reach", at[2], np.array([0.0, -0.12 * size]), frame=False),
        Center(middle[2]),
        Body((at[2], middle[2])),
        Trail(middle[2]),
        ConstraintMark("rope", middle[2], (0,)),
        Body((at[2], middle[2])),
        Arrow("g", np.array([-0.2 * size, 0.0]), np.array([0.0, -0.2 * size]), frame=False),
    )
    assert kind.example().sketch(np.zeros(3)).up == 1


def test_a_chain_in_space_is_drawn_with_the_axes_of_its_joints():
    kind = mechanism(
        "Space",
        [GROUND, rod("a", (0.0, 0.0, -0.5)), rod("b", (0.0, 0.0, -0.5))],
        [
            turning("α", "ground", "a", axis=(1.0, 0.0, 0.0)),
            turning("β", "a", "b", (0.0, 0.0, -1.0), axis=(0.0, 1.0, 0.0)),
        ],
    )
    sketch = kind.example().sketch(np.array([np.pi / 2, 0.0]))
    assert sketch.up == 2
    found = [(type(one).__name__, plain(tuple(one))) for one in sketch.parts]
    at = np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    ends = np.array([[0.0, 0.5, 0.0], [0.0, 1.5, 0.0]])
    size = 1.5
    assert found == expected(
        *fixed_axes(0.15 * size, 3),
        Pivot(at[0], True, "α", np.array([1.0, 0.0, 0.0])),
        Center(ends[0]),
        Body((at[0], at[1])),
        Pivot(at[1], False, "β", np.array([0.0, 0.0, 1.0])),
        Center(ends[1]),
        Body((at[1], ends[1])),
        Trail(ends[1]),
        Arrow("g", np.array([-0.2 * size, 0.0, 0.0]), np.array([0.0, 0.0, -0.2 * size]), False),
    )
