"""Comparison of motions by all formulations, within bounds by tolerance and conditioning.

The true motion is not known, but all formulations integrate the same one: a motion at a tighter
tolerance shows the size of the errors, and one from a perturbed start their growth. Motions are
simulated in a batch, or one alone by another integrator. After a singular configuration, of a
partition or of the constraint Jacobian itself, a motion is judged otherwise or not at all; such
poses are detected from the states on both sides of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from eomcheck.claims.finding import Finding, Verdict
from eomcheck.claims.reproducer import motion_reproducer
from eomcheck.draws.fuzz_cases import FuzzCase, batched_terms_at, consistent
from eomcheck.errors import EomcheckError
from eomcheck.evaluation.dynamics import assembled_position
from eomcheck.evaluation.tolerance import INCONCLUSIVE, C
from eomcheck.formulations import FORMULATIONS, Formulation
from eomcheck.mechanics.parameters import settable
from eomcheck.mechanics.records import State
from eomcheck.motion.batch import Trajectories, simulate_many
from eomcheck.motion.simulate import simulate
from eomcheck.numbers.batch_arrays import batch_data
from eomcheck.numbers.generic import EPS, Array

# ---- Simulated motions ---------------------------------------------------------------------------

COARSE, TIGHT = 1e-8, 1e-10
"""Tolerances, rtol and atol, of the two motions of each formulation; the second one is judged."""

OTHER = "Vern8"
"""Integrator of motions simulated alone, other than that of batches."""

TIMES = 65
"""Number of times at which motions are compared, the start among them."""

MOST_STEPS = 1000
"""Largest number of steps; a motion that takes more is stopped, and counted."""


class SimulatedBatch(NamedTuple):
    """Motions of m scenes of one structure, at k times, by one formulation.

    Attributes:
        y: coordinates and velocities (m, k, 2n), NaN where not reached.
        energy: T + U (m, k), J.
        status: status of each motion (m,), see `Trajectories`.
        reason: reason why it did not reach the end (m,).
    """

    y: Array
    energy: Array
    status: Array
    reason: Array


def simulate_batch(
    cases: Sequence[FuzzCase], key: str, t_end: float, tolerance: float, most: int = MOST_STEPS
) -> SimulatedBatch | None:
    """Return motions by one formulation; None where it refuses the scenes as such.

    Args:
        cases: scenes of one structure, with the states in which motions start at t = 0.
        key: the formulation.
        t_end: end, s.
        tolerance: rtol and atol.
        most: largest number of steps.
    """
    scene = cases[0][0]
    parameters = {}
    if any(one is not scene for one, _ in cases):
        names = [name for name in settable(scene) if getattr(scene, name) is not None]
        parameters = {name: np.array([getattr(one, name) for one, _ in cases]) for name in names}
        parameters = {name: x for name, x in parameters.items() if x.size}
    q0, v0 = (np.array([state[i] for _, state in cases]) for i in (0, 1))
    times = np.linspace(0.0, t_end, TIMES)
    options: dict[str, Any] = {"rtol": tolerance, "atol": tolerance, "max_steps": most}
    try:
        with np.errstate(all="ignore"):
            trajectories: Trajectories = simulate_many(
                *(scene, key, t_end),
                **{"q0": q0, "v0": v0, "parameters": parameters, "output_times": times},
                **options,
            )
    except EomcheckError:
        return None
    y = np.concatenate((trajectories.q, trajectories.v), axis=2)
    return SimulatedBatch(y, trajectories.energy, trajectories.status, trajectories.reason)


def simulate_single(case: FuzzCase, key: str, t_end: float, tolerance: float) -> Array | None:
    """Return a motion y (1, k, 2n) by `simulate` and `OTHER`; None where it cannot start."""
    scene, state = case
    times = np.linspace(0.0, t_end, TIMES)
    start: dict[str, Any] = {"q0": state.q, "v0": state.v, "output_times": times}
    try:
        motion = simulate(
            *(scene, key, t_end),
            **start,
            rtol=tolerance,
            atol=tolerance,
            integrator=OTHER,
            max_steps=10 * MOST_STEPS,
        )
    except EomcheckError:
        return None
    y = np.full((1, TIMES, 2 * scene.n), np.nan)
    y[0, : len(motion.times)] = np.hstack((motion.q, motion.v))
    return y


# ---- Growth of errors ----------------------------------------------------------------------------


def perturbed_starts(cases: Sequence[FuzzCase]) -> tuple[list[FuzzCase], list[int]]:
    """Return the cases with states perturbed by `COARSE`, relative, and their input indices.

    All get the same perturbation, so that a start's does not depend on the others in the batch.
    """
    scenes, states, velocities, indices = [], [], [], []
    n = cases[0][0].n
    random = np.random.default_rng(n)
    perturbation = COARSE * random.choice((-1.0, 1.0), (2, n)) * random.uniform(0.5, 1.0, (2, n))
    for i, (scene, state) in enumerate(cases):
        try:
            q = assembled_position(scene, state.q + perturbation[0] * (1.0 + np.abs(state.q)), 0.0)
        except EomcheckError:
            continue  # its loops cannot be closed there
        scenes.append(scene)
        states.append(State(q, np.zeros(n), 0.0))
        velocities.append(state.v + perturbation[1] * (1.0 + np.abs(state.v)))
        indices.append(i)
    starts, kept = consistent(scenes, states, lambda _: np.array(velocities))
    return starts, [indices[i] for i in kept]


def largest_so_far(x: Array) -> Array:
    """Return the running maximum (m, k) along time; NaN from the first NaN on."""
    return np.maximum.accumulate(x, axis=1)


def grown(difference: Array, scale: Array) -> Array:
    """Return the running maximum (m, k) of differences of states (m, k, 2n), over `scale`."""
    return largest_so_far(np.abs(difference / scale).max(axis=2))


def growth_from_perturbed_starts(
    cases: Sequence[FuzzCase],
    both: dict[str, tuple[SimulatedBatch, SimulatedBatch]],
    t_end: float,
    scale: Array,
) -> tuple[Array, Array]:
    """Return distances (m, k) to motions from perturbed starts, and those of energies (m, k), J."""
    distance, energy = (np.full((len(cases), TIMES), np.nan) for _ in range(2))
    nearby, indices = perturbed_starts(cases)
    # By the formulation that gets furthest: the growth of errors does not depend on it.
    best = max(both, key=lambda key: np.isfinite(both[key][1].y).sum())
    perturbed = simulate_batch(nearby, best, t_end, TIGHT) if nearby else None
    if perturbed is not None:
        reference = both[best][1]
        distance[indices] = grown(perturbed.y - reference.y[indices], scale[indices])
        energy[indices] = largest_so_far(np.abs(perturbed.energy - reference.energy[indices]))
    return distance, energy


# ---- Singular poses ------------------------------------------------------------------------------


def crossings(cases: Sequence[FuzzCase], y: Array, t_end: float) -> Array:
    """Return the index of the first time (m,) after a pose where a_1 is singular.

    It is k where there is none. Such a pose was crossed where the sign of the determinant changes
    along the true motion, whichever formulation integrates it.

    Args:
        cases: scenes of one structure.
        y: the true motion (m, k, 2n), NaN where it is not known.
        t_end: end, s.
    """
    a, dependent = jacobians(cases, y, t_end)
    with np.errstate(all="ignore"):
        signs = np.linalg.slogdet(a[..., list(dependent)]).sign
    signs = np.where(np.isfinite(a).all(axis=(2, 3)), signs, 0.0)
    first = np.full(len(cases), y.shape[1])
    for i in range(len(cases) if a.shape[2] else 0):
        row = signs[i]
        regular = np.flatnonzero(np.abs(row) == 1.0)
        sign_changes = regular[1:][row[regular[1:]] != row[regular[:-1]]]
        first[i] = sign_changes[0] if sign_changes.size else y.shape[1]
    return first


def branchings(cases: Sequence[FuzzCase], y: Array, t_end: float) -> Array:
    """Return the index of the first time (m,) after a pose where the Jacobian a loses rank.

    It is k where there is none. At such a pose, as where all rods of a linkage are in line, a
    motion has branches, and rounding decides between them. After it rows of a point the other way:
    the matrix that maps the rows before to those after has an eigenvalue that is not positive.
    """
    a, _ = jacobians(cases, y, t_end)
    first = np.full(len(cases), y.shape[1])
    if not a.shape[2]:
        return first
    a, after = a[:, :-1], np.moveaxis(a[:, 1:], 2, 3)
    known = np.asarray(np.isfinite(a).all(axis=(2, 3)) & np.isfinite(after).all(axis=(2, 3)))
    left, right = a @ np.moveaxis(a, 2, 3), a @ after
    eye = np.eye(a.shape[2])
    left = np.where(known[..., None, None], left, eye)
    right = np.where(known[..., None, None], right, eye)
    regular = np.linalg.cond(left) < 1.0 / EPS
    left = np.where(regular[..., None, None], left, eye)
    directions = np.linalg.eigvals(np.linalg.solve(left, right)).real
    turned: Array = known & ((directions <= 0.0).any(axis=2) | ~regular)
    for i in range(len(cases)):
        times = np.flatnonzero(turned[i])
        first[i] = times[0] + 1 if times.size else y.shape[1]
    return first


def jacobians(cases: Sequence[FuzzCase], y: Array, t_end: float) -> tuple[Array, tuple[int, ...]]:
    """Return a (m, k, r, n) on motions y (m, k, 2n), NaN where y is, and its dependent columns."""
    scene, n = cases[0][0], cases[0][0].n
    out = np.full((*y.shape[:2], scene.r, n), np.nan)
    reached = [(i, k) for i, k in np.argwhere(np.isfinite(y).all(axis=2)).tolist()]
    if not scene.r or not reached:
        return out, ()
    times = np.linspace(0.0, t_end, y.shape[1])
    states = [State(y[i, k, :n], y[i, k, n:], float(times[k])) for i, k in reached]
    at = batched_terms_at([cases[i][0] for i, _ in reached], states)
    a: Any = at.terms.a
    out[tuple(np.array(reached).T)] = batch_data(a, at.states)
    return out, tuple(range(scene.r))


# ---- Findings ------------------------------------------------------------------------------------

END_STATES, ENERGY, ALONE = "end-states", "motion-energy", "motion-alone"
MOTION_CLAIMS = {
    END_STATES: "all formulations move a scene alike",
    ENERGY: "T + U stays what it was, where nothing takes or brings energy",
    ALONE: "a motion alone, by another integrator, is what it is beside others",
}
"""Id -> statement of a claim about motions."""


@dataclass(frozen=True)
class MotionFinding(Finding):
    """A `Finding` about a motion that starts in its state at t = 0; see `MOTION_CLAIMS`.

    Attributes:
        t_end: planned end of the motion, s.
        crossed: time at which a pose was crossed where a partition is singular, s; None for never.
        ended: "finished", "refused" at the start, "stopped", or "too many steps".
        reached: whether the formulation went beyond that pose.
    """

    t_end: float = 0.0
    crossed: float | None = None
    ended: str = "finished"
    reached: bool = False

    def as_python(self) -> str:
        """Return Python code that simulates the scene by this formulation and by others."""
        assert self.state is not None
        return motion_reproducer(self.scene, self.state, self.t_end, self.subject, TIGHT)


# ---- Judging -------------------------------------------------------------------------------------


def judge_motions(
    cases: Sequence[FuzzCase],
    keys: Sequence[str],
    t_end: float,
    alone: Sequence[tuple[int, str]] = (),
) -> list[list[MotionFinding]]:
    """Return the findings of motions, one list per motion.

    The reference is the median of all formulations at `TIGHT`. A formulation may differ from it by
    `C` times the sum of its own change between the two tolerances, that of the median formulation,
    and the growth of a perturbation of the start by `COARSE`. After a pose where a partition is
    singular the own change of a formulation that solves one is no measure and does not count: it
    crossed a pose at which it is not defined.

    Args:
        cases: scenes of one structure, and states at t = 0.
        keys: formulations, of which those that apply are compared.
        t_end: end, s.
        alone: (index of a motion, formulation) of motions that are also simulated alone.
    """
    applicable = [key for key in keys if FORMULATIONS[key].applies_to(cases[0][0])]
    runs = {
        key: (simulate_batch(cases, key, t_end, COARSE), simulate_batch(cases, key, t_end, TIGHT))
        for key in applicable
    }
    both = {key: (a, b) for key, (a, b) in runs.items() if a is not None and b is not None}
    if not both:
        return [[] for _ in cases]
    with np.errstate(all="ignore"):
        return _judged(cases, both, t_end, [one for one in alone if one[1] in both])


def failures_of_motion(case: FuzzCase, keys: Sequence[str], t_end: float) -> list[MotionFinding]:
    """Return the failed findings of one motion; see `judge_motions`."""
    return [one for one in findings_of_motion(case, keys, t_end) if one.verdict == "failed"]


def findings_of_motion(case: FuzzCase, keys: Sequence[str], t_end: float) -> list[MotionFinding]:
    """Return the findings of one motion, simulated in a batch and alone; see `judge_motions`."""
    applicable = [key for key in keys if FORMULATIONS[key].applies_to(case[0])]
    (findings,) = judge_motions([case], keys, t_end, [(0, key) for key in applicable])
    return findings


def _judged(
    cases: Sequence[FuzzCase],
    both: dict[str, tuple[SimulatedBatch, SimulatedBatch]],
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
    median_change = _median(np.array(list(changes.values())))
    growth, energy_growth = growth_from_perturbed_starts(cases, both, t_end, scale)
    when = crossings(cases, truth, t_end)
    bounds = {key: C * (changes[key] + median_change + growth) for key in both}
    errors = {key: np.abs((b.y - truth) / scale).max(axis=2) for key, (_, b) in both.items()}
    limit = np.full((m, TIMES), np.inf)
    for key, (_, b) in both.items():
        first = branchings(cases, b.y, t_end)
        for i in range(m):
            before = slice(0, first[i])
            if (errors[key][i, before] <= bounds[key][i, before]).all():
                limit[i, first[i] :] = np.nan
    gains = {key: largest_so_far(np.abs(a.energy - b.energy)) for key, (a, b) in both.items()}
    median_gain = _median(np.array(list(gains.values())))
    findings: list[list[MotionFinding]] = [[] for _ in cases]
    for key, (_, b) in both.items():
        solves = solves_for_some(FORMULATIONS[key])
        after_crossing = np.arange(TIMES) >= when[:, None]
        own_change, own_gain = (
            np.where(after_crossing & solves, 0.0, x[key]) for x in (changes, gains)
        )
        allowed = np.minimum(limit, C * (own_change + median_change + growth))
        energy_error = np.abs(b.energy - b.energy[:, :1])
        gain_allowed = np.minimum(limit, C * (own_gain + median_gain + energy_growth))
        size = 1.0 + np.abs(b.energy)
        conserves_energy = cases[0][0].conserves_energy
        for i in range(m):
            summary = _motion_summary(i, key, cases[i], b, when[i], t_end)
            findings[i].append(
                _worst_finding(END_STATES, summary, errors[key][i], allowed[i], np.ones(TIMES))
            )
            if conserves_energy:
                findings[i].append(
                    _worst_finding(ENERGY, summary, energy_error[i], gain_allowed[i], size[i])
                )
    for i, key in alone:
        a, b = (simulate_single(cases[i], key, t_end, x) for x in (COARSE, TIGHT))
        if a is None or b is None:
            continue
        after_crossing = (np.arange(TIMES) >= when[i]) & solves_for_some(FORMULATIONS[key])
        own_change = np.where(after_crossing, 0.0, grown(a - b, scale[[i]])[0])
        allowed = np.minimum(limit[i], C * (own_change + median_change[i] + growth[i]))
        observed = np.abs((b - truth[[i]]) / scale[[i]]).max(axis=2)[0]
        summary = _motion_summary(i, key, cases[i], both[key][1], when[i], t_end)
        findings[i].append(_worst_finding(ALONE, summary, observed, allowed, np.ones(TIMES)))
    return findings


def solves_for_some(formulation: Formulation) -> bool:
    """Return whether a formulation may solve constraints for some velocities in terms of others."""
    return formulation.partitioned or formulation.in_speeds


def _median(x: Array) -> Array:
    """Return the median (...,) of the finite entries of x (f, ...), NaN where there is none."""
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
"""Id of a claim -> description of its failure."""


class _MotionSummary(NamedTuple):
    key: str
    case: FuzzCase
    t_end: float
    crossed: float | None
    ended: str
    reached: bool


def _motion_summary(
    i: int, key: str, case: FuzzCase, by: SimulatedBatch, index: int, t_end: float
) -> _MotionSummary:
    crossed = t_end * index / (TIMES - 1) if index < TIMES else None
    ended = "stopped" if by.status[i] == "failed" else str(by.status[i])
    ended = "too many steps" if "steps do not reach" in by.reason[i] else ended
    reached = index < TIMES and bool(np.isfinite(by.y[i, index]).all())
    return _MotionSummary(key, case, t_end, crossed, ended, reached)


def _worst_finding(
    claim: str, motion: _MotionSummary, observed: Array, allowed: Array, scale: Array
) -> MotionFinding:
    """Return the finding of errors (k,) at the worst of the times at which they can be judged."""
    resolved = np.isfinite(observed) & np.isfinite(allowed) & (allowed <= INCONCLUSIVE * scale)
    resolved[0] = False  # the start is given
    scene, state = motion.case
    verdict: Verdict = "inconclusive"
    worst, detail = 0, ""
    if resolved.any():
        ratio = np.where(resolved, observed / np.maximum(allowed, np.finfo(float).tiny), -1.0)
        worst = int(ratio.argmax())
        verdict = "passed" if observed[worst] <= allowed[worst] else "failed"
        if verdict == "failed":
            t = motion.t_end * worst / (TIMES - 1)
            wrong = WRONG[claim]
            detail = f"motion, {motion.key}: {wrong} at t = {t:.4g} s"
            if motion.crossed is not None and motion.crossed <= t:
                detail += f", after a pose where a_1 is singular, before t = {motion.crossed:.4g} s"
    x, bound = float(observed[worst]), float(allowed[worst])
    fields = claim, motion.key, scene, State(state.q, state.v, 0.0), x, bound, verdict
    return MotionFinding(
        *fields,
        "compared: all formulations",
        detail,
        t_end=motion.t_end,
        crossed=motion.crossed,
        ended=motion.ended,
        reached=motion.reached,
    )
