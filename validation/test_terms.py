"""Single terms: M, B, Q, a, b and gamma are what energies, constraints and engines say."""

import pytest
from hypothesis import settings

from eomcheck import strategies
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import SCENES, RollingDisk
from validation.harness import holds, holds_on

# Snakes and whatever else only rolls have no positions to close.
CLOSED = [kind for kind in SCENES.values() if kind.position_residual is not None]


@pytest.mark.parametrize(
    "claim",
    [
        "finite-terms",
        "mass-matrix",
        "bias",
        "generalized-forces",
        "constraint-jacobian",
        "constraint-velocity",
        "constraint-drift",
        "kinetic-energy",
        "position-velocity",
        "moved-energy",
    ],
)
@pytest.mark.sampled(2)
def test_terms_are_what_defines_them(claim: str, links, examples):
    holds(claim, links, examples)


def test_heights_change_no_faster_than_their_points(links, examples):
    drawn = strategies.scene_states(strategies.scenes(RollingDisk, *links))
    holds_on("height-velocity", drawn, examples)


@pytest.mark.parametrize("kind", CLOSED, ids=lambda kind: kind.key)
def test_holonomic_constraints_are_rates_of_what_vanishes_at_closed_positions(
    kind: type[Scene], links, examples
):
    drawn = strategies.scene_states(strategies.scenes(kind, *links))
    # Closing a pose takes longer than looking at it.
    holds_on("position-rate", drawn, examples or settings().max_examples // 4)
