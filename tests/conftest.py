"""An option of the tests: motions by every formulation, or by one for each kind of state."""

from __future__ import annotations

import pytest

from eomcheck.formulations import applicable
from eomcheck.model import Scene
from eomcheck.scenes import SCENES

MOVERS = {"au", "em", "kane"}
"""One for each state that an integration carries, if not for every formulation. All are the same
source for every scene and are compiled for the snake anyway; compiling each for each scene is what
takes long."""


def movers(kind: type[Scene], every: bool = False) -> list[str]:
    """Return the formulations that move scenes of a kind in tests."""
    keys = [key for key in applicable(kind) if every or key in MOVERS]
    if not every and not kind.natural_speeds:
        # Its generalized speeds are the independent velocities that Em integrates.
        keys.remove("em")
    return keys


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.getgroup("eomcheck").addoption(
        "--all-movers", action="store_true", help="move every scene by every formulation"
    )


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Give `mover` the formulations of the module's SCENE_KIND, `moved` those of every kind."""
    every = metafunc.config.getoption("--all-movers")
    if "mover" in metafunc.fixturenames:
        metafunc.parametrize("mover", movers(metafunc.module.SCENE_KIND, every))
    if "moved" in metafunc.fixturenames:
        moved = [(kind, key) for kind in SCENES.values() for key in movers(kind, every)]
        metafunc.parametrize("moved", moved, ids=[f"{kind.key}-{key}" for kind, key in moved])
