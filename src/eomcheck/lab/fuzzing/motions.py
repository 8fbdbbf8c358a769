"""Motions by all formulations, compared within what tolerance and conditioning allow.

Nothing is known of the true motion. What is known: all formulations integrate the same one; a
motion at a tighter tolerance tells how large errors are, and one that starts nearby how they grow.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from eomcheck.claims.finding import Verdict
from eomcheck.evaluation.tolerance import INCONCLUSIVE, C
from eomcheck.formulations import FORMULATIONS, Formulation
from eomcheck.lab.fuzzing.families import Case
from eomcheck.lab.fuzzing.growth import grown, largest_so_far, of_moved_starts
from eomcheck.lab.fuzzing.motion_finding import ALONE, END_STATES, ENERGY, MotionFinding
from eomcheck.lab.fuzzing.moved import COARSE, OTHER, TIGHT, TIMES, Moved, moved, moved_alone
from eomcheck.lab.fuzzing.poses import branchings, crossings
from eomcheck.mechanics.records import State
from eomcheck.numbers.generic import Array


def judged_motions(
    cases: Sequence[Case],
    keys: Sequence[str],
    t_end: float,
    alone: Sequence[tuple[int, str]] = (),
) -> list[list[MotionFinding]]:
    """Return what is found of motions, one list each.

    The truth is the median of all formulations at `TIGHT`. A formulation may be as far from it as
    `C` times its own change between the two tolerances, that of the median formulation, and what
    becomes of a start that is moved by `COARSE`. Behind a pose in which a partition is singular the
    own change of a formulation that solves one is no measure: it went where it must not go.

    Args:
        cases: scenes of one structure, and states at t = 0.
        keys: formulations, of which those that apply are looked at.
        t_end: end, s.
        alone: numbers of motions that are also looked at alone, and by which formulation.
    """
    able = [key for key in keys if FORMULATIONS[key].applies_to(cases[0][0])]
    runs = {
        key: (moved(cases, key, t_end, COARSE), moved(cases, key, t_end, TIGHT)) for key in able
    }
    both = {key: (a, b) for key, (a, b) in runs.items() if a is not None and b is not None}
    if not both:
        return [[] for _ in cases]
    with np.errstate(all="ignore"):
        return _judged(cases, both, t_end, [one for one in alone if one[1] in both])


def failures_of_motion(case: Case, keys: Sequence[str], t_end: float) -> list[MotionFinding]:
    """Return what fails of one motion; see `judged_motions`."""
    return [one for one in findings_of_motion(case, keys, t_end) if one.verdict == "failed"]


def findings_of_motion(case: Case, keys: Sequence[str], t_end: float) -> list[MotionFinding]:
    """The findings about one motion, alone and beside others; see `judged_motions`."""
    able = [key for key in keys if FORMULATIONS[key].applies_to(case[0])]
    (findings,) = judged_motions([case], keys, t_end, [(0, key) for key in able])
    return findings


def _judged(
    cases: Sequence[Case],
    both: dict[str, tuple[Moved, Moved]],
    t_end: float,
    alone: Sequence[tuple[int, str]],
) -> list[list[MotionFinding]]:
    m, n = len(cases), cases[0][0].n
    tight = np.array([b.y for _, b in both.values()])
    truth = _median(tight)
    scale = np.repeat(
        [1.0 + np.nanmax(np.abs(np.nan_to_num(part)), axis=(1, 2)) for part in _halves(truth, n)],
        n,
        axis=0,
    ).T[:, None, :]
    changes = {key: grown(a.y - b.y, scale) for key, (a, b) in both.items()}
    usual = _median(np.array(list(changes.values())))
    growth, of_energy = of_moved_starts(cases, both, t_end, scale)
    when = crossings(cases, truth, t_end)
    bounds = {key: C * (changes[key] + usual + growth) for key in both}
    apart = {key: np.abs((b.y - truth) / scale).max(axis=2) for key, (_, b) in both.items()}
    unknown = np.full((m, TIMES), np.inf)
    for key, (_, b) in both.items():
        first = branchings(cases, b.y, t_end)
        for i in range(m):
            before = slice(0, first[i])
            if (apart[key][i, before] <= bounds[key][i, before]).all():
                unknown[i, first[i] :] = np.nan
    gains = {key: largest_so_far(np.abs(a.energy - b.energy)) for key, (a, b) in both.items()}
    energies = _median(np.array(list(gains.values())))
    found: list[list[MotionFinding]] = [[] for _ in cases]
    for key, (_, b) in both.items():
        doubtful = solves_for_some(FORMULATIONS[key])
        behind = np.arange(TIMES) >= when[:, None]
        own, gain = (np.where(behind & doubtful, 0.0, x[key]) for x in (changes, gains))
        allowed = np.minimum(unknown, C * (own + usual + growth))
        gained = np.abs(b.energy - b.energy[:, :1])
        of_gain = np.minimum(unknown, C * (gain + energies + of_energy))
        size = 1.0 + np.abs(b.energy)
        kept = cases[0][0].conserves_energy
        for i in range(m):
            shown = _at(i, key, cases[i], b, when[i], t_end)
            found[i].append(_found(END_STATES, shown, apart[key][i], allowed[i], np.ones(TIMES)))
            if kept:
                found[i].append(_found(ENERGY, shown, gained[i], of_gain[i], size[i]))
    for i, key in alone:
        a, b = (moved_alone(cases[i], key, t_end, x) for x in (COARSE, TIGHT))
        if a is None or b is None:
            continue
        behind = (np.arange(TIMES) >= when[i]) & solves_for_some(FORMULATIONS[key])
        own = np.where(behind, 0.0, grown(a - b, scale[[i]])[0])
        allowed = np.minimum(unknown[i], C * (own + usual[i] + growth[i]))
        observed = np.abs((b - truth[[i]]) / scale[[i]]).max(axis=2)[0]
        shown = _at(i, key, cases[i], both[key][1], when[i], t_end)
        found[i].append(_found(ALONE, shown, observed, allowed, np.ones(TIMES)))
    return found


def solves_for_some(formulation: Formulation) -> bool:
    """Return whether a formulation may solve constraints for some velocities by the others."""
    return formulation.partitioned or formulation.in_speeds


def _median(x: Array) -> Array:
    """Return the median (...,) of those of x (f, ...) that are finite, NaN where none is."""
    x = np.sort(np.where(np.isfinite(x), x, np.nan), axis=0)  # NaN last
    count = np.isfinite(x).sum(axis=0)
    low, high = (np.maximum(count - 1, 0) // 2, count // 2)
    high = np.minimum(high, np.maximum(count - 1, 0))
    picked = [np.take_along_axis(x, i[None], axis=0)[0] for i in (low, high)]
    return (picked[0] + picked[1]) / 2.0


def _halves(y: Array, n: int) -> tuple[Array, Array]:
    return y[:, :, :n], y[:, :, n:]


WRONG = {
    END_STATES: "another state than the others",
    ENERGY: "energy changes",
    ALONE: f"another state than alone, by {OTHER}",
}
"""Id of a claim -> what is wrong where it fails."""


class _Shown(NamedTuple):
    key: str
    case: Case
    t_end: float
    crossed: float | None
    ended: str
    reached: bool


def _at(i: int, key: str, case: Case, by: Moved, place: int, t_end: float) -> _Shown:
    crossed = t_end * place / (TIMES - 1) if place < TIMES else None
    ended = "stopped" if by.status[i] == "failed" else str(by.status[i])
    ended = "too many steps" if "steps do not reach" in by.reason[i] else ended
    reached = place < TIMES and bool(np.isfinite(by.y[i, place]).all())
    return _Shown(key, case, t_end, crossed, ended, reached)


def _found(
    claim: str, shown: _Shown, observed: Array, allowed: Array, scale: Array
) -> MotionFinding:
    """Return the finding of errors (k,): the worst of the times at which they can be judged."""
    told = np.isfinite(observed) & np.isfinite(allowed) & (allowed <= INCONCLUSIVE * scale)
    told[0] = False  # the start is given
    scene, state = shown.case
    verdict: Verdict = "inconclusive"
    worst, detail = 0, ""
    if told.any():
        ratio = np.where(told, observed / np.maximum(allowed, np.finfo(float).tiny), -1.0)
        worst = int(ratio.argmax())
        verdict = "passed" if observed[worst] <= allowed[worst] else "failed"
        if verdict == "failed":
            t = shown.t_end * worst / (TIMES - 1)
            what = WRONG[claim]
            detail = f"motion, {shown.key}: {what} at t = {t:.4g} s"
            if shown.crossed is not None and shown.crossed <= t:
                detail += f", after a pose where a_1 is singular, before t = {shown.crossed:.4g} s"
    x, most = float(observed[worst]), float(allowed[worst])
    named = claim, shown.key, scene, State(state.q, state.v, 0.0), x, most, verdict
    return MotionFinding(
        *named,
        "compared: all formulations",
        detail,
        t_end=shown.t_end,
        crossed=shown.crossed,
        ended=shown.ended,
        reached=shown.reached,
    )
