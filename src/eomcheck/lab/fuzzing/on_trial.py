"""What engines on trial are asked besides: ordinary cases near those where they came worst off."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from eomcheck.claims import Finding
from eomcheck.engines import ENGINES, Engine, is_on_trial
from eomcheck.lab.fuzzing.families import Case
from eomcheck.lab.fuzzing.mutation import Changed
from eomcheck.mechanics.records import Range
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array
from eomcheck.strategies.state_strategies import state_ranges

OVERSAMPLED = 2
"""Cases that are changed for one that is asked: closing may lead out of the ranges."""

FAR = 10.0
"""Coordinates at most, m or rad, of scenes that say nothing of theirs."""


def on_trial(engines: Iterable[str | type[Engine]]) -> tuple[type[Engine], ...]:
    """Return those engines that are somebody's own."""
    kinds = (ENGINES.get(one) if isinstance(one, str) else one for one in engines)
    return tuple(kind for kind in kinds if kind is not None and is_on_trial(kind))


def heights_of(findings: Sequence[Finding]) -> dict[tuple[str, str], float]:
    """Return the largest observed / allowed of engines on trial, by claim and key of the engine."""
    found: dict[tuple[str, str], float] = {}
    for one in findings:
        if one.verdict == "passed" and one.engine is not None and is_on_trial(one.engine):
            key = one.claim, one.engine.key
            found[key] = max(found.get(key, 0.0), one.ratio)
    return found


def is_ordinary(case: Case) -> bool:
    """Return whether a case is within what ordinary ones are drawn from.

    Next to a singular state, and far away, an engine may lose digits in its own way.
    """
    scene, (q, v, t) = case
    for name, one in _ranges(scene).items():
        x = getattr(scene, name)
        if x is not None and not ((one.low <= np.asarray(x)) & (np.asarray(x) <= one.high)).all():
            return False
    (low, high), fastest = _limits(scene)
    near = bool(((low <= q) & (q <= high)).all())
    times = state_ranges(scene).time
    return near and float(np.linalg.norm(v)) <= fastest and times.low <= t <= times.high


def tamed(changed: Changed) -> Changed:
    """Return an ordinary case in place of one that left the ranges: at their ends."""
    scene, q, v = changed
    values = {}
    for name, one in _ranges(scene).items():
        x = getattr(scene, name)
        values[name] = None if x is None else np.clip(x, one.low, one.high)
    (low, high), fastest = _limits(scene)
    speed = float(np.linalg.norm(v))
    slower = v if speed <= fastest / 2 else v * (fastest / 2 / speed)
    return type(scene)(**values), np.clip(q, low, high), slower


def _ranges(scene: Scene) -> dict[str, Range]:
    return type(scene).ranges(getattr(scene, "links", None) if scene.has_links else None)


def _limits(scene: Scene) -> tuple[tuple[Array, Array], float]:
    """Return the smallest and largest coordinates (n,) of ordinary states, and |v| at most."""
    found = state_ranges(scene)
    bounds = np.array([(one.low, one.high) for one in found.coordinates])
    if scene.coordinate_ranges() is None:
        bounds = np.array([[-FAR, FAR]] * scene.n)  # angles are turned further than drawn
    return (bounds[:, 0], bounds[:, 1]), found.components.high * float(np.sqrt(scene.n))
