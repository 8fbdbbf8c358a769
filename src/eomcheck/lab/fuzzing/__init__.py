"""Fuzzing at scale: states drawn and hill-climbed, screened in batches, then fully checked.

A `Campaign` runs rounds, one structural variant each; a round is determined by the seed and its
number, and by the highest scores of earlier rounds of that variant. `screening` computes all claims
for a batch of states and picks the suspects; `triage` judges them by `eomcheck.check_state` and
names the part at fault; `failures` shrinks and stores the counterexamples; `replay` checks stored
ones again.
"""
