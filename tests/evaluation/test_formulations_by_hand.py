"""What each formulation is, field by field, and its systems for numbers made by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from eomcheck.errors import InputError, UnknownNameError
from eomcheck.formulations import (
    FORMULATIONS,
    Partition,
    applicable,
    au,
    banded,
    el,
    em,
    formulation_for,
    formulation_of,
    gw,
    im,
    kane,
    uk,
)
from eomcheck.formulations.em import project
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import SCENES, Snake

# ---- Facts ---------------------------------------------------------------------------------------

YES, NO = True, False
FACTS = {
    "im": ("Integrated multiplier", "(6)-(7)", "acceleration", YES, YES, "q, v, μ", "terms", NO),
    "au": ("Augmented", "(8)-(9)", "acceleration", YES, YES, "q, v, μ", "terms", NO),
    "el": ("Elimination", "(10)-(11)", "acceleration", NO, NO, "q, v", "terms", YES),
    "gw": ("Greenwood", "(12)-(13)", "acceleration", YES, NO, "q, v", "terms", NO),
    "em": ("Embedding", "(14)-(18)", "velocity", NO, NO, "q, v2", "terms", YES),
    "ml": ("Modified Lagrange", "(19)-(21)", "velocity", NO, NO, "q, u", "speeds", NO),
    "kane": ("Kane (variant)", "(22)-(23)", "velocity", NO, NO, "q, u", "bodies", NO),
    "banded": ("Banded", "", "acceleration", YES, None, "q, x", "chain", NO),
    "uk": ("Udwadia-Kalaba", "", "acceleration", YES, None, "q, v", "terms", NO),
}
"""Key -> name, equations, level, multipliers, those of the paper, state, what it uses, split."""


def test_a_formulation_is_this_of_the_paper():
    found = {
        key: (
            one.name, one.equations, one.level, one.multipliers, one.multipliers_in_paper,
            one.state, one.uses, one.partitioned,
        )
        for key, one in FORMULATIONS.items()
    }  # fmt: skip
    assert found == FACTS and list(found) == list(FACTS)
    assert [one.key for one in FORMULATIONS.values()] == list(FACTS)
    assert [key for key, one in FORMULATIONS.items() if one.redundant] == ["uk"]
    assert [key for key, one in FORMULATIONS.items() if one.sparse] == ["kane"]
    assert [key for key, one in FORMULATIONS.items() if one.linear] == ["kane", "banded"]
    assert all(one.limits.endswith(".") for one in FORMULATIONS.values())
    assert [one.unknowns(5, 2) for one in FORMULATIONS.values()] == [12, 7, 5, 5, 3, 3, 3, -3, 7]


def test_formulations_are_those_whose_numbers_a_scene_gives():
    every = [key for key in FACTS if key != "banded"]
    assert list(applicable(Snake)) == list(FACTS)
    terms = type("Bare", (Scene,), {"terms": staticmethod(lambda *_: None), "key": "bare"})
    assert list(applicable(terms)) == ["im", "au", "el", "gw", "em", "uk"]
    assert list(applicable(SCENES["sleigh"])) == every
    with pytest.raises(InputError) as error:
        formulation_for(terms, "kane")
    said = "kane does not apply to the scene bare, which gives no bodies; those that apply: "
    assert str(error.value) == f"{said}im, au, el, gw, em, uk"
    for ask in (formulation_of, lambda key: formulation_for(terms, key)):
        with pytest.raises(UnknownNameError, match=r"^unknown formulation 'kan' \(did you mean"):
            ask("kan")


# ---- Systems -------------------------------------------------------------------------------------

M = np.array([[4.0, 1.0, 0.0], [1.0, 5.0, 2.0], [0.0, 2.0, 6.0]])
F, V = np.array([7.0, -8.0, 9.0]), np.array([1.0, 2.0, 3.0])
A, GAMMA = np.array([[1.0, 2.0, -1.0]]), np.array([0.5])
NONE: Any = None


def solution() -> tuple[np.ndarray, np.ndarray]:
    """Return (v̇, λ) of M v̇ = F + aᵀλ and a v̇ + gamma = 0."""
    free, response = np.linalg.solve(M, F), np.linalg.solve(M, A[0])
    multiplier = -(GAMMA[0] + A[0] @ free) / (A[0] @ response)
    return free + multiplier * response, np.array([multiplier])


def test_the_augmented_and_the_integrated_systems_have_these_rows():
    M_Au, F_Au = au.system(M, F, A, GAMMA)
    rows = [[4, 1, 0, -1], [1, 5, 2, -2], [0, 2, 6, 1], [-1, -2, 1, 0]]
    assert (M_Au.tolist(), F_Au.tolist()) == (rows, [7, -8, 9, 0.5])
    M_IM, F_IM = im.system(M, F, A, GAMMA, V)
    assert M_IM[:3].tolist() == np.eye(3, 7).tolist()
    assert not M_IM[3:, :3].any()
    assert (M_IM[3:, 3:].tolist(), F_IM.tolist()) == (rows, [1, 2, 3, 7, -8, 9, 0.5])
    for system in (au.system(M, F, NONE, NONE), gw.system(M, F, NONE, NONE)):
        assert system == (M, F)
    x = np.arange(5.0)
    first, last = au.split(x, np.ones((2, 3)))
    assert (first.tolist(), last.tolist()) == ([0, 1, 2], [3, 4])
    assert au.split(x, None) == (x, None)


@pytest.mark.parametrize("dependent", [0, 1, 2])
def test_elimination_puts_the_multiplier_of_the_dependent_row_into_the_others(dependent: int):
    rest = [i for i in range(3) if i != dependent]
    split = Partition(np.array([dependent]), np.array(rest))
    M_El, F_El = el.system(M, F, A, GAMMA, split)
    for row, i in enumerate(rest):
        share = A[0, i] / A[0, dependent]
        np.testing.assert_allclose(M_El[row], M[i] - share * M[dependent], rtol=1e-15)
        assert F_El[row] == pytest.approx(F[i] - share * F[dependent], rel=1e-15)
    assert (M_El[2].tolist(), F_El[2]) == ([1, 2, -1], -0.5)
    assert el.system(M, F, NONE, NONE, split) == (M, F)


@pytest.mark.parametrize("key", [key for key, one in FORMULATIONS.items() if one.uses == "terms"])
def test_every_formulation_of_terms_solves_the_same_equations(key: str):
    one, split = FORMULATIONS[key], Partition(np.array([1]), np.array([0, 2]))
    vdot, multipliers = one.solution(M, F, A, GAMMA, V, split)
    expected, force = solution()
    np.testing.assert_allclose(vdot, expected, rtol=1e-14)
    assert (multipliers is None) == (not one.multipliers)
    if multipliers is not None:
        np.testing.assert_allclose(multipliers, force, rtol=1e-13)
    none = Partition(np.zeros(0, int), np.arange(3))
    vdot, multipliers = one.solution(M, F, NONE, NONE, V, none)
    np.testing.assert_allclose(vdot, np.linalg.solve(M, F), rtol=1e-14)
    assert multipliers is None


def test_greenwoods_multipliers_are_those_of_the_forces():
    found = gw.greenwood_multipliers(M, F, A, GAMMA)
    np.testing.assert_allclose(found, solution()[1], rtol=1e-13)
    M_GW, F_GW = gw.system(M, F, A, np.array([2.0]))
    assert M_GW is M and F_GW.tolist() == [9, -4, 7]
    assert gw.greenwood_multipliers(M, F, NONE, NONE) is None


def test_a_repeated_row_shares_its_multiplier_with_the_row_that_it_repeats():
    twice, gamma = np.vstack([A, 2 * A]), np.array([0.5, 1.0])
    split = Partition(np.array([1]), np.array([0, 2]), np.array([0]), np.array([1]))
    vdot, multipliers = uk.solution(M, F, twice, gamma, V, split)
    expected, force = solution()
    np.testing.assert_allclose(vdot, expected, rtol=1e-14)
    # λ_1 + 2 λ_2 is the force, and the smallest such pair is 1 to 2.
    np.testing.assert_allclose(multipliers, [force[0] / 5, 2 * force[0] / 5], rtol=1e-13)


def test_a_projection_takes_the_rest_of_the_acceleration_from_the_forces():
    W, rest = np.array([[1.0, 0.0], [0.0, 1.0], [2.0, -1.0]]), np.array([1.0, 0.0, -2.0])
    square, right = project(M, F, W, rest)
    # M W = [[4, 1], [5, 3], [12, -4]], M rest = (4, -3, -12).
    assert square.tolist() == [[28, -7], [-7, 7]]
    assert right.tolist() == [3 + 2 * 21, -5 - 21]
    assert project(M, F, NONE, NONE) == (M, F)


def test_embedding_moves_along_the_independent_coordinates():
    for dependent in range(3):
        rest = [i for i in range(3) if i != dependent]
        split = Partition(np.array([dependent]), np.array(rest))
        vdot, multipliers = em.EM.solution(M, F, A, GAMMA, V, split)
        np.testing.assert_allclose(vdot, solution()[0], rtol=1e-13)
        assert multipliers is None


# ---- Sums over bodies ----------------------------------------------------------------------------


def bodies(seed: int = 0) -> tuple[np.ndarray, ...]:
    """Return two bodies in space whose velocities three speeds move."""
    random = np.random.default_rng(seed)
    partial, turning = random.integers(-3, 4, (2, 2, 3, 3)).astype(float)
    rest, turned, gyroscopic = random.integers(-3, 4, (3, 2, 3)).astype(float)
    inertia = np.array([np.diag([1.0, 2, 3]), [[4.0, 1, 0], [1, 5, 0], [0, 0, 6]]])
    return partial, turning, rest, turned, np.array([2.0, 3.0]), inertia, gyroscopic


def test_kanes_sums_are_over_all_bodies_and_both_kinds_of_velocity():
    partial, turning, rest, turned, mass, inertia, gyroscopic = bodies()
    found, left = kane.inertia_sums(*bodies())
    square, sums = np.zeros((3, 3)), np.zeros(3)
    for k in range(2):
        V, w = partial[k], turning[k]
        square += mass[k] * V.T @ V + w.T @ inertia[k] @ w
        sums += mass[k] * V.T @ rest[k] + w.T @ (inertia[k] @ turned[k] + gyroscopic[k])
    assert found.tolist() == square.tolist()
    assert left.tolist() == sums.tolist()
    _, without = kane.inertia_sums(*bodies()[:-1], NONE)
    spin = sum(turning[k].T @ gyroscopic[k] for k in range(2))
    np.testing.assert_allclose(left - without, spin, atol=1e-13)
    force = np.array([1.0, -2.0, 4.0])
    udot = kane.solution(*bodies(), force)
    np.testing.assert_allclose(udot, np.linalg.solve(square, force - sums), rtol=1e-9)
    np.testing.assert_allclose(kane.solution(*bodies(), NONE), np.linalg.solve(square, -sums))


# ---- Chains --------------------------------------------------------------------------------------


def chain(joints: int) -> tuple[np.ndarray, ...]:
    """Return (mass, force, before, after, rest) of a chain with so many joints."""
    random = np.random.default_rng(joints)
    mass, force = random.uniform(1, 2, 2 * joints + 2), random.uniform(-3, 3, 2 * joints + 2)
    before, after = random.uniform(-1, 1, (2, joints, 2, 2)) + 2 * np.eye(2)
    return mass, force, before, after, random.uniform(-1, 1, (joints, 2))


@pytest.mark.parametrize("joints", [1, 2, 5])
def test_a_chain_is_solved_as_the_dense_system_of_its_bodies_and_joints(joints: int):
    mass, force, before, after, rest = chain(joints)
    size, rows = 2 * joints + 2, 2 * joints
    gaps = np.zeros((rows, size))
    for k in range(joints):
        gaps[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = before[k]
        gaps[2 * k : 2 * k + 2, 2 * k + 2 : 2 * k + 4] = after[k]
    dense = np.block([[np.diag(mass), -gaps.T], [-gaps, np.zeros((rows, rows))]])
    order = [
        *(x for k in range(joints) for x in (2 * k, 2 * k + 1, size + 2 * k, size + 2 * k + 1)),
        size - 2,
        size - 1,
    ]
    bands, right = banded.system(mass, force, before, after, rest)
    assert bands.shape == (4 * joints + 2, 7)
    full = np.zeros((len(order), len(order)))
    for i in range(len(order)):
        for j in range(max(0, i - 3), min(len(order), i + 4)):
            full[i, j] = bands[i, 3 + j - i]
    assert full.tolist() == dense[np.ix_(order, order)].tolist()
    assert right.tolist() == np.concatenate([force, rest.ravel()])[order].tolist()
    for forces in (force, None):
        sides = np.concatenate([np.zeros(size) if forces is None else forces, rest.ravel()])
        expected = np.linalg.solve(dense, sides)
        xdot, found = banded.solution(mass, forces, before, after, rest)
        np.testing.assert_allclose(xdot, expected[:size], rtol=1e-11, atol=1e-12)
        np.testing.assert_allclose(found.ravel(), expected[size:], rtol=1e-11, atol=1e-12)
    x = np.arange(1.0, size + 1)
    np.testing.assert_allclose(banded.joint_gaps(before, after, x).ravel(), gaps @ x, rtol=1e-13)
