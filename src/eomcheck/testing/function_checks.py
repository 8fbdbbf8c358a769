"""`check_functions` and `check`: every claim about user-supplied functions at random states.

A claim compares two ways to compute one quantity from float64 functions that are black boxes. Both
sides carry their error (`UncertainArray`), measured from outside, so that each entry is judged by
its own allowed error: passed, failed, or inconclusive where the error is as large as the value. An
entry that is resolved in no state is reported by name, and so is a blind spot: a fault that no
claim can show because an input is missing.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from eomcheck import deprecated
from eomcheck.claims.confusions import NO_CONTEXT, locate
from eomcheck.claims.finding import (
    INCONCLUSIVE_CODE,
    PASSED_CODE,
    VERDICTS,
    Entries,
    Finding,
    Unresolved,
    Verdict,
    entries_of,
    entry_name,
    never_resolved,
    skipped_everywhere,
    unresolved_finding,
    verdict_codes,
    worst,
)
from eomcheck.claims.findings import Findings
from eomcheck.claims.registry import (
    FUNCTION_CLAIMS,
    ClaimOutput,
    Comparison,
    Decision,
    FunctionClaim,
    Skipped,
)
from eomcheck.console import polled_progress
from eomcheck.errors import InputError, safe_repr, whole_number
from eomcheck.evaluation.tolerance import INCONCLUSIVE, C, allowed_error
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import EPS, Array
from eomcheck.safe_output import counted

from eomcheck.testing import claims_answers, claims_terms  # isort: skip
from eomcheck.testing import claims_motions, claims_derivatives, claims_kinematics  # isort: skip
from eomcheck.testing.converters import as_equations, reference_functions
from eomcheck.testing.equations_of_files import read_equations
from eomcheck.testing.equations_of_motion import (
    INPUTS,
    BrokenError,
    ComparedEquations,
    EquationsOfMotion,
    Function,
    FunctionCaller,
    checked_states,
    equations_from,
)
from eomcheck.testing.fault_localization import localize_faults
from eomcheck.testing.function_state import NOT_QUADRATIC, FunctionState
from eomcheck.testing.uncertain import NEAR

# In the order in which a failure is closest to its cause.

GATHERED = claims_answers, claims_terms, claims_motions, claims_derivatives, claims_kinematics
"""Modules that register claims."""

LAST = "answers-repeat", "arguments-unchanged"
"""Claims that are checked last, in this order: they are about all calls of a run."""

WIDE = 3
"""Number of states outside the default ranges, beside the requested ones."""


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
) -> Findings:
    """Check equations of motion that are given as float64 functions, as black boxes.

    The convention is M q̈ + bias + gravity + ∂R/∂v = Q + aᵀλ, a v + b = 0, a q̈ + γ = 0. A function
    that is not given stands for a term that is zero. A fault that cannot be detected without it is
    reported in a Finding of its own, with the verdict "skipped", that names the missing functions.

    Args:
        n: number of coordinates.
        M: M(q) -> mass matrix (n, n).
        bias: bias(q, v) -> B (n,), without gravity unless `bias_has_gravity=True` is given.
        gravity: gravity(q) -> ∂U/∂q (n,), on the left-hand side.
        C: C(q, v) -> Coriolis matrix (n, n), C v = B and Ṁ - 2 C skew-symmetric.
        qdd: qdd(q, v) -> acceleration (n,), with everything in it.
        T: T(q, v) -> kinetic energy, J.
        U: U(q) -> potential energy, J.
        R: R(q, v) -> half the power that dampers take, W.
        Q: Q(q, v) -> generalized forces (n,) beside gravity and damping.
        a: a(q) -> constraint Jacobian (r, n).
        b: b(t), or b(q, t) -> constraint velocity (r,).
        c: c(q) -> loop-closure residual (r,), 0 where loops are closed, a = ∂c/∂q; with two
            arguments c(q, v) -> slip velocity (r,), 0 where nothing slips, a = ∂c/∂v.
        gamma: gamma(q, v) -> ȧ v + ḃ (r,).
        qdot: qdot(q, u) -> q̇ (n,), where all functions read generalized speeds u for v.
        options: further functions, about derivatives of the dynamics, inverse dynamics, regressors,
            center of mass, momentum and frames, as listed in `eomcheck.testing.EquationsOfMotion`:
            `qdd_q`, `qdd_v`, `qdd_tau`, `inverse_dynamics`, `tau_q`, `tau_v`, `regressor`, `com`,
            `momentum`, `J` and others; and `bias_has_gravity`, `coriolis_skew`, `holonomic`,
            `ranges`, `speeds`, `name`, `factory`, `array`.
        against: reference, with which every quantity is compared that both have: a scene, an engine
            made for one, (engine or its name, scene), or other `EquationsOfMotion`.
        states: number of random states, or a list of (q (n,), v (n,)).
        seed: seed of the random states.
        claims: ids of the claims to check, keys of `FUNCTION_CLAIMS`; all by default.

    Returns:
        One Finding per claim and subject, printed as a summary: that of the worst state, by the
        largest error per allowed error among failures, or else among comparisons that passed.

    Raises:
        InputError: n, states or a range is not valid, or a function is not callable.
        UnknownNameError: an unknown name of a function, a claim or an engine.
    """
    functions = {
        **{"M": M, "bias": bias, "gravity": gravity, "C": C, "qdd": qdd, "T": T, "U": U, "R": R},
        **{"Q": Q, "a": a, "b": b, "c": c, "gamma": gamma, "qdot": qdot},
    }
    subject = equations_from(n, {**functions, **options})
    return check_equations(subject, states=states, seed=seed, against=against, claims=claims)


def check(
    subject: Any,
    *state: Any,
    parameters: Mapping[Any, float] | None = None,
    states: int | Iterable[Any] = 20,
    seed: int = 0,
    against: Any = None,
    claims: Iterable[str] | None = None,
    holonomic: bool | None = None,
    **older: Any,
) -> Findings:
    """Check equations of motion: functions, a SymPy model, or either of them in a file.

    Args:
        subject: `EquationsOfMotion`; a SymPy `KanesMethod` or `LagrangesMethod`; or the name
            "FILE.py", "FILE.py:NAME" or "package.module:NAME" of a file with such an object or with
            functions, see `eomcheck.testing.equations_of_files.read_equations`.
        state: none; in 0.2 this function checked one state (q, v, t) of a scene, which is
            `eomcheck.check_state` now, and still does so, with a warning.
        parameters: symbol -> number, for a SymPy model.
        states, seed, against, claims: see `check_functions`.
        holonomic: in place of the attribute of the functions, see `EquationsOfMotion.holonomic`.
        older: further keywords of `eomcheck.check_state`.

    Returns:
        One Finding per claim and subject, see `check_functions`.

    Raises:
        InputError: `subject` is none of these, and what `check_functions` raises.
        UnknownNameError: see `check_functions`.

    Example:
        >>> import eomcheck
        >>> from eomcheck.testing import EquationsOfMotion
        >>> rod = EquationsOfMotion(1, M=lambda q: [[2.0]], bias=lambda q, v: [v[0] ** 2])
        >>> sorted({one.claim for one in eomcheck.check(rod) if one.verdict == "failed"})
        ['bias-of-mass-matrix', 'bias-power']
    """
    if isinstance(subject, Scene) and (state or older):
        # Not at the top: hypothesis is loaded with it, which functions do not need.
        from eomcheck.claims.run import check_state

        deprecated.warn("eomcheck.check(scene, q, v)", "eomcheck.check_state(scene, q, v)")
        return check_state(subject, *state, claims=claims, **older)
    if len(state) == 1 and isinstance(state[0], Mapping):
        raise InputError(f"numbers of a SymPy model are parameters={safe_repr(state[0])}")
    if state or older:
        more = ", ".join([*map(safe_repr, state), *older])
        raise InputError(f"arguments {more}: of a scene alone, not of equations of motion")
    if isinstance(subject, str):
        functions = read_equations(subject, None, parameters, seed).equations
    else:
        functions = as_equations(subject, parameters)
    return check_equations(
        functions, states=states, seed=seed, against=against, claims=claims, holonomic=holonomic
    )


def check_equations(
    functions: EquationsOfMotion,
    *,
    states: int | Iterable[Any] = 20,
    seed: int = 0,
    against: Any = None,
    claims: Iterable[str] | None = None,
    holonomic: bool | None = None,
) -> Findings:
    """Return the Findings of `functions`; see `check_functions`.

    Args:
        functions: the functions.
        states, seed, against, claims: see `check_functions`.
        holonomic: value that replaces `functions.holonomic`, see `EquationsOfMotion.holonomic`.
    """
    selected = FUNCTION_CLAIMS.select(claims)
    wanted = checked_states(functions, list(states) if isinstance(states, Iterable) else states)
    reference = None if against is None else reference_functions(against)
    if reference is not None and (reference.n, reference.p) != (functions.n, functions.p):
        raise InputError(
            f"against has {reference.n} coordinates, expected {functions.n} as the functions have"
        )
    whole_number("seed", seed, 0)
    if holonomic is not None:
        functions = replace(functions, holonomic=holonomic)
    if against is not None:
        functions = ComparedEquations.of(functions, against)
    caller = FunctionCaller(functions)
    drawn = sample_states(functions, wanted, seed) if isinstance(wanted, int) else wanted
    points = _function_states(caller, drawn, seed, reference)
    if reference is not None:
        claims_motions.check_reference(points)
    findings: dict[str, list[Finding]] = {}
    with polled_progress("checking {claim}", len(selected), lambda: len(findings)):
        for claim in selected:
            if claim.id not in LAST:
                blind = undetectable(claim, points[0])
                findings[claim.id] = [*worst_findings(claim, points), *blind]
        if isinstance(wanted, int) and functions.ranges is None:
            for finding in outside_default_ranges(caller, findings, seed + wanted, reference):
                findings[finding.claim].append(finding)
        for id in LAST:
            findings |= {x.id: [*worst_findings(x, points)] for x in selected if x.id == id}
    if FUNCTION_CLAIMS.by_name(selected):
        findings = {x.id: findings[x.id] or [inapplicable(functions, x)] for x in selected}
    ordered = [finding for claim in selected for finding in findings[claim.id]]
    located = localize_faults(functions, ordered, points)
    return Findings(_name_exchanged_arguments(functions, one, seed) for one in located)


def _name_exchanged_arguments(functions: EquationsOfMotion, finding: Finding, seed: int) -> Finding:
    """Return a failure that vanishes where a function gets v for q and q for v, with this said."""
    if finding.verdict != "failed" or finding.follows or functions.n != functions.p:
        return finding
    for name in finding.cause.split(" or "):
        function = functions.function(name)
        if not callable(function) or not INPUTS[name].reads.startswith("qv"):
            continue
        swapped: Function = lambda q, v, *more, f=function: f(v, q, *more)  # noqa: E731
        other = replace(functions, **{name: swapped})
        assert finding.state is not None
        again = check_functions_at(other, finding.state, [finding.claim], seed)
        # Not where both sides vanish, such as a derivative by q of what no longer depends on it.
        shown = any(one.entries is not None and any(one.entries.resolved) for one in again)
        if shown and all(one.verdict == "passed" for one in again):
            return finding.because(f"q and v changed places? {name}(v, q) passes")
    return finding


def _function_states(
    caller: FunctionCaller,
    states: Sequence[State],
    seed: int,
    reference: EquationsOfMotion | None = None,
) -> list[FunctionState]:
    """Return the functions at each state, with a seed of its own."""
    return [
        FunctionState(caller, state.q, state.v, seed + k, reference)
        for k, state in enumerate(states)
    ]


def outside_default_ranges(
    caller: FunctionCaller,
    inside: Mapping[str, list[Finding]],
    seed: int,
    reference: EquationsOfMotion | None = None,
) -> Iterator[Finding]:
    """Yield failures that occur outside the default ranges only, and a Finding with the ranges.

    A few states have q in [-π, π], where every function has a value, if nothing failed inside. A
    domain may end outside the ranges, as of tables and of arccos: a failure there is inconclusive.

    Args:
        caller: caller of the functions, without `ranges` of their own.
        inside: id -> Findings inside the ranges, of the requested claims.
        seed: seed of the random states.
        reference: functions that they are compared with, or None.
    """
    functions, wide = caller.functions, []
    if not any(finding.verdict == "failed" for of_claim in inside.values() for finding in of_claim):
        middle, half = functions.half_ranges()
        half[: functions.n] = np.pi
        points = _function_states(
            caller, _random_states(functions, middle, half, WIDE, seed), seed, reference
        )
        wide = [at for at in points if _is_finite(at)]
    for id in inside:
        for finding in worst_findings(FUNCTION_CLAIMS[id], wide):
            if finding.verdict == "failed":
                detail = (
                    f"outside the ranges only, with q in [-π, π]: {finding.detail}; say `ranges`"
                )
                yield replace(finding, verdict="inconclusive", detail=detail)
    if {"answers", "reference"} <= set(inside):  # in a report about all claims
        more = f", and {len(wide)} of {WIDE} states with q in [-π, π]" if wide else ""
        yield _ranges_finding(functions, more)


def _ranges_finding(functions: EquationsOfMotion, more: str = "") -> Finding:
    """Return the Finding with the ranges that were checked: the default ones, and `more`."""
    detail = f"checked q in [-1, 1], v in [-1, 1]{more}: `ranges` for more"
    return skipped_everywhere("reference", functions.name, functions, detail)


def _is_finite(at: FunctionState) -> bool:
    """Whether every function has a value at a state."""
    try:
        with np.errstate(all="ignore"):
            for name in at.functions.given:
                at.call(name)
    except BrokenError:
        return False
    return True


def sample_states(functions: EquationsOfMotion, count: int, seed: int) -> list[State]:
    """Return random states, uniformly distributed over the ranges."""
    return _random_states(functions, *functions.half_ranges(), count, seed)


def _random_states(
    functions: EquationsOfMotion, middle: Array, half: Array, count: int, seed: int
) -> list[State]:
    """Return `count` states drawn uniformly from the ranges `middle` ± `half`."""
    rng, n = np.random.default_rng(seed), functions.n
    draws = middle + half * rng.uniform(-1.0, 1.0, (count, len(half)))
    return [State(x[:n], x[n:]) for x in draws]


# ---- Verdicts ------------------------------------------------------------------------------------


class JudgedEntries(NamedTuple):
    """A Finding at a state, with the verdict of each entry.

    Attributes:
        finding: Finding about all entries, that of the worst one that is resolved. It holds the
            entries unless the claim decides by itself.
        verdicts: their codes, indices into `VERDICTS`, an array of the shape of the quantity.
        observed: errors, same shape.
        allowed: errors that are allowed, same shape.
    """

    finding: Finding
    verdicts: Array
    observed: Array
    allowed: Array

    @property
    def verdict(self) -> Verdict:
        """Verdict of the finding."""
        return self.finding.verdict

    @property
    def ratio(self) -> float:
        """Its ratio observed / allowed."""
        return self.finding.ratio


def worst_findings(claim: FunctionClaim, points: Sequence[FunctionState]) -> Iterator[Finding]:
    """Yield the worst Finding of each subject of a claim, and one of all unresolved entries.

    An entry is resolved where a state shows whether it is right, other than by 0 = 0; one that is
    the same in bits on both sides in every state is right, 0 or not. An entry that is resolved in
    no state is listed by name in one Finding of the claim, with the verdict "inconclusive": it
    never hides behind those that are.
    """
    by_subject: dict[str, list[JudgedEntries]] = defaultdict(list)
    for point in points:
        for one in judged_at(claim, point):
            by_subject[one.finding.subject].append(one)
    hidden: list[Unresolved] = []
    for subject, judged in by_subject.items():
        chosen, unresolved = worst(judged), list(_unresolved_entries(subject, judged))
        hidden += unresolved
        finding = chosen.finding
        if finding.verdict == "failed":
            yield _name_jumps(claim, finding, points)
        elif finding.verdict == "passed":
            if len(unresolved) < chosen.verdicts.size or not unresolved:
                yield replace(finding, detail=_unresolved_text(judged))
        elif not unresolved:
            yield finding
    if hidden:
        # Where the least error is allowed.
        first = min(hidden, key=lambda one: one.finding.allowed)
        names = [f"{input_description(one.subject)}, {one.entry}" for one in hidden]
        yield _name_jumps(claim, unresolved_finding(hidden, first, names), points, hidden=True)


def _unresolved_entries(subject: str, judged: Sequence[JudgedEntries]) -> Iterator[Unresolved]:
    """Yield the entries that no state resolves, with the state where the least is allowed."""
    by_shape: dict[tuple[int, ...], list[JudgedEntries]] = defaultdict(list)
    for one in judged:
        if one.finding.entries is not None:
            by_shape[one.verdicts.shape].append(one)
    for shape, group in by_shape.items():
        entries = [one.finding.entries for one in group if one.finding.entries is not None]
        unresolved = set(never_resolved(entries))
        for index in np.ndindex(shape) if unresolved else ():
            if (name := entry_name(index, entries[0].names)) in unresolved:
                least = min(group, key=lambda one, index=index: one.allowed[index])
                errors = {
                    "observed": float(least.observed[index]),
                    "allowed": float(least.allowed[index]),
                }
                yield Unresolved(subject, name, replace(least.finding, **errors), len(group))


def _unresolved_text(judged: Sequence[JudgedEntries]) -> str:
    """Return the number of unresolved entries of a subject that passes, as text; "" for none."""
    compared = [entries for entries in judged if entries.verdict != "skipped"]
    skipped = [entries.finding.detail for entries in judged if entries.verdict == "skipped"]
    hidden = sum(int((entries.verdicts == INCONCLUSIVE_CODE).sum()) for entries in compared)
    parts = []
    if hidden:
        count = sum(entries.verdicts.size for entries in compared)
        states = counted(len(compared), "state")
        parts.append(f"{hidden} of {count} entries in {states} not resolved")
    if skipped:
        of_all = f"{len(skipped)} of {counted(len(judged), 'state')}"
        parts.append(f"skipped in {of_all}: {skipped[0]}")
    return "; ".join(parts)


def _name_jumps(
    claim: FunctionClaim, finding: Finding, points: Sequence[FunctionState], hidden: bool = False
) -> Finding:
    """Return a Finding about entries with the names of the functions that jump near its state."""
    if finding.entries is None and not hidden:
        return finding
    assert finding.state is not None
    (at,) = [x for x in points if x.q is finding.state.q and x.v is finding.state.v]
    about = {name for need in claim.needs for name in need.split("|")}
    about.add(finding.subject.split(" ~ ")[0])
    state = (at.consistent() if claim.consistent else at) or at
    jump = [name for name in at.functions.given if name in about and state.jumps(name)]
    if not jump:
        return finding
    return finding.because(f"{' and '.join(jump)} jumps within {NEAR:g} of this state")


def check_functions_at(
    functions: EquationsOfMotion, state: State, claims: Iterable[str], seed: int = 0
) -> list[Finding]:
    """Return the Findings of some claims at one state, without blind spots.

    Args:
        functions: the functions.
        state: coordinates (n,) and velocities (p,).
        claims: ids, keys of `FUNCTION_CLAIMS`.
        seed: seed of the directions in which noise is measured.
    """
    points = _function_states(FunctionCaller(functions), [state], seed)
    findings: list[Finding] = []
    for claim in map(FUNCTION_CLAIMS.__getitem__, claims):
        for finding in (judged.finding for judged in judged_at(claim, points[0])):
            failed = finding.verdict == "failed"
            findings.append(_name_jumps(claim, finding, points) if failed else finding)
    return findings


def judged_at(claim: FunctionClaim, at: FunctionState) -> Iterator[JudgedEntries]:
    """Yield the Findings of a claim at a state, with the verdicts of all entries."""
    state = State(at.q, at.v)
    for outcome in claim_outputs(claim, at):
        yield judge_output(claim, outcome, at.functions, state)


def claim_outputs(claim: FunctionClaim, at: FunctionState) -> Iterator[ClaimOutput]:
    """Yield the outcomes of a claim at a state; skipped where a function that it needs breaks."""
    if not claim.applies(at):
        return
    try:
        with np.errstate(all="ignore"):
            if claim.natural and not at.natural():
                yield Skipped(claim.term, NOT_QUADRATIC)
                return
            state = at.consistent() if claim.consistent else at
            if state is None:
                yield Skipped(claim.term, at.why_not_consistent())
                return
            yield from claim.evaluate(state)
    except BrokenError as broken:
        if claim.id != "answers":
            # The reason once only: by `answers` where it breaks at the state itself, else by this.
            once = broken.name in at.caller.reported
            at.caller.reported.add(broken.name)
            why = "does not answer" if once else f"breaks: {broken.why}"
            yield Skipped(broken.name, f"{broken.name} {why}")
    except np.linalg.LinAlgError as error:
        yield Skipped(claim.term, f"not computed here: {error}{at.repeated_constraints()}")


def judge_output(
    claim: FunctionClaim, outcome: ClaimOutput, functions: Any = None, state: State | None = None
) -> JudgedEntries:
    """Return the Finding of an outcome, with the verdicts of its entries.

    Args:
        claim: the claim.
        outcome: the outcome.
        functions, state: scene and state of the Finding.
    """
    if isinstance(outcome, Skipped):
        outcome = Decision(outcome.subject, 0.0, 0.0, "skipped", outcome.reason)
    if isinstance(outcome, Comparison):
        decision, entries, *arrays = judge_entries(claim, outcome)
    else:
        decision, entries, none = outcome, None, np.zeros(())
        arrays = [np.asarray(VERDICTS.index(outcome.verdict)), none, none]
    subject, observed, allowed, verdict, detail = decision
    evidence = "skipped" if verdict == "skipped" else "property-tested"
    about = claim.id, subject, functions, state
    finding = Finding(*about, observed, allowed, verdict, evidence, detail, entries=entries)
    return JudgedEntries(finding, *arrays)


def judge_entries(
    claim: FunctionClaim, sides: Comparison
) -> tuple[Decision, Entries, Array, Array, Array]:
    """Judge each entry of two sides by its own error.

    An entry is inconclusive also where one side is known not to be 0, and more than a thousandth of
    the larger one is allowed: then it would pass with any sign. An entry that is the same in bits
    is not hidden.

    Returns:
        The decision of the worst entry, the resolved and hidden entries, and for each entry the
        code of its verdict, its error and its allowed error.
    """
    actual, expected = sides.actual, sides.expected
    if actual.value.size == 0:
        none = np.zeros(actual.shape, bool)
        passed = Decision(sides.subject, 0.0, 0.0, "passed")
        return passed, entries_of(sides.names, none, none), none, none, none
    error = actual.error + expected.error
    with np.errstate(all="ignore"):
        observed = np.abs(actual.value - expected.value)
        allowed = allowed_error(1.0) * (error / EPS)
        larger = np.maximum(np.abs(actual.value), np.abs(expected.value))
        nonzero = (np.abs(actual.value) > C * actual.error) | (
            np.abs(expected.value) > C * expected.error
        )
        blind = nonzero & (expected.value != 0.0) & (allowed > INCONCLUSIVE * larger)
        verdicts = verdict_codes(observed, allowed, np.maximum(actual.size, expected.size))
        finite = np.isfinite(error) & np.isfinite(observed)
        hidden = blind & (verdicts == PASSED_CODE) | ~finite
        verdicts = np.where(hidden, INCONCLUSIVE_CODE, verdicts)
        ratio = np.where(allowed > 0.0, observed / allowed, np.where(observed > 0.0, np.inf, 0.0))
    allowed = np.where(finite, allowed, np.inf)
    same = actual.value == expected.value
    resolved = (verdicts < INCONCLUSIVE_CODE) & ~(same & (actual.value == 0.0))
    order = np.lexsort((-np.nan_to_num(ratio, nan=0.0).ravel(), verdicts.ravel()))
    index = tuple(int(i) for i in np.unravel_index(int(order[0]), observed.shape))
    verdict, detail = VERDICTS[int(verdicts[index])], ""
    if verdict == "failed":
        detail = failure_detail(claim, sides, index, float(allowed[index]))
    elif verdict == "inconclusive":
        detail = "the error of what is measured is as large as its value"
    numbers = float(observed[index]), float(allowed[index])
    decision = Decision(sides.subject, *numbers, verdict, detail)
    return (
        decision,
        entries_of(sides.names, resolved, ~resolved & ~same),
        verdicts,
        observed,
        allowed,
    )


def failure_detail(
    claim: FunctionClaim, sides: Comparison, index: tuple[int, ...], allowed: float
) -> str:
    """Return the detail of a failure: the term to blame, the entry, and its diagnosis."""
    actual, expected = sides.actual.value, sides.expected.value
    term = claim.term or input_description(sides.subject)
    own = sides.explain(actual, expected, allowed, index) if sides.explain is not None else ""
    if own:
        return f"{term}, {entry_name(index, sides.names)}: {own}"
    context = NO_CONTEXT if sides.context is None else sides.context()
    difference = locate(actual, expected, sides.names, allowed, context, worst=index)
    return f"{term}, {difference.where}: {difference.text}"


def input_description(subject: str) -> str:
    """Return the description of the input that a subject is about, or else its name."""
    name = subject.split(" ~ ")[0]
    return INPUTS[name].what if name in INPUTS else name


# ---- Claims that do not apply --------------------------------------------------------------------


def caveats(functions: EquationsOfMotion, claims: Iterable[str]) -> list[Finding]:
    """Return the caveats of some claims that hold in every state; no function is called.

    Args:
        functions: the functions.
        claims: ids, keys of `FUNCTION_CLAIMS`.
    """
    middle, _ = functions.half_ranges()
    at = FunctionState(FunctionCaller(functions), middle[: functions.n], middle[functions.n :])
    selected = FUNCTION_CLAIMS.select(claims)
    findings: list[Finding] = []
    for claim in selected:
        of_claim = list(undetectable(claim, at))
        if FUNCTION_CLAIMS.by_name(selected) and not (of_claim or claim.applies(at)):
            of_claim = [inapplicable(functions, claim)]
        findings += of_claim
    if functions.ranges is None and {"answers", "reference"} <= {x.id for x in selected}:
        findings.append(_ranges_finding(functions))
    return findings


def inapplicable(functions: EquationsOfMotion, claim: FunctionClaim) -> Finding:
    """Return the Finding of a claim that was requested and lacks the inputs it needs."""
    either = [need.replace("|", " or ") for need in claim.needs]
    several = len(either) > 1
    needs = " and ".join(f"({x})" if several and " or " in x else x for x in either)
    detail = f"needs {needs}" if needs else "does not hold"
    if claim.without:
        detail += f", without {' or '.join(claim.without)}"
    return skipped_everywhere(claim.id, functions.name, functions, detail)


def undetectable(claim: FunctionClaim, at: FunctionState) -> Iterator[Finding]:
    """Yield a Finding for each blind spot of a claim that does not apply: inputs are missing."""
    functions = at.functions
    for blind in () if claim.applies(at) else claim.blind_spots:
        if blind.derived and not functions.derived:
            continue
        if (not blind.about or at.has(blind.about)) and (would := blind.revealing_inputs(at)):
            about = blind.about or functions.name
            detail = f"{blind.what}: {would} would tell"
            yield skipped_everywhere(claim.id, about, functions, detail)
