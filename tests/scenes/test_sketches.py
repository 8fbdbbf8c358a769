"""Every part of the picture of a scene is where it was when somebody last looked at it."""

from __future__ import annotations

import json

import pytest
from tests.scenes.sketches import STORED, sketched

from eomcheck.scenes import SCENES

KEPT = json.loads(STORED.read_text(encoding="utf-8"))


def test_pictures_of_all_scenes_are_kept():
    assert list(KEPT) == list(SCENES)


@pytest.mark.parametrize("key", SCENES)
def test_a_picture_of_a_scene_is_made_of_these_parts(key: str):
    assert sketched(key) == KEPT[key]
