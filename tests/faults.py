"""Faults of scenes and formulations, planted without a copy: each must be caught, and named."""

from __future__ import annotations

from tests.mutants import Mutant, mutants

from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import SCENES, Andrews, ChainPendulum, Snake

FAULTS = [fault for fault in mutants() if fault.claim]

DESCRIBED = "descriptions/"
COMPOSED = "mechanics/derived_functions.py"
TREES = f"{DESCRIBED}tree_quantities.py"
"""File of functions of trees of bodies, which scenes do not call themselves."""
SHARED: dict[str, type[Scene]] = {
    COMPOSED: ChainPendulum,
    f"{DESCRIBED}constraint_rows.py": Andrews,
    f"{DESCRIBED}forces.py": ChainPendulum,
    f"{DESCRIBED}first_derivation.py": ChainPendulum,
    f"{DESCRIBED}second_derivation.py": ChainPendulum,
    TREES: ChainPendulum,
}
"""File of functions that many scenes call -> one of the scenes."""
OWN = {
    kind.__module__.removeprefix("eomcheck.").replace(".", "/") + ".py": kind
    for kind in SCENES.values()
}
"""File of each scene."""


def scene_of(fault: Mutant) -> type[Scene]:
    """Return the kind of scene that shows a fault; one of a formulation shows in a snake."""
    if fault.scene:
        return SCENES[fault.scene]
    return SHARED.get(fault.file) or OWN.get(fault.file, Snake)
