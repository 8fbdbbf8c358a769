"""No claim is empty: each fails where what it is about is wrong, and by how much is measured.

`ABOUT` says what each claim is about: parts of scenes and of what formulations, engines and machine
code say. A claim that is not in it, and is no question of yes or no, fails the first test, so that
none can be added without being tested.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack
from dataclasses import replace
from fractions import Fraction
from functools import cache
from typing import Any, ClassVar
from unittest.mock import patch

import flint
import numpy as np
import pytest
from tests.claims.wrong import (
    BITS,
    MANY,
    Entry,
    Part,
    shape_in,
    share,
    with_entry,
    wrong_formulation,
    wrong_scene,
)
from tests.samples import ordinary

import eomcheck
from eomcheck.claims import (
    CLAIMS,
    Case,
    Finding,
    accelerations,
    numerical_accuracy,
    speeds_and_chains,
)
from eomcheck.claims.engine_quantities import CONFORMANCE, acceleration_asked, frames_asked
from eomcheck.claims.finding import entry_name
from eomcheck.claims.numerical_accuracy import (
    ENOUGH,
    MAY_REFUSE,
    SampledState,
    coverage,
    independent_rcond,
)
from eomcheck.claims.proof import identities_at, prove_structure
from eomcheck.claims.registry import Claim, Comparison, GenericPoint, Skipped, names_of_term
from eomcheck.descriptions.tree_model import MAKERS, TreeModel
from eomcheck.engines import ALWAYS, ENGINES, Engine
from eomcheck.errors import RefusedError
from eomcheck.evaluation.conformance import QUANTITIES, ConformancePoint
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import largest
from eomcheck.formulations import FORMULATIONS
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.ball import precision
from eomcheck.numbers.finite_field import FiniteField, random_prime
from eomcheck.numbers.generic import generic
from eomcheck.scenes import SCENES, Snake

SNAKE = Snake([1, 2], [1, 0.5], [0.1, 0.2], [3], [0.1, -0.2])
Q = np.array([0.3, -0.2, 0.3, 0.9])
MOVING = State(Q, eomcheck.velocity(SNAKE, Q, [1.0, 0.5]))


def moving() -> Evaluation:
    """Return a new evaluation of the snake in motion."""
    return Evaluation(SNAKE, MOVING.q, MOVING.v)


@cache
def sample(key: str) -> tuple[Scene, State]:
    """Return a scene of a kind in motion."""
    return (SNAKE, MOVING) if key == "snake" else ordinary(SCENES[key])


# ---- What claims are about -----------------------------------------------------------------------

# x_3, how fast the second body moves along, follows from the others.
NOT_ALONG = (0,), (1,), (3,)
RATES = tuple(Part(key, 0, NOT_ALONG if key == "banded" else None) for key in FORMULATIONS)
IN_VELOCITIES = tuple(part for part in RATES if not FORMULATIONS[part.of].in_speeds)
MULTIPLIERS = tuple(Part(key, 1) for key, f in FORMULATIONS.items() if f.multipliers)
M, FORCES, B, JACOBIAN, DRIFT, MOVED = (
    Part("terms", name) for name in ("M", "Q", "B", "a", "gamma", "b")
)
W, REST, OFFSET = (Part("speeds", name) for name in ("W", "rest", "offset"))
T, U = (Part("energies", i, relative=True) for i in (0, 1))
CONSTRAINT = Part("constraint")
GRADIENT = replace(CONSTRAINT, relative=True)
"""Of the constraint; a constant has none."""
VELOCITIES, POSITIONS, RESIDUAL = (
    Part("velocities", 0, relative=True),
    Part("positions", relative=True),
    Part("position_residual", relative=True),
)
PARTIAL, TURNING, REMAINDER, SWING, GYROSCOPIC, ACTIVE, MASS = (
    Part("bodies", name)
    for name in (
        "partial_velocity",
        "partial_angular_velocity",
        "remainder",
        "angular_remainder",
        "gyroscopic",
        "force",
        "mass",
    )
)
CHAIN_MASS, CHAIN_FORCE, BEFORE, AFTER, CHAIN_REST = (
    Part("chain", name) for name in ("mass", "force", "before", "after", "rest")
)
QUASI, OF_QUASI = Part("quasi_velocities"), Part("chain_velocity")
TURNS = (1,), (3,)
"""Where x is a rate of turning."""
EMBEDDING = Part("w of the embedding method", "", ((0, 0), (0, 1), (1, 0), (1, 1)), relative=True)
ENGINE_RATES = Part("casadi", "vdot", relative=True), Part("pinocchio", "vdot", relative=True)
MACHINE_CODE = Part("machine code", relative=True)
ENGINE_MULTIPLIERS = (
    Part("casadi", "multipliers", relative=True),
    Part("pinocchio", "multipliers", relative=True),
)


def tree_parts(function: str, *names: str) -> tuple[Part, ...]:
    """Return parts of the result of a function of the tree of bodies, by their names."""
    return tuple(Part(function, name, relative=True) for name in names)


def engine_parts(quantity: str) -> tuple[Part, ...]:
    """Return the parts of the answer of an engine about a quantity."""
    parts = {
        "frame_placement": (0, 1),
        "inverse_dynamics_derivatives": (0, 1),
        "forward_dynamics_derivatives": (0, 1, 2),
        "constraint_force_derivatives": (0, 1),
    }.get(quantity, ("",))
    library = "pinocchio" if ENGINES["pinocchio"].offers(quantity) else "casadi"
    return tuple(Part(f"{library}.{quantity}", part, relative=True) for part in parts)


ABOUT: dict[str, dict[str, tuple[Part, ...]]] = {
    "mass-matrix": {"snake": (M, T)},
    "bias": {"snake": (B, T), "turntable-ball": (B,)},
    "generalized-forces": {"snake": (FORCES, U), "bricard": (FORCES,)},
    "constraint-jacobian": {"snake": (JACOBIAN, GRADIENT), "bricard": (JACOBIAN,)},
    "constraint-velocity": {
        "snake": (JACOBIAN, CONSTRAINT),
        "turntable-ball": (JACOBIAN, MOVED, CONSTRAINT),
    },
    "position-rate": {"four-bar-chain": (JACOBIAN, RESIDUAL)},
    "constraint-drift": {"snake": (DRIFT, GRADIENT), "turntable-ball": (DRIFT,)},
    "kinetic-energy": {"snake": (M, T)},
    "position-velocity": {"sleigh": (POSITIONS, VELOCITIES)},
    "height-velocity": {"rolling-disk": (U,)},
    "moved-energy": {"sleigh": (VELOCITIES,)},
    "null-space-embedding": {"snake": (EMBEDDING,)},
    "null-space-speeds": {"snake": (W, JACOBIAN)},
    "speeds-velocity": {"snake": (W, Part("speeds_of"), Part("qdot")), "turntable-ball": (OFFSET,)},
    "speeds-remainder": {"snake": (REST, DRIFT), "turntable-ball": (REST, DRIFT)},
    # Springs act on the angles alone.
    "active-forces": {"snake": (ACTIVE, FORCES, replace(W, entries=((2, 0), (3, 1))))},
    "kane-ml-mass": {"snake": (MASS, PARTIAL, TURNING, M, W)},
    "kane-ml-force": {
        "snake": (REMAINDER, ACTIVE, B, REST),
        "rolling-disk": (GYROSCOPIC, SWING),
    },
    "kane-n-matrix": {
        # The first body has no remainder.
        "snake": (REMAINDER, replace(MASS, entries=((1,),)), VELOCITIES),
        "rolling-disk": (GYROSCOPIC, SWING),
    },
    "chain-velocity": {"snake": (OF_QUASI, replace(QUASI, entries=NOT_ALONG))},
    "chain-energy": {"snake": (CHAIN_MASS, QUASI, T)},
    "chain-forces": {"snake": (CHAIN_FORCE, FORCES, replace(QUASI, entries=TURNS))},
    "chain-coupling": {"snake": (BEFORE, AFTER, QUASI)},
    "chain-remainder": {"snake": (CHAIN_REST,)},
    "chain-acceleration": {"snake": (Part("chain_acceleration"),)},
    "equations-residual": {"snake": (*RATES, *MULTIPLIERS)},
    # Those in speeds satisfy the constraints by their remainder, whatever u̇ is.
    "constraint-acceleration": {"snake": (*IN_VELOCITIES, REST)},
    "equivalence": {"snake": RATES},
    "multipliers": {"snake": MULTIPLIERS},
    # An error that is there with the row more and without it is one of other claims.
    "redundant-rows": {"snake": (Part("uk", 1),), "bricard": (Part("uk", 1),)},
    "engine-acceleration": {"snake": (*RATES, *ENGINE_RATES)},
    "engine-multipliers": {"snake": (*MULTIPLIERS, *ENGINE_MULTIPLIERS)},
    "machine-code": {"snake": (MACHINE_CODE,)},
    "power-balance": {"snake": (*RATES, T)},
    # An error in u̇_1, the speed ahead, moves with the scene.
    "invariance": {"snake": (FORCES, B, replace(ACTIVE, entries=((1,),)))},
    "derivatives": {"snake": (*RATES, *MULTIPLIERS)},
    "true-error": {"snake": RATES},
    "center-of-mass-rates": {
        "chain-pendulum": tree_parts(
            "center_of_mass", "position", "jacobian", "velocity", "acceleration"
        ),
    },
    "momentum-rates": {
        "chain-pendulum": tree_parts("momentum", "momentum", "matrix", "rate"),
        "bricard": tree_parts("momentum", "rate"),
    },
    "frame-rates": {
        # The first link is the ground.
        "chain-pendulum": tuple(
            Part("link_motions", name, entries, relative=True)
            for name, entries in {
                "R": ((2, 0, 0), (3, 1, 0)),
                "p": ((2, 0), (3, 1)),
                "jacobian": ((2, 0, 0), (3, 1, 1), (2, 5, 1)),
                "velocity": ((2, 0), (3, 5)),
                "acceleration": ((2, 0), (3, 5)),
                "bias": ((2, 0), (3, 1)),
            }.items()
        ),
        "bricard": (Part("link_motions", "jacobian", ((2, 0, 0), (3, 4, 1)), relative=True),),
    },
    "weight-gradient": {"chain-pendulum": tree_parts("weight", "U", "gradient")},
    "coriolis-identities": {
        "chain-pendulum": (Part("coriolis_matrix", relative=True),),
        "bricard": (Part("coriolis_matrix", relative=True),),
    },
    "regressor-identity": {
        "chain-pendulum": (
            # Some parameters are 0; the origin of the first link is at rest.
            Part("regressor", "Y", ((0, 10), (1, 11), (2, 21), (2, 29)), relative=True),
            Part("regressor", "parameters", ((1,), (9,), (10,), (11,)), relative=True),
            Part("inverse_dynamics", relative=True),
        ),
        "bricard": (Part("regressor", "Y", ((0, 12), (0, 20), (1, 23)), relative=True),),
    },
    **{
        claim: {"bricard": engine_parts(quantity)}
        for claim, quantity in zip(CONFORMANCE, QUANTITIES, strict=True)
    },
}

YES_OR_NO = {"finite-terms", "enclosures", "refusals", "coverage"}
"""Claims without a tolerance."""


def test_of_every_claim_it_is_said_what_it_is_about():
    assert ABOUT.keys() | YES_OR_NO == CLAIMS.keys()
    assert not ABOUT.keys() & YES_OR_NO
    assert all(parts for about in ABOUT.values() for parts in about.values())


def test_claims_about_accelerations_are_about_those_of_every_formulation():
    solved = {
        claim for claim in ABOUT if CLAIMS[claim].term == "acceleration" and claim != "enclosures"
    }
    for claim in solved | {"equations-residual", "power-balance", "true-error"}:
        assert set(RATES) <= {part for parts in ABOUT[claim].values() for part in parts}


# ---- In doubles ----------------------------------------------------------------------------------


def wrong_result(function: Callable, part: Part, entry: Entry, k: int) -> Callable:
    """Return `function` with one number wrong in what it returns, by a share of itself."""

    def error_of(x: Any) -> Any:
        # A quotient of literals would be a double.
        return x * k // 2**BITS if isinstance(x, int) else x * k / 2**BITS

    def changed(*arguments: Any) -> Any:
        returned = function(*arguments)
        value = with_entry(part.take(returned), entry, lambda x: x + error_of(x))
        return part.put(returned, value)

    return changed


def library(part: Part) -> str:
    """Return the key of the engine whose answer a part belongs to."""
    return part.of.partition(".")[0]


def wrong_tree_function(part: Part, entry: Entry, k: int) -> AbstractContextManager:
    """Return the context in which a function of trees of bodies returns one wrong number."""
    right = TreeModel.function

    @cache
    def wrong(function: Callable) -> Callable:
        @generic
        def changed(parameters, *arguments):
            returned = function(parameters, *arguments)
            share = parameters.mass[0] * k / 2**BITS
            value = with_entry(part.take(returned), entry, lambda x: x + x * share)
            return part.put(returned, value)

        return changed

    def function_of(model: TreeModel, name: str) -> Callable:
        function = right(model, name)
        return wrong(function) if name == part.of else function

    return patch.object(TreeModel, "function", function_of)


def is_ball(x: Any) -> bool:
    return isinstance(x, flint.arb)


def engines_for(scene: Scene) -> tuple[Engine, ...]:
    kinds = (ENGINES[key] for key in ALWAYS)
    return tuple(kind(scene) for kind in kinds if kind.represents(scene))


def findings(claim: str, key: str, part: Part, entry: Entry, k: int) -> list[Finding]:
    """Look at a claim where one number is wrong."""
    scene, state = sample(key)
    with ExitStack() as stack:
        if part.of in FORMULATIONS:
            # The truth is enclosed by the same functions.
            enclosed = claim == "true-error"
            wrong = wrong_formulation(part, entry, k, lambda x: not (enclosed and is_ball(x)))
            stack.enter_context(patch.dict(FORMULATIONS, {part.of: wrong}))
        elif part == MACHINE_CODE:
            name = "acceleration_in_machine_code"
            changed = wrong_result(getattr(accelerations, name), part, entry, k)
            stack.enter_context(patch.object(accelerations, name, changed))
        elif part == EMBEDDING:
            changed = wrong_result(speeds_and_chains.embedding_null_space, part, entry, k)
            stack.enter_context(patch.object(speeds_and_chains, "embedding_null_space", changed))
        elif part.of in MAKERS:
            stack.enter_context(wrong_tree_function(part, entry, k))
        elif library(part) not in ENGINES:
            scene = wrong_scene(scene, part, entry, k)
        engines = engines_for(scene)
        for engine in engines:
            if engine.key == library(part):
                method = part.of.partition(".")[2] or "acceleration"
                changed = wrong_result(getattr(engine, method), part, entry, k)
                stack.enter_context(patch.object(engine, method, changed))
        formulations = tuple(f for f in FORMULATIONS.values() if f.applies_to(scene))
        return Case(Evaluation(scene, *state), formulations, engines).evaluate(CLAIMS[claim])


def worst(found: list[Finding]) -> Finding:
    return max((f for f in found if f.verdict != "inconclusive"), key=lambda f: f.ratio)


def shape_of(key: str, part: Part) -> tuple[int, ...]:
    scene, state = sample(key)
    at = Evaluation(scene, *state)
    if part.of in ENGINES or part == MACHINE_CODE:
        return (scene.r if part.name == "multipliers" else scene.n,)
    if part.of in MAKERS or "." in part.of:
        return np.shape(value_of(at, part))
    if part == EMBEDDING:
        return scene.n, scene.p
    return shape_in(at, part)


def value_of(at: Evaluation, part: Part) -> Any:
    """Return a quantity of the tree of bodies, or an engine's answer about it."""
    vdot = acceleration_asked(at)
    point = ConformancePoint(at, vdot)
    if part.of in MAKERS:
        return part.take(point.result(part.of))
    one = QUANTITIES[part.of.partition(".")[2]]
    frame = frames_asked(at, point)[0] if one.of_frame else ""
    third = point.torques if "tau" in one.arguments else vdot
    (engine,) = (one for one in engines_for(at.scene) if one.key == library(part))
    x, S, _ = engine.velocity_map(at.q, at.v)
    values = {"f": frame, "q": x, "v": S @ at.v, "vdot": third, "tau": third}
    return part.take(getattr(engine, one.name)(*(values[name] for name in one.arguments)))


def entries_of(key: str, part: Part) -> Iterator[Entry]:
    """Yield the entries that are to be wrong in turn; of shares no small ones."""
    entries = part.each_entry(shape_of(key, part))
    if part.of not in MAKERS and "." not in part.of:
        yield from entries
        return
    scene, state = sample(key)
    value = np.asarray(value_of(Evaluation(scene, *state), part))
    yield from (entry for entry in entries if abs(value[entry]) > largest(value) / 1000)


cases = pytest.mark.parametrize(
    ("claim", "key", "part"),
    [
        pytest.param(claim, key, part, id=f"{claim}, {key}, {part}")
        for claim, about in ABOUT.items()
        for key, parts in about.items()
        for part in parts
    ],
)

SLIGHT = 2.0**-30
"""An error of 1e-9: no tolerance may be so wide at an ordinary state."""


@pytest.mark.parametrize(
    ("claim", "key"), [(c, key) for c, about in ABOUT.items() for key in about]
)
@pytest.mark.sampled(2)
def test_where_nothing_is_wrong_no_claim_fails_and_some_finding_passes(claim: str, key: str):
    found = findings(claim, key, Part("terms", "M"), (0, 0), 0)
    assert {f.verdict for f in found} == {"passed"}
    assert worst(found).ratio < 0.1


@pytest.mark.sampled(12)
@cases
def test_a_claim_fails_where_any_number_that_it_is_about_is_slightly_wrong(claim, key, part):
    for entry in entries_of(key, part):
        found = findings(claim, key, part, entry, share(SLIGHT))
        assert worst(found).verdict == "failed", (entry, str(worst(found)))
        assert all(f.claim == claim for f in found)


@pytest.mark.sampled(10)
@cases
def test_ten_times_the_allowed_error_fails_and_a_tenth_passes(claim, key, part):
    entry = next(entries_of(key, part))
    slight = worst(findings(claim, key, part, entry, share(SLIGHT)))
    as_allowed = SLIGHT / slight.ratio
    at_ten = {f.subject: f for f in findings(claim, key, part, entry, share(10 * as_allowed))}
    assert at_ten[slight.subject].verdict == "failed"
    at_a_tenth = findings(claim, key, part, entry, share(as_allowed / 10))
    assert {f.verdict for f in at_a_tenth} == {"passed"}
    assert at_ten[slight.subject].ratio == pytest.approx(10, rel=0.2)


# ---- Every row of every side ---------------------------------------------------------------------


class Shifted(Case):
    """A case in which each number found is wrong in turn, by a multiple of what is allowed."""

    by: ClassVar[float]
    judged: ClassVar[list[tuple[str, Finding]]]

    def compare(self, subject: str, actual: Any, expected: Any, sensitivity: float, **options: Any):
        actual = np.asarray(actual, np.float64)
        right = super().compare(subject, actual, expected, sensitivity, **options)
        for entry in np.ndindex(actual.shape):
            wrong = actual.copy()
            wrong[entry] = np.asarray(expected, np.float64)[entry] + self.by * right.allowed
            name = entry_name(entry, options["names"])
            finding = super().compare(subject, wrong, expected, sensitivity, **options)
            self.judged.append((name, finding))
        return right


def shifted(claim: str, key: str, by: float) -> list[tuple[str, Finding]]:
    """Return what is found with every number wrong in turn, and the name of that number."""
    scene, state = sample(key)
    engines = engines_for(scene)
    formulations = tuple(f for f in FORMULATIONS.values() if f.applies_to(scene))
    kind = type("Shifted", (Shifted,), {"by": by, "judged": []})
    case = kind(Evaluation(scene, *state), formulations, engines)
    with patch.object(numerical_accuracy, "Case", kind):
        case.evaluate(CLAIMS[claim])
    return kind.judged


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("claim", "key"), [(c, key) for c, about in ABOUT.items() for key in about]
)
def test_an_error_in_any_row_is_judged_by_its_size_and_named_by_its_row(claim: str, key: str):
    # Links on the ground do not move at all: nothing is allowed about them.
    failed = [pair for pair in shifted(claim, key, 10.0) if pair[1].allowed]
    assert failed
    for name, finding in failed:
        assert finding.verdict == "failed", str(finding)
        assert f"{name}:" in f"{finding.detail}:", str(finding)
    assert {f.verdict for _, f in shifted(claim, key, 0.1)} == {"passed"}


# ---- In a finite field ---------------------------------------------------------------------------

PROVED = [
    (claim, key, part)
    for claim, about in ABOUT.items()
    if CLAIMS[claim].proved
    for key, parts in about.items()
    for part in parts
    # In a proof a stands beside the constraints in a claim of its own.
    if (claim, part) != ("position-rate", JACOBIAN)
]


def test_every_identity_is_disproved_somewhere_below():
    assert {claim for claim, _, _ in PROVED} == {id for id in CLAIMS if CLAIMS[id].proved}


@pytest.mark.night
@pytest.mark.parametrize(
    ("claim", "key", "part"),
    [pytest.param(*case, id=", ".join(map(str, case))) for case in PROVED],
)
def test_an_identity_is_disproved_where_any_number_that_it_is_about_is_wrong(claim, key, part):
    for entry in entries_of(key, part):
        (scene, _), twice = sample(key), 2**BITS
        with ExitStack() as stack:
            if part.of in FORMULATIONS:
                wrong = {part.of: wrong_formulation(part, entry, twice)}
                stack.enter_context(patch.dict(FORMULATIONS, wrong))
            elif part == EMBEDDING:
                changed = wrong_result(speeds_and_chains.embedding_null_space, part, entry, twice)
                stack.enter_context(
                    patch.object(speeds_and_chains, "embedding_null_space", changed)
                )
            elif part.of in MAKERS:
                stack.enter_context(wrong_tree_function(part, entry, twice))
            else:
                scene = wrong_scene(scene, part, entry, twice)
            formulations = tuple(f for f in FORMULATIONS.values() if f.applies_to(scene))
            found = prove_structure(scene, formulations, 1, 0)
        assert "failed" in {f.verdict for f in found if f.claim == claim}, entry


@pytest.mark.night
@pytest.mark.parametrize("claim", [id for id in CLAIMS if CLAIMS[id].proved])
def test_an_identity_is_disproved_by_any_row_of_its_sides_and_named_by_that_row(claim: str):
    key = next(iter(ABOUT[claim]))
    (scene, _), right = sample(key), CLAIMS[claim]
    formulations = tuple(f for f in FORMULATIONS.values() if f.applies_to(scene))
    sides = [
        found
        for key, found in identities_at(point(scene), right)
        if key[0] == claim and isinstance(found, Comparison)
    ]
    assert sides
    for one in sides:
        axes = tuple(map(len, one.names))
        assert axes == np.shape(one.actual) == np.shape(one.expected)
        for entry in list(np.ndindex(axes))[:MANY]:
            with patch.dict(CLAIMS, {claim: replace(right, sides=off_by_one(right, one, entry))}):
                found = prove_structure(scene, formulations, 1, 0)
            (failure,) = [f for f in found if f.claim == claim and f.verdict == "failed"]
            assert failure.subject == one.subject
            name = entry_name(entry, one.names)
            if name == "row any direction":
                name = f"row {scene.coordinate_names[0]}"  # looked at along the axes then
            assert f"{name}:" in f"{failure.detail}:"


def point(scene: Scene) -> GenericPoint:
    source = random.Random(0)
    field = FiniteField(random_prime(source), source)
    formulations = tuple(f for f in FORMULATIONS.values() if f.applies_to(scene))
    return GenericPoint(scene, field, formulations)


def off_by_one(claim: Claim, which: Comparison, entry: Entry) -> Callable:
    """Return the sides of a claim, one number of one of them too large by 1."""

    assert claim.sides is not None
    right = claim.sides

    def changed(at: Any, look: Any) -> Iterator[Comparison | Skipped]:
        for one in right(at, look):
            if isinstance(one, Comparison) and one.subject == which.subject:
                one = one._replace(actual=with_entry(one.actual, entry, lambda x: x + 1))
            yield one

    return changed


# ---- Yes or no -----------------------------------------------------------------------------------


@pytest.mark.parametrize("part", [M, FORCES, B, JACOBIAN, DRIFT], ids=str)
def test_a_term_with_an_entry_that_is_not_finite_is_named(part: Part):
    for entry in part.each_entry(shape_of("snake", part)):
        at = moving()
        at.terms = part.put(at.terms, with_entry(part.take(at.terms), entry, lambda _: np.nan))
        found = Case(at, (), ()).evaluate(CLAIMS["finite-terms"])
        (failure,) = [f for f in found if f.verdict == "failed"]
        assert failure.subject == part.name
        place = entry_name(entry, names_of_term(SNAKE, str(part.name)))
        assert failure.detail.startswith(f"term that is not finite, {place}")


def test_what_overflows_in_a_huge_state_is_no_term_that_is_not_finite():
    at = Evaluation(SNAKE, Q, 1e200 * MOVING.v)
    assert not np.isfinite(at.terms.B).all()
    found = Case(at, (), ()).evaluate(CLAIMS["finite-terms"])
    assert {f.verdict for f in found} == {"passed"}


@pytest.mark.parametrize("part", RATES, ids=str)
def test_enclosures_that_are_wrong_in_the_tenth_digit_are_disjoint(part: Part):
    wrong = wrong_formulation(part, (0,), share(1e-10), where=is_ball)
    formulations = tuple((FORMULATIONS | {part.of: wrong}).values())
    found = Case(moving(), formulations, ()).evaluate(CLAIMS["enclosures"])
    assert len(found) == math.comb(len(FORMULATIONS), 2)
    apart = {f.subject for f in found if f.verdict == "failed"}
    assert apart == {f.subject for f in found if part.of in f.subject.split(" ~ ")}


@pytest.mark.parametrize(("by", "verdict"), [(10, "failed"), (Fraction(1, 10), "passed")])
def test_enclosures_ten_radii_apart_are_disjoint_and_a_tenth_of_a_radius_they_are_not(by, verdict):
    au = eomcheck.enclose(SNAKE, "au", Q, [1.0, 0.5])

    def of_au(case: Case, formulation: Any, known: Any) -> Any:
        apart = au.vdot.copy()
        if formulation.key == "kane":
            with precision(400):
                apart[1] = apart[1] + flint.arb(apart[1].rad()) * by.numerator / by.denominator
        return replace(au, vdot=apart)

    formulations = FORMULATIONS["au"], FORMULATIONS["kane"]
    with patch.object(numerical_accuracy, "_enclose", of_au):
        found = Case(moving(), formulations, ()).evaluate(CLAIMS["enclosures"])
    (finding,) = found
    assert finding.verdict == verdict
    assert ("row y" in finding.detail) == (verdict == "failed")


@pytest.mark.parametrize("key", FORMULATIONS)
@pytest.mark.parametrize(("times", "verdict"), [(10.0, "failed"), (0.1, "passed")])
def test_a_refusal_is_justified_below_its_threshold_only(key: str, times: float, verdict: str):
    """The threshold of the refusal is set to a tenth, or to ten times, of what is found."""
    at, f = moving(), FORMULATIONS[key]
    rcond = independent_rcond(f, RefusedError("M", 0.0, 0.0, "refused"), Case(at, (f,), ()))
    assert 1e-6 < rcond < 1
    refusal = RefusedError("M", 0.0, rcond / times, "refused")
    at._solutions[key, False] = refusal
    (finding,) = Case(at, (f,), ()).evaluate(CLAIMS["refusals"])
    assert (finding.verdict, finding.subject) == (verdict, key)
    assert finding.observed == pytest.approx(times * finding.allowed)


@pytest.mark.parametrize(
    ("states", "refusing", "verdict"),
    [
        (200, 1, "passed"),
        (200, 10, "passed"),
        (200, 11, "failed"),
        (200, 100, "failed"),
        (ENOUGH, 1, "passed"),
        (ENOUGH, 2, "failed"),
        (ENOUGH - 1, 19, "inconclusive"),
    ],
)
def test_coverage_fails_above_one_state_in_twenty(states: int, refusing: int, verdict: str):
    assert MAY_REFUSE == 1 / 20
    drawn = [SampledState(SNAKE, MOVING, ("em",) if i < refusing else ()) for i in range(states)]
    finding = coverage(drawn)
    assert finding.verdict == verdict
    assert finding.observed == refusing / states
    assert f"em refused {refusing}" in finding.detail
