"""Random points of finite fields: what is drawn there is free, and what is stated of it is true."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import numpy as np
import pytest
from tests.claims.test_proof import ALL, wrong_block

from eomcheck.claims import proof
from eomcheck.claims.confusions import agree_everywhere, equal
from eomcheck.claims.proof import (
    IdentitySampler,
    failure_probability,
    largest_bounds,
    new_seed,
    prove_structure,
)
from eomcheck.claims.registry import Comparison, GenericPoint
from eomcheck.formulations import FORMULATIONS, Partition
from eomcheck.numbers.finite_field import DegreeArithmetic, FiniteField, random_prime
from eomcheck.scenes import Snake

SCENE = Snake.coil(3)


def point(**more) -> GenericPoint:
    source = random.Random(0)
    return GenericPoint(SCENE, FiniteField(random_prime(source), source), **more)


def objects(*entries) -> np.ndarray:
    return np.array(entries, object)


def test_sides_are_the_same_only_if_every_entry_is():
    assert agree_everywhere(objects(1, 2), objects(1, 2), equal)
    assert not agree_everywhere(objects(1, 2), objects(1, 3), equal)
    assert not agree_everywhere(objects(1, 2), objects(3, 4), equal)
    assert not agree_everywhere(objects(1, 1), np.array(1, object), equal)


def test_the_prime_stated_is_the_prime_of_the_numbers():
    draws = IdentitySampler(SCENE, ALL, random.Random(0))
    for _ in range(3):
        at, prime = draws._point()
        numbers = (*at.q, *at.u, *at.parameters.mass, *at.directions[0], *at.free.v)
        assert {x.modulus() for x in numbers} == {prime}
    draws.sample()
    assert all(set(one.primes) for one in draws.results.values())


def test_the_partition_drawn_is_hardly_ever_the_paper_s():
    drawn = set()
    for seed in range(12):
        draws = IdentitySampler(SCENE, (), random.Random(seed))
        draws._point()
        assert draws.partition is not None
        drawn.add(tuple(draws.partition.dependent.tolist()))
    # One of 10 ways to choose 3 of 5 coordinates is the paper's.
    assert len(drawn) >= 4


def test_every_variable_of_a_point_is_one():
    at = point()
    free = (*at.q, *at.u, *at.directions[0], *at.free.v, at.t)
    assert len({int(x) for x in free}) == len(free)


def test_the_free_velocity_need_not_satisfy_the_constraints():
    at = point()
    assert all(x == 0 for x in at.terms.a @ at.v)
    assert all(x != 0 for x in at.terms.a @ at.free.v)


def test_the_other_partition_is_really_taken():
    taken = []

    class Recording(GenericPoint):
        def solution(self, formulation, partition=None):
            taken.append(partition)
            return super().solution(formulation, partition)

    other = Partition(np.array([0, 2, 4]), np.array([1, 3]))
    source = random.Random(0)
    field = FiniteField(random_prime(source), source)
    at = Recording(SCENE, field, (FORMULATIONS["em"],), other)
    assert [f.key for f, *_ in at.others] == ["em"]
    assert taken == [at.partition, other]


def test_points_that_were_drawn_again_are_charged_to_the_probability():
    wrong = replace(FORMULATIONS["au"], key="wrong", solution=wrong_block)
    for finding in prove_structure(SCENE, (*ALL, wrong), 2, 0):
        if (made := finding.proof) is not None:
            choices = SCENE.n if finding.subject.endswith("drawn") else 1
            bounds = made.degree, made.height
            assert made.draws == 4
            assert made.failure_probability == failure_probability(*bounds, 2, 4, choices)


def test_the_bound_of_an_identity_is_that_of_its_worst_entry(monkeypatch: pytest.MonkeyPatch):
    x, y = DegreeArithmetic().vector(2)
    found = objects(x, x * x * y, 5 * y)
    sides = Comparison("s", found, np.zeros(3, object), (("1", "2", "3"),))
    monkeypatch.setattr(proof, "identities_at", lambda at: [(("c", "s"), sides)])
    (degree, height) = largest_bounds(point())["c", "s"]
    assert degree == 3
    assert height == pytest.approx(math.log2(5))


def test_a_new_seed_is_rarer_than_a_mistake():
    """Of 256 bits: no event is rarer than 2^-b for a generator with b bits of seed."""
    assert max(new_seed() for _ in range(8)) > 2**240
