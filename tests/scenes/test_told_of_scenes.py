"""What every scene says of itself: what it is drawn from, refuses, conserves and starts with."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from eomcheck.errors import InputError, RefusedError
from eomcheck.mechanics.parameters import MOST_LINKS, Parametric, parameter, with_parameters
from eomcheck.mechanics.records import (
    Range,
    full_turns,
    plane_mirror,
    plane_rotation,
    plane_translation,
)
from eomcheck.numbers.generic import FLOAT64
from eomcheck.scenes import (
    SCENES,
    Bicycle,
    Bricard,
    ChainPendulum,
    FlyballGovernor,
    FourBarChain,
    RollingDisk,
    Sleigh,
    Snake,
    TurntableBall,
)

EPS = float(np.finfo(float).eps)


def told(one: Range) -> str:
    """The range, its shape if it is an array, and "?" where it may be absent."""
    shape = "x".join(map(str, one.shape))
    return f"{one.low:g}..{one.high:g}{f' ({shape})' * bool(shape)}{'?' * one.optional}"


def refused(scene: Any, name: str, value: float) -> bool:
    try:
        with_parameters(scene, {name: [value]})
    except InputError as error:
        return str(error).startswith(name)
    return False


# Parameter: what it is drawn from; ">" and ">=": entries that are 0, or below it, are refused.
PARAMETERS = {
    "snake": {
        "mass": "> 0.1..10 (3)",
        "length": "> 0.1..10 (3)",
        "inertia": ">= 0.01..10 (3)",
        "stiffness": "0..10000 (2)?",
        "wheel_angle": "-1..1 (3)",
        "pose": "",
        "damping": ">= 0..100 (2)?",
    },
    "chain-pendulum": {
        "mass": "> 0.1..10 (3)",
        "length": "> 0.1..10 (3)",
        "inertia": ">= 0.01..10 (3)",
        "gravity": ">= 0..20?",
        "pose": "",
    },
    "sleigh": {"mass": "> 0.1..10", "inertia": ">= 0.01..10", "offset": "-5..5", "rate": ""},
    "rolling-disk": {
        "mass": "> 0.1..10",
        "radius": "> 0.1..10",
        "axial": "> 0.01..10",
        "across": "> 0.01..10",
        "gravity": ">= 0..20",
        "lean": "",
        "roll": "",
    },
    "turntable-ball": {
        "mass": "> 0.1..10",
        "radius": "> 0.1..10",
        "inertia": "> 0.01..10",
        "rate": "-5..5",
        "swing": "-5..5",
        "frequency": "0.1..5",
        "start": "",
        "speed": "",
        "spin": "",
    },
    "four-bar-chain": {
        "mass": "> 0.1..10 (7)",
        "inertia": ">= 0.01..10 (7)",
        "length": "> 0.1..10",
        "span": "> 0.1..10",
        "gravity": ">= 0..20?",
        "angle": "",
        "rate": "",
        "repeated": "",
    },
    "andrews": {
        "mass": "> 0.001..0.1 (7)",
        "inertia": ">= 1e-07..0.0001 (7)",
        "center": "",
        "tip": "",
        "pins": "",
        "hook": "",
        "anchor": "",
        "stiffness": ">= 0..5000",
        "rest_length": ">= 0..0.1",
        "torque": "-0.1..0.1",
        "pose": "",
    },
    "flyball-governor": {
        "slider": "> 0.1..10",
        "spinning": ">= 0.01..1",
        "arm": "> 0.1..10",
        "center": "> 0.1..1",
        "along": ">= 0.01..1",
        "across": ">= 0.01..1",
        "hinge": "> 0.01..0.2",
        "top": "",
        "attachment": "> 0.3..0.6",
        "stiffness": ">= 0..10000",
        "rest_length": ">= 0..1",
        "damping": ">= 0..100?",
        "gravity": ">= 0..20",
        "height": "",
        "angle": "",
        "rate": "",
    },
    "bricard": {
        "mass": "> 0.1..10 (5)",
        "across": "> 0.01..10 (5)",
        "length": "> 0.1..10",
        "gravity": ">= 0..20",
        "angle": "",
        "rate": "",
        "redundant": "",
    },
    "bicycle": {
        "wheelbase": "> 0.8..1.5",
        "trail": "-0.1..0.2",
        "tilt": "-0.2..0.5",
        "radius": "> 0.2..0.5 (2)",
        "mass": "> 1..100 (4)",
        "center": "-1..1 (2x2)",
        "wheels": "> 0.01..1 (2x2)",
        "frames": ">",
        "gravity": ">= 0..20",
        "speed": "",
        "lean_rate": "",
    },
}


def described(key: str) -> dict[str, str]:
    scene: Any = next(SCENES[key].structures(3 if SCENES[key].has_links else None))
    ranges, found = scene.ranges(3 if SCENES[key].has_links else None), {}
    for name in scene.declared:
        signs = [refused(scene, name, x) for x in (-1e-9, 0.0)]
        sign = {(True, True): "> ", (True, False): ">= "}.get((signs[0], signs[1]), "")
        found[name] = f"{sign}{told(ranges[name]) if name in ranges else ''}".strip()
    return found


@pytest.mark.parametrize("key", PARAMETERS)
def test_parameters_are_of_these_signs_and_drawn_from_these_ranges(key: str):
    assert described(key) == PARAMETERS[key]


# What coordinates are drawn from, which are angles, which rows are holonomic, what of the energy,
# the structures, the symmetries.
SAID = {
    "snake": (
        None,
        "θ_1 θ_2 θ_3",
        None,
        True,
        False,
        [
            "snake[3]",
            "snake[3], no stiffness",
            "snake[3], with damping",
            "snake[3], no stiffness, with damping",
        ],
        ["rotation", "translation", "mirror"],
    ),
    "chain-pendulum": (
        None,
        "θ_1 θ_2 θ_3",
        None,
        True,
        False,
        ["chain-pendulum[3]", "chain-pendulum[3], no gravity"],
        [],
    ),
    "sleigh": (None, "θ", None, True, False, ["sleigh"], ["rotation", "translation", "mirror"]),
    "rolling-disk": (
        "-10..10 -10..10 -3.14159..3.14159 -1.2..1.2 -3.14159..3.14159",
        "ψ θ φ",
        None,
        True,
        False,
        ["rolling-disk"],
        ["rotation", "translation", "mirror"],
    ),
    "turntable-ball": (
        "-10..10 -10..10 -3.14159..3.14159 -1.2..1.2 -3.14159..3.14159",
        "ψ θ φ",
        None,
        "the table is driven",
        True,
        ["turntable-ball", "turntable-ball, no swing, no frequency"],
        ["rotation", "mirror"],
    ),
    "four-bar-chain": (
        "1.1..2.1 1.1..2.1 1.1..2.1 -0.1..0.1 -0.1..0.1 -0.1..0.1 1.1..2.1",
        "θ_1 θ_2 θ_3 φ_1 φ_2 φ_3 θ_0",
        "0 1 2 3 4 5",
        True,
        False,
        ["four-bar-chain[3]", "four-bar-chain[3], no gravity"],
        ["full turns"],
    ),
    "andrews": (
        "-1..1 0..0.5 -0.5..0.2 0.48..0.53 -0.2..0.5 1.04..1.24 -1..1",
        "θ γ φ δ Ω ε β",
        "0 1 2 3 4 5",
        True,
        False,
        ["andrews"],
        [],
    ),
    "flyball-governor": (
        "0..0.6 -3.14159..3.14159 -1.2..1.2 -1.2..1.2",
        "ψ θ_1 θ_2",
        None,
        "dampers take it",
        False,
        ["flyball-governor", "flyball-governor, no damping"],
        ["rotation", "mirror", "exchange"],
    ),
    "bricard": (
        "-0.2..0.4 -0.2..0.4 -0.2..0.4 -0.2..0.4 -0.2..0.4",
        "θ_2 θ_3 θ_4 θ_5 θ_1",
        "0 1 2 3",
        True,
        False,
        ["bricard"],
        ["full turns"],
    ),
    "bicycle": (
        "-10..10 -10..10 0.1..0.5 -3.14159..3.14159 2.94159..3.34159 -3.14159..3.14159 "
        "0.770796..2.3708 -0.8..0.8 -3.14159..3.14159",
        "θ φ β_f ψ ψ_f β_r",
        "2 4",
        True,
        False,
        ["bicycle"],
        ["rotation", "translation", "mirror"],
    ),
}


def said_by(key: str) -> tuple[Any, ...]:
    kind: Any = SCENES[key]
    links = 3 if kind.has_links else None
    scene = next(kind.structures(links))
    ranges = scene.coordinate_ranges()
    q, v = np.linspace(0.3, 0.7, scene.n), np.linspace(-0.9, 0.2, scene.n)
    return (
        " ".join(map(told, ranges)) if ranges else None,
        " ".join(scene.coordinate_names[scene.angle_coordinates]),
        " ".join(map(str, range(scene.r)[scene.holonomic])) if scene.position_residual else None,
        scene.conserves_energy or scene.why_not_conserved,
        scene.depends_on_time,
        [one.structure for one in kind.structures(links)],
        [one.name for one in scene.symmetries(q, v)],
    )


@pytest.mark.parametrize("key", SAID)
def test_a_scene_says_this_of_its_coordinates_energy_structures_and_symmetries(key: str):
    assert said_by(key) == SAID[key]


def test_what_a_seed_draws_follows_the_order_of_parameters_and_wheels_come_last():
    names = ["mass", "length", "inertia", "stiffness", "damping", "wheel_angle"]
    assert list(Snake.ranges(3)) == names
    names = ["mass", "radius", "inertia", "rate", "swing", "frequency"]
    assert list(TurntableBall.ranges()) == names


def test_all_scenes_are_told_of():
    assert list(PARAMETERS) == list(SAID) == list(SCENES)


# ---- What is refused, and just not ---------------------------------------------------------------


def flat(scene: Any, at: int, angle: float) -> tuple[Any, np.ndarray]:
    q = np.linspace(0.2, 1.4, scene.n)
    q[at] = angle
    return scene, q


def across(k: int, angle: float) -> tuple[Any, np.ndarray]:
    angles = np.array([0.1, -0.2, 0.3, 0.4])
    angles[k] = angle
    return replace(Snake.coil(4), wheel_angle=angles), np.linspace(0.2, 1.4, 6)


QUARTER = np.pi / 2


@pytest.mark.parametrize(
    ("of", "what"),
    [
        (lambda x: flat(RollingDisk(), 3, QUARTER - x), "cos θ"),
        (lambda x: flat(RollingDisk(), 3, -QUARTER + x), "cos θ"),
        (lambda x: flat(TurntableBall(), 3, QUARTER - x), "cos θ"),
        (lambda x: flat(Bicycle(), 6, x), "sin ψ"),
        (lambda x: flat(Bicycle(), 6, -x), "sin ψ"),
        (lambda x: across(1, QUARTER - x), "cos α"),
        (lambda x: across(3, -QUARTER + x), "cos α"),
    ],
)
def test_generalized_speeds_are_refused_within_four_eps_of_where_there_are_none(of, what: str):
    scene, q = of(3 * EPS)
    with pytest.raises(RefusedError) as refusal:
        scene.refuse_speeds(q)
    assert refusal.value.what == what
    assert refusal.value.rcond == pytest.approx(3 * EPS, rel=0.2)
    assert refusal.value.threshold == 4 * EPS
    scene, q = of(6 * EPS)
    scene.refuse_speeds(q)


def test_the_wheel_that_stands_across_is_named_and_the_first_may():
    with pytest.raises(RefusedError, match=r"wheel_angle\[2\] = 1\.5707963267948966 "):
        across_2, q = across(2, QUARTER)
        across_2.refuse_speeds(q)
    first, q = across(0, QUARTER)
    first.refuse_speeds(q)


@pytest.mark.parametrize(
    ("made", "says"),
    [
        (lambda x: RollingDisk(lean=QUARTER - x), "lean = 1.57"),
        (lambda x: RollingDisk(lean=x - QUARTER), "lean = -1.57"),
        (lambda x: Bicycle(tilt=QUARTER - x), "tilt = 1.57"),
        (lambda x: Bicycle(tilt=x - QUARTER), "tilt = -1.57"),
        (lambda x: Bricard(angle=-np.pi / 6 + x), "angle = -0.523"),
        (lambda x: Bricard(angle=-5 * np.pi / 6 - x), "angle = -2.61"),
        (lambda x: Bicycle(frames=frames(0, 6 - x)), "frames[0] = [3.0, 7.0, 12.0, 6.0"),
        (lambda x: Bicycle(frames=frames(1, x - 6)), "frames[1] = [3.0, 7.0, 12.0, -6.0"),
    ],
)
def test_parameters_that_no_scene_has_are_refused_up_to_their_bound_and_not_below(made, says: str):
    made(0.01)
    # The sine of -π/6 is none of the doubles: -1/2 itself cannot be said.
    for x in (-1e-9, -0.01) if says.startswith("angle") else (0.0, -0.01):
        with pytest.raises(InputError) as refusal:
            made(x)
        assert str(refusal.value).startswith(says[: None if x > -1e-3 else 9]), str(refusal.value)


def frames(which: int, product: float) -> list[list[float]]:
    """Moments of both frames, those of one 3 and 12 ahead and down, whose root is 6."""
    usual = [[9.0, 11.0, 3.0, 2.0], [0.06, 0.05, 0.01, -0.007]]
    usual[which] = [3.0, 7.0, 12.0, product]
    return usual


@pytest.mark.parametrize("frame", [0, 1])
@pytest.mark.parametrize("entry", [0, 1, 2])
@pytest.mark.parametrize("value", [0.0, -5.0])
def test_moments_of_a_bicycles_frames_are_positive(frame: int, entry: int, value: float):
    frames = [[9.0, 11.0, 3.0, 0.0], [0.06, 0.05, 0.01, 0.0]]
    frames[frame][entry] = value
    with pytest.raises(InputError, match=rf"^frames\[{frame}\] = "):
        Bicycle(frames=frames)


@pytest.mark.parametrize("given", [{"swing": 1.0}, {"frequency": 2.0}])
def test_a_table_that_swings_has_a_frequency_and_the_other_way_round(given):
    with pytest.raises(InputError, match="expected both or none"):
        TurntableBall(**given)


# ---- Where a scene starts ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("scene", "q", "v"),
    [
        (Sleigh(rate=-0.7), [0, 0, 0], [0, 0, -0.7]),
        (
            TurntableBall(start=(0.4, -0.6), speed=(0.3, 0.5), spin=7.0, rate=3.0, radius=0.5),
            [0.4, -0.6, 0, 0, 0],
            [0.3, 0.5, 7.0, 1.4, -3.0],
        ),
        (
            replace(FourBarChain.rods(2), angle=1.1, rate=-0.4),
            [1.1, 1.1, 0, 0, 1.1],
            [-0.4, -0.4, 0, 0, -0.4],
        ),
        (replace(ChainPendulum.rods(2), pose=[0.3, -0.8]), [0.3, -0.8], [0, 0]),
        (replace(Snake.coil(2), pose=[0.3, -0.8]), [0, 0, 0.3, -0.8], [0, 0, 0, 0]),
        (
            FlyballGovernor(height=0.3, angle=0.7, rate=-2.0),
            [0.3, 0, 0.7, 0.7],
            [0, -2.0, 0, 0],
        ),
        (
            Bicycle(radius=(0.25, 0.5), speed=3.0, lean_rate=0.8),
            [0, 0, 0.25, 0, np.pi, 0, np.pi / 2, 0, 0],
            [-3.0, -0.2, 0, 0, 0, 6.0, 0.8, 0, 12.0],
        ),
        (
            RollingDisk(lean=0.0, roll=-3.0, radius=0.5),
            [0, 0, 0, 0, 0],
            [-1.5, 0, 0, 0, -3.0],
        ),
        (
            Bricard(angle=np.pi / 6, rate=2.0),
            [-np.arcsin(1 / 3), -np.arcsin(1 / 3), np.pi / 6, np.pi / 6, np.pi / 6],
            None,
        ),
    ],
)
def test_a_scene_starts_where_its_parameters_say(scene: Any, q: Any, v: Any):
    at, rates = scene.initial_state()
    if isinstance(scene, Bricard):  # θ_2, θ_3, θ_4, θ_5, θ_1: the second and fourth follow
        b = -np.arcsin(1 / 3)
        follows = -np.cos(np.pi / 6) / (1.5**2 * np.cos(b)) * 2.0
        q, v = [b, np.pi / 6, b, np.pi / 6, np.pi / 6], [follows, 2.0, follows, 2.0, 2.0]
    np.testing.assert_allclose(at, q, rtol=0, atol=1e-15)
    np.testing.assert_allclose(rates, v, rtol=0, atol=1e-15)


# ---- Motions of a whole scene on the plane -------------------------------------------------------


def test_a_scene_is_turned_shifted_and_mirrored_as_said():
    disk = RollingDisk()
    q, v = np.array([1.0, 2.0, 0.3, 0.5, -0.7]), np.array([-3.0, 5.0, 7.0, 11.0, 13.0])
    c, s = np.cos(0.75), np.sin(0.75)
    turned = plane_rotation(disk, q, v, slice(2, 4))
    np.testing.assert_allclose(turned.q, [c - 2 * s, s + 2 * c, 1.05, 1.25, -0.7], rtol=1e-15)
    np.testing.assert_allclose(turned.v, [-3 * c - 5 * s, 5 * c - 3 * s, 7, 11, 13], rtol=1e-15)
    image = np.eye(5)
    image[:2, :2] = [[c, -s], [s, c]]
    assert (turned.name, turned.scene) == ("rotation", disk)
    np.testing.assert_array_equal(turned.image, image)
    shifted = plane_translation(disk, q, v)
    assert shifted.q.tolist() == [4.0, 0.0, 0.3, 0.5, -0.7]
    assert shifted.v.tolist() == v.tolist()
    assert (shifted.image == np.eye(5)).all()
    mirrored = plane_mirror(disk, q, v, unflipped=(0, 3))
    assert mirrored.q.tolist() == [1.0, -2.0, -0.3, 0.5, 0.7]
    assert mirrored.v.tolist() == [-3.0, -5.0, -7.0, 11.0, -13.0]
    assert (mirrored.image == np.diag([1.0, -1, -1, 1, -1])).all()
    whole = full_turns(disk, q, v)
    np.testing.assert_array_equal(whole.q, q + 2 * np.pi)
    assert (whole.v == v).all()
    assert (whole.image == np.eye(5)).all()
    assert q.tolist() == [1.0, 2.0, 0.3, 0.5, -0.7]  # and is not changed itself


def test_symmetries_of_the_scenes_turn_and_mirror_what_they_should():
    ball = TurntableBall(swing=1.5, frequency=3.0)
    q, v = np.array([1.0, 2.0, 0.3, 0.5, -0.7]), np.arange(1.0, 6.0)
    turned, mirrored = ball.symmetries(q, v)
    assert (turned.q - q)[2:].tolist() == [0.75, 0.0, 0.0]
    other: Any = mirrored.scene
    assert (other.rate, other.swing, other.frequency) == (-2.0, -1.5, 3.0)
    assert mirrored.q.tolist() == [1.0, -2.0, -0.3, -0.5, -0.7]
    steady: Any = [*TurntableBall().symmetries(q, v)][1].scene
    assert (steady.rate, steady.swing) == (-2.0, None)
    *_, sleigh = Sleigh().symmetries(q[:3], v[:3])
    assert np.diag(sleigh.image).tolist() == [1, -1, -1]
    *_, disk = RollingDisk().symmetries(q, v)
    assert np.diag(disk.image).tolist() == [1, -1, -1, -1, 1]
    *_, snake = Snake.coil(2).symmetries(q[:4], v[:4])
    assert np.diag(snake.image).tolist() == [1, -1, -1, -1]
    moved: Any = snake.scene
    np.testing.assert_array_equal(moved.wheel_angle, -Snake.coil(2).wheel_angle)
    turn, mirror, exchange = FlyballGovernor().symmetries(q[:4], v[:4])
    assert (turn.q - q[:4]).tolist() == [0.0, 0.75, 0.0, 0.0]
    assert mirror.v.tolist() == [1.0, -2.0, 3.0, 4.0]
    assert exchange.q.tolist() == [1.0, 2.0, 0.5, 0.3]
    assert (exchange.image @ v[:4]).tolist() == [1.0, 2.0, 4.0, 3.0]
    p = np.arange(1.0, 10.0)
    turn, _, mirror = Bicycle().symmetries(p, -p)
    assert (turn.q - p)[3:].tolist() == [0.75, *[0.0] * 5]
    assert np.diag(mirror.image).tolist() == [1, -1, 1, -1, 1, 1, -1, -1, 1]
    np.testing.assert_allclose(mirror.q, [1, -2, 3, -4, 5, 6, np.pi - 7, -8, 9])


# ---- Parameters that are declared once -----------------------------------------------------------


class Told(Parametric):
    """A scene of parameters only."""

    size: Any = parameter("size", "m", "> 0", (1.0, 2.0), default=1.5)
    drag: Any = parameter("C", "1", ">= 0", (0.0, 3.0, None), (2,), default=(1.0, 2.0))
    pair: Any = parameter("pair", "kg", shape=(2, 2), default=((1.0, 2.0), (3.0, 4.0)))
    half: Any = parameter("half", "m", default=lambda told: told.size / 2, read=False)
    more: Any = parameter("more", "s", default=None, optional=True)

    key = "told"

    def initial_state(self) -> Any:
        return np.zeros(0), np.zeros(0)


def test_parameters_are_documented_read_and_printed_as_declared():
    lines = (Told.__doc__ or "").splitlines()
    assert [line.strip() for line in lines if line.startswith("    ")] == [
        "size: size, m, > 0.",
        "drag: C, (2,), 1, >= 0, or None without.",
        "pair: pair, (2, 2), kg.",
        "half: half, m.",
        "more: more, s, or None without.",
        "InputError: wrong shape, not finite, or out of its range.",
    ]
    scene = Told(size=3.0, drag=None)
    read: Any = scene.parameters(FLOAT64)
    assert read._fields == ("size", "drag", "pair", "more")
    assert read.size.tolist() == [3.0]
    assert read.drag is None
    assert read.more is None
    assert read.pair.tolist() == [[1.0, 2.0], [3.0, 4.0]]
    assert scene.half == 1.5
    assert repr(scene) == "Told(size=3.0, drag=None, half=1.5)"
    assert repr(Told(half=9.0)) == "Told(half=9.0)"
    assert repr(Told(pair=[[1, 2], [3, 5]], half=0.5)).startswith("Told(pair=[[1.0, 2.0], [3.0, 5")
    assert Told.ranges() == {
        "size": Range(1.0, 2.0),
        "drag": Range(0.0, 3.0, (2,), True),
    }


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"size": 0.0}, "size = 0.0, expected a positive number"),
        ({"drag": [1.0, -2.0]}, "drag[1] = -2.0, expected a number that is not negative"),
        ({"drag": [-3.0, -2.0]}, "drag[0] = -3.0, expected a number that is not negative"),
        ({"drag": [1.0]}, "drag has shape (1,), expected (2,)"),
        ({"size": np.nan}, "size = nan, expected a finite number"),
        ({"pair": [[1, 2], [np.inf, 4]]}, "pair[1, 0] = inf, expected a finite number"),
        ({"size": "a"}, "size = 'a' is not an array of real numbers"),
    ],
)
def test_a_wrong_parameter_is_named_with_its_place_and_value(given, says: str):
    with pytest.raises(InputError) as refusal:
        Told(**given)
    assert str(refusal.value) == says


@pytest.mark.parametrize(
    ("given", "found"),
    [
        ({"size": [2.0]}, 2.0),
        ({"drag": [5.0]}, [5.0, 5.0]),
        ({"drag": [5.0, 6.0]}, [5.0, 6.0]),
        ({"drag": None}, None),
        ({"pair": [1.0, 2.0, 3.0, 5.0]}, [[1.0, 2.0], [3.0, 5.0]]),
        ({"more": [7.0]}, 7.0),
    ],
)
def test_numbers_in_order_are_given_to_a_parameter_in_its_shape(given, found):
    (name,) = given
    value = getattr(with_parameters(Told(drag=None), given), name)
    assert (value if value is None else value.tolist()) == found


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"pair": [1.0, 2.0]}, "pair = [1.0, 2.0]: 2 numbers, expected 4, or one for all of them"),
        ({"size": [1.0, 2.0]}, "size = [1.0, 2.0]: 2 numbers, expected 1"),
    ],
)
def test_another_count_of_numbers_is_refused(given, says: str):
    with pytest.raises(InputError) as refusal:
        with_parameters(Told(), given)
    assert str(refusal.value) == says


def test_a_scene_has_at_most_so_many_links():
    assert MOST_LINKS == 1_000_000
    assert ChainPendulum.ranges(MOST_LINKS)["mass"].shape == (MOST_LINKS,)
    for links in (0, MOST_LINKS + 1):
        with pytest.raises(InputError, match="links"):
            ChainPendulum.ranges(links)


@pytest.mark.parametrize(
    ("masses", "windows"), [(3, 1), (5, 2), (7, 3), (1, None), (2, None), (4, None), (6, None)]
)
def test_so_many_masses_are_so_many_windows_or_none(masses: int, windows: int | None):
    ones = np.ones(masses)
    if windows is not None:
        assert FourBarChain(ones, ones).windows == windows
        return
    with pytest.raises(InputError, match="2N\\+1 links, one mass each"):
        FourBarChain(ones, ones)
