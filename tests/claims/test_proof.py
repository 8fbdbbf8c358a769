"""`prove`: what is proved, what a proof rests on, and what is disproved or refused by name."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import permutations
from typing import Any

import numpy as np
import pytest
from tests.samples import NOT_OF_SNAKES
from tests.scenes.test_own_scene import Free, MarkedFree, free_terms

from eomcheck.claims import CLAIMS, Finding, proof
from eomcheck.claims import proof as draws
from eomcheck.claims.proof import failure_probability, identities_at, prove, prove_structure
from eomcheck.claims.registry import Comparison, GenericPoint
from eomcheck.errors import InputError, UnknownNameError
from eomcheck.formulations import FORMULATIONS
from eomcheck.formulations.au import split
from eomcheck.mechanics.records import Speeds, Terms
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.finite_field import PRIME_COUNT, DegreeArithmetic
from eomcheck.numbers.generic import generic
from eomcheck.numbers.linear import solve
from eomcheck.scenes import SCENES, Snake

ALL = tuple(FORMULATIONS.values())
IDENTITIES = {key for key, claim in CLAIMS.items() if claim.proved}


def failed(findings: list[Finding]) -> list[Finding]:
    return [f for f in findings if f.verdict != "passed"]


def what(findings: list[Finding]) -> list[tuple[str, str]]:
    return [(f.claim, f.subject) for f in findings]


# ---- What is proved ------------------------------------------------------------------------------


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    ("key", "links"),
    [
        (key, links)
        for key, kind in SCENES.items()
        for links in ([1, 2, 3, 4, 7] if kind.has_links else [None])
    ],
)
def test_every_claim_about_a_kind_of_scene_is_proved_with_and_without_absent_terms(key, links):
    findings = prove(SCENES[key], links, points=2, seed=0)
    assert failed(findings) == []
    structures = {f.scene.structure for f in findings}
    assert structures == {scene.structure for scene in SCENES[key].structures(links)}


def test_every_identity_is_proved_and_none_without_a_claim():
    findings = prove(Snake, 3, points=1, seed=0)
    assert {f.claim for f in findings} == IDENTITIES - NOT_OF_SNAKES
    springless = [f for f in findings if f.scene.structure.endswith("no stiffness")]
    absent = {"generalized-forces", "active-forces", "chain-forces"} | NOT_OF_SNAKES
    assert {f.claim for f in springless} == IDENTITIES - absent


def test_every_formulation_takes_part_and_every_pair_is_compared_once():
    findings = prove(Snake.coil(3), points=1, seed=0)
    by_claim = {claim: [f.subject for f in findings if f.claim == claim] for claim in IDENTITIES}
    for claim in ("equations-residual", "constraint-acceleration", "power-balance"):
        assert by_claim[claim] == list(FORMULATIONS)
    drawn = [f"{f.key}, drawn" for f in ALL if f.partitioned]
    count = len(ALL) * (len(ALL) - 1) // 2
    assert len(set(by_claim["equivalence"])) == count + len(drawn)
    assert by_claim["equivalence"][count:] == drawn


@pytest.mark.night
def test_an_instance_stands_for_its_structure_only():
    snake = Snake.paper()
    findings = prove(replace(snake, stiffness=None), points=1, seed=0)
    assert failed(findings) == []
    assert {f.scene.structure for f in findings} == {"snake[7], no stiffness"}
    again = prove(replace(snake, stiffness=None, mass=[9.0] * 7), points=1, seed=0)
    assert [f.proof for f in again] == [f.proof for f in findings]


def test_several_numbers_of_links_are_proved_one_after_the_other():
    findings = prove(Snake.coil(5), iter((1, 3)), points=1, seed=0)
    assert list(dict.fromkeys(f.scene.name for f in findings)) == ["snake[1]", "snake[3]"]


def test_formulations_left_out_take_no_part():
    findings = prove(Snake.coil(2), points=1, seed=0, formulations=["kane", "au"])
    assert [s for c, s in what(findings) if c == "equivalence"] == ["kane ~ au"]
    none = prove(Snake.coil(2), points=1, seed=0, formulations=[])
    assert {"bias", "null-space-speeds"} <= {f.claim for f in none}
    assert "equivalence" not in {f.claim for f in none}


# ---- What a proof rests on -----------------------------------------------------------------------


@pytest.mark.night
def test_a_proof_carries_its_bounds_its_primes_and_its_probability():
    for finding in prove(Snake, 3, points=3, seed=0):
        proof = finding.proof
        assert proof is not None
        assert finding.state is None
        assert (finding.observed, finding.detail) == (0.0, "")
        assert all(p.bit_length() == 62 for p in proof.primes)
        assert len(set(proof.primes)) == 3 <= proof.draws
        assert proof.degree >= 0 <= proof.height
        assert 0 <= proof.failure_probability < 1e-40
        chance = proof.failure_probability
        basis = f"failure probability below {chance:.1e}" if chance else "nothing in it is random"
        assert finding.evidence == f"proved: 3 points, {basis}"
        assert finding.scene.structure in str(finding)
        assert finding.as_dict()["proof"]["primes"] == list(proof.primes)


def test_the_probability_is_the_documented_one():
    """Per point 2 d / (2^61 - 1) plus the share of primes that divide all coefficients."""
    for finding in prove(Snake, 2, points=2, seed=0):
        proof = finding.proof
        assert proof is not None
        bad = (proof.height + proof.degree / 2) / 61 / PRIME_COUNT
        per_point = 2 * proof.degree / (2**61 - 1) + bad
        choices = math.comb(proof.draws, 2)
        # A drawn partition is one of at most n that might have been looked at.
        choices *= finding.scene.n if finding.subject.endswith("drawn") else 1
        assert math.isclose(proof.failure_probability, choices * per_point**2)


def test_the_primes_of_a_proof_are_those_of_the_points_that_were_looked_at(monkeypatch):
    looked_at: dict[tuple[str, str], list[int]] = {}

    def look(at: GenericPoint, *claims):
        for key, sides in identities_at(at, *claims):
            if not isinstance(at.arithmetic, DegreeArithmetic):
                looked_at.setdefault(key, []).append(at.q[0].modulus())
            yield key, sides

    monkeypatch.setattr(draws, "identities_at", look)
    findings = prove(Snake.coil(2), points=3, seed=0)
    assert {f.claim for f in findings} <= IDENTITIES
    for finding in findings:
        assert finding.proof is not None
        assert list(finding.proof.primes) == looked_at[finding.claim, finding.subject]


@pytest.mark.parametrize("order", list(permutations((1, 2, 3))))
def test_the_degree_and_height_of_a_proof_are_the_largest_of_all_entries(monkeypatch, order):
    """Entries are x, 4 x y and 3 x y z; the last has the largest degree, not the largest height."""

    def sides(at: GenericPoint, look: GenericPoint):
        x, y, z = at.q[:3]
        numbers = {1: x, 2: 4 * x * y, 3: 3 * x * y * z}
        found = np.array([numbers[i] for i in order], object)
        yield Comparison("test", found, np.array([numbers[i] for i in order], object), (("",) * 3,))

    claim = replace(CLAIMS["bias"], id="test", sides=sides, asks="")
    monkeypatch.setitem(CLAIMS, "test", claim)
    (finding,) = [f for f in prove(Snake.coil(1), points=2, seed=0) if f.claim == "test"]
    proof = finding.proof
    assert proof is not None
    # A side minus itself is bounded as a sum: coefficients 8 and 6.
    assert (proof.degree, proof.height) == (3, 3.0)
    assert proof.failure_probability == failure_probability(3, 3.0, 2, proof.draws)


def test_the_probability_of_a_small_identity_is_what_points_of_a_small_field_show(monkeypatch):
    """x² = 1 has 2 solutions modulo each prime: it holds at 2 / p of all points, or at fewer."""
    low, high = 2**6, 2**7
    primes = [p for p in range(low + 1, high, 2) if all(p % k for k in range(3, 12, 2))]
    for p in primes:
        solutions = [x for x in range(p) if x * x % p == 1]
        assert len(solutions) / p <= 2 * 2 / (low - 1)
    monkeypatch.setattr(proof, "PRIMES", (low, high))
    monkeypatch.setattr(proof, "PRIME_COUNT", len(primes))
    assert failure_probability(2, 1.0, 1, 1) >= 2 / min(primes)


def test_the_probability_falls_with_points_and_grows_with_what_is_to_be_excluded():
    one, two = failure_probability(50, 80.0, 1, 1), failure_probability(50, 80.0, 2, 2)
    assert math.isclose(two, one * one)
    assert failure_probability(51, 80.0, 1, 1) > one
    assert failure_probability(50, 81.0, 1, 1) > one
    assert failure_probability(50, 80.0, 1, 4) == 4 * one
    assert failure_probability(2**70, 0.0, 1, 1) == 1.0


def test_more_points_make_every_proof_stronger():
    few, many = (prove(Snake.coil(2), points=points, seed=0) for points in (1, 3))
    for weak, strong in zip(few, many, strict=True):
        assert weak.proof is not None and strong.proof is not None
        assert (weak.proof.degree, weak.proof.height) == (strong.proof.degree, strong.proof.height)
        if weak.proof.failure_probability > 0:
            assert strong.proof.failure_probability < 1e-10 * weak.proof.failure_probability


def primes(findings: list[Finding]) -> set[int]:
    return {p for f in findings if f.proof is not None for p in f.proof.primes}


@pytest.mark.night
def test_the_same_seed_gives_the_same_primes_and_another_one_others():
    first, again, other = (prove(Snake, 2, points=2, seed=seed) for seed in (0, 0, 6))
    assert [f.proof for f in first] == [f.proof for f in again]
    assert not primes(first) & primes(other)


def test_without_a_seed_every_run_draws_its_own_primes():
    assert not primes(prove(Snake, 1, points=2)) & primes(prove(Snake, 1, points=2))


@pytest.mark.night
def test_every_structure_draws_its_own_primes():
    findings = prove(Snake, (2, 3), points=2, seed=0)
    assert len(primes(findings)) == 2 * len({f.scene.structure for f in findings})


# ---- Input ---------------------------------------------------------------------------------------


class Nameless(Free):
    """A kind of scene that comes in one size."""


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((Snake, 2, 0), "points = 0, expected a whole number of at least 1"),
        ((Snake, 2, 10**9 + 1), "points = 1000000001, expected at most 1000000000"),
        ((Snake, 2, 2.5), "points = 2.5, expected a whole number of at least 1"),
        ((Snake, 2, True), "points = True, expected a whole number of at least 1"),
        ((Snake, 0), "links = 0, expected a whole number of at least 1"),
        ((Snake, (2, -1)), "links = -1, expected a whole number of at least 1"),
        ((Snake, 2.5), "links = 2.5, expected a whole number of at least 1"),
        ((Snake, True), "links = True, expected a whole number of at least 1"),
        ((Snake, []), "links = [] holds no number of links"),
        ((Snake,), f"links = None: {Snake!r} is no scene, so its links must be given"),
        ((3, 2), "scene = 3, expected a scene or a kind of scene such as Snake"),
        ((Nameless, 2), "links = 2: free has no number of links to choose"),
    ],
)
def test_bad_input_is_refused_in_one_sentence(arguments: tuple[Any, ...], message: str):
    with pytest.raises(InputError) as error:
        prove(*arguments)
    assert str(error.value) == message


@pytest.mark.parametrize("names", [["nope"], ["au", "nope"], [3]])
def test_an_unknown_formulation_is_refused_with_those_that_exist(names):
    with pytest.raises(UnknownNameError, match=r"^unknown formulation .*; known: im, au, "):
        prove(Snake, 1, formulations=names)


# ---- Scenes of a user's own ----------------------------------------------------------------------


class Belt(MarkedFree):
    """One point on springs, taken along in x by a belt: the constraint depends on nothing else."""

    key = "belt"
    name = "point on a belt"
    conserves_energy = False
    n, r = 2, 1
    constraint_names = ("belt",)

    @staticmethod
    def terms(parameters, angles, q, v):
        a = np.array([[1, 0]], object)
        free = free_terms(parameters, angles, q, v)
        return free._replace(a=a, gamma=np.zeros(1, object), b=-parameters.belt)

    @staticmethod
    def speeds(parameters, angles, kinematics):
        offset = np.array([parameters.belt[0], 0], object)
        return Speeds(np.array([[0], [1]], object), np.zeros(2, object), offset)

    @staticmethod
    def bodies(parameters, angles, kinematics):
        free = MarkedFree.bodies(parameters, angles, kinematics)
        return free._replace(
            partial_velocity=free.partial_velocity[:, :, 1:],
            partial_angular_velocity=free.partial_angular_velocity[:, :, 1:],
            force=kinematics.force[1:],
        )

    @staticmethod
    def speeds_of(parameters, angles, q, v):
        return v[1:]

    @staticmethod
    def constraint(parameters, angles, q, v):
        return v[:1] - parameters.belt


class BeltAlongY(Belt):
    """The belt in y: the first column of a is zero, so that the paper's partition never works."""

    @staticmethod
    def terms(parameters, angles, q, v):
        return Belt.terms(parameters, angles, q, v)._replace(a=np.array([[0, 1]], object))

    @staticmethod
    def speeds(parameters, angles, kinematics):
        offset = np.array([0, parameters.belt[0]], object)
        return Speeds(np.array([[1], [0]], object), np.zeros(2, object), offset)

    @staticmethod
    def bodies(parameters, angles, kinematics):
        free = MarkedFree.bodies(parameters, angles, kinematics)
        return free._replace(
            partial_velocity=free.partial_velocity[:, :, :1],
            partial_angular_velocity=free.partial_angular_velocity[:, :, :1],
            force=kinematics.force[:1],
        )

    @staticmethod
    def speeds_of(parameters, angles, q, v):
        return v[:1]

    @staticmethod
    def constraint(parameters, angles, q, v):
        return v[1:] - parameters.belt


def changed(base: type[Free], name: str, function) -> Scene:
    """Return a scene whose function `name` is `function` of what it was."""
    before = getattr(base, name)
    after = staticmethod(lambda *arguments: function(before(*arguments), *arguments))
    return type("Changed", (base,), {name: after})()


@pytest.mark.parametrize("scene", [MarkedFree(), Belt()], ids=lambda s: s.key)
def test_a_scene_of_ones_own_is_proved(scene: Scene):
    findings = prove(scene, points=2, seed=0)
    assert failed(findings) == []
    claims = {f.claim for f in findings}
    assert {"bias", "generalized-forces", "kinetic-energy", "equivalence"} <= claims
    assert ("constraint-jacobian" in claims) == (scene.r > 0)


WRONG_TERMS = [
    ("Q", lambda x: -x, "generalized-forces", "generalized forces, row x: wrong sign"),
    ("M", lambda x: 2 * x, "mass-matrix", "mass matrix, row x: twice the expected value"),
    ("a", lambda x: -x, "constraint-jacobian", "constraint Jacobian, row belt"),
    ("b", lambda x: -x, "constraint-jacobian", "constraint Jacobian, row belt"),
    ("gamma", lambda x: x + 1, "constraint-drift", "constraint drift, row belt: should vanish"),
]


@pytest.mark.parametrize(("field", "wrong", "claim", "detail"), WRONG_TERMS)
def test_a_wrong_term_of_a_scene_of_ones_own_is_disproved_and_named(field, wrong, claim, detail):
    def replaced(terms: Terms, *_) -> Terms:
        return terms._replace(**{field: wrong(getattr(terms, field))})

    first = failed(prove(changed(Belt, "terms", replaced), points=2, seed=0))[0]
    assert (first.claim, first.detail) == (claim, detail)
    assert (first.observed, first.evidence) == (2.0, "disproved: 2 points")
    assert first.proof is None


def test_wrong_signs_of_speeds_and_bodies_are_disproved_and_named():
    wrong = {
        "speeds": lambda x, *_: x._replace(offset=-x.offset),
        "bodies": lambda x, *_: x._replace(force=-x.force),
    }
    named = {
        name: failed(prove(changed(Belt, name, function), points=1, seed=0))[0]
        for name, function in wrong.items()
    }
    assert (named["speeds"].claim, named["speeds"].subject) == ("speeds-velocity", "a q̇ + b")
    assert named["speeds"].detail == "generalized speeds, row belt: should vanish"
    assert named["bodies"].detail == "generalized active forces, row u_1: wrong sign"


@pytest.mark.parametrize("base", [MarkedFree, Belt])
def test_a_float_in_a_function_is_not_looked_at_and_said_so(base):
    scene = changed(base, "terms", lambda terms, *_: terms._replace(Q=0.5 * terms.Q))
    (finding,) = prove(scene, points=2, seed=0)
    assert (finding.claim, finding.subject) == ("finite-terms", "terms")
    assert finding.verdict == "skipped"
    assert finding.detail.startswith("not rational, in ")
    assert "unsupported operand type(s) for *: 'float'" in finding.detail


def test_a_function_of_a_value_that_is_no_quotient_is_not_looked_at_and_said_so():
    for name in ("sin", "sqrt", "abs"):
        function = getattr(np, name)
        scene = changed(
            MarkedFree, "terms", lambda terms, *_, f=function: terms._replace(Q=f(terms.Q))
        )
        (finding,) = prove(scene, points=1, seed=0)
        assert finding.verdict == finding.evidence == "skipped"
        assert finding.detail.startswith("not rational, in ")


def test_a_power_is_a_product():
    scene = changed(
        MarkedFree,
        "terms",
        lambda t, p, _, q, v: t._replace(Q=t.Q * v**2 / (v * v)),
    )
    assert failed(prove(scene, points=1, seed=0)) == []


@pytest.mark.parametrize(
    "branch",
    [
        lambda p: p.mass[0] == p.mass[0] + p.mass[0] - p.mass[0],
        lambda p: p.mass[0] * 2 != p.mass[0] + p.mass[0],
        lambda p: p.mass[0] * 2 in [p.mass[0] + p.mass[0]],
        lambda p: p.mass[0] - p.mass[0] == 0,
        lambda p: bool(p.mass[0] * 2),
    ],
)
def test_a_branch_on_a_value_is_not_looked_at(branch):
    def branching(terms, parameters, *_):
        return terms._replace(Q=-terms.Q) if branch(parameters) else terms

    (finding,) = prove(changed(MarkedFree, "terms", branching), points=1, seed=0)
    assert finding.verdict == finding.evidence == "skipped"
    assert "a branch on a value" in finding.detail


def test_a_mistake_in_a_call_is_bad_input_and_no_finding():
    scene = changed(MarkedFree, "terms", lambda terms, *_: terms)
    type(scene).energies = staticmethod(lambda parameters, prepared, q: None)
    with pytest.raises(InputError, match=r"Changed: TypeError.*positional argument"):
        prove(scene, points=1, seed=0)


def test_sides_of_different_shapes_are_disproved(monkeypatch):
    monkeypatch.setattr("eomcheck.claims.proof.check_shapes", lambda scene: None)
    scene = changed(Belt, "constraint", lambda c, *_: np.concatenate((c, c)))
    first = failed(prove(scene, points=1, seed=0))[0]
    assert (first.claim, first.verdict) == ("constraint-jacobian", "failed")
    assert first.detail == "constraint Jacobian, shape (1,), expected (2,)"


def test_half_a_velocity_does_not_hide_which_row_is_wrong():
    """v/2 · v along an axis: half of a literal 1 would be no element of the field."""

    def halved(energies, parameters, _, q, v):
        m, (_, U) = parameters.mass[0], energies
        return m * (v[0] / 2 * v[0] + v[1] / 2 * v[1]), U

    assert failed(prove(changed(MarkedFree, "energies", halved), points=1, seed=0)) == []
    base = type(changed(MarkedFree, "energies", halved))
    wrong = changed(base, "terms", lambda t, p, _, q, v: t._replace(B=q[0] * v))
    first = failed(prove(wrong, points=1, seed=0))[0]
    assert (first.claim, first.detail) == ("bias", "bias, row x: should vanish")


# ---- What is singular everywhere -----------------------------------------------------------------


@generic
def wrong_block(M, F, a, gamma, v, partition):
    """Return Au's solution with the lower left block left out."""
    n, r = F.size, gamma.size
    M_Au = np.zeros((n + r, n + r), M.dtype)
    M_Au[:n, :n] = M
    M_Au[:n, n:] = -a.T
    return split(solve(M_Au, np.concatenate((F, gamma)), "M_Au"), a)


def test_a_formulation_that_is_singular_everywhere_is_a_failed_finding_naming_its_matrix():
    wrong = replace(FORMULATIONS["au"], key="wrong", solution=wrong_block)
    findings = prove_structure(Snake.coil(3), (*ALL, wrong), 2, 0)
    (finding,) = failed(findings)
    assert (finding.claim, finding.subject) == ("equivalence", "wrong")
    assert finding.detail == "M_Au is singular at every state"
    right = prove_structure(Snake.coil(3), ALL, 2, 0)
    assert what(findings[1:]) == what(right)
    # Nothing is drawn again for it once it is known, and every draw is charged.
    assert {f.proof.draws for f in findings if f.proof} == {4}
    assert {f.proof.draws for f in right if f.proof} == {2}


def test_a_partition_that_never_works_is_named_and_everything_else_is_proved():
    findings = prove(BeltAlongY(), points=2, seed=0)
    wrong = [f for f in findings if f.verdict == "failed"]
    assert what(wrong) == [("equivalence", f.key) for f in ALL if f.partitioned]
    skipped = [f for f in findings if f.verdict == "skipped"]
    assert what(skipped) == [("null-space-embedding", "em")]
    assert "a_1" in skipped[0].detail
    assert all("singular at every state" in f.detail for f in wrong)
    proved = [f for f in findings if f.verdict == "passed"]
    assert {"constraint-jacobian", "null-space-speeds", "equivalence"} <= {f.claim for f in proved}
    assert [s for c, s in what(proved) if c == "null-space-embedding"] == ["em, drawn"]
    assert all(len(f.proof.primes) == 2 for f in proved if f.proof)


def test_generalized_speeds_that_exist_nowhere_are_a_failed_finding():
    def nowhere(speeds, parameters, _, kinematics):
        zero = parameters.mass[0] - parameters.mass[0]
        return speeds._replace(W=speeds.W / zero)

    (finding,) = prove(changed(MarkedFree, "speeds", nowhere), points=1, seed=0)
    assert (finding.claim, finding.subject) == ("finite-terms", "speeds")
    assert finding.detail.startswith("defined nowhere: ")


def test_a_point_is_drawn_again_where_a_formulation_refuses_by_chance(monkeypatch):
    refused = []
    refusal = GenericPoint.refusal

    def by_chance(self, formulation):
        if not refused:
            refused.append(formulation.key)
            return RefusedOnce()
        return refusal(self, formulation)

    class RefusedOnce(ArithmeticError):
        what = "M_Once"

    monkeypatch.setattr(GenericPoint, "refusal", by_chance)
    findings = prove(Snake.coil(2), points=2, seed=0)
    assert failed(findings) == []
    for finding in findings:
        assert finding.proof is not None
        assert (len(finding.proof.primes), finding.proof.draws) == (2, 3)
