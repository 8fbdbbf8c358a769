"""Every scene of the registry keeps the contract, in every kind of number."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from tests.scenes import LINKS, random_scene, random_state

import eomcheck
from eomcheck import strategies
from eomcheck.arithmetic.counting import Counting
from eomcheck.arithmetic.float64 import FLOAT64
from eomcheck.checks.proof import prove
from eomcheck.engines import ENGINES
from eomcheck.evaluate import Evaluation
from eomcheck.formulations import FORMULATIONS, applicable
from eomcheck.model import Scene
from eomcheck.motion.simulate import Motion, simulate
from eomcheck.quantities import Quantities
from eomcheck.scenes import SCENES
from eomcheck.states import check_consistent
from eomcheck.tolerance import allowed_error

kinds = pytest.mark.parametrize("kind", SCENES.values(), ids=SCENES)
every_formulation_of_every_kind = pytest.mark.parametrize(
    ("kind", "key"), [(kind, key) for kind in SCENES.values() for key in applicable(kind)]
)


def structures(kind: type[Scene], links: int = LINKS) -> list[Scene]:
    return list(kind.structures(links if kind.has_links else None))


def ordinary(kind: type[Scene], seed: int = 0):
    random = np.random.default_rng(seed)
    scene = random_scene(kind, random)
    return scene, random_state(scene, random)


@kinds
def test_every_identity_is_proved_for_every_structure(kind: type[Scene]):
    for scene in structures(kind):
        findings = prove(scene, points=1, seed=0)
        assert [str(f) for f in findings if f.verdict != "passed"] == []
        proved = {f.claim for f in findings}
        assert {"mass-matrix", "bias", "equivalence", "equations-residual"} <= proved


@kinds
def test_one_link_is_proved_too(kind: type[Scene]):
    if kind.has_links:
        for scene in structures(kind, 1):
            findings = prove(scene, points=1, seed=0)
            assert [str(f) for f in findings if f.verdict == "failed"] == []


@kinds
@settings(max_examples=5)
@given(data=strategies.st.data())
def test_ordinary_scenes_and_states_pass_every_claim(kind: type[Scene], data):
    scene, state = data.draw(strategies.scene_states(strategies.scenes(kind, 1, 3)))
    check_consistent(Evaluation(scene, *state))
    findings = eomcheck.check(scene, *state)
    assert [str(f) for f in findings if f.verdict == "failed"] == []


@kinds
def test_a_state_in_motion_is_checked_by_every_formulation_and_engine(kind: type[Scene]):
    scene, state = ordinary(kind)
    findings = eomcheck.check(scene, *state)
    assert [str(f) for f in findings if f.verdict == "failed"] == []
    # Around a parallelogram gamma cancels, and what is left of it has no digit to compare.
    assert {f.claim for f in findings if f.verdict == "inconclusive"} <= {"speeds-remainder"}
    subjects = {f.subject for f in findings if f.claim == "engine-acceleration"}
    engines = [key for key, engine in ENGINES.items() if engine.represents(scene)]
    assert subjects == {f"{f} ~ {engine}" for f in applicable(kind) for engine in engines}


def test_compiled_rates_are_those_of_the_public_acceleration(moved: tuple[type[Scene], str]):
    kind, key = moved
    scene, (q, v, t) = ordinary(kind)
    expected = eomcheck.acceleration(scene, key, q, v, t)
    motion, at = Motion(scene, FORMULATIONS[key], q, v), Evaluation(scene, q, v, t)
    y = motion.y0.copy()
    if motion.formulation.state == "q, u":
        y[scene.n :] = at.u
    rates = motion.function(t, y)
    allowed = 4 * expected.error_bound
    assert np.abs(rates[: scene.n] - v).max() <= allowed_error(at.spread(lambda e: e.velocity))
    found = rates[scene.n : scene.n + motion.speeds]
    if motion.formulation.state == "q, u":
        if at.speeds.W is not None:
            found = at.speeds.W @ found + at.speeds.rest
    elif motion.formulation.state == "q, x":
        found = at.call(scene.chain_acceleration, at.parameters, at.prepared, at.x, found)
    elif motion.formulation.state == "q, v2":
        expected = expected.vdot[motion.partition.independent]
        assert np.abs(found - expected).max() <= allowed
        return
    assert np.abs(found - expected.vdot).max() <= allowed


@kinds
def test_formulations_move_a_scene_alike(kind: type[Scene]):
    scene, (q, v, _) = ordinary(kind, 1)
    if scene.depends_on_time:  # the drawn state is one of another time
        q = v = None
    ends = []
    for key in ("au", "em", "kane"):
        motion = simulate(scene, key, 0.1, rtol=1e-11, atol=1e-11, q0=q, v0=v)
        assert motion.status == "finished", motion.reason
        ends.append(np.concatenate((motion.q[-1], motion.v[-1])))
        if scene.conserves_energy:
            assert np.ptp(motion.energy) <= 1e-8 * np.abs(motion.energy).max()
    size = np.abs(ends[0]).max()
    assert max(np.abs(end - ends[0]).max() for end in ends) <= 1e-8 * size


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
