"""The formulations on exact fractions: they are not close to each other, they are equal."""

from __future__ import annotations

from fractions import Fraction
from functools import cache
from itertools import combinations
from operator import attrgetter

import numpy as np
import pytest
from tests.exact import SMALL_SCENES, RandomFractions

from eomcheck.claims.registry import GenericPoint
from eomcheck.errors import RefusedError
from eomcheck.formulations import FORMULATIONS, Formulation, Partition, kane
from eomcheck.formulations.em import project
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.dual import duals, rate

SEEDS = range(3)
ALL = list(FORMULATIONS.values())
WITH_MULTIPLIERS = [f for f in FORMULATIONS.values() if f.multipliers]
IN_TERMS = [f for f in FORMULATIONS.values() if f.uses == "terms"]
PARTITIONED = [f for f in FORMULATIONS.values() if f.partitioned]

structure = attrgetter("structure")
scenes = pytest.mark.parametrize("scene", SMALL_SCENES, ids=structure)
seeds = pytest.mark.parametrize("seed", SEEDS)


def formulations(which=ALL):
    return pytest.mark.parametrize("formulation", which, ids=lambda f: f.key)


@cache
def exact(scene: Scene, seed: int) -> GenericPoint:
    return point(scene, seed)


def point(scene: Scene, seed: int) -> GenericPoint:
    return GenericPoint(scene, RandomFractions(seed))


def partition(scene: Scene, dependent: tuple[int, ...]) -> Partition:
    rest = [i for i in range(scene.n) if i not in dependent]
    return Partition(np.array(dependent, int), np.array(rest, int))


@cache
def reference(scene: Scene, seed: int):
    return exact(scene, seed).solution(FORMULATIONS["au"])


def equal(x, y) -> bool:
    x, y = np.asarray(x, object), np.asarray(y, object)
    assert x.shape == y.shape
    return bool((x == y).all())


def is_exact(x) -> bool:
    return all(isinstance(y, Fraction | int) for y in np.ravel(x))


# ---- The formulations ----------------------------------------------------------------------------


@pytest.mark.sampled(4)
@scenes
@seeds
@formulations()
def test_all_formulations_give_exactly_the_same_acceleration(
    scene: Scene, seed: int, formulation: Formulation
):
    vdot = exact(scene, seed).solution(formulation).vdot
    assert is_exact(vdot)
    assert equal(vdot, reference(scene, seed).vdot)


@pytest.mark.sampled(4)
@scenes
@seeds
@formulations()
def test_multipliers_come_out_where_the_formulation_says_so_and_are_exactly_the_same(
    scene: Scene, seed: int, formulation: Formulation
):
    multipliers = exact(scene, seed).solution(formulation).multipliers
    assert (multipliers is not None) == formulation.multipliers
    if multipliers is not None:
        assert is_exact(multipliers)
        assert equal(multipliers, reference(scene, seed).multipliers)


@pytest.mark.sampled(4)
@scenes
@seeds
@formulations()
def test_every_acceleration_satisfies_the_constraints_differentiated_exactly(
    scene: Scene, seed: int, formulation: Formulation
):
    at = exact(scene, seed)
    assert equal(at.terms.a @ at.solution(formulation).vdot, -at.terms.gamma)


@pytest.mark.sampled(4)
@scenes
@seeds
@formulations(WITH_MULTIPLIERS)
def test_acceleration_and_multipliers_satisfy_the_equations_of_motion_exactly(
    scene: Scene, seed: int, formulation: Formulation
):
    at = exact(scene, seed)
    M, _, _, a, _, _ = at.terms
    result = at.solution(formulation)
    assert equal(M @ result.vdot, at.F + a.T @ result.multipliers)


@pytest.mark.parametrize("scene", [s for s in SMALL_SCENES if s.n <= 5], ids=structure)
@formulations(PARTITIONED)
def test_every_choice_of_dependent_coordinates_gives_exactly_the_same_acceleration(
    scene: Scene, formulation: Formulation
):
    at = exact(scene, 0)
    for dependent in combinations(range(scene.n), scene.r):
        vdot = at.solution(formulation, partition(scene, dependent)).vdot
        assert equal(vdot, reference(scene, 0).vdot), dependent


@pytest.mark.sampled(4)
@scenes
@formulations(IN_TERMS)
def test_without_constraints_every_formulation_in_terms_solves_for_the_free_motion(
    scene: Scene, formulation: Formulation
):
    at = exact(scene, 0)
    vdot, multipliers = formulation.solution(
        at.terms.M, at.F, None, None, at.v, partition(scene, dependent=())
    )
    assert multipliers is None
    assert is_exact(vdot)
    assert equal(at.terms.M @ vdot, at.F)


@pytest.mark.sampled(4)
@scenes
@formulations()
def test_a_wrong_sign_in_the_constraint_drift_does_not_go_unnoticed(
    scene: Scene, formulation: Formulation
):
    at = point(scene, 0)
    right = at.solution(formulation).vdot
    at.terms = at.terms._replace(gamma=-at.terms.gamma)
    at.speeds = at.speeds._replace(rest=-at.speeds.rest)
    at.bodies = at.bodies._replace(remainder=-at.bodies.remainder)
    # One link has no joint, but the tip of link 1 moves on with s_1 ω_1.
    at.chain = at.chain._replace(rest=-at.chain.rest)
    at.x = np.array([-at.x[0], *at.x[1:]], object)
    assert not equal(at.solution(formulation).vdot, right)


def test_a_singular_matrix_of_fractions_is_refused_by_its_name():
    at = point(SMALL_SCENES[0], 0)
    at.terms = at.terms._replace(a=at.terms.a * 0)
    with pytest.raises(RefusedError, match="M_Au") as caught:
        at.solution(FORMULATIONS["au"])
    assert (caught.value.what, caught.value.rcond) == ("M_Au", 0.0)


# ---- The scenes ----------------------------------------------------------------------------------


def functions_at(at: GenericPoint, qdot: np.ndarray, v: np.ndarray):
    """Return (terms, velocities, energies, constraint) while q changes at `qdot`."""
    prepared, q = at.prepared_duals(qdot)
    return [
        function(at.parameters, prepared, q, v)
        for function in (
            at.scene.terms,
            at.scene.velocities,
            at.scene.energies,
            at.scene.constraint,
        )
    ]


def unit(size: int, i: int) -> np.ndarray:
    return np.array([Fraction(int(i == j)) for j in range(size)], object)


@scenes
@seeds
def test_speeds_span_the_null_space_of_the_constraints_and_solve_their_rate(
    scene: Scene, seed: int
):
    at = exact(scene, seed)
    a, gamma = at.terms.a, at.terms.gamma
    assert equal(a @ at.speeds.W, np.zeros((scene.r, scene.p), int))
    assert equal(a @ at.speeds.rest + gamma, np.zeros(scene.r, int))
    assert equal(scene.speeds_of(at.parameters, at.prepared, at.q, at.v), at.u)


@scenes
@seeds
def test_the_rest_is_the_rate_of_the_velocity_at_constant_speeds(scene: Scene, seed: int):
    at = exact(scene, seed)
    prepared, q = at.prepared_duals(at.v)
    kinematics = scene.kinematics(at.parameters, prepared, q, duals(at.u, 0 * at.u))
    W = scene.speeds(at.parameters, prepared, kinematics).W
    assert equal(rate(W) @ at.u, at.speeds.rest)


@pytest.mark.sampled(3)
@scenes
@seeds
def test_the_mass_matrix_is_the_hessian_of_the_kinetic_energy(scene: Scene, seed: int):
    at = exact(scene, seed)

    def T(v):
        return scene.energies(at.parameters, at.prepared, at.q, v)[0]

    n = scene.n
    M = [
        [T(unit(n, i) + unit(n, j)) - T(unit(n, i)) - T(unit(n, j)) for j in range(n)]
        for i in range(n)
    ]
    assert equal(at.terms.M, M)


@scenes
@seeds
def test_the_mass_matrix_is_symmetric_and_positive_definite(scene: Scene, seed: int):
    M = exact(scene, seed).terms.M
    assert equal(M, M.T)
    left = M.copy()
    for i in range(scene.n):
        assert left[i, i] > 0
        left[i + 1 :] = left[i + 1 :] - np.outer(left[i + 1 :, i] / left[i, i], left[i])


@pytest.mark.sampled(3)
@scenes
@seeds
def test_the_bias_is_that_of_lagranges_equations(scene: Scene, seed: int):
    at = exact(scene, seed)
    momentum_rate = rate(functions_at(at, at.v, at.v)[0].M) @ at.v
    for i in range(scene.n):
        T, _ = functions_at(at, unit(scene.n, i), at.v)[2]
        B = 0 if at.terms.B is None else at.terms.B[i]
        assert momentum_rate[i] - rate(T) == B, i


@scenes
@seeds
def test_forces_are_the_gradient_of_potential_and_dissipation_and_absent_where_both_are(
    scene: Scene, seed: int
):
    at = exact(scene, seed)
    _, U = scene.energies(at.parameters, at.prepared, at.q, at.v)
    R = at.dissipation(at.v)
    assert (U is None and R is None) == (at.terms.Q is None)
    expected = np.zeros(scene.n, object)
    for i in range(scene.n):
        if U is not None:
            expected[i] -= rate(functions_at(at, unit(scene.n, i), at.v)[2][1])
        if R is not None:
            expected[i] -= rate(at.dissipation(duals(at.v, unit(scene.n, i))))
    assert at.terms.Q is None or equal(at.terms.Q, expected)


@scenes
@seeds
def test_the_constraint_jacobian_and_drift_are_derivatives_of_the_constraint(
    scene: Scene, seed: int
):
    at = exact(scene, seed)
    for i in range(scene.n):
        c = scene.constraint(at.parameters, at.prepared, at.q, unit(scene.n, i))
        assert equal(c, at.terms.a[:, i])
    assert equal(rate(functions_at(at, at.v, at.v)[3]), at.terms.gamma)


@scenes
@seeds
def test_bodies_move_as_the_velocities_of_the_second_derivation(scene: Scene, seed: int):
    """Along every partial velocity: what Kane's equations sum is M, rest and F again."""
    at = exact(scene, seed)
    velocities, (W, rest, _) = scene.velocities, at.speeds
    partial = [velocities(at.parameters, at.prepared, at.q, W[:, i]) for i in range(scene.p)]
    prepared, q = at.prepared_duals(at.v)
    accelerations = velocities(at.parameters, prepared, q, duals(at.v, rest))
    mass, inertia = at.parameters.mass, at.parameters.inertia

    M_Kane, left = kane.inertia_sums(*at.bodies[:-1])
    for i, (V_i, omega_i) in enumerate(partial):
        for j, (V_j, omega_j) in enumerate(partial):
            linear = (mass * (V_i * V_j).sum(axis=1)).sum()
            assert M_Kane[i, j] == linear + (inertia * (omega_i * omega_j).sum(axis=1)).sum()
        linear = (mass * (V_i * rate(accelerations[0])).sum(axis=1)).sum()
        angular = (inertia * (omega_i * rate(accelerations[1])).sum(axis=1)).sum()
        assert left[i] == linear + angular


@scenes
@seeds
def test_modified_lagrange_and_kane_have_the_same_matrix_and_right_hand_side(
    scene: Scene, seed: int
):
    at = exact(scene, seed)
    M_ML, F_ML = project(at.terms.M, at.F, at.speeds.W, at.speeds.rest)
    b = at.bodies
    M_Kane, left = kane.inertia_sums(*b[:-1])
    assert equal(M_Kane, M_ML)
    assert equal(kane.right_hand_side(b.force, left), F_ML)
    assert (b.force is None) == (at.terms.Q is None)
    if b.force is not None:
        assert equal(b.force, at.speeds.W.T @ at.terms.Q)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("scene", [s for s in SMALL_SCENES if s.conserves_energy], ids=structure)
@seeds
@formulations()
def test_ideal_constraints_do_no_work(scene: Scene, seed: int, formulation: Formulation):
    at = exact(scene, seed)
    vdot = at.solution(formulation).vdot
    T, U = functions_at(at, at.v, duals(at.v, vdot))[2]
    assert rate(T if U is None else T + U) == 0
