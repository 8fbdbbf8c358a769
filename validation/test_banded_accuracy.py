"""The digits that the banded formulation keeps, against the enclosed truth, family by family.

`pytest -s validation/test_banded_accuracy.py` prints what docs/theory/banded.md quotes.
"""

import numpy as np
import pytest

from eomcheck.claims import Case
from eomcheck.errors import RefusedError
from eomcheck.evaluation.certified import true_error, true_state
from eomcheck.evaluation.doubles import Evaluation
from eomcheck.evaluation.tolerance import largest
from eomcheck.formulations import FORMULATIONS
from eomcheck.motion.right_hand_side import RightHandSide
from eomcheck.numbers.contract import Array
from eomcheck.scenes import Snake


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


@pytest.mark.parametrize("links", SIZES)
@pytest.mark.parametrize("family", FAMILIES)
def test_banded_keeps_12_digits_in_machine_code_or_not(family: str, links: int):
    scene = FAMILIES[family](links)
    q, _ = scene.initial_state()
    # The motion of pattern(1000) that starts with such speeds has no tail in doubles.
    u = [0.0, 0.0] if family == "pattern" else [1.0, 0.5]
    truth, at = true_state(scene, q, u)
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
