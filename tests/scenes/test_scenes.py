"""Every scene of the registry keeps the contract, in every kind of number."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.samples import LINKS, ordinary

import eomcheck
from eomcheck import strategies
from eomcheck.claims.proof import prove
from eomcheck.engines import ALWAYS, ENGINES
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import check_consistent
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.formulations import FORMULATIONS, applicable
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.counting import Counting
from eomcheck.numbers.generic import FLOAT64
from eomcheck.scenes import SCENES

kinds = pytest.mark.parametrize("kind", SCENES.values(), ids=SCENES)
every_formulation_of_every_kind = pytest.mark.parametrize(
    ("kind", "key"), [(kind, key) for kind in SCENES.values() for key in applicable(kind)]
)


def structures(kind: type[Scene], links: int = LINKS) -> list[Scene]:
    return list(kind.structures(links if kind.has_links else None))


@pytest.mark.sampled(3)
@kinds
def test_every_identity_is_proved_for_every_structure(kind: type[Scene]):
    for scene in structures(kind):
        findings = prove(scene, points=1, seed=0)
        assert [str(f) for f in findings if f.verdict != "passed"] == []
        proved = {f.claim for f in findings}
        assert {"mass-matrix", "bias", "equivalence", "equations-residual"} <= proved


@pytest.mark.sampled(3)
@kinds
def test_one_link_is_proved_too(kind: type[Scene]):
    if kind.has_links:
        for scene in structures(kind, 1):
            findings = prove(scene, points=1, seed=0)
            assert [str(f) for f in findings if f.verdict == "failed"] == []


@pytest.mark.night
@pytest.mark.sampled(10)
@kinds
@settings(max_examples=5)
@given(data=st.data())
def test_ordinary_scenes_and_states_pass_every_claim(kind: type[Scene], data):
    scene, state = data.draw(strategies.scene_states(strategies.scenes(kind, 1, 3)))
    check_consistent(Evaluation(scene, *state))
    findings = eomcheck.check_state(scene, *state)
    assert [str(f) for f in findings if f.verdict == "failed"] == []


@pytest.mark.sampled(6)
@kinds
def test_a_state_in_motion_is_checked_by_every_formulation_and_engine(kind: type[Scene]):
    scene, state = ordinary(kind)
    findings = eomcheck.check_state(scene, *state)
    assert [str(f) for f in findings if f.verdict == "failed"] == []
    # Around a parallelogram gamma cancels, and what is left of it has no digit to compare.
    assert {f.claim for f in findings if f.verdict == "inconclusive"} <= {"speeds-remainder"}
    subjects = {f.subject for f in findings if f.claim == "engine-acceleration"}
    engines = [key for key in ALWAYS if ENGINES[key].represents(scene)]
    assert subjects == {f"{f} ~ {engine}" for f in applicable(kind) for engine in engines}


@pytest.mark.sampled(4)
@every_formulation_of_every_kind
def test_operations_are_counted_and_without_constraints_only_one_system_is_solved(
    kind: type[Scene], key: str
):
    scene, counting = ordinary(kind)[0], Counting()
    at = Quantities(scene, counting, counting.vector(scene.n), counting.vector(1)[0])
    at.u = counting.vector(scene.p)
    solution = at.solution(FORMULATIONS[key])
    assert counting.tally.multiplications > 0
    if scene.r == 0:
        assert [system.columns for system in counting.tally.systems] == [1]
        assert solution.multipliers is None


@kinds
def test_a_scene_is_printed_as_the_code_that_makes_it_again(kind: type[Scene]):
    for scene in (ordinary(kind)[0], *structures(kind)):
        again = eval(repr(scene), {kind.__name__: kind})
        assert repr(again) == repr(scene)
        assert again.structure == scene.structure
        for one, other in zip(again.parameters(FLOAT64), scene.parameters(FLOAT64), strict=True):
            assert (one is None) == (other is None)
            assert one is None or (one == other).all()


@kinds
def test_the_example_starts_from_a_consistent_state_that_it_names(kind: type[Scene]):
    scene = kind.example()
    at = Evaluation(scene, *scene.initial_state())
    check_consistent(at)
    assert scene.name.startswith(kind.key)
    assert len(scene.coordinate_names) == scene.n
    assert len(scene.constraint_names) == scene.r
    assert (at.terms.a is None) == (scene.r == 0)
    assert kind.conserves_energy == (not kind.why_not_conserved)
