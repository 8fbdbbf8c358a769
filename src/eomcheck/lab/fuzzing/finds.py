"""Finds: failures made small and round, told apart by cause, and kept to be looked at again."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from eomcheck.claims import CLAIMS, Finding
from eomcheck.claims.repeat import python_of
from eomcheck.claims.selection import Selection
from eomcheck.claims.smaller import no_larger, smallest_failure
from eomcheck.errors import EomcheckError, InputError
from eomcheck.evaluation.doubles import Evaluation
from eomcheck.evaluation.dynamics import consistent_velocity
from eomcheck.files import write_text
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.fuzzing.draws import Case
from eomcheck.lab.fuzzing.judging import Fault, about, failures, fault_of
from eomcheck.lab.fuzzing.motions import MotionFinding, failures_of_motion, python_of_motion
from eomcheck.lab.fuzzing.structures import plain_random, random_of
from eomcheck.lookup import value_of
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.named import kinds_of
from eomcheck.numbers.contract import Array
from eomcheck.random_mechanisms.kinds import Random
from eomcheck.scenes import SCENES
from eomcheck.testing.run import functions_at
from eomcheck.testing.subject import Functions

FUNCTIONS = "functions"
"""Whose fault what fails of somebody's functions is."""

MOST_TRIES = 150
"""States looked at while numbers are made round."""


@dataclass(frozen=True)
class Find:
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
        whose: whose fault it is, see `eomcheck.lab.fuzzing.judging`.
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
        words = cause_of(self)
        what = self.detail.rpartition(": ")[2] if ": " in self.detail else ""
        what = "" if any(c.isdigit() for c in what) else what
        return self.scene, self.claim, " ".join(words), self.whose, what

    @property
    def case(self) -> Case:
        """The scene and its state.

        Raises:
            EomcheckError: there is no such scene.
        """
        functions = functions_named(self.scene)
        kind = kinds_of(self.scene)[0] if functions is None else functions
        return case_of(kind, self.parameters, self.q, self.v, self.t)

    @property
    def python(self) -> str:
        """Python code that shows it again."""
        if self.t_end:
            return python_of_motion(*self.case, self.t_end, self.subject)
        return python_of(*self.case)

    def __str__(self) -> str:
        how = f"observed {self.observed:.3g}, allowed {self.allowed:.3g}"
        return f"{self.claim}, {self.subject}: {how}; {self.whose} ({self.evidence})"


def cause_of(one: Find | Finding) -> list[str]:
    """Return the words of a subject that tell causes apart: formulations, or the engine alone."""
    words = one.subject.replace("~", " ").replace(":", " ").split()
    if one.claim in CLAIMS and CLAIMS[one.claim].asks:
        words = [word for word in words if word not in FORMULATIONS]
    return sorted(words)


def case_of(
    kind: Any, parameters: dict[str, Any], q: Sequence[float], v: Sequence[float], t: float
) -> Case:
    """Return the scene that `parameters_of` is of, or functions, in a state."""
    if isinstance(kind, Functions):
        scene: Any = kind
    elif issubclass(kind, Random):
        scene = random_of(kind, parameters)
    else:
        scene = kind(**parameters)
    return scene, State(np.array(q, float), np.array(v, float), t)


@lru_cache(16)
def functions_named(name: str) -> Functions | None:
    """Return the `eomcheck.testing.Functions` that a name stands for, None if it is a scene's.

    Args:
        name: path/to/file.py:NAME or package.module:NAME.

    Raises:
        InputError: no such file or module, or it cannot be run.
    """
    found = value_of(name)
    return found if isinstance(found, Functions) else None


def find_of(finding: Finding, name: str, fault: Fault | None = None) -> Find:
    """Return what to keep of a failure.

    Args:
        finding: the failure.
        name: of the kind of scene.
        fault: whose fault it is, by default what `fault_of` says.
    """
    scene, state = finding.scene, finding.state
    assert state is not None
    fault = fault_of(finding) if fault is None else fault
    return Find(
        name,
        parameters_of(scene),
        state.q.tolist(),
        state.v.tolist(),
        float(state.t),
        finding.claim,
        finding.subject,
        float(finding.observed),
        float(finding.allowed),
        fault.whose,
        fault.evidence,
        finding.detail,
        t_end=finding.t_end if isinstance(finding, MotionFinding) else 0.0,
    )


def parameters_of(scene: Any) -> dict[str, Any]:
    """Return what makes a scene again, plain; functions need nothing.

    Of a random one that is its description, and what of it was changed.
    """
    if isinstance(scene, Random):
        return plain_random(scene)
    return {} if isinstance(scene, Functions) else numbers_of(scene)


def numbers_of(scene: Any) -> dict[str, Any]:
    """Return the arguments of a scene that are drawn, by name, plain; functions have none."""
    if isinstance(scene, Functions):
        return {}
    links = getattr(scene, "links", None) if scene.has_links else None
    values = {name: getattr(scene, name) for name in type(scene).ranges(links)}
    return {name: None if x is None else np.asarray(x).tolist() for name, x in values.items()}


# ---- Made small ----------------------------------------------------------------------------------


def shrunk(finding: Finding, formulations: Sequence[str], seed: int = 0) -> Finding:
    """Return a failure of the same claim about the same formulations, smaller and rounder.

    Smaller ones are looked for by hypothesis, then each number is tried at 0, at 1 and with fewer
    digits. What an engine says is left as it is: each try would make the engine again.
    """
    scene = finding.scene
    assert isinstance(scene, Scene)
    selection = Selection.of(formulations, [], [finding.claim], scenes=[type(scene)])
    if not CLAIMS[finding.claim].asks:
        links = (1, getattr(scene, "links", 1))
        smaller = smallest_failure(finding, no_larger(scene, links), selection, seed)
        finding = smaller if about(smaller) == about(finding) else finding

        def look(case: Case) -> list[Finding]:
            return failures(case, [finding.claim], formulations)

        finding = rounded(finding, look)
    return finding


def alike(failed: Finding, case: Case, formulations: Sequence[str]) -> list[Finding]:
    """Return the failures at another case of the same claim, and of the same cause."""
    if CLAIMS[failed.claim].asks:
        return []
    found = failures(case, [failed.claim], formulations)
    return [one for one in found if cause_of(one) == cause_of(failed)]


F = TypeVar("F", bound=Finding)


def rounded(finding: F, look: Callable[[Case], Sequence[F]], most: int = MOST_TRIES) -> F:
    """Return a failure about the same subject, with rounder numbers.

    Args:
        finding: the failure.
        look: returns the failures of its claim at another case.
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
                    finding = _tried(finding, same, i, y, look) or finding
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
    found = [_Part(name, np.ravel(x)) for name, x in numbers_of(scene).items() if x is not None]
    return [*found, _Part("q", state.q), _Part("v", state.v)]


def _tried(
    finding: F, part: _Part, i: int, y: float, look: Callable[[Case], Sequence[F]]
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
            given = numbers_of(scene)
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


# ---- Kept ----------------------------------------------------------------------------------------


def read_finds(path: Path) -> list[Find]:
    """Return the finds in a file.

    Raises:
        InputError: it cannot be read, or holds something else.
    """
    if not path.exists():
        return []
    try:
        return [_read(one) for one in json.loads(path.read_text(encoding="utf-8"))]
    except (OSError, TypeError, KeyError, ValueError) as error:
        raise InputError(f"{str(path)!r} holds no finds: {error}") from None


def _read(one: dict[str, Any]) -> Find:
    fields = set(Find.__dataclass_fields__)
    if unknown := set(one) - fields:
        raise ValueError(f"unknown: {', '.join(sorted(unknown))}")
    return Find(**one)


def write_finds(path: Path, finds: Iterable[Find]) -> None:
    """Write finds into a file, those of one cause once."""
    kept = [
        {k: x for k, x in asdict(one).items() if x != "" and not (k == "t_end" and x == 0.0)}
        for one in told_apart(finds)
    ]
    write_text(path, "[\n" + ",\n".join(json.dumps(one) for one in kept) + "\n]\n")


def told_apart(finds: Iterable[Find]) -> list[Find]:
    """Return the first find of each cause."""
    found: dict[Any, Find] = {}
    for i, one in enumerate(finds):
        found.setdefault(one.key if one.claim else i, one)
    return list(found.values())


def replayed(
    finds: Iterable[Find], formulations: Sequence[str], looked_at: Callable[[], None] = lambda: None
) -> list[Find]:
    """Return those finds that still fail, with what is observed now."""
    still = []
    for one in finds:
        failed = _failures_again(one, formulations)
        told = Fault(one.whose, one.evidence) if one.t_end or one.whose == FUNCTIONS else None
        still += [find_of(x, one.scene, told) for x in failed[:1]]
        looked_at()
    return still


def _failures_again(one: Find, formulations: Sequence[str]) -> Sequence[Finding]:
    """Return what still fails of a find."""
    scene, state = one.case
    same = one.claim, one.subject
    if isinstance(scene, Functions):
        found = functions_at(scene, state, [one.claim])
    elif one.t_end:
        found = failures_of_motion((scene, state), formulations, one.t_end)
    else:
        return failures((scene, state), [one.claim] if one.claim else list(CLAIMS), formulations)
    return [x for x in found if x.verdict == "failed" and (x.claim, x.subject) == same]


def name_of(kind: type[Scene], asked: str) -> str:
    """Return the name under which a kind of scene is found again: its key, or what was asked."""
    return kind.key if SCENES.get(kind.key) is kind else asked
