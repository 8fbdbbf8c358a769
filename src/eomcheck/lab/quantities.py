"""The quantities that libraries are compared in: ours, theirs, and how far they are apart."""

from __future__ import annotations

import numpy as np

from eomcheck.engines import Answers, EngineFault
from eomcheck.engines.files import FileEngine
from eomcheck.evaluation.doubles import Evaluation
from eomcheck.evaluation.tolerance import largest
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.comparison import Comparison
from eomcheck.lab.parting import Why
from eomcheck.numbers.contract import Array

QUANTITIES = {
    "M": "mass_matrix",
    "bias": "bias",
    "gravity": "forces",
    "forces": "forces",
    "q̈": "acceleration",
}
"""What is compared -> what an engine is asked; gravity is what forces are at rest."""


def ours_at(at: Evaluation) -> dict[str, Array]:
    """Return what we say."""
    rest = Evaluation(at.scene, at.q, np.zeros(at.scene.n), at.t)
    vdot = at.acceleration(FORMULATIONS["gw"]).vdot
    terms = at.terms.M, at.terms.B, rest.terms.Q, at.terms.Q, vdot
    zero = np.zeros(at.scene.n)
    said = (zero if one is None else one for one in terms)
    return dict(zip(QUANTITIES, said, strict=True))


def theirs_at(found: Comparison, key: str, engine: FileEngine, at: Evaluation) -> dict[str, Array]:
    """Return what a library says, and keep what it does instead of an answer."""
    answers, (q, v, t), zero = Answers(engine), (at.q, at.v, at.t), np.zeros(at.scene.n)
    arguments = {
        "M": (q, t),
        "bias": (q, v, t),
        "gravity": (q, zero, t),
        "forces": (q, v, t),
        "q̈": (q, v, zero, at.terms.a, at.terms.gamma, t),
    }
    told = {}
    for name, method in QUANTITIES.items():
        try:
            answer = answers.ask(method, *arguments[name])
        except EngineFault as fault:
            if (key, name) not in found.faults:
                found.faults[key, name] = fault.what
                found.why[key].append(Why(f"gives no {name}: {fault.what}", f"no {name}"))
        else:
            told[name] = answer.vdot if name == "q̈" else answer
    return told


def apart(x: Array | None, y: Array | None) -> float:
    """Return the largest difference over the largest entry, NaN where one is not known."""
    if x is None or y is None:
        return np.nan
    scale = max(largest(x), largest(y))
    return largest(x - y) / scale if scale > 0 else 0.0
