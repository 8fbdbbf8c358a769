"""The quantities that libraries are compared in: ours, theirs, and how far they are apart."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from eomcheck.engines import Answers, EngineFault
from eomcheck.engines.answers import inertia_size, weight_size
from eomcheck.engines.files import FileEngine
from eomcheck.errors import RefusedError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import largest
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.comparison import Comparison
from eomcheck.lab.parting import Why, scale_of
from eomcheck.numbers.generic import Array

QUANTITIES = {
    "M": "mass_matrix",
    "bias": "bias",
    "gravity": "forces",
    "forces": "forces",
    "q̈": "acceleration",
}
"""What is compared -> what an engine is asked; gravity is what forces are at rest."""


def ours_at(found: Comparison, at: Evaluation) -> dict[str, Array]:
    """Return our quantities, without q̈ where it is refused; the reason is kept.

    Constraints that depend on each other, or a singular M, leave M, bias and forces to compare.
    """
    rest = Evaluation(at.scene, at.q, np.zeros(at.scene.n), at.t)
    terms = at.terms.M, at.terms.B, rest.terms.Q, at.terms.Q
    zero = np.zeros(at.scene.n)
    ours = {
        name: zero if one is None else one for name, one in zip(QUANTITIES, terms, strict=False)
    }
    try:
        ours["q̈"] = at.acceleration(FORMULATIONS["gw"]).vdot
    except RefusedError as refusal:
        found.skipped.append(str(refusal))
    return ours


def summed_at(at: Evaluation) -> dict[str, float]:
    """Return the size of the terms that a library may sum to each quantity.

    0 of M and of q̈, for which the entries themselves count.
    """
    B, Q = inertia_size(at), at.kept(weight_size)
    return dict(zip(QUANTITIES, (0.0, B, Q, Q, 0.0), strict=True))


def theirs_at(
    found: Comparison, key: str, engine: FileEngine, at: Evaluation, names: Iterable[str]
) -> dict[str, Array]:
    """Answers of a library by quantity; its faults are kept in `found`."""
    answers, (q, v, t), zero = Answers(engine), (at.q, at.v, at.t), np.zeros(at.scene.n)
    arguments = {
        "M": (q, t),
        "bias": (q, v, t),
        "gravity": (q, zero, t),
        "forces": (q, v, t),
        "q̈": (q, v, zero, at.terms.a, at.terms.gamma, t),
    }
    told = {}
    for name in names:
        try:
            answer = answers.ask(QUANTITIES[name], *arguments[name])
        except EngineFault as fault:
            if (key, name) not in found.faults:
                found.faults[key, name] = fault.what
                found.why[key].append(Why(f"gives no {name}: {fault.what}", f"no {name}"))
        else:
            told[name] = answer.vdot if name == "q̈" else answer
    return told


def apart(x: Array | None, y: Array | None, summed: float = 0.0) -> float:
    """Return the largest difference, relative; see `scale_of`. NaN where one is not known."""
    if x is None or y is None:
        return np.nan
    scale = scale_of(max(largest(x), largest(y)), summed)
    return largest(x - y) / scale if scale > 0 else 0.0
