"""The claim about machine code: what motions run on says what the public path says."""

from __future__ import annotations

from collections.abc import Iterator

from eomcheck.arithmetic.generic import NotRationalError
from eomcheck.checks.claim import Case, claim
from eomcheck.checks.finding import Finding
from eomcheck.motion.right_hand_side import acceleration_in_machine_code

FEW = 5
"""Coordinates of scenes for which machine code is made beside the example of a kind: it takes as
long as hundreds of states."""


@claim("machine-code", "q̈ in machine code = q̈ of the public path", "(7)-(23)", "machine code")
def machine_code(case: Case) -> Iterator[Finding]:
    """Each formulation gives the same acceleration in machine code."""
    scene = case.at.scene
    if scene.n > FEW and scene.structure != type(scene).example().structure:
        return
    for formulation in case.solved:
        try:
            found = acceleration_in_machine_code(case.at, formulation)
        except NotRationalError:  # the scene's functions cannot be traced: there is none
            continue
        public = case.at.acceleration(formulation).vdot
        yield case.compare(formulation.key, found, public, 2 * case.vdot_spread(formulation))
