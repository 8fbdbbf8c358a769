"""Scenes by hand against descriptions of them, exactly, modulo a prime."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.scenes.by_hand import given_by

import eomcheck
from eomcheck.descriptions import elements
from eomcheck.descriptions.described_scene import GROUND, Described, Description
from eomcheck.errors import InputError, UnknownNameError
from eomcheck.mechanics.parameters import parameter
from eomcheck.mechanics.scene import Scene
from eomcheck.scene_lookup import scene_classes_named
from eomcheck.scenes import Sleigh

GUIDES = Path(__file__).parents[2] / "docs" / "guides"
MASS, INERTIA = (0.7,), (0.3,)


def in_words(parameters: Any) -> Description:
    body = elements.Link("sleigh", parameters.mass[0], (parameters.offset[0], 0, 0))
    joint = elements.Joint("edge", "planar", GROUND, "sleigh")
    edge = elements.knife_edge("edge", "sleigh", (0, -1, 0))
    return Description([body], [joint], constraints=[edge], planar=True)


class SleighInWords(Described, description=in_words, closed=True, held=False):
    """The sleigh, its generalized speeds a partition."""

    mass: Any = parameter("m", "kg", "> 0", (0.1, 10.0), (1,))
    inertia: Any = parameter("I, central", "kg m²", ">= 0", (0.01, 10.0), (1,))
    offset: Any = parameter("from edge to centre of mass", "m", sample_range=(-5.0, 5.0))

    key, conserves_energy, angle_coordinates = "sleigh-in-words", True, slice(2, None)
    named_coordinates, named_constraints = ("x", "y", "θ"), ("edge",)

    def initial_state(self):
        return np.zeros(3), np.array([0.0, 0.0, 1.0])


def trailers() -> tuple[Scene, Scene]:
    """Return the trailer of the tutorial, and its description."""
    numbers = {"mass": (310.0,), "inertia": (170.0,), "back": 2.2, "axle": 3.1}
    found: Any = [
        kind(**numbers)
        for name in ("trailer.py", "trailer_in_words.py")
        for kind in scene_classes_named(f"{GUIDES / name}:Trailer")
    ]
    by_hand, described = found
    return by_hand, described


@pytest.mark.parametrize(
    ("by_hand", "described"),
    [
        (Sleigh(0.7, 0.3, -1.2), SleighInWords(MASS, INERTIA, -1.2)),
        pytest.param(*trailers(), id="trailer"),
    ],
)
def test_words_give_exactly_the_terms_that_are_written_by_hand(by_hand: Scene, described: Scene):
    theirs, ours = given_by(by_hand), given_by(described)
    same = {name: digest for name, digest in theirs.items() if name not in ("Q", "U")}
    assert same == {name: ours[name] for name in same}
    assert theirs["Q"] == ours["Q"] == "absent"


@pytest.mark.parametrize("kind", [SleighInWords, type(trailers()[1])])
def test_what_is_described_in_words_is_proved(kind: type[Scene]):
    scene = trailers()[1] if kind is not SleighInWords else SleighInWords(MASS, INERTIA, -1.2)
    found = eomcheck.prove(scene, points=1, seed=0)
    assert len(found) > 60
    assert {one.verdict for one in found} == {"passed"}


def hanging(parameters: Any) -> Description:
    bob = elements.Link("bob", parameters.mass[0], (parameters.length[0], 0, 0))
    joint = elements.Joint("hinge", "revolute", GROUND, "bob")
    return Description([bob], [joint], gravity=(0, -9.81, 0), planar=True)


class Hanging(Described, description=hanging, held=False):
    """A pendulum whose gravity is a literal that is not whole."""

    mass: Any = parameter("m", "kg", "> 0", (0.1, 10.0), (1,), default=(1.0,))
    inertia: Any = parameter("I, central", "kg m²", ">= 0", (0.01, 10.0), (1,), default=(1.0,))
    length: Any = parameter("to the centre of mass", "m", default=0.5)

    key, conserves_energy, angle_coordinates = "hanging", True, slice(0, None)
    named_coordinates = ("θ",)

    def initial_state(self):
        return np.zeros(1), np.zeros(1)


def test_a_literal_that_keeps_exact_arithmetic_away_is_named():
    found = eomcheck.check_state(Hanging(), [0.3], [0.1])
    assert not [x for x in found if x.verdict == "failed"]
    skipped = (x for x in found if x.verdict == "skipped" and not x.claim.startswith("engine-"))
    exact = {x.claim: x.detail for x in skipped}
    assert set(exact) >= {"enclosures", "true-error"}
    for detail in exact.values():
        assert detail.endswith("-9.81 in a description is no whole number: make it a parameter")


class Weightless(Described, description=hanging, held=False):
    """A pendulum that does not tell its moment of inertia."""

    mass: Any = parameter("m", "kg", "> 0", (0.1, 10.0), (1,), default=(1.0,))
    length: Any = parameter("to the centre of mass", "m", default=0.5)

    key, conserves_energy, angle_coordinates = "weightless", True, slice(0, None)
    named_coordinates = ("θ",)

    def initial_state(self):
        return np.zeros(1), np.zeros(1)


class Doubled(Weightless, description=hanging, held=False):
    """A pendulum that tells two."""

    key = "doubled"
    inertia: Any = parameter("I, central", "kg m²", ">= 0", (0.01, 10.0), (2,), default=(1.0, 2.0))


@pytest.mark.parametrize(("kind", "said"), [(Weightless, "is missing"), (Doubled, "has 2 numbers")])
def test_moments_of_inertia_that_do_not_fit_the_bodies_are_refused(kind: type[Scene], said: str):
    with pytest.raises(InputError, match=rf"inertia .* {said}; it must have 1, "):
        eomcheck.acceleration(kind(), "em", [0.3], [0.1])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda **x: elements.Joint("a", "revolute", GROUND, "b", **x), "orign of Joint: origin"),
        (lambda **x: elements.Link("a", **x), "mas of Link: mass"),
        (lambda **x: elements.Spring("a", "b", "c", (0, 0, 0), (0, 0, 0), 1, **x),
         "lenght of Spring: length"),
        (lambda **x: elements.pin("a", "b", "c", **x), "at_othr of pin: at_other"),
        (lambda **x: elements.rolling_disk("a", "b", "c", 1.0, **x),
         "acros of rolling_disk: across"),
    ],
)  # fmt: skip
def test_a_keyword_that_no_element_has_is_named_with_those_that_it_has(make: Any, message: str):
    keyword, owner, near = message.replace(" of", "").replace(":", "").split(" ")
    with pytest.raises(UnknownNameError) as caught:
        make(**{keyword: 1.0})
    said = f"unknown keyword of {owner} {keyword!r} (did you mean {near!r}?); known: name, "
    assert str(caught.value).startswith(said)
    assert near in caught.value.known
