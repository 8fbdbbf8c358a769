"""How far apart the formulations are on random snakes, beside what rounding allows and a fault."""

from __future__ import annotations

from dataclasses import dataclass

from eomcheck import strategies
from eomcheck.console import progress
from eomcheck.errors import RefusedError
from eomcheck.evaluation.doubles import Evaluation
from eomcheck.evaluation.tolerance import allowed_error, largest
from eomcheck.formulations import FORMULATIONS, applicable
from eomcheck.lab.draws import draw

REFERENCE = "au"


@dataclass(frozen=True)
class Agreement:
    """Distance of one formulation from the reference at one state, relative to max |q̈|.

    `observed` is the distance, `allowed` what rounding allows of it. `faulty` is the distance of
    the reference itself when the sign of gamma is flipped.
    """

    key: str
    links: int
    observed: float
    allowed: float
    faulty: float


def measure_agreement(max_links: int = 40, per_size: int = 3, seed: int = 0) -> list[Agreement]:
    """Return the Records of `per_size` random snakes of each size from 1 to `max_links` links."""
    records: list[Agreement] = []
    with progress("comparing", max_links * per_size) as advance:
        for links in range(1, max_links + 1):
            snakes = strategies.scene_states(strategies.snakes(links, links))
            for scene, state in draw(snakes, per_size, seed):
                records.extend(_compare(Evaluation(scene, *state)))
                advance()
    return records


def _compare(at: Evaluation) -> list[Agreement]:
    reference = FORMULATIONS[REFERENCE]
    try:
        vdot = at.acceleration(reference).vdot
        spread = at.acceleration_spread(reference)
    except RefusedError:
        return []
    M, _, _, a, gamma, _ = at.terms
    flipped = reference.solution(M, at.F, a, -gamma, at.v, at.partition)[0]
    scale = largest(vdot)
    if scale == 0.0:
        return []
    records = []
    for key, formulation in applicable(at.scene).items():
        if key == REFERENCE:
            continue
        try:
            observed = largest(at.acceleration(formulation).vdot - vdot) / scale
            allowed = allowed_error(at.acceleration_spread(formulation) + spread) / scale
        except RefusedError:
            continue
        faulty = largest(flipped - vdot) / scale
        records.append(Agreement(key, at.scene.r, observed, allowed, faulty))
    return records
