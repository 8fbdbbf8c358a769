"""Compiled code: it says what the interpreted path says, never raises, and is kept on disk."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eomcheck import acceleration, velocity
from eomcheck.arithmetic.float64 import FLOAT64, angles, compiled
from eomcheck.errors import RefusedError
from eomcheck.evaluate import Evaluation
from eomcheck.formulations import FORMULATIONS
from eomcheck.motion.right_hand_side import net_force, right_hand_side
from eomcheck.motion.right_hand_side import velocity as velocity_of_speeds
from eomcheck.scenes import Snake
from eomcheck.tolerance import allowed_error

every_formulation = pytest.mark.parametrize("key", FORMULATIONS)
PARTITIONED = [f.key for f in FORMULATIONS.values() if f.partitioned]


def uneven(links: int, springs: bool) -> Snake:
    random = np.random.default_rng(links)

    def between(low: float, high: float, size: int) -> np.ndarray:
        return random.uniform(low, high, size)

    return Snake(
        between(0.5, 2.0, links),
        between(0.5, 2.0, links),
        between(0.1, 0.5, links),
        between(1.0, 50.0, links - 1) if springs else None,
        between(-0.5, 0.5, links),
        between(-0.7, 0.7, links),
    )


SNAKES = [
    uneven(1, springs=False),
    uneven(2, springs=True),
    uneven(2, springs=False),
    uneven(7, springs=True),
    uneven(7, springs=False),
    Snake.paper(),
]
snakes = pytest.mark.parametrize(
    "snake", SNAKES, ids=lambda s: f"{s.links}-{'free' if s.stiffness is None else 'springs'}"
)


def rate(snake: Snake, key: str, q, v):
    """Return (q̇, rate of the speeds) by compiled code, speeds being v or u."""
    formulation = FORMULATIONS[key]
    at = Evaluation(snake, q, v)
    function = right_hand_side(snake, formulation)
    return function(snake.parameters(FLOAT64), at.q, at.speeds_read(formulation), 0.0, at.partition)


def state(snake: Snake):
    q, _ = snake.initial_state()
    return q, velocity(snake, q, [1.5, -0.5])


@pytest.mark.parametrize(
    ("snake", "key"),
    # Without springs one that reads Lagrange's terms will do, and one that does not.
    [
        (snake, key)
        for snake in SNAKES
        for key in (FORMULATIONS if snake.stiffness is not None else ("au", "kane"))
    ],
    ids=lambda x: x if isinstance(x, str) else f"{x.links}-{x.stiffness is not None}",
)
def test_the_compiled_right_hand_side_gives_the_acceleration_of_the_public_path(snake, key):
    q, v = state(snake)
    expected = acceleration(snake, key, q, v)
    qdot, speeds_rate = rate(snake, key, q, v)
    at = Evaluation(snake, q, v)
    vdot = speeds_rate
    if FORMULATIONS[key].in_speeds:
        vdot = at.speeds.W @ speeds_rate + at.speeds.rest
    elif FORMULATIONS[key].uses == "chain":
        vdot = snake.chain_acceleration(at.parameters, at.prepared, at.x, speeds_rate)
    assert np.abs(vdot - expected.vdot).max() <= 2 * expected.error_bound
    assert expected.error_bound < 1e-6
    assert np.abs(qdot - v).max() <= allowed_error(at.spread(lambda e: e.velocity))


@every_formulation
def test_the_compiled_right_hand_side_is_made_once_for_all_snakes(key):
    formulation = FORMULATIONS[key]
    assert right_hand_side(SNAKES[0], formulation) is right_hand_side(SNAKES[-1], formulation)


@pytest.mark.parametrize("key", PARTITIONED)
@pytest.mark.parametrize("links", [2, 3, 7])
def test_at_a_singular_pose_the_compiled_right_hand_side_gives_nan_and_does_not_raise(key, links):
    one = np.ones(links)
    snake = Snake(one, one, one, one[1:], 0 * one)
    q = np.array([0.0, 0.0, *[0.3] * links])
    v = velocity(snake, q, [1.0, 0.0])
    with pytest.raises(RefusedError):
        acceleration(snake, key, q, v)
    qdot, vdot = rate(snake, key, q, v)
    assert np.array_equal(qdot, v)
    assert np.isnan(vdot).any()


@every_formulation
def test_the_compiled_right_hand_side_does_not_raise_on_nan(key):
    snake = SNAKES[1]
    q, v = state(snake)
    q[2] = np.nan
    formulation = FORMULATIONS[key]
    at = Evaluation(snake, np.zeros(snake.n), v)
    speeds, partition = at.speeds_read(formulation), at.partition
    rates = right_hand_side(snake, formulation)(
        snake.parameters(FLOAT64), q, speeds, 0.0, partition
    )
    assert np.isnan(rates[1]).all()


@snakes
def test_compiled_scene_functions_give_what_they_give_uncompiled(snake):
    q, v = state(snake)
    at = Evaluation(snake, q, v)
    here = (at.parameters, at.prepared)
    kinematics = snake.kinematics(*here, at.q, at.u)
    for name, arguments in {
        "terms": (*here, at.q, at.v),
        "kinematics": (*here, at.q, at.u),
        "speeds": (*here, kinematics),
        "bodies": (*here, kinematics),
        "velocities": (*here, at.q, at.v),
        "energies": (*here, at.q, at.v),
    }.items():
        function = getattr(snake, name)
        fields = zip(function(*arguments), compiled(function)(*arguments), strict=True)
        for i, (expected, found) in enumerate(fields):
            assert (expected is None) == (found is None), (name, i)
            if expected is not None:
                rounding = snake.n * max(1.0, np.abs(expected).max(initial=0.0))
                spread = allowed_error(rounding * np.linalg.norm(at.speeds.W, 1))
                assert np.shape(found) == np.shape(expected), (name, i)
                assert np.abs(found - expected).max(initial=0.0) <= spread, (name, i)


def call_net_force(M, Q, B):
    return net_force(M, Q, B)


def call_velocity(u, W, offset):
    return velocity_of_speeds(u, W, offset)


IN_EVERY_WAY = ("python", "compiled", "called in compiled code")


def in_every_way(function, caller):
    return pytest.mark.parametrize(
        "function",
        [lambda: function, lambda: compiled(function), lambda: compiled(caller)],
        ids=IN_EVERY_WAY,
    )


@in_every_way(net_force, call_net_force)
def test_the_net_force_leaves_out_what_is_absent(function):
    M, Q, B = np.eye(2), np.array([1.0, 2.0]), np.array([0.5, -1.0])
    assert function()(M, Q, B).tolist() == [0.5, 3.0]
    assert function()(M, None, B).tolist() == [-0.5, 1.0]
    assert function()(M, Q, None).tolist() == [1.0, 2.0]
    assert function()(M, None, None).tolist() == [0.0, 0.0]


@in_every_way(velocity_of_speeds, call_velocity)
def test_the_velocity_leaves_out_what_is_absent(function):
    W, u = np.array([[1.0], [2.0]]), np.array([3.0])
    assert function()(u, None, None).tolist() == [3.0]
    assert function()(u, W, None).tolist() == [3.0, 6.0]
    assert function()(u, W, np.array([1.0, -1.0])).tolist() == [4.0, 5.0]


KERNEL = """
import numpy as np
from eomcheck.arithmetic.float64 import compiled
from eomcheck.scenes.snake_terms import forces

kernel = compiled(forces)
found = kernel(np.array([2.0]), None, np.array([1.0, 0.0]), np.zeros(2))
assert found.tolist() == [0.0, 0.0, -2.0, 2.0]
print(sum(kernel.stats.cache_hits.values()), sum(kernel.stats.cache_misses.values()))
"""


def run_kernel(directory: Path) -> str:
    done = subprocess.run(
        [sys.executable, "-c", KERNEL],
        env=os.environ | {"NUMBA_CACHE_DIR": str(directory)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert not done.stderr
    return done.stdout.strip()


def test_compiled_code_is_kept_on_disk_and_a_second_process_compiles_nothing(tmp_path):
    assert run_kernel(tmp_path) == "0 1"
    assert run_kernel(tmp_path) == "1 0"


SCENE = """
from eomcheck.arithmetic.generic import generic


@generic
def inner(x):
    return {factor} * x


@generic
def outer(x):
    return inner(x)
"""

USE = """
import numpy as np
from eomcheck.arithmetic.float64 import compiled
from scene import outer

print(compiled(outer)(np.array([1.0]))[0])
"""


def test_compiled_code_of_a_users_own_functions_is_not_used_once_they_are_edited(tmp_path):
    for factor in (2, 3):
        (tmp_path / "scene.py").write_text(SCENE.format(factor=factor), encoding="utf-8")
        done = subprocess.run(
            [sys.executable, "-c", USE],
            cwd=tmp_path,
            env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")},
            capture_output=True,
            text=True,
            check=True,
        )
        assert float(done.stdout) == factor


def test_compiled_code_of_older_sources_is_not_used(tmp_path):
    run_kernel(tmp_path)
    (stamped,) = (path for path in tmp_path.iterdir() if path.is_dir())
    stamped.rename(tmp_path / "numba-of-older-sources")
    assert run_kernel(tmp_path) == "0 1"


def test_code_compiled_for_a_scene_of_a_lost_module_does_not_stand_in_the_way(tmp_path):
    """Its argument types cannot even be read from the index of the cache."""
    module = tmp_path / "lost.py"
    module.write_text(
        "from typing import Any, NamedTuple\n\nclass Mine(NamedTuple):\n"
        "    cos: Any\n    sin: Any\n    value: Any\n",
        encoding="utf-8",
    )
    code = """
import sys
import numpy as np
from eomcheck.arithmetic.float64 import compiled
from eomcheck.model import Angles
from eomcheck.scenes.snake import Parameters
from eomcheck.scenes.snake_speeds import speeds_of
one = np.ones(2)
snake = Parameters(one, one, one, None, None, one, 0 * one)
if sys.argv[1] == "mine":
    from lost import Mine as Angles
call = compiled(speeds_of)
print(call(snake, Angles(cos=one, sin=0 * one, value=one), np.ones(4), np.ones(4))[1])
print(call.stats.cache_hits.total())
"""

    def run(which: str) -> list[str]:
        environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
        if which == "mine":
            environment |= {"PYTHONPATH": str(tmp_path)}
        command = [sys.executable, "-c", code, which]
        done = subprocess.run(command, capture_output=True, text=True, env=environment)
        assert done.returncode == 0, done.stderr
        return done.stdout.split()

    assert run("mine") == ["1.0", "0"]
    assert run("theirs") == ["1.0", "0"]
    assert run("theirs") == ["1.0", "1"]


def test_closures_over_different_functions_have_different_names():
    """numba numbers functions anew in every process.

    Two of one name, cached by two processes, would share their symbols in a third.
    """
    snake = SNAKES[0]
    functions: list[Any] = [compiled(f) for f in (snake.terms, snake.kinematics, snake.speeds_of)]
    functions += [right_hand_side(snake, f) for f in FORMULATIONS.values()]
    names = [function.py_func.__qualname__ for function in functions]
    assert len(set(names)) == len(names), names


def test_compiled_angles_have_the_cosines_and_sines_of_the_c_library():
    x = np.array([0.0, 0.5, -3.0, 1e8, 1e300])
    _, cos, sin = compiled(angles)(x)
    assert cos.tolist() == [math.cos(t) for t in x]
    assert sin.tolist() == [math.sin(t) for t in x]
