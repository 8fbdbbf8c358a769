"""`check_functions` and `check`: every claim at random states, and what cannot be told."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from eomcheck.claims.finding import Finding, Verdict, diagnose, judge, worst_entry
from eomcheck.claims.registry import Skipped
from eomcheck.errors import InputError, named, some, whole_number
from eomcheck.mechanics.records import State
from eomcheck.numbers.contract import Array
from eomcheck.numbers.pivots import EPS

# In the order in which a failure is closest to its cause.
from eomcheck.testing import of_answers, of_terms, of_energies  # isort: skip
from eomcheck.testing import of_constraints, of_motions, of_reference  # isort: skip
from eomcheck.testing.answers import Answers, BrokenError
from eomcheck.testing.point import Point
from eomcheck.testing.reference import reference_of
from eomcheck.testing.registry import FUNCTION_CLAIMS, FunctionClaim, Outcome, Sides, Told
from eomcheck.testing.subject import INPUTS, Function, Functions, checked_states, functions_of

GATHERED = of_answers, of_terms, of_energies, of_constraints, of_motions, of_reference
"""The files that register claims."""

RANKS: tuple[Verdict, ...] = ("failed", "passed", "inconclusive", "not looked at")
"""Of several states, the verdict that counts is the first of these that there is."""


def check_functions(
    n: int,
    *,
    M: Function | None = None,
    bias: Function | None = None,
    gravity: Function | None = None,
    C: Function | None = None,
    qdd: Function | None = None,
    T: Function | None = None,
    U: Function | None = None,
    R: Function | None = None,
    Q: Function | None = None,
    a: Function | None = None,
    b: Function | None = None,
    c: Function | None = None,
    gamma: Function | None = None,
    qdot: Function | None = None,
    against: Any = None,
    states: int | Iterable[Any] = 20,
    seed: int = 0,
    claims: Iterable[str] | None = None,
    **options: Any,
) -> list[Finding]:
    """Check equations of motion that are given as functions of doubles, as black boxes.

    The convention is M q̈ + bias + gravity + ∂R/∂v = Q + aᵀλ, a v + b = 0, a q̈ + γ = 0. A function
    that is not given stands for a term that is not there. What cannot be told without it is a
    Finding of its own, with the verdict "not looked at", that says which function would tell.

    Args:
        n: number of coordinates.
        M: M(q) -> mass matrix (n, n).
        bias: bias(q, v) -> B (n,), without gravity unless `bias_has_gravity=True` is given.
        gravity: gravity(q) -> ∂U/∂q (n,), on the left-hand side.
        C: C(q, v) -> Coriolis matrix (n, n), C v = B.
        qdd: qdd(q, v) -> acceleration (n,), with everything in it.
        T: T(q, v) -> kinetic energy, J.
        U: U(q) -> potential energy, J.
        R: R(q, v) -> half the power that dampers take, W.
        Q: Q(q, v) -> generalized forces (n,) beside gravity and damping.
        a: a(q) -> constraint Jacobian (r, n).
        b: b(t), or b(q, t) -> constraint velocity (r,).
        c: c(q) -> what vanishes where loops are closed (r,), a = ∂c/∂q; with two arguments
            c(q, v) -> what vanishes where nothing slips, a = ∂c/∂v.
        gamma: gamma(q, v) -> ȧ v + ḃ (r,).
        qdot: qdot(q, u) -> q̇ (n,), where all functions read generalized speeds u for v.
        against: what every quantity is compared with that both have: a scene, an engine made for
            one, (engine or its name, scene), or other `Functions`.
        states: number of random states, or a list of (q (n,), v (n,)).
        seed: of the draws.
        claims: ids of the claims to look at, keys of `FUNCTION_CLAIMS`; all by default.
        options: `bias_has_gravity`, `holonomic`, `ranges`, `speeds`, `name`, `factory`, `array`,
            see `eomcheck.testing.Functions`.

    Returns:
        One Finding per claim and subject, that of the state where it is worst, by the largest error
        per allowed error among failures, or else among what passed.

    Raises:
        InputError: n, states or a range is nothing of the kind, or a function is not callable.
        UnknownNameError: an unknown name of a function, a claim or an engine.
    """
    functions = {
        **{"M": M, "bias": bias, "gravity": gravity, "C": C, "qdd": qdd, "T": T, "U": U, "R": R},
        **{"Q": Q, "a": a, "b": b, "c": c, "gamma": gamma, "qdot": qdot},
    }
    subject = functions_of(n, {**functions, **options})
    return check(subject, states=states, seed=seed, against=against, claims=claims)


def check(
    functions: Functions,
    *,
    states: int | Iterable[Any] = 20,
    seed: int = 0,
    against: Any = None,
    claims: Iterable[str] | None = None,
    holonomic: bool | None = None,
) -> list[Finding]:
    """Return the Findings of `functions`; see `check_functions`.

    Args:
        functions: the functions.
        states, seed, against, claims: see `check_functions`.
        holonomic: in place of what `functions` say of themselves, see `Functions.holonomic`.
    """
    ids = tuple(FUNCTION_CLAIMS if claims is None else some("claims", claims))
    selected = [named("claim", one, FUNCTION_CLAIMS) for one in ids]
    given = (
        states
        if isinstance(states, int | np.integer)
        else list(states)
        if isinstance(states, Iterable)
        else states
    )
    wanted = checked_states(functions, given)
    reference = None if against is None else reference_of(against)
    if reference is not None and (reference.n, reference.p) != (functions.n, functions.p):
        raise InputError(
            f"against has {reference.n} coordinates, expected {functions.n} as the functions have"
        )
    whole_number("seed", seed, 0)
    if holonomic is not None:
        functions = replace(functions, holonomic=holonomic)
    where = drawn(functions, wanted, seed) if isinstance(wanted, int) else list(wanted)
    answers = Answers(functions)
    points = [
        Point(answers, state.q, state.v, seed + k, reference) for k, state in enumerate(where)
    ]
    if reference is not None:
        of_reference.check_reference(points)
    found: list[Finding] = []
    for claim in selected:
        found += worst(functions, claim, points)
        found += untold(functions, claim, points[0])
    return found


def drawn(functions: Functions, count: int, seed: int) -> list[State]:
    """Return random states, evenly spread over the ranges."""
    middle, half = functions.half_ranges()
    rng, n = np.random.default_rng(seed), functions.n
    draws = middle + half * rng.uniform(-1.0, 1.0, (count, len(half)))
    return [State(x[:n], x[n:]) for x in draws]


def worst(functions: Functions, claim: FunctionClaim, points: list[Point]) -> Iterator[Finding]:
    """Yield the worst Finding of each subject of a claim."""
    by_subject: dict[str, list[Finding]] = {}
    for at in points:
        for finding in at_point(functions, claim, at):
            by_subject.setdefault(finding.subject, []).append(finding)
    for findings in by_subject.values():
        yield min(findings, key=lambda f: (RANKS.index(f.verdict), -f.ratio))


def functions_at(
    functions: Functions, state: State, claims: Iterable[str], seed: int = 0
) -> list[Finding]:
    """Return the Findings of some claims at one state; nothing of what cannot be told.

    Args:
        functions: the functions.
        state: coordinates (n,) and velocities (p,).
        claims: ids, keys of `FUNCTION_CLAIMS`.
        seed: of the directions in which noise is measured.
    """
    at = Point(Answers(functions), state.q, state.v, seed)
    return [one for id in claims for one in at_point(functions, FUNCTION_CLAIMS[id], at)]


def at_point(functions: Functions, claim: FunctionClaim, at: Point) -> Iterator[Finding]:
    """Yield the Findings of a claim at a state."""
    state = State(at.q, at.v)
    for outcome in outcomes(claim, at):
        told = decided(claim, outcome)
        yield Finding(
            claim.id,
            told.subject,
            functions,
            state,
            told.observed,
            told.allowed,
            told.verdict,
            "property-tested" if told.verdict != "not looked at" else "not looked at",
            told.detail,
        )


def outcomes(claim: FunctionClaim, at: Point) -> Iterator[Outcome]:
    """Yield what a claim says at a state; nothing where a function that it needs breaks."""
    if not claim.applies(at):
        return
    try:
        with np.errstate(all="ignore"):
            if claim.natural and not at.natural():
                yield Skipped(claim.term, "T has terms that are not quadratic in v")
                return
            here = at.consistent() if claim.consistent else at
            if here is None:
                yield Skipped(claim.term, "no state is found nearby that keeps the constraints")
                return
            yield from claim.look(here)
    except BrokenError as broken:
        if claim.id != "answers":
            # Told by `answers` where it breaks at the state itself.
            yield Skipped(broken.name, f"{broken.name} breaks: {broken.why}")
    except np.linalg.LinAlgError as error:
        yield Skipped(claim.term, f"not computed here: {error}")


def decided(claim: FunctionClaim, outcome: Outcome) -> Told:
    """Return what an outcome comes to."""
    if isinstance(outcome, Skipped):
        return Told(outcome.subject, 0.0, 0.0, "not looked at", outcome.reason)
    return compared(claim, outcome) if isinstance(outcome, Sides) else outcome


def compared(claim: FunctionClaim, sides: Sides) -> Told:
    """Return what two sides come to: the entry that is worst, each judged by its own error."""
    found, expected = sides.found, sides.expected
    error = found.error + expected.error
    size = np.maximum(found.size, expected.size)
    with np.errstate(all="ignore"):
        observed = np.abs(found.value - expected.value)
    judged: list[tuple[int, float, tuple[int, ...], float]] = []
    for index in np.ndindex(observed.shape):
        known = np.isfinite(error[index]) and np.isfinite(observed[index])
        here = float(observed[index]), float(error[index]) / EPS, float(size[index])
        allowed, verdict = judge(*here) if known else (float("inf"), "inconclusive")
        ratio = here[0] / allowed if allowed > 0.0 else (np.inf if here[0] > 0.0 else 0.0)
        judged.append((RANKS.index(verdict), -ratio, index, allowed))
    if not judged:
        return Told(sides.subject, 0.0, 0.0, "passed")
    rank, _, index, allowed = min(judged)
    verdict, detail = RANKS[rank], ""
    if verdict == "failed":
        detail = blamed(claim, sides, index, allowed)
    elif verdict == "inconclusive":
        detail = "what is measured is as uncertain as it is large"
    return Told(sides.subject, float(observed[index]), allowed, verdict, detail)


def blamed(claim: FunctionClaim, sides: Sides, index: tuple[int, ...], allowed: float) -> str:
    """Return the term to blame, the entry, and what is wrong with it."""
    found, expected = sides.found.value, sides.expected.value
    only: Array = np.zeros(found.shape)
    only[index] = 1.0
    term = claim.term or words(sides.subject)
    where = worst_entry(only, sides.names) if found.ndim else "value"
    said = sides.say(found, expected, allowed, index) if sides.say is not None else ""
    return f"{term}, {where}: {said or diagnose(found, expected, allowed, index)}"


def words(subject: str) -> str:
    """Return what a subject is about, in words where it is a function."""
    name = subject.split(" ~ ")[0]
    return INPUTS[name].what if name in INPUTS else name


def untold(functions: Functions, claim: FunctionClaim, at: Point) -> Iterator[Finding]:
    """Yield what cannot be told because an input is missing."""
    if claim.applies(at):
        return
    for blind in claim.blind:
        if blind.derived and not functions.derived:
            continue
        about = not blind.about or at.has(blind.about)
        if about and not any(at.has(name) for name in blind.told_by):
            named_ = [name for name in blind.told_by if name != blind.about]
            would = " or ".join(filter(None, (", ".join(named_[:-1]), named_[-1])))
            detail = f"{blind.what}: {would} would tell"
            about_ = blind.about or functions.name
            said = (claim.id, about_, functions, None, 0.0, 0.0, "not looked at", "not looked at")
            yield Finding(*said, detail)
