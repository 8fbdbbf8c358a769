"""A formulation of a scene in machine code, ready to be integrated from a state."""

from __future__ import annotations

import numpy as np

from eomcheck.console import watched
from eomcheck.evaluation.doubles import Evaluation
from eomcheck.formulations import Formulation
from eomcheck.mechanics.scene import Scene
from eomcheck.motion.crossing import crossed, solves_partition
from eomcheck.motion.integrators import Steps, integrate
from eomcheck.motion.observe import observer_of
from eomcheck.motion.right_hand_side import RightHandSide, choice_for, kernel_of
from eomcheck.motion.stabilization import check_stabilization, in_pieces, projected
from eomcheck.motion.state import number_of_speeds, state_of, take_speeds
from eomcheck.motion.trace import ACCELERATION, block_of, parameter_arrays
from eomcheck.numbers.contract import Array

AT_ONCE = 2**20
"""Numbers that are seen at once, of as many states as that makes."""

SEEN = "v", "energy", "constraint"
"""What is kept of what `observations_on` shows."""


class Motion:
    """A formulation of a scene in machine code, with the state vector that it integrates.

    Args:
        scene: the scene.
        formulation: the formulation.
        q0: initial coordinates (n,).
        v0: initial velocities (n,), consistent with the constraints.
        u0: initial generalized speeds (p,), by default those of v0.
        baumgarte: rate of Baumgarte's feedback, 1/s, or None.

    Raises:
        InputError: `baumgarte` is not positive or does not apply.
        RefusedError: the generalized speeds do not exist, or it is not clear which constraints are
            independent. Those of the start are kept all along the motion.
    """

    def __init__(
        self,
        scene: Scene,
        formulation: Formulation,
        q0: Array,
        v0: Array,
        u0: Array | None = None,
        baumgarte: float | None = None,
    ):
        check_stabilization(scene, formulation, baumgarte, None)
        self.scene, self.formulation, self.baumgarte = scene, formulation, baumgarte
        at = Evaluation(scene, q0, v0)
        if formulation.state == "q, u":
            scene.refuse_speeds(at.q)
        self.partition = at.partition_for(formulation, pivoted=False)
        self.choice = choice_for(at, formulation)
        if formulation.state == "q, u" and u0 is not None:
            at.u = u0
        self.y0 = state_of(at, formulation)
        self.speeds = number_of_speeds(scene, formulation)
        self.rates = RightHandSide(scene, formulation, baumgarte, self.choice)
        self.solves_partition = solves_partition(scene, formulation)

    def solve(self, t_end: float, projection: float | None = None, **options) -> Steps:
        """Return `integrate`'s result for this motion; counts are set anew.

        Args:
            t_end: end, s.
            projection: interval at which the velocity is projected onto the constraints, s.
            options: of `integrate`.
        """
        self.rates.reset()
        label = f"integrating by {self.formulation.key}"
        with watched(label, t_end, lambda: self.rates.time):
            return self._solve(t_end, projection, **options)

    def every_step(
        self, t_end: float, projection: float | None = None, *, output_times=None, **options
    ) -> Steps | None:
        """Return all states that `solve` steps to on its way to `output_times`.

        None where those are its output, or where it has no pose that it cannot cross: poses lie
        between steps, and between output times that are further apart the way is not straight.
        """
        if output_times is None or not self.solves_partition:
            return None
        return self.solve(t_end, projection, **options)

    def _solve(self, t_end: float, projection: float | None, **options) -> Steps:
        call = self.rates.address, self.rates.arguments
        if projection is None:
            return integrate(*call, self.y0, t_end, **options)
        first, times = options.pop("first_step", 0.0), options.pop("output_times", None)
        most = options.pop("max_steps", 0)

        def piece(start, end, y, first_step, output_times, max_steps) -> Steps:
            return integrate(
                *call,
                y,
                end,
                t_start=start,
                first_step=first_step,
                output_times=output_times,
                max_steps=max_steps,
                **options,
            )

        return in_pieces(piece, self.project, self.y0, t_end, projection, first, times, most)

    def project(self, t: float, y: Array) -> Array:
        """Return the state vector y with its speeds projected onto the constraints.

        Raises:
            RefusedError: a matrix is singular to working precision.
        """
        n, end = self.scene.n, self.scene.n + self.speeds
        here = self.scene, self.formulation, self.partition
        speeds = projected(*here, t, y[:n], y[n:end])
        return np.concatenate((y[:n], speeds, y[end:]))

    def split(self, y: Array, t: float = 0.0) -> tuple[Array, Array]:
        """Return (q (n,), v (n,)) of a state vector at time t, s; NaN where it is not finite."""
        n = self.scene.n
        if not np.isfinite(y).all():
            return np.full(n, np.nan), np.full(n, np.nan)
        at = Evaluation(self.scene, y[:n], np.zeros(n), t)
        del at.v
        take_speeds(at, self.formulation, y[n : n + self.speeds])
        return at.q, at.v

    def seen(self, t: Array, y: Array) -> dict[str, Array]:
        """Return v, energy, constraint and multipliers, each (k, ·), of states y (k, size).

        Constraint and multipliers only where there are any. States are seen a few at a time, so
        that little memory is taken but for what is returned.
        """
        observer = observer_of(self.scene, self.formulation)
        here = self.scene, self.formulation
        solving = kernel_of(*here, also=ACCELERATION, choice=self.choice)
        looks = []
        for kernel, wanted in ((observer, SEEN), (solving, ("multipliers",))):
            names = [name for name in wanted if name in kernel.outputs]
            if names:
                looks.append((kernel, block_of(kernel, self.scene), names))
        found = {
            name: np.empty((len(t), k.outputs[name])) for k, _, names in looks for name in names
        }
        rows = max(1, AT_ONCE // max(kernel.size for kernel, *_ in looks))
        first = 0
        with watched(f"looking at the states of {self.formulation.key}", len(t), lambda: first):
            for first in range(0, len(t), rows):
                some = slice(first, first + rows)
                for kernel, block, names in looks:
                    seen = kernel.rows(block, t[some, None], y[some, :, None])
                    for name in names:
                        found[name][some] = seen[name][:, :, 0]
        return found

    def crossed(self, t: Array, y: Array) -> tuple[float, float] | None:
        """Return the times, s, between which states y (k, size) went over such a pose, or None."""
        if not self.solves_partition or len(t) == 0:
            return None
        parameters = {name: np.ravel(x) for name, x in parameter_arrays(self.scene).items()}
        here = self.scene, self.formulation, parameters
        # From where it started, which need not be an output.
        t, y = np.concatenate(([0.0], t)), np.vstack((self.y0, y))
        (place,) = crossed(*here, t[:, None], y[:, :, None])
        return None if place is None else (float(t[place[0]]), float(t[place[1]]))

    def evaluation(self, y: Array, t: float) -> Evaluation | None:
        """Return the evaluation at a state vector; None where doubles cannot hold it."""
        q, v = self.split(y, t)
        if not np.isfinite((q, v)).all():
            return None
        at = Evaluation(self.scene, q, v, t)
        at.independent_partition = self.partition
        if self.formulation.state == "q, u":
            at.u = y[self.scene.n : self.scene.n + self.speeds]
        return at
