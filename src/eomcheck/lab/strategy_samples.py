"""Samples of a hypothesis strategy as a list, for studies that measure."""

from __future__ import annotations

from typing import TypeVar

import hypothesis
from hypothesis import HealthCheck, Phase
from hypothesis.strategies import SearchStrategy

T = TypeVar("T")

UNHURRIED = (
    HealthCheck.too_slow,
    HealthCheck.data_too_large,
    HealthCheck.large_base_example,
    HealthCheck.filter_too_much,
)
"""Health checks of hypothesis that are off: large scenes are drawn slowly."""


def draw_samples(cases: SearchStrategy[T], count: int, seed: int) -> list[T]:
    """Return `count` draws from `cases`, the same for the same seed."""
    drawn: list[T] = []
    settings = hypothesis.settings(
        max_examples=count,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=UNHURRIED,
    )

    @hypothesis.seed(seed)
    @settings
    @hypothesis.given(cases)
    def take(case: T) -> None:
        drawn.append(case)

    take()
    return drawn
