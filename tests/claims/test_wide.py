"""States beyond the ordinary ones: which, how far, and where they are drawn."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest

import eomcheck
from eomcheck.claims.run import RunSelection, ValidationRun
from eomcheck.descriptions.random_mechanisms import RANDOM
from eomcheck.draws.pairwise_design import (
    FAST,
    SLOW,
    TURNS,
    rotating_coordinates,
    scene_cases,
    state_cases,
    with_wide,
)
from eomcheck.engines.casadi import CasadiEngine
from eomcheck.evaluation.dynamics import assembly_error
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.scenes import SCENES, Bricard, ChainPendulum, FlyballGovernor, Sleigh, Snake
from eomcheck.testing.suite import SceneTarget

TURN = 2 * np.pi


def pairs(scene, count: int, seed: int = 0):
    """Return ordinary states and the states in their places."""
    ordinary = list(state_cases(scene, count, 0))
    return [(x, y) for (_, x), (_, y) in zip(ordinary, with_wide(ordinary, seed), strict=True)]


def test_every_other_state_is_beyond_the_ordinary_ones_and_the_others_are_as_drawn():
    for i, (ordinary, wide) in enumerate(pairs(ChainPendulum.example(), 9)):
        assert (wide is ordinary) == (i % 2 == 0)


def test_angles_are_turned_by_up_to_two_whole_turns_and_speeds_are_fast_and_slow():
    turns, speeds = set(), []
    for ordinary, wide in pairs(ChainPendulum.example(), 200)[1::2]:
        turned = (wide.q - ordinary.q) / TURN
        assert turned == pytest.approx(np.round(turned), abs=1e-9)
        turns |= set(np.round(turned).astype(int).tolist())
        if ordinary.v.any():
            speeds.append(np.log10(np.abs(wide.v).max()))
    assert turns == set(range(-TURNS, TURNS + 1)) == {-2, -1, 0, 1, 2}
    fast, slow = ([x for x in speeds if low <= x <= high] for low, high in (FAST, SLOW))
    assert len(fast) > 40 and len(slow) > 20
    assert (FAST, SLOW) == ((1.5, 3.0), (-6.0, -2.0))


def test_what_slides_stays_where_it_is():
    sleigh = Sleigh.example()
    assert rotating_coordinates(sleigh).tolist() == [False, False, True]
    assert rotating_coordinates(FlyballGovernor.example()).tolist().count(True) > 0
    for ordinary, wide in pairs(sleigh, 20)[1::2]:
        assert wide.q[:2] == pytest.approx(ordinary.q[:2], abs=1e-9)


def test_which_coordinates_turn_is_told_by_the_tree_where_the_scene_names_none():
    found = [
        (rotating_coordinates(scene), scene.tree())
        for scene, _ in scene_cases(RANDOM["random-trees"], (1, 3), 12, 0)
    ]
    assert any(turned.any() for turned, _ in found)
    for turned, tree in found:
        assert tree is not None
        slides = np.array([kind.startswith("p") for kind in tree.joint])
        assert not (tree.coordinates[slides] != 0)[:, turned].any(), tree


@pytest.mark.parametrize("kind", [*SCENES.values(), *RANDOM.values()], ids=lambda kind: kind.key)
def test_wide_states_keep_the_constraints(kind):
    links = (2, 4) if kind.has_links else (1, 1)
    for scene, (q, v, t) in islice(with_wide(scene_cases(kind, links, 8, 0), 0), 1, None, 2):
        at = Evaluation(scene, q, v, t)
        eomcheck.evaluation.dynamics.check_consistent(at)
        error, allowed = assembly_error(at)
        assert error <= allowed


def test_another_seed_draws_other_states():
    scene = ChainPendulum.example()
    (_, one), (_, again), (_, other) = (pairs(scene, 2, seed)[1] for seed in (0, 0, -1))
    assert one.q.tolist() == again.q.tolist()
    assert (one.q - other.q).any() or (one.v - other.v).any()


def test_wide_states_are_for_engines_that_are_named():
    assert not RunSelection.of(scenes=[Bricard]).engines_named
    assert not RunSelection.of(engines=[], scenes=[Bricard]).engines_named
    assert RunSelection.of(engines=["casadi"], scenes=[Bricard]).engines_named
    claims, far = ["mass-matrix"], []
    for engines in (["casadi"], None):
        found = eomcheck.validate(Snake.paper(), examples=8, engines=engines, claims=claims)
        states = [one.state for one in found if one.state is not None]
        far.append(max(np.abs(state.q[2:]).max() for state in states))
    assert far[0] > TURN + 1 > far[1]


@pytest.mark.parametrize("engines", [["casadi"], []])
def test_random_scenes_of_a_kind_are_in_wide_states_for_an_engine_that_is_named(engines):
    run, selection = (
        ValidationRun(),
        RunSelection.of(None, engines, ["mass-matrix"], scenes=[ChainPendulum]),
    )
    run.validate_kind(ChainPendulum, selection, (1, 2), 8, 0)
    far = [np.abs(one.state.q).max() for one in run.sampled]
    assert (max(far) > TURN + 1) == bool(engines)


def test_tests_of_an_engine_are_asked_at_wide_states_and_tests_of_a_scene_are_not(monkeypatch):
    far: dict[bool, list[float]] = {True: [], False: []}

    def looked_at(self, scene, state, selection):
        far[selection.engines_named].append(np.abs(state.q).max())
        return []

    monkeypatch.setattr(ValidationRun, "check_state", looked_at)
    monkeypatch.setattr("eomcheck.testing.suite.check_compared", lambda *_: None)
    for engine in (CasadiEngine, None):
        SceneTarget("rods", ChainPendulum.rods(2), engine).results(8, 0)
    assert max(far[True]) > TURN + 1 > max(far[False])
    assert len(far[True]) == len(far[False]) == 9
