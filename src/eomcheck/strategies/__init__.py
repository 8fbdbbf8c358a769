"""Hypothesis strategies for property-based testing: scenes, consistent states, hostile states.

Strategies define the set of valid inputs, not their distribution. Bad bounds raise InputError when
a strategy is constructed, not when it is drawn from::

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
"""Hypothesis settings for tests that draw from these strategies, as a decorator or the first
argument of `hypothesis.settings`. Deadline and health checks are off: the first case loads engines,
and drawing a case solves its loop closure and makes its velocity consistent."""
