"""Triage of suspects: judged by `eomcheck.check_state` alone, and the part at fault diagnosed.

At fault is a formulation whose error exceeds its own bound (a silent error), the check (a false
alarm), an engine, the scene, or a refusal that should not be. Errors are measured against certified
values in ball arithmetic; identities are tested in a finite field (polynomial identity testing),
where nothing is rounded.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence
from contextlib import suppress
from functools import lru_cache
from typing import NamedTuple

from eomcheck.claims import CLAIMS, Finding
from eomcheck.claims.proof import prove
from eomcheck.claims.run import check_state
from eomcheck.draws.fuzz_cases import FuzzCase
from eomcheck.engines import Engine, is_under_test
from eomcheck.errors import EomcheckError, InputError
from eomcheck.evaluation.certified import REFERENCE_DIGITS, enclose, true_error
from eomcheck.evaluation.dynamics import acceleration
from eomcheck.evaluation.tolerance import NOTICEABLE, UNDERFLOW, largest
from eomcheck.formulations import FORMULATIONS
from eomcheck.mechanics.scene import Scene

SILENT, ALARM, ENGINE, SCENE, REFUSAL, UNKNOWN = (
    "silent error",
    "false alarm",
    "engine",
    "scene",
    "refusal",
    "not told",
)
"""Parts at fault: a formulation, whose error exceeds its bound; the check, which allows too little
(a false positive); an engine; the scene; a refusal that should not be; or not known."""


class Diagnosis(NamedTuple):
    """The part at fault of a failure, with the evidence."""

    at_fault: str
    evidence: str


def failed_findings(
    case: FuzzCase,
    claims: Iterable[str],
    formulations: Sequence[str],
    engines: Sequence[str | type[Engine]] = (),
) -> list[Finding]:
    """Return the findings of `eomcheck.check_state` at one state that failed."""
    findings = check_case(case, claims, formulations, engines)
    return [one for one in findings if one.verdict == "failed"]


def check_case(
    case: FuzzCase,
    claims: Iterable[str],
    formulations: Sequence[str],
    engines: Sequence[str | type[Engine]] = (),
) -> list[Finding]:
    """Return the findings of `eomcheck.check_state` at one state."""
    scene, (q, v, t) = case
    applicable = [key for key in formulations if FORMULATIONS[key].applies_to(scene)]
    options = {"formulations": applicable, "engines": list(engines), "claims": sorted(set(claims))}
    return check_state(scene, q, v, t, consistent=False, **options)


def diagnose_failure(finding: Finding) -> Diagnosis:
    """Return the part at fault of a failure.

    The true acceleration is enclosed in ball arithmetic for every formulation of the finding's
    subject; identities are tested in a finite field, where nothing is rounded.
    """
    claim = CLAIMS[finding.claim]
    if finding.claim == "refusals":
        return Diagnosis(REFUSAL, finding.detail)
    scene, state = finding.scene, finding.state
    assert isinstance(scene, Scene) and state is not None
    silent, errors = [], []
    for key in formulations_about(finding) or tuple(FORMULATIONS):
        with suppress(EomcheckError, TypeError):
            answer = acceleration(scene, key, *state, consistent=False)
            truth = enclose(scene, key, state.q, t=state.t, digits=REFERENCE_DIGITS, v=state.v)
            error = largest(true_error(answer.vdot, truth))
            size = largest(truth.doubles())
            bound = max(answer.error_bound, UNDERFLOW)
            summary = f"{key}: true error {error:.2g} of {size:.2g}, bound {answer.error_bound:.2g}"
            errors.append(summary)
            if error > bound:
                silent.append(f"{summary}{', noticeable' if error > NOTICEABLE * size else ''}")
    if silent:
        return Diagnosis(SILENT, f"enclosed: {'; '.join(silent)}")
    under_test = finding.engine is not None and is_under_test(finding.engine)
    wrong = frozenset() if under_test else unproved(scene)
    if wrong is None:
        return Diagnosis(UNKNOWN, "the scene's functions are not rational: nothing is proved")
    if claim.asks and not wrong:
        why = "; ".join(errors[:2]) or "no formulation answers"
        return Diagnosis(
            ENGINE, f"{'the engine on trial' if under_test else 'an engine'}; enclosed: {why}"
        )
    if wrong:
        return Diagnosis(SCENE, f"not proved either: {', '.join(sorted(wrong))}")
    return Diagnosis(ALARM, f"identities proved; enclosed: {'; '.join(errors) or 'no formulation'}")


def formulations_about(finding: Finding) -> tuple[str, ...]:
    """Return the keys of formulations in the subject of a finding."""
    return keys_in_subject(finding.subject, FORMULATIONS)


def keys_in_subject(subject: str, keys: Container[str]) -> tuple[str, ...]:
    """Return the keys among `keys` that a subject names, in its order."""
    words = subject.replace("~", " ").replace(",", " ").replace(":", " ").split()
    return tuple(word for word in words if word in keys)


def unproved(scene: Scene) -> frozenset[str] | None:
    """Return the claims disproved for the structure of `scene`; None if none can be proved."""
    return _unproved(_Same(scene, (type(scene), scene.structure)))


class _Same(NamedTuple):
    scene: Scene
    which: tuple

    def __hash__(self) -> int:
        return hash(self.which)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and self.which == other.which


@lru_cache(64)
def _unproved(same: _Same) -> frozenset[str] | None:
    try:
        findings = prove(same.scene, points=1, seed=0)
    except InputError:
        return None
    if not any(one.proof is not None for one in findings):
        return None
    return frozenset(one.claim for one in findings if one.verdict == "failed")
