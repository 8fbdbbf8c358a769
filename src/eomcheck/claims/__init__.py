"""Claims about scenes: statements that hold for correct equations of motion, such as M = ∂²T/∂q̇².

Each module registers its claims in `CLAIMS`. A claim is written once, as a function that yields
both sides of an equation, and evaluated in two ways: `run` compares the sides in float64 at sampled
states, `proof` tests them in finite fields (polynomial identity testing), for all states at once.
"""

from __future__ import annotations

from eomcheck.claims import terms_and_positions, speeds_and_chains  # isort: skip
from eomcheck.claims import bodies_and_frames, engine_quantities  # isort: skip
from eomcheck.claims import accelerations, formulation_derivatives  # isort: skip
from eomcheck.claims import numerical_accuracy  # isort: skip
from eomcheck.claims.case import Case
from eomcheck.claims.finding import Finding, Proof, State
from eomcheck.claims.registry import CLAIMS, Claim

# In the order in which a failure is closest to its cause: single terms, then identities between
# them, then whole accelerations.

__all__ = [
    "CLAIMS",
    "Case",
    "Claim",
    "Finding",
    "Proof",
    "State",
    "accelerations",
    "bodies_and_frames",
    "engine_quantities",
    "formulation_derivatives",
    "numerical_accuracy",
    "speeds_and_chains",
    "terms_and_positions",
]
