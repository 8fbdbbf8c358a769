"""Which state of a chain to integrate: four of them along reference motions, side by side.

`pytest -s validation/test_chain_states.py` prints what docs/theory/banded.md quotes.
"""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from tests.machine_code import in_machine_code

import eomcheck
from eomcheck.arithmetic.float64 import FLOAT64
from eomcheck.evaluate import Evaluation
from eomcheck.formulations import FORMULATIONS
from eomcheck.model import Array
from eomcheck.motion.stored import load_reference
from eomcheck.scenes import Snake

REFERENCES = Path(__file__).with_name("references")
TOLERANCES = (1e-6, 1e-9, 1e-12)
NAMES = ("paper-rest", "coil-20", "free-3")


class Chain:
    """The functions of a snake's chain at its parameters, in machine code."""

    def __init__(self, snake: Snake):
        self.parameters = snake.parameters(FLOAT64)
        self.solve = partial(in_machine_code, FORMULATIONS["banded"].solution)
        self.of, self.velocity, self.x, self.acceleration = (
            partial(in_machine_code, function)
            for function in (
                Snake.chain,
                Snake.chain_velocity,
                Snake.quasi_velocities,
                Snake.chain_acceleration,
            )
        )

    def projected(self, here: tuple, q: Array, x: Array) -> Array:
        """Return the x that keeps the joints together and is nearest to x in kinetic energy."""
        chain = self.of(*here, q, x)
        return self.solve(*chain._replace(force=chain.mass * x, rest=0 * chain.rest))[0]

    def rates(self, q: Array, x: Array, v: Array | None, project: bool) -> tuple[Array, Array]:
        """Return (q̇, ẋ), or (q̇, v̇) where the state has v."""
        here = self.parameters, FLOAT64.angles(q[2:])
        if v is not None:
            x = self.x(*here, q, v)
        if project:
            x = self.projected(here, q, x)
        xdot = self.solve(*self.of(*here, q, x))[0]
        if v is None:
            return self.velocity(*here, q, x), xdot
        return self.velocity(*here, q, x) if project else v, self.acceleration(*here, x, xdot)


STATES = {
    "q, v": (True, False),
    "q, v, projected": (True, True),
    "q, x": (False, False),
    "q, x, projected": (False, True),
}
"""Whether the state has v, and whether each right-hand side projects it first."""


def moved(reference, tolerance: float, with_v: bool, project: bool) -> tuple[float, float, int]:
    """Return (error of the end state, largest sideways speed of a wheel, right-hand sides)."""
    snake, n = reference.scene, reference.scene.n
    chain = Chain(snake)
    at = Evaluation(snake, reference.q0, eomcheck.velocity(snake, reference.q0, reference.u0))

    def rates(y: Array) -> tuple[Array, Array]:
        return chain.rates(y[:n], y[n:], y[n:] if with_v else None, project)

    found = solve_ivp(
        lambda t, y: np.concatenate(rates(y)),
        (0.0, reference.times[-1]),
        np.concatenate((at.q, at.v if with_v else at.x)),
        method="DOP853",
        t_eval=reference.times,
        rtol=tolerance,
        atol=tolerance,
    )
    states = [(y[:n], rates(y)[0]) for y in found.y.T.copy()]
    here = ((Evaluation(snake, q, v), q, v) for q, v in states)
    sideways = [np.abs(snake.constraint(e.parameters, e.prepared, q, v)).max() for e, q, v in here]
    q, v = states[-1]
    error = max(np.abs(q - reference.q[-1]).max(), np.abs(v - reference.v[-1]).max())
    return error, max(sideways), found.nfev


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("tolerance", TOLERANCES)
def test_quasi_velocities_need_no_projection(name: str, tolerance: float):
    reference = load_reference(REFERENCES / f"{name}.json")
    found = {state: moved(reference, tolerance, *how) for state, how in STATES.items()}
    for state, (error, sideways, count) in found.items():
        print(f"\n{name:10} {tolerance:.0e} {state:16} {error:.1e} {sideways:.1e} {count}", end="")
    error, sideways, count = found["q, x"]
    # Whatever the state, an error is that of its steps: within a factor of the best.
    assert error <= 5 * min(error for error, _, _ in found.values())
    assert sideways <= 10 * tolerance
    # One solve each, where a projection takes two.
    assert count <= 1.1 * min(count for _, _, count in found.values())
