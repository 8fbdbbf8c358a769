"""Failing cases, shrunk, deduplicated by cause, stored and replayed.

A `FailureRecord` is a counterexample, a state at which a claim fails, as plain data: the scene's
parameters, or the description of a random scene; the state; the claim; and the part at fault. A
file (the corpus) keeps one of each cause. A failure is shrunk by hypothesis, then each of its
numbers is tried at 0, at 1 and with fewer digits. Replayed, a stored failure is checked again and
fails, holds, or stays undecided.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeVar

import numpy as np

from eomcheck.atomic_write import locked, read_text, write_text
from eomcheck.calls import is_ours
from eomcheck.claims import CLAIMS, Finding
from eomcheck.claims.finding import comparison_text, worst
from eomcheck.claims.reproducer import motion_reproducer, reproducer_of
from eomcheck.claims.run import (
    RunSelection,
    cause_of,
    diagnosis_of,
    is_same_failure,
    no_larger,
    sides_of,
    smallest_failure,
)
from eomcheck.claims.user_scenes import failing_function
from eomcheck.class_lookup import home_of_code, location_of
from eomcheck.descriptions.elements import Constraint, Joint, Link
from eomcheck.descriptions.random_mechanisms import RandomScene
from eomcheck.descriptions.random_trees import RandomDescription
from eomcheck.draws.fuzz_cases import FuzzCase
from eomcheck.engines import ALWAYS, ENGINES, engine_of, is_under_test
from eomcheck.errors import EomcheckError, InputError, described_error, message_of
from eomcheck.evaluation.dynamics import consistent_velocity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.fuzzing.motion_comparison import (
    MOTION_CLAIMS,
    TIGHT,
    MotionFinding,
    findings_of_motion,
)
from eomcheck.lab.fuzzing.screening import (
    Diagnosis,
    check_case,
    diagnose_failure,
    failed_findings,
    keys_in_subject,
    time_is_up,
)
from eomcheck.lab.store.validation_runs import check_types
from eomcheck.mechanics.parameters import settable
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene, finite_array
from eomcheck.numbers.generic import Array
from eomcheck.scene_lookup import is_robot, scene_classes_named
from eomcheck.testing.equations_of_files import FileEquations, equations_named
from eomcheck.testing.equations_of_motion import EquationsOfMotion
from eomcheck.testing.function_checks import FUNCTION_CLAIMS, check_functions_at

# ---- Scenes as plain data ------------------------------------------------------------------------


def plain_random(scene: RandomScene) -> dict[str, Any]:
    """Return the description of a random scene as lists, and its parameters that differ from it."""
    unchanged: Any = type(scene)()
    plain: dict[str, Any] = {"description": _listed(scene.source.description)}
    for name in settable(scene):
        x, y = getattr(scene, name), getattr(unchanged, name)
        if (x is None) != (y is None) or (x is not None and not np.array_equal(x, y)):
            plain[name] = None if x is None else np.asarray(x).tolist()
    return plain


def random_of(kind: type[RandomScene], plain: dict[str, Any]) -> RandomScene:
    """Return the random scene of a description as `plain_random` returns it.

    Raises:
        InputError: `plain` holds no description.
    """
    parameters = dict(plain)
    try:
        links, joints, constraints, gravity, first, pose = _tupled(parameters.pop("description"))
        description = RandomDescription(
            tuple(Link(*entry) for entry in links),
            tuple(Joint(*entry) for entry in joints),
            tuple(Constraint(*entry) for entry in constraints),
            *(gravity, first, pose),
        )
    except (TypeError, ValueError, KeyError) as error:
        raise InputError(f"no description of a random scene: {error}") from None
    scene = kind.of_description(description)()
    return scene.changed(**parameters) if parameters else scene


def _listed(x: Any) -> Any:
    if isinstance(x, tuple | list):
        return [_listed(one) for one in x]
    return x.item() if isinstance(x, np.generic) else x


def _tupled(x: Any) -> Any:
    return tuple(_tupled(one) for one in x) if isinstance(x, list) else x


def fuzz_case(
    kind: Any, parameters: dict[str, Any], q: Sequence[float], v: Sequence[float], t: float
) -> FuzzCase:
    """Return a case: functions, or a scene of parameters as `parameters_of` returns, in a state.

    Raises:
        InputError: the scene has no such parameters or refuses them, or it has no such state.
    """
    if isinstance(kind, EquationsOfMotion):
        scene: Any = kind
        return scene, State(finite_array("q", q, (kind.n,)), finite_array("v", v, (kind.p,)), t)
    if issubclass(kind, RandomScene):
        scene = random_of(kind, parameters)
    else:
        try:
            scene = kind(**parameters)
        except TypeError as error:  # an unknown name, or one too few
            raise InputError(
                f"{kind.key} of {', '.join(parameters)}: {message_of(error)}"
            ) from None
    position, velocity = scene.check_state(q, v, t)
    return scene, State(position, velocity, t)


def equations_of(name: str) -> FileEquations | None:
    """Return the equations of motion of a name, see `equations_named`; None for that of a scene.

    Args:
        name: path/to/file.py, path/to/file.py:NAME or package.module:NAME.

    Raises:
        InputError: no such file or module, it cannot be run, or n cannot be found.
    """
    return None if is_robot(name) else equations_named(name)


def functions_named(name: str) -> EquationsOfMotion | None:
    """Return the functions of a name, see `equations_of`."""
    read = equations_of(name)
    return None if read is None else read.equations


def parameters_of(scene: Any) -> dict[str, Any]:
    """Return the arguments that rebuild a scene, as plain data; none for functions.

    For a random scene these are its description and the parameters that differ from it.
    """
    if isinstance(scene, RandomScene):
        return plain_random(scene)
    return {} if isinstance(scene, EquationsOfMotion) else sampled_parameters(scene)


def sampled_parameters(scene: Any) -> dict[str, Any]:
    """Return the random arguments of a scene by name, as plain data; functions have none."""
    if isinstance(scene, EquationsOfMotion):
        return {}
    links = getattr(scene, "links", None) if scene.has_links else None
    values = {name: getattr(scene, name) for name in type(scene).ranges(links)}
    return {name: None if x is None else np.asarray(x).tolist() for name, x in values.items()}


# ---- Failures ------------------------------------------------------------------------------------

FUNCTIONS = "functions"
"""Part at fault of failures of user-supplied functions."""


@dataclass(frozen=True)
class FailureRecord:
    """A counterexample in plain data: a state at which a claim fails.

    Attributes:
        scene: key of the scene class, or its location: path/to/file.py:Class.
        parameters: arguments of the scene class.
        q: coordinates (n,).
        v: velocities (n,).
        t: time, s.
        claim: id of the claim; "" stands for all of them.
        subject: subject of the finding, such as formulations or an engine.
        observed: the error.
        allowed: the error that rounding explains.
        whose: the part at fault, see `eomcheck.lab.fuzzing.screening`.
        evidence: evidence that this part is at fault.
        detail: the finding's description of the error.
        why: a sentence by the author of the fix.
        t_end: end of a motion from this state, s; 0 for a failure of the state alone.
        engine: location of a user-supplied engine at fault: path/to/file.py:Class.
    """

    scene: str
    parameters: dict[str, Any]
    q: list[float]
    v: list[float]
    t: float = 0.0
    claim: str = ""
    subject: str = ""
    observed: float = 0.0
    allowed: float = 0.0
    whose: str = ""
    evidence: str = ""
    detail: str = ""
    why: str = ""
    t_end: float = 0.0
    engine: str = ""

    @property
    def key(self) -> tuple[str, ...]:
        """Key of the cause: scene, claim, formulations, part at fault, and diagnosis."""
        return self.scene, self.claim, " ".join(cause_of(self)), self.whose, diagnosis_of(self)

    @property
    def case(self) -> FuzzCase:
        """The scene and its state.

        Raises:
            EomcheckError: there is no such scene.
        """
        functions = functions_named(self.scene)
        kind = scene_classes_named(self.scene)[0] if functions is None else functions
        return fuzz_case(kind, self.parameters, self.q, self.v, self.t)

    @property
    def python(self) -> str:
        """Python code that reproduces the failure."""
        if self.t_end:
            return motion_reproducer(*self.case, self.t_end, self.subject, TIGHT)
        engines = [engine_of(self.engine)] if self.engine else []
        return reproducer_of(self.detail, *self.case, engines)

    def __str__(self) -> str:
        how = comparison_text(self.observed, self.allowed, self.detail, "")
        return f"{self.claim}, {self.subject}: {how}; {self.whose} ({self.evidence})"


def failure_record(finding: Finding, name: str, fault: Diagnosis | None = None) -> FailureRecord:
    """Return the record of a failed finding.

    Args:
        finding: the failure.
        name: name of the scene class.
        fault: the part at fault, by default the result of `diagnose_failure`.
    """
    scene, state = finding.scene, finding.state
    assert state is not None
    fault = diagnose_failure(finding) if fault is None else fault
    engine = finding.engine
    return FailureRecord(
        name,
        parameters_of(scene),
        state.q.tolist(),
        state.v.tolist(),
        float(state.t),
        finding.claim,
        finding.subject,
        float(finding.observed),
        float(finding.allowed),
        fault.at_fault,
        fault.evidence,
        finding.detail,
        t_end=finding.t_end if isinstance(finding, MotionFinding) else 0.0,
        engine="" if engine is None or not is_under_test(engine) else location_of(engine),
    )


# ---- The corpus file -----------------------------------------------------------------------------


def read_failures(path: Path) -> list[FailureRecord]:
    """Return the failures in a corpus file; none if there is no such file.

    Raises:
        InputError: the file cannot be read, or holds something else.
    """
    if not path.exists():
        return []
    try:
        rows = json.loads(read_text(path))
        if not isinstance(rows, list):
            raise TypeError("expected a list")
        return [_read(one) for one in rows]
    except (OSError, TypeError, KeyError, ValueError, RecursionError) as error:
        raise InputError(f"{str(path)!r} holds no failures: {message_of(error)}") from None


def _read(row: Any) -> FailureRecord:
    """Return the failure of a row of JSON.

    Raises:
        TypeError, ValueError: a field is missing, unknown, of another type, or not finite.
    """
    failure = FailureRecord(**row)
    check_types(failure)
    for name in ("q", "v", "t", "t_end"):
        finite_array(name, getattr(failure, name), np.shape(getattr(failure, name))[:1])
    if failure.t_end < 0.0:
        raise ValueError(f"t_end = {failure.t_end}, expected a time that is not negative")
    return failure


def write_failures(path: Path, failures: Iterable[FailureRecord]) -> None:
    """Write failures into a file, the first of each cause."""
    rows = [
        {k: x for k, x in asdict(one).items() if x != "" and not (k == "t_end" and x == 0.0)}
        for one in first_of_each_cause(failures)
    ]
    write_text(path, "[\n" + ",\n".join(json.dumps(row) for row in rows) + "\n]\n")


def add_failures(path: Path, failures: Iterable[FailureRecord]) -> None:
    """Add failures to those in a file; concurrent processes lose none.

    Raises:
        InputError: the file cannot be read.
        UnwrittenError: the file cannot be written.
    """
    with locked(path):
        write_failures(path, [*read_failures(path), *failures])


def first_of_each_cause(failures: Iterable[FailureRecord]) -> list[FailureRecord]:
    """Return the first failure of each cause."""
    first: dict[Any, FailureRecord] = {}
    for i, one in enumerate(failures):
        first.setdefault(one.key if one.claim else i, one)
    return list(first.values())


# ---- Shrinking -----------------------------------------------------------------------------------

MOST_TRIES = 150
"""Largest number of states checked while a failure is simplified."""

DIGITS = 0, 1, 2, 4, 8
"""Numbers of digits to which numbers are rounded, in this order; 0 stands for 0 and 1."""

F = TypeVar("F", bound=Finding)


def simplify(
    finding: F,
    simplifications: Iterable[Callable[[F], Iterable[F | None]]],
    check: Callable[[F], Sequence[F]],
    most: int = MOST_TRIES,
) -> F:
    """Return a failure simplified greedily, which fails in the same way (`is_same_failure`).

    Args:
        finding: the failure.
        simplifications: functions of a failure -> simpler ones in its place, the simplest first; a
            candidate is None where there is no such case. The first that fails is taken.
        check: returns the failures at the case of a candidate.
        most: largest number of candidates to check.
    """
    tries = 0
    for simpler in simplifications:
        for candidate in simpler(finding):
            if tries >= most or time_is_up():
                return finding
            tries += 1
            failures: Sequence[F] = ()
            with suppress(EomcheckError, np.linalg.LinAlgError):
                failures = () if candidate is None else check(candidate)
            smaller = next((x for x in failures if is_same_failure(x, finding)), None)
            if smaller is not None:
                finding = smaller
                break
    return finding


def simplify_numbers(finding: F, check: Callable[[F], Sequence[F]], most: int = MOST_TRIES) -> F:
    """Return a failure with rounder numbers: each is tried at 0, at 1 and with fewer digits."""
    numbers = [
        (name, i) for name, values in _numbers_of(finding).items() for i in range(values.size)
    ]
    rounder = [partial(_rounder, *one, digits) for digits in DIGITS for one in numbers]
    return simplify(finding, rounder, check, most)


def _numbers_of(finding: Finding) -> dict[str, Array]:
    """Return the numbers of a case by name: random parameters, q and v."""
    assert finding.state is not None
    parameters = sampled_parameters(finding.scene).items()
    numbers = {name: np.ravel(x) for name, x in parameters if x is not None}
    return numbers | {"q": finding.state.q, "v": finding.state.v}


def _rounder(name: str, i: int, digits: int, finding: F) -> Iterator[F | None]:
    """Yield a failure in whose place one number is rounder, and its velocity consistent again."""
    numbers = _numbers_of(finding)[name]
    x = float(numbers[i])
    for y in (0.0, 1.0) if digits == 0 else (float(f"{x:.{digits - 1}e}"),):
        if y == x:
            continue
        values = np.array(numbers)
        values[i] = y
        try:
            yield _with_numbers(finding, name, values)
        except (EomcheckError, np.linalg.LinAlgError):
            yield None


def _with_numbers(finding: F, name: str, values: Array) -> F:
    scene, state = finding.scene, finding.state
    assert state is not None
    if name in ("q", "v"):
        state = state._replace(**{name: values})
    else:
        parameters = sampled_parameters(scene)
        parameters[name] = values.reshape(np.shape(parameters[name])).tolist()
        scene = type(scene)(**parameters)
    if isinstance(scene, Scene):
        with np.errstate(all="ignore"):
            state = state._replace(v=consistent_velocity(Evaluation(scene, *state), state.v))
    return replace(finding, scene=scene, state=state)


def shrink(finding: Finding, formulations: Sequence[str], seed: int = 0) -> Finding:
    """Return a failure of the same claim about the same formulations, smaller and rounder.

    Smaller cases are searched by hypothesis, then each number is tried at 0, at 1 and with fewer
    digits. A failure of an engine is returned as it is: each try would construct the engine again.
    So is one of a scene of which a function raises: it may in every case that is drawn.
    """
    scene, state = finding.scene, finding.state
    assert isinstance(scene, Scene) and state is not None
    own = not is_ours(type(scene))
    if CLAIMS[finding.claim].asks or (own and failing_function(scene, state)):
        return finding
    selection = RunSelection.of(formulations, [], [finding.claim], scenes=[type(scene)])
    links = (1, getattr(scene, "links", 1))
    finding = smallest_failure(finding, no_larger(scene, links), selection, seed, time_is_up)

    def failures(candidate: Finding) -> list[Finding]:
        assert candidate.state is not None
        case = candidate.scene, candidate.state
        return failed_findings(case, [candidate.claim], formulations)

    return simplify_numbers(finding, failures)


def alike(failed: Finding, case: FuzzCase, formulations: Sequence[str]) -> list[Finding]:
    """Return the failures at another case that are the same, see `is_same_failure`."""
    if CLAIMS[failed.claim].asks:
        return []
    failures = failed_findings(case, [failed.claim], formulations)
    return [one for one in failures if is_same_failure(one, failed)]


# ---- Replay --------------------------------------------------------------------------------------

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
        allowed: names of scenes and engines whose code may be imported, see `runs_code`; None for
            all.
    """
    results = []
    for failure in failures:
        results.append(_replayed(failure, formulations, allowed))
        advance()
    return results


def runs_code(name: str) -> tuple[str, str] | None:
    """Return the file or module that a name of a scene or engine imports, and the name in it.

    None if it imports none.

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
    for option, name in (("--scene", one.scene), ("--engine", one.engine)):
        code = runs_code(name)
        if allowed is not None and code is not None and code not in map(runs_code, allowed):
            reason = f"it runs code of {code[0]}, which is imported with {option} {name} only"
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
        return finding.claim == one.claim and sides_of(finding) == sides_of(one)

    if isinstance(scene, EquationsOfMotion):
        claims = _claims(one, FUNCTION_CLAIMS)
        return check_functions_at(scene, state, claims), same if one.claim else lambda finding: True
    if one.t_end:
        _claims(one, MOTION_CLAIMS)
        return findings_of_motion((scene, state), formulations, one.t_end), same
    claims = _claims(one, CLAIMS)
    engines: Sequence[str] = keys_in_subject(one.subject, ENGINES) if one.claim else ALWAYS
    engines = [one.engine] if one.engine else engines
    # Any failure of the claim counts: a fault may appear in another subject now.
    return check_case((scene, state), claims, formulations, engines), lambda finding: True


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
        if one.claim in ("", x.claim) and (not one.subject or sides_of(x) == sides_of(one))
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
