"""Claims about the true acceleration, enclosed in balls of as many digits as it takes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from eomcheck.certified import TRUE_DIGITS, certify, true_state
from eomcheck.checks.claim import Case, claim, pairs
from eomcheck.checks.finding import Finding, State, Verdict
from eomcheck.enclosure import Enclosure, enclosure
from eomcheck.errors import RefusedError
from eomcheck.formulations import Formulation

EVIDENCE = f"enclosed: {TRUE_DIGITS} digits"


def _enclosed(case: Case, formulation: Formulation) -> Enclosure | None:
    at = case.at
    partition = at.partition
    try:
        return enclosure(at.scene, formulation, at.q, at.u, at.t, TRUE_DIGITS, partition)
    except RefusedError:
        return None


@claim("enclosures", "true q̈ of one formulation = of another", "(7)-(23)", "acceleration")
def enclosures(case: Case) -> Iterator[Finding]:
    """The enclosures by all formulations have a point in common, pair by pair."""
    if not case.has_speeds or not np.isfinite(case.at.u).all():
        return
    at = case.at
    found = tuple((f, x) for f in case.solved if (x := _enclosed(case, f)) is not None)
    for (f, x), (g, y) in pairs(found):
        apart = np.flatnonzero(~x.overlaps(y))
        rows = ", ".join(at.scene.coordinate_names[i] for i in apart)
        verdict: Verdict = "failed" if apart.size else "passed"
        yield Finding(
            "enclosures",
            f"{f.key} ~ {g.key}",
            at.scene,
            State(at.q, at.v, at.t),
            float(apart.size),
            0.0,
            verdict,
            EVIDENCE,
            f"acceleration, row {rows}: the balls are disjoint" if apart.size else "",
        )


@claim("true-error", "|q̈ - true q̈| ≤ its error bound", "(7)-(23)", "rounding error")
def true_errors(case: Case) -> Iterator[Finding]:
    """The error in doubles, against the enclosed truth, is what rounding explains."""
    here = case.at
    if not case.has_speeds or not np.isfinite(here.u).all():
        return
    try:
        truth, at = true_state(here.scene, here.q, here.u, here.t)
    except RefusedError:
        return
    true = Case(at, case.formulations, case.engines, case.claim)
    for formulation in true.solved:
        found = certify(formulation, truth, at)
        spread = true.vdot_spread(formulation)
        yield replace(
            true.compare(formulation.key, found.vdot, truth.doubles(), spread, evidence=EVIDENCE),
            digits=found.digits,
            state=State(here.q, here.v, here.t),
        )
