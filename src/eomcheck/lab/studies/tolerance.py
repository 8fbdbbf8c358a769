"""What the constant C of every tolerance rests on: observed / (κ ε scale) over random states."""

from __future__ import annotations

from collections import defaultdict

from eomcheck import strategies
from eomcheck.claims.run import Run, Selection
from eomcheck.console import progress
from eomcheck.evaluation.tolerance import C


def measure_constant(
    min_links: int, max_links: int, examples: int, seed: int
) -> dict[str, list[float]]:
    """Return, per claim, observed / (κ ε scale) of every conclusive Finding."""
    run, selection = Run(), Selection.of()
    drawn = strategies.scene_states(strategies.snakes(min_links, max_links))
    with progress("measuring", examples) as advance:
        run.explore(drawn, selection, examples, seed, advance)
    ratios: dict[str, list[float]] = defaultdict(list)
    for finding in run.findings:
        if finding.verdict != "inconclusive" and finding.claim != "refusals":
            ratios[finding.claim].append(C * finding.ratio)
    return dict(ratios)
