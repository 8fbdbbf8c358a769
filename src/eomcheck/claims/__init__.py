"""Claims about scenes: each file registers its claims in `CLAIMS`, each once, by both its sides.

`run` checks them in float64 at sampled states; `proof` tests them in finite fields, for all states
at once.
"""

from __future__ import annotations

from eomcheck.claims import single_terms, positions, speeds_and_chains  # isort: skip
from eomcheck.claims import accelerations, numerical_accuracy  # isort: skip
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
    "numerical_accuracy",
    "positions",
    "single_terms",
    "speeds_and_chains",
]
