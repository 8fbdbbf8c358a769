import pytest
from hypothesis import given, settings

import eomcheck
from eomcheck import strategies
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import SCENES

# Snakes and whatever else only rolls have no positions to close.
CLOSED = [kind for kind in SCENES.values() if kind.position_residual is not None]


@pytest.mark.parametrize("kind", CLOSED, ids=lambda kind: kind.key)
def test_holonomic_constraints_are_rates_of_what_vanishes_at_closed_positions(
    kind: type[Scene], links, examples
):
    conclusive = 0

    def holds_here(case):
        nonlocal conclusive
        scene, state = case
        for finding in eomcheck.check(scene, *state, claims=["position-rate"]):
            assert finding.verdict != "failed", f"{finding}\n\n{finding.as_python()}"
            conclusive += finding.verdict == "passed"

    search = given(strategies.scene_states(strategies.scenes(kind, *links)))(holds_here)
    # Closing a pose takes longer than looking at it.
    settings(max_examples=examples or settings().max_examples // 4)(search)()
    assert conclusive > 0
