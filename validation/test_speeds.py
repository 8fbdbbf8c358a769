"""The paper's appendices: null spaces, generalized speeds, and Kane's method against ML."""

import pytest

from validation.harness import holds


@pytest.mark.parametrize(
    "claim",
    [
        "null-space-embedding",
        "null-space-speeds",
        "speeds-velocity",
        "speeds-remainder",
        "active-forces",
        "kane-ml-mass",
        "kane-ml-force",
        "kane-n-matrix",
    ],
)
@pytest.mark.sampled(2)
def test_generalized_speeds_and_what_is_made_with_them(claim: str, links, examples):
    holds(claim, links, examples)
