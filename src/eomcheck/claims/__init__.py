"""What is claimed: each file registers its claims in `CLAIMS`, each once, by both its sides.

`run` judges them in doubles, at states; `proof` in finite fields, for all states at once.
"""

from __future__ import annotations

# In the order in which a failure is closest to its cause: single terms, then identities between
# them, then whole accelerations.
from eomcheck.claims import terms, positions, speeds, chain  # isort: skip
from eomcheck.claims import accelerations, redundant, physics, truth, refusals  # isort: skip
from eomcheck.claims.case import Case
from eomcheck.claims.finding import Finding, Proof, State
from eomcheck.claims.registry import CLAIMS, Claim

__all__ = [
    "CLAIMS",
    "Case",
    "Claim",
    "Finding",
    "Proof",
    "State",
    "accelerations",
    "chain",
    "physics",
    "positions",
    "redundant",
    "refusals",
    "speeds",
    "terms",
    "truth",
]
