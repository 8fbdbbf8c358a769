"""Random mechanisms are those that their seeds drew when somebody last read them."""

from __future__ import annotations

import json

import pytest
from tests.scenes.draws import DRAWN, STORED

KEPT = json.loads(STORED.read_text(encoding="utf-8"))


@pytest.mark.parametrize("kind", DRAWN)
def test_a_seed_draws_the_same_mechanisms_as_ever(kind: str):
    found = DRAWN[kind]()
    assert list(found) == list(KEPT[kind])
    for name, lines in found.items():
        assert lines == KEPT[kind][name], name
