"""Every planted fault is disproved, at one random point, and named."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.claims.test_planted_faults import kind_in, planted, with_fault
from tests.faults import FAULTS, OWN, SHARED
from tests.mutants import PACKAGE, Mutant
from tests.samples import LINKS

from eomcheck.claims import CLAIMS, Finding
from eomcheck.claims.proof import prove_structure
from eomcheck.formulations import FORMULATIONS
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import Snake

SEED = 0

SINGULAR = "finite-terms", "a_1 is singular"
OTHERWISE = {
    "subtract_vectors(a.columns.get": SINGULAR,
    "x[i] for j, x in": SINGULAR,
    "cross(rates.alpha, along), ": ("constraint-drift", "constraint drift, row tip along y"),
}
"""Place of a fault -> (claim, what its Finding says), where a proof sees it otherwise."""


def expected(fault: Mutant) -> tuple[str, str]:
    """Return (claim, what its Finding says)."""
    if "nan" in fault.after:
        # A NaN is a double among the elements of a field.
        return "finite-terms", "unsupported operand"
    if fault.claim == "refusals":
        return "equivalence", f"[{Path(fault.file).stem}]"
    if fault.before in OTHERWISE:
        return OTHERWISE[fault.before]
    if fault.claim == "mass-matrix":
        # M is judged by M v at a random v: rows have names there, columns have not. Where the
        # energies are wrong it is M that differs from them.
        return "mass-matrix", "mass matrix, row "
    if fault.claim in ("constraint-jacobian", "constraint-velocity"):
        # a likewise, and b with it.
        return "constraint-jacobian", "constraint Jacobian, row "
    return fault.claim, fault.says


def structure(kind: type[Scene]) -> Scene:
    """Return a scene with everything that a kind can have."""
    return next(kind.structures(LINKS if kind.has_links else None))


def first_failure(scene: Scene, formulations: dict) -> Finding | None:
    """Look at one random point; return what fails first in the order of the claims."""
    chosen = tuple(f for f in formulations.values() if f.applies_to(scene))
    findings = prove_structure(scene, chosen, 1, SEED)
    order = list(CLAIMS)
    # What is no number cannot be looked at, and says so.
    failed = [finding for finding in findings if finding.verdict in ("failed", "skipped")]
    return min(failed, key=lambda finding: order.index(finding.claim), default=None)


@pytest.mark.sampled(35)
@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.id)
def test_a_planted_fault_is_disproved_and_named(fault: Mutant):
    with with_fault(fault) as (kind, formulations):
        scene = Snake.coil(LINKS) if kind is Snake else structure(kind)
        failure = first_failure(scene, formulations)
    assert failure is not None, "not disproved"
    claim, says = expected(fault)
    assert failure.claim == claim, str(failure)
    assert says in str(failure), str(failure)
    assert failure.detail
    assert failure.evidence.startswith(("disproved: ", "skipped"))


@pytest.mark.sampled(3)
@pytest.mark.parametrize("fault", [f for f in FAULTS if f.claim == "refusals"], ids=lambda f: f.id)
def test_a_matrix_made_singular_is_named_and_nothing_else_fails(fault: Mutant):
    with with_fault(fault) as (_, formulations):
        findings = prove_structure(Snake.coil(LINKS), tuple(formulations.values()), 1, SEED)
    (failure,) = (f for f in findings if f.verdict == "failed")
    assert failure.detail.endswith(" is singular at every state")
    matrix = failure.detail.removesuffix(" is singular at every state")
    assert f'"{matrix}"' in fault.planted()


def test_every_exception_is_about_a_fault_that_is_planted():
    assert OTHERWISE.keys() <= {fault.before for fault in FAULTS}


@pytest.mark.sampled(4)
@pytest.mark.parametrize("file", (*OWN, *SHARED))
def test_the_source_as_it_is_shows_no_fault(file: str):
    source = (PACKAGE / file).read_text(encoding="utf-8")
    with planted(file, source) as module:
        assert first_failure(structure(kind_in(module, file)), FORMULATIONS) is None
