"""Findings about motions, and Python code that shows them again."""

from __future__ import annotations

from dataclasses import dataclass

from eomcheck.claims.finding import Finding
from eomcheck.claims.reproducer import beginning_of
from eomcheck.lab.fuzzing.moved import TIGHT
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene

END_STATES, ENERGY, ALONE = "end-states", "motion-energy", "motion-alone"
CLAIMS_OF_MOTIONS = {
    END_STATES: "all formulations move a scene alike",
    ENERGY: "T + U stays what it was, where nothing takes or brings energy",
    ALONE: "a motion alone, by another integrator, is what it is beside others",
}
"""Id -> what is claimed of motions."""


@dataclass(frozen=True)
class MotionFinding(Finding):
    """A `Finding` about a motion that starts in its state at t = 0; see `CLAIMS_OF_MOTIONS`.

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
        f"from eomcheck.formulations import applicable\n{beginning_of(scene)}"
        f"options = dict(q0=[{state.q.tolist()}], v0=[{state.v.tolist()}])\n"
        f"options |= dict(rtol={TIGHT}, atol={TIGHT})\n"
        f"one = eomcheck.simulate_many(scene, {key!r}, {t_end!r}, **options)\n"
        "for key in applicable(scene):\n"
        f"    other = eomcheck.simulate_many(scene, key, {t_end!r}, **options)\n"
        "    apart = abs(one.q[0] - other.q[0]).max(axis=1)\n"
        "    gained = abs(other.energy[0] - other.energy[0, 0]).max()\n"
        '    print(key, other.status[0], "apart", apart[-1], "energy", gained, other.reason[0])\n'
    )
