"""Fuzzing of random trees and mechanisms: structures by strata, each in lanes of its own."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from eomcheck.claims import CLAIMS
from eomcheck.descriptions.random_mechanisms import MOTION, NOTHING, RANDOM
from eomcheck.draws.fuzz_cases import (
    FAMILIES,
    ORDINARY,
    WIDE,
    StructuralVariant,
    draw_cases_with,
    draw_structure_kind,
    structural_variants,
    varied,
)
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import check_consistent
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.fuzzing.campaign import Campaign, Round
from eomcheck.lab.fuzzing.failures import (
    failure_record,
    fuzz_case,
    parameters_of,
    read_failures,
    write_failures,
)
from eomcheck.lab.fuzzing.motion_rounds import MotionPlan, draw_starts
from eomcheck.lab.fuzzing.screening import SCENE, CheckFrequency, Diagnosis, failed_findings
from eomcheck.lab.fuzzing.state_rounds import STRUCTURES, RandomStatePlan, StatePlan
from eomcheck.lab.store.record_file import Records
from eomcheck.mechanics.records import State
from eomcheck.strategies import draw_samples, scene_states, scenes

TREES, MECHANISMS = RANDOM["random-trees"], RANDOM["random-mechanisms"]
ALL = tuple(one for one in CLAIMS if one != "coverage")
both = pytest.mark.parametrize("kind", (TREES, MECHANISMS), ids=lambda kind: kind.key)


def plan(kind, **options) -> RandomStatePlan:
    """Return a plan of small batches, in lanes only."""
    usual = {"kind": kind, "seed": 3, "claims": ALL, "formulations": tuple(FORMULATIONS)}
    return RandomStatePlan(
        **(usual | {"batch": 4, "check_frequency": CheckFrequency(0, 0, 0, 0, 0)} | options)
    )


@both
def test_strata_are_topologies_and_what_is_drawn_is_of_its_stratum(kind):
    strata = structural_variants(kind, (2, 3))
    assert len(strata) == len(set(strata)) == len({one.name for one in strata}) >= 16
    random = np.random.default_rng(0)
    for stratum in strata:
        scene = draw_structure_kind(kind, stratum, random)()
        assert isinstance(stratum, StructuralVariant)
        assert scene.links == stratum.links
        assert dict(stratum.levels).items() <= scene.topology.items()
    structures = {draw_structure_kind(kind, strata[0], random)().structure for _ in range(12)}
    assert len(structures) > 2


def test_other_kinds_have_the_strata_that_they_had():
    from eomcheck.scenes import Snake

    assert structural_variants(Snake, (1,)) == [StructuralVariant(1, ())]
    assert draw_structure_kind(Snake, StructuralVariant(1, ()), np.random.default_rng(0)) is Snake


@both
def test_wide_cases_have_other_inertias_and_the_same_structure(kind):
    random = np.random.default_rng(2)
    scene = draw_structure_kind(kind, structural_variants(kind, (4,))[0], random)()
    cases, families = draw_cases_with(
        lambda family: varied(scene, family, random), FAMILIES, 64, random
    )
    assert {one.structure for one, _ in cases} == {scene.structure}
    assert {type(one) for one, _ in cases} == {type(scene)}
    for one, state in cases:
        check_consistent(Evaluation(one, *state))
    masses = [np.abs(one.mass).max() for (one, _), f in zip(cases, families, strict=True)
              if f == WIDE]  # fmt: skip
    assert max(masses) > 1e4 * min(masses)
    same = [np.array_equal(one.mass, scene.mass)
            for (one, _), f in zip(cases, families, strict=True) if f == ORDINARY]  # fmt: skip
    assert same and all(same)


@pytest.mark.night
@both
def test_rounds_look_at_several_structures_find_nothing_and_can_be_repeated(kind):
    stratum = structural_variants(kind, (1,))[0]
    one, again = (plan(kind).run(Round(1, stratum, {})) for _ in range(2))
    assert not one.failed and one.counts["structures"] == STRUCTURES
    assert one.counts == again.counts and one.counts["climbed"] > 0
    assert one.states <= plan(kind).max_states
    heights = [{k: [x.score for x in b] for k, b in r.population.items()} for r in (one, again)]
    assert heights[0] == heights[1]
    # The next one goes on with a structure of this one besides.
    after = plan(kind).run(Round(2, stratum, one.population))
    assert after.counts["climbed"] > STRUCTURES * 4 + 2
    assert all(len(best) <= 6 for best in after.population.values())


@pytest.mark.night
def test_a_wrong_sum_of_terms_is_found_in_random_trees(monkeypatch):
    from eomcheck.descriptions import mechanism_class

    right = mechanism_class.make_terms

    def wrong(*given):
        terms = right(*given)

        def leaning(parameters, prepared, q, v):
            found = terms(parameters, prepared, q, v)
            return found._replace(B=found.B + found.B / 1024)

        return leaning

    monkeypatch.setattr(mechanism_class, "make_terms", wrong)
    caches = mechanism_class.plan_and_functions, mechanism_class.scene_class_of
    for one in caches:
        one.cache_clear()
    try:
        stratum = next(x for x in structural_variants(TREES, (3,)) if "spherical" in x.name)
        result = plan(
            TREES, families=(ORDINARY,), check_frequency=CheckFrequency(0, 0, 0, 0, 0)
        ).run(Round(0, stratum, {}))
        assert {"bias-symbols", "power-balance", "kane-ml-force"} & {x.claim for x in result.failed}
        find = plan(TREES).record_failure(result.failed[0], TREES.key, [])
        assert find.whose == SCENE and "description" in find.parameters
    finally:
        for one in caches:
            one.cache_clear()


@both
def test_what_is_kept_of_a_random_scene_makes_it_again(kind, tmp_path: Path):
    random = np.random.default_rng(1)
    for stratum in islice(structural_variants(kind, (3,)), 0, None, 3):
        scene = varied(draw_structure_kind(kind, stratum, random)(), WIDE, random)
        q, v = scene.initial_state()
        again, state = fuzz_case(kind, parameters_of(scene), q, v, 0.0)
        assert repr(again) == repr(scene) and again.structure == scene.structure
        assert np.array_equal(state.q, q)
    assert not failed_findings((scene, State(q, v + 0.5, 0.0)), ["kinetic-energy"], ())
    from eomcheck.claims import Finding

    told = Finding("equivalence", "au ~ im", scene, State(q, v, 0.0), 1.0, 0.0, "failed", "tested")
    find = failure_record(told, kind.key, Diagnosis("scene", "tested"))
    file = tmp_path / "found.json"
    write_failures(file, [find])
    (kept,) = read_failures(file)
    assert repr(kept.case[0]) == repr(scene)
    assert "mechanism(" in kept.python


@both
def test_what_is_kept_of_a_random_scene_without_an_optional_parameter_makes_it_again(kind):
    taken = set()
    for scene in kind.structures(3):
        q, v = scene.initial_state()
        for name in scene.declared.keys() & {"damping", "gravity"}:
            if getattr(scene, name) is None:
                continue
            without = scene.changed(**{name: None})
            again, _ = fuzz_case(kind, parameters_of(without), q, v, 0.0)
            assert getattr(again, name) is None and repr(again) == repr(without)
            taken.add(name)
    assert taken == {"damping", "gravity"}


@pytest.mark.night
@both
def test_a_campaign_of_random_scenes_goes_on_where_it_stopped(kind, tmp_path: Path):
    strata, here = (
        structural_variants(kind, (1,))[:1],
        plan(kind, claims=("kinetic-energy",), batch=2),
    )
    here = replace(here, formulations=("au",))
    whole = Campaign(here, kind.key, strata)
    whole.run(states=40)
    with Records(tmp_path / "r.db") as records:
        Campaign(here, kind.key, strata, records).run(states=5)
    with Records(tmp_path / "r.db") as records:
        again = Campaign(here, kind.key, strata, records)
        assert 0 < again.resumed < 40
        again.run(states=40)
    assert again.counts == whole.counts and again.rounds == whole.rounds >= 2
    assert {k: x.score for k, x in again.worst.items()} == {
        k: x.score for k, x in whole.worst.items()
    }


@pytest.mark.sampled(2)
@both
def test_random_scenes_are_moved_too(kind):
    here = MotionPlan(kind, 0, tuple(FORMULATIONS), (ORDINARY,), batch=4)
    stratum = structural_variants(kind, (2,))[0]
    cases, _ = draw_starts(here.kind, stratum, here.families, here.batch, np.random.default_rng(0))
    assert len({type(scene) for scene, _ in cases}) == 1
    result = here.run(Round(0, stratum, {}))
    assert not result.failed and result.counts["passed"] > 0


@both
@pytest.mark.night
def test_fuzzing_and_hypothesis_draw_structures_and_numbers_from_the_same_ranges(kind):
    random, strata = np.random.default_rng(0), structural_variants(kind, (3,))
    fuzzed = [draw_structure_kind(kind, strata[i % len(strata)], random)() for i in range(60)]
    by_hypothesis = [scene for scene, _ in draw_samples(scene_states(scenes(kind, 3, 3)), 30, 0)]
    ways: dict[str, set[str]] = {}
    for entry in kind.topologies(3):
        for name, of in entry.items():
            ways.setdefault(name, set()).update(of)
    for name, among in ways.items():
        seen = [{one.topology.get(name) for one in x} for x in (fuzzed, by_hypothesis)]
        if name == MOTION:
            continue
        assert seen[0] | seen[1] <= among | {NOTHING}, name
        # Hypothesis is fond of the simplest; what it draws is drawn here, and all but rare ways.
        assert len(seen[0]) > len(among) / 2 and seen[0] & seen[1], name
    for name in ("mass", "center"):
        drawn = [np.concatenate([np.ravel(getattr(one, name)) for one in x])
                 for x in (fuzzed, by_hypothesis)]  # fmt: skip
        lows, highs = [x.min() for x in drawn], [x.max() for x in drawn]
        wide = max(highs) - min(lows)
        assert max(lows) - min(lows) < 0.35 * wide and max(highs) - min(highs) < 0.35 * wide


def test_a_plan_for_random_kinds_is_a_plan():
    one = plan(TREES)
    assert isinstance(one, StatePlan) and replace(one, batch=9).max_states > one.max_states
    assert isinstance(replace(one, batch=9), RandomStatePlan)
