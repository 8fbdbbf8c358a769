"""Checks: each file registers its claims in `CLAIMS`; each claim yields Findings."""

from __future__ import annotations

# In the order in which a failure is closest to its cause: single terms, then identities between
# them, then whole accelerations.
from eomcheck.claims import terms, identities, chain  # isort: skip
from eomcheck.claims import equivalence, machine_code, physics, truth, refusals  # isort: skip
from eomcheck.claims.claim import CLAIMS, Case, Claim
from eomcheck.claims.finding import Finding, Proof, State

__all__ = [
    "CLAIMS",
    "Case",
    "Claim",
    "Finding",
    "Proof",
    "State",
    "chain",
    "equivalence",
    "identities",
    "machine_code",
    "physics",
    "refusals",
    "terms",
    "truth",
]
