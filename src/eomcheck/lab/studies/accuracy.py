"""What doubles deliver: certified errors of every formulation over random states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eomcheck import strategies
from eomcheck.console import progress
from eomcheck.errors import RefusedError
from eomcheck.evaluation.certified import Accuracy, accuracy, certify, relative_error, true_state
from eomcheck.evaluation.doubles import Evaluation
from eomcheck.evaluation.dynamics import speeds_of
from eomcheck.evaluation.enclosure import Enclosure
from eomcheck.evaluation.tolerance import UNDERFLOW, largest
from eomcheck.formulations import Formulation, applicable
from eomcheck.lab.draws import draw
from eomcheck.motion.observe import as_integrated
from eomcheck.motion.right_hand_side import acceleration_in_machine_code
from eomcheck.scenes import Snake


@dataclass(frozen=True)
class Delivered:
    """What one formulation delivered at one state.

    Attributes:
        key: the formulation.
        links: number of links.
        refused: what stood in the way, or None.
        digits: decimal digits of v̇ that are certainly right.
        relative: largest error over largest true entry.
        ulps: largest error of an entry in units in the last place.
        condition: largest condition number of a matrix solved.
        kappa: how strongly the computation amplifies relative changes.
        ratio: observed error / (κ ε scale), NaN where nothing is foreseen or nothing can be lost.
        of_bound: error over the error bound that the public path states; 0 where that is infinite.
        machine_of_bound: that of machine code over the same bound; NaN where it gives no number.
        state: the state as code, where either exceeds 1.
    """

    key: str
    links: int
    refused: str | None
    digits: float = 0.0
    relative: float = float("inf")
    ulps: float = float("inf")
    condition: float = float("inf")
    kappa: float = float("inf")
    ratio: float = float("nan")
    of_bound: float = 0.0
    machine_of_bound: float = 0.0
    state: str = ""


def measure_accuracy(
    min_links: int, max_links: int, examples: int, seed: int, hostile: bool = False
) -> list[Delivered]:
    """Return one Record per formulation and random state, ordinary or hostile."""
    if hostile:
        snakes = strategies.hostile_snakes(min_links, max_links)
        drawn = strategies.scene_states(snakes, strategies.hostile_states)
    else:
        drawn = strategies.scene_states(strategies.snakes(min_links, max_links))
    records, formulations = [], applicable(Snake).values()
    with progress("measuring", examples) as advance:
        for scene, (q, v, t) in draw(drawn, examples, seed):
            try:
                truth, at = true_state(scene, q, speeds_of(scene, q, v, t), t)
            except RefusedError as refusal:
                records += [Delivered(f.key, scene.r, refusal.what) for f in formulations]
            else:
                records += [_delivered(f, truth, at) for f in formulations]
            advance()
    return records


def _delivered(formulation: Formulation, truth: Enclosure, at: Evaluation) -> Delivered:
    key, links = formulation.key, at.scene.r
    try:
        found = certify(formulation, truth, at)
    except RefusedError as refusal:
        return Delivered(key, links, refusal.what)
    shares = found.relative / _bound(found), _of_machine_code(formulation, found, at)
    return Delivered(
        key,
        links,
        None,
        found.digits,
        found.relative,
        float(found.ulps.max()),
        max(found.condition.values()),
        found.kappa,
        found.ratio,
        *shares,
        f"{at.scene!r}, q = {at.q.tolist()}, u = {at.u.tolist()}" if max(shares) > 1 else "",
    )


def _bound(found: Accuracy) -> float:
    """Return the bound that the public path states, over the largest true entry."""
    least = UNDERFLOW / max(largest(found.truth.doubles()), UNDERFLOW)
    return max(found.relative_bound, least)


def _of_machine_code(formulation: Formulation, found: Accuracy, at: Evaluation) -> float:
    """Return the error of machine code over the bound of the public path for the same question."""
    same = as_integrated(at, formulation)
    if same is not at:
        try:
            found = accuracy(at.scene, formulation.key, at.q, t=at.t, v=same.v)
        except RefusedError:
            return float("nan")
    machine = acceleration_in_machine_code(same, formulation)
    if not np.isfinite(machine).all():
        return float("nan")
    return relative_error(machine, found.truth) / _bound(found)
