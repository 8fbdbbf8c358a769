"""Parameters of scenes that an engine has by another way, and those that none has."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from eomcheck.claims.pairwise_design import links_of
from eomcheck.engines import ENGINES
from eomcheck.lab.report.overview import Overview
from eomcheck.scenes import SCENES


class OtherData(NamedTuple):
    """How the parameters of a kind of scene are seen to be the right ones in its equations."""

    scene: str
    covered: str
    """Those that an engine takes from elsewhere, and the engine."""
    common: str
    """Those that both derivations take from `parameters()`."""


def other_data(overview: Overview) -> Iterator[OtherData]:
    """Yield, per scene validated, which of its parameters an engine has by another way.

    Those are the parameters that change the scene's `tree()`, if an engine that is built of the
    tree took part.
    """
    for run in overview.runs:
        if (kind := SCENES.get(run.settings["scene"])) is None:
            continue
        scene: Any = kind.example()
        names = list(kind.ranges(links_of(scene)))
        ours = [key for key in run.series["engines"] if key in ENGINES]
        by = [key for key in ours if not ENGINES[key].reads_parameters]
        seen = [name for name in names if by and _in_tree(scene, name)]
        common = ", ".join(name for name in names if name not in seen)
        covered = f"{', '.join(seen)} ({', '.join(by)}, from the tree)" if seen else "-"
        said = f"common mode not covered: {common}" if common else "-"
        yield OtherData(kind.key, covered, said)


def _in_tree(scene: Any, name: str) -> bool:
    value, tree = getattr(scene, name), scene.tree()
    if tree is None or value is None:
        return False
    changed = replace(scene, **{name: 1.5 * value + 0.1}).tree()
    return any(not np.array_equal(x, y) for x, y in zip(tree, changed, strict=True))
