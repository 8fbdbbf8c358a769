"""Comparison of motions by all formulations, within what tolerance and conditioning allow.

The true motion is not known. Known is: all formulations integrate the same one; a motion at a
tighter tolerance shows how large errors are, and one that starts nearby how they grow. Motions are
simulated in a batch, or one alone by another integrator. Behind a pose where a partition, or the
constraint Jacobian itself, is singular a motion is judged otherwise or not at all; such poses are
detected from the states on both sides of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from eomcheck.claims.finding import Finding, Verdict
from eomcheck.claims.reproducer import reproducer_header
from eomcheck.errors import EomcheckError
from eomcheck.evaluation.batched_evaluation import LaneEvaluation
from eomcheck.evaluation.dynamics import assembled_position
from eomcheck.evaluation.tolerance import INCONCLUSIVE, C
from eomcheck.formulations import FORMULATIONS, Formulation
from eomcheck.lab.fuzzing.cases import FuzzCase, consistent
from eomcheck.mechanics.parameters import settable
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.motion.batch import Trajectories, simulate_many
from eomcheck.motion.simulate import simulate
from eomcheck.numbers.generic import Array
from eomcheck.numbers.lanes import LaneArray
from eomcheck.numbers.pivots import EPS

# ---- Simulated motions ---------------------------------------------------------------------------

COARSE, TIGHT = 1e-8, 1e-10
"""Tolerances of the two motions of each formulation; the second one is judged."""

OTHER = "Vern8"
"""The integrator of motions that are looked at alone, which is not the one of lanes."""

TIMES = 65
"""Times at which motions are compared, the start among them."""

MOST_STEPS = 1000
"""A motion that takes more is not gone on with, and counted."""


class SimulatedBatch(NamedTuple):
    """Motions of m scenes of one structure, at k times, as one formulation says.

    Attributes:
        y: coordinates and velocities (m, k, 2n), NaN where not reached.
        energy: T + U (m, k), J.
        status: of each (m,), see `Trajectories`.
        reason: why it did not reach the end (m,).
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
        most: steps, at most.
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
            found: Trajectories = simulate_many(
                *(scene, key, t_end),
                **{"q0": q0, "v0": v0, "parameters": parameters, "output_times": times},
                **options,
            )
    except EomcheckError:
        return None
    y = np.concatenate((found.q, found.v), axis=2)
    return SimulatedBatch(y, found.energy, found.status, found.reason)


def simulate_single(case: FuzzCase, key: str, t_end: float, tolerance: float) -> Array | None:
    """Return a motion y (1, k, 2n) by `simulate` and `OTHER`; None where it cannot start."""
    scene, state = case
    times = np.linspace(0.0, t_end, TIMES)
    start: dict[str, Any] = {"q0": state.q, "v0": state.v, "output_times": times}
    try:
        found = simulate(
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
    y[0, : len(found.times)] = np.hstack((found.q, found.v))
    return y


# ---- Growth of errors ----------------------------------------------------------------------------


def perturbed_starts(cases: Sequence[FuzzCase]) -> tuple[list[FuzzCase], list[int]]:
    """Return the cases with states moved by `COARSE`, and which they are of those given.

    All are moved alike, so that what a start is moved by does not depend on those beside it.
    """
    scenes, states, wished, places = [], [], [], []
    n = cases[0][0].n
    random = np.random.default_rng(n)
    away = COARSE * random.choice((-1.0, 1.0), (2, n)) * random.uniform(0.5, 1.0, (2, n))
    for i, (scene, state) in enumerate(cases):
        try:
            q = assembled_position(scene, state.q + away[0] * (1.0 + np.abs(state.q)), 0.0)
        except EomcheckError:
            continue  # it cannot be closed there
        scenes.append(scene)
        states.append(State(q, np.zeros(n), 0.0))
        wished.append(state.v + away[1] * (1.0 + np.abs(state.v)))
        places.append(i)
    found, kept = consistent(scenes, states, lambda _: np.array(wished))
    return found, [places[i] for i in kept]


def largest_so_far(x: Array) -> Array:
    """Return the largest so far (m, k); NaN once one is NaN: what comes then is not known."""
    return np.maximum.accumulate(x, axis=1)


def grown(difference: Array, scale: Array) -> Array:
    """Return the largest entry so far (m, k) of differences of states (m, k, 2n), over `scale`."""
    return largest_so_far(np.abs(difference / scale).max(axis=2))


def growth_from_perturbed_starts(
    cases: Sequence[FuzzCase],
    both: dict[str, tuple[SimulatedBatch, SimulatedBatch]],
    t_end: float,
    scale: Array,
) -> tuple[Array, Array]:
    """Return how far motions are apart (m, k) that begin a little apart, and their energies."""
    apart, energy = (np.full((len(cases), TIMES), np.nan) for _ in range(2))
    nearby, places = perturbed_starts(cases)
    # By the formulation that comes furthest: how a motion grows is not a matter of formulation.
    best = max(both, key=lambda key: np.isfinite(both[key][1].y).sum())
    there = simulate_batch(nearby, best, t_end, TIGHT) if nearby else None
    if there is not None:
        here = both[best][1]
        apart[places] = grown(there.y - here.y[places], scale[places])
        energy[places] = largest_so_far(np.abs(there.energy - here.energy[places]))
    return apart, energy


# ---- Singular poses ------------------------------------------------------------------------------


def crossings(cases: Sequence[FuzzCase], y: Array, t_end: float) -> Array:
    """Return the number of the first time (m,) behind a pose where a_1 is singular.

    The number of times for none. Such a pose was crossed where the sign of the determinant changes
    on the true motion, whatever a formulation says of it.

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
        seen = np.flatnonzero(np.abs(row) == 1.0)
        turns = seen[1:][row[seen[1:]] != row[seen[:-1]]]
        first[i] = turns[0] if turns.size else y.shape[1]
    return first


def branchings(cases: Sequence[FuzzCase], y: Array, t_end: float) -> Array:
    """Return the number of the first time (m,) behind a pose where a loses rank.

    The number of times for none. There a motion has branches, as where all rods of a linkage are in
    line, and which one it takes is up to rounding. From such a pose on rows of a point the other
    way: what they are of the rows before has an eigenvalue that is not positive.
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
        places = np.flatnonzero(turned[i])
        first[i] = places[0] + 1 if places.size else y.shape[1]
    return first


def jacobians(cases: Sequence[FuzzCase], y: Array, t_end: float) -> tuple[Array, tuple[int, ...]]:
    """Return a (m, k, r, n) on motions y (m, k, 2n), NaN where these are, and what depends."""
    scene, n = cases[0][0], cases[0][0].n
    out = np.full((*y.shape[:2], scene.r, n), np.nan)
    reached = [(i, k) for i, k in np.argwhere(np.isfinite(y).all(axis=2)).tolist()]
    if not scene.r or not reached:
        return out, ()
    times = np.linspace(0.0, t_end, y.shape[1])
    states = [State(y[i, k, :n], y[i, k, n:], float(times[k])) for i, k in reached]
    at = LaneEvaluation([cases[i][0] for i, _ in reached], states)
    a: Any = at.terms.a
    data = np.broadcast_to(
        a.data if isinstance(a, LaneArray) else a[..., None], (*a.shape, at.lanes)
    )
    out[tuple(np.array(reached).T)] = np.moveaxis(data, -1, 0)
    return out, tuple(at.partition.dependent)


# ---- Findings ------------------------------------------------------------------------------------

END_STATES, ENERGY, ALONE = "end-states", "motion-energy", "motion-alone"
MOTION_CLAIMS = {
    END_STATES: "all formulations move a scene alike",
    ENERGY: "T + U stays what it was, where nothing takes or brings energy",
    ALONE: "a motion alone, by another integrator, is what it is beside others",
}
"""Id -> what is claimed of motions."""


@dataclass(frozen=True)
class MotionFinding(Finding):
    """A `Finding` about a motion that starts in its state at t = 0; see `MOTION_CLAIMS`.

    Attributes:
        t_end: where the motion was to end, s.
        crossed: when a pose was crossed in which a partition is singular, s; None for never.
        ended: "finished", "refused" at the start, "stopped", or "too many steps".
        reached: whether the formulation came behind that pose.
    """

    t_end: float = 0.0
    crossed: float | None = None
    ended: str = "finished"
    reached: bool = False

    def as_python(self) -> str:
        """Return Python code that moves the scene by this formulation and by others."""
        assert self.state is not None
        return python_of_motion(self.scene, self.state, self.t_end, self.subject)


def python_of_motion(scene: Scene, state: State, t_end: float, key: str) -> str:
    """Return Python code that prints how far motions are from that by the formulation `key`."""
    return (
        f"from eomcheck.formulations import applicable\n{reproducer_header(scene)}"
        f"options = dict(q0=[{state.q.tolist()}], v0=[{state.v.tolist()}])\n"
        f"options |= dict(rtol={TIGHT}, atol={TIGHT})\n"
        f"one = eomcheck.simulate_many(scene, {key!r}, {t_end!r}, **options)\n"
        "for key in applicable(scene):\n"
        f"    other = eomcheck.simulate_many(scene, key, {t_end!r}, **options)\n"
        "    apart = abs(one.q[0] - other.q[0]).max(axis=1)\n"
        "    gained = abs(other.energy[0] - other.energy[0, 0]).max()\n"
        '    print(key, other.status[0], "apart", apart[-1], "energy", gained, other.reason[0])\n'
    )


# ---- Judging -------------------------------------------------------------------------------------


def judge_motions(
    cases: Sequence[FuzzCase],
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
        key: (simulate_batch(cases, key, t_end, COARSE), simulate_batch(cases, key, t_end, TIGHT))
        for key in able
    }
    both = {key: (a, b) for key, (a, b) in runs.items() if a is not None and b is not None}
    if not both:
        return [[] for _ in cases]
    with np.errstate(all="ignore"):
        return _judged(cases, both, t_end, [one for one in alone if one[1] in both])


def failures_of_motion(case: FuzzCase, keys: Sequence[str], t_end: float) -> list[MotionFinding]:
    """Return what fails of one motion; see `judge_motions`."""
    return [one for one in findings_of_motion(case, keys, t_end) if one.verdict == "failed"]


def findings_of_motion(case: FuzzCase, keys: Sequence[str], t_end: float) -> list[MotionFinding]:
    """The findings about one motion, alone and beside others; see `judge_motions`."""
    able = [key for key in keys if FORMULATIONS[key].applies_to(case[0])]
    (findings,) = judge_motions([case], keys, t_end, [(0, key) for key in able])
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
    usual = _median(np.array(list(changes.values())))
    growth, of_energy = growth_from_perturbed_starts(cases, both, t_end, scale)
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
            shown = _motion_summary(i, key, cases[i], b, when[i], t_end)
            found[i].append(
                _worst_finding(END_STATES, shown, apart[key][i], allowed[i], np.ones(TIMES))
            )
            if kept:
                found[i].append(_worst_finding(ENERGY, shown, gained[i], of_gain[i], size[i]))
    for i, key in alone:
        a, b = (simulate_single(cases[i], key, t_end, x) for x in (COARSE, TIGHT))
        if a is None or b is None:
            continue
        behind = (np.arange(TIMES) >= when[i]) & solves_for_some(FORMULATIONS[key])
        own = np.where(behind, 0.0, grown(a - b, scale[[i]])[0])
        allowed = np.minimum(unknown[i], C * (own + usual[i] + growth[i]))
        observed = np.abs((b - truth[[i]]) / scale[[i]]).max(axis=2)[0]
        shown = _motion_summary(i, key, cases[i], both[key][1], when[i], t_end)
        found[i].append(_worst_finding(ALONE, shown, observed, allowed, np.ones(TIMES)))
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


class _MotionSummary(NamedTuple):
    key: str
    case: FuzzCase
    t_end: float
    crossed: float | None
    ended: str
    reached: bool


def _motion_summary(
    i: int, key: str, case: FuzzCase, by: SimulatedBatch, place: int, t_end: float
) -> _MotionSummary:
    crossed = t_end * place / (TIMES - 1) if place < TIMES else None
    ended = "stopped" if by.status[i] == "failed" else str(by.status[i])
    ended = "too many steps" if "steps do not reach" in by.reason[i] else ended
    reached = place < TIMES and bool(np.isfinite(by.y[i, place]).all())
    return _MotionSummary(key, case, t_end, crossed, ended, reached)


def _worst_finding(
    claim: str, shown: _MotionSummary, observed: Array, allowed: Array, scale: Array
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
