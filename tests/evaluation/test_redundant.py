"""Redundant constraints against pseudo-inverses in many digits, and against those left out."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import eomcheck
from eomcheck import RefusedError, acceleration, independent_constraints, with_constraints
from eomcheck.claims.case import Case
from eomcheck.claims.numerical_accuracy import independent_rcond, judge_refusal
from eomcheck.errors import InputError
from eomcheck.evaluation import constraint_rank as rank_module
from eomcheck.evaluation.constraint_rank import RANK, check_rank_kept, rank_of, repeated_rows
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import CONTRADICTION, perturbed_samples
from eomcheck.formulations import FORMULATIONS, Partition, applicable
from eomcheck.scenes import Bricard, FourBarChain, Snake

UK = FORMULATIONS["uk"]
RING, CHAIN = Bricard(redundant=2.0), replace(FourBarChain.rods(2), angle=1.0, repeated=1.0)
STATES = {
    "bricard": (RING, *RING.closed_state(0.5, 0.7)),
    "bricard, cube": (RING, *RING.closed_state(0.0, -1.0)),
    "four-bar": (CHAIN, *CHAIN.initial_state()),
    "four-bar, three times": (replace(CHAIN, repeated=-3.0), *CHAIN.initial_state()),
}
ONCE = {"bricard": Bricard(), "four-bar": replace(CHAIN, repeated=None)}
every_state = pytest.mark.parametrize("name", STATES)


def once(name: str) -> tuple[eomcheck.scenes.Bricard | FourBarChain, np.ndarray, np.ndarray]:
    """Return the same scene without its redundant row."""
    _, q, v = STATES[name]
    return ONCE[name.partition(",")[0]], q, v


# ---- The truth -----------------------------------------------------------------------------------


def exact(M, F, a, gamma, kept) -> tuple[list, list]:
    """Return v̇ and the smallest λ of these doubles, as fractions.

    Of rows `kept`, which imply the others: their augmented system, and then all λ = Eᵀ⁺ μ by the
    normal equations, of which no formulation knows.
    """
    n, r = len(F), len(gamma)
    A = [[Fraction(x) for x in row] for row in a]
    size = n + len(kept)
    K = [[Fraction(0)] * size for _ in range(size)]
    right = [Fraction(x) for x in F] + [-Fraction(gamma[k]) for k in kept]
    for i in range(n):
        for j in range(n):
            K[i][j] = Fraction(M[i][j])
        for c, k in enumerate(kept):
            K[i][n + c], K[n + c][i] = -A[k][i], A[k][i]
    vdot = eliminated(K, right)[:n]
    force = [sum(Fraction(M[i][j]) * vdot[j] for j in range(n)) - Fraction(F[i]) for i in range(n)]
    # aᵀ λ = force, least |λ|: λ = a w with aᵀ a w = force, w in the span of the kept rows.
    gram = [[sum(A[k][i] * A[m][i] for i in range(n)) for m in range(r)] for k in range(r)]
    inner = [[sum(gram[m][i] * gram[m][j] for m in range(r)) for j in kept] for i in kept]
    w = eliminated(inner, [sum(A[i][j] * force[j] for j in range(n)) for i in kept])
    return vdot, [sum(gram[m][k] * w[c] for c, k in enumerate(kept)) for m in range(r)]


def eliminated(A: list[list[Fraction]], b: list[Fraction]) -> list[Fraction]:
    """Return the solution of A x = b by Gauss-Jordan elimination."""
    rows = [[*row, right] for row, right in zip(A, b, strict=True)]
    for c in range(len(rows)):
        pivot = next(i for i in range(c, len(rows)) if rows[i][c] != 0)
        rows[c], rows[pivot] = rows[pivot], rows[c]
        rows[c] = [x / rows[c][c] for x in rows[c]]
        for i in range(len(rows)):
            if i != c:
                rows[i] = [x - rows[i][c] * y for x, y in zip(rows[i], rows[c], strict=True)]
    return [row[-1] for row in rows]


@every_state
def test_motion_and_smallest_multipliers_are_those_of_exact_fractions(name: str):
    scene, q, v = STATES[name]
    at = Evaluation(scene, q, v)
    found = acceleration(scene, "uk", q, v)
    M, _, _, a, gamma, _ = at.terms
    kept = at.independent_partition.kept.tolist()
    vdot, multipliers = exact(M.tolist(), at.F.tolist(), a.tolist(), gamma.tolist(), kept)
    assert np.abs(found.vdot - np.array(vdot, float)).max() <= found.error_bound < 1e-11
    # The fifth row depends on the others to rounding only, and so do these λ.
    assert np.abs(found.multipliers - np.array(multipliers, float)).max() < 1e-13


@every_state
def test_the_acceleration_is_that_without_the_redundant_row(name: str):
    here, bare = STATES[name], once(name)
    found, expected = acceleration(here[0], "uk", *here[1:]), acceleration(bare[0], "au", *bare[1:])
    allowed = found.error_bound + expected.error_bound
    assert np.abs(found.vdot - expected.vdot).max() <= allowed < 1e-11
    a, alone = (Evaluation(*one).terms.a for one in (here, bare))
    assert np.abs(a.T @ found.multipliers - alone.T @ expected.multipliers).max() < 1e-12


@pytest.mark.parametrize("times", [1.0, -3.0, 0.25])
def test_a_row_and_its_multiple_share_the_load_by_their_size(times: float):
    """λ_1 + t λ_2 = μ with the least λ_1² + λ_2²: λ_1 = μ/(1 + t²), λ_2 = t μ/(1 + t²)."""
    q, v = CHAIN.initial_state()
    alone = acceleration(replace(CHAIN, repeated=None), "au", q, v).multipliers
    both = acceleration(replace(CHAIN, repeated=times), "uk", q, v).multipliers
    assert alone is not None and both is not None
    assert np.abs(both[:3] - alone[:3]).max() < 1e-13
    shared = alone[3] / (1.0 + times**2) * np.array([1.0, times])
    assert np.abs(both[3:] - shared).max() < 1e-13


@every_state
def test_it_is_the_equation_of_udwadia_and_kalaba(name: str):
    """With the pseudo-inverse of numpy, whose singular values tell the rank in another way."""
    at = Evaluation(*STATES[name])
    M, _, _, a, gamma, _ = at.terms
    free = np.linalg.solve(M, at.F)
    mobility = a @ np.linalg.solve(M, a.T)
    multipliers = -np.linalg.pinv(mobility, rcond=1e-9) @ (gamma + a @ free)
    found = at.acceleration(UK)
    assert found.multipliers is not None
    assert np.abs(found.multipliers - multipliers).max() < 1e-11
    assert np.abs(found.vdot - free - np.linalg.solve(M, a.T @ multipliers)).max() < 1e-11


@st.composite
def dependent_rows(draw):
    """Draw M, F, a, gamma with rows that depend on each other, and which of them are kept."""
    whole = st.integers(-8, 8).map(float)
    n, rank, more = draw(st.integers(2, 5)), draw(st.integers(1, 2)), draw(st.integers(1, 4))
    vectors = st.lists(whole, min_size=n, max_size=n)
    L = np.tril(np.array(draw(st.lists(vectors, min_size=n, max_size=n)))) / 8.0
    np.fill_diagonal(L, draw(st.lists(st.integers(4, 16).map(float), min_size=n, max_size=n)))
    base = np.array(draw(st.lists(vectors, min_size=rank, max_size=rank)))
    base[:, :rank] += 64.0 * np.eye(rank)
    shares = st.lists(whole, min_size=rank, max_size=rank)
    mixed = np.array(draw(st.lists(shares, min_size=more, max_size=more))) / 4.0
    order = np.array(draw(st.permutations(range(rank + more))))
    E = np.concatenate((np.eye(rank), mixed))[order]
    kept, redundant = np.flatnonzero(order < rank), np.flatnonzero(order >= rank)
    drift = E @ np.array(draw(st.lists(whole, min_size=rank, max_size=rank)))
    return L @ L.T, np.array(draw(vectors)), E @ base, drift, kept, redundant


@settings(max_examples=60)
@given(dependent_rows())
def test_any_dependent_rows_have_the_motion_and_multipliers_of_exact_fractions(drawn):
    M, F, a, gamma, kept, redundant = drawn
    columns = np.arange(len(F))
    partition = Partition(columns[: len(kept)], columns[len(kept) :], kept, redundant)
    vdot, multipliers = UK.solution(M, F, a, gamma, None, partition)
    expected = exact(M.tolist(), F.tolist(), a.tolist(), gamma.tolist(), kept.tolist())
    for found, true in zip((vdot, multipliers), expected, strict=True):
        true = np.array(true, float)
        assert np.abs(found - true).max() <= 1e-10 * max(1.0, np.abs(true).max())


@settings(max_examples=30)
@given(dependent_rows(), st.randoms(use_true_random=False))
def test_other_rows_kept_make_no_difference(drawn, random):
    M, F, a, gamma, kept, redundant = drawn
    every = np.arange(len(a))
    other = np.array(sorted(random.sample(range(len(a)), len(kept))))
    values = np.linalg.svd(a[other] / 64.0, compute_uv=False)
    if values[-1] < 0.1:
        return  # these do not imply the others
    columns = np.arange(len(F))
    found = [
        UK.solution(M, F, a, gamma, None, Partition(columns, columns, *rows))
        for rows in ((kept, redundant), (other, np.setdiff1d(every, other)))
    ]
    for x, y in zip(*found, strict=True):
        assert np.abs(x - y).max() <= 1e-9 * max(1.0, np.abs(x).max())


def test_nothing_is_solved_for_rows_that_are_independent():
    snake = Snake.paper()
    q, _ = snake.initial_state()
    v = eomcheck.velocity(snake, q, [1.0, 0.5])
    found, expected = (acceleration(snake, key, q, v) for key in ("uk", "au"))
    assert (found.vdot == expected.vdot).all() and (found.multipliers == expected.multipliers).all()
    assert list(found.rcond) == ["M_UK"]


def test_what_a_claim_solves_by_itself_is_kept_for_its_copies():
    """They take what elimination rounds from the original's factors."""
    at = Evaluation(*STATES["bricard"])
    uk = FORMULATIONS["uk"]
    M, _, _, a, gamma, _ = at.terms
    given = M, at.F, a, gamma, at.v, at.partition_for(uk, pivoted=False)
    _, digits = at.call_solving("as a claim does", uk.solution, *given)
    kept = at.solves["as a claim does", False]
    assert digits and set(kept) == {"M_UK", "a_k fit", "1 + G GT"}
    with perturbed_samples(at).recording_solves(("as a claim does", False)) as watch:
        assert watch.references.keys() == kept.keys()


def test_a_mass_matrix_may_be_singular_where_constraints_hold_the_rest():
    M, F = np.diag([1.0, 0.0]), np.array([1.0, 2.0])
    a, gamma = np.array([[0.0, 1.0], [0.0, 2.0]]), np.array([3.0, 6.0])
    partition = Partition(np.array([0]), np.array([1]), np.array([0]), np.array([1]))
    vdot, multipliers = UK.solution(M, F, a, gamma, None, partition)
    assert np.abs(vdot - [1.0, -3.0]).max() < 1e-15
    assert np.abs(multipliers - [-0.4, -0.8]).max() < 1e-15


# ---- Errors --------------------------------------------------------------------------------------


@pytest.mark.sampled(3)
@every_state
def test_enclosures_hold_the_result_and_its_error_is_what_the_bound_says(name: str):
    scene, q, v = STATES[name]
    found = eomcheck.accuracy(scene, "uk", q, v=v)
    assert found.error.max() <= acceleration(scene, "uk", q, v).error_bound
    assert found.digits > 12
    assert not found.silently_wrong


@pytest.mark.sampled(3)
@every_state
def test_no_claim_fails_where_constraints_are_redundant(name: str):
    scene, q, v = STATES[name]
    findings = eomcheck.check_state(scene, q, v)
    assert [str(f) for f in findings if f.verdict == "failed"] == []
    solved = {f.subject for f in findings if f.claim == "constraint-acceleration"}
    assert solved == {"uk"}
    code = [f.verdict for f in findings if f.claim == "machine-code"]
    assert code == ["passed"]


# ---- Which they are ------------------------------------------------------------------------------


@pytest.mark.parametrize("key", [key for key in applicable(FourBarChain) if key != "uk"])
@every_state
def test_every_other_formulation_says_which_constraint_is_redundant(name: str, key: str):
    scene, q, v = STATES[name]
    (redundant,) = independent_constraints(scene, q).redundant
    with pytest.raises(RefusedError, match=f"the other constraints imply it: {redundant}"):
        acceleration(scene, key, q, v)


@every_state
def test_every_formulation_solves_what_is_left_by_name(name: str):
    scene, q, v = STATES[name]
    left = with_constraints(scene, independent_constraints(scene, q).kept)
    assert (left.r, left.p) == (4, 1)
    expected = acceleration(scene, "uk", q, v).vdot
    for key in applicable(left):
        found = acceleration(left, key, q, v)
        assert np.abs(found.vdot - expected).max() <= found.error_bound + 1e-11
    assert independent_constraints(left, q).redundant == ()


def test_the_rows_taken_are_those_that_pivoted_qr_takes_first():
    q, _ = RING.closed_state(1.0, 0.0)
    assert independent_constraints(RING, q).redundant == ("hinge along z",)
    found = rank_of(Evaluation(RING, q, np.zeros(5)))
    assert found.distance[4] <= found.uncertainty[4] < 1e-12
    assert found.distance[:4].min() > 0.1
    assert independent_constraints(RING, RING.closed_state(0.2, 0.0)[0]).redundant == (
        "hinge along y",
    )


@pytest.mark.parametrize("times", [1e-12, 0.3, -7.0, 1e9])
def test_of_rows_that_say_the_same_the_last_is_redundant(times: float):
    q, _ = CHAIN.initial_state()
    again = replace(CHAIN, repeated=times)
    assert independent_constraints(again, q).redundant == ("repeated",)


def changed(scene: FourBarChain, **functions) -> FourBarChain:
    """Return the chain with other functions."""

    def terms(parameters, prepared, q, v):
        found = FourBarChain.terms(parameters, prepared, q, v)
        a, b = other.constraints(parameters, prepared, q)
        return found._replace(a=a, b=b, gamma=other.drift(parameters, prepared, q, v))

    functions |= {"terms": terms}
    held = {name: staticmethod(x) if callable(x) else x for name, x in functions.items()}
    other = object.__new__(type("Changed", (FourBarChain,), held))
    vars(other).update(vars(scene))
    return other


def off(amount: float) -> FourBarChain:
    """Return a chain whose last row is that before it, turned by so much."""

    def constraints(parameters, angles, q):
        a, b = FourBarChain.constraints(parameters, angles, q)
        turned = a[-1:] + amount * np.array([[0, 0, 0, 0, 1]])
        return np.concatenate((a[:4], turned)), b

    return changed(CHAIN, constraints=constraints)


def test_a_rank_that_is_not_clear_is_refused_by_name():
    q, v = CHAIN.initial_state()
    seen = {}
    for power in range(4, 17):
        scene = off(10.0**-power)
        try:
            partition = Evaluation(scene, q, v).independent_partition
            seen[power] = "independent" if partition.redundant is None else "redundant"
        except RefusedError as refusal:
            assert refusal.what == RANK
            assert refusal.rcond <= refusal.threshold
            assert "the rank of a is not clear: the constraint of " in str(refusal)
            seen[power] = "not clear"
    assert list(dict.fromkeys(seen.values())) == ["independent", "not clear", "redundant"]
    assert seen[8] == "independent" and seen[12] == "not clear" and seen[16] == "redundant"


def test_a_row_is_as_unsure_as_the_rows_that_it_is_made_of():
    # What depends is exact here, what it depends on is not: its distance is all of their rounding.
    random, reached = np.random.default_rng(0), []
    for _ in range(60):
        rank = int(random.integers(1, 4))
        kept, shares = random.normal(size=(rank, 6)), random.uniform(-10.0, 10.0, rank)
        row = shares @ kept
        unsure = np.vstack((10.0 ** random.uniform(-9.0, -6.0, (rank, 6)), np.zeros(6)))
        R = np.linalg.qr(np.vstack((kept, row)).T, mode="r")
        allowed, distances = rank_module._rounding(R, unsure, rank, rank), []
        for _ in range(40):
            moved = kept + unsure[:-1] * random.choice((-1.0, 1.0), kept.shape)
            share = np.linalg.lstsq(moved.T, row, rcond=None)[0]
            distances.append(np.linalg.norm(row - share @ moved))
        assert max(distances) <= allowed * (1 + 1e-4)
        reached.append(max(distances) / allowed)
    assert np.median(reached) > 0.3


def test_the_rank_does_not_depend_on_units():
    q, v = CHAIN.initial_state()
    at = Evaluation(CHAIN, q, v)
    for scale in (1e-12, 1e9):
        heavy = replace(CHAIN, mass=CHAIN.mass * scale, inertia=CHAIN.inertia * scale)
        assert independent_constraints(heavy, q).redundant == ("repeated",)
    assert (rank_of(at).kept == [0, 1, 2, 3]).all()


def test_after_many_turns_the_rank_is_as_clear_as_the_angles_are():
    """2π of 1e5 turns is known to 1e-10 only, and the ring closes as well as that."""
    q, _ = RING.closed_state(0.5, 0.0)
    turned = q + 2 * np.pi * 1e5 * np.array([1, -1, 1, 1, -1])
    assert len(independent_constraints(RING, turned).kept) == 4
    at = Evaluation(RING, turned, np.zeros(5))
    assert 1e-12 < np.linalg.svd(at.terms.a, compute_uv=False)[-1] < rank_of(at).uncertainty.max()


def test_a_changed_rank_is_refused():
    q, v = RING.closed_state(0.5, 0.0)
    closed = Evaluation(RING, q, v)
    three = closed.partition._replace(kept=np.arange(3), redundant=np.array([3, 4]))
    with pytest.raises(RefusedError, match="the rank of a is 4 here and was 3 where the motion"):
        check_rank_kept(closed, three)
    flat = replace(CHAIN, angle=0.0)
    at = Evaluation(flat, *flat.initial_state())
    with pytest.raises(RefusedError, match="the rank of a is 2 here and was 4 where the motion"):
        check_rank_kept(at, at.partition._replace(kept=np.arange(4), redundant=np.array([4])))
    check_rank_kept(closed, closed.independent_partition)


@pytest.mark.parametrize("repeated", [None, 1.0])
def test_a_singular_pose_is_no_redundancy(repeated: float | None):
    flat = replace(CHAIN, angle=0.0, repeated=repeated)
    with pytest.raises(RefusedError, match=r"window 1, x, window 2, x.* the pose is singular"):
        acceleration(flat, "uk", *flat.initial_state())


def test_an_open_ring_has_all_its_constraints():
    q, _ = RING.closed_state(0.5, 0.0)
    open_ring = q + 0.1 * np.eye(5)[0]
    assert independent_constraints(RING, open_ring) == (RING.constraint_names, ())


@pytest.mark.parametrize("sign", [1, -1])
def test_constraints_that_contradict_each_other_are_refused_by_name(sign: int):
    def drift(parameters, angles, q, v):
        return FourBarChain.drift(parameters, angles, q, v) + np.array([0, 0, 0, 0, sign])

    scene = changed(CHAIN, drift=drift)
    q, v = CHAIN.initial_state()
    with pytest.raises(
        RefusedError, match=r"of repeated contradicts the others.* allowed [-\de.]+$"
    ):
        acceleration(scene, "uk", q, v)
    with pytest.raises(RefusedError, match="contradicts"):
        eomcheck.accuracy(scene, "uk", q, v=v)
    found = [f for f in eomcheck.check_state(scene, q, v, engines=[]) if "uk" in f.subject]
    assert {f.claim for f in found} == {"refusals"}
    assert [f.verdict for f in found] == ["passed"]


def test_a_contradiction_that_there_is_not_is_refused_in_vain():
    refusal = RefusedError(CONTRADICTION, 1e-3, 1.0, "refused")
    for scene, q, v in STATES.values():
        rcond = independent_rcond(UK, refusal, Case(Evaluation(scene, q, v), (UK,), ()))
        assert judge_refusal(refusal, rcond)[0] == "failed"


def test_more_constraints_than_coordinates_are_solved_or_refused():
    one = replace(FourBarChain.rods(1), angle=1.0)

    def constraints(parameters, angles, q):
        a, b = FourBarChain.constraints(parameters, angles, q)
        return np.concatenate((a, a)), b

    def drift(parameters, angles, q, v):
        gamma = FourBarChain.drift(parameters, angles, q, v)
        return np.concatenate((gamma, gamma))

    names = property(lambda self: ("x", "y", "x again", "y again"))
    functions = {"constraints": constraints, "drift": drift, "position_residual": None}
    scene = changed(one, constraint_names=names, **functions)
    q, v = one.initial_state()
    expected = acceleration(one, "au", q, v)
    found = acceleration(scene, "uk", q, v)
    assert np.abs(found.vdot - expected.vdot).max() <= found.error_bound + expected.error_bound
    assert found.multipliers is not None and expected.multipliers is not None
    assert np.abs(found.multipliers - np.tile(expected.multipliers / 2, 2)).max() < 1e-13
    for key in applicable(FourBarChain):
        if key != "uk":
            with pytest.raises(
                RefusedError, match="redundant, for the other constraints imply it: "
            ):
                acceleration(scene, key, q, v)


def test_a_partition_cannot_be_chosen():
    with pytest.raises(InputError, match="uk has no partition to choose"):
        acceleration(CHAIN, "uk", *CHAIN.initial_state(), pivoted=True)


# ---- Which rows repeat which ---------------------------------------------------------------------


def test_a_row_that_repeats_others_is_named_as_their_sum_of_any_size():
    a = np.array([[0.1, 0.2, 0.0], [0.0, 1e9, 3e9], [0.2, 0.4, 0.0], [0.1, 1e9 + 0.2, 3e9]])
    names = ["a", "b", "c", "d"]
    assert repeated_rows(a, names) == ["c = 2 a", "d = a + b"]
    assert repeated_rows(a, names, [0]) == ["d = b + 0.5 c", "a = 0.5 c"]
    assert repeated_rows(a[:2], names) == []
    assert repeated_rows(np.zeros((1, 3)), names) == ["a = 0"]
    # A row that is beside the span by more than rounding repeats nothing.
    a[2, 2] = 0.1
    assert repeated_rows(a, names) == ["d = a + b"]


def test_of_a_long_sum_no_rows_are_named():
    a = np.vstack([np.eye(4), np.ones(4)])
    assert repeated_rows(a, [*"abcde"]) == ["e follows from the rows before it"]
