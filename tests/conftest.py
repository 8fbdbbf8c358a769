"""Motions by every formulation that applies."""

from __future__ import annotations

import pytest

from eomcheck.formulations import applicable
from eomcheck.scenes import SCENES


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Give `mover` the formulations of the module's SCENE_KIND, `moved` those of every kind."""
    if "mover" in metafunc.fixturenames:
        metafunc.parametrize("mover", applicable(metafunc.module.SCENE_KIND))
    if "moved" in metafunc.fixturenames:
        moved = [(kind, key) for kind in SCENES.values() for key in applicable(kind)]
        metafunc.parametrize("moved", moved, ids=[f"{kind.key}-{key}" for kind, key in moved])
