"""What leaving out saves: the same scene with explicit zeros moves alike, and costs more."""

from __future__ import annotations

import numpy as np
import pytest
from tests.samples import random_scene, random_state

from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import acceleration_sensitivity
from eomcheck.formulations import applicable
from eomcheck.lab.studies.operations import STUDY, savings_in
from eomcheck.lab.studies.operations.measure import absent_terms, with_zeros
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import SCENES

STRUCTURES = [
    scene for kind in SCENES.values() for scene in kind.structures(3 if kind.has_links else None)
]
structures = pytest.mark.parametrize("scene", STRUCTURES, ids=lambda scene: scene.structure)


@pytest.mark.parametrize("kind", SCENES.values(), ids=SCENES)
def test_zeros_change_no_acceleration(kind: type[Scene]):
    random = np.random.default_rng(0)
    scene = random_scene(kind, random, 2)
    state = random_state(scene, random)
    at, filled = Evaluation(scene, *state), Evaluation(with_zeros(scene), *state)
    for formulation in applicable(kind).values():
        expected = at.acceleration(formulation).vdot
        spread = acceleration_sensitivity(at, formulation)
        found = filled.acceleration(formulation).vdot
        assert np.abs(found - expected).max() <= 1e-13 * spread


@structures
def test_with_zeros_nothing_is_absent_any_more(scene: Scene):
    assert absent_terms(scene)
    zeros = with_zeros(scene)
    assert absent_terms(zeros) == ()
    assert type(zeros).key == type(scene).key


def test_no_formulation_spends_an_operation_on_what_is_absent():
    records = savings_in(STUDY.run(scene="all", repeats=0))
    assert {record.structure for record in records} == {scene.structure for scene in STRUCTURES}
    for record in records:
        absent, zeros = record.operations
        assert absent <= zeros, record
        # All of them subtract the bias from the forces, or add forces to it.
        if "Q" in record.absent and record.formulation != "kane":
            assert absent < zeros, record
        if "gyroscopic" in record.absent and record.formulation == "kane":
            assert absent < zeros, record


def test_times_of_both_are_measured_on_request():
    found = STUDY.run(scene="sleigh", formulation=["kane"], repeats=2)
    (record,) = savings_in(found)
    assert record.seconds is not None
    assert min(record.seconds) > 0.0
    assert record.absent == ["Q", "b", "offset", "gyroscopic", "force"]
