"""Claims about whole accelerations: equations, formulations, engines, energy, symmetry.

Accelerations q̈ satisfy Eqs. (3) and (5), and agree between formulations, with engines (rigid-body
libraries) and with machine code (the same formulation, JIT-compiled). Redundant constraints,
implied by others, change no motion and share its forces. Claims of physics need no second
computation: energy is conserved or dissipated as R states, and accelerations transform with the
whole scene.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import cache, cached_property, partial
from operator import attrgetter
from typing import Any

import numpy as np

from eomcheck.claims.case import (
    Case,
    ask_engine,
    cancelling_size,
    compare_with_engine,
    skipped_finding,
)
from eomcheck.claims.finding import Finding
from eomcheck.claims.registry import (
    Comparison,
    EvaluationContext,
    Skipped,
    case_claim,
    claim,
    magnitude,
    numbered,
    product_size,
    sensitivity_where,
    speed_names,
    unordered_pairs,
    vanishing,
)
from eomcheck.engines import Answers, Engine, EngineFault, is_under_test
from eomcheck.errors import RefusedError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import (
    acceleration_sensitivity,
    measured_entry_sensitivity,
    perturbed_samples,
    sensitivity_of,
)
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.evaluation.tolerance import INCONCLUSIVE, allowed_error, can_overflow, larger, largest
from eomcheck.formulations import FORMULATIONS, Formulation
from eomcheck.motion.observables import as_integrated
from eomcheck.motion.right_hand_side import acceleration_in_machine_code
from eomcheck.numbers.batch_arrays import as_float64, batch_size, choose
from eomcheck.numbers.dual import duals, rate, value
from eomcheck.numbers.generic import Array, NotRationalError, as_objects, map_entries, map_record
from eomcheck.numbers.linear import least_squares, null_space, row_scale, singular_values
from eomcheck.numbers.noise import NORMAL

# ---- Equations, formulations, engines, machine code ----------------------------------------------


def _row_sum(matrix: Any) -> float:
    """Return the largest sum of magnitudes in a row."""
    return product_size(matrix, np.ones(matrix.shape[1]))


@claim("equations-residual", "M q̈ - F - aᵀλ = 0", "(5)", "equations of motion")
def equations_residual(at: Quantities, context: EvaluationContext) -> Iterator[Comparison]:
    """Each q̈ satisfies Eq. (5): with its own λ, or on every motion that the constraints allow."""
    M, _, _, a, _, _ = at.terms
    F_sensitivity = context.sensitivity(lambda e: e.F)
    motions, resolved = (None, True) if a is None else _allowed_motions(at, context)
    for f, x in context.solutions:
        residual, names = _left(x, at), at.scene.coordinate_names
        terms = magnitude(M, x.vdot) + magnitude(at.F)
        # Digits lost in M are lost in q̈ too, except by formulations that sum bodies without M.
        of_terms = context.sensitivity(partial(_left, x)) if f.linear else F_sensitivity
        sensitivity = _row_sum(M) * context.vdot_sensitivity(f) + of_terms
        if a is not None and x.multipliers is not None:
            terms = terms + magnitude(a.T, x.multipliers)
            sensitivity += _row_sum(a.T) * context.multiplier_sensitivity(f)
        elif motions is not None:
            cancelled = 0.0 if context.exact else _constraint_forces(a, residual)
            terms = magnitude(motions.T, terms + cancelled)
            residual = motions.T @ residual
            names = speed_names(at) if context.exact else numbered("allowed motion ", residual.size)
            sensitivity = choose(resolved, sensitivity, np.inf)
        yield vanishing(f.key, residual, (names,), terms, sensitivity + largest(terms))


def _left(x: Any, e: Quantities) -> Array:
    """Return the residual M q̈ - F - aᵀλ (n,) of a solution; without aᵀλ if it has no λ."""
    net, a = e.terms.M @ x.vdot - e.F, e.terms.a
    return net if a is None or x.multipliers is None else net - a.T @ x.multipliers


def _allowed_motions(at: Quantities, context: EvaluationContext) -> tuple[Any, Any]:
    """Return a basis (n, p) of the null space of a, and whether rounding leaves it resolved."""
    if context.exact:
        return at.speeds.W, True
    # Rows of one size: small ones are constraints as well.
    a = at.terms.a
    a = a * row_scale(a)[:, None]
    basis, values = null_space(a), singular_values(a)
    resolved = len(values) == 0 or allowed_error(values[0]) <= INCONCLUSIVE * values[-1]
    # Singular vectors are accurate relative to the largest row, not row by row. Nor is a correction
    # by least squares, if rows are nearly dependent and forces may be huge: correct twice.
    for _ in range(2):
        basis = basis - least_squares(a, a @ basis)
    return basis, resolved


def _constraint_forces(a: Any, net: Array) -> Array:
    """Return |aᵀ| |λ| (n,) of the constraint forces aᵀλ = net, whose terms may cancel."""
    if not batch_size(net) and not np.isfinite(net).all():
        return np.full(net.size, np.inf)
    return np.abs(a.T) @ np.abs(least_squares(a.T, net))


@claim(
    "constraint-acceleration",
    "a q̈ + ȧ q̇ + ḃ = 0",
    "(3)",
    "constraints at acceleration level",
    needs="constraints, and a formulation that solves a state",
)
def constraint_acceleration(at: Quantities, context: EvaluationContext) -> Iterator[Comparison]:
    """Each q̈ satisfies the differentiated constraints."""
    a, gamma, names = at.terms.a, at.terms.gamma, (at.scene.constraint_names,)
    if a is None:
        return
    gamma_sensitivity = context.sensitivity(lambda e: e.terms.gamma)
    for f, x in context.solutions:
        terms = magnitude(a, x.vdot) + magnitude(gamma)
        sensitivity = _row_sum(a) * context.vdot_sensitivity(f) + gamma_sensitivity + largest(terms)
        yield vanishing(f.key, a @ x.vdot + gamma, names, terms, sensitivity)


@claim(
    "equivalence",
    "q̈ of one formulation = q̈ of another",
    "(7)-(23)",
    "acceleration",
    needs="two formulations that solve one state",
)
def equivalence(at: Quantities, context: EvaluationContext) -> Iterator[Comparison]:
    """All formulations give the same acceleration, pair by pair, whatever the partition."""
    names = (at.scene.coordinate_names,)
    for (f, x), (g, y) in unordered_pairs(context.solutions):
        sensitivity = context.vdot_sensitivity(f) + context.vdot_sensitivity(g)
        yield Comparison(f"{f.key} ~ {g.key}", x.vdot, y.vdot, names, sensitivity=sensitivity)
    for f, x, y in context.others:
        yield Comparison(f"{f.key}, drawn", x.vdot, y.vdot, names, drawn_partition=True)


@claim(
    "multipliers",
    "λ of one formulation = λ of another",
    "(7), (9), (12)",
    "multipliers",
    needs="constraints, and two formulations that give λ at one state",
)
def multipliers(at: Quantities, context: EvaluationContext) -> Iterator[Comparison]:
    """All formulations with multipliers have equal multipliers, pair by pair."""
    if at.terms.a is not None:
        for f, x in context.solutions:
            has, declared = int(x.multipliers is not None), int(f.multipliers)
            yield Comparison(f.key, has, declared, (), size=1.0, sensitivity=1.0)
    having = [(f, x) for f, x in context.solutions if x.multipliers is not None]
    for (f, x), (g, y) in unordered_pairs(having):
        sensitivity = context.multiplier_sensitivity(f) + context.multiplier_sensitivity(g)
        names = (at.scene.constraint_names,)
        yield Comparison(
            f"{f.key} ~ {g.key}", x.multipliers, y.multipliers, names, sensitivity=sensitivity
        )


# ---- Engines -------------------------------------------------------------------------------------


def _part_in(formulation: Formulation, T: Array, part: str, e: Evaluation) -> Array:
    """Return a part of the solution in the coordinates T; a function of the evaluation."""
    return getattr(e.acceleration_in(formulation, T), part)


def _force_responses(at: Evaluation) -> tuple[float, float]:
    """Return the largest change of v̇ and of λ per unit change of every entry of F."""
    M, a = at.terms.M, at.terms.a
    if a is None:
        return float(np.linalg.norm(np.linalg.inv(M), np.inf)), 0.0
    Z = null_space(a)
    response = Z @ np.linalg.solve(Z.T @ M @ Z, Z.T)
    multipliers = np.linalg.pinv(a.T) @ (M @ response - np.eye(len(M)))
    return float(np.linalg.norm(response, np.inf)), float(np.linalg.norm(multipliers, np.inf))


def _engine_sensitivity(case: Case, engine: Engine | type[Engine], part: str) -> float:
    """Return κ · scale of an engine's v̇ or λ; infinite if nothing can be judged."""
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
        summed = cancelling_size(case, engine, "bias")
        if engine.offers("forces"):  # it may use its own Q instead of the scene's
            summed += cancelling_size(case, engine, "forces")
        by_force = _force_responses(at)[part == "multipliers"] * summed
        return sensitivity_of(at, partial(_part_in, like, T, part), coordinates=True) + by_force
    except (np.linalg.LinAlgError, RefusedError):
        return float("inf")


def _compare_engines(case: Case, part: str, names: tuple[str, ...]) -> Iterator[Finding]:
    """Yield the Findings of the part "vdot" or "multipliers" for each engine that has it."""
    if part == "multipliers" and case.at.scene.r == 0:
        return
    for engine in case.claim_engines:
        yield from _compare_engine(case.rounded_for(engine), engine, part, names)


def _compare_engine(
    case: Case, engine: Engine | type[Engine], part: str, names: tuple[str, ...]
) -> Iterator[Finding]:
    """Yield the Findings of the part "vdot" or "multipliers" of an engine."""
    at, r = case.at, case.at.scene.r
    Q = np.zeros(at.scene.n) if at.terms.Q is None else at.terms.Q
    handed = at.q, at.v, Q, at.terms.a, at.terms.gamma, at.t
    engine_sensitivity = cache(partial(_engine_sensitivity, case, engine, part))
    answer = ask_engine(
        case,
        engine,
        *handed,
        expected=partial(_expected_part, case, engine, part),
        part=attrgetter(part),
        excused=lambda: engine_sensitivity() == np.inf,
    )
    if isinstance(answer, Finding) or isinstance(engine, type):
        yield answer
        return
    engine_value = getattr(answer, part)
    if engine_value is None and r > 0:
        yield skipped_finding(case, type(engine), "it does not tell λ")
    if engine_value is None:
        return
    like = FORMULATIONS[engine.solves_like]
    # Formulations are compared with each other, so that one of them suffices for an engine under
    # test.
    chosen = case.solutions
    if is_under_test(type(engine)):
        with suppress(RefusedError):
            chosen = ((like, at.acceleration(like)),)
    for formulation, x in chosen:
        if (value := getattr(x, part)) is None:
            continue
        if engine.compliant and r > 0:
            yield _compliance_finding(case, engine, value, engine_value)
            break
        both = case.part_sensitivity(formulation, part, coordinates=True), engine_sensitivity()
        # Beside an engine with fewer digits, rounding of the formulation itself does not count.
        sensitivity = sum(both) if case.unrounded is None else max(both)
        subject = f"{formulation.key} ~ {engine.key}"
        compared = case, engine, subject, value, engine_value, sensitivity
        again = partial(_repeated_part, part, handed)
        finding = compare_with_engine(*compared, again, names=(names,))
        yield _excuse_failure(case, engine, finding, Q) if part == "vdot" else finding


def _expected_part(case: Case, engine: Engine | type[Engine], part: str) -> Array | None:
    """Return v̇ or λ by the formulation that an engine is most similar to, or by another one."""
    with suppress(np.linalg.LinAlgError, RefusedError):
        solved = case.at.acceleration(FORMULATIONS[engine.solves_like])
        if (value := getattr(solved, part)) is not None:
            return value
    parts = (getattr(solution, part) for _, solution in case.solutions)
    return next((x for x in parts if x is not None), None)


def _excuse_failure(case: Case, engine: Engine, finding: Finding, Q: Array) -> Finding:
    """Turn a failure into an inconclusive Finding if the engine's own, larger matrix explains it.

    With mimic joints, which follow others, S is not square: an engine may solve M_x and eliminate
    afterwards, and M_x may be worse conditioned than SᵀM_xS. Since M_x is the engine's own matrix,
    it can excuse a failure but never make it a pass.
    """
    if finding.verdict != "failed":
        return finding
    try:
        own = _own_sensitivity(case, Answers(engine), Q)
        allowed = allowed_error(own, case.at.unit_roundoff)
    except (np.linalg.LinAlgError, EngineFault):
        return finding
    if not finding.observed <= allowed:
        return finding
    why = "the condition of its own matrix, of joints that follow others, explains the difference"
    return replace(finding, verdict="inconclusive", allowed=allowed, detail=why)


def _own_sensitivity(case: Case, answers: Answers, Q: Array) -> float:
    """Return κ · scale of v̇ of an engine that solves M_x and then constrains mimic joints.

    0 if S is square: then the condition number of M itself counts.
    """
    (_, S, _), M, B = answers.own_terms(*case.state)
    if len(S) == S.shape[1]:
        return 0.0
    back, inverse = np.linalg.pinv(S), np.abs(np.linalg.inv(M))
    free = inverse @ (np.abs(back.T @ Q) + np.abs(B))
    held = S @ np.linalg.solve(S.T @ M @ S, S.T @ M)
    sizes = back, held, inverse @ np.abs(M)
    return float(np.prod([np.linalg.norm(matrix, np.inf) for matrix in sizes])) * largest(free)


def _repeated_part(part: str, handed: tuple, answers: Answers) -> Any:
    """Return a part of the engine's solution, computed once more."""
    return getattr(answers.acceleration(*handed), part)


def _compliance_finding(case: Case, engine: Engine, value: Array, engine_value: Array) -> Finding:
    """Return the skipped Finding on an engine with compliant constraints, a different model."""
    scale = largest(value)
    apart = largest(engine_value - value)
    share = f"{apart / scale:.2g} of it" if scale > 0 else f"{largest(engine_value):.2g}"
    why = f"its constraints are compliant: a difference of model, here {share}"
    return skipped_finding(case, type(engine), why)


@case_claim(
    "engine-acceleration",
    "q̈ = q̈ of the engine",
    "(5), (7)-(23)",
    "acceleration",
    asks="acceleration",
)
def engine_acceleration(case: Case) -> Iterator[Finding]:
    """Each formulation has the constrained acceleration of each engine."""
    return _compare_engines(case, "vdot", case.at.scene.coordinate_names)


@case_claim(
    "engine-multipliers",
    "λ = λ of the engine",
    "(5), (7), (9), (12)",
    "multipliers",
    asks="acceleration",
    needs="constraints",
)
def engine_multipliers(case: Case) -> Iterator[Finding]:
    """Each formulation with multipliers has those of each engine."""
    return _compare_engines(case, "multipliers", case.at.scene.constraint_names)


# ---- Machine code --------------------------------------------------------------------------------

FEW = 5
"""Largest number of coordinates of scenes, other than the example of a class, that are compiled to
machine code: that takes as long as checking hundreds of states."""


@case_claim(
    "machine-code",
    "q̈ in machine code = q̈ of the public path",
    "(7)-(23)",
    "machine code",
    needs="few coordinates or the example of a class, and a formulation that solves a state",
)
def machine_code(case: Case) -> Iterator[Finding]:
    """Each formulation has the same acceleration in JIT-compiled machine code."""
    scene = case.at.scene
    if scene.n > FEW and scene.structure != type(scene).example().structure:
        return
    for formulation in case.solved:
        try:
            at, y = as_integrated(case.at, formulation)
            compiled = acceleration_in_machine_code(at, formulation, y)
            public = at.acceleration(formulation).vdot
        except NotRationalError as error:
            outcome = 0.0, 0.0, "skipped", "property-tested", f"not rational: {error}"
            yield case.finding("all", *outcome)
            return
        except RefusedError:  # at the integrator's velocity, which differs by rounding
            continue
        extreme = can_overflow(at.v, at.F, at.terms.M) or _has_subnormal(at.terms.a)
        if extreme and not np.isfinite(compiled).all():
            # Solves in machine code scale no columns: their products and quotients are larger.
            outcome = math.inf, 0.0, "inconclusive", "property-tested"
            yield case.finding(formulation.key, *outcome, "overflows in machine code: NaN")
            continue
        # Velocities that differ by rounding have the same sensitivity.
        sensitivity = 2 * case.vdot_sensitivity(formulation)
        if np.isinf(sensitivity) and np.isnan(compiled).all():
            # Rows of rounding error only: they are scaled in Python, not in machine code.
            outcome = math.inf, math.inf, "inconclusive", "property-tested"
            yield case.finding(formulation.key, *outcome, "no digit is left: NaN in machine code")
            continue
        names = (scene.coordinate_names,)
        yield case.compare(formulation.key, compiled, public, sensitivity, names=names)


def _has_subnormal(a: Array | None) -> bool:
    """Return whether constraints have subnormal entries, whose quotients may overflow."""
    return a is not None and bool(((a != 0) & (np.abs(a) < NORMAL)).any())


# ---- Redundant constraints -----------------------------------------------------------------------


@claim(
    "redundant-rows",
    "a row that others imply: same q̈, same aᵀλ, least |λ|",
    "",
    "redundant constraints",
    needs="constraints, and a formulation that solves a state",
)
def redundant_rows(at: Quantities, context: EvaluationContext) -> Iterator[Comparison | Skipped]:
    """With a redundant row added, a sum of the others, q̈ and aᵀλ stay and |λ| is least.

    λ is smallest where it is perpendicular to the null space of aᵀ: the new multiplier is the same
    sum of the others.
    """
    M, _, _, a, gamma, _ = at.terms
    if a is None:
        return
    for f, x in context.solutions:
        if not f.redundant or x.multipliers is None:
            continue
        weights, partition = context.added_row
        rows = np.concatenate((a, np.array([weights @ a], a.dtype)))
        drift = np.concatenate((gamma, np.array([weights @ gamma], gamma.dtype)))
        try:
            inputs = M, at.F, rows, drift, at.v, partition
            (vdot, lambda_), digits = at.call_solving("redundant rows", f.solution, *inputs)
        except RefusedError as refusal:
            yield Skipped(f.key, str(refusal))
            continue
        names, force = (at.scene.coordinate_names,), a.T @ x.multipliers
        sensitivity = sensitivity_where(digits)
        yield Comparison(f"{f.key}, q̈", vdot, x.vdot, names, None, sensitivity, may_vanish=True)
        scale = product_size(rows.T, lambda_)
        forces = rows.T @ lambda_, force
        yield Comparison(f"{f.key}, aᵀλ", *forces, names, scale, sensitivity, may_vanish=True)
        sides = lambda_[-1:], np.array([weights @ lambda_[:-1]], lambda_.dtype)
        size = product_size(lambda_)
        yield Comparison(f"{f.key}, |λ|", *sides, (("the new row",),), size, sensitivity)


# ---- Energy, and motions of the whole scene ------------------------------------------------------


def _energy_rate(energies: Callable, *state: Any) -> Any:
    """Return the rate of T + U, W, of a state in dual numbers."""
    T, U = energies(*state)
    return rate(T if U is None else T + U)


def _power_of_q(
    energies: Callable, parameters: Any, prepared: Any, rates: Any, *state: Array
) -> Any:
    """Return the share of q in Ṫ + U̇, W, from precomputed values, their rates, q and v."""
    return _energy_rate(energies, *_arguments_while_q_changes(parameters, prepared, rates, *state))


def _power_along(energies: Callable, *arguments: Any) -> Any:
    """Return the share of v in Ṫ + U̇, W, from (parameters, prepared, q, v, v̇)."""
    *constants, v, vdot = arguments
    return _energy_rate(energies, *as_objects(tuple(constants)), duals(v, vdot))


def _velocities_of_q(velocities: Callable, *arguments: Any) -> tuple[Array, Array]:
    """Return [V, ω] and the share of q in [V̇, ω̇]; see `_power_of_q`."""
    along_q = np.concatenate(velocities(*_arguments_while_q_changes(*arguments)), axis=1)
    return map_entries(value, along_q), rate(along_q)


def _velocities_along(velocities: Callable, *arguments: Any) -> Any:
    """Return the share of v in [V̇, ω̇] from (parameters, prepared, q, v, v̇)."""
    *constants, v, vdot = arguments
    return rate(np.concatenate(velocities(*as_objects(tuple(constants)), duals(v, vdot)), axis=1))


def _arguments_while_q_changes(
    parameters: Any, prepared: Any, rates: Any, q: Array, v: Array
) -> tuple:
    """Return arguments in dual numbers whose dual part is the rate of q, v constant."""
    return as_objects(parameters), map_record(duals, prepared, rates), duals(q, v), as_objects(v)


class _Rates:
    """Rates of the energy and of the bodies' velocities by automatic differentiation.

    Their shares from q̇ = v do not depend on v̇, and are the same for all formulations.
    """

    def __init__(self, e: Quantities):
        self._e = e

    def _along_v(self, function: Callable, scene_function: Callable, vdot: Array) -> Any:
        """Run a function on the scene's function at this state and v̇."""
        e = self._e
        return e.run(function, scene_function, e.parameters, e.prepared, e.q, e.v, vdot)

    def _along_q(self, function: Callable, scene_function: Callable) -> Any:
        """Run a function on the scene's function, with precomputed values and their rates."""
        e = self._e
        return e.run(function, scene_function, e.parameters, *e.prepared_and_rates(e.v), e.q, e.v)

    @cached_property
    def _power_of_q(self) -> Any:
        return self._along_q(_power_of_q, self._e.scene.energies)

    def power(self, vdot: Array) -> tuple[Any, Any]:
        """Return the shares of q and of v in d(T+U)/dt, W."""
        return self._power_of_q, self._along_v(_power_along, self._e.scene.energies, vdot)

    @cached_property
    def _velocities_of_q(self) -> tuple[Array, Array]:
        return self._along_q(_velocities_of_q, self._e.scene.velocities)

    def bodies(self, vdot: Array) -> Array:
        """Return [V, ω] and its shares of q and of v in [V̇, ω̇] of the bodies (3, n_b, d + e)."""
        along_v = self._along_v(_velocities_along, self._e.scene.velocities, vdot)
        parts = *self._velocities_of_q, along_v
        return np.stack([as_float64(x) for x in parts])


def _power_of_inertia(at: Evaluation, rates: Callable[[Evaluation], Array]) -> tuple[Any, Any]:
    """Return the sizes of the power of inertia forces, W: of its terms, and of theirs.

    The first is Σ |m V| |V̇| + Σ |ω| |I| |ω̇|, whose terms cancel in the power. The second adds to
    each entry of V, ω and their rates its largest change under perturbation divided by the step,
    since V may be a difference of larger terms itself.

    Args:
        at: the state.
        rates: function that returns `_Rates.bodies`.
    """

    def power(sizes: Array) -> Any:
        speed, change = sizes[0], sizes[1] + sizes[2]
        inertia = np.abs(at.parameters.inertia)
        e = round((inertia.size / len(speed)) ** 0.5)
        d = speed.shape[1] - e
        pushing = at.parameters.mass @ (speed[:, :d] * change[:, :d]).sum(axis=1)
        turning = inertia.reshape(len(speed), e, e) * change[:, None, d:]
        return pushing + (speed[:, d:, None] * turning).sum()

    with np.errstate(all="ignore"):
        exact = rates(at)
        try:
            sensitive = measured_entry_sensitivity(at, exact, rates(perturbed_samples(at)))
        except RefusedError:
            return power(np.abs(exact)), np.inf
        return power(np.abs(exact)), power(sensitive)


@claim(
    "power-balance",
    "d(T + U)/dt = -q̇ ∂R/∂q̇",
    "(25)-(26), (31)",
    "power balance",
    rate_of="all",
    needs="a scene that the clock does not drive, and a formulation that solves a state",
)
def power_balance(at: Quantities, context: EvaluationContext) -> Iterator[Comparison]:
    """Ideal constraints do no work: along each q̈ the energy decreases by the dampers' power."""
    rates_of, R = cache(_Rates), at.dissipation(duals(at.v, at.v))
    if not at.scene.conserves_energy and (R is None or at.terms.b is not None):
        return  # motion driven by the clock exchanges power that R does not contain
    for f, x in context.solutions:
        shares = (*rates_of(at).power(x.vdot), 0 if R is None else rate(R))
        rounding = (0.0, 0.0) if context.exact else _power_size(context, f, rates_of, shares)
        yield vanishing(f.key, sum(shares), (), *rounding)


def _power_size(
    case: Any, f: Formulation, rates_of: Callable[[Evaluation], _Rates], shares: tuple
) -> tuple[Any, Any]:
    """Return the size of the terms of the power, W, and κ · scale of their sum."""

    def power(e: Evaluation) -> float:
        return sum(rates_of(e).power(e.acceleration(f).vdot))

    def of_bodies(e: Evaluation) -> Array:
        return rates_of(e).bodies(e.acceleration(f).vdot)

    summed, summed_sensitivity = _power_of_inertia(case.at, of_bodies)
    terms, resolved = larger(largest(shares), summed), np.isfinite(case.vdot_sensitivity(f))
    if not batch_size(resolved) and not resolved:
        return terms, np.inf
    # Energies are summed over the bodies, which rounds as often.
    rounding = case.at.scene.n * (largest(shares) + summed_sensitivity) + _constraint_power(case, f)
    return terms, choose(resolved, case.sensitivity(power) + rounding, np.inf)


def _constraint_power(case: Any, f: Formulation) -> Any:
    """Return |λ|ᵀ |a| |v|, W: the size of the power of λ on the rounding of v in a v."""
    lambda_ = case.at.acceleration(f).multipliers
    return 0.0 if lambda_ is None else product_size(lambda_, case.at.terms.a, case.at.v)


@case_claim(
    "invariance",
    "q̈ moves with the scene",
    "(25)-(28)",
    "invariance",
    needs="a symmetry of the scene",
)
def invariance(case: Case) -> Iterator[Finding]:
    """Turning, shifting or mirroring the whole scene turns, shifts or mirrors q̈."""
    at = case.at
    for symmetry in at.scene.symmetries(at.q, at.v):
        mapped = Evaluation(symmetry.scene, symmetry.q, symmetry.v, at.t)
        longest = largest(np.abs(symmetry.image).sum(axis=1))
        for formulation in case.solved:
            try:
                actual = mapped.acceleration(formulation).vdot
            except RefusedError as refused:
                why = "skipped", "property-tested", f"refused after that: {refused}"
                yield case.finding(f"{symmetry.name}: {formulation.key}", 0.0, 0.0, *why)
                continue
            expected = symmetry.image @ at.acceleration(formulation).vdot
            # A turn adds to every angle, whose rounding then is that of larger numbers.
            turn = 1.0 + largest(symmetry.q - at.q) / max(largest(at.q), 1.0)
            sensitivity = (
                2 * longest * turn * case.part_sensitivity(formulation, "vdot", coordinates=True)
            )
            if not largest(actual - expected) <= allowed_error(sensitivity):
                # An angle of 0 has no rounding error to measure; the transformed angle has.
                try:
                    sensitivity += acceleration_sensitivity(mapped, formulation, coordinates=True)
                except RefusedError:
                    sensitivity = np.inf
            names = (at.scene.coordinate_names,)
            subject = f"{symmetry.name}: {formulation.key}"
            yield case.compare(subject, actual, expected, sensitivity, names=names)
