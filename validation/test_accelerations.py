"""Whole accelerations: the equations of motion, each other, engines, energy and symmetry."""

import math

import pytest

from eomcheck import strategies
from validation.harness import holds


@pytest.mark.parametrize(
    "claim",
    [
        "equations-residual",
        "constraint-acceleration",
        "equivalence",
        "multipliers",
        "redundant-rows",
        "engine-acceleration",
        "engine-multipliers",
        "machine-code",
        "power-balance",
        "invariance",
        "derivatives",
    ],
)
@pytest.mark.sampled(2)
def test_every_acceleration_is_the_one(claim: str, links, few):
    holds(claim, links, few)


@pytest.mark.parametrize("claim", ["equivalence", "true-error"])
@pytest.mark.sampled(2)
def test_it_is_with_wheels_at_any_angle_and_links_in_any_direction(claim: str, links, examples):
    def states(scene):
        return strategies.states(scene, angle=math.pi)

    holds(claim, links, examples, states, wheel_angle=1.55)
