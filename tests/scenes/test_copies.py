"""Scenes that come back from a file or another process are what they were."""

from __future__ import annotations

import copy
import pickle
from dataclasses import fields

import numpy as np
import pytest

from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import SCENES


@pytest.mark.parametrize("kind", SCENES.values(), ids=SCENES)
@pytest.mark.parametrize("again", [copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))])
def test_copies_of_scenes_cannot_be_changed_either(kind: type[Scene], again):
    scene = kind.example()
    found = again(scene)
    assert repr(found) == repr(scene)
    for field in fields(found):
        value = getattr(found, field.name)
        if isinstance(value, np.ndarray):
            assert not value.flags.writeable
            assert np.array_equal(value, getattr(scene, field.name))
