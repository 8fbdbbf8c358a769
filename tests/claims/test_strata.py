"""Cases drawn by strata: every kind of case is looked at by default, whatever the seed."""

from __future__ import annotations

import inspect
import subprocess
import sys
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

import eomcheck
from eomcheck.claims.run import RunSelection, ValidationRun
from eomcheck.cli.check_commands import validate_command
from eomcheck.draws import pairwise_design as module
from eomcheck.draws.pairwise_design import (
    AT_REST,
    BOTH,
    LINKS,
    MOTION,
    MOVING,
    NEGATIVE,
    POSITIVE,
    REST_EVERY,
    ZERO,
    count_levels,
    covering_array,
    design_rows,
    factors,
    level_pairs,
    levels_of_case,
    pairs_in,
    sample_level,
    scene_cases,
    state_cases,
)
from eomcheck.errors import InputError, RefusedError
from eomcheck.formulations import FORMULATIONS
from eomcheck.mechanics.records import Range
from eomcheck.scenes import SCENES, Snake
from eomcheck.scenes.snake import qdot

EXAMPLES = inspect.signature(validate_command).parameters["examples"].default
LEAST, MOST = 1, 12
every_kind = pytest.mark.parametrize("kind", SCENES.values(), ids=SCENES)


def choices(kind) -> list:
    """Return the strata of a kind for each number of links of a default run."""
    numbers = range(LEAST, MOST + 1) if kind.has_links else (None,)
    return [ways for n in numbers for ways in factors(kind, n)]


# ---- Rows ----------------------------------------------------------------------------------------


@every_kind
@pytest.mark.parametrize("seed", range(5))
def test_a_covering_array_has_every_pair(kind, seed):
    made = covering_array(choices(kind), np.random.default_rng(seed))
    wanted = level_pairs(choices(kind))
    assert set().union(*map(pairs_in, made)) == wanted
    for row in made:
        assert any(all(way in ways[x] for x, way in row.items()) for ways in choices(kind))
    # No array is smaller than the two largest strata that meet.
    assert len(made) <= 60


@pytest.mark.sampled(3)
@every_kind
@pytest.mark.parametrize("seed", [0, 1])
def test_a_single_scene_is_drawn_at_rest_too_where_no_clock_drives_it(kind, seed):
    drawn = list(state_cases(kind.example(), 2 * REST_EVERY, seed))
    at_rest = [number for number, (_, state) in enumerate(drawn) if not np.any(state.v)]
    assert at_rest == ([] if kind.example().depends_on_time else [REST_EVERY - 1])


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("examples", [1, 9, 10, 55, EXAMPLES, 333])
def test_at_most_a_tenth_is_at_rest_however_few_are_drawn(examples, seed):
    drawn = list(design_rows(choices(Snake), examples, np.random.default_rng(seed)))
    assert len(drawn) == examples
    assert sum(row[MOTION] == AT_REST for row in drawn) <= examples / REST_EVERY


def test_links_motion_springs_dampers_and_wheels_are_strata_of_snakes():
    (three,), (one,) = factors(Snake, 3), factors(Snake, 1)
    assert three == {
        **{LINKS: ("3",), MOTION: (MOVING, AT_REST)},
        **dict.fromkeys(("mass", "length", "inertia"), ("present",)),
        **dict.fromkeys(("stiffness", "damping"), ("absent", ZERO, POSITIVE)),
        "wheel_angle": (ZERO, POSITIVE, NEGATIVE, BOTH),
    }
    assert one["stiffness"] == one["damping"] == ("absent",), "a link alone has no joints"
    assert one["wheel_angle"] == (ZERO, POSITIVE, NEGATIVE)


# ---- Cases, measured on what was drawn -----------------------------------------------------------


@pytest.mark.sampled(4)
@every_kind
def test_default_draws_have_every_pair_of_strata_and_hardly_rest(kind, sized):
    for seed in range(sized(3, 1) if kind is Snake else 1):
        cases = list(scene_cases(kind, (LEAST, MOST), EXAMPLES, seed))
        found = [levels_of_case(scene, state) for scene, state in cases]
        assert set().union(*map(pairs_in, found)) == level_pairs(choices(kind))
        counts = count_levels(cases)
        assert counts[MOTION].get(AT_REST, 0) <= EXAMPLES / REST_EVERY
        assert all(states > 0 for of in counts.values() for states in of.values())
        if kind.has_links:
            moving = [row for row in found if row[LINKS] == "1" and row[MOTION] == MOVING]
            assert len(moving) >= 4


def test_what_is_measured_is_what_was_drawn_not_what_was_meant():
    one = Snake([1], [1], [0.1], None, [0.2]), Snake([1], [1], [0.1], None, [0.0])
    at_rest = eomcheck.mechanics.records.State(*one[0].initial_state())
    assert count_levels((scene, at_rest) for scene in one) == {
        LINKS: {"1": 2},
        MOTION: {MOVING: 0, AT_REST: 2},
        "wheel_angle": {ZERO: 1, POSITIVE: 1, NEGATIVE: 0},
    }


SAME = """
import sys
{more}
from eomcheck.draws.pairwise_design import scene_cases
from eomcheck.scenes import Snake
for scene, state in scene_cases(Snake, (1, 12), 20, {seed}):
    print(repr(scene), state.q.tolist(), state.v.tolist())
"""


@pytest.mark.night
def test_draws_depend_on_the_seed_and_on_nothing_that_stands_in_sources(tmp_path: Path):
    (tmp_path / "own.py").write_text("X = 0.7123, 3, 2.125, 7.5e-3\n", encoding="utf-8")

    def printed(seed: int, more: str = "") -> str:
        code = SAME.format(seed=seed, more=more)
        run = [sys.executable, "-c", code]
        return subprocess.run(run, cwd=tmp_path, capture_output=True, text=True, check=True).stdout

    assert printed(1) == printed(1, "sys.path.append('.'); import own") != printed(2)


def test_negative_seeds_are_seeds_of_their_own():
    first = [next(scene_cases(Snake, (3, 3), 1, seed))[1].q.tolist() for seed in (-1, 0, 1)]
    assert first[0] != first[2] != first[1]


def test_a_scene_that_cannot_be_closed_is_said(monkeypatch: pytest.MonkeyPatch):
    def refuse(*arguments, **options):
        raise RefusedError("loops", 0.0, 1.0, "the loops are open")

    monkeypatch.setattr(module, "ordinary_state", refuse)
    with pytest.raises(InputError, match="no position near any of 100 draws is closed; snake"):
        next(scene_cases(Snake, (1, 1), 1, 0))


# ---- Variety -------------------------------------------------------------------------------------


def test_arrays_take_all_of_their_range_and_their_links_differ():
    cases = list(scene_cases(Snake, (4, 4), 1000, 3))
    ranges = Snake.ranges(4)
    for name, one in ranges.items():
        values = np.array([x for s, _ in cases if (x := getattr(s, name)) is not None])
        assert_whole_range(values, one, name)
        there = values[np.any(values != 0, axis=1)]
        for i, j in combinations(range(there.shape[1]), 2):
            assert (there[:, i] != there[:, j]).all(), f"{name}, links {i} and {j}"


@pytest.mark.parametrize("way", [POSITIVE, NEGATIVE, BOTH])
@pytest.mark.parametrize(("low", "high"), [(-1.0, 3.0), (-3.0, 1.0)])
def test_a_range_whose_ends_have_other_magnitudes_is_left_in_no_way(low, high, way):
    random, ends = np.random.default_rng(0), {POSITIVE: (0.0, high), NEGATIVE: (low, 0.0)}
    drawn = np.array([sample_level(Range(low, high, (2,)), way, random) for _ in range(200)])
    least, most = ends.get(way, (low, high))
    assert least <= drawn.min() < 0.9 * least + 0.1 * most
    assert 0.1 * least + 0.9 * most < drawn.max() <= most


def assert_whole_range(values, one: Range, name: str) -> None:
    """Assert that entries differ, and come from each tenth of the range and near zero."""
    for entry in values.reshape(len(values), -1).T:
        assert len(np.unique(entry)) > len(entry) / 2, f"{name} hardly changes"
        tenths = np.histogram(entry, 10, (one.low, one.high))[0]
        assert (tenths > 0).all(), f"{name}: {tenths}"
        assert ((one.low <= entry) & (entry <= one.high)).all()
        signs = {np.sign(x) for x in (one.low / 2, one.high / 2) if x}
        assert signs <= set(np.sign(entry)), name


@pytest.mark.sampled(5)
@every_kind
def test_no_number_of_a_case_is_constant(kind, sized):
    # Closed positions take long to find.
    count = sized(1000, 400) if kind.position_residual is None else 150
    cases = list(scene_cases(kind, (2, 2), count, 5))
    for name, one in kind.ranges(2 if kind.has_links else None).items():
        present = [x for s, _ in cases if (x := getattr(s, name)) is not None]
        assert_whole_range(np.array(present), one, name)
        assert (len(present) < count) == one.optional
    q, v = (np.array([getattr(state, x) for _, state in cases]) for x in "qv")
    for name, column in zip(cases[0][0].coordinate_names, q.T, strict=True):
        assert len(np.unique(column)) > 0.9 * count, name
    moving = v[v.any(axis=1)]
    assert len(moving) >= 0.9 * count
    for column in moving.T:
        assert (column > 0).any() and (column < 0).any()
    assert len({state.t for _, state in cases}) == (count if kind.depends_on_time else 1)


@pytest.mark.sampled(3)
@every_kind
def test_symmetries_move_what_is_drawn(kind):
    moved: dict[str, list[bool]] = {}
    for scene, state in scene_cases(kind, (2, 2), 30, 1):
        for one in scene.symmetries(state.q, state.v):
            other = abs(one.q - state.q).max() > 1e-3 or repr(one.scene) != repr(scene)
            moved.setdefault(one.name, []).append(bool(other))
    for name, each in moved.items():
        assert np.mean(each) > 0.8, name


# ---- Faults that only some strata show -----------------------------------------------------------


def first_failure(kind, selection: RunSelection):
    run = ValidationRun()
    run.validate_kind(kind, selection, (LEAST, MOST), EXAMPLES, 0)
    return run.minimal


class WrongQdotOfOneLink(Snake):
    @staticmethod
    def qdot(parameters, prepared, kinematics):
        found = qdot(parameters, prepared, kinematics)
        return 1.25 * found if found.size == 3 else found


@pytest.mark.night
def test_a_velocity_that_is_wrong_for_one_link_only_is_found_by_default():
    failure = first_failure(WrongQdotOfOneLink, RunSelection.of(engines=[]))
    assert failure is not None
    assert getattr(failure.scene, LINKS) == 1
    assert failure.claim in ("speeds-velocity", "null-space-speeds")


@pytest.mark.night
def test_a_fault_of_gw_for_one_link_only_is_found_by_default(monkeypatch: pytest.MonkeyPatch):
    right = FORMULATIONS["gw"]

    def wrong(M, F, a, gamma, v, partition):
        gamma = 1.5 * gamma if len(a) == 1 else gamma
        return right.solution(M, F, a, gamma, v, partition)

    monkeypatch.setitem(FORMULATIONS, "gw", replace(right, solution=wrong))
    failure = first_failure(Snake, RunSelection.of(engines=[]))
    assert failure is not None
    assert getattr(failure.scene, LINKS) == 1
    assert "gw" in failure.subject
