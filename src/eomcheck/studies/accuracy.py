"""What doubles deliver: certified errors of every formulation over random states."""

from __future__ import annotations

from dataclasses import dataclass

from eomcheck import strategies
from eomcheck.certified import accuracy
from eomcheck.console import progress
from eomcheck.errors import RefusedError
from eomcheck.formulations import applicable
from eomcheck.scenes import Snake
from eomcheck.states import speeds_of
from eomcheck.studies.draws import draw


@dataclass(frozen=True)
class Delivered:
    """What one formulation delivered at one state.

    Attributes:
        key: the formulation.
        links: number of links.
        refused: what stood in the way, or None.
        digits: decimal digits of v̇ that are certainly right.
        relative: largest error over largest true entry.
        ulps: largest error of an entry in units in the last place.
        condition: largest condition number of a matrix solved.
        kappa: how strongly the computation amplifies relative changes.
        ratio: observed error / (κ ε scale), NaN where nothing is foreseen or nothing can be lost.
    """

    key: str
    links: int
    refused: str | None
    digits: float = 0.0
    relative: float = float("inf")
    ulps: float = float("inf")
    condition: float = float("inf")
    kappa: float = float("inf")
    ratio: float = float("nan")


def measure_accuracy(min_links: int, max_links: int, examples: int, seed: int) -> list[Delivered]:
    """Return one Record per formulation and random state."""
    snakes = strategies.scene_states(strategies.snakes(min_links, max_links))
    records, keys = [], applicable(Snake)
    with progress("measuring", examples * len(keys)) as advance:
        for scene, (q, v, t) in draw(snakes, examples, seed):
            u = speeds_of(scene, q, v, t)
            for key in keys:
                try:
                    found = accuracy(scene, key, q, u, t)
                except RefusedError as refusal:
                    records.append(Delivered(key, scene.r, refusal.what))
                else:
                    records.append(
                        Delivered(
                            key,
                            scene.r,
                            None,
                            found.digits,
                            found.relative,
                            float(found.ulps.max()),
                            max(found.condition.values()),
                            found.kappa,
                            found.ratio,
                        )
                    )
                advance()
    return records
