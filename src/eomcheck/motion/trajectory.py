"""A motion as it came out, and how far what was found in it can be trusted."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from eomcheck.console import watched
from eomcheck.errors import RefusedError
from eomcheck.evaluation.doubles import Evaluation
from eomcheck.evaluation.rank import check_rank_kept
from eomcheck.evaluation.sensitivity import acceleration_sensitivity
from eomcheck.evaluation.tolerance import allowed_error, largest
from eomcheck.mechanics.scene import Scene
from eomcheck.motion.crossing import crossing
from eomcheck.motion.integrators import Steps
from eomcheck.motion.motion import Motion
from eomcheck.numbers.contract import Array

LOOKED_AT = 200
"""Most states of a trajectory at which the matrices solved are looked at."""


@dataclass(frozen=True)
class Trajectory:
    """A motion, as one formulation and one integrator found it.

    Attributes:
        scene: the scene.
        key: the formulation.
        integrator: the integrator.
        rtol: relative tolerance.
        atol: absolute tolerance.
        times: (k,), s.
        q: coordinates (k, n).
        v: velocities (k, n).
        multipliers: λ (k, r), or None where the formulation has none.
        energy: T + U (k,), J.
        constraint_residual: |a v + b| (k, r), m/s, or None without constraints.
        right_hand_sides: right-hand sides evaluated.
        steps: steps taken.
        status: "finished", or "failed" if the end was not reached.
        reason: why not.
        seconds: time of the integration alone, s.
        refusal: what the formulation says to the state where it failed, if it refuses it.
        rcond: smallest reciprocal condition number of each matrix solved, by name, at the states
            looked at: `LOOKED_AT` of them at most, first and last included.
        rate_error: bound on the relative error of v̇ that rounding alone makes, the largest of the
            first, the last and the worst conditioned of these states; infinite where none can be
            measured.
        baumgarte: rate of Baumgarte's feedback, 1/s, or None without.
        projection: interval at which the velocity was projected, s, or None.
    """

    scene: Scene
    key: str
    integrator: str
    rtol: float
    atol: float
    times: Array
    q: Array
    v: Array
    multipliers: Array | None
    energy: Array
    constraint_residual: Array | None
    right_hand_sides: int
    steps: int
    status: str
    reason: str
    seconds: float
    refusal: RefusedError | None = None
    rcond: dict[str, float] = field(default_factory=dict)
    rate_error: float = math.inf
    baumgarte: float | None = None
    projection: float | None = None


def trajectory(
    motion: Motion,
    found: Steps,
    integrator: str,
    rtol: float,
    atol: float,
    seconds: float,
    every: Steps | None,
) -> Trajectory:
    """Return what the last `solve` of `motion`, which found these steps, says of the scene.

    Poses that it cannot cross are looked for in `every` step, see `Motion.every_step`.
    """
    scene, formulation = motion.scene, motion.formulation
    course = _Course(motion, found, found if every is None else every)
    reason, refusal = course.refused or ("", None)
    if not (reason or (found.success and course.whole)):
        reason, refusal = _reason(motion, found)
    n, residual, energy = scene.n, course.rows("constraint"), course.rows("energy")
    assert energy is not None
    return Trajectory(
        scene,
        formulation.key,
        integrator,
        rtol,
        atol,
        found.t[: course.kept],
        found.y[: course.kept, :n],
        course.seen["v"][: course.kept],
        course.rows("multipliers"),
        energy[:, 0],
        None if residual is None else np.abs(residual, out=residual),
        motion.rates.calls,
        found.steps,
        "failed" if reason else "finished",
        reason,
        seconds,
        refusal,
        course.rcond,
        course.rate_error(),
    )


class _Course:
    """What follows from the states of a motion, up to the first that fails.

    Seen in machine code. At `LOOKED_AT` of the states, and where a multiplier is no number, the
    public path looks at the matrices that are solved.
    """

    def __init__(self, motion: Motion, found: Steps, every: Steps):
        self.formulation = motion.formulation
        self.seen = motion.seen(found.t, found.y)
        whole = np.asarray(np.isfinite(found.y).all(axis=1))
        for name in ("v", "energy", "constraint"):
            if name in self.seen:
                whole &= np.isfinite(self.seen[name]).all(axis=1)
        count = len(whole)
        self.kept = count if whole.all() else int(np.argmin(whole))
        self.rcond: dict[str, float] = {}
        self.refused: tuple[str, RefusedError] | None = None
        self._looked: dict[str, Evaluation] = {}
        self._worst = math.inf
        between = motion.crossed(every.t, every.y)
        if between is not None:
            refusal = crossing(*between)
            self.refused = str(refusal), refusal
            self.kept = min(self.kept, int(np.searchsorted(found.t, between[0], "right")))
        places = set(np.linspace(0, count - 1, min(count, LOOKED_AT)).astype(int).tolist())
        if "multipliers" in self.seen:
            without = np.isnan(self.seen["multipliers"]).any(axis=1)
            places |= set(np.flatnonzero(without)[:LOOKED_AT].tolist())
        looks = sorted(place for place in places if place < self.kept)
        place = 0
        with watched(f"looking at matrices of {self.formulation.key}", count, lambda: place):
            for place in looks:
                t = float(found.t[place])
                try:
                    self._look(motion, t, found.y[place])
                except RefusedError as refusal:
                    self.refused = f"the state at t = {t:.9g} s is refused: {refusal}", refusal
                    self.kept = place
                    break
        self.whole = self.kept == count

    def _look(self, motion: Motion, t: float, y: Array) -> None:
        at = motion.evaluation(y, t)
        if at is None:
            raise RefusedError("v", math.nan, 0.0, "v overflows: doubles cannot hold it")
        if motion.choice is not None:
            check_rank_kept(at, motion.partition)
        found = at.acceleration(self.formulation).rcond
        for name, rcond in found.items():
            self.rcond[name] = min(rcond, self.rcond.get(name, 1.0))
        # No more of them than are asked again: what they know grows with the matrices.
        self._looked.setdefault("first", at)
        self._looked["last"] = at
        if min(found.values(), default=math.inf) < self._worst:
            self._worst = min(found.values())
            self._looked["worst"] = at

    def rows(self, name: str) -> Array | None:
        """Return what was seen at the states kept (k, ·), or None."""
        return self.seen[name][: self.kept] if name in self.seen else None

    def rate_error(self) -> float:
        """Return the largest relative error bound of v̇ at the first, last and worst state."""
        worst = 0.0
        for at in {id(at): at for at in self._looked.values()}.values():
            size = largest(at.acceleration(self.formulation).vdot)
            bound = allowed_error(acceleration_sensitivity(at, self.formulation))
            # `max` would take NaN, ∞ / ∞, for small.
            if not math.isfinite(bound + size):
                return math.inf
            worst = max(worst, bound / size if size > 0 else 0.0)
        return worst if self._looked else math.inf


def _reason(motion: Motion, found: Steps) -> tuple[str, RefusedError | None]:
    """Say why an integration did not reach its end."""
    if motion.rates.failed == 0:
        return "the energy overflows" if found.success else found.message, None
    when = motion.rates.failure_time
    y = found.y[-1] if len(found.y) and np.isfinite(found.y[-1]).all() else motion.y0
    why, refusal = "it overflows, or a matrix is singular there", None
    try:
        q, v = motion.split(y, when)
        # A velocity that the independent ones do not determine is what a_1 refuses as well.
        at = Evaluation(motion.scene, q, np.nan_to_num(v), when)
        at.independent_partition = motion.partition
        at.acceleration(motion.formulation)
    except RefusedError as error:
        why, refusal = str(error), error
    return f"the right-hand side is not finite at t = {when:.9g} s: {why}", refusal
