"""Findings about one engine, in one state of a scene."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from tests.samples import random_state

from eomcheck import check_state
from eomcheck.claims.finding import Finding
from eomcheck.engines import Engine
from eomcheck.lab.fuzzing.screening import keys_in_subject
from eomcheck.mechanics.scene import Scene


def own_findings(
    kind: type[Engine], scene: Scene, claims: Iterable[str] = (), seed: int = 1
) -> list[Finding]:
    """Return the findings of claims, by default of all, about an engine in a random state."""
    state = random_state(scene, np.random.default_rng(seed))
    found = check_state(scene, *state, engines=[kind], claims=sorted(claims) or None)
    return [one for one in found if keys_in_subject(one.subject, [kind.key])]


def verdicts(
    kind: type[Engine], scene: Scene, claims: Iterable[str] = (), seed: int = 1
) -> dict[str, str]:
    """Return claim -> verdict of `own_findings`, "failed" if one of several is."""
    found = own_findings(kind, scene, claims, seed)
    return {x.claim: x.verdict for x in sorted(found, key=lambda x: x.verdict == "failed")}


def failed(found: Iterable[Finding]) -> list[str]:
    """Return the findings that failed, as text."""
    return [str(one) for one in found if one.verdict == "failed"]


def passed(found: Iterable[Finding]) -> set[str]:
    """Return the claims of findings that passed."""
    return {one.claim for one in found if one.verdict == "passed"}
