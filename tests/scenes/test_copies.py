"""Scenes that come back from a file or another process are what they were."""

from __future__ import annotations

import copy
import pickle
from dataclasses import fields

import numpy as np
import pytest

import eomcheck
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import SCENES, Bricard


@pytest.mark.parametrize("kind", SCENES.values(), ids=SCENES)
@pytest.mark.parametrize("again", [copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))])
def test_copies_of_scenes_cannot_be_changed_either(kind: type[Scene], again):
    scene = kind.example()
    record = scene.float64_parameters
    assert scene.float64_parameters is record
    found = again(scene)
    assert repr(found) == repr(scene)
    assert found.float64_parameters is not record
    assert type(found.float64_parameters) is type(record)
    for field in fields(found):
        value = getattr(found, field.name)
        if isinstance(value, np.ndarray):
            assert not value.flags.writeable
            assert np.array_equal(value, getattr(scene, field.name))


def test_a_scene_with_some_of_its_constraints_is_copied_after_it_was_evaluated():
    whole = Bricard()
    scene = eomcheck.with_constraints(whole, whole.constraint_names[:-1])
    terms = Evaluation(scene, *scene.initial_state()).terms
    again = pickle.loads(pickle.dumps(scene))
    assert np.array_equal(Evaluation(again, *scene.initial_state()).terms.M, terms.M)
