"""MJX, where it is installed: its quantities are MuJoCo's in float64, and right in float32."""

from __future__ import annotations

import numpy as np
import pytest
from tests.samples import random_state

import eomcheck
from eomcheck.engines.mjx import Mjx64Engine, MjxEngine
from eomcheck.lab.fuzzing.screening import keys_in_subject
from eomcheck.scenes import ChainPendulum

pytest.importorskip("mujoco.mjx")


@pytest.mark.parametrize("kind", [MjxEngine, Mjx64Engine])
def test_every_quantity_that_it_offers_is_right(kind):
    scene = ChainPendulum.example()
    state = random_state(scene, np.random.default_rng(0))
    findings = eomcheck.check_state(scene, *state, engines=[kind])
    own = [one for one in findings if keys_in_subject(one.subject, [kind.key])]
    assert [str(one) for one in own if one.verdict == "failed"] == []
    passed = {one.claim for one in own if one.verdict == "passed"}
    assert {"mass-matrix", "bias", "engine-momentum", "engine-frame-jacobian"} <= passed
    assert {"engine-inverse-dynamics-derivatives"} <= passed
