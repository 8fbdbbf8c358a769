"""The tree of bodies of a scene has the bodies and the gravity of the scene."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from tests.samples import random_state

from eomcheck import check_state
from eomcheck.descriptions import elements
from eomcheck.descriptions.described_scene import GROUND, Described, Description
from eomcheck.mechanics.parameters import parameter
from eomcheck.mechanics.records import Tree
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import SCENES

CLAIMS = "weight-gradient", "coriolis-identities", "regressor-identity"
PULLED = np.array([3.0, 4.0, 5.0])


def with_tree(key: str, change: Callable[[Tree], Tree]) -> Scene:
    """Return an example of a scene with a changed tree of bodies."""
    kind: Any = SCENES[key]

    class Changed(kind):
        def tree(self) -> Tree:
            return change(super().tree())

    return Changed.example()


def failed_claims(scene: Scene) -> dict[str, str]:
    """Return the claims about the tree that fail at an ordinary state, each with a message."""
    q, v = random_state(scene, np.random.default_rng(0))[:2]
    findings = check_state(scene, q, v, claims=CLAIMS, consistent=False)
    assert {x.claim for x in findings} == set(CLAIMS)
    return {x.claim: str(x) for x in findings if x.verdict == "failed"}


@pytest.mark.parametrize("key", ["sleigh", "snake", "chain-pendulum", "bicycle"])
def test_a_tree_that_is_not_that_of_the_scene_fails(key: str) -> None:
    """Other gravity fails the claim about weight, other masses those about M and B too."""
    assert failed_claims(with_tree(key, lambda tree: tree)) == {}
    pulled = failed_claims(with_tree(key, lambda tree: tree._replace(gravity=PULLED)))
    assert list(pulled) == ["weight-gradient"]
    assert "[U] failed" in pulled["weight-gradient"] and "(gravity" in pulled["weight-gradient"]
    heavy = failed_claims(with_tree(key, lambda tree: tree._replace(mass=2 * tree.mass)))
    assert {"coriolis-identities", "regressor-identity"} <= set(heavy)


@pytest.mark.parametrize("key", ["chain-pendulum", "bicycle"])
def test_a_tree_without_the_weight_of_its_scene_fails(key: str) -> None:
    """Gravity is 0 unless `tree` has it, and the scene's is not."""
    light = with_tree(key, lambda tree: tree._replace(gravity=0 * tree.gravity))
    assert list(failed_claims(light)) == ["weight-gradient"]


def pendulum(parameters: Any) -> Description:
    """A pendulum whose gravity and a part of its mass are literals."""
    bob = elements.Link("bob", parameters.mass[0] + 2, (parameters.length[0], 0, 0))
    joint = elements.Joint("hinge", "revolute", GROUND, "bob")
    return Description([bob], [joint], gravity=(0, -9, 0), planar=True)


class Literal(Described, description=pendulum, held=False):
    """A pendulum by a description without a parameter for gravity."""

    mass: Any = parameter("m", "kg", "> 0", (0.1, 10.0), (1,), default=(1.0,))
    inertia: Any = parameter("I, central", "kg m²", ">= 0", (0.01, 10.0), (1,), default=(1.0,))
    length: Any = parameter("to the centre of mass", "m", default=0.5)

    key, conserves_energy, angle_coordinates = "literal", True, slice(0, None)
    named_coordinates = ("θ",)

    def initial_state(self):
        return np.zeros(1), np.zeros(1)


class Turned(Literal, description=pendulum, held=False):
    """The same with another gravity in its tree."""

    key = "turned"

    def tree(self) -> Tree:
        return super().tree()._replace(gravity=PULLED)  # type: ignore[union-attr]


def test_gravity_that_is_no_parameter_is_that_of_the_tree() -> None:
    """A constant gravity of a description counts like one that is a parameter."""
    for kind, failed in ((Literal, []), (Turned, ["weight-gradient"])):
        findings = check_state(kind(), [0.3], [0.1], claims=CLAIMS)
        assert [x.claim for x in findings if x.verdict == "failed"] == failed
        assert sum(x.claim == "weight-gradient" for x in findings) == 2
