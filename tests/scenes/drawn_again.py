"""How many random mechanisms are drawn again, and why: `... -m tests.scenes.drawn_again 1000`."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable
from typing import Any
from unittest.mock import patch

from eomcheck.descriptions.random_mechanisms import RANDOM
from eomcheck.draws import pairwise_design
from eomcheck.errors import RefusedError


def drawn_again(examples: int, seed: int = 0) -> tuple[Counter, Counter]:
    """Return reasons with their counts, and the kinds of the first constraints with theirs."""
    why: Counter[str] = Counter()

    def counting(reason: str, call: Callable) -> Callable:
        def counted(*given: Any, **options: Any) -> Any:
            try:
                return call(*given, **options)
            except RefusedError:
                why[reason] += 1
                raise

        return counted

    def watched(name: str, reason: str) -> Any:
        return patch.object(pairwise_design, name, counting(reason, getattr(pairwise_design, name)))

    with watched("_scene", "no constraint"), watched("ordinary_state", "not closed"):
        cases = list(
            pairwise_design.scene_cases(RANDOM["random-mechanisms"], (1, 12), examples, seed)
        )
    return why, Counter(scene.source.description.constraints[0].kind for scene, _ in cases)


if __name__ == "__main__":
    for counts in drawn_again(int(sys.argv[1])):
        print(dict(counts.most_common()))
