"""Power balances of all copies at once are those of each; invariance in what does not refuse."""

from __future__ import annotations

import numpy as np
import pytest
from tests.evaluation.test_sensitivity import one_alone

import eomcheck
from eomcheck.claims.accelerations import _Rates
from eomcheck.draws.pairwise_design import state_cases
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import perturbed_samples
from eomcheck.formulations import FORMULATIONS
from eomcheck.numbers.batch_arrays import as_float64
from eomcheck.numbers.noise import SAMPLES, Noise
from eomcheck.scenes import SCENES, Snake


@pytest.mark.parametrize("key", SCENES)
def test_energies_and_bodies_of_all_copies_change_as_those_of_each(key: str, monkeypatch):
    scene, state = next(iter(state_cases(SCENES[key].example(), 1, 0)))
    at, im = Evaluation(scene, *state), FORMULATIONS["im"]
    at.acceleration(im)

    def found(e):
        rates, vdot = _Rates(e), e.acceleration(im).vdot
        with e.computing("it"):
            return as_float64(rates.power(vdot)), rates.bodies(vdot)

    power, bodies = found(perturbed_samples(at))
    assert power.shape == (2,) and power.count == SAMPLES + 1
    for i in range(SAMPLES):
        of_one = found(one_alone(at, Noise(i), monkeypatch))
        assert np.array_equal(power.data[i], of_one[0].data[0])
        assert np.array_equal(bodies.data[i], of_one[1].data[0])


def test_where_one_formulation_refuses_the_turned_scene_the_others_are_compared():
    """Turned by 0.75 rad the one wheel rolls along x, where El and Em have to refuse."""
    scene, q = Snake([1.0], [1.0], [0.1], None, [0.0]), np.array([0.3, 0.2, -0.75])
    v = eomcheck.velocity(scene, q, [1.0, 0.5])
    found = eomcheck.check_state(scene, q, v, engines=[], claims=["invariance"])
    moved: dict[str, set[str]] = {}
    refused = {one.subject for one in found if one.verdict == "skipped"}
    assert refused == {"rotation: el", "rotation: em"}
    for one in found:
        if one.subject in refused:
            assert one.detail.startswith("refused after that: "), str(one)
            continue
        assert one.verdict == "passed", str(one)
        name, _, key = one.subject.partition(": ")
        moved.setdefault(name, set()).add(key)
    assert moved["translation"] == moved["mirror"] == set(FORMULATIONS)
    assert moved["rotation"] == set(FORMULATIONS) - {"el", "em"}
