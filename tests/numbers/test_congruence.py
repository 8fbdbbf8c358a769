"""Sums Jᵀ D J: one sum, written out or as a product of matrices, over what is not 0 alone."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from eomcheck.numbers import linear
from eomcheck.numbers.counting import Counting
from eomcheck.numbers.linear import add_congruence
from eomcheck.numbers.tape import Tape

BODIES, SIZE, COLUMNS = 5, 3, 6


def numbers(turning: bool, whole: bool = False) -> dict:
    """Return arguments of `add_congruence` with zeros outside of a support."""
    random = np.random.default_rng(4)
    support = random.uniform(size=(BODIES, COLUMNS)) < 0.6
    J = random.integers(-9, 9, (BODIES, SIZE, COLUMNS)) * support[:, None, :]
    D = random.integers(1, 9, (BODIES, SIZE, SIZE))
    rest, more = random.integers(-9, 9, (2, BODIES, SIZE))
    given = {
        "J": J,
        "weights": D + D.swapaxes(1, 2) if turning else random.integers(1, 9, BODIES),
        "rest": rest,
        "more": more if turning else None,
        "support": support,
    }
    kind = int if whole else float
    return {
        name: x if x is None or x.dtype == bool else x.astype(kind) for name, x in given.items()
    }


def expected(J, weights, rest, more, support) -> np.ndarray:
    """Return the sums (p, p+1) by another way: full matrices."""
    D = weights if weights.ndim == 3 else weights[:, None, None] * np.eye(SIZE)
    moments = np.einsum("kcf,kf->kc", D, rest) + (0 if more is None else more)
    M = np.einsum("kci,kcf,kfj->ij", J, D, J)
    return np.concatenate((M, np.einsum("kci,kc->i", J, moments)[:, None]), axis=1)


def sums(given: dict, first=1.0, kind: object = float) -> np.ndarray:
    both = np.full((COLUMNS, COLUMNS + 1), first, kind)
    add_congruence(both, **given)
    return both


def lower(both: np.ndarray) -> np.ndarray:
    """Return what counts: the lower triangle and the vector."""
    return np.concatenate((both[np.tril_indices(COLUMNS)], both[:, COLUMNS]))


@pytest.fixture(params=["written out", "one product"])
def way(request, monkeypatch):
    if request.param == "one product":
        monkeypatch.setattr(linear, "MANY", 0)
        monkeypatch.setattr(linear, "WIDE", 0)
    return request.param


@pytest.mark.parametrize("turning", [False, True], ids=["masses", "moments of inertia"])
@pytest.mark.parametrize("told", [False, True], ids=["all columns", "support"])
def test_sums_are_those_of_full_matrices(way, turning, told):
    given = numbers(turning)
    given |= {} if told else {"support": None}
    # Of whole numbers: exactly.
    assert (lower(sums(given)) == lower(1 + expected(**given))).all()


def test_sums_of_exact_numbers_are_exact():
    given = {
        name: x if name == "support" else np.vectorize(Fraction, otypes=[object])(x)
        for name, x in numbers(True, whole=True).items()
    }
    found = sums(given, Fraction(1, 3), object)
    assert (lower(found) == lower(Fraction(1, 3) + expected(**numbers(True, whole=True)))).all()


def counted(given: dict) -> int:
    counting = Counting()
    numbers = {
        name: x if x is None or name == "support" else counting.numbers(x)
        for name, x in given.items()
    }
    sums(numbers, 0, object)
    return counting.tally.multiplications


@pytest.mark.parametrize("turning", [False, True], ids=["masses", "moments of inertia"])
def test_what_is_0_throughout_costs_nothing(turning):
    given = numbers(turning)
    widths = given["support"].sum(axis=1)
    of_pairs = (widths * (widths + 1) // 2).sum()
    rows = SIZE * SIZE if turning else SIZE
    # Each row: a momentum of each column, its product with the vector, and with each before it.
    assert counted(given) == rows * (2 * widths.sum() + of_pairs) + turning * SIZE * widths.sum()


def traced(bodies: int, columns: int) -> Tape:
    tape, both = Tape(), np.zeros((columns, columns + 1), object)
    J, mass = tape.inputs("J", (bodies, SIZE, columns)), tape.inputs("m", (bodies,))
    add_congruence(both, J, mass, tape.inputs("rest", (bodies, SIZE)))
    return tape


def test_where_few_columns_meet_operations_stay_their_own_and_where_many_do_they_are_one_product():
    # A chain of many bodies with few speeds: loops are found again in what is written out.
    assert [group.kind for group in traced(1000, 3).groups] == []
    assert [group.kind for group in traced(4, 16).groups] == []
    wide = traced(40, 40)
    assert [group.kind for group in wide.groups] == ["product"]
    # And the trace is as long as what is read and written, not as the product.
    assert len(wide.operations) < 3 * 40 * SIZE * 40
