"""Engines on trial: what they answer in a state beside the scene's own, and whose fault it is.

Of our engines and a scene it is the scene that is judged: "found" is the scene's value. Of an
engine that somebody else wrote, "found" is what the engine says and "expected" the reference.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from eomcheck.claims.finding import Finding, resembles, told_apart, worst_of
from eomcheck.engines import (
    Answers,
    Engine,
    EngineFault,
    is_on_trial,
    kind_of,
    made,
    version_of,
)
from eomcheck.engines.answers import drift_size, inertia_size, mass_size, overflows, weight_size
from eomcheck.evaluation.tolerance import largest
from eomcheck.numbers.generic import Array

if TYPE_CHECKING:
    from eomcheck.claims.case import Case

UNABLE = (np.linalg.LinAlgError, EngineFault)

BETWEEN = 0.25
"""Share of the answers asked again before which the engine is asked at another state."""

FLOAT32 = 2.0**-19
"""A relative error below this, and above that of doubles, is one of single precision."""


def size_of(case: Case, engine: Engine, method: str) -> float:
    """Return the size of the terms that an engine may sum to an answer, where it cancels."""
    if method == "bias":
        own = 0.0 if is_on_trial(kind_of(engine)) else engine.bias_size(*case.state)
        return inertia_size(case.at) + own
    if method == "forces":
        return case.at.kept(weight_size)
    if method == "constraint_drift":
        return drift_size(case.at)
    if method != "mass_matrix" or not engine.offers("velocity_map"):
        return 0.0
    try:
        S = Answers(engine).velocity_map(case.at.q, np.zeros_like(case.at.v)).S
        return mass_size(case.at, S)
    except UNABLE:
        return 0.0


def answer(
    case: Case,
    engine: Engine | type[Engine],
    *arguments: Any,
    expected: Callable[[], Any],
    part: Callable[[Any], Any] = lambda said: said,
    excused: Callable[[], bool] = lambda: False,
) -> Any:
    """Return what the engine says of what the claim asks; else the Finding that it says nothing.

    An engine on trial is asked again and again: returned is the answer furthest from the scene's.

    Args:
        case: the state, and the claim that is looked at.
        engine: the engine, or its class if it could not be made.
        arguments: what its method is handed.
        expected: gives what is expected of `part`; None if nothing is known here.
        part: gives the quantity of an answer that is compared; None if the answer lacks it.
        excused: whether nothing could be judged here, whatever the answer.
    """
    assert case.claim is not None
    method, kind = case.claim.asks, kind_of(engine)
    if not kind.offers(method):
        return unseen(case, kind, f"it does not offer {method}")
    if isinstance(engine, type) and not is_on_trial(engine):
        return unseen(case, engine, f"not rational: {case.broken[engine]}")
    try:
        if isinstance(engine, type):
            raise EngineFault(case.broken[engine])
        answers = Answers(engine)
        if is_on_trial(kind):
            answers.disturb(method, *arguments)
            found = _answered(answers, method, arguments, case.asked_again)
            known = expected()
            return _worst(found, part, part(found[0]) if known is None else known)
        return answers.ask(method, *arguments)
    except EngineFault as fault:
        if isinstance(fault.__cause__, np.linalg.LinAlgError) and not is_on_trial(kind):
            return unseen(case, kind, fault.what)
        open_here = overflows(case.at) or excused()
        verdict = "inconclusive" if open_here else "failed"
        outcome = np.inf, 0.0, verdict, evidence_of(kind), f"{kind.__name__}: {fault.what}"
        return case.finding(kind.key, *outcome, engine=kind)


def _answered(answers: Answers, method: str, arguments: tuple, times: int) -> list[Any]:
    """Answers of an engine that is asked again and again, all of which are to be right.

    Calls at other states come in between, at irregular intervals, so that no period of calls
    passes by.

    Raises:
        EngineFault: one of them is no answer.
    """
    found = [answers.ask(method, *arguments)]
    random = np.random.default_rng(0)
    for k in range(times):
        if k == 0 or random.random() < BETWEEN:
            answers.ask_elsewhere(method, arguments, 1 + k % 7)
        found.append(answers.ask(method, *arguments))
    return found


def _worst(found: Sequence[Any], part: Callable[[Any], Any], expected: Any) -> Any:
    """Answer whose part is furthest from what is expected: the first one if all are alike."""
    worst, by = found[0], -1.0
    for one in found:
        quantity = part(one)
        if quantity is None or expected is None:
            continue  # what one answer lacks another may have
        apart = largest(np.asarray(quantity) - np.asarray(expected))
        if apart > by:
            worst, by = one, apart
    return worst


def unseen(case: Case, kind: type[Engine], why: str) -> Finding:
    """Return the Finding of what an engine does not tell, or of what cannot be compared."""
    outcome = 0.0, 0.0, "not looked at", evidence_of(kind), why
    return case.finding(kind.key, *outcome, engine=kind)


def evidence_of(kind: type[Engine]) -> str:
    """Return the level of evidence of a comparison, and what it rests on."""
    return f"compared: {version_of(kind)}"


def compared(
    case: Case,
    engine: Engine,
    subject: str,
    ours: Any,
    theirs: Any,
    sensitivity: float,
    again: Callable[[Answers], Any],
    *,
    names: Sequence[tuple[str, ...]],
    scale: float | None = None,
    sizes: Any = None,
    own: Callable[[], Any] | None = None,
) -> Finding:
    """Return the Finding of an answer being the scene's own.

    Args:
        case: the state, and the claim that is looked at.
        engine: the engine.
        subject: what is compared.
        ours: the scene's.
        theirs: the engine's, same shape.
        sensitivity: κ · scale of both computations together.
        again: asks the same once more.
        names: names along each axis.
        scale: size of what is compared, by default the largest entry of what is expected.
        sizes: of the terms of which each entry is a sum, where they are known.
        own: gives κ · scale of each entry of the scene's.
    """
    kind, tried = type(engine), is_on_trial(type(engine))
    found, expected = (theirs, ours) if tried else (ours, theirs)
    here = subject, found, expected, sensitivity
    how: dict[str, Any] = {"names": tuple(names), "scale": scale, "sizes": sizes}
    how |= {"evidence": evidence_of(kind), "own": own}
    finding = case.compare(*here, **how, engine=kind)
    if finding.verdict == "failed" and tried:
        try:
            fresh = again(Answers(made(kind, case.at.scene)))
        except Exception:
            return finding
        if largest(np.asarray(fresh) - np.asarray(ours)) <= finding.allowed:
            return finding.because("a new engine answers right: it keeps what it was asked before")
    return finding


def said_on_trial(kind: type[Engine], found: Array, expected: Array, allowed: float) -> str:
    """Return what is wrong with the worst entry of an engine on trial: both numbers, and a name.

    Of a library that reads a robot's file itself, nobody is blamed: both numbers, and whose.

    Args:
        kind: the engine.
        found: what it says.
        expected: what it should say, same shape.
        allowed: the error that rounding explains.
    """
    worst = worst_of(found - expected)
    what = resembles(found, expected, allowed, worst)
    x, y = told_apart(found[worst], expected[worst], 9)
    numbers = f"found {x}, expected {y}"
    if kind.reads_file:
        what = ""
        numbers = f"{x} by the library, {y} by eomcheck"
    if largest(found - expected) <= FLOAT32 * largest(expected):
        what = "as large as the rounding of single precision"
    return f"{numbers}: {what}" if what else numbers
