"""Ordinary scenes and states of every kind, drawn without hypothesis."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg import null_space

from eomcheck.evaluation.dynamics import assembled_position, consistent_velocity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.mechanics.records import Range, State
from eomcheck.mechanics.scene import Scene

LINKS = 4


def drawn(one: Range, random: np.random.Generator) -> Any:
    """Return a number or an array from a range."""
    value = random.uniform(one.low, one.high, one.shape)
    return value if one.shape else float(value)


NOT_OF_SNAKES = {"height-velocity", "position-rate"}
"""Claims about closed positions and heights, which snakes do not have."""


def random_scene(kind: type[Scene], random: np.random.Generator, links: int = LINKS) -> Scene:
    """Return a scene whose parameters are drawn from the ranges of its kind."""
    ranges = kind.ranges(links if kind.has_links else None)
    usual = {name: one for name, one in ranges.items() if name not in kind.usually_absent}
    return kind(**{name: drawn(one, random) for name, one in usual.items()})


def random_state(scene: Scene, random: np.random.Generator) -> State:
    """Return a consistent state of `scene` in motion."""
    ranges = scene.coordinate_ranges() or (Range(-2.0, 2.0),) * scene.n
    t = random.uniform(0.0, 5.0) if scene.depends_on_time else 0.0
    q = assembled_position(scene, [drawn(one, random) for one in ranges], t)
    at = Evaluation(scene, q, np.zeros(scene.n), t)
    c = random.uniform(1.0, 3.0, scene.p)
    a = at.terms.a
    return State(q, c if a is None else consistent_velocity(at, null_space(a) @ c), t)


def ordinary(kind: type[Scene], seed: int = 0) -> tuple[Scene, State]:
    """Return a random scene of a kind in a random state."""
    random = np.random.default_rng(seed)
    scene = random_scene(kind, random)
    return scene, random_state(scene, random)
