"""A chain: its claims, the digits that the banded formulation keeps, and which state to integrate.

`pytest -s validation/test_chain.py` prints the numbers of docs/theory/banded.md and
docs/evidence/stability.md.
"""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from tests.machine_code import MachineCode

import eomcheck
from eomcheck.claims import Case
from eomcheck.errors import RefusedError
from eomcheck.evaluation.certified import true_acceleration, true_error
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import largest
from eomcheck.formulations import FORMULATIONS
from eomcheck.motion.reference_solution import load_reference
from eomcheck.motion.right_hand_side import RightHandSide
from eomcheck.numbers.generic import FLOAT64, Array
from eomcheck.scenes import Snake
from validation.harness import holds


@pytest.mark.sampled(5)
@pytest.mark.parametrize(
    "claim",
    [
        "chain-velocity",
        "chain-energy",
        "chain-forces",
        "chain-coupling",
        "chain-remainder",
        "chain-acceleration",
    ],
)
def test_the_numbers_of_a_chain(claim: str, links, examples):
    holds(claim, links, examples)


# ---- Digits, family by family, against the enclosed truth ----------------------------------------


def drawn(links: int, **given) -> Snake:
    """Return a snake of random links in a random pose, but for what is given."""
    random = np.random.default_rng(links)
    made = {
        "mass": random.uniform(0.5, 2, links),
        "length": random.uniform(0.5, 2, links),
        "inertia": random.uniform(0.1, 1, links),
        "stiffness": random.uniform(10, 100, links - 1),
        "wheel_angle": random.uniform(-1, 1, links),
        "pose": random.uniform(-2, 2, links),
    }
    return Snake(**(made | given))


def decades(links: int) -> Array:
    """Return numbers from 1e-8 to 1e8."""
    return 10.0 ** np.random.default_rng(links).uniform(-8, 8, links)


def nearly_across(links: int) -> Array:
    return np.where(np.arange(links) % 300 == 5, np.pi / 2 - 1e-9, 0.3)


FAMILIES = {
    "coil": Snake.coil,
    "pattern": Snake.pattern,
    "straight": lambda N: drawn(N, wheel_angle=np.zeros(N), pose=np.zeros(N)),
    "random": drawn,
    "masses over 16 decades": lambda N: drawn(N, mass=decades(N)),
    "the same, rising": lambda N: drawn(N, mass=np.geomspace(1e-8, 1e8, N)),
    "the same, falling": lambda N: drawn(N, mass=np.geomspace(1e8, 1e-8, N)),
    "masses and inertias": lambda N: drawn(N, mass=decades(N), inertia=decades(N)[::-1]),
    "no inertia": lambda N: drawn(N, inertia=np.zeros(N)),
    "wheels nearly across": lambda N: drawn(N, wheel_angle=nearly_across(N)),
}
SIZES = (7, 100, 1000)
REFUSED = {("pattern", 1000)}
"""Where the constraints are dependent in doubles, see the last test."""


def error(vdot: Array, truth) -> float:
    return largest(true_error(vdot, truth)) / largest(truth.doubles())


@pytest.mark.sampled(3)
@pytest.mark.parametrize("links", SIZES)
@pytest.mark.parametrize("family", FAMILIES)
def test_banded_keeps_12_digits_in_machine_code_or_not(family: str, links: int):
    scene = FAMILIES[family](links)
    q, _ = scene.initial_state()
    # The motion of pattern(1000) that starts with such speeds has no tail in doubles.
    u = [0.0, 0.0] if family == "pattern" else [1.0, 0.5]
    truth, at = true_acceleration(scene, q, u)
    found: dict[str, float | str] = {}
    for key in ("banded", "au", "kane"):
        try:
            found[key] = error(at.acceleration(FORMULATIONS[key]).vdot, truth)
        except RefusedError as refusal:
            found[key] = f"refused ({refusal.what} {refusal.rcond:.0e})"
    rates = RightHandSide(scene, FORMULATIONS["banded"])
    xdot = rates(at.t, np.concatenate((at.q, at.x)))[scene.n :]
    vdot = scene.chain_acceleration(at.parameters, at.prepared, at.x, xdot)
    refused = np.isnan(vdot).all()
    found["machine code"] = "refused (NaN)" if refused else error(vdot, truth)
    line = (f"{key} {x if isinstance(x, str) else format(x, '.1e')}" for key, x in found.items())
    print(f"\n{family:22} {links:4}  {', '.join(line)}", end="")
    for way in ("banded", "machine code"):
        assert isinstance(found[way], str) == ((family, links) in REFUSED)
        assert isinstance(found[way], str) or found[way] < 1e-12


@pytest.mark.night
def test_pattern_is_refused_where_its_constraints_are_dependent_in_doubles():
    """A motion about link 180 dies away on both sides: the longer the snake, the less holds it."""
    refused: dict[int, tuple[bool, ...]] = {}
    smallest: dict[int, float] = {}
    for links in (100, 200, 220, 240, 300):
        scene = Snake.pattern(links)
        at = Evaluation(scene, *scene.initial_state())
        singular = np.linalg.svd(at.terms.a, compute_uv=False)
        smallest[links] = singular[-1] / singular[0]
        case = Case(at, (FORMULATIONS["banded"], FORMULATIONS["au"]), ())
        refused[links] = tuple(case.result(f) is None for f in case.formulations)
        print(f"\npattern({links}): σ_min/σ_max of a {smallest[links]:.0e}", end="")
    assert refused == {
        100: (False, False),
        200: (False, False),
        220: (False, False),
        240: (True, True),
        300: (True, True),
    }
    assert smallest[200] > 1e-4 > 1e-13 > smallest[240] > 1e-15 > smallest[300]


# ---- Which state to integrate: four of them along reference motions, side by side ----------------

REFERENCES = Path(__file__).with_name("references")
TOLERANCES = (1e-6, 1e-9, 1e-12)
MOTIONS = ("paper-rest", "coil-20", "free-3")


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


@pytest.mark.night
@pytest.mark.parametrize("name", MOTIONS)
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
