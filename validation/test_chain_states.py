"""Which state of a chain to integrate: four of them along reference motions, side by side.

`pytest -s validation/test_chain_states.py` prints what docs/theory/banded.md quotes.
"""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from tests.machine_code import MachineCode

import eomcheck
from eomcheck.evaluation.doubles import Evaluation
from eomcheck.formulations import FORMULATIONS
from eomcheck.motion.stored import load_reference
from eomcheck.numbers.contract import Array
from eomcheck.numbers.float64 import FLOAT64

REFERENCES = Path(__file__).with_name("references")
TOLERANCES = (1e-6, 1e-9, 1e-12)
NAMES = ("paper-rest", "coil-20", "free-3")


@cache
def rates_of(name: str, with_v: bool, project: bool) -> Callable[[Array], Array]:
    """Return the function (q, x) -> (q̇, ẋ), or (q, v) -> (q̇, v̇), in machine code."""
    snake = load_reference(REFERENCES / f"{name}.json").scene
    solve, n = FORMULATIONS["banded"].solution, snake.n

    def projected(here: tuple, q: Array, x: Array) -> Array:
        """Return the x that keeps the joints together and is nearest to x in kinetic energy."""
        chain = snake.chain(*here, q, x)
        return solve(*chain._replace(force=chain.mass * x, rest=0 * chain.rest))[0]

    def rates(parameters, y: Array) -> tuple[Array, Array]:
        q, x = y[:n], y[n:]
        here = parameters, snake.prepare(q[0].tape, parameters, q, 0)
        if with_v:
            x = snake.quasi_velocities(*here, q, x)
        if project:
            x = projected(here, q, x)
        xdot = solve(*snake.chain(*here, q, x))[0]
        if not with_v:
            return snake.chain_velocity(*here, q, x), xdot
        qdot = snake.chain_velocity(*here, q, x) if project else y[n:]
        return qdot, snake.chain_acceleration(*here, x, xdot)

    parameters = snake.parameters(FLOAT64)
    given = parameters, np.zeros(n + (n if with_v else snake.s))
    run = MachineCode(rates, *given).of_last(*given)
    return lambda y: np.concatenate(run(y))


STATES = {
    "q, v": (True, False),
    "q, v, projected": (True, True),
    "q, x": (False, False),
    "q, x, projected": (False, True),
}
"""Whether the state has v, and whether each right-hand side projects it first."""


def moved(name: str, tolerance: float, with_v: bool, project: bool) -> tuple[float, float, int]:
    """Return (error of the end state, largest sideways speed of a wheel, right-hand sides)."""
    reference = load_reference(REFERENCES / f"{name}.json")
    snake, n, rates = reference.scene, reference.scene.n, rates_of(name, with_v, project)
    at = Evaluation(snake, reference.q0, eomcheck.velocity(snake, reference.q0, reference.u0))

    found = solve_ivp(
        lambda t, y: rates(y),
        (0.0, reference.times[-1]),
        np.concatenate((at.q, at.v if with_v else at.x)),
        method="DOP853",
        t_eval=reference.times,
        rtol=tolerance,
        atol=tolerance,
    )
    states = [(y[:n], rates(y)[:n]) for y in found.y.T.copy()]
    here = ((Evaluation(snake, q, v), q, v) for q, v in states)
    sideways = [np.abs(snake.constraint(e.parameters, e.prepared, q, v)).max() for e, q, v in here]
    q, v = states[-1]
    error = max(np.abs(q - reference.q[-1]).max(), np.abs(v - reference.v[-1]).max())
    return error, max(sideways), found.nfev


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("tolerance", TOLERANCES)
def test_quasi_velocities_need_no_projection(name: str, tolerance: float):
    found = {state: moved(name, tolerance, *how) for state, how in STATES.items()}
    for state, (error, sideways, count) in found.items():
        print(f"\n{name:10} {tolerance:.0e} {state:16} {error:.1e} {sideways:.1e} {count}", end="")
    error, sideways, count = found["q, x"]
    # Whatever the state, an error is that of its steps: within a factor of the best.
    assert error <= 5 * min(error for error, _, _ in found.values())
    assert sideways <= 10 * tolerance
    # One solve each, where a projection takes two.
    assert count <= 1.1 * min(count for _, _, count in found.values())
