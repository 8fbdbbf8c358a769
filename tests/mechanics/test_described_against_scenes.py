"""Descriptions against hand-written scenes: the same terms modulo primes, at no higher cost."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from eomcheck import acceleration
from eomcheck.descriptions.build import mechanism
from eomcheck.descriptions.elements import Joint, Link, rolling_ball, rolling_disk
from eomcheck.descriptions.first_derivation import PreparedMechanism
from eomcheck.descriptions.mechanism_class import Mechanism
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.counting import Counting, Tally
from eomcheck.numbers.finite_field import FiniteField, random_prime
from eomcheck.numbers.generic import Angles
from eomcheck.scenes import Bicycle, ChainPendulum, FlyballGovernor, Snake

ROD = (1.0 / 12.0,) * 3


def chain(links: int, free: bool = False, away: float = 0.0, **more: Any) -> type[Mechanism]:
    """Return the class of a chain of rods on a pin, or with the first of them free in the plane."""
    names = [f"rod {i + 1}" for i in range(links)]
    joints = [
        Joint(f"φ_{i + 1}", "revolute", before, name, (float(i > 0), 0.0, 0.0))
        for i, (before, name) in enumerate(zip(["ground", *names], names, strict=False))
    ]
    if free:
        joints[0] = joints[0]._replace(name="first", kind="planar")
    bodies = [Link(name, 1.0, (0.5, 0.0, away), ROD) for name in names]
    more = {"gravity": (0.0, -9.81, 0.0)} | more
    return mechanism("Chain", [Link("ground"), *bodies], joints, **more)


# ---- The same terms ------------------------------------------------------------------------------


def relative(angles: Angles) -> tuple[Any, Any]:
    """Return cosines and sines of each angle relative to the previous one."""
    cos, sin = angles.cos + 0, angles.sin + 0
    for i in range(1, cos.size):
        c, s, C, S = angles.cos[i], angles.sin[i], angles.cos[i - 1], angles.sin[i - 1]
        cos[i], sin[i] = c * C + s * S, s * C - c * S
    return cos, sin


@pytest.mark.parametrize("links", [1, 2, 3, 7])
@pytest.mark.parametrize("hand", [Snake.coil, ChainPendulum.rods])
def test_a_chain_by_description_has_the_terms_of_the_scene_by_hand(links: int, hand: Any):
    scene, kind = hand(links), chain(links, free=hand == Snake.coil, gravity=None)
    source = random.Random(links)
    field = FiniteField(random_prime(source), source)
    theirs = Quantities(scene, field, field.vector(scene.n))
    theirs.v = field.vector(scene.n)
    given, mechanism = theirs.parameters, kind()
    assert mechanism.source.topology.planar
    center, offset = np.zeros((2, links, 2), object)
    center[:, 0], offset[1:, 0] = given.length / field.literal(2), given.length[:-1]
    T = np.array(scene.tree().coordinates, int)
    ours = mechanism.parameters(field)._replace(
        mass=given.mass,
        center=center,
        offset=np.concatenate([np.zeros((0, 2), object), offset]),
        inertia=given.inertia.reshape(links, 1, 1),
    )
    cos, sin = relative(getattr(theirs.prepared, "angles", theirs.prepared))
    prepared = PreparedMechanism(T @ theirs.q, Angles(None, cos, sin), None)
    M, _, B, *_ = mechanism.terms(ours, prepared, T @ theirs.q, T @ theirs.v)
    zero = 0 * theirs.v
    expected = zero if theirs.terms.B is None else theirs.terms.B
    assert (T.T @ M @ T == theirs.terms.M).all()
    assert (expected == T.T @ B).all()


# ---- What it costs -------------------------------------------------------------------------------


def counted(scene: Scene) -> Tally:
    """Return the operation counts of Lagrange's terms."""
    counting = Counting()
    at = Quantities(scene, counting, counting.vector(scene.n), counting.vector(1)[0])
    at.v = counting.vector(scene.n)
    assert at.parameters is not None
    assert at.prepared is not None
    counting.tally.clear()
    assert at.terms.M is not None
    return counting.tally


def cost(scene: Scene) -> int:
    tally = counted(scene)
    return tally.additions + tally.multiplications + tally.divisions


@pytest.mark.parametrize(
    ("links", "by_hand", "relative", "absolute"),
    [(3, 266, 1.3, 0.7), (7, 1910, 0.6, 0.5), (20, 30679, 0.4, 0.3)],
)
def test_in_the_plane_a_description_costs_hardly_more_than_equations_by_hand(
    links, by_hand, relative, absolute
):
    # Operation count of the hand-written terms of the chain pendulum, by all columns.
    assert cost(chain(links)()) <= relative * by_hand
    assert cost(ChainPendulum.rods(links)) <= absolute * by_hand


def test_space_costs_more_than_the_plane_and_what_is_absent_nothing():
    plane, space = chain(4)(), chain(4, away=0.1)()
    assert plane.source.topology.planar
    assert not space.source.topology.planar
    assert cost(plane) < 0.6 * cost(space)
    weightless = chain(4, gravity=None)()
    assert cost(weightless) < cost(plane)
    assert cost(plane.changed(gravity=None)) == cost(weightless)


def test_only_joints_on_the_way_to_a_body_are_paid_for():
    names = [f"arm {i}" for i in range(8)]
    star = mechanism(
        "Star",
        [Link("ground"), *(Link(name, 1.0, (0.5, 0.1, 0.2), ROD) for name in names)],
        [Joint(f"φ_{i}", "revolute", "ground", name) for i, name in enumerate(names)],
    )()
    single = mechanism(
        "Single",
        [Link("ground"), Link("arm", 1.0, (0.5, 0.1, 0.2), ROD)],
        [Joint("φ", "revolute", "ground", "arm")],
    )()
    assert cost(star) == 8 * cost(single)


def test_the_bicycle_in_words_costs_less_than_equations_by_hand():
    # Operation count of its hand-written terms, by all columns of all bodies.
    assert cost(Bicycle()) <= 0.26 * 9769


def rolls(told: Callable | None, on: str = "ground", table: bool = True) -> Mechanism:
    """Return a body that rolls on the ground or on a table that turns, or does neither."""
    links, joints = [Link("ground")], [Joint("p", "floating", "ground", "body")]
    if table:
        links.append(Link("table", 1.0, (0.1, 0.0, 0.0), ROD))
        joints.append(Joint("α", "revolute", "ground", "table"))
    links.append(Link("body", 1.0, (0.0, 0.0, 0.0), ROD))
    closing = () if told is None else told("b", "body", on, 0.5)
    return mechanism("Rolls", links, joints, closing, pose={"p_roll": 1.0})()


@pytest.mark.parametrize(("told", "price"), [(rolling_ball, 400), (rolling_disk, 660)])
def test_a_plane_that_stands_costs_nothing_whatever_else_moves(told: Callable, price: int):
    beside = cost(rolls(told)) - cost(rolls(None))
    alone = cost(rolls(told, table=False)) - cost(rolls(None, table=False))
    assert beside == alone <= price
    assert cost(rolls(told, "table")) - cost(rolls(None)) > 1.2 * alone
    a = Evaluation(rolls(told), np.ones(7), np.ones(7)).terms.a
    assert a is not None
    assert (a[:, 6] == 0).all()


def test_scenes_in_turn_are_each_read_with_their_own_numbers():
    """Descriptions in float64 are cached."""
    light, heavy = (FlyballGovernor(center=x) for x in (0.3, 0.5))
    q, v = light.initial_state()
    found = [acceleration(one, "au", q, v).vdot for one in (light, heavy, light)]
    assert np.abs(found[0] - found[1]).max() > 1e-3
    assert np.array_equal(found[0], found[2])
