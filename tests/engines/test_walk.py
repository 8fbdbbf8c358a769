"""The walk through a tree: what engines are built from."""

from __future__ import annotations

import numpy as np
import pytest

from eomcheck.engines.walk import Link, bodies_with_mass, links_of
from eomcheck.scenes import SCENES

TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""A quarter turn about z."""


def link(name: str, parent: int, kind: str, offset: list[float], mass: float, turn=None) -> Link:
    rotation = np.eye(3) if turn is None else turn
    moments = mass * np.eye(3)
    return Link(name, parent, kind, rotation, np.array(offset), mass, np.zeros(3), moments)


@pytest.mark.parametrize("key", [k for k, kind in SCENES.items() if kind.example().tree()])
def test_links_are_the_trees_own_and_follow_what_they_sit_on(key):
    tree = SCENES[key].example().tree()
    links = links_of(tree)
    assert [(one.parent, one.kind) for one in links] == list(
        zip(tree.parent, tree.joint, strict=True)
    )
    assert all(one.parent < j for j, one in enumerate(links))
    assert len({one.name for one in links}) == len(links)
    assert [one.mass for one in links] == tree.mass.tolist()
    assert all((one.inertia == of).all() for one, of in zip(links, tree.inertia, strict=True))
    assert all((one.rotation == of).all() for one, of in zip(links, tree.rotation, strict=True))


def test_an_axis_and_a_kind_of_motion_follow_from_the_name_of_a_joint():
    for kind, slides, axis in (("px", True, 0), ("py", True, 1), ("rz", False, 2)):
        one = link("a", -1, kind, [0.0, 0.0, 0.0], 1.0)
        assert one.slides is slides
        assert one.axis.tolist() == np.eye(3)[axis].tolist()


def test_links_without_mass_leave_their_joints_to_the_body_that_they_carry():
    links = [
        link("x", -1, "px", [1.0, 0.0, 0.0], 0.0),
        link("turn", 0, "rz", [0.0, 2.0, 0.0], 0.0, TURN),
        link("body", 1, "px", [3.0, 0.0, 0.0], 5.0, TURN),
        link("next", 2, "rz", [0.0, 0.0, 4.0], 6.0),
    ]
    body, following = bodies_with_mass(links)
    assert (body.body.name, body.parent, following.parent) == ("body", -1, 0)
    # At rest: (1, 0) + (0, 2), a quarter turn, 3 along what is y by now, another quarter turn.
    assert body.offset == pytest.approx([1.0, 5.0, 0.0])
    assert body.rotation == pytest.approx(TURN @ TURN)
    assert [(j.name, j.slides) for j in body.joints] == [
        ("x", True),
        ("turn", False),
        ("body", True),
    ]
    # Seen from the body, which is turned by half a turn, the hinge is 3 above it.
    assert body.joints[1].position == pytest.approx([0.0, 3.0, 0.0])
    assert body.joints[2].position == pytest.approx([0.0, 0.0, 0.0])
    assert body.joints[0].axis == pytest.approx([-1.0, 0.0, 0.0])
    assert body.joints[1].axis == pytest.approx([0.0, 0.0, 1.0])
    assert body.joints[2].axis == pytest.approx([1.0, 0.0, 0.0])
    assert following.offset == pytest.approx([0.0, 0.0, 4.0])


def test_bodies_with_mass_keep_their_own_joint_and_the_order():
    tree = SCENES["andrews"].example().tree()
    bodies = bodies_with_mass(links_of(tree))
    assert [one.parent for one in bodies] == list(tree.parent)
    assert all(len(one.joints) == 1 for one in bodies)


@pytest.mark.parametrize(
    "parents",
    [pytest.param((-1, -1), id="nothing"), pytest.param((-1, 0, 0), id="two")],
)
def test_a_link_without_mass_that_carries_not_exactly_one_cannot_be_taken_over(parents):
    links = [link(str(j), p, "rz", [0.0, 0.0, 0.0], float(j > 0)) for j, p in enumerate(parents)]
    assert bodies_with_mass(links) is None
