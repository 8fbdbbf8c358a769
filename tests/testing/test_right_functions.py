"""Right functions are never refused, and what is allowed is neither too little nor too much."""

from __future__ import annotations

import numpy as np
import pytest
from tests.testing.trees import random_tree

from eomcheck.evaluation.tolerance import C
from eomcheck.scenes import SCENES
from eomcheck.testing import EquationsOfMotion, check, check_functions, from_scene

TREES = 120


@pytest.mark.night
@pytest.mark.parametrize("first", range(0, TREES, 30))
def test_no_random_tree_is_refused(first: int):
    for seed in range(first, first + 30):
        ranges = (-1.0, 1.0) if seed % 2 else (-3.0, 3.0)
        found = check_functions(**random_tree(seed), states=1, seed=seed, ranges=ranges)
        failed = [x for x in found if x.verdict == "failed"]
        assert not failed, f"tree {seed}: {failed[0]}"
        looked_at = {x.claim for x in found if x.verdict == "passed"}
        assert {"bias-of-mass-matrix", "kinetic-energy", "motion", "power-balance"} <= looked_at


@pytest.mark.night
@pytest.mark.parametrize("key", SCENES)
def test_no_scene_is_refused(key: str):
    made = from_scene(SCENES[key].example())
    terms = {
        name: made.function(name) for name in made.given[: made.given.index("inverse_dynamics")]
    }
    # Differences of all quantities of a large scene take an hour.
    subject = made if key == "sleigh" else EquationsOfMotion(made.n, **terms)
    found = check(subject, states=1, seed=3)
    assert not [str(x) for x in found if x.verdict == "failed"]
    assert "bias-of-mass-matrix" in {x.claim for x in found if x.verdict == "passed"}


def ratios(claims: list[str], seeds: range) -> list[float]:
    found = []
    for seed in seeds:
        found += check_functions(**random_tree(seed), states=3, seed=seed, claims=claims)
    return [x.ratio for x in found if x.verdict == "passed"]


@pytest.mark.night
def test_with_1_in_the_place_of_32_right_functions_would_be_refused():
    """So 32 is needed: errors that are measured are sometimes too small, by chance."""
    assert 1.0 / C < max(ratios(["bias-quadratic", "coriolis-bias"], range(60))) < 0.5


@pytest.mark.night
def test_what_is_allowed_is_not_much_more_than_what_is_seen():
    """Bounds that are a thousand times too wide would pass everything, and this fail."""
    found = [x for x in ratios(["kinetic-energy", "gravity-of-potential"], range(30)) if x > 0.0]
    assert np.median(found) > 1e-3
