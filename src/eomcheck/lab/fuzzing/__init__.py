"""Fuzzing at scale: states drawn and hill-climbed, screened in batches, then fully checked.

A `Campaign` goes through rounds, one structure each; a round is determined by the seed and its
number, and by the highest scores of earlier rounds of that structure. `screening` computes all
claims for a batch of states and picks the suspects; `triage` judges them by `eomcheck.check_state`
and tells which part is at fault; `failed_findings` shrinks and stores those that fail; `replay`
checks stored ones again.
"""
