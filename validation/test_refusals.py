"""Who refuses which states, and why; how many of the ordinary ones."""

import numpy as np
import pytest
from hypothesis import example, given, settings

import eomcheck
from eomcheck import strategies
from eomcheck.claims.run import RunSelection, ValidationRun
from eomcheck.draws.pairwise_design import scene_cases
from eomcheck.mechanics.records import State
from eomcheck.scenes import Snake
from validation.harness import ACROSS, SPECIAL, holds, rolling, uniform

# found by the fuzz profile: a wheel across its link, on a chain with one heavy link
HEAVY_LINK = Snake(
    [1.0, 1.0, 1.0, 1.0, 1e6, 1.0, 1.0, 1.0, 1.0, 1.0],
    [1.0] * 10,
    [0.0] * 10,
    None,
    [0.0] * 9 + [np.pi / 2],
)


def test_a_formulation_refuses_special_states_only_where_it_must(links, examples):
    holds("refusals", links, examples)


def test_a_formulation_refuses_hostile_states_only_where_it_must(links, examples):
    low, high = links

    @settings(max_examples=examples or settings().max_examples)
    @example((HEAVY_LINK, State(np.zeros(HEAVY_LINK.n), np.zeros(HEAVY_LINK.n))))
    @given(strategies.scene_states(strategies.hostile_snakes(low, high), strategies.hostile_states))
    def refusals_are_justified(case):
        scene, state = case
        findings = eomcheck.check_state(
            scene, *state, claims=["refusals"], engines=[], consistent=False
        )
        for finding in findings:
            assert finding.verdict != "failed", f"{finding}\n\n{finding.as_python()}"

    refusals_are_justified()


def refused(scene, state) -> set[str]:
    findings = eomcheck.check_state(scene, *state, claims=["refusals"], engines=[])
    return {finding.subject for finding in findings if finding.verdict != "skipped"}


@pytest.mark.parametrize("heading", [0.0, 0.7])
def test_el_and_em_refuse_the_stretched_snake_and_nobody_else(heading):
    assert refused(*rolling(uniform([0.0] * 5), heading)) == {"el", "em"}


def test_el_and_em_refuse_one_link_only_along_x():
    assert refused(*rolling(uniform([0.3]), -0.3)) == {"el", "em"}
    assert refused(*rolling(uniform([0.3]), 0.5)) == set()


def test_el_and_em_refuse_wherever_the_last_two_wheels_are_parallel():
    for theta in ([0.0, 0.4, 0.4], [0.0, 0.4, 0.4 + np.pi]):
        assert refused(*rolling(uniform([0.1, 0.2, 0.2]), theta)) == {"el", "em"}
    assert refused(*rolling(uniform([0.1, 0.2, 0.2]), [0.4, 0.4, 0.0])) == set()


def test_ml_and_kane_refuse_a_wheel_across_its_link_and_nobody_else():
    assert refused(ACROSS, SPECIAL[-1][1]) == {"ml", "kane"}


def test_at_least_95_percent_of_ordinary_states_are_solved_by_all_formulations(links, examples):
    run, selection = ValidationRun(), RunSelection.of(engines=[], claims=["coverage"])
    run.explore(scene_cases(Snake, links, examples or 200, seed=0), selection)
    (finding,) = run.finish(selection)
    print(finding.detail)
    assert finding.verdict == "passed", finding.detail
