"""Motions by every formulation that applies, and machine code kept for one module only."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from tests import machine_code

from eomcheck.formulations import applicable
from eomcheck.motion import right_hand_side
from eomcheck.scenes import SCENES


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Give `mover` the formulations of the module's SCENE_KIND, `moved` those of every kind."""
    if "mover" in metafunc.fixturenames:
        metafunc.parametrize("mover", applicable(metafunc.module.SCENE_KIND))
    if "moved" in metafunc.fixturenames:
        moved = [(kind, key) for kind in SCENES.values() for key in applicable(kind)]
        metafunc.parametrize("moved", moved, ids=[f"{kind.key}-{key}" for kind, key in moved])


@pytest.fixture(scope="module", autouse=True)
def forgotten_kernels() -> Iterator[None]:
    """Forget machine code after each module: of all tests it would be a gigabyte."""
    yield
    right_hand_side._kernels.clear()
    machine_code._kept.clear()
