"""Fuzzing at scale: states drawn and climbed to in lanes, and judged by `eomcheck.check`.

A `Campaign` goes through rounds, one structure each; what a round looks like is decided by the seed
and its number, and by what earlier rounds of that structure found. `screening` computes all claims
in lanes and says what to look at again; `judging` does that; `finds` keeps what fails.
"""
