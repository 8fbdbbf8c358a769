"""Strategies are made of these numbers: what cases are drawn from, and what is made of them."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck
from hypothesis import strategies as st
from scipy.linalg import null_space

from eomcheck import strategies
from eomcheck.descriptions.random_mechanisms import RandomMechanism, RandomTree
from eomcheck.errors import InputError, RefusedError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.lab.strategy_samples import draw_samples
from eomcheck.mechanics.records import Range
from eomcheck.scenes import ChainPendulum, FourBarChain, Sleigh, Snake, TurntableBall
from eomcheck.strategies import scene_strategies, state_strategies
from eomcheck.strategies.state_strategies import (
    StateRanges,
    angles_of,
    consistent_state,
    ordinary_state,
    state_or_reject,
    state_ranges,
)

of_scenes: Any = importlib.import_module("eomcheck.strategies.scene_strategies")
of_states: Any = importlib.import_module("eomcheck.strategies.state_strategies")


class Said:
    """A strategy that draws nothing and says what it is made of, for two links."""

    def __init__(self, text: str):
        self.text = text

    def __or__(self, other: Said) -> Said:
        return Said(f"{self.text} | {other.text}")

    def map(self, function: Callable) -> Said:
        """Say what becomes of 3."""
        try:
            return Said(f"[{self.text}: 3 -> {function(3.0)}]")
        except TypeError:
            return Said(f"[{self.text}: made]")

    def flatmap(self, function: Callable) -> Said:
        """Say what is drawn for 2."""
        return Said(f"{self.text}: {function(2).text}")


def _builds(made: Any, **parts: Said) -> Said:
    return Said(", ".join(f"{name} {one.text}" for name, one in parts.items()))


def _built(made: Any, *parts: Said, **named: Said) -> Said:
    if named:
        return _builds(made, **named)
    return Said(f"[{', '.join(one.text for one in parts)}: 1, 0.5 -> {made(1.0, 0.5):g}]")


SAYING = SimpleNamespace(
    floats=lambda low, high: Said(f"{low:g}..{high:g}"),
    integers=lambda low, high: Said(f"{low}..{high}"),
    sampled_from=lambda among: Said(f"of {among}"),
    just=lambda x: Said(str(x)),
    none=lambda: Said("None"),
    lists=lambda one, min_size, max_size: Said(f"{min_size}-{max_size} of ({one.text})"),
    tuples=lambda *parts: Said(" and ".join(one.text for one in parts)),
    builds=_built,
)


@pytest.fixture
def saying(monkeypatch):
    """Have strategies say what they are made of."""
    for module in (scene_strategies, state_strategies, of_scenes, of_states):
        monkeypatch.setattr(module, "st", SAYING)


# ---- Numbers -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("bounds", "lowest", "said"),
    [
        ((2.0, 1.0), 0.0, "x = (2.0, 1.0), expected 0 <= low <= high, both finite"),
        ((-0.5, 1.0), 0.0, "x = (-0.5, 1.0), expected 0 <= low <= high, both finite"),
        ((1.0, 1.0), 1.5, "x = (1.0, 1.0), expected 1.5 <= low <= high, both finite"),
        ((0.0, math.inf), 0.0, "x = (0.0, inf), expected 0 <= low <= high, both finite"),
        ((1.0, 2.0, 3.0), 0.0, "x = (1.0, 2.0, 3.0), expected 0 <= low <= high, both finite"),
        ("ab", 0.0, "x = 'ab', expected 0 <= low <= high, both finite"),
    ],
)
def test_bounds_that_are_none_are_refused_in_these_words(bounds: Any, lowest: float, said: str):
    with pytest.raises(InputError) as error:
        scene_strategies.bounded_floats("x", bounds, lowest)
    assert str(error.value) == said


def test_numbers_of_links_that_are_in_no_order_are_refused_in_these_words():
    said = r"^min_links, max_links = 4, 3, expected min_links <= max_links$"
    with pytest.raises(InputError, match=said):
        scene_strategies.links_between(4, 3)
    with pytest.raises(InputError, match=r"^max_links = 0"):
        scene_strategies.links_between(1, 0)


def test_only_what_is_below_a_millionth_is_nothing():
    tiny = np.nextafter(1e-6, 0.0)
    for x, kept in ((1e-6, 1e-6), (-1e-6, -1e-6), (tiny, 0.0), (-tiny, 0.0), (-2.0, -2.0)):
        assert scene_strategies.without_tiny(x) == kept


def test_strategies_for_numbers_are_made_of_these(saying):
    one, absent = Range(1.0, 2.0, (4, 3)), Range(-1.0, 2.0, (2,), True)
    found: dict[str, Any] = {
        "1..2": scene_strategies.bounded_floats("x", (1.0, 2.0), 1.0),
        "3..3": scene_strategies.links_between(3, 3),
        "[-2..4: 3 -> 1000.0]": scene_strategies.magnitudes(-2.0, 4.0),
        "0..2": scene_strategies.entry_of(Range(0.0, 2.0)),
        "-2..0": scene_strategies.entry_of(Range(-2.0, 0.0)),
        "[-1..2: 3 -> 3.0]": scene_strategies.entry_of(Range(-1.0, 2.0)),
        "4-4 of (3-3 of (1..2))": scene_strategies.parameter_of(one),
        "None | 2-2 of ([-1..2: 3 -> 3.0]) | 2-2 of ([-1..2: 3 -> 3.0])": (
            scene_strategies.parameter_of(absent)
        ),
        "mass 1..2, more 0..3": scene_strategies.from_ranges(
            Snake, {"mass": Range(1.0, 2.0), "more": Range(0.0, 3.0)}
        ),
    }
    assert [one.text for one in found.values()] == list(found)


# ---- Scenes --------------------------------------------------------------------------------------


USUAL = (
    "1..8: mass 2-2 of (0.1..10), length 2-2 of (0.1..10), inertia 2-2 of (0.01..10), "
    "stiffness None | 1-1 of (0..10000) | 1-1 of (0..10000), "
    "damping None | 1-1 of (0..100) | 1-1 of (0..100), wheel_angle 2-2 of ([-1..1: 3 -> 3.0])"
)
GIVEN = (
    "2..3: mass 2-2 of (1..2), length 2-2 of (3..4), inertia 2-2 of (0..5), "
    "stiffness None | 1-1 of (6..7) | 1-1 of (6..7), damping None | 1-1 of (8..9) | 1-1 of (8..9), "
    "wheel_angle 2-2 of ([-0.5..0.5: 3 -> 3.0])"
)
HARD = (
    "1..8: mass 2-2 of ([-8..8: 3 -> 1000.0]), length 2-2 of ([-8..8: 3 -> 1000.0]), "
    "inertia 2-2 of (0.0 | [-8..8: 3 -> 1000.0]), "
    "stiffness None | 1-1 of (0.0 | [-8..12: 3 -> 1000.0]), "
    "wheel_angle 2-2 of (of (0.0, -0.0) | -3.14159..3.14159 | "
    "[of (-1.0, 1.0), 0.0 | [-16..-1: 3 -> 1000.0]: 1, 0.5 -> 1.0708]), "
    "damping None | 1-1 of (0.0 | [-8..12: 3 -> 1000.0])"
)


def test_snakes_are_drawn_from_these_ranges_unless_others_are_given(saying):
    found: Any = strategies.snakes()
    assert found.text == USUAL
    found = strategies.snakes(
        2, 3, mass=(1.0, 2.0), length=(3.0, 4.0), inertia=(0.0, 5.0), stiffness=(6.0, 7.0),
        damping=(8.0, 9.0), wheel_angle=0.5,
    )  # fmt: skip
    assert found.text == GIVEN
    found = strategies.hostile_snakes()
    assert found.text == HARD
    found = strategies.hostile_snakes(3, 4)
    assert found.text.startswith("3..4: ")


@pytest.mark.parametrize("name", ["mass", "length", "inertia", "stiffness", "damping"])
def test_bounds_of_snakes_are_checked_each_by_its_name_and_its_smallest(name: str):
    least = "4.94066e-324" if name in ("mass", "length") else "0"
    wrong: dict[str, Any] = {name: (-1.0, 1.0)}
    with pytest.raises(InputError) as error:
        strategies.snakes(**wrong)
    said = f"{name} = (-1.0, 1.0), expected {least} <= low <= high, both finite"
    assert str(error.value) == said
    strategies.snakes(**{name: (5e-324 if least != "0" else 0.0, 1.0)})  # type: ignore
    with pytest.raises(InputError, match=r"^wheel_angle = \(0.0, -0.5\), expected 0 <= low"):
        strategies.snakes(wheel_angle=-0.5)


def test_links_are_one_to_eight_by_default_and_of_no_account_to_a_scene_without_them(monkeypatch):
    kept: list[Any] = []
    topologies = lambda kind, n: kept.append((kind, n)) or st.none()  # noqa: E731
    monkeypatch.setattr(of_scenes, "_topologies", topologies)
    monkeypatch.setattr(of_scenes, "_of_kind", lambda kind, n: st.just((kind, n)))
    assert draw_samples(strategies.scenes(Sleigh, 0, -1), 1, 0) == [(None, None)]
    assert kept == [(Sleigh, None)]
    monkeypatch.setattr(scene_strategies, "st", SAYING)
    monkeypatch.setattr(of_scenes, "_topologies", lambda kind, n: Said(f"{kind.__name__} {n}"))
    monkeypatch.setattr(of_scenes, "_of_kind", lambda kind, n: Said(f"{kind} {n}"))
    found: Any = strategies.scenes(ChainPendulum)
    assert found.text == "1..8: ChainPendulum 2: 2 2"


def test_a_draw_that_is_refused_is_no_case_and_the_ways_are_those_of_one_entry(monkeypatch):
    asked: list[Any] = []

    class Refused(ChainPendulum):
        @classmethod
        def topologies(cls, links: Any = None) -> Any:
            return [{"way": (f"{links} a", f"{links} b")}]

        @classmethod
        def of_topology(cls, links: Any, levels: Any, choices: Any) -> Any:
            asked.append((links, levels["way"]))
            if levels["way"].endswith("b"):
                raise RefusedError("a", 0.0, 1.0, "no")
            assert choices.whole(3, 3) == 3 and choices.number(0.5, 0.5) == 0.5
            return ChainPendulum

    found = draw_samples(strategies.scenes(Refused, 2, 2), 5, 0)
    assert {(type(one), one.links) for one in found} == {(ChainPendulum, 2)}
    assert set(asked) == {(2, "2 a"), (2, "2 b")}


def test_random_mechanisms_are_of_their_kind_and_numbers_of_bodies(monkeypatch):
    monkeypatch.setattr(scene_strategies, "scenes", lambda *given: given)
    assert strategies.random_trees() == (RandomTree, 1, 12)
    assert strategies.random_mechanisms() == (RandomMechanism, 1, 12)
    assert strategies.random_trees(2, 3) == (RandomTree, 2, 3)
    assert strategies.random_mechanisms(30, 30) == (RandomMechanism, 30, 30)
    wrong: Any
    for wrong, said in (
        ((3, 2), "min_bodies, max_bodies = 3, 2, expected min_bodies <= max_bodies"),
        ((1, 31), "max_bodies = 31, expected at most 30 of a random scene"),
        ((31, 31), "min_bodies = 31, expected at most 30 of a random scene"),
    ):
        for make in (strategies.random_trees, strategies.random_mechanisms, strategies.urdfs):
            with pytest.raises(InputError) as error:
                make(*wrong)
            assert str(error.value) == said


def test_urdfs_are_made_with_the_options_that_are_given(monkeypatch):
    made: list[Any] = []
    monkeypatch.setattr(
        scene_strategies, "urdf_tree", lambda links, choices, *more: made.append((links, *more))
    )
    monkeypatch.setattr(scene_strategies, "urdf_text", lambda tree: "text")
    given: list[dict[str, Any]] = [
        {},
        {"joints": ["fixed", "revolute"], "mimic": False},
        {"massless": False},
        {"dampers": False},
    ]
    for more in given:
        assert draw_samples(strategies.urdfs(3, 3, **more), 1, 0) == ["text"]
    everywhere = ("revolute", "prismatic", "fixed")
    assert [made[0], *[one for i, one in enumerate(made) if one != made[i - 1]][-3:]] == [
        (3, everywhere, True, True, True),
        (3, ("fixed", "revolute"), False, True, True),
        (3, everywhere, True, False, True),
        (3, everywhere, True, True, False),
    ]
    said = "expected 'revolute' and any of: fixed, floating, planar, prismatic, revolute"
    for joints in (["prismatic"], ["revolute", "spherical"]):
        with pytest.raises(InputError) as error:
            strategies.urdfs(joints=joints)
        assert str(error.value) == f"joints = {tuple(joints)!r}, {said}"


def test_tests_with_these_cases_may_be_slow_and_large():
    assert strategies.settings.deadline is None
    assert set(strategies.settings.suppress_health_check) == {
        HealthCheck.too_slow,
        HealthCheck.data_too_large,
        HealthCheck.large_base_example,
        HealthCheck.filter_too_much,
    }


# ---- States --------------------------------------------------------------------------------------


def test_states_are_drawn_from_these_ranges():
    usual, angle, speed = Range(-10.0, 10.0), Range(-1.0, 1.0), Range(-5.0, 5.0)
    around = Range(-math.pi, math.pi)
    snake = state_ranges(Snake.coil(2))
    two = (usual, usual, angle, angle)
    assert snake == StateRanges(two, around, speed._replace(shape=(2,)), Range(0.0, 0.0))
    own = state_ranges(Snake.coil(1), 2.0, 0.5, 1.5, 3.0)
    assert own.coordinates == (Range(-2.0, 2.0), Range(-2.0, 2.0), Range(-0.5, 0.5))
    assert (own.components, own.time) == (Range(-1.5, 1.5, (2,)), Range(0.0, 0.0))
    ball = TurntableBall.example()
    assert ball.depends_on_time
    assert state_ranges(ball).time == Range(0.0, 10.0)
    assert state_ranges(ball, time=3.0).time == Range(0.0, 3.0)
    bars = FourBarChain.example()
    assert bars.coordinate_ranges() is not None
    found = state_ranges(bars)
    assert found.coordinates == bars.coordinate_ranges()
    assert (found.heading, found.components.shape) == (Range(0.0, 0.0), (bars.p,))
    assert angles_of(Snake.coil(2)) == [False, False, True, True]
    assert angles_of(ChainPendulum.rods(2)) == [True, True]


def test_ordinary_states_are_around_a_curved_pose_that_is_turned():
    chain = ChainPendulum.rods(3)
    assert chain.coordinate_ranges() is None
    state = ordinary_state(chain, [0.1, 0.2, 0.3], 2.0, [1.0, -2.0, 3.0], 0.0)
    assert state.q == pytest.approx([0.1 + 0.4 + 2, 0.2 + 0.8 + 2, 0.3 + 1.2 + 2])
    assert (state.v.tolist(), state.t, strategies.CURVATURE) == ([1.0, -2.0, 3.0], 0.0, 0.4)
    snake = Snake.coil(2)
    q, v, _ = ordinary_state(snake, [5.0, -6.0, 0.1, 0.2], -1.0, [1.5, -0.5], 0.0)
    assert q == pytest.approx([5.0, -6.0, 0.1 + 0.4 - 1, 0.2 + 0.8 - 1])
    a = Evaluation(snake, q, 0 * q).terms.a
    assert v == pytest.approx(null_space(a) @ [1.5, -0.5])
    assert consistent_state(snake, q, [1.5], 0.0).v == pytest.approx(null_space(a)[:, 0] * 1.5)
    many = consistent_state(snake, q, [1.5, -0.5, 7.0], 0.0)
    assert many.v == pytest.approx(v)
    bars = FourBarChain.example()
    near = bars.initial_state()[0] + 0.01
    same = ordinary_state(bars, near, 3.0, [0.5] * bars.p, 0.0)
    assert np.abs(same.q - near).max() < 0.1, "a scene with ranges of its own is not turned"


def test_a_state_near_which_nothing_is_closed_is_no_case():
    def make(scene: Any, *numbers: Any) -> Any:
        if numbers == (1, 2):
            raise RefusedError("a", 0.0, 1.0, "no")
        return scene, numbers

    made: Any = state_or_reject(make, Sleigh())
    assert made((3, 4))[1] == (3, 4)
    pairs = st.sampled_from([(1, 2), (3, 4)]).map(made)
    found = {numbers for _, numbers in draw_samples(pairs, 20, 0)}
    assert found == {(3, 4)}


@pytest.mark.parametrize("name", ["position", "angle", "speed", "time"])
def test_bounds_of_states_are_checked_each_by_its_name(name: str):
    with pytest.raises(InputError) as error:
        strategies.states(Snake.coil(2), **{name: -1.0})
    said = f"{name} = (0.0, -1.0), expected 0 <= low <= high, both finite"
    assert str(error.value) == said
    wrong: Any = 3
    with pytest.raises(InputError, match="scene"):
        strategies.states(wrong)


def test_strategies_for_states_are_made_of_these(saying):
    found: Any = strategies.states(Snake.coil(2))
    half, turned = "[-10..10: 3 -> 3.0]", "[-1..1: 3 -> 3.0]"
    more = "[-3.14159..3.14159: 3 -> 3.0] and 2-2 of ([-5..5: 3 -> 3.0]) and 0..0"
    assert found.text == f"[{half} and {half} and {turned} and {turned} and {more}: made]"
    found = strategies.states(TurntableBall.example(), time=3.0)
    assert found.text.endswith(" and 0..3: made]")
    found = strategies.hostile_states(Snake.coil(3))
    q = "[-3.14159..3.14159: 3 -> [3.0, 3.0, 3.0, 3.0, 3.0]] | 5-5 of (-1e+09..1e+09)"
    v = "2-2 of (0.0 | [of (-1.0, 1.0), [-150..150: 3 -> 1000.0]: 1, 0.5 -> 0.5])"
    assert found.text == f"[{q} and {v} and 0.0: made]"
