"""The degree that a `Bound` states is never below the true one, measured along random lines.

Off the circle the formulations differ from each other: what is measured is the degree of each
quantity, and of left - right as a polynomial in independent cosines and sines, which is what the
bound is about. `measured / bound` at N = 1, 2, 3, 4, largest over the entries of v̇:

    im, au   13/15   26/32   45/53    64/74
    el       13/16   26/34   45/58    64/82
    gw       13/23   26/62   45/113   64/174
    em       13/20   26/42   45/82    64/114
    ml        4/14   26/34   53/72    80/110
    kane      4/4    26/38   51/76    77/114

Springs change none of them. Single terms (M, Q, B, a, gamma) are measured as bounded.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any

import flint
import numpy as np
import pytest
from tests.lines import PRIME, Line, numerator_degrees
from tests.samples import NOT_OF_SNAKES

from eomcheck.claims import CLAIMS
from eomcheck.claims.proof import Key, identities_at
from eomcheck.claims.registry import GenericPoint
from eomcheck.formulations import FORMULATIONS, Partition
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.finite_field import Bound, DegreeArithmetic
from eomcheck.scenes import Snake

ALL = tuple(FORMULATIONS.values())
IDENTITIES = {key for key, claim in CLAIMS.items() if claim.proved}
SMALL = [scene for links in (1, 2, 3, 4) for scene in Snake.structures(links)]
"""Of the snake only: other scenes go through the same bounds of the same operations."""

scenes = pytest.mark.parametrize("scene", SMALL, ids=lambda scene: scene.structure)
EXACT = {"bias", "generalized-forces", "constraint-jacobian", "constraint-drift", "kinetic-energy"}
"""Claims about single terms, in which nothing is divided and nothing of the top degree cancels."""


def other_partition(scene: Scene) -> Partition:
    """Return the partition that takes the last columns for dependent ones."""
    columns = np.arange(scene.n)
    return Partition(columns[scene.p :], columns[: scene.p])


def entries(scene: Scene, arithmetic: Any) -> Iterator[tuple[Key, Any]]:
    """Yield every entry of each side of each identity, and of their difference."""
    for key, sides in identities_at(GenericPoint(scene, arithmetic, ALL, other_partition(scene))):
        found, expected = (np.asarray(x, object) for x in (sides.actual, sides.expected))
        for array in (found, expected, found - expected):
            yield from ((key, x) for x in np.ravel(np.asarray(array, object)))


def degree(x: Any) -> int:
    """Return the degree that is stated; -1 for a literal zero, as it is measured."""
    if isinstance(x, Bound):
        return x.degree
    assert isinstance(x, int)
    return 0 if x else -1


@cache
def degrees(scene: Scene) -> list[tuple[Key, int, int]]:
    """Return (identity, measured, stated) for every entry."""
    stated = [(key, degree(x)) for key, x in entries(scene, DegreeArithmetic())]
    measured = numerator_degrees(lambda s: [x for _, x in entries(scene, Line(0, s))])
    return [(key, m, bound) for (key, bound), m in zip(stated, measured, strict=True)]


@pytest.mark.night
@scenes
def test_no_measured_degree_exceeds_the_bound(scene: Scene):
    found = degrees(scene)
    assert {claim for (claim, _), *_ in found} <= IDENTITIES
    assert [entry for entry in found if entry[1] > entry[2]] == []


@pytest.mark.night
@scenes
def test_every_formulation_and_every_identity_is_measured(scene: Scene):
    """Unless it is about springs, joints or the second partition: then where there are any."""
    looked_at = {key for key, *_ in degrees(scene)}
    springs = {"generalized-forces", "active-forces", "chain-forces"}
    absent = springs if scene.structure.endswith("no stiffness") else set()
    if scene.r == 1:
        absent |= {"chain-coupling", "chain-remainder"}
    assert {claim for claim, _ in looked_at} == IDENTITIES - absent - NOT_OF_SNAKES
    assert {key for claim, key in looked_at if claim == "power-balance"} == set(FORMULATIONS)


@pytest.mark.night
@scenes
def test_the_bounds_of_single_terms_are_the_degrees_themselves(scene: Scene):
    """At N = 1 one turning link drops out of B and gamma, and leaves a zero that is no literal."""
    largest: dict[Key, tuple[int, int]] = {}
    for key, measured, bound in degrees(scene):
        before = largest.get(key, (0, 0))
        largest[key] = max(before[0], measured), max(before[1], bound)
    single = {key: both for key, both in largest.items() if key[0] in EXACT}
    assert single
    slack = 2 if scene.r == 1 else 0
    assert all(bound - measured <= slack for measured, bound in single.values()), single


@pytest.mark.sampled(12)
@scenes
@pytest.mark.parametrize("formulation", ALL, ids=lambda f: f.key)
def test_bounds_of_accelerations_are_safe_and_not_far_from_the_degrees(scene: Scene, formulation):
    def vdot(arithmetic):
        return GenericPoint(scene, arithmetic).solution(formulation).vdot

    bounds = [degree(x) for x in vdot(DegreeArithmetic())]
    measured = numerator_degrees(lambda s: vdot(Line(1, s)))
    assert all(m <= bound for m, bound in zip(measured, bounds, strict=True))
    assert max(bounds) <= 4 * max(measured)


# ---- The measurement itself ----------------------------------------------------------------------


def element(x: int) -> flint.nmod:
    return flint.nmod(x, PRIME)


@pytest.mark.parametrize("first", [8, 16, 64])
def test_degrees_of_known_fractions_are_measured_right(first: int):
    def values(s):
        s = element(s)
        yield 0 * s
        yield element(5)
        yield s * s * s - 7
        yield 1 / (s + 3)
        yield (s - 2) * (s + 3) / ((s + 3) * (s + 5))  # reduced: degree 1
        yield (s**9 + s + 1) / (s**11 + 2)

    assert numerator_degrees(values, first) == [-1, 0, 3, 0, 1, 9]


def test_along_a_line_cosines_and_sines_are_variables_of_their_own():
    angles = Line(0, 1).angles(np.zeros(2))
    assert (angles.cos * angles.cos + angles.sin * angles.sin != 1).all()
    steps = [Line(0, s).vector(3) for s in (1, 2, 3)]
    assert (steps[2] - steps[1] == steps[1] - steps[0]).all()
