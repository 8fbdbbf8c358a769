"""What the paper claims, and what the Records of the study say to it.

A claim is a number of comparisons. It holds where all of them come out as the paper says, partly
where at least half of them do. A difference below a factor of `CLEAR` is none: a change of the
tolerance or another machine makes as much.
"""

from __future__ import annotations

# In this order the claims register.
from eomcheck.lab.studies.paper.claims import equations, errors, cpu_time  # isort: skip
from eomcheck.lab.studies.paper.claims.claim import judgements

__all__ = ["cpu_time", "equations", "errors", "judgements"]
