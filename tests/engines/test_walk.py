"""The walk through a tree: what engines are built from."""

from __future__ import annotations

import numpy as np
import pytest

from eomcheck.engines import ENGINES, asked_by_default
from eomcheck.engines.tree_engine import TreeEngine, TreeLink, bodies_with_mass, tree_links
from eomcheck.scenes import SCENES

TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""A quarter turn about z."""


def link(
    name: str, parent: int, kind: str, offset: list[float], mass: float, turn=None
) -> TreeLink:
    rotation = np.eye(3) if turn is None else turn
    moments = mass * np.eye(3)
    return TreeLink(name, parent, kind, rotation, np.array(offset), mass, np.zeros(3), moments)


@pytest.mark.parametrize("key", [k for k, kind in SCENES.items() if kind.example().tree()])
def test_links_are_the_trees_own_and_follow_what_they_sit_on(key):
    tree = SCENES[key].example().tree()
    links = tree_links(tree)
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
    bodies = bodies_with_mass(tree_links(tree))
    assert [one.parent for one in bodies] == list(tree.parent)
    assert all(len(one.joints) == 1 for one in bodies)


@pytest.mark.parametrize(
    "parents",
    [pytest.param((-1, -1), id="nothing"), pytest.param((-1, 0, 0), id="two")],
)
def test_a_link_without_mass_that_carries_not_exactly_one_cannot_be_taken_over(parents):
    links = [link(str(j), p, "rz", [0.0, 0.0, 0.0], float(j > 0)) for j, p in enumerate(parents)]
    assert bodies_with_mass(links) is None


def held(links: list[TreeLink]) -> set[str]:
    """Return the engines of trees that say that they can hold such links."""
    kinds = asked_by_default(ENGINES)
    trees = {key: kind for key, kind in kinds.items() if issubclass(kind, TreeEngine)}
    return {key for key, kind in trees.items() if kind.holds(links)}


EVERY = {"pinocchio", "mujoco", "drake", "exudyn", "idyntree", "pybullet"}


@pytest.mark.parametrize("place", range(3))
def test_rotors_and_inertia_without_mass_are_held_by_pinocchio_alone_wherever_they_are(place):
    links = [link(str(j), j - 1, "rz", [0.0, 1.0, 0.0], 1.0) for j in range(3)]
    assert held(links) == EVERY
    for change in ({"armature": 0.1}, {"mass": 0.0}):
        changed = [*links]
        changed[place] = links[place]._replace(**change)
        assert held(changed) == {"pinocchio"}
    changed[place] = links[place]._replace(mass=0.0, inertia=np.zeros((3, 3)))
    assert held(changed) == (EVERY - {"mujoco"} if place == 2 else EVERY)


@pytest.mark.parametrize(
    ("moments", "taken"),
    [
        ((0.0, 0.0, 0.0), {"tree", "pybullet"}),
        ((0.2, 0.3, 0.4), {"tree", "pybullet"}),
        ((0.0, 0.3, 0.3), {"tree"}),
        ((0.3, 0.3, 0.0), {"tree"}),
        ((0.1, 0.2, 0.4), set()),
    ],
)
def test_a_thin_rod_is_no_link_for_pybullet_and_a_point_is(moments, taken):
    one = link("a", -1, "rz", [0.0, 0.0, 0.0], 1.0)._replace(inertia=np.diag(moments))
    kinds = {"tree": TreeEngine, "pybullet": ENGINES["pybullet"]}
    assert {key for key, kind in kinds.items() if kind.takes(one)} == taken  # type: ignore


@pytest.mark.parametrize("order", [(0, 1, 2), (1, 0, 2), (2, 0, 1), (2, 1, 0)])
def test_principal_moments_come_with_axes_that_are_a_rotation(order):
    R = np.linalg.qr(np.arange(9.0).reshape(3, 3) ** 2 + np.eye(3))[0]
    for turn in (np.eye(3), R):
        inertia = turn @ np.diag(np.array([0.2, 0.3, 0.4])[list(order)]) @ turn.T
        moments, axes = link("a", -1, "rz", [0.0] * 3, 1.0)._replace(inertia=inertia).principal
        assert moments == pytest.approx([0.2, 0.3, 0.4])
        assert np.linalg.det(axes) == pytest.approx(1.0)
        np.testing.assert_allclose(axes @ np.diag(moments) @ axes.T, inertia, atol=1e-15)
