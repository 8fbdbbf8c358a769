"""`eomcheck.quantity`: values by their definitions, and one clear sentence about every mistake."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from tests.samples import ordinary

import eomcheck
from eomcheck.errors import InputError, UnknownNameError
from eomcheck.evaluation.conformance import QUANTITIES
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.scenes import SCENES, ChainPendulum, RollingDisk, Snake

ARM = ChainPendulum(np.array([1.0, 2.0]), np.array([1.0, 0.5]), np.array([0.1, 0.2]), 9.81)
Q, V = [0.3, -0.4], [1.0, 0.5]


@pytest.mark.parametrize(
    ("call", "kind", "message"),
    [
        (
            lambda: eomcheck.quantity(ARM, "momentun", Q),
            UnknownNameError,
            "unknown quantity 'momentun' (did you mean 'momentum'?); known: inverse_dynamics, ",
        ),
        (
            lambda: eomcheck.quantity(ARM, "frame_bias", Q),
            InputError,
            "frame = None: frame_bias needs the name of a link: 'ground', 'link 1', 'link 2'",
        ),
        (
            lambda: eomcheck.quantity(ARM, "frame_bias", Q, V, frame="link 3"),
            UnknownNameError,
            "unknown frame 'link 3' (did you mean 'link 2'?); known: ground, link 1, link 2",
        ),
        (
            lambda: eomcheck.quantity(ARM, "momentum", Q, V, frame="link 1"),
            InputError,
            "frame = 'link 1': momentum belongs to no link",
        ),
        (
            lambda: eomcheck.quantity(ARM, "momentum", [0.3]),
            InputError,
            "q has shape (1,), expected (2,)",
        ),
        (
            lambda: eomcheck.quantity(ARM, "momentum", Q, [[1.0, 0.5]]),
            InputError,
            "v has shape (1, 2), expected (2,)",
        ),
        (
            lambda: eomcheck.quantity(ARM, "momentum_rate", Q, V, [1.0]),
            InputError,
            "vdot has shape (1,), expected (2,)",
        ),
        (
            lambda: eomcheck.quantity(ARM, "momentum_rate", Q, V, [1.0, np.nan]),
            InputError,
            "vdot[1] = nan, expected a finite number",
        ),
        (
            lambda: eomcheck.quantity(RollingDisk.example(), "momentum", np.zeros(5)),
            InputError,
            "rolling-disk has no tree of bodies: its `tree` returns None",
        ),
        (
            lambda: eomcheck.quantity("arm", "momentum", Q),  # type: ignore[arg-type]
            InputError,
            "scene = 'arm', expected a scene such as Snake.paper()",
        ),
    ],
    ids=lambda x: x[:30] if isinstance(x, str) else None,
)
def test_a_mistake_is_named_in_one_sentence(call: Callable, kind: type[Exception], message: str):
    with pytest.raises(kind) as raised:
        call()
    text = str(raised.value)
    assert text.startswith(message) and "\n" not in text


@pytest.mark.parametrize("name", QUANTITIES)
def test_every_quantity_is_a_float64_array_of_its_shape(name: str):
    one, frame = QUANTITIES[name], "link 2" if QUANTITIES[name].of_frame else None
    value = eomcheck.quantity(ARM, name, Q, V, [0.2, -0.3], frame=frame)
    assert value.dtype == np.float64
    sizes: dict[int | str, int | str] = {"n": 2, "2n": 4, "3n": 6, "r": 0, "p": 20}
    assert value.shape == tuple(sizes.get(size, size) for size in one.shape)


@pytest.mark.parametrize("key", [key for key in SCENES if SCENES[key].example().tree() is not None])
def test_inverse_and_forward_dynamics_have_all_forces_of_the_scene(key: str):
    scene, state = ordinary(SCENES[key])
    at = Evaluation(scene, *state)
    vdot = np.cos(np.arange(scene.n))
    force = at.terms.M @ vdot - at.F
    value = eomcheck.quantity(scene, "inverse_dynamics", *state[:2], vdot, t=state.t)
    assert np.array_equal(value, force)
    free = eomcheck.quantity(scene, "forward_dynamics", *state[:2], t=state.t)
    assert np.allclose(at.terms.M @ free, at.F, rtol=0, atol=1e-9 * np.abs(at.F).max())


def test_velocities_and_accelerations_that_are_not_given_are_0():
    snake, state = ordinary(Snake)
    for name in ("momentum", "kinetic_energy"):
        assert not eomcheck.quantity(snake, name, state.q).any()
    bias = eomcheck.quantity(snake, "frame_bias", *state[:2], frame="link 2")
    value = eomcheck.quantity(snake, "frame_acceleration", *state[:2], frame="link 2")
    assert bias.any() and np.array_equal(value, bias)


def test_the_center_of_mass_of_one_arm_is_where_it_is():
    arm = ChainPendulum(np.array([3.0]), np.array([2.0]), np.array([0.1]), 9.81)
    angle, speed = 0.4, 1.5
    center = eomcheck.quantity(arm, "center_of_mass", [angle])
    assert np.allclose(center, [np.cos(angle), np.sin(angle), 0.0], rtol=1e-15)
    momentum = eomcheck.quantity(arm, "momentum", [angle], [speed])
    linear = 3.0 * speed * np.array([-np.sin(angle), np.cos(angle), 0.0])
    assert np.allclose(momentum, [*linear, 0.0, 0.0, 0.1 * speed], rtol=1e-14)
