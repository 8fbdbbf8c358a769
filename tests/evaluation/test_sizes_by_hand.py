"""Sensitivities, ranks and slips of hand-made numbers: each figure worked out beforehand."""

from __future__ import annotations

from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eomcheck.errors import RefusedError
from eomcheck.evaluation import constraint_rank
from eomcheck.evaluation import perturbed as sensitivity
from eomcheck.evaluation.tolerance import (
    INCONCLUSIVE,
    allowed_error,
    larger,
    largest,
    well_conditioned,
)
from eomcheck.formulations import FORMULATIONS
from eomcheck.mechanics.records import Terms
from eomcheck.numbers.batch_arrays import BatchArray
from eomcheck.numbers.generic import EPS
from eomcheck.numbers.noise import SAMPLES, STEP

AU = FORMULATIONS["au"]

# ---- Sensitivities -------------------------------------------------------------------------------

LIMIT = INCONCLUSIVE * STEP / allowed_error(1.0) / np.log(2.0)
"""By how much log2 of a determinant may change."""


@pytest.mark.parametrize(
    ("signs", "changes", "told"),
    [
        ([1, 1, 1, 1, 1], [0.9, -0.9, 0.0, 0.9, 0.0], True),
        ([1, 1, 1, 1, 1], [0.0, 0.0, 0.0, 1.1, 0.0], False),
        ([1, 1, 1, 1, 1], [-1.1, 0.0, 0.0, 0.0, 0.0], False),
        ([1, 1, 1, 1, 1], [0.0, 0.0, 0.0, 0.0, 9.0], True),  # by more noise
        ([1, 1, 1, 1, -1], [0.0] * 5, True),
        ([1, 1, 1, -1, 1], [0.0] * 5, False),
        ([0, 1, 1, 1, 1], [0.0] * 5, False),
        ([1, 1, 1, 1, 1], [0.0, np.nan, 0.0, 0.0, 0.0], False),
    ],
)
@pytest.mark.parametrize("which", [0, 1])
def test_a_determinant_is_told_where_all_copies_have_its_sign_and_its_size(
    signs: list[int], changes: list[float], told: bool, which: int
):
    key = "au", True
    names = "M_Au", "a_1"
    fine = SimpleNamespace(sign=-np.ones(5), log_determinant=np.full(5, 7.0))
    moved = SimpleNamespace(
        sign=-np.array(signs, float), log_determinant=7.0 + LIMIT * np.array(changes)
    )
    copies = {name: moved if i == which else fine for i, name in enumerate(names)}
    own = {name: SimpleNamespace(sign=-1.0, log_determinant=7.0) for name in names}

    samples: Any = SimpleNamespace(solves={key: copies})
    at: Any = SimpleNamespace(unit_roundoff=2.0**-53, solves={key: own}, states=0)
    assert sensitivity._matrices_resolved(at, samples, key).tolist() == [told]


def test_what_is_read_counts_by_its_size_and_the_change_of_the_copy_that_moves_most():
    here = np.array([1.0, -4.0])
    moves = np.array([[1, 0], [0, 3], [-5, 0], [2, 2], [0, 99]]) * STEP
    asked = []

    def read(formulation: Any, pivoted: bool) -> Any:
        asked.append((formulation.key, pivoted))
        return SimpleNamespace(vdot=BatchArray(here + moves), multipliers=None)

    samples: Any = SimpleNamespace(solution_without_noise=read)
    at: Any = SimpleNamespace(acceleration=lambda f, pivoted: SimpleNamespace(vdot=here), states=0)
    found = sensitivity._input_sensitivity(at, samples, AU, "vdot", True)
    assert found.tolist() == [4.0 + 5.0]
    assert asked == [("au", True)]


@pytest.mark.parametrize(
    ("rcond", "found", "determined", "read", "expected"),
    [
        ({"M": 0.5}, 3.0, True, 2.0, 3.0),
        ({"M": 0.5}, 3.0, True, 7.0, 7.0),
        ({}, 3.0, True, 2.0, 3.0),
        ({"M": 0.5, "a_1": 1e-13}, 3.0, True, 2.0, np.inf),
        ({"M": 0.5}, np.inf, True, 2.0, np.inf),
        ({"M": 0.5}, 3.0, False, 2.0, np.inf),
    ],
)
def test_an_acceleration_is_as_sensitive_as_what_makes_most_of_it(
    monkeypatch, rcond, found, determined, read, expected
):
    asked: list[Any] = []

    def sensitivity_of(at, quantity, coordinates, solved) -> float:
        asked.append((quantity(at), coordinates, solved))
        return found

    def told(at, samples, key) -> np.ndarray:
        asked.append((samples, key))
        return np.array([determined])

    def of_read(at, samples, formulation, part, pivoted) -> np.ndarray:
        asked.append((samples, part, pivoted))
        return np.array([read])

    monkeypatch.setattr(sensitivity, "perturbed_samples", lambda at, coordinates: coordinates)

    for name, function in (
        *(("sensitivity_of", sensitivity_of), ("_matrices_resolved", told)),
        ("_input_sensitivity", of_read),
    ):
        monkeypatch.setattr(sensitivity, name, function)
    answer = {False: "the paper's", True: "the pivoted"}
    at: Any = SimpleNamespace(
        unit_roundoff=2.0**-53,
        acceleration=lambda f, pivoted: SimpleNamespace(rcond=rcond, multipliers=answer[pivoted]),
        states=0,
    )
    how: dict[str, Any] = {"part": "multipliers", "coordinates": True, "pivoted": True}
    assert sensitivity.acceleration_sensitivity(at, AU, **how) == expected
    whole = [("the pivoted", True, True), (True, ("au", True)), (True, "multipliers", True)]
    assert asked == whole[: len(asked)]
    assert len(asked) == (3 if np.isfinite(expected) else 0 if len(rcond) > 1 else len(asked))


def test_a_quantity_is_asked_of_all_copies_together(monkeypatch):
    here, asked = np.array([1.0, -2.0]), []
    moves = [[1, 0], [0, 0], [0, -5], [0, 0], [9, 0]]

    def perturbed(at: Any, coordinates: bool) -> Any:
        asked.append(coordinates)
        x = BatchArray(here + STEP * np.array(moves))
        return SimpleNamespace(x=x, computing=lambda name: nullcontext())

    monkeypatch.setattr(sensitivity, "perturbed_samples", perturbed)
    at: Any = SimpleNamespace(x=here, states=0)

    def x(e: Any) -> np.ndarray:
        return e.x

    assert sensitivity.sensitivity_of(at, x) == 2.0 + 5.0
    assert sensitivity.sensitivity_of(at, x, coordinates=True) == 7.0
    assert asked == [False, True]
    moves[4] = [0, 0]  # what does not grow with the noise; it is too small to matter
    assert np.isfinite(sensitivity.sensitivity_of(at, x, solved=True))


@pytest.mark.parametrize(
    ("rcond", "fine"),
    [({"M": 1.0}, True), ({"M": 1.0, "a": 0.9}, False), ({"M": 1.1, "a": 1e3}, True)],
)
def test_matrices_are_conditioned_down_to_a_share_that_rounding_leaves(rcond: dict, fine: bool):
    least = 32.0 * EPS / 1e-3
    found = well_conditioned({name: x * least * (1 + 1e-12) for name, x in rcond.items()})
    assert bool(found) is fine


def test_of_two_numbers_and_of_lanes_the_larger_magnitudes_count():
    assert (larger(2.0, -3.0), larger(-3.0, 2.0)) == (2.0, 2.0)
    lanes = BatchArray(np.array([[1.0, -5.0], [-7.0, np.nan], [2.0, 0.5]]))
    found = largest(lanes)
    assert found.data.tolist() == [5.0, np.inf, 2.0]
    both = larger(found, BatchArray(np.array([6.0, 1.0, 1.0])))
    assert both.data.tolist() == [6.0, np.inf, 2.0]


# ---- Slips ---------------------------------------------------------------------------------------


def test_a_violation_is_signed_and_allowed_by_the_size_of_its_terms():
    a, v = np.array([[1.0, -2.0], [3.0, 0.5]]), np.array([-4.0, 2.0])
    at: Any = SimpleNamespace(unit_roundoff=2.0**-53, terms=Terms(None, None, None, a, None, None))
    residual, allowed = sensitivity.violation(at, v)
    assert residual.tolist() == [-8.0, -11.0]
    assert allowed == pytest.approx(32.0 * EPS * np.array([8.0, 13.0]), abs=0.0)
    at.terms = at.terms._replace(b=np.array([5.0, -7.0]))
    residual, allowed = sensitivity.violation(at, v)
    assert residual.tolist() == [-3.0, -18.0]
    assert allowed == pytest.approx(32.0 * EPS * np.array([13.0, 20.0]), abs=0.0)
    at.terms = at.terms._replace(a=np.zeros((2, 2)), b=None)
    assert sensitivity.violation(at, v)[1].tolist() == [0.0, 0.0]


class Told:
    """A noise that moves entries by 2 h and draws the changes that it is given."""

    def __init__(self, drawn: np.ndarray):
        self.drawn = drawn

    def perturbed(self, x: np.ndarray, size: np.ndarray) -> np.ndarray:
        return x + 2.0 * STEP * size

    def changes(self, shape: tuple[int, ...]) -> np.ndarray:
        assert shape == (1, *self.drawn.shape)
        return self.drawn[None] * STEP


def slipping(a: Any, kept: Any = None) -> Any:
    terms = Terms(None, None, None, None if a is None else np.array(a), None, None)
    r, n = (0, 3) if a is None else np.shape(a)
    at: Any = SimpleNamespace(
        unit_roundoff=2.0**-53,
        input_sizes=None,
        terms=terms,
        scene=SimpleNamespace(r=r),
        states=0,
    )
    at.v, at.cached = np.array([1.0, -4.0, 8.0][:n]), lambda function: function(at)
    at.independent_partition = SimpleNamespace(kept=kept)
    return at


SLANTED = [[1.0, 0.5, 0.0], [0.0, 2.0, -1.0]]


@pytest.mark.parametrize(
    ("a", "kept"),
    [
        (SLANTED, None),
        ([SLANTED[0], [2.0, 1.0, 0.0], SLANTED[1]], np.array([0, 2])),
        ([*SLANTED, [1.0, 1.0, 1.0], [3.0, 3.5, -1.0]], np.array([0, 1, 2])),
    ],
)
def test_velocities_slip_by_four_times_what_is_allowed_and_as_little_as_they_can(
    monkeypatch, a: Any, kept: Any
):
    at, drawn = slipping(a, kept), np.array([0.5, -1.0, 0.75, 0.25])[: len(a)]
    size = allowed_error(np.arange(1.0, len(a) + 1))
    monkeypatch.setattr(sensitivity, "allowed_violation", lambda at: size)
    (found,) = sensitivity._velocity_perturbations(at, at.v[None], Told(drawn))  # type: ignore[arg-type]
    own = 2.0 * STEP * np.abs(at.v)
    rows = slice(None) if kept is None else kept
    asked = (4.0 * np.arange(1.0, len(a) + 1) * drawn * STEP)[rows]
    slip = found - own
    assert np.array(a)[rows] @ slip == pytest.approx(asked, rel=1e-9, abs=0.0)
    assert slip == pytest.approx(np.linalg.pinv(np.array(a)[rows]) @ asked, rel=1e-9, abs=1e-25)


def test_velocities_move_by_themselves_alone_where_no_constraint_tells_more(monkeypatch):
    free = slipping(None)
    found = sensitivity._velocity_perturbations(free, free.v[None], Told(np.zeros(0)))  # type: ignore[arg-type]
    assert (found == 2.0 * STEP * np.abs(free.v)).all()
    at = slipping([[0.0, 0.0, 0.0]])
    monkeypatch.setattr(sensitivity, "allowed_violation", lambda at: np.ones(1))
    found = sensitivity._velocity_perturbations(at, at.v[None], Told(np.ones(1)))  # type: ignore[arg-type]
    assert (found == 2.0 * STEP * np.abs(at.v)).all()


# ---- Closed positions ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("steps", "taken"),
    [
        ([6.0, 2.9, 1.6, 0.0], 3),
        ([6.0, 3.1, 0.0, 0.0], 2),
        ([1e9, 6.0, 2.9, 0.1, 0.06], 5),
        ([9.0, 5.0, 0.0, 0.0], 2),
    ],
)
def test_a_search_goes_on_while_steps_are_less_than_half_of_those_before(steps, taken):
    """Steps in 1e-15, of which 7.1 are rounding beside 1."""
    left = iter(steps)
    scene = SimpleNamespace(
        r=1, holonomic=slice(0, 1), position_residual=lambda *given: 1e-15 * np.array([next(left)])
    )
    at: Any = SimpleNamespace(scene=scene, parameters=None, prepared=None, q=None)
    at.run = lambda function, *given: function(*given)
    at.terms = Terms(None, None, None, np.array([[1.0]]), None, None)
    at.elsewhere = lambda q: at
    _, step, closed = constraint_rank.newton(at, np.array([0.5]))
    assert closed and step == pytest.approx(1e-15 * steps[taken - 1], abs=0.0)
    assert len(list(left)) == len(steps) - taken


def test_what_has_no_position_constraint_is_closed_where_it_is():
    at: Any = SimpleNamespace(scene=SimpleNamespace(position_residual=None))
    q = np.array([3.0, -1.0])
    assert constraint_rank.position_residual(at).shape == (0,)
    found, step, closed = constraint_rank.newton(at, q)
    assert found is q and (step, closed) == (0.0, True)


# ---- Ranks ---------------------------------------------------------------------------------------


def ranked(monkeypatch, a: Any, unsure: Any, own: Any = 0.0) -> Any:
    """Return the rank of a, of which rounding explains so much, with angles or without."""
    a = np.array(a, float)
    unsure, own = (np.broadcast_to(np.asarray(x, float), a.shape) for x in (unsure, own))
    monkeypatch.setattr(
        constraint_rank,
        "_in_common_units",
        lambda at, least: (a.copy(), (unsure if least else own).copy()),
    )
    names = tuple(f"row {i}" for i in range(len(a)))
    at: Any = SimpleNamespace(
        terms=SimpleNamespace(a=a), scene=SimpleNamespace(constraint_names=names)
    )
    at.cached = lambda function: function(at)
    return constraint_rank.rank_of(at)


def test_rows_are_kept_by_the_largest_that_is_left(monkeypatch):
    a = [[0.0, 2.0, 0.0], [1.0, 0.0, 0.0], [3.0, 4.0, 0.0], [0.0, 0.0, 1e-9]]
    found = ranked(monkeypatch, a, 1e-14)
    assert (found.kept.tolist(), found.redundant.tolist()) == ([0, 2, 3], [1])
    assert found.distance == pytest.approx([1.2, 0.0, 5.0, 1e-9], abs=1e-14)
    wide = np.sqrt(3.0) * 1e-14
    assert found.uncertainty == pytest.approx(
        [1.32 * wide, 2 * wide, wide, wide], rel=1e-6, abs=0.0
    )


@pytest.mark.parametrize(
    ("away", "rank_found"),
    [(0.99e-12, 1), (1.9e-12, 1), (3e-12, None), (1.9e-9, None), (2.1e-9, 2), (1.0, 2)],
)
def test_a_row_is_independent_a_thousand_times_beyond_rounding(monkeypatch, away, rank_found):
    """Rounding explains 1e-12 of an entry, and so twice that of a row less the one before."""
    a = [[1.0, 0.0], [1.0 - 1e-9, away]]
    unsure = [[0.0, 1e-12]] * 2
    if rank_found is not None:
        found = ranked(monkeypatch, a, unsure, 1.0)
        assert found.kept.tolist() == [0, 1][:rank_found]
        return
    with pytest.raises(RefusedError, match=r"constraint of row 1 is .* away") as refused:
        ranked(monkeypatch, a, unsure, 1.0)
    assert refused.value.rcond == pytest.approx(away, rel=1e-3, abs=0.0)
    assert refused.value.threshold == pytest.approx(2e-9, rel=1e-6, abs=0.0)


@pytest.mark.parametrize("which", ["a", "unsure"])
def test_rows_that_are_not_finite_have_no_rank(monkeypatch, which: str):
    given = {"a": np.eye(2), "unsure": np.full((2, 2), 1e-14)}
    given[which] = given[which].copy()
    given[which][1, 0] = np.nan
    with pytest.raises(RefusedError, match="doubles cannot hold it"):
        ranked(monkeypatch, **given)


def test_an_entry_that_is_certain_tells_rows_apart_though_others_are_not(monkeypatch):
    a = [[1.0, 0.5, 0.0], [1.0 - 1e-9, 0.5, 1e-10]]
    unsure = [[1e-9, 1e-9, 1e-9]] * 2
    known = [[1.0, 1.0, 4e-14]] * 2
    assert ranked(monkeypatch, a, unsure, [[1.0, 1.0, 6e-14]] * 2).kept.tolist() == [0]
    with pytest.raises(
        RefusedError, match=r"row 1 depends .* within .* small entry that is certain"
    ):
        ranked(monkeypatch, a, unsure, known)


def test_rows_are_measured_by_the_energy_in_velocities_and_by_their_size(monkeypatch):
    a = np.array([[3.0, 0.0, 4.0], [0.0, 2.0, 0.0]])
    moves = iter(np.array([[[0, 0, 1], [0, 0, 0]], [[0, 0, -2], [0, 5, 0]]] * 2) * STEP)
    asked: list[Any] = []

    def moved(at: Any, noise: Any, least: float) -> np.ndarray:
        asked.append((noise.seed, least))
        return a + next(moves)

    monkeypatch.setattr(constraint_rank, "_perturbed_jacobian", moved)
    M = np.diag([1.0, 4.0, 100.0])
    at: Any = SimpleNamespace(terms=SimpleNamespace(a=a, M=M))
    found, unsure = constraint_rank._in_common_units(at, 0.5)
    assert asked == [(k, 0.5) for k in range(SAMPLES)]
    columns = np.array([0.5, 0.25, 2.0**-4])  # powers of two that bring 1, 2 and 10 to [1/2, 1)
    scaled, size = a * columns, np.array([1.0, 1.0 + 2.0**-20])
    norms = np.linalg.norm(scaled, axis=1) * size
    assert found == pytest.approx(scaled / norms[:, None])
    expected = (
        allowed_error(np.abs(a) + np.array([[0, 0, 2], [0, 5, 0]])) * columns / norms[:, None]
    )
    assert unsure == pytest.approx(expected, rel=0.02, abs=0.0)


# ---- Contradictions ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("key", "rows", "held"),
    [("uk", [2], True), ("uk", None, False), ("au", [2], False), ("au", None, False)],
)
def test_results_are_held_against_rows_that_are_redundant_where_these_are_fine(
    monkeypatch, key: str, rows: Any, held: bool
):
    asked: list[Any] = []
    monkeypatch.setattr(sensitivity, "check_no_contradiction", lambda *given: asked.append(given))
    at: Any = SimpleNamespace(independent_partition=SimpleNamespace(redundant=rows))
    at.acceleration = lambda formulation, pivoted: (formulation.key, pivoted)
    found = sensitivity.solution_of(at, FORMULATIONS[key], True)
    assert found == (key, True)
    assert asked == ([(at, FORMULATIONS[key], (key, True))] if held else [])


@pytest.mark.parametrize(("share", "fine"), [(0.9, True), (1.1, False)])
@pytest.mark.parametrize("row", [0, 1])
def test_rows_contradict_beyond_the_rounding_of_what_is_added(monkeypatch, share, fine, row):
    """Of both rows |a| |v̇| + |gamma| is 16 and 6, the larger counts."""
    monkeypatch.setattr(sensitivity, "sensitivity_of", lambda at, quantity, solved: 2.0)
    vdot = np.array([-2.0, 3.0])
    off = share * allowed_error(16.0 + 2.0)
    terms = Terms(None, None, None, np.array([[4.0, 1.0], [1.0, 1.0]]), np.array([5.0, -1.0]), None)
    terms = terms._replace(gamma=np.array([5.0, -1.0]) + off * (np.arange(2) == row))
    names = SimpleNamespace(constraint_names=("one", "two"))
    at: Any = SimpleNamespace(terms=terms, scene=names)
    found: Any = SimpleNamespace(vdot=vdot)
    at.acceleration = lambda formulation: found
    if fine:
        sensitivity.check_no_contradiction(at, FORMULATIONS["uk"], found)
        return
    with pytest.raises(RefusedError, match=f"constraint of {('one', 'two')[row]} contradicts"):
        sensitivity.check_no_contradiction(at, FORMULATIONS["uk"], found)
