"""Whatever is handed to a public function: an answer, or one sentence of our own."""

from __future__ import annotations

import numpy as np
import pytest

import eomcheck
from eomcheck.errors import EomcheckError
from eomcheck.scenes import Snake

SCENE = Snake.coil(3)
Q, V = SCENE.initial_state()
U = [1.0, 0.5]
CHEAP = ["kinetic-energy"]

ODD = (
    None,
    "x",
    [],
    [[]],
    np.zeros((5, 1)),
    np.zeros((1, 5)),
    np.zeros(4),
    np.zeros((2, 5)),
    5,
    -1,
    np.nan,
    [1, [2]],
    [None] * 5,
    np.array(["a"] * 5),
    [True] * 5,
    np.full(5, np.inf),
    [10**400] * 5,
    [1j] * 5,
    {},
    set(),
    object(),
    np.ma.masked_array(np.zeros(5), [1, 0, 0, 0, 0]),
    np.zeros(5, dtype="datetime64[s]"),
    lambda: 0,
)

CALLS = {
    "acceleration scene": lambda x: eomcheck.acceleration(x, "au", Q, V),
    "acceleration key": lambda x: eomcheck.acceleration(SCENE, x, Q, V),
    "acceleration q": lambda x: eomcheck.acceleration(SCENE, "au", x, V),
    "acceleration v": lambda x: eomcheck.acceleration(SCENE, "au", Q, x),
    "acceleration t": lambda x: eomcheck.acceleration(SCENE, "au", Q, V, x),
    "velocity scene": lambda x: eomcheck.velocity(x, Q, U),
    "velocity q": lambda x: eomcheck.velocity(SCENE, x, U),
    "velocity u": lambda x: eomcheck.velocity(SCENE, Q, x),
    "velocity t": lambda x: eomcheck.velocity(SCENE, Q, U, x),
    "speeds_of scene": lambda x: eomcheck.speeds_of(x, Q, V),
    "speeds_of q": lambda x: eomcheck.speeds_of(SCENE, x, V),
    "speeds_of v": lambda x: eomcheck.speeds_of(SCENE, Q, x),
    "enclose scene": lambda x: eomcheck.enclose(x, "au", Q, U),
    "enclose q": lambda x: eomcheck.enclose(SCENE, "au", x, U),
    "enclose u": lambda x: eomcheck.enclose(SCENE, "au", Q, x),
    "enclose v": lambda x: eomcheck.enclose(SCENE, "au", Q, v=x),
    "enclose digits": lambda x: eomcheck.enclose(SCENE, "au", Q, U, 0.0, x),
    "accuracy scene": lambda x: eomcheck.accuracy(x, "au", Q, U),
    "accuracy q": lambda x: eomcheck.accuracy(SCENE, "au", x, U),
    "accuracy u": lambda x: eomcheck.accuracy(SCENE, "au", Q, x),
    "accuracy v": lambda x: eomcheck.accuracy(SCENE, "au", Q, v=x),
    "check scene": lambda x: eomcheck.check_state(x, Q, V, claims=CHEAP),
    "check q": lambda x: eomcheck.check_state(SCENE, x, V, claims=CHEAP),
    "check v": lambda x: eomcheck.check_state(SCENE, Q, x, claims=CHEAP),
    "check t": lambda x: eomcheck.check_state(SCENE, Q, V, x, claims=CHEAP),
    "check claims": lambda x: eomcheck.check_state(
        SCENE, Q, V, claims=CHEAP if x is None else x, engines=[]
    ),
    "check formulations": lambda x: eomcheck.check_state(SCENE, Q, V, formulations=x, claims=CHEAP),
    "check engines": lambda x: eomcheck.check_state(SCENE, Q, V, engines=x, claims=CHEAP),
    "validate scene": lambda x: eomcheck.validate(x, examples=1, claims=CHEAP),
    "validate examples": lambda x: eomcheck.validate(SCENE, examples=x, claims=CHEAP),
    "validate seed": lambda x: eomcheck.validate(SCENE, examples=1, seed=x, claims=CHEAP),
    "simulate scene": lambda x: eomcheck.simulate(x, "kane", 0.01),
    "simulate t_end": lambda x: eomcheck.simulate(SCENE, "kane", x),
    "simulate q0": lambda x: eomcheck.simulate(SCENE, "kane", 0.01, q0=x),
    "simulate v0": lambda x: eomcheck.simulate(SCENE, "kane", 0.01, v0=x),
    "simulate u0": lambda x: eomcheck.simulate(SCENE, "kane", 0.01, u0=x),
    "simulate output_times": lambda x: eomcheck.simulate(SCENE, "kane", 0.01, output_times=x),
    "simulate rtol": lambda x: eomcheck.simulate(SCENE, "kane", 0.01, rtol=x),
    "simulate first_step": lambda x: eomcheck.simulate(SCENE, "kane", 0.01, first_step=x),
    "simulate max_steps": lambda x: eomcheck.simulate(SCENE, "kane", 0.01, max_steps=x),
    "prove scene": lambda x: eomcheck.prove(x, points=1),
    "prove points": lambda x: eomcheck.prove(SCENE, points=x),
    "Snake mass": lambda x: Snake(x, [1] * 3, [1] * 3, None, [0] * 3),
    "Snake stiffness": lambda x: Snake([1] * 3, [1] * 3, [1] * 3, x, [0] * 3),
    "Snake pose": lambda x: Snake([1] * 3, [1] * 3, [1] * 3, None, [0] * 3, x),
    "Snake.coil": Snake.coil,
}


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
@pytest.mark.sampled(3)
def test_odd_input_is_answered_or_refused_in_one_sentence(call):
    refused = 0
    for odd in ODD:
        if isinstance(odd, int) and odd == 5 and call is CALLS["prove points"]:
            continue  # that is a number of points
        try:
            call(odd)
        except EomcheckError as error:
            refused += 1
            assert len(str(error).splitlines()) == 1
    assert refused > 10
