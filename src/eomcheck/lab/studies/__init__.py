"""Registry of the studies, one line each, from which commands, sections and documentation
follow.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from eomcheck.errors import UnknownNameError

if TYPE_CHECKING:
    from eomcheck.lab.study import Study

STUDIES: dict[str, str] = {
    "work-precision": "Measure error against run time: formulations, integrators and tolerances.",
    "stability": "Drive every formulation through states of growing severity, and certify what it "
    "delivers.",
    "stiff": "Compare explicit and implicit integrators on joints that are stiff, damped and not.",
    "long-run": "Measure how constraint and energy errors grow in 1 000 s, stabilized and not.",
    "paper": "Repeat the paper's simulations, Table I and Figs. 2 to 7, and judge its claims by "
    "them.",
    "operations": "Count the operations of one right-hand side, exactly, for every number of "
    "links.",
    "accuracy": "Certify how many digits each formulation delivers in doubles, against ball "
    "arithmetic.",
    "engines": "Ask every engine at random states, and measure how far it is from the scenes' own.",
    "conformance": "Compare each quantity of each library, on robots and scenes, and count its "
    "true digits.",
    "robots": "Check and prove robot descriptions, and compare how libraries read them.",
    "robot-files": "Count the robot files of packages that are read, and why others are refused.",
    "robot-pairs": "Compare the URDF of a robot in one package with its MJCF in another.",
    "agreement": "Compare the formulations on random snakes, beside a fault.",
    "rhs": "Time one right-hand side of each formulation, over the number of links where there is "
    "one.",
    "differentiation": "Time derivatives of the acceleration, beside those of Pinocchio.",
    "motion": "Time a motion, by default of the paper's robot, in machine code and through Python.",
    "tolerance": "Measure observed / (κ ε scale) per claim: what the constant C of the tolerances "
    "rests on.",
}
"""Key -> description. A study of key a-b is STUDY of the module a_b, imported on demand."""

BENCHMARKS = ("rhs", "differentiation", "motion", "tolerance")
"""Keys of the commands of `eomcheck bench`, not of `eomcheck study`."""
DRAWN = ("accuracy", "agreement")
"""Keys of the studies with a figure by `eomcheck draw`."""


def study_of(key: str) -> Study:
    """Return the study of a key.

    Raises:
        UnknownNameError: there is none.
    """
    if key not in STUDIES:
        raise UnknownNameError("study", key, STUDIES)
    return import_module(f"{__name__}.{key.replace('-', '_')}").STUDY
