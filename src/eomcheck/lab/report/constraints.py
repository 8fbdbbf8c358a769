"""Which constraints of a scene depend on others."""

from __future__ import annotations

import numpy as np

from eomcheck.evaluation.constraint_rank import rank_of
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.lab.show.table import Sheet, print_sheets, say
from eomcheck.mechanics.scene import Scene


def print_constraints(scene: Scene) -> int:
    """Print which constraints depend on others where the scene begins; return how many do.

    Raises:
        RefusedError: the rank of a is not clear, or another one in positions nearby.
    """
    q, _ = scene.initial_state()
    at = Evaluation(scene, q, np.zeros(scene.n))
    redundant = at.independent_partition.redundant
    without = [] if redundant is None else redundant.tolist()
    if at.terms.a is None:
        say(f"{scene.name} has no constraint")
        return 0
    rank = rank_of(at)
    rows = [
        (
            name,
            "redundant" if i in without else "kept",
            f"{rank.distance[i]:.2g}",
            f"{rank.unsure[i]:.2g}",
        )
        for i, name in enumerate(scene.constraint_names)
    ]
    columns = ("constraint", "it is", "away from the others, of its size", "by rounding at most")
    print_sheets([Sheet("constraints", "", columns, rows)])
    say(f"{scene.structure}: n = {scene.n}, r = {scene.r}, rank {scene.r - len(without)}")
    return len(without)
