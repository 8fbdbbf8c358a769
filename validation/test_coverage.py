from eomcheck import strategies
from eomcheck.claims.run import Run, Selection


def test_at_least_95_percent_of_ordinary_states_are_solved_by_all_formulations(links, examples):
    run, selection = Run(), Selection.of(engines=[], claims=["equivalence", "refusals", "coverage"])
    drawn = strategies.scene_states(strategies.snakes(*links))
    run.explore(drawn, selection, examples or 200, seed=0)
    (finding,) = [f for f in run.finish(selection) if f.claim == "coverage"]
    print(finding.detail)
    assert finding.verdict == "passed", finding.detail
