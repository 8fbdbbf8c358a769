"""Failures of motions made small, and whose fault they are."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from eomcheck.lab.fuzzing.families import Case
from eomcheck.lab.fuzzing.judging import SILENT, UNKNOWN, Fault
from eomcheck.lab.fuzzing.motion_finding import ALONE, MotionFinding
from eomcheck.lab.fuzzing.motions import failures_of_motion, judged_motions
from eomcheck.lab.fuzzing.rounding import rounded

MOST_TRIES = 60
"""Motions looked at while numbers of a find are made round."""

AMONG = 4
"""Formulations that are asked while a find is made small, the one to blame among them."""


def shrunk_motion(finding: MotionFinding, keys: Sequence[str]) -> MotionFinding:
    """Return a failure of the same claim by the same formulation: shorter, and rounder."""
    scene, state = finding.scene, finding.state
    assert state is not None
    able = [key for key in keys if key != finding.subject]
    among = [finding.subject, *able[: AMONG - 1]]

    def failed(case: Case, t_end: float) -> list[MotionFinding]:
        found = failures_of_motion(case, among, t_end)
        same = finding.claim, finding.subject
        return [one for one in found if (one.claim, one.subject) == same]

    for shorter in (lambda t: t / 2, lambda t: t / 2, _digits(2), _digits(1)):
        if found := failed((scene, state), shorter(finding.t_end)):
            finding = found[0]
    small = rounded(finding, lambda case: failed(case, finding.t_end), MOST_TRIES)
    # What fails among a few has to fail among all.
    assert small.state is not None
    all_of = failures_of_motion((small.scene, small.state), keys, small.t_end)
    same = [x for x in all_of if (x.claim, x.subject) == (small.claim, small.subject)]
    return same[0] if same else finding


def _digits(count: int) -> Callable[[float], float]:
    return lambda t: float(f"{t:.{count - 1}e}")


def fault_of_motion(finding: MotionFinding, keys: Sequence[str]) -> Fault:
    """Return whose fault a failure is: that of a formulation which most others contradict."""
    assert finding.state is not None
    alone = [(0, key) for key in keys] if finding.claim == ALONE else []
    (found,) = judged_motions([(finding.scene, finding.state)], keys, finding.t_end, alone)
    others = [x for x in found if x.claim == finding.claim and x.subject != finding.subject]
    right = [x for x in others if x.verdict == "passed"]
    best = max((x.observed for x in right), default=0.0)
    said = f"{len(right)} of {len(others)} others agree to {best:.2g}"
    return Fault(SILENT if len(right) > len(others) / 2 and len(right) > 1 else UNKNOWN, said)
