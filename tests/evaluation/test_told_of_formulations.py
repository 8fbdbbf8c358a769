"""Formulations as data: their orders as Table I prints them, and which apply where."""

from __future__ import annotations

import numpy as np
import pytest

from eomcheck.errors import InputError
from eomcheck.formulations import (
    FORMULATIONS,
    Partition,
    formulation_for,
    formulations_among,
    formulations_for,
)
from eomcheck.formulations.uk import redundancy_coefficients, smallest_multipliers
from eomcheck.scenes import RollingDisk, Sleigh, Snake

ORDERS = {
    "im": ("2n + r", 19, True, False),
    "au": ("n + r", 12, True, False),
    "el": ("n", 7, True, False),
    "gw": ("n", 7, True, False),
    "em": ("n - r", 2, True, False),
    "ml": ("n - r", 2, True, True),
    "kane": ("n - r", 2, True, True),
    "banded": ("2s + r - n", 20, False, False),
    "uk": ("n + r", 12, False, False),
}
"""Key -> order, unknowns for n = 7, r = 5 and s = 11, whether it is in the paper, and in speeds."""


@pytest.mark.parametrize("key", FORMULATIONS)
def test_the_order_of_a_formulation_is_that_of_table_i(key: str):
    one = FORMULATIONS[key]
    found = one.order_text, one.unknowns(7, 5, 11), one.in_paper, one.in_speeds
    assert found == ORDERS[key]


def test_formulations_are_those_that_apply_each_once_in_their_own_order_unless_named():
    assert [one.key for one in formulations_for(Snake)] == [*ORDERS]
    assert [one.key for one in formulations_for(Sleigh)] == [x for x in ORDERS if x != "banded"]
    named = formulations_for(Sleigh, ["uk", "au", "uk"])
    assert [one.key for one in named] == ["uk", "au"]
    assert [one.key for one in formulations_among((Sleigh, Snake), ["banded"])] == ["banded"]
    assert [one.key for one in formulations_among((Sleigh, Snake))] == [*ORDERS]
    assert formulations_for(Sleigh, []) == ()
    said = "banded does not apply to the scene sleigh, which gives no chain; those that apply: im,"
    alone = lambda: formulation_for(Sleigh, "banded")  # noqa: E731
    for refused in (alone, lambda: formulations_among((Sleigh, RollingDisk), ["au", "banded"])):
        with pytest.raises(InputError, match=said):
            refused()


def test_a_partition_is_made_again_of_its_choice():
    one = Partition(np.array([2, 0]), np.array([1]), np.array([3, 1]), np.array([0]))
    again = Partition.chosen(one.choice)
    assert one.choice == ((2, 0), (1,), (3, 1), (0,))
    for part, of in zip(again, one, strict=True):
        assert part.tolist() == of.tolist()
    bare = Partition.chosen(((1,), (0, 2), None, None))
    assert (bare.kept, bare.redundant) == (None, None)


def test_multipliers_of_rows_that_depend_on_others_are_the_smallest_there_are():
    rows = np.array([[1.0, 2.0, 0.0, 1.0], [0.0, 1.0, -1.0, 3.0]])
    G = np.array([[0.5, -2.0], [3.0, 0.25]])
    kept, redundant, a = np.array([1, 3]), np.array([2, 0]), np.zeros((4, 4))
    a[kept], a[redundant] = rows, G @ rows
    M = np.diag([1.0, 2.0, 3.0, 4.0])
    np.testing.assert_allclose(redundancy_coefficients(M, a, kept, redundant), G, atol=1e-14)
    mu = np.array([0.7, -1.3])
    found = smallest_multipliers(mu, G, kept, redundant)
    least = np.linalg.pinv(a.T) @ (rows.T @ mu)
    np.testing.assert_allclose(found, least, atol=1e-14)
