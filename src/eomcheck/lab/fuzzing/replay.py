"""Replay of stored failures: each is checked again and fails, holds, or stays undecided."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from pathlib import Path
from typing import Literal, NamedTuple

from eomcheck.claims import CLAIMS, Finding
from eomcheck.claims.finding import worst
from eomcheck.class_lookup import home_of_code
from eomcheck.engines import ALWAYS, ENGINES
from eomcheck.errors import EomcheckError, described_error, message_of
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.fuzzing.failures import FUNCTIONS, FailureRecord, failure_record
from eomcheck.lab.fuzzing.motion_comparison import MOTION_CLAIMS, findings_of_motion
from eomcheck.lab.fuzzing.screening import Diagnosis, check_case, keys_in_subject
from eomcheck.scene_lookup import is_robot
from eomcheck.testing.equations_of_motion import EquationsOfMotion
from eomcheck.testing.function_checks import FUNCTION_CLAIMS, check_functions_at

ReplayOutcome = Literal["failed", "holds", "inconclusive", "not checked"]


class ReplayResult(NamedTuple):
    """The outcome of a stored failure that is checked again.

    Attributes:
        failure: the failure; where it still fails, with the error observed now.
        outcome: "failed"; "holds": its claim was decided for its subject and holds; "inconclusive":
            it was computed and could not be decided; "not checked": it could not be computed.
        reason: reason why it was not decided, "" where it was.
    """

    failure: FailureRecord
    outcome: ReplayOutcome
    reason: str = ""


def replay_failures(
    failures: Iterable[FailureRecord],
    formulations: Sequence[str],
    advance: Callable[[], None] = lambda: None,
    allowed: Collection[str] | None = None,
) -> list[ReplayResult]:
    """Check stored failures again, in their order.

    Args:
        failures: the stored failures.
        formulations: keys of the formulations that take part.
        advance: called after each.
        allowed: names of scenes whose code may be imported, see `runs_code`; None for all.
    """
    results = []
    for failure in failures:
        results.append(_replayed(failure, formulations, allowed))
        advance()
    return results


def runs_code(name: str) -> tuple[str, str] | None:
    """Return the file or module that a scene's name imports, and the name in it; None if none.

    Files are resolved, so that two paths of one file are equal.
    """
    code = None if is_robot(name) else home_of_code(name)
    if code is None:
        return None
    home, attribute = code
    return (str(Path(home).resolve()) if home.endswith(".py") else home), attribute


def _replayed(
    one: FailureRecord, formulations: Sequence[str], allowed: Collection[str] | None
) -> ReplayResult:
    code = runs_code(one.scene)
    if allowed is not None and code is not None and code not in map(runs_code, allowed):
        reason = f"it runs code of {code[0]}, which is imported with --scene {one.scene} only"
        return ReplayResult(one, "not checked", reason)
    try:
        findings, wanted = _findings(one, formulations)
    except EomcheckError as error:
        return ReplayResult(one, "not checked", message_of(error))
    except Exception as error:  # of the code that the failure names
        return ReplayResult(one, "not checked", f"raises {described_error(error)}")
    failed = [x for x in findings if x.verdict == "failed" and wanted(x)]
    if failed:
        fault = Diagnosis(one.whose, one.evidence) if one.t_end or one.whose == FUNCTIONS else None
        return ReplayResult(failure_record(failed[0], one.scene, fault), "failed")
    return _undecided(one, findings, formulations)


def _findings(
    one: FailureRecord, formulations: Sequence[str]
) -> tuple[Sequence[Finding], Callable[[Finding], bool]]:
    """Return the findings at a stored failure's state, and the predicate of those it fails by."""
    scene, state = one.case

    def same(finding: Finding) -> bool:
        return finding.claim == one.claim and _sides(finding) == _sides(one)

    if isinstance(scene, EquationsOfMotion):
        claims = _claims(one, FUNCTION_CLAIMS)
        return check_functions_at(scene, state, claims), same if one.claim else lambda finding: True
    if one.t_end:
        _claims(one, MOTION_CLAIMS)
        return findings_of_motion((scene, state), formulations, one.t_end), same
    claims = _claims(one, CLAIMS)
    engines = keys_in_subject(one.subject, ENGINES) if one.claim else ALWAYS
    # Any failure of the claim counts: a fault may appear in another subject now.
    return check_case((scene, state), claims, formulations, engines), lambda finding: True


def _sides(one: FailureRecord | Finding) -> list[str]:
    """Return the sides of a subject such as "au ~ im", sorted."""
    return sorted(one.subject.split(" ~ "))


def _claims(one: FailureRecord, known: Collection[str]) -> list[str]:
    if one.claim and one.claim not in known:
        raise EomcheckError(f"there is no claim {one.claim!r} about it")
    return [one.claim] if one.claim else list(known)


def _undecided(
    one: FailureRecord, findings: Sequence[Finding], formulations: Sequence[str]
) -> ReplayResult:
    """Return the result where nothing fails: "holds" only where the same subject was decided."""
    about = [
        x
        for x in findings
        if one.claim in ("", x.claim) and (not one.subject or _sides(x) == _sides(one))
    ]
    if not about:
        absent = [x for x in keys_in_subject(one.subject, FORMULATIONS) if x not in formulations]
        why = (
            f"{', '.join(absent)} takes no part" if absent else f"nothing is about {one.subject!r}"
        )
        return ReplayResult(one, "not checked", why)
    # Of all claims some are undecided in any state. A single claim holds if all of it is decided.
    inconclusive = [x for x in about if one.claim and x.verdict == "inconclusive"]
    chosen = worst(inconclusive or about)
    if chosen.verdict == "passed":
        return ReplayResult(one, "holds")
    outcome: ReplayOutcome = "not checked" if chosen.verdict == "skipped" else "inconclusive"
    sizes = f"observed {chosen.observed:.3g}, allowed {chosen.allowed:.3g}"
    return ReplayResult(one, outcome, f"{chosen.subject}: {chosen.detail or sizes}")
