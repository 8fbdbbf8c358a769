"""Identities of rational functions, proved for all parameters and states of N links at once."""

import pytest

import eomcheck
from eomcheck.scenes import Snake


@pytest.mark.sampled(6)
@pytest.mark.parametrize("links", [*range(1, 13), 20, 50, 100])
def test_every_identity_is_proved_with_4_points(links: int):
    findings = eomcheck.prove(Snake, links, points=4, seed=links)
    assert all(finding.verdict == "passed" for finding in findings), [
        str(finding) for finding in findings if finding.verdict != "passed"
    ]
    assert all(finding.evidence.startswith("proved") for finding in findings)
    assert sum(finding.proof.failure_probability for finding in findings) < 1e-40
    # Nothing was left out: every pair of formulations, and two with a second partition.
    pairs = {f.subject for f in findings if f.claim == "equivalence"}
    count = len(eomcheck.FORMULATIONS)
    assert len(pairs) == count * (count - 1) // 2 + 2
