"""Finds: failures made small and round, told apart by cause, and kept to be looked at again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from eomcheck.claims import CLAIMS, Finding
from eomcheck.claims.finding import EVERY_ROW
from eomcheck.claims.reproducer import python_of
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.fuzzing.families import Case
from eomcheck.lab.fuzzing.judging import Fault, fault_of
from eomcheck.lab.fuzzing.motion_finding import MotionFinding, python_of_motion
from eomcheck.lab.fuzzing.parameters import case_of, functions_named, parameters_of
from eomcheck.mechanics.scene import Scene
from eomcheck.scene_lookup import kinds_of
from eomcheck.scenes import SCENES

FUNCTIONS = "functions"
"""Whose fault what fails of somebody's functions is."""


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
        return self.scene, self.claim, " ".join(cause_of(self)), self.whose, diagnosis_of(self)

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


def diagnosis_of(one: Find | Finding) -> str:
    """Diagnosis in a detail that tells causes apart; "" if none, or if it holds numbers."""
    found = one.detail.rpartition(": ")[2] if ": " in one.detail else ""
    found = found.removesuffix(EVERY_ROW)  # in all that do not vanish in this state
    return "" if any(c.isdigit() for c in found) else found


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


def name_of(kind: type[Scene], asked: str) -> str:
    """Return the name under which a kind of scene is found again: its key, or what was asked."""
    return kind.key if SCENES.get(kind.key) is kind else asked
