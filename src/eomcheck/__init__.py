"""eomcheck: tests of equations of motion of multibody systems.

Claims about a scene (energies, constraints, accelerations by several formulations) are checked in
float64 against rounding bounds by perturbation analysis, and proved by polynomial identity testing.
Public names are loaded lazily: importing the package imports no engine, no compiler and no
plotting.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from eomcheck import deprecated

__version__ = "0.3.0"

if TYPE_CHECKING:
    from eomcheck import scenes, strategies, testing
    from eomcheck.calls import time_limit
    from eomcheck.claims import CLAIMS, Claim, Finding, Proof
    from eomcheck.claims.findings import Findings
    from eomcheck.claims.proof import prove
    from eomcheck.claims.run import check_state, validate
    from eomcheck.engines import ENGINES, Engine
    from eomcheck.errors import (
        EngineError,
        EomcheckError,
        InconsistentVelocityError,
        InputError,
        RefusedError,
        UnknownNameError,
    )
    from eomcheck.evaluation.certified import (
        Accuracy,
        EnclosedDerivatives,
        Enclosure,
        accuracy,
        enclose,
        enclose_derivatives,
    )
    from eomcheck.evaluation.conformance import quantity
    from eomcheck.evaluation.derivatives import Derivatives, derivatives
    from eomcheck.evaluation.dynamics import (
        ConstraintRank,
        acceleration,
        independent_constraints,
        speeds_of,
        velocity,
    )
    from eomcheck.evaluation.evaluation import Acceleration
    from eomcheck.formulations import FORMULATIONS, Formulation
    from eomcheck.mechanics.subset import with_constraints
    from eomcheck.motion.batch import Trajectories, simulate_many
    from eomcheck.motion.compiled_derivatives import compile_derivatives
    from eomcheck.motion.integrators import INTEGRATORS
    from eomcheck.motion.simulate import Trajectory, simulate
    from eomcheck.scenes import SCENES
    from eomcheck.testing.function_checks import check

_HOME = {
    "acceleration": "evaluation.dynamics",
    "Acceleration": "evaluation.evaluation",
    "velocity": "evaluation.dynamics",
    "speeds_of": "evaluation.dynamics",
    "derivatives": "evaluation.derivatives",
    "Derivatives": "evaluation.derivatives",
    "compile_derivatives": "motion.compiled_derivatives",
    "enclose": "evaluation.certified",
    "Enclosure": "evaluation.certified",
    "enclose_derivatives": "evaluation.certified",
    "EnclosedDerivatives": "evaluation.certified",
    "independent_constraints": "evaluation.dynamics",
    "ConstraintRank": "evaluation.dynamics",
    "with_constraints": "mechanics.subset",
    "accuracy": "evaluation.certified",
    "Accuracy": "evaluation.certified",
    "quantity": "evaluation.conformance",
    "check": "testing.function_checks",
    "check_state": "claims.run",
    "validate": "claims.run",
    "prove": "claims.proof",
    "Proof": "claims",
    "Finding": "claims",
    "Findings": "claims.findings",
    "Claim": "claims",
    "CLAIMS": "claims",
    "ENGINES": "engines",
    "Engine": "engines",
    "FORMULATIONS": "formulations",
    "Formulation": "formulations",
    "SCENES": "scenes",
    "INTEGRATORS": "motion.integrators",
    "simulate": "motion.simulate",
    "Trajectory": "motion.simulate",
    "simulate_many": "motion.batch",
    "Trajectories": "motion.batch",
    "EomcheckError": "errors",
    "InputError": "errors",
    "UnknownNameError": "errors",
    "InconsistentVelocityError": "errors",
    "EngineError": "errors",
    "RefusedError": "errors",
    "time_limit": "calls",
}
_MODULES = ("scenes", "strategies", "testing")

deprecated.install()


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return importlib.import_module(f"eomcheck.{name}")
    if name in _HOME:
        return getattr(importlib.import_module(f"eomcheck.{_HOME[name]}"), name)
    return deprecated.renamed("eomcheck", name)


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
    "ConstraintRank",
    "Derivatives",
    "EnclosedDerivatives",
    "Enclosure",
    "Engine",
    "EngineError",
    "EomcheckError",
    "Finding",
    "Findings",
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
    "check_state",
    "compile_derivatives",
    "derivatives",
    "enclose",
    "enclose_derivatives",
    "independent_constraints",
    "prove",
    "quantity",
    "scenes",
    "simulate",
    "simulate_many",
    "speeds_of",
    "strategies",
    "testing",
    "time_limit",
    "validate",
    "velocity",
    "with_constraints",
]
