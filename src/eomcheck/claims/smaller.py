"""Smaller cases in which the same claim fails, looked for by hypothesis."""

from __future__ import annotations

import hypothesis
from hypothesis import Phase, Verbosity
from hypothesis.errors import Unsatisfiable
from hypothesis.strategies import SearchStrategy

from eomcheck import strategies
from eomcheck.claims import CLAIMS, Finding, State
from eomcheck.claims.case import ONCE
from eomcheck.claims.robot_file import of_file
from eomcheck.claims.selection import Selection, asked_of, case_of
from eomcheck.claims.strata import links_of
from eomcheck.mechanics.scene import Scene

TRIES = 50
"""Cases looked at in search of a smaller one that fails, those met while shrinking not counted."""


def no_larger(scene: Scene, links: tuple[int, int]) -> SearchStrategy[tuple[Scene, State]]:
    """Return a strategy for scenes of the kind of `scene`, with at most as many links, in a state.

    Args:
        scene: the scene.
        links: smallest and largest number of links, for a kind that has one.
    """
    most = max(links[0], min(links[1], links_of(scene) or links[1]))
    return strategies.scene_states(strategies.scenes(type(scene), links[0], most))


def states_of(scene: Scene) -> SearchStrategy[tuple[Scene, State]]:
    """Return a strategy for `scene` with each of its ordinary states."""
    return strategies.states(scene).map(lambda state: (scene, state))


class _Falsified(AssertionError):
    def __init__(self, finding: Finding):
        self.finding = finding
        super().__init__(str(finding))


def smallest_failure(
    failed: Finding,
    cases: SearchStrategy[tuple[Scene, State]],
    selection: Selection,
    seed: int,
) -> Finding:
    """Return the smallest failure of the same claim among `cases`, or the one there is.

    Args:
        failed: a failure.
        cases: among which a smaller one is looked for.
        selection: what takes part.
        seed: of the search.
    """

    def examine(drawn: tuple[Scene, State]) -> None:
        asked = asked_of(drawn[0], selection)
        case = case_of(asked, drawn[1], selection, ONCE)
        for finding in of_file(asked, case, CLAIMS[failed.claim]):
            if finding.verdict == "failed":
                raise _Falsified(finding)

    settings = hypothesis.settings(
        strategies.settings,
        max_examples=TRIES,
        database=None,
        derandomize=False,
        report_multiple_bugs=False,
        phases=(Phase.generate, Phase.shrink),
        verbosity=Verbosity.quiet,
    )
    try:
        hypothesis.seed(seed)(settings(hypothesis.given(cases)(examine)))()
    except _Falsified as falsified:
        return falsified.finding
    except Unsatisfiable:
        pass  # none of them could be closed
    return failed
