"""Links of very different masses and of very different lengths."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from eomcheck.lab.studies.stability.families.base import Family, Posed, decades
from eomcheck.scenes import Snake

LINKS = 6

PATTERNS: dict[str, Callable] = {
    "head": lambda k: k == 0,
    "tail": lambda k: k == LINKS - 1,
    "alternating": lambda k: k % 2 == 0,
}


def _sizes(pattern: str, ratio: float) -> np.ndarray:
    return np.where(PATTERNS[pattern](np.arange(LINKS)), ratio, 1.0)


def _posed(mass: np.ndarray, length: np.ndarray) -> Posed:
    angle = np.arange(LINKS)
    one = np.ones(LINKS)
    scene = Snake(mass, length, mass * length**2 / 12, 10.0 * one[1:], 0.1 * angle, 0.4 * angle)
    return Posed(scene, scene.initial_state()[0], np.array([1.0, 0.5]))


def _family(key: str, name: str, word: str, pose: Callable[[str, float], Posed]) -> Family:
    variants = tuple(f"{word} {p}" if p in ("head", "tail") else p for p in PATTERNS)
    return Family(
        key=key,
        name=name,
        severity=f"largest {name.split()[0].lower()} over smallest",
        values=decades(0, 16),
        quick=decades(0, 16, 4),
        variants=variants,
        pose=lambda variant, ratio: pose(variant.split()[-1], ratio),
    )


MASS_RATIO = _family(
    "mass-ratio",
    "Mass ratio",
    "heavy",
    lambda pattern, ratio: _posed(_sizes(pattern, ratio), np.ones(LINKS)),
)
LENGTH_RATIO = _family(
    "length-ratio",
    "Length ratio",
    "long",
    lambda pattern, ratio: _posed(np.ones(LINKS), _sizes(pattern, ratio)),
)
