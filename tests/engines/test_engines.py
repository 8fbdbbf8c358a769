"""The engines: what they can represent, and that they are set up right."""

from __future__ import annotations

import importlib
import tomllib
from pathlib import Path
from typing import ClassVar, NamedTuple

import numpy as np
import pytest

from eomcheck import velocity
from eomcheck.claims.run import RunSelection
from eomcheck.engines import ALWAYS, ENGINES, Answers, asked_by_default, engine_of
from eomcheck.engines import casadi as casadi_engine
from eomcheck.engines.answers import inertia_size, mass_size
from eomcheck.errors import EngineError, UnknownNameError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import acceleration_sensitivity, sensitivity_of
from eomcheck.evaluation.tolerance import allowed_error, largest
from eomcheck.formulations import FORMULATIONS, kane
from eomcheck.numbers.generic import Array
from eomcheck.scenes import Snake

EVERY = asked_by_default(ENGINES)
every_engine = pytest.mark.parametrize("key", EVERY)
solving = pytest.mark.parametrize(
    "key",
    [key for key, engine in EVERY.items() if engine.offers("acceleration")],
)
solving_without_giving_way = pytest.mark.parametrize(
    "key",
    [
        key
        for key, engine in EVERY.items()
        if engine.offers("acceleration") and not engine.compliant
    ],
)
deriving_constraints = pytest.mark.parametrize(
    "key", [key for key, engine in EVERY.items() if engine.offers("forces")]
)

SNAKES = [
    Snake([2.0], [3.0], [0.7], None, [0.4]),
    Snake([1.0, 2.0], [1.0, 0.5], [0.1, 0.2], [4.0], [0.125, -0.5]),
    Snake([1.0, 2.0, 0.5], [1.0, 0.5, 2.0], [0.1, 0.2, 0.3], None, [0.125, -0.5, 1.0]),
    Snake.paper(),
]
snakes = pytest.mark.parametrize("snake", SNAKES, ids=lambda s: f"{s.links}")


class Treeless(Snake):
    """A snake that no tree of bodies describes."""

    key = "treeless"

    def tree(self):
        return None


def state(snake: Snake) -> Evaluation:
    q = np.array([0.4, -0.2, *(0.3 * np.arange(1, snake.links + 1) ** 1.5)])
    return Evaluation(snake, q, velocity(snake, q, [1.5, -0.75]))


def assert_close(found, expected, spread: float):
    assert np.shape(found) == np.shape(expected)
    assert np.abs(found - expected).max(initial=0.0) <= allowed_error(spread)
    assert allowed_error(spread) <= 1e-9 * max(1.0, largest(expected))


# ---- The registry --------------------------------------------------------------------------------


@pytest.mark.parametrize("key", ["bullet", "CASADI", "", None])
def test_an_unknown_engine_is_refused_with_all_that_are_known(key):
    with pytest.raises(UnknownNameError) as caught:
        engine_of(key)
    assert repr(key) in str(caught.value)
    assert all(known in str(caught.value) for known in ENGINES)


@every_engine
def test_an_engine_is_found_by_its_key_and_says_which_formulation_it_solves_like(key):
    engine = engine_of(key)
    assert engine is ENGINES[key]
    assert FORMULATIONS[engine.solves_like].uses == "terms"


@every_engine
def test_an_engine_names_its_library_and_version(key):
    name, version = ENGINES[key].version().split()
    assert name == key
    assert version[0].isdigit()


def test_every_engine_that_is_not_required_has_an_extra_and_is_in_the_extra_of_all():
    project = tomllib.loads(Path(__file__).parents[2].joinpath("pyproject.toml").read_text())
    extras = project["project"]["optional-dependencies"]
    wanted = {engine.extra for engine in EVERY.values() if engine.extra}
    assert [one for key in extras if key in wanted for one in extras[key]] == extras["engines"]
    assert wanted <= set(extras)
    required = " ".join(project["project"]["dependencies"])
    assert not any(extra in required for extra in wanted)


def test_engines_that_an_extra_installs_take_part_only_when_named():
    assert (
        {kind.key for kind in RunSelection.of().engines} == set(ALWAYS) == {"pinocchio", "casadi"}
    )
    assert [kind.key for kind in RunSelection.of(engines=["mujoco"]).engines] == ["mujoco"]


# ---- What an engine can represent ----------------------------------------------------------------


@every_engine
@snakes
def test_every_engine_represents_snakes(key, snake):
    assert ENGINES[key].represents(snake)


def test_an_engine_that_needs_a_tree_does_not_represent_a_scene_without_one():
    scene = Treeless([1.0, 1.0], [1.0, 1.0], [1.0, 1.0], None, [0.0, 0.0])
    # One that derives everything needs none.
    for engine in EVERY.values():
        assert engine.represents(scene) == engine.offers("forces")
        if engine.represents(scene):
            assert engine(scene).mass_matrix(np.zeros(4)).shape == (4, 4)
        else:
            with pytest.raises(EngineError, match=r"treeless\[2\]"):
                engine(scene)


@every_engine
def test_a_library_that_is_missing_is_an_engine_error_that_names_it(key, monkeypatch):
    def missing(name: str, *_):
        raise ImportError(f"no {name} here")

    monkeypatch.setattr(casadi_engine, "_MODELS", {})
    monkeypatch.setattr(importlib, "import_module", missing)
    for use in (ENGINES[key].version, lambda: ENGINES[key](SNAKES[0])):
        with pytest.raises(EngineError, match=key):
            use()


def test_casadi_keeps_models_of_snakes_with_and_without_springs_and_dampers_apart(monkeypatch):
    """Two that have as many numbers: one with a spring, one with a damper."""
    monkeypatch.setattr(casadi_engine, "_MODELS", {})
    q, v = np.array([0.3, -5.0, 0.5, 0.75]), np.array([1.0, 0.2, -0.5, 1.5])
    for spring, damper in [(4.0, 0.0), (0.0, 4.0), (3.0, 2.0), (0.0, 0.0)]:
        terms = [spring] if spring else None, [0.125, -0.5], [damper] if damper else None
        scene = Snake([1.0, 2.0], [1.0, 0.5], [0.1, 0.2], terms[0], terms[1], damping=terms[2])
        moment = spring * 0.25 + damper * 2.0
        forces = casadi_engine.CasadiEngine(scene).forces(q, v)
        assert forces.tolist() == [0.0, 0.0, moment, -moment]


class Lengths(NamedTuple):
    """Parameters of a chain of some links, and of the springs between them."""

    length: Array
    stiffness: Array


def test_casadi_keeps_models_of_parameters_of_other_lengths_apart(monkeypatch):
    made = list[int]()

    def model(scene):
        made.append(Chain.lengths)
        return {}

    class Chain(Snake):
        lengths: ClassVar[int] = 1

        def parameters(self, numbers):
            return Lengths(np.zeros(Chain.lengths), np.zeros(3 - Chain.lengths))

    monkeypatch.setattr(casadi_engine, "_MODELS", {})
    monkeypatch.setattr(casadi_engine, "_symbolic_model", model)
    for count in (1, 2, 1):
        Chain.lengths = count
        casadi_engine.CasadiEngine(Chain.example())
    assert made == [1, 2]


# ---- One link, by hand ---------------------------------------------------------------------------

ANGLES = pytest.mark.parametrize("theta", [0.0, 0.7, 2.5, -1.2])


@every_engine
@ANGLES
def test_an_engine_has_the_mass_matrix_and_bias_of_a_single_link(key, theta):
    m, L, inertia, omega = 2.0, 3.0, 0.7, -0.8
    snake = Snake([m], [L], [inertia], None, [0.4])
    engine = Answers(ENGINES[key](snake))
    q, v = np.array([0.3, -5.0, theta]), np.array([1.1, 0.2, omega])
    cos, sin = np.cos(theta), np.sin(theta)
    moment = m * L / 2
    M = [
        [m, 0.0, -moment * sin],
        [0.0, m, moment * cos],
        [-moment * sin, moment * cos, inertia + moment * L / 2],
    ]
    B = [-moment * cos * omega**2, -moment * sin * omega**2, 0.0]
    assert_close(engine.mass_matrix(q), np.array(M), 4 * largest(M))
    assert_close(engine.bias(q, v), np.array(B), inertia_size(Evaluation(snake, q, v)))


@solving_without_giving_way
@ANGLES
def test_an_engine_has_the_acceleration_and_multiplier_of_a_single_link_on_its_wheel(key, theta):
    m, L, alpha, s, omega = 2.0, 3.0, 0.4, 1.5, -0.8
    snake = Snake([m], [L], [0.7], None, [alpha])
    q = np.array([0.3, -5.0, theta])
    at = Evaluation(snake, q, velocity(snake, q, [s, omega]))
    result = Answers(ENGINES[key](snake)).acceleration(
        at.q, at.v, np.zeros(3), at.terms.a, at.terms.gamma
    )
    axle = np.array([np.sin(alpha + theta), -np.cos(alpha + theta)])
    link = np.array([np.cos(theta), np.sin(theta)])
    expected = np.array([*(-s * omega * axle + L / 2 * omega**2 * link), 0.0])
    spread = acceleration_sensitivity(at, FORMULATIONS["au"], coordinates=True)
    assert_close(result.vdot, expected, spread)
    spread = acceleration_sensitivity(at, FORMULATIONS["au"], "multipliers", coordinates=True)
    assert_close(result.multipliers, np.array([-m * s * omega]), spread)


# ---- Every snake ---------------------------------------------------------------------------------


@every_engine
@snakes
def test_an_engine_has_the_mass_matrix_and_bias_of_the_scene(key, snake):
    at = state(snake)
    engine = Answers(ENGINES[key](snake))
    spread = sensitivity_of(at, lambda e: e.terms.M, coordinates=True)
    assert_close(
        engine.mass_matrix(at.q),
        at.terms.M,
        spread + mass_size(at, engine.velocity_map(at.q, at.v).S),
    )
    spread = sensitivity_of(at, lambda e: e.terms.B, coordinates=True)
    assert_close(engine.bias(at.q, at.v), at.terms.B, spread + inertia_size(at))


@deriving_constraints
@snakes
def test_an_engine_derives_the_forces_and_constraints_of_the_scene(key, snake):
    at = state(snake)
    engine = Answers(ENGINES[key](snake))
    Q = np.zeros(snake.n) if at.terms.Q is None else at.terms.Q
    spread = (
        0.0 if at.terms.Q is None else sensitivity_of(at, lambda e: e.terms.Q, coordinates=True)
    )
    assert_close(engine.forces(at.q, at.v), Q, spread)
    spread = sensitivity_of(at, lambda e: e.terms.a, coordinates=True)
    assert_close(engine.constraint_jacobian(at.q, at.v), at.terms.a, spread)
    spread = sensitivity_of(at, lambda e: e.terms.gamma, coordinates=True)
    assert_close(engine.constraint_drift(at.q, at.v), at.terms.gamma, spread)


@deriving_constraints
@snakes
def test_an_engine_differentiates_the_inertia_remainder_of_kanes_equations(key, snake):
    at = state(snake)
    found, size, condition = Answers(ENGINES[key](snake)).kane_inertia_remainder(at.q, at.v)
    assert condition >= 1.0

    def remainder(e: Evaluation):
        return kane.inertia_sums(*e.bodies[:-1])[1]

    ours = sensitivity_of(at, remainder, coordinates=True)
    assert_close(found, remainder(at), condition * (ours + size))


@solving_without_giving_way
@snakes
def test_an_engine_has_the_acceleration_of_every_formulation(key, snake):
    at = state(snake)
    engine = ENGINES[key](snake)
    answers = Answers(engine)
    Q = np.zeros(snake.n) if at.terms.Q is None else at.terms.Q
    found = answers.acceleration(at.q, at.v, Q, at.terms.a, at.terms.gamma)
    like = FORMULATIONS[engine.solves_like]
    T = answers.velocity_map(at.q, at.v).S
    theirs = sensitivity_of(at, lambda e: e.acceleration_in(like, T).vdot, coordinates=True)
    for formulation in FORMULATIONS.values():
        expected = at.acceleration(formulation)
        ours = acceleration_sensitivity(at, formulation, coordinates=True)
        assert_close(found.vdot, expected.vdot, ours + theirs)


@every_engine
def test_two_snakes_of_one_size_do_not_share_parameters(key):
    light, heavy = (Snake([m], [1.0], [1.0], None, [0.0]) for m in (1.0, 5.0))
    engines = [Answers(ENGINES[key](snake)) for snake in (light, heavy)]
    assert [engine.mass_matrix(np.zeros(3))[0, 0] for engine in engines] == [1.0, 5.0]


@solving
def test_an_engine_changes_neither_the_state_nor_what_it_is_handed(key):
    at = state(SNAKES[1])
    Q, a, gamma = at.terms.Q, at.terms.a, at.terms.gamma
    arrays = [at.q, at.v, Q, a, gamma]
    before = [x.copy() for x in arrays]
    engine = Answers(ENGINES[key](SNAKES[1]))
    engine.acceleration(*arrays)
    engine.bias(at.q, at.v)
    assert all(np.array_equal(x, y) for x, y in zip(arrays, before, strict=True))
