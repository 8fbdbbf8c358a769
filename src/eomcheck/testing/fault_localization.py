"""Fault localization: the wrong function, from all claims that failed and passed.

A claim that fails shows that one of the functions it reads is wrong, its suspects. The functions
that are suspects of all failures explain them at once, except those that are cleared by a claim
that passes. Where several are left, the inputs that would distinguish them are named. The parity in
v of the residual of the equations of motion excludes more suspects: a wrong gravity leaves a
residual that is constant in v, a damper an odd one, the bias one that is even and vanishes at rest,
the mass matrix one of the parity of the acceleration.

Where a claim about the bias failed, its wrong terms are named by polarization: B is a quadratic
form in v, so that its values at v = e_i and e_i + e_j give all coefficients at one q.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple, TypeVar

import numpy as np

from eomcheck.claims.confusions import MISSING, agreement_within, scaling
from eomcheck.claims.finding import EVERY_ROW, Finding, format_distinct
from eomcheck.claims.registry import FUNCTION_CLAIMS
from eomcheck.evaluation.tolerance import C
from eomcheck.numbers.generic import Array
from eomcheck.testing.called_functions import called_functions
from eomcheck.testing.claims_derivatives import EXCHANGED
from eomcheck.testing.claims_motions import FOLLOWS, is_nonzero
from eomcheck.testing.claims_terms import row_names
from eomcheck.testing.equations_of_motion import INPUTS, BrokenError, EquationsOfMotion
from eomcheck.testing.function_state import (
    REST_ENERGY,
    FunctionState,
    bias_along,
    bias_of_energy,
    bias_of_inertia,
    inertia,
    supplied_or_derived_bias,
)
from eomcheck.testing.uncertain import UncertainArray, exact

# ---- Polarization of the bias --------------------------------------------------------------------

LISTED = 3
"""Largest number of wrong terms, and of claims in a sentence, that are listed by name."""

CONSTANT = "the difference does not depend on v"
SCALES = 0.0, 1.0, -1.0, 2.0
"""Multiples of v at which the dependence of a quantity on v is measured."""


OfV = Callable[[Array], UncertainArray | None]
R = TypeVar("R")


class Term(NamedTuple):
    """Coefficient of v_i v_j in one row.

    Attributes:
        row: index of the row.
        i, j: indices of the velocities, i ≤ j.
        got: the coefficient.
        expected: expected value of the coefficient.
        allowed: largest difference that the errors of both explain.
    """

    row: int
    i: int
    j: int
    got: float
    expected: float
    allowed: float

    @property
    def name(self) -> str:
        """Name of the product."""
        return f"v[{self.i}]²" if self.i == self.j else f"v[{self.i}] v[{self.j}]"

    @property
    def is_wrong(self) -> bool:
        """Whether it differs by more than the errors explain."""
        return abs(self.got - self.expected) > self.allowed


def wrong_terms(failed: Finding, at: FunctionState) -> str:
    """Return the wrong terms where a claim about the bias failed, as text; "" for any other claim.

    Args:
        failed: a failure.
        at: state at which it failed.
    """
    pair = _bias_sides(failed.claim, at)
    if pair is None or EVERY_ROW in failed.detail:
        return ""
    terms = _value_or(lambda: _bias_terms(*pair, at), [])
    if terms is None:
        return CONSTANT
    wrong = sorted(filter(lambda x: x.is_wrong, terms), key=lambda x: -abs(x.got - x.expected))
    texts = list(dict.fromkeys(_term_text(term, wrong, row_names(at)) for term in wrong))
    more = f"; {len(texts) - LISTED} more terms" if len(texts) > LISTED else ""
    return "; ".join(texts[:LISTED]) + more


def _bias_terms(actual: OfV, expected: OfV, at: FunctionState) -> list[Term] | None:
    """Return the terms of both sides of a bias; None where they differ by a constant alone."""
    v = np.where(at.v < 0.0, -1.0, 1.0) * at.width_v  # not small, unlike v near rest
    off, sound = (_parities(side, v) for side in (_difference(actual, expected), expected))
    if off.constant and not (off.odd or off.even):
        return None
    if off.constant or off.odd or sound.constant or sound.odd:
        actual, expected = _quadratic_part(actual), _quadratic_part(expected)
    return list(_terms(actual, expected, at.width_v))


def _value_or(function: Callable[[], R], otherwise: R) -> R:
    """Return function(), or `otherwise` where a function breaks or a matrix is singular."""
    try:
        with np.errstate(all="ignore"):
            return function()
    except (BrokenError, np.linalg.LinAlgError):
        return otherwise


def _bias_sides(claim: str, at: FunctionState) -> tuple[OfV, OfV] | None:
    """Return both sides of a claim as functions of v; None where they are not quadratic in v."""
    if at.functions.qdot is not None:
        return None
    supplied: OfV = lambda v: at.with_velocity(v).B()  # noqa: E731
    match claim:
        case "bias-of-mass-matrix":
            return supplied, lambda v: bias_along(at, v)
        case "bias-of-energy":
            return supplied, lambda v: bias_of_energy(at.with_velocity(v))
        case "coriolis-bias":
            expected = (
                supplied if at.has("bias") else (lambda v: bias_of_inertia(at.with_velocity(v)))
            )
            return lambda v: at.with_velocity(v).quantity("C") @ exact(v), expected
    return None


class VelocityDependence(NamedTuple):
    """Parities in v of a quantity: whether it has constant, odd, and even nonconstant terms."""

    constant: bool
    odd: bool
    even: bool

    @property
    def text(self) -> str:
        """Dependence of the residual of motion on v, "" where it is of several kinds."""
        kinds = {
            (True, False, False): "constant in v: a force",
            (False, True, False): "odd in v: damping",
            (False, False, True): "even in v, 0 at rest: bias",
        }
        return kinds.get((self.constant, self.odd, self.even), "")


def velocity_dependence(values: Sequence[UncertainArray]) -> VelocityDependence:
    """Return the parities in v of a quantity from its values at `SCALES` times v."""
    at_rest, ahead, behind, _ = values
    odd, even = ahead - behind, ahead + behind - 2.0 * at_rest
    return VelocityDependence(*(bool(is_nonzero(x).any()) for x in (at_rest, odd, even)))


def _parities(function: OfV, v: Array) -> VelocityDependence:
    """Return the parities of a function of v; even, as of a bias, where it has no value."""
    values = [x for x in (function(scale * v) for scale in SCALES) if x is not None]
    return (
        velocity_dependence(values)
        if len(values) == len(SCALES)
        else VelocityDependence(False, False, True)
    )


def _difference(x: OfV, y: OfV) -> OfV:
    """Return the function x - y, None where one of them has no value."""

    def difference(v: Array) -> UncertainArray | None:
        x_value, y_value = x(v), y(v)
        return None if x_value is None or y_value is None else x_value - y_value

    return difference


def _quadratic_part(function: OfV) -> OfV:
    """Return the part of a function that is even in v, without the constant."""

    def part(v: Array) -> UncertainArray | None:
        ahead, back, at_rest = function(v), function(-v), function(0.0 * v)
        if ahead is None or back is None or at_rest is None:
            return None
        return 0.5 * (ahead + back) - at_rest

    return part


def coefficients(function: OfV, widths: Array) -> dict[tuple[int, int], UncertainArray]:
    """Return the coefficients of a quadratic form in v.

    Args:
        function: function of v that is quadratic in it.
        widths: size of each velocity at which it is evaluated (p,).

    Returns:
        (i, j) -> coefficient of v_i v_j in each row (p,), i ≤ j; {} if there is no value.
    """
    axes, products = np.diag(widths), {}
    for i, axis in enumerate(axes):
        value = function(axis)
        if value is None:
            return {}
        products[i, i] = value
        for j in range(i):
            of_both = function(axis + axes[j])
            assert of_both is not None
            products[j, i] = of_both - products[i, i] - products[j, j]
    return {(i, j): (1.0 / (widths[i] * widths[j])) * x for (i, j), x in products.items()}


def _terms(actual: OfV, expected: OfV, widths: Array) -> Iterator[Term]:
    """Yield the terms that both functions have."""
    actual_terms, expected_terms = coefficients(actual, widths), coefficients(expected, widths)
    for (i, j), got in actual_terms.items():
        if (i, j) in expected_terms:
            wanted = expected_terms[i, j]
            errors = C * (got.error + wanted.error)
            numbers = zip(got.value, wanted.value, errors, strict=True)
            for row, (x, y, allowed) in enumerate(numbers):
                yield Term(row, i, j, float(x), float(y), float(allowed))


def _term_text(term: Term, wrong: list[Term], names: tuple[str, ...]) -> str:
    """Return a description of a wrong term, with the term that stands in its place, if any."""
    got, expected, near = term.got, term.expected, term.allowed
    beside = [x for x in wrong if x.row == term.row and x is not term]
    for x, y in ((term, neighbour) for neighbour in beside):
        lost, extra = (x, y) if abs(x.got) <= x.allowed else (y, x)
        is_moved = abs(extra.got - extra.expected - lost.expected) <= lost.allowed + extra.allowed
        if abs(lost.got) <= lost.allowed < abs(lost.expected) and is_moved:
            diagnosis = f"missing, {extra.name} in its place"
            return f"row {names[lost.row]}, {lost.name}: {diagnosis}: {lost.expected:.6g}"
    numbers = "got {}, expected {}".format(*format_distinct(got, expected))
    if abs(expected) <= near:
        return f"row {names[term.row]}, {term.name}: should vanish: got {got:.6g}"
    if diagnosis := scaling(got, expected, agreement_within(near)):
        numbers = f"expected {expected:.6g}" if diagnosis == MISSING else numbers
        return f"row {names[term.row]}, {term.name}: {diagnosis}: {numbers}"
    return f"row {names[term.row]}, {term.name}: {numbers}"


# ---- Failures and suspects -----------------------------------------------------------------------

READS: dict[str, tuple[str, ...]] = {
    "bias-of-mass-matrix": ("qdot",),
    "bias-power": ("qdot",),
    "coriolis-bias": ("qdot",),
    "gravity-of-potential": ("qdot",),
    "constraint-jacobian": ("qdot",),
    "constraint-velocity": ("b",),
    "constraint-drift": ("b", "qdot"),
    "constraint-acceleration": ("gamma|a", "b", "qdot"),
    "motion": ("bias|C|M|T", "gravity|U", "R", "Q", "qdot"),
    "power-balance": ("gravity|U", "R", "Q", "qdot"),
    "inverse-dynamics": ("bias|C|M|T", "gravity|U", "R", "Q", "qdot"),
    "inverse-dynamics-by-position": ("qdot",),
    "acceleration-by-position": ("qdot",),
    "regressor-parameters": ("qdot",),
    "regressor-power": ("qdot",),
    "com-jacobian": ("qdot",),
    "com-rate": ("qdot",),
    "com-gravity": ("com_jacobian|qdot",),
    "com-kinetic-energy": ("com_jacobian|qdot",),
    "com-acceleration": ("qdot",),
    "momentum-rate": ("qdot",),
    "frame-jacobian": ("qdot",),
    "frame-rate": ("qdot",),
    "frame-bias": ("qdot",),
    "frame-acceleration": ("qdot",),
}
"""Claim -> functions it reads beside those it needs, if they are given; of "x|y" the first one."""

OF_THE_REFERENCE = {"forces": ("gravity|U", "R", "Q")}
"""Quantity compared with a reference -> functions it reads; others read those of `FOLLOWS`."""

SETTLES: dict[str, tuple[str, ...]] = {
    "bias-of-mass-matrix": ("bias",),
    "coriolis-bias": ("bias",),
    "gravity-of-potential": ("gravity", "U"),
    "kinetic-energy": ("M", "T"),
    "bias-of-energy": ("bias",),
    "constraint-jacobian": ("a", "c"),
    "constraint-velocity": ("c",),
    "constraint-drift": ("gamma", "b"),
    "constraint-acceleration": ("gamma",),
    "motion": ("M", "bias", "C", "gravity", "U", "R", "Q", "a"),
    "inverse-dynamics": ("inverse_dynamics", "M", "bias", "C", "gravity", "U", "R", "Q"),
    "inverse-dynamics-acceleration": ("inverse_dynamics", "qdd"),
    "inverse-dynamics-by-position": ("inverse_dynamics", "tau_q"),
    "inverse-dynamics-by-velocity": ("inverse_dynamics", "tau_v"),
    "acceleration-by-position": ("qdd", "qdd_q"),
    "acceleration-by-velocity": ("qdd", "qdd_v"),
    "acceleration-by-force": ("qdd", "qdd_tau"),
    "acceleration-force-mass": ("qdd_tau", "M", "inverse_mass_matrix"),
    "acceleration-inverse-position": ("qdd_q", "tau_q"),
    "acceleration-inverse-velocity": ("qdd_v", "tau_v"),
    "inverse-mass-matrix": ("inverse_mass_matrix", "M"),
    "regressor-parameters": ("regressor", "parameters"),
    "com-jacobian": ("com", "com_jacobian"),
    "com-velocity": ("com_velocity", "com_jacobian"),
    "com-rate": ("com", "com_velocity"),
    "com-acceleration": ("com_velocity", "com_jacobian", "com_acceleration"),
    "com-momentum": ("mass", "com_velocity", "com_jacobian"),
    "mass-parameters": ("mass",),
    "momentum-matrix": ("momentum", "momentum_matrix"),
    "momentum-rate": ("momentum", "momentum_rate"),
    "com-momentum-rate": ("mass", "com_acceleration"),
    "frame-jacobian": ("J", "frame_placement"),
    "frame-velocity": ("J", "frame_velocity"),
    "frame-rate": ("frame_velocity", "frame_placement"),
    "frame-bias": ("frame_bias", "frame_velocity"),
    "frame-acceleration": ("frame_acceleration", "frame_velocity"),
    "frame-acceleration-bias": ("frame_acceleration", "frame_bias"),
}
"""Claim -> functions that are right if it passes, unless two are wrong in the same way."""


CONFIRMED_BY: dict[str, tuple[str, ...]] = {
    "qdd": ("motion", "acceleration-force", "constraint-acceleration"),
    "inverse_dynamics": ("inverse-dynamics",),
}
"""Function -> the claims that together compare all of it; those without their inputs are not."""


class Conflict(NamedTuple):
    """Failure and its suspects.

    Attributes:
        finding: the failure.
        suspects: functions, keys of `INPUTS`, at least one of which is wrong.
        read: all functions that the claim reads, also those that alone would not explain it.
    """

    finding: Finding
    suspects: frozenset[str]
    read: frozenset[str]


class Blame(NamedTuple):
    """Conclusion about the causes of failures.

    Attributes:
        causes: functions, keys of `INPUTS`, of which one is wrong.
        certain: whether there is only one.
        conflicts: the failures it explains.
        settled: claims that pass and clear other suspects of the first failure.
    """

    causes: tuple[str, ...]
    certain: bool
    conflicts: tuple[Conflict, ...]
    settled: tuple[str, ...]


def localize_faults(
    functions: EquationsOfMotion, findings: list[Finding], points: Sequence[FunctionState]
) -> list[Finding]:
    """Return the Findings with the conclusion in the first failure, the others folded under it.

    Verdicts, order and numbers are unchanged. Nothing is computed where nothing failed.

    Args:
        functions: the functions.
        findings: Findings of all claims.
        points: states at which they were judged.
    """
    failed = [finding for finding in findings if finding.verdict == "failed"]
    if not failed:
        return findings
    at = {(x.q.tobytes(), x.v.tobytes()): x for x in points}
    where = {
        id(finding): at.get((finding.state.q.tobytes(), finding.state.v.tobytes()))
        for finding in failed
        if finding.state is not None
    }
    calls = called_functions({name: functions.function(name) for name in functions.given})
    confirmed = {
        name: claims
        for name, claims in confirmed_by(findings, points[0]).items()
        if not any(calls[name] & functions_read(functions, claim) for claim in claims)
    }
    conflicts = []
    for finding in failed:
        names = suspects(functions, finding, where.get(id(finding)))
        if not names & {*confirmed}:
            names = names & exchanged_functions(finding.detail) or names
        read = functions_read(functions, finding.claim, finding.subject)
        conflicts.append(Conflict(finding, names, read))
    changed: dict[int, Finding] = {}
    unsettled = unsettled_by([x for x in (points[0], *where.values()) if x is not None])
    unsettled |= unsettled_by_calls(functions, calls)
    conflicts = with_called_suspects(conflicts, calls, settled_by(findings, unsettled))
    for blame in blames_of(findings, conflicts, unsettled, confirmed):
        own = [finding.finding for finding in blame.conflicts]
        cause = " or ".join(blame.causes)
        polarized = ""
        for finding in own:
            term = _wrong_terms_of_cause(blame, finding, where.get(id(finding)), polarized)
            polarized = polarized or (term if finding.claim != "motion" else "")
            detailed = finding.because(term) if term else finding
            changed[id(finding)] = replace(
                detailed, cause=cause, follows="" if finding is own[0] else own[0].claim
            )
        text, head = sentence(functions, blame, points[0], calls), changed[id(own[0])]
        about = "T" in blame.causes or ("bias" in blame.causes and not blame.certain)
        energy = rest_energy(where.get(id(own[0]))) if about else ""
        if energy:
            text = f"{text}; {energy}" if text else energy
        if text:
            changed[id(own[0])] = replace(head, detail=f"{text}; {head.detail}")
    return [changed.get(id(finding), finding) for finding in findings]


def _wrong_terms_of_cause(
    blame: Blame, failed: Finding, at: FunctionState | None, polarized: str
) -> str:
    """Return the wrong terms where a failure is about a cause in `blame`, as text; "" once known.

    Args:
        blame: the conclusion.
        failed: a failure that it explains.
        at: state of the failure, or None.
        polarized: text about an earlier failure, "" if there is none.
    """
    if at is None:
        return ""
    if failed.claim == "motion":
        return "" if "off by" in failed.detail else _residual_parity_text(at)
    if polarized or not {"bias", "C", "T"} & {*blame.causes}:
        return ""
    term = wrong_terms(failed, at)
    return term if term == CONSTANT or {"bias", "C"} & {*blame.causes} else ""


# ---- Suspects ------------------------------------------------------------------------------------


def read_by(functions: EquationsOfMotion, names: Iterable[str]) -> frozenset[str]:
    """Return the given functions that are read for quantities, of "x|y" the first one."""
    given: set[str] = set()
    for name in names:
        for alternative in name.split("|"):
            if functions.function(alternative) is not None:
                given.add(alternative)
                break
            if alternative == "gravity" and functions.bias_has_gravity:
                given.add("bias")
                break
    if functions.bias_has_gravity and "bias" in given and functions.gravity is not None:
        given.add("gravity")
    return frozenset(given)


def functions_read(functions: EquationsOfMotion, claim: str, subject: str = "") -> frozenset[str]:
    """Return the functions that a claim reads, about a subject.

    Args:
        functions: the functions.
        claim: id, a key of `FUNCTION_CLAIMS`.
        subject: subject of a Finding.
    """
    about, registered = subject.split(" ~ ")[0], FUNCTION_CLAIMS[claim]
    if claim == "reference":
        more = f"|{FOLLOWS[about]}" if about in FOLLOWS else ""
        return read_by(functions, OF_THE_REFERENCE.get(about, (f"{about}{more}",)))
    needs = [name for name in registered.needs if name not in ("factory", "against", "tau")]
    if not needs:
        return frozenset({about} & {*INPUTS})
    state = ("a", "b", "c") if registered.consistent else ()
    return read_by(functions, (*needs, *READS.get(claim, ()), *state))


def suspects(
    functions: EquationsOfMotion, failed: Finding, at: FunctionState | None
) -> frozenset[str]:
    """Return the functions of which one is wrong where a claim fails.

    Args:
        functions: the functions.
        failed: the failure.
        at: state at which it fails, None if it is unknown.
    """
    names = functions_read(functions, failed.claim, failed.subject)
    if failed.claim != "motion" or at is None:
        return names
    if _bias_follows_from_T(at):
        names |= {"T"}
    return _value_or(lambda: names & _suspects_by_parity(at, names), names) or names


def unsettled_by_calls(
    functions: EquationsOfMotion, calls: Mapping[str, frozenset[str]]
) -> set[tuple[str, str]]:
    """Return pairs (claim, function) that are not settled because one function calls the other.

    A claim that reads both passes whatever the called one returns.

    Args:
        functions: the functions.
        calls: see `called_functions`.
    """
    pairs: set[tuple[str, str]] = set()
    for claim in SETTLES:
        read = functions_read(functions, claim)
        for caller, called in calls.items():
            if caller in read and called & read:
                pairs |= {(claim, name) for name in (caller, *called)}
    return pairs


SOLVED_BY_OTHERS = "qdd", "inverse_dynamics"
"""Functions that hold the equations of motion, and usually call the functions of their terms."""


def with_called_suspects(
    conflicts: Sequence[Conflict], calls: Mapping[str, frozenset[str]], settled: Collection[str]
) -> list[Conflict]:
    """Return conflicts with the functions that a suspect calls, where other failures suspect these.

    Args:
        conflicts: the failures.
        calls: see `called_functions`.
        settled: functions that are right, and so are those that they call.
    """
    callers = [x for x in SOLVED_BY_OTHERS if x in calls and x not in settled]
    wider = []
    for k, conflict in enumerate(conflicts):
        elsewhere = {x for other in (*conflicts[:k], *conflicts[k + 1 :]) for x in other.suspects}
        called = {x for caller in callers if caller in conflict.suspects for x in calls[caller]}
        more = (called & elsewhere) - conflict.read  # read directly, they are judged already
        wider.append(conflict._replace(suspects=conflict.suspects | more))
    return wider


def exchanged_functions(detail: str) -> frozenset[str]:
    """Return the two functions that are exchanged according to the detail of a failure, if any.

    Each holds what the other should: what both are compared with agrees with both, and is right.
    """
    *_, text = detail.split(": ")
    first, _, other = text.removesuffix(EXCHANGED).partition(" and ")
    names = frozenset({first, other})
    return names if text.endswith(EXCHANGED) and names <= {*INPUTS} else frozenset()


def residual(at: FunctionState) -> UncertainArray | None:
    """Return M q̈ + B + g + ∂R/∂v - Q in the directions that constraints leave.

    None if B is unknown.
    """
    B = supplied_or_derived_bias(at)
    if B is None:
        return None
    remaining = inertia(at) @ at.quantity("qdd") + B - at.forces()
    return exact(at.free().T) @ remaining if at.has("a") else remaining


def _measured_residuals(at: FunctionState) -> tuple[list[FunctionState], list[UncertainArray]]:
    """Return states at `SCALES` times v that keep the constraints, and the residual at each.

    Both lists are empty where v cannot be scaled, or no force is given.
    """
    state = at.consistent()
    if state is None or not state.parts() or state.has("b"):
        return [], []
    points = [state.with_velocity(scale * state.v) for scale in SCALES]
    values = [x for x in map(residual, points) if x is not None]
    return (points, values) if len(values) == len(SCALES) else ([], [])


def _residual_parity_text(at: FunctionState) -> str:
    """Return the parity in v of the residual of `motion`, as text; "" if it has several."""

    def dependence() -> str:
        _, values = _measured_residuals(at)
        return velocity_dependence(values).text if values else ""

    text = _value_or(dependence, "")
    return f"the difference is {text}" if text else ""


def _suspects_by_parity(at: FunctionState, names: frozenset[str]) -> frozenset[str]:
    """Return the suspects among `names` that explain the parity of the `motion` residual."""
    points, values = _measured_residuals(at)
    if not values:
        return names
    state = points[1]
    observed = velocity_dependence(values)
    qdd = velocity_dependence([x.quantity("qdd") for x in points])
    free = exact(state.free().T) if state.has("a") else exact(np.eye(len(state.v)))
    parts = {name: [free @ x.parts()[name] for x in points] for name in state.parts()}
    only = [name for name, force in parts.items() if _is_proportional(values, force)]
    damping = (
        velocity_dependence(parts["damping"])
        if "damping" in parts
        else VelocityDependence(False, True, False)
    )
    loads = (
        velocity_dependence(parts["Q"]) if "Q" in parts else VelocityDependence(True, False, False)
    )
    energy_at_rest = {"T"} if state.rest_energy_changes() else set()
    explains = {
        "bias": VelocityDependence(bool(energy_at_rest), False, True),
        "C": VelocityDependence(False, False, True),
        "gravity": VelocityDependence(True, False, False),
        "U": VelocityDependence(True, False, False),
        "R": VelocityDependence(damping.constant, True, damping.even),
        "Q": VelocityDependence(True, loads.odd, loads.even),
    }
    explaining = set()
    for name in names:
        can = explains.get(name, VelocityDependence(True, True, True))
        if name == "T" and "T" in energy_at_rest:
            explaining.add(name)
            continue
        if name in ("M", "T"):
            even = qdd.even or not (state.has("bias") or state.has("C"))
            can = VelocityDependence(qdd.constant, qdd.odd, even)
            if (qdd.constant and not observed.constant) or (qdd.odd and not observed.odd):
                continue
        if all(present <= able for present, able in zip(observed, can, strict=True)):
            explaining.add(name)
    if only:
        named = {"Q": {"Q"}, "gravity": {"gravity", "U", "bias"}, "damping": {"R"}}
        explaining &= ({"qdd"} | energy_at_rest).union(*(named[name] for name in only))
    return frozenset(explaining)


def _bias_follows_from_T(at: FunctionState) -> bool:
    """Return whether B in the equations of motion is that of T, and T is not quadratic in v.

    Then M lacks terms of T.
    """
    function = at.functions.function
    return function("T") is not None and function("bias") is None and not _is_natural(at)


def _is_natural(at: FunctionState) -> bool:
    """Return whether T is quadratic in v; True where it has no value."""
    return _value_or(at.natural, True)


def unsettled_by(points: Sequence[FunctionState]) -> set[tuple[str, str]]:
    """Return pairs (claim, function) that are not settled where T is not quadratic in v.

    M = ∂²T/∂v² is independent of other terms of T, which may be the potential energy; a bias that
    agrees with T then includes gravity. With terms linear in v the system is driven by time, and M
    alone does not determine B.
    """
    if all(map(_is_natural, points)):
        return set()
    pairs = {("kinetic-energy", "T"), ("bias-of-energy", "bias")}
    even = all(point.even() for point in points if not _is_natural(point))
    return pairs if even else pairs | {("bias-of-mass-matrix", "bias")}


def rest_energy(at: FunctionState | None) -> str:
    """Return the reason why T is suspect at rest, "" for none."""
    if at is None or _is_natural(at):
        return ""
    with np.errstate(all="ignore"):
        return REST_ENERGY if at.rest_energy_changes() else ""


def _is_proportional(values: Sequence[UncertainArray], part: Sequence[UncertainArray]) -> bool:
    """Return whether a residual is one multiple of a force at all velocities."""
    residuals, force = (np.concatenate([np.ravel(x.value) for x in y]) for y in (values, part))
    square = float(force @ force)
    if square == 0.0 or np.count_nonzero(np.abs(force) > 1e-3 * np.abs(force).max()) < 2:
        return False
    factor = float(residuals @ force) / square
    error = sum(np.concatenate([np.ravel(x.error) for x in y]) for y in (values, part))
    return bool((np.abs(residuals - factor * force) <= C * (1.0 + abs(factor)) * error).all())


# ---- Conclusions ---------------------------------------------------------------------------------


def blames_of(
    findings: list[Finding],
    conflicts: list[Conflict],
    unsettled: Set[tuple[str, str]] = frozenset(),
    confirmed: Mapping[str, tuple[str, ...]] = MappingProxyType({}),
) -> list[Blame]:
    """Return the conclusions: the fewest functions that explain all failures.

    A failure with a single suspect that is not confirmed makes that one certain. Among other
    failures the causes are the common suspects of all that are not explained yet, without those
    settled by a claim that passes.

    Args:
        findings: Findings of all claims.
        conflicts: the failures.
        unsettled: see `settled_by`.
        confirmed: see `confirmed_by`.
    """
    settled, blames = settled_by(findings, unsettled), []
    left = [x.suspects - {*confirmed} or x.suspects for x in conflicts]
    certain = {name for names in left if len(names) == 1 for name in names}
    order = list(INPUTS).index
    for name in sorted(certain, key=order):
        own = [x for x in conflicts if min(x.read & certain, key=order, default="") == name]
        if own:
            others = [x for x in INPUTS if x in own[0].suspects - {name} and x in confirmed]
            passed = dict.fromkeys(claim for other in others for claim in confirmed[other])
            blames.append(Blame((name,), True, tuple(own), tuple(passed)))
    unexplained = [x for x in conflicts if x.suspects and not x.read & certain]
    while unexplained:
        common, own = unexplained[0].suspects, []
        for conflict in unexplained:
            if common & conflict.suspects:
                common &= conflict.suspects
                own.append(conflict)
        causes = common - {*settled} or common
        cleared_names = (own[0].suspects - causes) & {*settled}
        cleared = tuple(dict.fromkeys(settled[x] for x in INPUTS if x in cleared_names))
        ordered = tuple(x for x in INPUTS if x in causes)
        blames.append(Blame(ordered, len(causes) == 1, tuple(own), cleared))
        unexplained = [conflict for conflict in unexplained if conflict not in own]
    return blames


def confirmed_by(findings: list[Finding], at: FunctionState) -> dict[str, tuple[str, ...]]:
    """Return the functions that are confirmed: claims that compare all of them pass everywhere.

    A function that is only settled may be wrong in a part that the claim does not compare.

    Args:
        findings: Findings of all claims.
        at: one of the states.

    Returns:
        function -> the claims that confirm it.
    """
    verdicts: dict[str, set[str]] = {}
    for finding in findings:
        verdicts.setdefault(finding.claim, set()).add(finding.verdict)
    confirmed: dict[str, tuple[str, ...]] = {}
    for name, claims in CONFIRMED_BY.items():
        applied = tuple(claim for claim in claims if FUNCTION_CLAIMS[claim].applies(at))
        passed = all(verdicts.get(claim) == {"passed"} for claim in applied)
        if claims[0] in applied and passed:
            confirmed[name] = applied
    return confirmed


def settled_by(
    findings: list[Finding], unsettled: Set[tuple[str, str]] = frozenset()
) -> dict[str, str]:
    """Return the functions that are settled: cleared by a claim that passes.

    Args:
        findings: Findings of all claims.
        unsettled: pairs (claim, function) that are not settled, see `unsettled_by`.

    Returns:
        function -> the first claim that passes and settles it.
    """
    failed = {
        (x.claim, x.claim == "reference" and x.subject) for x in findings if x.verdict == "failed"
    }
    settled: dict[str, str] = {}
    for finding in findings:
        about = finding.claim == "reference"
        if finding.verdict != "passed" or (finding.claim, about and finding.subject) in failed:
            continue
        names = functions_read(finding.scene, finding.claim, finding.subject)
        for name in names if about else names & {*SETTLES.get(finding.claim, ())}:
            if (finding.claim, name) in unsettled:
                continue
            settled.setdefault(name, finding.claim)
    return settled


def sentence(
    functions: EquationsOfMotion,
    blame: Blame,
    at: FunctionState,
    calls: Mapping[str, frozenset[str]] = MappingProxyType({}),
) -> str:
    """Return the conclusion as a sentence, "" where the first failure already holds all of it.

    Args:
        functions: the functions.
        blame: the conclusion.
        at: one of the states.
        calls: see `called_functions`; named where it is why a cause is not cleared.
    """
    named = [
        INPUTS[x].what if INPUTS[x].what == x else f"{INPUTS[x].what} {x}" for x in blame.causes
    ]
    failing = tuple(dict.fromkeys(conflict.finding.claim for conflict in blame.conflicts))
    if blame.certain:
        if len(blame.conflicts[0].suspects) == 1:
            return ""  # such as gravity that raises, whatever fails because of it
        text = f"{named[0]} is wrong: {_claims_text(failing, 'fail')}"
        text = f"{text}, {_claims_text(blame.settled, 'pass')}" if blame.settled else text
        return f"{text}{_nearest_detail(blame)}"
    inputs = distinguishing_inputs(functions, blame.causes, at)
    text = f"{' or '.join(named)} is wrong"
    text = f"{text}: {inputs} would tell" if inputs else text
    if len(blame.causes) > 1:
        for caller in sorted(calls.keys() - {*blame.causes}, key=list(INPUTS).index):
            if called := [x for x in blame.causes if x in calls[caller]]:
                return f"{text}; {caller} calls {' and '.join(called)}, and repeats any mistake"
    return text


def _nearest_detail(blame: Blame) -> str:
    """Return the detail of the first failure about the cause itself, unless it is the head."""
    subject = f"{INPUTS[blame.causes[0]].what}, "
    for conflict in blame.conflicts:
        if conflict.finding.detail.startswith(subject):
            text = f"; {conflict.finding.claim}: {conflict.finding.detail.removeprefix(subject)}"
            return "" if conflict is blame.conflicts[0] else text
    return ""


def _claims_text(claims: Sequence[str], verb: str) -> str:
    """Return the names of a few claims and a verb, as text."""
    names, more = [*claims[:LISTED]], len(claims) - LISTED
    if more > 0:
        names.append(f"{more} more")
    joined = f"{', '.join(names[:-1])} and {names[-1]}" if len(names) > 1 else names[0]
    third = "passes" if verb == "pass" else f"{verb}s"
    return f"{joined} {third if len(names) == 1 else verb}"


TELL = "T", "U", "M", "bias", "gravity", "c", "a", "gamma", "qdd"
"""Inputs that may distinguish suspects, in the order in which they are named."""

TELL_MORE = "inverse_dynamics", "com_velocity", "com", "momentum", "frame_velocity", "J"
"""Inputs that may distinguish suspects beside those that the equations of motion consist of."""

CONSTRAINTS = "a", "b", "c", "gamma"
"""Inputs without which there are no constraints."""

INERTIA, SPEEDS = frozenset({"M", "T"}), frozenset({"bias", "C"})


def distinguishing_inputs(
    functions: EquationsOfMotion, causes: Sequence[str], at: FunctionState
) -> str:
    """Return the inputs that are not given and would distinguish the causes, as text."""
    constrained = any(functions.function(x) is not None for x in CONSTRAINTS)
    basic = {*list(INPUTS)[: list(INPUTS).index("qdot") + 1]}
    names = [
        x
        for x in (TELL if basic >= {*causes} else (*TELL, *TELL_MORE))
        if functions.function(x) is None
        and (constrained or x not in CONSTRAINTS)
        and not (x == "gravity" and functions.bias_has_gravity)
        and _distinguishes(functions, x, {*causes})
    ]
    if not at.has("against"):
        names.append("against")
    return f"{', '.join(names[:-1])} or {names[-1]}" if len(names) > 1 else "".join(names)


def _distinguishes(functions: EquationsOfMotion, name: str, causes: set[str]) -> bool:
    """Return whether a claim that needs one more function reads some of the causes and not all."""
    if name == "qdd" and causes & INERTIA and causes & SPEEDS:
        return True  # M leaves a residual of the parity of q̈, the bias one that is even in v
    wider = replace(functions, **{name: lambda *_: None})
    for id, claim in FUNCTION_CLAIMS.items():
        if "against" in claim.needs:
            continue
        names = functions_read(wider, id)
        applies = all(
            any(wider.function(x) is not None for x in need.split("|")) for need in claim.needs
        )
        excluded = any(wider.function(x) is not None for x in claim.without)
        if applies and not excluded and name in names and 0 < len(names & causes) < len(causes):
            return True
    return False
