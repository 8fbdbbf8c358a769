"""A run: which states it looks at, and that nothing it finds is lost."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import strategies as st
from tests.reports import Heavy

import eomcheck
from eomcheck.claims import State
from eomcheck.claims.run import RunSelection, ValidationRun
from eomcheck.errors import InputError
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import SCENES, Sleigh, Snake
from eomcheck.testing import check_functions

KINETIC = {"engines": [], "claims": ["kinetic-energy"]}


def moving(scene) -> State:
    q, _ = scene.initial_state()
    return State(q, eomcheck.velocity(scene, q, [1.0, 0.5]))


def test_a_failure_of_the_initial_state_is_among_the_findings():
    scene, run = Heavy(), ValidationRun()
    new = run.check_state(scene, moving(scene), RunSelection.of(**KINETIC, scenes=[scene]))
    assert "failed" in {finding.verdict for finding in new}
    assert run.findings == new


def test_the_time_of_a_claim_is_that_of_all_states(monkeypatch):
    scene, run = Sleigh(), ValidationRun()
    asked = {"engines": [], "claims": ["kinetic-energy", "power-balance"]}
    selection = RunSelection.of(**asked, scenes=[scene])
    clock = itertools.count()
    monkeypatch.setattr("eomcheck.claims.run.time.perf_counter", lambda: float(next(clock)))
    for _ in range(3):
        run.check_state(scene, moving(scene), selection)
    assert run.seconds == dict.fromkeys(asked["claims"], 3.0)


def test_the_smallest_failing_case_is_the_last_finding():
    def build(x: int):
        scene = Heavy() if x >= 10 else Sleigh()
        state = moving(scene)
        return scene, state._replace(q=state.q + np.array([x, 0, 0]))

    run, selection = ValidationRun(), RunSelection.of(**KINETIC, scenes=[Sleigh, Heavy])
    run.explore(
        map(build, (3, 99, 50)), selection, shrink_among=lambda _: st.integers(0, 999).map(build)
    )
    assert run.cases == 2
    assert run.minimal is not None and run.minimal.state is not None
    assert run.minimal.state.q[0] == Sleigh().initial_state()[0][0] + 10


def test_terms_that_are_no_numbers_fail():
    class Broken(Sleigh):
        @staticmethod
        def terms(*arguments):
            terms = Sleigh.terms(*arguments)
            return terms._replace(M=terms.M * np.nan)

    scene, run = Broken(), ValidationRun()
    run.check_state(scene, moving(scene), RunSelection.of(engines=[], scenes=[scene]))
    failed = [finding for finding in run.findings if finding.verdict == "failed"]
    assert [finding.claim for finding in failed] == ["finite-terms"]


def states(seed: int) -> list[list[float]]:
    found = eomcheck.validate(Snake.coil(2), examples=6, seed=seed, **KINETIC)
    return [finding.state.q.tolist() for finding in found if finding.state is not None]


def test_another_seed_draws_other_states_and_the_same_seed_the_same():
    assert states(1) == states(1)
    assert states(1) != states(2)


def test_another_seed_moves_the_example_of_a_kind_otherwise():
    runs = ValidationRun(), ValidationRun()
    for seed, run in enumerate(runs):
        run.validate_kind(Sleigh, RunSelection.of(**KINETIC, scenes=[Sleigh]), (1, 1), 1, seed)
    one, other = (run.sampled[0] for run in runs)
    assert repr(one.scene) == repr(other.scene) == repr(Sleigh.example())
    assert not np.array_equal(one.state.v, other.state.v)


def test_scenes_of_all_numbers_of_links_are_drawn():
    run, selection = ValidationRun(), RunSelection.of(**KINETIC)
    run.validate_kind(Snake, selection, (1, 3), 30, 0)
    assert {one.scene.n - 2 for one in run.sampled[1:]} == {1, 2, 3}


@pytest.mark.parametrize("kind", SCENES.values(), ids=SCENES)
@pytest.mark.parametrize("seed", [0, 1])
def test_the_example_of_a_kind_is_looked_at_as_it_starts_and_moving(kind: type[Scene], seed: int):
    run, selection = ValidationRun(), RunSelection.of(**KINETIC, scenes=[kind])
    run.validate_kind(kind, selection, (1, 2), 1, seed)
    assert run.cases == 3
    start, moving, _ = (run.findings[end - 1] for end in run.ends)
    assert repr(start.scene) == repr(moving.scene) == repr(kind.example())
    assert start.state is not None and moving.state is not None
    assert np.array_equal(start.state.v, kind.example().initial_state()[1])
    assert moving.state.v.any()


def test_a_run_counts_who_refused():
    scene = Snake([1, 1], [1, 1], [0.1, 0.1], [1], [0, 0])
    run = ValidationRun()
    run.check_state(scene, State(*scene.initial_state()), RunSelection.of(engines=[]))
    assert run.refused == ("el", "em")
    turned = scene.initial_state()[0] + np.array([0, 0, 0.3, 0.8])
    run.check_state(scene, State(turned, np.zeros(4)), RunSelection.of(engines=[]))
    assert run.refused == ()


def test_a_state_that_is_refused_is_counted_once():
    scene = Snake([1, 1], [1, 1], [0.1, 0.1], [1], [0, 0])
    q, v = scene.initial_state()
    turned = State(q + np.array([0, 0, 0.3, 0.8]), np.zeros(4))
    run = ValidationRun()
    cases = [(scene, one) for one in (turned, State(q, v), turned)]
    run.explore(cases, RunSelection.of(engines=[], claims=["refusals"]))
    assert [one.refused for one in run.sampled] == [(), ("el", "em"), ()]


@pytest.mark.parametrize(
    "checks",
    [
        lambda: eomcheck.check_state(Snake.paper(), *Snake.paper().initial_state(), claims=[]),
        lambda: eomcheck.validate(Snake.paper(), examples=1, claims=()),
        lambda: check_functions(1, M=lambda q: [[1.0]], claims=[]),
    ],
    ids=["check", "validate", "check_functions"],
)
def test_an_empty_selection_of_claims_is_no_success(checks):
    with pytest.raises(InputError, match="names nothing, expected at least one name"):
        checks()
