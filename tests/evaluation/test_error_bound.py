"""Each part of the estimate of rounding errors is needed: a state at which the rest does not do.

Elsewhere: what underflows (`test_certified`), and the sizes of noise (`tests/numbers/test_noise`).
"""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from unittest.mock import patch

import numpy as np
import pytest
from validation.test_no_silent_error import with_an_entry_of_nothing_but_rounding

import eomcheck
from eomcheck.claims import CLAIMS, Case
from eomcheck.evaluation import perturbed
from eomcheck.evaluation import perturbed as sensitivity
from eomcheck.evaluation.certified import true_acceleration, true_error
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import (
    acceleration_sensitivity,
    check_consistent,
    sensitivity_of,
    violation,
)
from eomcheck.evaluation.tolerance import (
    INCONCLUSIVE,
    UNDERFLOW,
    allowed_error,
    largest,
    well_conditioned,
)
from eomcheck.formulations import FORMULATIONS
from eomcheck.kernels import perturbed_solves
from eomcheck.numbers.linear import SOLVERS, active_noise, reference_solve
from eomcheck.numbers.noise import Noise
from eomcheck.scenes import Snake


def bound(at: Evaluation, key: str, without: AbstractContextManager | None = None) -> float:
    """Return the error bound at a state, on request without a part of the estimate."""
    fresh = Evaluation(at.scene, at.q, at.v)
    with without or nullcontext():
        return allowed_error(acceleration_sensitivity(fresh, FORMULATIONS[key]))


def error(at: Evaluation, key: str, truth: eomcheck.Enclosure) -> float:
    """Return the true error."""
    return largest(true_error(at.acceleration(FORMULATIONS[key]).vdot, truth))


# ---- How far a result moves ----------------------------------------------------------------------


def size_alone(at, quantity, coordinates=False, solved=False, **_):
    found = sensitivity_of(at, quantity, coordinates, solved)
    return largest(np.asarray(quantity(at))) if np.isfinite(found) else found


@pytest.mark.parametrize("key", ["el", "em"])
def test_the_size_of_a_result_alone_bounds_no_error_of_nearly_dependent_constraints(key: str):
    snake = Snake([1.0, 2.0], [1.0, 2.0], [0.1, 0.2], [3.0], [0.25, 0.0])
    truth, at = true_acceleration(snake, [0, 0, 0.5, 0.75 + 1e-4], [1.0, 0.5])
    nothing_moved = {"sensitivity_of": size_alone, "_input_sensitivity": lambda *_: 0.0}
    alone = bound(at, key, patch.multiple(sensitivity, **nothing_moved))
    assert 10 * alone < error(at, key, truth) < bound(at, key)


# ---- What elimination does to each right-hand side -----------------------------------------------


def of_its_own_factors(name):
    """Return how the matrix was solved as it is, but for what elimination rounded there."""
    like = reference_solve(name)
    return None if like is None else like._replace(rounding=None)


NOTHING_OF_FACTORS = patch.object(perturbed_solves, "reference_solve", of_its_own_factors)


def without_factors(A, b, name):
    """Solve with A, b and x moved alone, and not by what elimination rounds."""
    noise = active_noise()
    first, sides = A.shape[-1] ** 2, b.size // len(b)
    draws = noise.draws

    def quiet(count):
        found = draws(count).copy()
        found[:, first + sides : first + 2 * sides] = 0.0
        return found

    with patch.object(noise, "draws", quiet):
        return perturbed_solves.perturbed_solve(A, b, name)


def test_changes_of_the_entries_alone_bound_no_error_where_solutions_cancel():
    """Three links in a line, wheels straight: what the right-hand sides give cancels."""
    snake = Snake(
        [0.12689859050047594, 0.005748741466433394, 0.22307883519189656],
        [4.355577307228323, 0.003376641422144537, 0.002840447344467551],
        [0.0001578580366471679, 11.930515385886766, 0.006933660889087129],
        None,
        [0.0, 7.272740609397704e-10, -9.808007512794337e-11],
    )
    theta = [1.0723342844630022, 1.0723342851902762, 1.0723342843649222]
    u = [-0.00514349662516115, 0.0003286950600909576]
    truth, at = true_acceleration(snake, [-0.7444062358363321, 0.8581677077936065, *theta], u)
    alone = bound(at, "au", patch.dict(SOLVERS, {Noise: without_factors}))
    assert alone < error(at, "au", truth) < bound(at, "au")


def test_factors_of_copies_bound_no_error_of_what_is_eliminated_by_an_entry_of_rounding():
    """The last wheel is 1e-15 rad from across: M_ML has an entry that only rounding makes."""
    scene, (q, v, _) = with_an_entry_of_nothing_but_rounding()
    truth = eomcheck.enclose(scene, "ml", q, v=v, digits=20)
    at = Evaluation(scene, q, v)
    assert bound(at, "ml", NOTHING_OF_FACTORS) < error(at, "ml", truth) < bound(at, "ml")


# ---- Velocities that violate the constraints, within what is let pass ----------------------------


def entries_alone(at, v, noise):
    return noise.perturbed(v, np.abs(v)) - v


SLIPPING = [
    (
        Snake([5.43, 0.14], [0.23, 0.38], [0.298, 0.005], None, [-0.5, 0.0]),
        [0.0, 0.0, 1.6, 1.1005502241332392],
        [-0.12458373999269806, -0.2670264135119646, 0.0999999999999924, -0.0540015724621517],
    ),
    (
        Snake([8.01, 0.69, 0.15], [0.24, 6.68, 0.1], [0.676, 0.22, 0.01], None, [1.1, -1.1, 0.7]),
        [0.0, 0.0, -0.20000000000000007, 2.076392266200999, 0.3527845324019979],
        [
            *[0.14816231334956362, 0.27427337126649176],
            *[-1.0000000000001452, 0.04051096916816206, -1.9046370231731138],
        ],
    ),
    (
        Snake([2.72, 6.63, 9.69], [4.88, 2.5, 0.15], [0.001, 0.051, 0.664], None, [1.3, 0.2, -0.7]),
        [0.0, 0.0, -2.0, -1.0, -0.5],
        [
            *[1.384943399481547, -0.39848430326723216],
            *[-0.9000000000001245, 0.7147305147999987, 2.8293355677200536],
        ],
    ),
]
"""Ordinary scenes, and velocities that the check of consistency only just lets pass."""


def apart(at: Evaluation) -> float:
    """Return how far two accelerations differ, of which one reads all of v and one only its u."""
    au, kane = (at.acceleration(FORMULATIONS[key]).vdot for key in ("au", "kane"))
    return largest(au - kane)


@pytest.mark.parametrize(("snake", "q", "v"), SLIPPING)
def test_formulations_agree_at_any_velocity_that_is_let_pass(snake: Snake, q: list, v: list):
    at = Evaluation(snake, q, v)
    check_consistent(at)
    residual, allowed = violation(at, at.v)
    assert largest(residual / allowed) > 0.9
    assert 1.5 * apart(at) < bound(at, "au") + bound(at, "kane")
    found = Case(at, (FORMULATIONS["au"], FORMULATIONS["kane"]), ()).evaluate(CLAIMS["equivalence"])
    assert {f.verdict for f in found} == {"passed"}


@pytest.mark.parametrize(("snake", "q", "v"), SLIPPING[1:])
def test_changes_of_the_entries_of_v_alone_do_not_explain_how_they_differ(snake, q, v):
    at = Evaluation(snake, q, v)
    alone = [
        bound(at, key, patch.object(perturbed, "_velocity_perturbations", entries_alone))
        for key in ("au", "kane")
    ]
    assert sum(alone) < apart(at)


# ---- Matrices of which nothing is left -----------------------------------------------------------


def at_rest(snake: Snake, *theta: float) -> Evaluation:
    """Return a snake without springs at rest: whatever the matrix, 0 solves the equations."""
    return Evaluation(snake, [0, 0, *theta], np.zeros(2 + len(theta)))


@pytest.mark.parametrize(
    ("at", "key"),
    [
        (at_rest(Snake([1.52], [1e8], [0.178], None, [-0.88]), 1.41), "ml"),
        (
            at_rest(
                Snake([0.53, 1.8], [0.86, 1.12], [0.186, 0.195], None, [0.0, 0.0]),
                *(2.8199999999999945, 2.819999999987761),
            ),
            "el",
        ),
    ],
)
def test_a_determinant_that_rounding_decides_leaves_no_bound(at: Evaluation, key: str):
    without = patch.object(sensitivity, "_matrices_resolved", lambda *_: True)
    assert bound(at, key) == np.inf
    assert bound(at, key, without) < UNDERFLOW


def test_a_condition_number_that_leaves_three_digits_of_none_leaves_no_bound():
    snake = Snake([1.94, 1.16], [1.63, 0.57], [0.165, 0.174], None, [-0.49, 0.8])
    at = at_rest(snake, -0.26, -1.54999999997792)
    rcond = min(at.acceleration(FORMULATIONS["el"]).rcond.values())
    assert allowed_error(1 / rcond) > INCONCLUSIVE
    assert bound(at, "el") == np.inf
    assert (
        bound(at, "el", patch.object(sensitivity, "well_conditioned", lambda *_: True)) < UNDERFLOW
    )


def test_of_several_matrices_the_worst_conditioned_decides():
    worst = 1.0 / (INCONCLUSIVE / allowed_error(1.0))
    assert well_conditioned({"M": 1.0, "a_1": 2.0 * worst})
    assert not well_conditioned({"M": 1.0, "a_1": 0.5 * worst})
    lanes = {"M": np.ones(2), "a_1": worst * np.array([0.5, 2.0])}
    assert well_conditioned(lanes).tolist() == [False, True]


# ---- Which of several pivots ---------------------------------------------------------------------

TIED = [1.0, 1.3759313442838287e-06, 1.3759313419090113e-06, 1.226775801336115e-05]
"""Lengths with which rows of M_El, and of M_IM, have pivots of the same size."""
ACROSS = [0.0, 0.0, -1.3688761976085697, -6.637238402472314e-14]
AT = (
    [-9.062077838223202e-56] * 6,
    [
        *(-6.796177018300744e-22, 6.879656721272827e-07, -1.3759313442545654e-06),
        *(0.999999999978732, -1.000000001704698, 0.11215833755083748),
    ],
)


def tied(mass: list[float], inertia: list[float]) -> Snake:
    stiffness = [3.244731764819549e-07, 12.305827970533176, 0.0]
    damping = [77171485834.20601, 0.0, 0.0]
    return Snake(mass, TIED, inertia, stiffness, ACROSS, damping=damping)


@pytest.mark.parametrize(
    ("key", "snake"),
    [
        (
            "el",
            tied(
                [
                    27.501227487845036,
                    1.1563955743164103e-06,
                    8.515817290200996e-4,
                    0.03162277660168379,
                ],
                [1564372.7742405706, 1.0, 1.0, 0.002270183297644602],
            ),
        ),
        (
            "im",
            tied(
                [
                    0.027026897545729563,
                    1.1364505356423903e-9,
                    8.368939950849061e-7,
                    3.107735986340777e-5,
                ],
                [1.0, 1.0, 1.0, 0.002270183297644602],
            ),
        ),
    ],
    ids=["el", "im"],
)
def test_a_choice_between_equal_pivots_is_the_same_in_every_copy(key: str, snake: Snake):
    """By the other row, which most copies would take, nearly nothing is lost."""
    at = Evaluation(snake, *AT)
    truth = eomcheck.enclose(snake, key, at.q, v=at.v, digits=20)
    any_row = patch.object(perturbed_solves, "reference_solve", lambda _: None)
    assert bound(at, key, any_row) < error(at, key, truth) < bound(at, key)
