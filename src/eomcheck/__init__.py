"""eomcheck: gradcheck for equations of motion.

The public names are loaded when they are first used: importing the package imports no engine, no
compiler and no plotting.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

__version__ = "0.2.0"

if TYPE_CHECKING:
    from eomcheck import scenes, strategies, testing
    from eomcheck.claims import CLAIMS, Claim, Finding, Proof
    from eomcheck.claims.proof import prove
    from eomcheck.claims.run import check, validate
    from eomcheck.engines import ENGINES, Engine
    from eomcheck.errors import (
        EngineError,
        EomcheckError,
        InconsistentVelocityError,
        InputError,
        RefusedError,
        UnknownNameError,
    )
    from eomcheck.evaluation.certified import Accuracy, accuracy
    from eomcheck.evaluation.doubles import Acceleration
    from eomcheck.evaluation.dynamics import acceleration, speeds_of, velocity
    from eomcheck.evaluation.enclosure import Enclosure, enclose
    from eomcheck.evaluation.redundant import Dependence, independent_constraints
    from eomcheck.formulations import FORMULATIONS, Formulation
    from eomcheck.mechanics.subset import with_constraints
    from eomcheck.motion.integrators import INTEGRATORS
    from eomcheck.motion.many import Trajectories, simulate_many
    from eomcheck.motion.simulate import simulate
    from eomcheck.motion.trajectory import Trajectory
    from eomcheck.scenes import SCENES

_HOME = {
    "acceleration": "evaluation.dynamics",
    "Acceleration": "evaluation.doubles",
    "velocity": "evaluation.dynamics",
    "speeds_of": "evaluation.dynamics",
    "enclose": "evaluation.enclosure",
    "Enclosure": "evaluation.enclosure",
    "independent_constraints": "evaluation.redundant",
    "Dependence": "evaluation.redundant",
    "with_constraints": "mechanics.subset",
    "accuracy": "evaluation.certified",
    "Accuracy": "evaluation.certified",
    "check": "claims.run",
    "validate": "claims.run",
    "prove": "claims.proof",
    "Proof": "claims",
    "Finding": "claims",
    "Claim": "claims",
    "CLAIMS": "claims",
    "ENGINES": "engines",
    "Engine": "engines",
    "FORMULATIONS": "formulations",
    "Formulation": "formulations",
    "SCENES": "scenes",
    "INTEGRATORS": "motion.integrators",
    "simulate": "motion.simulate",
    "Trajectory": "motion.trajectory",
    "simulate_many": "motion.many",
    "Trajectories": "motion.many",
    "EomcheckError": "errors",
    "InputError": "errors",
    "UnknownNameError": "errors",
    "InconsistentVelocityError": "errors",
    "EngineError": "errors",
    "RefusedError": "errors",
}
_MODULES = ("scenes", "strategies", "testing")


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return importlib.import_module(f"eomcheck.{name}")
    if name in _HOME:
        return getattr(importlib.import_module(f"eomcheck.{_HOME[name]}"), name)
    raise AttributeError(f"module 'eomcheck' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*_HOME, *_MODULES, "__version__"])


__all__ = [
    "CLAIMS",
    "ENGINES",
    "FORMULATIONS",
    "INTEGRATORS",
    "SCENES",
    "Acceleration",
    "Accuracy",
    "Claim",
    "Dependence",
    "Enclosure",
    "Engine",
    "EngineError",
    "EomcheckError",
    "Finding",
    "Formulation",
    "InconsistentVelocityError",
    "InputError",
    "Proof",
    "RefusedError",
    "Trajectories",
    "Trajectory",
    "UnknownNameError",
    "acceleration",
    "accuracy",
    "check",
    "enclose",
    "independent_constraints",
    "prove",
    "scenes",
    "simulate",
    "simulate_many",
    "speeds_of",
    "strategies",
    "testing",
    "validate",
    "velocity",
    "with_constraints",
]
