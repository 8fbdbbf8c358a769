"""The studies, one line each: their commands, sections and lines of documentation follow."""

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
}
"""Key -> what it does. A study of key a-b is STUDY of the module a_b, imported when it is asked
for."""


def study_of(key: str) -> Study:
    """Return the study of a key.

    Raises:
        UnknownNameError: there is none.
    """
    if key not in STUDIES:
        raise UnknownNameError("study", key, STUDIES)
    return import_module(f"{__name__}.{key.replace('-', '_')}").STUDY
