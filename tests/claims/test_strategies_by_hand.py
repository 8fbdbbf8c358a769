"""Strategies are made of these numbers: what cases are drawn from, and what is made of them."""

from __future__ import annotations

import importlib
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck
from scipy.linalg import null_space

from eomcheck import strategies
from eomcheck.descriptions.random_mechanisms import RandomMechanism, RandomTree
from eomcheck.draws import (
    StateRanges,
    angles_of,
    consistent_state,
    draw_array,
    draw_magnitude,
    hostile_state,
    ordinary_state,
    state_ranges,
    zero_or_magnitude,
)
from eomcheck.errors import InputError, RefusedError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.mechanics.records import Range
from eomcheck.scenes import Bricard, ChainPendulum, FourBarChain, Sleigh, Snake, TurntableBall
from eomcheck.strategies import check_bounds, draw_samples, without_tiny

module: Any = importlib.import_module("eomcheck.strategies")


class Scripted:
    """A source of choices that lists what it is asked: the option `pick`, 2, given numbers or 3."""

    def __init__(self, pick: int = 0, numbers: Sequence[float] = ()):
        self.pick, self.numbers, self.asked = pick, list(numbers), []

    def one_of(self, among: Sequence[Any]) -> Any:
        """Return the option `pick`, or the last one."""
        self.asked.append(f"of {tuple(among)}")
        return among[min(self.pick, len(among) - 1)]

    def whole(self, low: int, high: int) -> int:
        """Return 2."""
        self.asked.append(f"{low}..{high}")
        return 2

    def number(self, low: float, high: float) -> float:
        """Return the next of the numbers."""
        self.asked.append(f"[{low:g}..{high:g}]")
        return self.numbers.pop(0) if self.numbers else 3.0


@pytest.fixture
def plain(monkeypatch):
    """Have strategies be the function that makes a case, and whether numbers may be tiny."""
    monkeypatch.setattr(module, "strategy_of", lambda make, tiny=False: (make, tiny))


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
        check_bounds("x", bounds, lowest)
    assert str(error.value) == said


def test_numbers_of_links_that_are_in_no_order_are_refused_in_these_words():
    said = r"^min_links, max_links = 4, 3, expected min_links <= max_links$"
    for make in (
        strategies.snakes,
        strategies.hostile_snakes,
        lambda *x: strategies.scenes(Snake, *x),
    ):
        with pytest.raises(InputError, match=said):
            make(4, 3)
        with pytest.raises(InputError, match=r"^max_links = 0"):
            make(1, 0)


def test_only_what_is_below_a_millionth_is_nothing():
    tiny = np.nextafter(1e-6, 0.0)
    for x, kept in ((1e-6, 1e-6), (-1e-6, -1e-6), (tiny, 0.0), (-tiny, 0.0), (-2.0, -2.0)):
        assert without_tiny(x) == kept


def test_strategies_for_numbers_are_made_of_these():
    choices = Scripted()
    table = draw_array(Range(1.0, 2.0, (2, 3)), Scripted(numbers=[1, 2, 3, 4, 5, 6]))
    assert table.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert draw_array(Range(0.0, 2.0), choices) == 3.0
    assert draw_magnitude(choices, -2.0, 4.0) == 1000.0
    assert choices.asked == ["[0..2]", "[-2..4]"]
    assert zero_or_magnitude(Scripted(0), -2.0, 4.0) == 0.0
    signed = Scripted(1)
    assert zero_or_magnitude(signed, -2.0, 4.0) == 1000.0
    assert zero_or_magnitude(signed, -2.0, 4.0, (1.0, -1.0)) == -1000.0
    assert signed.asked[2:] == ["of (True, False)", "of (1.0, -1.0)", "[-2..4]"]


# ---- Scenes --------------------------------------------------------------------------------------


MASSES = 2 * ["[0.1..10]"] + 2 * ["[0.1..10]"] + 2 * ["[0.01..10]"]
OPTIONAL = "of (True, False, False)"
USUAL = [
    *("1..8", *MASSES, OPTIONAL, "[0..10000]", OPTIONAL, "[0..100]", "[-1..1]", "[-1..1]"),
]
GIVEN = [
    *("2..3", "[1..2]", "[1..2]", "[3..4]", "[3..4]", "[0..5]", "[0..5]"),
    *(OPTIONAL, "[6..7]", OPTIONAL, "[8..9]", "[-0.5..0.5]", "[-0.5..0.5]"),
]
EITHER, SIZE = "of (True, False)", "[-8..8]"
WHEEL = "of ('zero', 'any', 'across')"
HARD = [
    *("1..8", SIZE, SIZE, SIZE, SIZE, EITHER, SIZE, EITHER, SIZE, EITHER, EITHER, "[-8..12]"),
    *(WHEEL, "[-3.14159..3.14159]", WHEEL, "[-3.14159..3.14159]", EITHER, EITHER, "[-8..12]"),
]


def test_snakes_are_drawn_from_these_ranges_unless_others_are_given(plain):
    def asked(strategy: Any, pick: int, tiny: bool) -> list[str]:
        make, of_any_size = strategy
        choices = Scripted(pick)
        assert make(choices).links == 2 and of_any_size == tiny
        return choices.asked

    assert asked(strategies.snakes(), 1, False) == USUAL
    given = strategies.snakes(
        2, 3, mass=(1.0, 2.0), length=(3.0, 4.0), inertia=(0.0, 5.0), stiffness=(6.0, 7.0),
        damping=(8.0, 9.0), wheel_angle=0.5,
    )  # fmt: skip
    assert asked(given, 1, False) == GIVEN
    assert asked(strategies.hostile_snakes(), 1, True) == HARD
    assert asked(strategies.hostile_snakes(3, 4), 1, True)[0] == "3..4"
    absent: Any = strategies.snakes()
    assert absent[0](Scripted(0)).stiffness is absent[0](Scripted(0)).damping is None
    absent = strategies.hostile_snakes()
    assert absent[0](Scripted(0)).stiffness is absent[0](Scripted(0)).damping is None


def test_wheels_of_hostile_snakes_are_straight_anywhere_or_next_to_across():
    def wheel(*picks: int) -> tuple[float, list[str]]:
        choices, left = Scripted(), list(picks)

        def one_of(among: Sequence[Any]) -> Any:
            choices.asked.append(f"of {tuple(among)}")
            return among[left.pop(0)]

        choices.one_of = one_of
        return module._wheel_angle(choices), choices.asked

    assert wheel(0, 1)[1] == [WHEEL, "of (0.0, -0.0)"]
    assert math.copysign(1.0, wheel(0, 1)[0]) == -1.0
    assert wheel(1) == (3.0, [WHEEL, "[-3.14159..3.14159]"])
    assert wheel(2, 1, 0)[0] == math.pi / 2
    assert wheel(2, 0, 1)[0] == -(math.pi / 2 - 1000.0)
    assert wheel(2, 0, 1)[1] == [WHEEL, "of (-1.0, 1.0)", EITHER, "[-16..-1]"]


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


def test_links_are_one_to_eight_by_default_and_of_no_account_to_a_scene_without_them(plain):
    choices = Scripted()
    make: Any = strategies.scenes(Sleigh, 0, -1)[0]  # type: ignore[index]
    assert isinstance(make(choices), Sleigh) and not any(".." in x[:5] for x in choices.asked[:1])
    make = strategies.scenes(ChainPendulum)[0]  # type: ignore[index]
    choices = Scripted()
    assert make(choices).links == 2 and choices.asked[0] == "1..8"


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
    monkeypatch.setattr(module, "scenes", lambda *given: given)
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
        module, "urdf_tree", lambda links, choices, *more: made.append((links, *more))
    )
    monkeypatch.setattr(module, "urdf_text", lambda tree: "text")
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
    state = ordinary_state(chain, Scripted(numbers=[0.1, 0.2, 0.3, 2.0, 1.0, -2.0, 3.0, 0.0]))
    assert state.q == pytest.approx([0.1 + 0.4 + 2, 0.2 + 0.8 + 2, 0.3 + 1.2 + 2])
    assert (state.v.tolist(), state.t, strategies.CURVATURE) == ([1.0, -2.0, 3.0], 0.0, 0.4)
    snake = Snake.coil(2)
    numbers = [5.0, -6.0, 0.1, 0.2, -1.0, 1.5, -0.5, 0.0]
    q, v, _ = ordinary_state(snake, Scripted(numbers=numbers))
    assert q == pytest.approx([5.0, -6.0, 0.1 + 0.4 - 1, 0.2 + 0.8 - 1])
    a = Evaluation(snake, q, 0 * q).terms.a
    assert v == pytest.approx(null_space(a) @ [1.5, -0.5])
    resting = Scripted(numbers=numbers)
    assert not ordinary_state(snake, resting, at_rest=True).v.any() and len(resting.asked) == 8
    one = consistent_state(snake, q, np.array([1.5]), 0.0)
    assert one.v == pytest.approx(null_space(a)[:, 0] * 1.5)
    many = consistent_state(snake, q, np.array([1.5, -0.5, 7.0]), 0.0)
    assert many.v == pytest.approx(v)
    bars = FourBarChain.example()
    near = bars.initial_state()[0] + 0.01
    same = ordinary_state(bars, Scripted(numbers=[*near, 3.0, *[0.5] * bars.p, 0.0]))
    assert np.abs(same.q - near).max() < 0.1, "a scene with ranges of its own is not turned"


def test_a_state_near_which_nothing_is_closed_is_no_case():
    def make(choices: Any) -> int:
        number = choices.one_of((12, 34))
        if number == 12:
            raise RefusedError("a", 0.0, 1.0, "no")
        return number

    assert set(draw_samples(strategies.strategy_of(make), 20, 0)) == {34}


@pytest.mark.parametrize("name", ["position", "angle", "speed", "time"])
def test_bounds_of_states_are_checked_each_by_its_name(name: str):
    with pytest.raises(InputError) as error:
        strategies.states(Snake.coil(2), **{name: -1.0})
    said = f"{name} = (0.0, -1.0), expected 0 <= low <= high, both finite"
    assert str(error.value) == said
    wrong: Any = 3
    with pytest.raises(InputError, match="scene"):
        strategies.states(wrong)


def test_strategies_for_states_are_made_of_these(plain):
    def asked(strategy: Any, pick: int, tiny: bool) -> list[str]:
        make, of_any_size = strategy
        choices = Scripted(pick)
        make(choices)
        assert of_any_size == tiny
        return choices.asked

    angle, speeds = "[-1..1]", 2 * ["[-5..5]"]
    found = asked(strategies.states(Snake.coil(2)), 0, False)
    wide = 2 * ["[-10..10]"]
    assert found == [*wide, angle, angle, "[-3.14159..3.14159]", *speeds, "[0..0]"]
    assert asked(strategies.states(TurntableBall.example(), time=3.0), 0, False)[-1] == "[0..3]"
    snake = Snake.coil(3)
    straight = asked(strategies.hostile_states(snake), 0, True)
    assert straight == [EITHER, "[-3.14159..3.14159]", EITHER, EITHER]
    speed = [EITHER, "of (-1.0, 1.0)", "[-150..150]"]
    anywhere = asked(strategies.hostile_states(snake), 1, True)
    assert anywhere == [EITHER, *5 * ["[-1e+09..1e+09]"], *speed, *speed]
    assert hostile_state(snake, Scripted(0)).q.tolist() == 5 * [3.0]


def test_velocities_are_drawn_where_dependent_rows_leave_motion_and_p_is_0():
    scene = Bricard(angle=1.0, redundant=1.0)
    assert scene.p == 0
    for strategy in (strategies.states(scene), strategies.hostile_states(scene)):
        assert any(state.v.any() for state in draw_samples(strategy, 20, 0))
