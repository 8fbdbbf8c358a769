"""Scenes made of descriptions against the equations that were written for them by hand."""

from __future__ import annotations

import json

import pytest
from tests.scenes.by_hand import STORED, given_by, looked_at

BY_HAND = json.loads(STORED.read_text(encoding="utf-8"))


@pytest.mark.parametrize("key", BY_HAND)
def test_a_description_gives_exactly_what_equations_by_hand_gave(key: str):
    scenes = looked_at(key)
    assert {name: given_by(scene) for name, scene in scenes.items()} == BY_HAND[key]
