"""`eomcheck.quantity`: values by their definitions, and one clear sentence about every mistake."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.engines.test_driven_pendulum import BOB
from tests.samples import ordinary

import eomcheck
from eomcheck.descriptions.build import mechanism
from eomcheck.descriptions.elements import Joint, Link
from eomcheck.engines.answers import weight_size
from eomcheck.errors import InputError, RefusedError, UnknownNameError
from eomcheck.evaluation.conformance import QUANTITIES, enclosed_quantity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.numbers.generic import Array
from eomcheck.scenes import SCENES, ChainPendulum, RollingDisk, Snake, from_urdf

CRANE = Path(__file__).parents[2] / "docs" / "guides" / "crane.urdf"

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
            lambda: eomcheck.quantity(ARM, "center_of_mass", Q, vdot=V),
            InputError,
            "vdot: center_of_mass does not depend on it, only on q",
        ),
        (
            lambda: eomcheck.quantity(ARM, "frame_bias", Q, tau=V, frame="link 1"),
            InputError,
            "tau: frame_bias does not depend on it, only on q, v",
        ),
        (
            lambda: eomcheck.quantity(ARM, "forward_dynamics", Q, V, [0.2, -0.3]),
            InputError,
            "vdot: forward_dynamics does not depend on it, only on q, v, tau",
        ),
        (
            lambda: eomcheck.quantity(ARM, "forward_dynamics", Q, V, tau=[1.0]),
            InputError,
            "tau has shape (1,), expected (2,)",
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
    options = {"v": V, "vdot": [0.2, -0.3], "tau": [0.1, 0.7]}
    more: Any = {x: value for x, value in options.items() if x in one.arguments}
    value = eomcheck.quantity(ARM, name, Q, **more, frame=frame)
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
    back = eomcheck.quantity(scene, "forward_dynamics", *state[:2], tau=force, t=state.t)
    assert np.allclose(back, vdot, rtol=0, atol=1e-9)


@pytest.mark.parametrize("t", [0.0, 0.6, 2.5])
def test_the_time_counts(t: float):
    length = 1.5 + 0.4 * np.sin(1.7 * t)  # of a cord that is hauled in and let out again
    swing = 2.0 * length * np.cos(0.7)
    M = np.array([[2.0, swing], [swing, 2.0 * length**2 + 0.3]])
    inverse = eomcheck.quantity(BOB, "inverse_mass_matrix", [0.1, 0.7], t=t)
    np.testing.assert_allclose(inverse @ M, np.eye(2), atol=1e-14)
    one, at = QUANTITIES["inverse_mass_matrix"], Evaluation(BOB, [0.1, 0.7], [0.0, 0.0], t)
    np.testing.assert_allclose(enclosed_quantity(at, one, "", at.v), inverse, rtol=1e-14)


# ---- Derivatives ---------------------------------------------------------------------------------

STEP = 2.0**-11

Free = mechanism(
    "Free",
    [Link("ground"), *(Link(x, 1.0, (0.5, 0.1, 0.2), (0.7, 0.8, 0.9)) for x in ("base", "arm"))],
    [
        Joint("base", "floating", "ground", "base"),
        Joint("arm", "revolute", "base", "arm", (1.0, 0.0, 0.0), stiffness=3.0, damping=0.4),
    ],
)
SPRUNG = {
    "a damper": from_urdf(CRANE),
    "springs and dampers": Snake.paper(),
    "a free base": Free.example(),
    "a loop": SCENES["four-bar-chain"].example(),
}


def difference(function: Callable[[float], Array], noise: float) -> tuple[Array, float]:
    """Return the derivative of a function at 0, extrapolated, and a bound on its error."""
    coarse, fine = ((function(h) - function(-h)) / (2 * h) for h in (STEP, STEP / 2))
    return (4 * fine - coarse) / 3, np.abs(fine - coarse).max() + 8 * noise / STEP


@pytest.mark.parametrize("name", SPRUNG)
def test_derivatives_are_those_of_the_quantities_that_are_returned(name: str):
    scene = SPRUNG[name]
    n, r = scene.n, scene.r
    random = np.random.default_rng(3)
    q = scene.initial_state()[0] + 0.1 * random.normal(size=n)
    v, vdot, tau = random.normal(size=(3, n))
    one = eomcheck.acceleration(scene, "au", q, v, consistent=False, tau=tau)
    digits_lost = one.error_bound / np.abs(one.vdot).max()

    def value(quantity: str, q: Array, v: Array, third: Array) -> Array:
        accelerated = "vdot" in QUANTITIES[quantity].arguments
        vdot, tau = (third, None) if accelerated else (None, third)
        return eomcheck.quantity(scene, quantity, q, v, vdot, tau=tau)

    def multipliers(q: Array, v: Array, tau: Array) -> Array:
        found = eomcheck.acceleration(scene, "au", q, v, consistent=False, tau=tau)
        assert found.multipliers is not None
        return found.multipliers

    functions: dict[str, tuple[Callable[[Array, Array, Array], Array], Array, int]] = {
        "inverse_dynamics": (partial(value, "inverse_dynamics"), vdot, 2),
        "forward_dynamics": (partial(value, "forward_dynamics"), tau, 3),
    }
    if r:
        functions["constraint_force"] = multipliers, tau, 2
    for quantity, (function, third, count) in functions.items():
        state = q, v, third
        found = value(f"{quantity}_derivatives", *state)
        noise = digits_lost * np.abs(function(*state)).max()
        for i in range(count):
            change = np.zeros((3, n))
            change[i] = random.normal(size=n)

            def along(h, function=function, state=state, change=change):
                return function(*(x + h * dx for x, dx in zip(state, change, strict=True)))

            expected, allowed = difference(along, noise)
            actual = found[:, i * n : (i + 1) * n] @ change[i]
            assert np.abs(actual - expected).max() <= allowed, (quantity, i)
            assert allowed < 0.01 * max(np.abs(actual).max(), 1.0), "steps decide nothing"


def test_derivatives_are_at_no_forces_unless_some_are_given():
    scene = SPRUNG["a loop"]
    q, v = scene.initial_state()
    for tau in (None, np.sin(np.arange(scene.n))):
        found = eomcheck.derivatives(scene, "au", q, v, tau)
        assert found.multipliers_q is not None and found.multipliers_v is not None
        value = eomcheck.quantity(scene, "constraint_force_derivatives", q, v, tau=tau)
        assert np.array_equal(value, np.hstack((found.multipliers_q, found.multipliers_v)))
    crane, none = SPRUNG["a damper"], np.zeros(3)
    for name in ("forward_dynamics", "forward_dynamics_derivatives"):
        value = eomcheck.quantity(crane, name, [0.3, 0.5, 0.2], V_3)
        assert np.array_equal(value, eomcheck.quantity(crane, name, [0.3, 0.5, 0.2], V_3, tau=none))
    found = eomcheck.derivatives(crane, "au", [0.3, 0.5, 0.2], V_3)
    expected = np.hstack((found.q, found.v, found.tau))
    assert np.abs(value - expected).max() <= 2 * max(found.error_bounds.values())


V_3 = [0.4, -0.1, 0.6]


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


@pytest.mark.parametrize(
    "name", ["kinetic_energy", "momentum_rate", "inverse_dynamics", "inverse_dynamics_derivatives"]
)
def test_a_quantity_that_overflows_is_refused(name: str):
    with pytest.raises(RefusedError, match="overflows: "):
        eomcheck.quantity(ARM, name, Q, [1e200, -1e200])


def test_weight_that_engines_sum_is_that_of_the_tree():
    """A constant gravity of a description counts, though the scene has no parameter for it."""

    class Held(ChainPendulum):
        def tree(self):
            return super().tree()._replace(gravity=np.array([0.0, -2 * 9.81, 0.0]))

    arm, heavy = (
        kind(np.array([1.0, 2.0]), np.array([1.0, 0.5]), np.array([0.1, 0.2]), 9.81)
        for kind in (ChainPendulum, Held)
    )
    light, twice = (weight_size(Evaluation(scene, Q, V, 0.0)) for scene in (arm, heavy))
    assert 0 < light < twice == 2 * light
