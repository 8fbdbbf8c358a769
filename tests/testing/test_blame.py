"""Which function is wrong, by all that failed and passed together, and which of its terms."""

from __future__ import annotations

import numpy as np
import pytest

from eomcheck.testing.of_terms import proportional

EXPECTED = np.array([0.0, 1e-7, -2e-7])


@pytest.mark.parametrize(
    ("factor", "text"),
    [
        (0.5, "half of it, in every row"),
        (-1.0, "sign, in every row"),
        (0.0, "missing, in every row"),
        (0.7, "0.7 times what is expected, in every row"),
        (0.7001, "0.7001 times what is expected, in every row"),
    ],
)
def test_a_factor_that_is_known_to_six_digits_has_one_text(factor: float, text: str):
    noise = np.array([5e-14, 5e-14, -3e-14])
    assert proportional(factor * EXPECTED + noise, EXPECTED, 1e-13, (1,)) == text


def test_a_factor_beyond_noise_is_another_one():
    assert proportional(0.50001 * EXPECTED, EXPECTED, 1e-13, (1,)).startswith("0.50001 times")
    assert proportional(EXPECTED * [1.0, 1.0, 0.5], EXPECTED, 1e-13, (1,)) == ""
