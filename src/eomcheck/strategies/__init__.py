"""hypothesis strategies: scenes of every kind, consistent states, and hostile ones.

They describe what is valid, not how it is distributed, and refuse bad bounds when they are called,
not when they are drawn from::

    from hypothesis import given
    from eomcheck import strategies

    @strategies.settings
    @given(strategies.scene_states(strategies.snakes(max_links=5)))
    def test_my_solver(case):
        scene, state = case
        ...
"""

from __future__ import annotations

from hypothesis import HealthCheck
from hypothesis import settings as hypothesis_settings

from eomcheck.strategies.scene_strategies import (
    NEGLIGIBLE,
    random_mechanisms,
    random_trees,
    scenes,
    snakes,
    urdfs,
)
from eomcheck.strategies.state_strategies import (
    CURVATURE,
    hostile_snakes,
    hostile_states,
    scene_states,
    states,
)

__all__ = [
    "CURVATURE",
    "NEGLIGIBLE",
    "hostile_snakes",
    "hostile_states",
    "random_mechanisms",
    "random_trees",
    "scene_states",
    "scenes",
    "settings",
    "snakes",
    "states",
    "urdfs",
]

settings = hypothesis_settings(
    deadline=None,
    suppress_health_check=[
        HealthCheck.too_slow,
        HealthCheck.data_too_large,
        HealthCheck.large_base_example,
        HealthCheck.filter_too_much,
    ],
)
"""What a test needs whose cases are drawn here, as a decorator or the first argument of
`hypothesis.settings`: the first case loads engines, which takes longer than hypothesis allows for
one, and a case is closed and made consistent while it is drawn."""
