"""Failing cases, shrunk, deduplicated by cause and stored for replay.

A `FailureRecord` is a state at which a claim fails, as plain data: the scene's parameters, or the
description of a random scene; the state; the claim; and the part at fault. A file (the corpus)
keeps one of each cause. A failure is shrunk by hypothesis, then each of its numbers is tried at 0,
at 1 and with fewer digits.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from eomcheck.atomic_write import locked, read_text, write_text
from eomcheck.claims import CLAIMS, Finding
from eomcheck.claims.finding import EVERY_ROW
from eomcheck.claims.reproducer import reproducer_code
from eomcheck.claims.run import RunSelection, no_larger, smallest_failure
from eomcheck.class_lookup import object_named
from eomcheck.descriptions.elements import Constraint, Joint, Link
from eomcheck.descriptions.random_elements import RandomDescription
from eomcheck.descriptions.random_mechanisms import RandomScene
from eomcheck.descriptions.robot_files import is_robot
from eomcheck.errors import EomcheckError, InputError, message_of
from eomcheck.evaluation.dynamics import consistent_velocity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.fuzzing.cases import FuzzCase
from eomcheck.lab.fuzzing.motion_comparison import MotionFinding, python_of_motion
from eomcheck.lab.fuzzing.triage import (
    Diagnosis,
    diagnose_failure,
    failed_findings,
    formulations_about,
)
from eomcheck.mechanics.parameters import settable
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene, finite_array
from eomcheck.numbers.generic import Array
from eomcheck.scene_lookup import scene_classes_named
from eomcheck.scenes import SCENES
from eomcheck.testing.equations_of_motion import EquationsOfMotion

# ---- Scenes as plain data ------------------------------------------------------------------------


def plain_random(scene: RandomScene) -> dict[str, Any]:
    """Return the description of a random scene as lists, and the parameters that were changed."""
    usual: Any = type(scene)()
    found: dict[str, Any] = {"description": _listed(scene.source.description)}
    for name in settable(scene):
        x, y = getattr(scene, name), getattr(usual, name)
        if (x is None) != (y is None) or (x is not None and not np.array_equal(x, y)):
            found[name] = None if x is None else np.asarray(x).tolist()
    return found


def random_of(kind: type[RandomScene], plain: dict[str, Any]) -> RandomScene:
    """Return the scene that `plain_random` wrote down.

    Raises:
        InputError: it is no description.
    """
    given = dict(plain)
    try:
        links, joints, constraints, gravity, first, pose = _tupled(given.pop("description"))
        description = RandomDescription(
            tuple(Link(*one) for one in links),
            tuple(Joint(*one) for one in joints),
            tuple(Constraint(*one) for one in constraints),
            *(gravity, first, pose),
        )
    except (TypeError, ValueError, KeyError) as error:
        raise InputError(f"no description of a random scene: {error}") from None
    scene = kind.of_description(description)()
    return scene.changed(**given) if given else scene


def _listed(x: Any) -> Any:
    if isinstance(x, tuple | list):
        return [_listed(one) for one in x]
    return x.item() if isinstance(x, np.generic) else x


def _tupled(x: Any) -> Any:
    return tuple(_tupled(one) for one in x) if isinstance(x, list) else x


def fuzz_case(
    kind: Any, parameters: dict[str, Any], q: Sequence[float], v: Sequence[float], t: float
) -> FuzzCase:
    """Return the scene that `parameters_of` is of, or functions, in a state.

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
        except TypeError as error:  # another name, or one too few
            raise InputError(
                f"{kind.key} of {', '.join(parameters)}: {message_of(error)}"
            ) from None
    position, velocity = scene.check_state(q, v, t)
    return scene, State(position, velocity, t)


@lru_cache(16)
def functions_named(name: str) -> EquationsOfMotion | None:
    """Return the `eomcheck.testing.EquationsOfMotion` that a name stands for, None if it is a
    scene's.

    Args:
        name: path/to/file.py:NAME or package.module:NAME.

    Raises:
        InputError: no such file or module, or it cannot be run.
    """
    found = None if is_robot(name) else object_named(name)
    return found if isinstance(found, EquationsOfMotion) else None


def parameters_of(scene: Any) -> dict[str, Any]:
    """Return what makes a scene again, plain; functions need nothing.

    Of a random one that is its description, and what of it was changed.
    """
    if isinstance(scene, RandomScene):
        return plain_random(scene)
    return {} if isinstance(scene, EquationsOfMotion) else sampled_parameters(scene)


def sampled_parameters(scene: Any) -> dict[str, Any]:
    """Return the arguments of a scene that are drawn, by name, plain; functions have none."""
    if isinstance(scene, EquationsOfMotion):
        return {}
    links = getattr(scene, "links", None) if scene.has_links else None
    values = {name: getattr(scene, name) for name in type(scene).ranges(links)}
    return {name: None if x is None else np.asarray(x).tolist() for name, x in values.items()}


# ---- Failures ------------------------------------------------------------------------------------

FUNCTIONS = "functions"
"""Whose fault what fails of somebody's functions is."""


@dataclass(frozen=True)
class FailureRecord:
    """A state at which a claim fails, ready to be kept.

    Attributes:
        scene: key of the kind of scene, or where it is found: path/to/file.py:Class.
        parameters: its arguments.
        q: coordinates (n,).
        v: velocities (n,).
        t: time, s.
        claim: id of the claim; "" stands for all of them.
        subject: what it is about.
        observed: the error.
        allowed: what rounding explains.
        whose: whose fault it is, see `eomcheck.lab.fuzzing.triage`.
        evidence: how that is known.
        detail: what the finding says is wrong.
        why: a sentence by whoever mended it.
        t_end: where a motion from this state ends, s; 0 where it is about the state alone.
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

    @property
    def key(self) -> tuple[str, ...]:
        """What tells causes apart: scene, claim, formulations, fault, and what is wrong."""
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
        """Python code that shows it again."""
        if self.t_end:
            return python_of_motion(*self.case, self.t_end, self.subject)
        return reproducer_code(*self.case)

    def __str__(self) -> str:
        how = f"observed {self.observed:.3g}, allowed {self.allowed:.3g}"
        return f"{self.claim}, {self.subject}: {how}; {self.whose} ({self.evidence})"


def cause_of(one: FailureRecord | Finding) -> list[str]:
    """Return the words of a subject that tell causes apart: formulations, or the engine alone."""
    words = one.subject.replace("~", " ").replace(":", " ").split()
    if one.claim in CLAIMS and CLAIMS[one.claim].asks:
        words = [word for word in words if word not in FORMULATIONS]
    return sorted(words)


def diagnosis_of(one: FailureRecord | Finding) -> str:
    """Diagnosis in a detail that tells causes apart; "" if none, or if it holds numbers."""
    found = one.detail.rpartition(": ")[2] if ": " in one.detail else ""
    found = found.removesuffix(EVERY_ROW)  # in all that do not vanish in this state
    return "" if any(c.isdigit() for c in found) else found


def failure_record(finding: Finding, name: str, fault: Diagnosis | None = None) -> FailureRecord:
    """Return what to keep of a failure.

    Args:
        finding: the failure.
        name: of the kind of scene.
        fault: whose fault it is, by default what `diagnose_failure` says.
    """
    scene, state = finding.scene, finding.state
    assert state is not None
    fault = diagnose_failure(finding) if fault is None else fault
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
    )


def lookup_name(kind: type[Scene], asked: str) -> str:
    """Return the name under which a kind of scene is found again: its key, or what was asked."""
    return kind.key if SCENES.get(kind.key) is kind else asked


# ---- The corpus file -----------------------------------------------------------------------------


def read_failures(path: Path) -> list[FailureRecord]:
    """Return the finds in a file.

    Raises:
        InputError: it cannot be read, or holds something else.
    """
    if not path.exists():
        return []
    try:
        rows = json.loads(read_text(path))
        if not isinstance(rows, list):
            raise TypeError("expected a list")
        return [_read(one) for one in rows]
    except (OSError, TypeError, KeyError, ValueError, RecursionError) as error:
        raise InputError(f"{str(path)!r} holds no finds: {message_of(error)}") from None


KINDS = {"float": (int, float), "str": str, "dict[str, Any]": dict, "list[float]": list}
"""Annotation of a field of `FailureRecord` -> what it may be in JSON."""


def _read(one: Any) -> FailureRecord:
    """A failure of its row.

    Raises:
        TypeError, ValueError: a field is missing, unknown, of another type, or not finite.
    """
    if not isinstance(one, dict):
        raise TypeError(f"{one!r}, expected names and values")
    if unknown := set(one) - set(FailureRecord.__dataclass_fields__):
        raise ValueError(f"unknown: {', '.join(sorted(unknown))}")
    for name, value in one.items():
        kind = KINDS[FailureRecord.__annotations__[name]]
        if not isinstance(value, kind) or isinstance(value, bool):
            raise TypeError(f"{name} = {value!r}, expected {FailureRecord.__annotations__[name]}")
    find = FailureRecord(**one)
    for name in ("q", "v"):
        finite_array(name, getattr(find, name), (len(getattr(find, name)),))
    for name in ("t", "t_end"):
        finite_array(name, getattr(find, name), ())
    if find.t_end < 0.0:
        raise ValueError(f"t_end = {find.t_end}, expected a time that is not negative")
    return find


def write_failures(path: Path, finds: Iterable[FailureRecord]) -> None:
    """Write finds into a file, those of one cause once."""
    kept = [
        {k: x for k, x in asdict(one).items() if x != "" and not (k == "t_end" and x == 0.0)}
        for one in first_of_each_cause(finds)
    ]
    write_text(path, "[\n" + ",\n".join(json.dumps(one) for one in kept) + "\n]\n")


def add_failures(path: Path, finds: Iterable[FailureRecord]) -> None:
    """Add finds to those in a file; two processes that do so at once lose none.

    Raises:
        InputError: the file cannot be read.
        UnwrittenError: it cannot be written.
    """
    with locked(path):
        write_failures(path, [*read_failures(path), *finds])


def first_of_each_cause(finds: Iterable[FailureRecord]) -> list[FailureRecord]:
    """Return the first find of each cause."""
    found: dict[Any, FailureRecord] = {}
    for i, one in enumerate(finds):
        found.setdefault(one.key if one.claim else i, one)
    return list(found.values())


# ---- Rounder numbers -----------------------------------------------------------------------------

MOST_TRIES = 150
"""States looked at while numbers are made round."""

F = TypeVar("F", bound=Finding)


def simplify_numbers(
    finding: F, check: Callable[[FuzzCase], Sequence[F]], most: int = MOST_TRIES
) -> F:
    """Return a failure about the same subject, with rounder numbers.

    Args:
        finding: the failure.
        check: returns the failures of its claim at another case.
        most: other cases that are looked at, at most.
    """
    tries = 0
    for digits in (0, 1, 2, 4, 8):
        for part in _parts(finding):
            for i in range(part.size):
                scene, state = finding.scene, finding.state
                assert state is not None
                here = _parts(finding)
                same = next(one for one in here if one.name == part.name)
                x = float(same.values[i])
                for y in _rounder(x, digits):
                    if y == x or tries >= most:
                        continue
                    tries += 1
                    finding = _tried(finding, same, i, y, check) or finding
                    if finding.scene is not scene or finding.state is not state:
                        break
    return finding


def _rounder(x: float, digits: int) -> list[float]:
    return [0.0, 1.0] if digits == 0 else [float(f"{x:.{digits - 1}e}")]


@dataclass
class _Part:
    name: str
    values: Array

    @property
    def size(self) -> int:
        return self.values.size


def _parts(finding: Finding) -> list[_Part]:
    scene, state = finding.scene, finding.state
    assert state is not None
    found = [
        _Part(name, np.ravel(x)) for name, x in sampled_parameters(scene).items() if x is not None
    ]
    return [*found, _Part("q", state.q), _Part("v", state.v)]


def _tried(
    finding: F, part: _Part, i: int, y: float, look: Callable[[FuzzCase], Sequence[F]]
) -> F | None:
    """Return the failure with one number replaced, None where it does not fail there."""
    scene, state = finding.scene, finding.state
    assert state is not None
    values = part.values.copy()
    values[i] = y
    try:
        if part.name in ("q", "v"):
            state = state._replace(**{part.name: values})
        else:
            given = sampled_parameters(scene)
            given[part.name] = values.reshape(np.shape(given[part.name])).tolist()
            scene = type(scene)(**given)
        if isinstance(scene, Scene):
            with np.errstate(all="ignore"):
                at = Evaluation(scene, *state)
                state = state._replace(v=consistent_velocity(at, state.v))
        found = look((scene, state))
    except (EomcheckError, np.linalg.LinAlgError):
        return None
    return next((one for one in found if one.subject == finding.subject), None)


# ---- Shrinking -----------------------------------------------------------------------------------


def shrink(finding: Finding, formulations: Sequence[str], seed: int = 0) -> Finding:
    """Return a failure of the same claim about the same formulations, smaller and rounder.

    Smaller ones are looked for by hypothesis, then each number is tried at 0, at 1 and with fewer
    digits. What an engine says is left as it is: each try would make the engine again.
    """
    scene = finding.scene
    assert isinstance(scene, Scene)
    selection = RunSelection.of(formulations, [], [finding.claim], scenes=[type(scene)])
    if not CLAIMS[finding.claim].asks:
        links = (1, getattr(scene, "links", 1))
        smaller = smallest_failure(finding, no_larger(scene, links), selection, seed)
        finding = smaller if formulations_about(smaller) == formulations_about(finding) else finding

        def look(case: FuzzCase) -> list[Finding]:
            return failed_findings(case, [finding.claim], formulations)

        finding = simplify_numbers(finding, look)
    return finding


def alike(failed: Finding, case: FuzzCase, formulations: Sequence[str]) -> list[Finding]:
    """Return the failures at another case of the same claim, and of the same cause."""
    if CLAIMS[failed.claim].asks:
        return []
    found = failed_findings(case, [failed.claim], formulations)
    return [one for one in found if cause_of(one) == cause_of(failed)]
