"""Claims about whole accelerations: Eqs. (3) and (5), the formulations, engines, machine code."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from functools import cache, partial
from operator import attrgetter
from typing import Any

import numpy as np

from eomcheck.claims.case import Case
from eomcheck.claims.finding import Finding
from eomcheck.claims.registry import (
    Look,
    Sides,
    check,
    claim,
    magnitude,
    numbered,
    pairs,
    size,
    speed_names,
    vanishing,
)
from eomcheck.claims.trial import answer, compared, size_of, unseen
from eomcheck.engines import Answers, Engine, EngineFault, is_on_trial
from eomcheck.errors import RefusedError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import sensitivity_of
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.evaluation.tolerance import INCONCLUSIVE, allowed_error, can_overflow, largest
from eomcheck.formulations import FORMULATIONS, Formulation
from eomcheck.motion.observables import as_integrated
from eomcheck.motion.right_hand_side import acceleration_in_machine_code
from eomcheck.numbers.generic import Array, NotRationalError
from eomcheck.numbers.lanes import lanes_in, where
from eomcheck.numbers.linear import least_squares, null_space, row_scale, singular_values
from eomcheck.numbers.noise import NORMAL


def _row_sum(matrix: Any) -> float:
    """Return the largest sum of magnitudes in a row."""
    return size(matrix, np.ones(matrix.shape[1]))


@claim("equations-residual", "M q̈ - F - aᵀλ = 0", "(5)", "equations of motion")
def equations_residual(at: Quantities, look: Look) -> Iterator[Sides]:
    """Each q̈ satisfies Eq. (5): with its own λ, or on every motion that the constraints allow."""
    M, _, _, a, _, _ = at.terms
    F_sensitivity = look.sensitivity(lambda e: e.F)
    motions, told = (None, True) if a is None else _allowed_motions(at, look)
    for f, x in look.solutions:
        residual, names = _left(x, at), at.scene.coordinate_names
        terms = magnitude(M, x.vdot) + magnitude(at.F)
        # What is lost in M is lost in q̈ too, but where bodies are summed without it.
        of_terms = look.sensitivity(partial(_left, x)) if f.linear else F_sensitivity
        sensitivity = _row_sum(M) * look.vdot_sensitivity(f) + of_terms
        if a is not None and x.multipliers is not None:
            terms = terms + magnitude(a.T, x.multipliers)
            sensitivity += _row_sum(a.T) * look.multiplier_sensitivity(f)
        elif motions is not None:
            cancelled = 0.0 if look.exact else _constraint_forces(a, residual)
            terms = magnitude(motions.T, terms + cancelled)
            residual = motions.T @ residual
            names = speed_names(at) if look.exact else numbered("allowed motion ", residual.size)
            sensitivity = where(told, sensitivity, np.inf)
        yield vanishing(f.key, residual, (names,), terms, sensitivity + largest(terms))


def _left(x: Any, e: Quantities) -> Array:
    """Return M q̈ - F - aᵀλ (n,) of the q̈ and λ of a solution; without λ where it has none."""
    net, a = e.terms.M @ x.vdot - e.F, e.terms.a
    return net if a is None or x.multipliers is None else net - a.T @ x.multipliers


def _allowed_motions(at: Quantities, look: Look) -> tuple[Any, Any]:
    """Return a basis (n, p) of all v with a v = 0, and whether rounding lets a tell them."""
    if look.exact:
        return at.speeds.W, True
    # Rows of one size: small ones are constraints as well.
    a = at.terms.a
    a = a * row_scale(a)[:, None]
    basis, values = null_space(a), singular_values(a)
    told = len(values) == 0 or allowed_error(values[0]) <= INCONCLUSIVE * values[-1]
    # Singular vectors are as accurate as the largest row allows, not each row for itself; nor is
    # what mends them where rows nearly depend on each other, whose forces may be huge.
    for _ in range(2):
        basis = basis - least_squares(a, a @ basis)
    return basis, told


def _constraint_forces(a: Any, net: Array) -> Array:
    """Return |aᵀ| |λ| (n,) of the constraint forces aᵀλ = net, which may have cancelled there."""
    if not lanes_in(net) and not np.isfinite(net).all():
        return np.full(net.size, np.inf)
    return np.abs(a.T) @ np.abs(least_squares(a.T, net))


@claim("constraint-acceleration", "a q̈ + ȧ q̇ + ḃ = 0", "(3)", "constraints at acceleration level")
def constraint_acceleration(at: Quantities, look: Look) -> Iterator[Sides]:
    """Each q̈ satisfies the constraints differentiated."""
    a, gamma, names = at.terms.a, at.terms.gamma, (at.scene.constraint_names,)
    if a is None:
        return
    gamma_sensitivity = look.sensitivity(lambda e: e.terms.gamma)
    for f, x in look.solutions:
        terms = magnitude(a, x.vdot) + magnitude(gamma)
        sensitivity = _row_sum(a) * look.vdot_sensitivity(f) + gamma_sensitivity + largest(terms)
        yield vanishing(f.key, a @ x.vdot + gamma, names, terms, sensitivity)


@claim("equivalence", "q̈ of one formulation = q̈ of another", "(7)-(23)", "acceleration")
def equivalence(at: Quantities, look: Look) -> Iterator[Sides]:
    """All formulations give the same acceleration, pair by pair, whatever the partition."""
    names = (at.scene.coordinate_names,)
    for (f, x), (g, y) in pairs(look.solutions):
        sensitivity = look.vdot_sensitivity(f) + look.vdot_sensitivity(g)
        yield Sides(f"{f.key} ~ {g.key}", x.vdot, y.vdot, names, sensitivity=sensitivity)
    for f, x, y in look.others:
        yield Sides(f"{f.key}, drawn", x.vdot, y.vdot, names)


@claim("multipliers", "λ of one formulation = λ of another", "(7), (9), (12)", "multipliers")
def multipliers(at: Quantities, look: Look) -> Iterator[Sides]:
    """All formulations that have multipliers have the same, pair by pair."""
    if at.terms.a is not None:
        for f, x in look.solutions:
            has, declared = int(x.multipliers is not None), int(f.multipliers)
            yield Sides(f.key, has, declared, (), size=1.0, sensitivity=1.0)
    having = [(f, x) for f, x in look.solutions if x.multipliers is not None]
    for (f, x), (g, y) in pairs(having):
        sensitivity = look.multiplier_sensitivity(f) + look.multiplier_sensitivity(g)
        names = (at.scene.constraint_names,)
        yield Sides(
            f"{f.key} ~ {g.key}", x.multipliers, y.multipliers, names, sensitivity=sensitivity
        )


# ---- Engines -------------------------------------------------------------------------------------


def _part_in(formulation: Formulation, T: Array, part: str, e: Evaluation) -> Array:
    return getattr(e.acceleration_in(formulation, T), part)


def _responses(at: Evaluation) -> tuple[float, float]:
    """Return the largest change of v̇ and of λ per change of all entries of F by one unit."""
    M, a = at.terms.M, at.terms.a
    if a is None:
        return float(np.linalg.norm(np.linalg.inv(M), np.inf)), 0.0
    Z = null_space(a)
    response = Z @ np.linalg.solve(Z.T @ M @ Z, Z.T)
    multipliers = np.linalg.pinv(a.T) @ (M @ response - np.eye(len(M)))
    return float(np.linalg.norm(response, np.inf)), float(np.linalg.norm(multipliers, np.inf))


def _sensitivity(case: Case, engine: Engine | type[Engine], part: str) -> float:
    """Return κ · scale of what an engine solves; infinite where nothing can be judged."""
    if isinstance(engine, type):
        return 0.0
    at = case.at
    like, n = FORMULATIONS[engine.solves_like], at.scene.n
    T = np.eye(n)
    with suppress(EngineFault):
        S = Answers(engine).velocity_map(at.q, at.v).S
        T = S if S.shape == (n, n) else T
    try:
        at.acceleration(like)
        summed = size_of(case, engine, "bias")
        if engine.offers("forces"):  # it may take its own Q, not ours
            summed += size_of(case, engine, "forces")
        by_force = _responses(at)[part == "multipliers"] * summed
        return sensitivity_of(at, partial(_part_in, like, T, part), coordinates=True) + by_force
    except (np.linalg.LinAlgError, RefusedError):
        return float("inf")


def _against_engines(case: Case, part: str, names: tuple[str, ...]) -> Iterator[Finding]:
    """Yield the Findings of "vdot" or "multipliers", for each engine where that can be judged."""
    at, r = case.at, case.at.scene.r
    if part == "multipliers" and r == 0:
        return
    Q = np.zeros(at.scene.n) if at.terms.Q is None else at.terms.Q
    handed = at.q, at.v, Q, at.terms.a, at.terms.gamma, at.t
    for engine in case.taking_part:
        theirs_by = cache(partial(_sensitivity, case, engine, part))
        said = answer(
            case,
            engine,
            *handed,
            expected=partial(_expected, case, engine, part),
            part=attrgetter(part),
            excused=lambda by=theirs_by: by() == np.inf,
        )
        if isinstance(said, Finding) or isinstance(engine, type):
            yield said
            continue
        theirs = getattr(said, part)
        if theirs is None and r > 0:
            yield unseen(case, type(engine), "it does not tell λ")
        if theirs is None:
            continue
        like = FORMULATIONS[engine.solves_like]
        # Our formulations are compared with each other: one of them tells of an engine on trial.
        chosen = case.solutions
        if is_on_trial(type(engine)):
            with suppress(RefusedError):
                chosen = ((like, at.acceleration(like)),)
        for formulation, x in chosen:
            if (ours := getattr(x, part)) is None:
                continue
            if engine.compliant and r > 0:
                yield _of_another_model(case, engine, ours, theirs)
                break
            sensitivity = case.part_sensitivity(formulation, part, coordinates=True) + theirs_by()
            here = case, engine, f"{formulation.key} ~ {engine.key}", ours, theirs, sensitivity
            finding = compared(*here, partial(_part_again, part, handed), names=(names,))
            yield _excused(case, engine, finding, Q) if part == "vdot" else finding


def _expected(case: Case, engine: Engine | type[Engine], part: str) -> Array | None:
    """Acceleration or multipliers of the formulation that an engine solves like, or another."""
    with suppress(np.linalg.LinAlgError, RefusedError):
        solved = case.at.acceleration(FORMULATIONS[engine.solves_like])
        if (found := getattr(solved, part)) is not None:
            return found
    return next((x for _, one in case.solutions if (x := getattr(one, part)) is not None), None)


def _excused(case: Case, engine: Engine, finding: Finding, Q: Array) -> Finding:
    """Return a failure as inconclusive where the engine's own, larger matrix explains it.

    Of joints that follow others S is not square: an engine may solve M_x and eliminate afterwards,
    and M_x may be worse conditioned than SᵀM_xS. What is allowed is not its own to say, so that
    nothing passes by it.
    """
    if finding.verdict != "failed":
        return finding
    try:
        allowed = allowed_error(_own_sensitivity(case, Answers(engine), Q))
    except (np.linalg.LinAlgError, EngineFault):
        return finding
    if not finding.observed <= allowed:
        return finding
    why = "the condition of its own matrix, of joints that follow others, explains the difference"
    return replace(finding, verdict="inconclusive", allowed=allowed, detail=why)


def _own_sensitivity(case: Case, answers: Answers, Q: Array) -> float:
    """Return κ · scale of v̇ where an engine solves M_x and then holds joints that follow others.

    0 where S is square: then M itself tells.
    """
    (_, S, _), M, B = answers.own_terms(*case.state)
    if len(S) == S.shape[1]:
        return 0.0
    back, inverse = np.linalg.pinv(S), np.abs(np.linalg.inv(M))
    free = inverse @ (np.abs(back.T @ Q) + np.abs(B))
    held = S @ np.linalg.solve(S.T @ M @ S, S.T @ M)
    sizes = back, held, inverse @ np.abs(M)
    return float(np.prod([np.linalg.norm(one, np.inf) for one in sizes])) * largest(free)


def _part_again(part: str, handed: tuple, answers: Answers) -> Any:
    return getattr(answers.acceleration(*handed), part)


def _of_another_model(case: Case, engine: Engine, ours: Array, theirs: Array) -> Finding:
    """Return what constraints that give way make of a quantity: neither right nor wrong."""
    scale = largest(ours)
    share = f"{largest(theirs - ours) / scale:.2g} of it" if scale > 0 else f"{largest(theirs):.2g}"
    why = f"its constraints are compliant: a difference of model, here {share}"
    return unseen(case, type(engine), why)


@check(
    "engine-acceleration",
    "q̈ = q̈ of the engine",
    "(5), (7)-(23)",
    "acceleration",
    asks="acceleration",
)
def engine_acceleration(case: Case) -> Iterator[Finding]:
    """Each formulation gives the constrained acceleration of each engine."""
    return _against_engines(case, "vdot", case.at.scene.coordinate_names)


@check(
    "engine-multipliers",
    "λ = λ of the engine",
    "(5), (7), (9), (12)",
    "multipliers",
    asks="acceleration",
)
def engine_multipliers(case: Case) -> Iterator[Finding]:
    """Each formulation that has multipliers gives those of each engine."""
    return _against_engines(case, "multipliers", case.at.scene.constraint_names)


# ---- Machine code --------------------------------------------------------------------------------

FEW = 5
"""Coordinates of scenes for which machine code is made beside the example of a kind: it takes as
long as hundreds of states."""


@check("machine-code", "q̈ in machine code = q̈ of the public path", "(7)-(23)", "machine code")
def machine_code(case: Case) -> Iterator[Finding]:
    """Each formulation gives the same acceleration in machine code."""
    scene = case.at.scene
    if scene.n > FEW and scene.structure != type(scene).example().structure:
        return
    for formulation in case.solved:
        try:
            at, y = as_integrated(case.at, formulation)
            found = acceleration_in_machine_code(at, formulation, y)
            public = at.acceleration(formulation).vdot
        except NotRationalError as error:
            outcome = 0.0, 0.0, "not looked at", "property-tested", f"not rational: {error}"
            yield case.finding("all", *outcome)
            return
        except RefusedError:  # another velocity that is refused
            continue
        extreme = can_overflow(at.v, at.F, at.terms.M) or _subnormal(at.terms.a)
        if extreme and not np.isfinite(found).all():
            # Solves in registers scale no columns: their products and quotients are larger.
            outcome = math.inf, 0.0, "inconclusive", "property-tested"
            yield case.finding(formulation.key, *outcome, "overflows in machine code: NaN")
            continue
        # Velocities that differ by rounding have the same sensitivity.
        sensitivity = 2 * case.vdot_sensitivity(formulation)
        if np.isinf(sensitivity) and np.isnan(found).all():
            # Rows of nothing but rounding: they are scaled in Python, in registers they are not.
            outcome = math.inf, math.inf, "inconclusive", "property-tested"
            yield case.finding(formulation.key, *outcome, "no digit is left: NaN in machine code")
            continue
        names = (scene.coordinate_names,)
        yield case.compare(formulation.key, found, public, sensitivity, names=names)


def _subnormal(a: Array | None) -> bool:
    """Return whether a quotient of entries of constraints may overflow, whatever they say."""
    return a is not None and bool(((a != 0) & (np.abs(a) < NORMAL)).any())
