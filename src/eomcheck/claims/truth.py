"""Claims about the true acceleration, enclosed in balls of as many digits as it takes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from eomcheck.claims.case import Case
from eomcheck.claims.finding import Finding
from eomcheck.claims.own import not_rational
from eomcheck.claims.registry import check, pairs
from eomcheck.errors import RefusedError
from eomcheck.evaluation.certified import (
    TRUE_DIGITS,
    TRUTH_WITHOUT_SPEEDS,
    Enclosure,
    certify,
    enclose,
    enclosure,
    true_state,
)
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.formulations import Formulation

EVIDENCE = f"enclosed: {TRUE_DIGITS} digits"


def _enclosed(
    case: Case, formulation: Formulation, known: dict[int, Quantities]
) -> Enclosure | Finding:
    """Return the enclosure, or that there is none; see `enclosure` for `known`."""
    at = case.at
    start, how = {"u": at.u}, (TRUE_DIGITS, at.partition_for(formulation, False))
    try:
        return enclosure(at.scene, formulation, at.q, start, at.t, *how, known)
    except (RefusedError, TypeError) as error:
        return _without_truth(case, formulation.key, error)


def _without_truth(case: Case, subject: str, error: Exception) -> Finding:
    """Return the Finding where there are no digits, or a function does not run on balls."""
    if isinstance(error, RefusedError):
        return case.finding(subject, 0.0, 0.0, "inconclusive", EVIDENCE, str(error))
    why = f"not rational: {error}"
    return case.finding(subject, 0.0, 0.0, "not looked at", EVIDENCE, why)


@check("enclosures", "true q̈ of one formulation = of another", "(7)-(23)", "acceleration")
def enclosures(case: Case) -> Iterator[Finding]:
    """The enclosures by all formulations have a point in common, pair by pair."""
    if not case.has_speeds or not np.isfinite(case.at.u).all():
        return
    if why := not_rational(case.at.scene):
        yield case.finding("all", 0.0, 0.0, "not looked at", EVIDENCE, why)
        return
    found: list[tuple[Formulation, Enclosure]] = []
    known: dict[int, Quantities] = {}
    for f in case.solved:
        x = _enclosed(case, f, known)
        if isinstance(x, Finding):
            yield x
        else:
            found.append((f, x))
    kept = {f: case.at.partition_for(f, False).redundant is None for f, _ in found}
    for (f, x), (g, y) in pairs(found):
        if kept[f] != kept[g]:
            continue  # of fewer rows, which rounding cannot tell from all, another truth follows
        apart = np.flatnonzero(~x.overlaps(y))
        rows = ", ".join(case.at.scene.coordinate_names[i] for i in apart)
        detail = f"acceleration, row {rows}: the balls are disjoint" if apart.size else ""
        verdict = "failed" if apart.size else "passed"
        outcome = float(apart.size), 0.0, verdict, EVIDENCE, detail
        yield case.finding(f"{f.key} ~ {g.key}", *outcome)


@check("true-error", "|q̈ - true q̈| ≤ its error bound", "(7)-(23)", "rounding error")
def true_errors(case: Case) -> Iterator[Finding]:
    """The error in doubles, against the enclosed truth, is what rounding explains."""
    here = case.at
    if case.has_speeds and not np.isfinite(here.u).all():
        return
    if why := not_rational(here.scene):
        yield case.finding("all", 0.0, 0.0, "not looked at", EVIDENCE, why)
        return
    try:
        if case.has_speeds:
            truth, at = true_state(here.scene, here.q, here.u, here.t)
        else:
            how = {"t": here.t, "digits": TRUE_DIGITS, "v": here.v}
            truth, at = enclose(here.scene, TRUTH_WITHOUT_SPEEDS, here.q, **how), here
    except (RefusedError, TypeError) as error:
        yield _without_truth(case, "all", error)
        return
    true = Case(at, case.formulations, (), case.claim)
    for formulation in true.solved:
        sensitivity = true.vdot_sensitivity(formulation)
        try:
            found = certify(formulation, truth, at, sensitivity=sensitivity)
        except RefusedError as error:
            yield _without_truth(case, formulation.key, error)
            continue
        both, names = (found.vdot, found.truth.doubles()), (here.scene.coordinate_names,)
        judged = true.compare(formulation.key, *both, sensitivity, names=names, evidence=EVIDENCE)
        yield replace(judged, digits=found.digits, state=case.state)
