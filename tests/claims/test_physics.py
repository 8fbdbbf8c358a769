"""What the power balance is told of all copies at once is what each of them says."""

from __future__ import annotations

import numpy as np
import pytest

from eomcheck.claims.physics import _Rates
from eomcheck.claims.strata import state_cases
from eomcheck.evaluation.doubles import Evaluation
from eomcheck.evaluation.perturbed import perturbed_copies
from eomcheck.formulations import FORMULATIONS
from eomcheck.scenes import SCENES


@pytest.mark.parametrize("key", SCENES)
def test_energies_and_bodies_of_all_copies_change_as_those_of_each(key: str):
    scene, state = next(iter(state_cases(SCENES[key].example(), 1, 0)))
    copies = perturbed_copies(Evaluation(scene, *state))
    together, im = copies[0].together, FORMULATIONS["im"]

    def found(e):
        rates, vdot = _Rates(e), e.acceleration(im).vdot
        with e.computing("it"):
            return np.array(rates.power(vdot)), rates.bodies(vdot)

    power, bodies = found(together)
    assert power.shape == (2, len(copies))
    for i, copy in enumerate(copies):
        of_one = found(copy)
        assert np.array_equal(power[:, i], of_one[0])
        assert np.array_equal(bodies[i], of_one[1])
