"""The tree of bodies of a scene has the bodies and the gravity of the scene."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from tests.samples import random_state

from eomcheck import check_state, prove, quantity
from eomcheck.descriptions import elements
from eomcheck.descriptions.described_scene import GROUND, Described, Description
from eomcheck.engines.casadi import CasadiEngine
from eomcheck.errors import InputError
from eomcheck.evaluation.conformance import ConformancePoint
from eomcheck.mechanics.parameters import parameter
from eomcheck.mechanics.records import Tree
from eomcheck.mechanics.scene import Scene, check_tree
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


def linked(tree: Tree, **changes: Any) -> Tree:
    """Return a tree with changes of its last link."""
    *others, last = tree.frames
    return tree._replace(links=(*others, last._replace(**changes)))


REFLECTION = np.diag([1.0, 1.0, -1.0])
MALFORMED: dict[str, tuple[Callable[[Tree], Any], str]] = {
    "no tree": (lambda x: [1], r" = \[1\], expected a Tree or None"),
    "gravity": (
        lambda x: x._replace(gravity=np.array([0.0, np.nan, 0.0])),
        r"\.gravity\[1\] = nan, expected a finite number",
    ),
    "mass": (lambda x: x._replace(mass=x.mass[:-1]), r"\.mass has shape \(2,\), expected \(3,\)"),
    "matrix": (
        lambda x: x._replace(coordinates=np.eye(3)[:, :2]),
        r"\.coordinates has shape \(3, 2\), expected \(3, 3\)",
    ),
    "kind": (
        lambda x: x._replace(joint=(*x.joint[:-1], "ball")),
        r"\.joint\[2\] = 'ball', expected one of px, py, pz, rx, ry, rz",
    ),
    "parents": (
        lambda x: x._replace(parent=(-1, 0, 2)),
        r"\.parent\[2\] = 2, expected one of -1, 0, 1: joints are in depth-first order",
    ),
    "few parents": (lambda x: x._replace(parent=(-1, 0)), r"\.parent has 2 entries, expected 3"),
    "rotation": (
        lambda x: x._replace(rotation=2 * x.rotation),
        r"\.rotation\[0\] is no rotation: \|RᵀR - 1\| = 3, expected 0",
    ),
    "reflection": (
        lambda x: x._replace(rotation=np.stack([np.eye(3), np.eye(3), REFLECTION])),
        r"\.rotation\[2\] is no rotation but a reflection",
    ),
    "names": (lambda x: x._replace(names=("a", "b")), r"\.names has 2 names, expected 3"),
    "same names": (
        lambda x: x._replace(names=("a", "b", "a")),
        r"\.names: the name 'a' is there 2 times, expected once",
    ),
    "same links": (
        lambda x: x._replace(links=(*x.frames, x.frames[-1])),
        r"\.links: the name '[^']+' is there 2 times, expected once",
    ),
    "no name": (lambda x: linked(x, name=3), r"\.links\[.\]: name = 3, expected a string"),
    "no link": (lambda x: x._replace(links=(3,)), r"\.links\[0\] = 3, expected a TreeFrame"),
    "joint": (
        lambda x: linked(x, joint=99),
        r"\.links\[.\]\.joint = 99, expected a joint from 0 to 2, or -1 for the ground",
    ),
    "position": (
        lambda x: linked(x, p=np.zeros(2)),
        r"\.links\[.\]\.p has shape \(2,\), expected \(3,\)",
    ),
    "orientation": (lambda x: linked(x, R=2 * np.eye(3)), r"\.links\[.\]\.R is no rotation: "),
}


@pytest.mark.parametrize("name", MALFORMED)
@pytest.mark.parametrize("key", ["sleigh", "chain-pendulum"])
def test_a_malformed_tree_is_one_sentence(key: str, name: str) -> None:
    """Whoever reads it, claims, quantities or engines, gets the same InputError."""
    change, message = MALFORMED[name]
    scene = with_tree(key, change)
    with pytest.raises(InputError, match=r"^Changed\.tree\(\)" + message):
        scene.tree()
    q = np.zeros(scene.n)
    for read in (
        lambda: quantity(scene, "center_of_mass", q),
        lambda: check_state(scene, q, 0 * q, claims=CLAIMS, consistent=False),
        lambda: CasadiEngine(scene).gravity(q),
    ):
        with pytest.raises(InputError, match=r"^Changed\.tree\(\)" + message):
            read()


def test_trees_of_the_package_are_well_formed() -> None:
    """The check passes on every scene of this package and on robots."""
    scenes = [kind.example() for kind in SCENES.values()]
    for scene in [x for x in scenes if x.tree() is not None]:
        check_tree(scene.name, scene.tree(), scene.n)


@pytest.mark.parametrize("key", ["sleigh", "chain-pendulum"])
def test_gravity_of_a_tree_is_disproved(key: str) -> None:
    """A proof in the numbers of the scene finds gravity that the scene does not have."""
    kind: Any = SCENES[key]

    class Changed(kind):
        def tree(self, parameters: Any = None) -> Tree:
            return super().tree(parameters)._replace(gravity=PULLED)

    for scene, verdict in ((kind.example(), "passed"), (Changed.example(), "failed")):
        findings = [x for x in prove(scene, points=1, seed=0) if x.claim == "weight-gradient"]
        assert {x.subject: x.verdict for x in findings} == {"∂U/∂q": "passed", "U": verdict}


# ---- Each identity by itself ---------------------------------------------------------------------

SIDES = [
    ("center-of-mass-rates", "center_of_mass", "jacobian", {"J v"}),
    ("center-of-mass-rates", "center_of_mass", "velocity", {"J v", "ċ"}),
    ("center-of-mass-rates", "center_of_mass", "acceleration", {"c̈"}),
    ("momentum-rates", "momentum", "matrix", {"A v"}),
    ("momentum-rates", "momentum", "momentum", {"A v"}),
    ("momentum-rates", "momentum", "rate", {"ḣ"}),
    ("frame-rates", "link_motions", "jacobian", {"J v", "J v̇ + J̇ v"}),
    ("frame-rates", "link_motions", "velocity", {"J v", "ṗ", "Ṙ"}),
    ("frame-rates", "link_motions", "R", {"Ṙ"}),
    ("frame-rates", "link_motions", "acceleration", {"V̇", "J v̇ + J̇ v"}),
    ("frame-rates", "link_motions", "bias", {"J v̇ + J̇ v"}),
    ("weight-gradient", "weight", "gradient", {"∂U/∂q", "U"}),
    ("coriolis-identities", "coriolis_matrix", "", {"C v", "Ṁ"}),
    ("regressor-identity", "regressor", "Y", {"Y π"}),
    ("regressor-identity", "inverse_dynamics", "", {"τ"}),
]
"""Claim, function of the tree, one of its results, and the identities that it is in."""


@pytest.mark.parametrize(("claim", "function", "part", "expected"), SIDES)
def test_each_result_of_a_tree_is_held_against_another(
    claim: str, function: str, part: str, expected: set[str], monkeypatch: pytest.MonkeyPatch
):
    right = ConformancePoint.result

    def wrong(self: Any, name: str, rates: bool = False) -> Any:
        value = right(self, name, rates)
        if rates or name != function:
            return value
        if not part:
            return 1.001 * value
        return value._replace(**{part: 1.001 * getattr(value, part)})

    scene = SCENES["bicycle"].example()
    state = random_state(scene, np.random.default_rng(1))
    monkeypatch.setattr(ConformancePoint, "result", wrong)
    found = check_state(scene, *state, claims=[claim], consistent=False)
    assert {x.subject for x in found if x.verdict == "failed"} == expected


def test_the_gradient_of_weight_is_that_of_the_scene_at_rest_too(monkeypatch: pytest.MonkeyPatch):
    """Without velocity it changes no energy: it is compared along an acceleration."""
    right = ConformancePoint.result

    def wrong(self: Any, name: str, rates: bool = False) -> Any:
        value = right(self, name, rates)
        return value._replace(gradient=-value.gradient) if name == "weight" else value

    scene = SCENES["bicycle"].example()
    q, v, t = random_state(scene, np.random.default_rng(1))
    monkeypatch.setattr(ConformancePoint, "result", wrong)
    found = check_state(scene, q, 0.0 * v, t, claims=["weight-gradient"])
    assert {x.subject for x in found if x.verdict == "failed"} == {"U"}
