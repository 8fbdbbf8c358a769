"""Functions, claims about them and what they are compared with, against tables written by hand."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eomcheck.claims.registry import FUNCTION_CLAIMS, ClaimRegistry, FunctionClaim, has_any
from eomcheck.engines import ENGINES, Engine
from eomcheck.errors import InputError, UnknownNameError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.mechanics.records import State
from eomcheck.scenes import SCENES, Sleigh, Snake, TurntableBall
from eomcheck.testing import EquationsOfMotion, check, function_checks
from eomcheck.testing.converters import from_engine, from_scene, reference_functions
from eomcheck.testing.equations_of_motion import (
    INPUTS,
    MAY_READ_MORE,
    MOST_STATES,
    OPTIONS,
    ComparedEquations,
    checked_states,
    equations_from,
)
from eomcheck.testing.handed_over import HANDED_OVER, weighs_alone

# ---- Functions -----------------------------------------------------------------------------------


def test_each_input_reads_answers_and_is_called_what_the_guide_says():
    assert {name: (one.reads, "".join(one.shape), one.what) for name, one in INPUTS.items()} == {
        "M": ("q", "pp", "mass matrix"),
        "bias": ("qv", "p", "bias"),
        "gravity": ("q", "p", "gravity"),
        "C": ("qv", "pp", "Coriolis matrix"),
        "qdd": ("qv", "p", "acceleration"),
        "T": ("qv", "", "kinetic energy"),
        "U": ("q", "", "potential energy"),
        "R": ("qv", "", "dissipation function"),
        "Q": ("qv", "p", "generalized forces"),
        "a": ("q", "rp", "constraint Jacobian"),
        "b": ("t", "r", "constraint velocity"),
        "c": ("q", "r", "constraint"),
        "gamma": ("qv", "r", "constraint drift"),
        "qdot": ("qv", "n", "rates of the coordinates"),
        "inverse_dynamics": ("qva", "p", "inverse dynamics"),
        "tau_q": ("qva", "pp", "derivative ∂τ/∂q"),
        "tau_v": ("qva", "pp", "derivative ∂τ/∂v"),
        "qdd_q": ("qv", "pp", "derivative ∂q̈/∂q"),
        "qdd_v": ("qv", "pp", "derivative ∂q̈/∂v"),
        "qdd_tau": ("qv", "pp", "derivative ∂q̈/∂τ"),
        "inverse_mass_matrix": ("q", "pp", "inverse mass matrix"),
        "regressor": ("qva", "pk", "regressor"),
        "parameters": ("", "k", "inertial parameters"),
        "mass": ("", "", "total mass"),
        "com": ("q", "3", "center of mass"),
        "com_jacobian": ("q", "3p", "Jacobian of the center of mass"),
        "com_velocity": ("qv", "3", "velocity of the center of mass"),
        "com_acceleration": ("qva", "3", "acceleration of the center of mass"),
        "momentum_matrix": ("q", "6p", "momentum matrix"),
        "momentum": ("qv", "6", "momentum"),
        "momentum_rate": ("qva", "6", "rate of the momentum"),
        "frame_placement": ("q", "f34", "frame placement"),
        "J": ("q", "f6p", "frame Jacobian"),
        "frame_velocity": ("qv", "f6", "frame velocity"),
        "frame_bias": ("qv", "f6", "frame bias"),
        "frame_acceleration": ("qva", "f6", "frame acceleration"),
    }
    assert MAY_READ_MORE == {
        **{"b": "qt", "c": "qv", "gravity": "qv", "qdd": "qvf"},
        **{"qdd_q": "qvf", "qdd_v": "qvf", "qdd_tau": "qvf"},
    }
    more = "bias_has_gravity", "speeds", "holonomic", "coriolis_skew", "derived", "ranges"
    names = "coordinates", "velocities", "name"
    assert (*INPUTS, *more, *names, "factory", "array") == OPTIONS


def test_functions_are_called_by_their_name_and_what_is_given_in_the_order_of_the_table():
    one = equations_from(3, {"qdd": len, "M": len, "name": "arm"})
    assert one.given == ("M", "qdd") and one.structure == "arm: M, qdd"
    assert repr(one) == "<arm: M, qdd>" and one.function("M") is len
    assert one.function("T") is None
    assert (EquationsOfMotion(2, M=len, speeds=2).p, EquationsOfMotion(10_000, M=len).p) == (
        2,
        10_000,
    )
    with pytest.raises(UnknownNameError) as error:
        equations_from(2, {"n": 3})
    assert str(error.value) == f"unknown argument 'n'; known: {', '.join(OPTIONS)}"


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"n": 10_001, "M": len}, "n = 10001, expected at most 10000"),
        (
            {"qdot": len, "speeds": 0},
            "speeds = 0, expected a whole number of at least 1",
        ),
        ({"qdot": len, "speeds": 10_001}, "speeds = 10001, expected at most 10000"),
        (
            {"M": len, "speeds": 3},
            "speeds = 3 without qdot(q, u), which would tell how 2 coordinates move with them",
        ),
        ({}, f"no function is given, expected at least one of {', '.join(INPUTS)}"),
        ({"M": 3}, "M = 3, expected a function"),
        ({"M": len, "array": 3}, "array = 3, expected a function"),
        ({"M": len, "coriolis_skew": 2}, "coriolis_skew = 2, expected True or False"),
        ({"mass": np.nan}, "mass = nan, expected a function or a finite number"),
        ({"mass": [1.0]}, "mass = [1.0], expected a function or a finite number"),
        ({"parameters": []}, "parameters = [], expected a function or finite numbers"),
        ({"mass": "m"}, "mass = 'm', expected a function or a finite number"),
        ({"J": {}}, "J = {}, expected a function or a dict, name of a frame -> function"),
        (
            {"J": {"tool": 2}},
            "J = {'tool': 2}, expected a function or a dict, name of a frame -> function",
        ),
        ({"M": len, "bias_has_gravity": True}, "bias_has_gravity = True, but no bias is given"),
        ({"M": len, "coordinates": "x"}, "coordinates = 'x', expected 2 different names"),
        (
            {"M": len, "coordinates": ["x", "x"]},
            "coordinates = ['x', 'x'], expected 2 different names",
        ),
        ({"M": len, "velocities": [""]}, "velocities = [''], expected 2 different names"),
        (
            {"qdot": len, "speeds": 1, "ranges": [(0, 1)]},
            "ranges = [(0, 1)], expected (low, high) with low < high, or 2 such pairs for the "
            "coordinates, or 3 with the velocities",
        ),
    ],
)
def test_functions_that_cannot_be_are_refused_in_a_sentence(given, message):
    with pytest.raises(InputError) as error:
        EquationsOfMotion(**{"n": 2} | given)
    assert str(error.value) == message


def test_compared_functions_are_what_they_were_beside_what_they_are_compared_with():
    own = EquationsOfMotion(
        3, M=len, qdot=abs, speeds=2, ranges=(0.0, 2.0), name="arm", derived=True
    )
    made = ComparedEquations.of(own, "a scene")
    assert made.against == "a scene" and made.given == own.given
    for name in ("n", *OPTIONS):
        assert getattr(made, name) is getattr(own, name), name


def test_states_are_a_number_or_pairs_of_coordinates_and_velocities():
    own = EquationsOfMotion(2, qdot=len, speeds=1)
    assert checked_states(own, np.int64(7)) == 7
    assert checked_states(own, MOST_STATES) == MOST_STATES == 1_000_000
    (one, other) = checked_states(own, iter([([1, 2], [3]), (np.ones(2), np.zeros(1))]))  # type: ignore[misc]
    assert isinstance(one, State) and one.t == 0.0
    assert [x.tolist() for x in one[:2]] == [[1.0, 2.0], [3.0]]
    assert [x.tolist() for x in other[:2]] == [[1.0, 1.0], [0.0]]
    with pytest.raises(InputError, match=r"^states = 1000001, expected at most 1000000$"):
        checked_states(own, 1_000_001)
    with pytest.raises(InputError) as error:
        checked_states(own, [([1, 2], [3, 4])])
    assert str(error.value) == (
        "states = [([1, 2], [3, 4])], expected a number of at least 1 or a list of (q, v) of 2 "
        "and 1 finite numbers"
    )


# ---- Claims about them ---------------------------------------------------------------------------


def there(*names: str) -> Any:
    """Return what stands for a point at which these quantities are."""
    return SimpleNamespace(has=lambda name: name in names)


def test_a_claim_applies_where_all_it_needs_is_there_and_nothing_that_breaks_it():
    claims = ClaimRegistry(FunctionClaim)
    claim = partial(claims.register, "evaluate")

    def look(at: Any) -> Any:
        yield from ()

    how: dict[str, Any] = {"natural": True, "blind_spots": ("x",)}
    register = claim("one", "M = Mᵀ", "M", ("M", "T|U"), without=("a", "b"), **how)
    assert register(look) is look
    one = claims["one"]
    assert one == FunctionClaim(
        "one",
        "M = Mᵀ",
        "M",
        ("M", "T|U"),
        ("a", "b"),
        True,
        False,
        ("x",),
        look,  # type: ignore[arg-type]
    )
    claim("other", "s", "t", consistent=True)(look)
    other = claims["other"]
    assert other == FunctionClaim("other", "s", "t", (), (), False, True, (), look)
    for names, applies in (
        (("M", "T"), True),
        (("M", "U"), True),
        (("M", "T", "U"), True),
        (("M",), False),
        (("T", "U"), False),
        (("M", "U", "a"), False),
        (("M", "U", "b"), False),
        (("M", "U", "c"), True),
    ):
        assert one.applies(there(*names)) == applies, names
        assert other.applies(there(*names))
    assert has_any(there("T"), "M|T") and has_any(there("M"), "M|T")
    assert not has_any(there("M|T", "U"), "M|T")


def test_every_claim_needs_and_is_broken_by_what_there_is():
    assert len(function_checks.FUNCTION_CLAIMS) == len(FUNCTION_CLAIMS) > 20, (
        "running them registers all"
    )
    known = {*INPUTS, "against", "factory", "tau"}
    for one in FUNCTION_CLAIMS.values():
        for names in (*one.needs, *one.without):
            assert {*names.split("|")} <= known, (one.id, names)
        assert all(x.about in {*INPUTS, ""} for x in one.blind_spots), one.id


# ---- What they are compared with -----------------------------------------------------------------

OF_SCENE = {*HANDED_OVER, "parameters", "mass"}
OF_EQUATIONS = {"tau_q", "tau_v", "qdd_q", "qdd_v", "qdd_tau", "inverse_dynamics"} | {
    "inverse_mass_matrix"
}
OF_SCENES = {
    "snake": "M bias gravity qdd T U a c gamma",
    "chain-pendulum": "M bias gravity qdd T U",
    "sleigh": "M bias qdd T a c gamma",
    "turntable-ball": "M bias qdd T a b c gamma",
    "flyball-governor": "M bias gravity qdd T U R",
}


@pytest.mark.parametrize("key", OF_SCENES)
def test_a_scene_gives_the_functions_that_it_has(key):
    scene = SCENES[key].example()
    made = from_scene(scene)
    terms = [name for name in made.given if name == "qdd" or name not in OF_SCENE]
    assert (made.n, made.name, " ".join(terms)) == (scene.n, scene.name, OF_SCENES[key])
    has_tree = scene.tree() is not None
    more = OF_SCENE if has_tree else {name for name in OF_SCENE if name in OF_EQUATIONS}
    alone = {"regressor", "parameters"} if weighs_alone(scene) else set()
    assert {*made.given} - {*terms} == more - {"qdd"} - {"regressor", "parameters"} | alone


class Pushed(Sleigh, functions=()):
    """A sleigh with forces that nothing in it explains."""

    @staticmethod
    def terms(parameters, angle, q, v):
        """Return its terms with forces."""
        found = Sleigh.terms(parameters, angle, q, v)
        return found._replace(Q=np.array([q[0], 2 * v[1], 5.0]), B=None)


def test_forces_without_an_energy_are_told_as_they_are_and_a_bias_that_is_not_there_is_0():
    usual = Sleigh.example()
    scene = Pushed(mass=usual.mass, inertia=usual.inertia, offset=usual.offset)
    made: Any = from_scene(scene)
    q, v = np.array([0.5, 1.0, 0.25]), np.array([3.0, 7.0, -1.0])
    assert "Q" in made.given and "gravity" not in made.given
    assert made.Q(q, v).tolist() == [0.5, 14.0, 5.0]
    assert made.bias(q, v).tolist() == [0.0, 0.0, 0.0]


def test_functions_of_a_scene_are_its_terms_at_rest_and_in_motion():
    scene = SCENES["flyball-governor"].example()
    made: Any = from_scene(scene)
    q, v = (np.asarray(x) for x in scene.initial_state())
    v = v + np.array([0.5, -0.25, 0.125, 0.75])
    moving, still = Evaluation(scene, q, v, 0.0), Evaluation(scene, q, 0 * v, 0.0)
    assert np.array_equal(made.M(q), still.terms.M)
    assert np.array_equal(made.bias(q, v), moving.terms.B)
    assert np.array_equal(made.gravity(q), -still.terms.Q)
    kinetic, potential = scene.energies(moving.parameters, moving.prepared, moving.q, moving.v)
    assert (made.T(q, v), made.U(q), made.R(q, v)) == (kinetic, potential, moving.dissipation(v))
    left = made.M(q) @ made.qdd(q, v) + made.bias(q, v)
    assert left == pytest.approx(moving.terms.Q, rel=1e-9, abs=1e-9)


def test_functions_of_a_driven_scene_are_at_time_0_but_what_the_clock_drives():
    scene = TurntableBall(swing=1.0, frequency=3.0)
    made: Any = from_scene(scene)
    q, v = np.arange(5.0) / 8, np.arange(5.0)
    zero = np.zeros(5)
    at = Evaluation(scene, q, v, 0.0)
    assert np.array_equal(made.a(q), Evaluation(scene, q, zero, 0.0).terms.a)
    assert np.array_equal(made.gamma(q, v), at.terms.gamma)
    later = Evaluation(scene, q, zero, 0.5).terms.b
    assert np.array_equal(made.b(q, 0.5), later) and not np.array_equal(made.b(q, 0.0), later)
    c = scene.constraint(at.parameters, at.prepared, at.q, at.v)
    assert np.array_equal(made.c(q, v), c)


def test_an_engine_gives_what_it_overrides_and_constraints_only_where_there_are_any():
    class Few(Engine):
        """An engine that tells forces and one Jacobian beside what it must."""

        key = "few"

        @classmethod
        def version(cls):
            """Return one."""
            return "few 1"

        @classmethod
        def represents(cls, scene):
            """Return that it can be any."""
            return True

        def mass_matrix(self, q, t=0.0):
            """Return 2 and the number of coordinates."""
            return np.full((self.scene.n, self.scene.n), 2.0)

        def bias(self, q, v, t=0.0):
            """Return the velocities."""
            return v

        def forces(self, q, v, t=0.0):
            """Return the coordinates."""
            return q

        def constraint_jacobian(self, q, v, t=0.0):
            """Return the sum of both, of zero velocities."""
            return (q + v)[None, :]

    made: Any = from_engine(Few(Sleigh.example()))
    assert made.name == "few of sleigh" and made.given == ("M", "bias", "Q", "a")
    q, v = np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0])
    assert made.Q(q, v).tolist() == [1.0, 2.0, 3.0] and made.bias(q, v).tolist() == [4.0, 5.0, 6.0]
    assert made.a(q).tolist() == [[1.0, 2.0, 3.0]]
    free = from_engine(Few(SCENES["chain-pendulum"].example()))
    assert free.given == ("M", "bias", "Q")


@pytest.mark.parametrize(
    ("against", "hint"),
    [
        (3, ""),
        ({"M": 1}, "; of functions make one: EquationsOfMotion(n, M=M, ...)"),
        (("casadi", 3), ""),
    ],
)
def test_what_nothing_can_be_compared_with_is_refused_in_a_sentence(against, hint):
    with pytest.raises(InputError) as error:
        reference_functions(against)
    assert str(error.value) == (
        f"against = {against!r}, expected a scene, an engine made for one, (engine, scene), or "
        f"EquationsOfMotion{hint}"
    )


@pytest.mark.parametrize(
    ("subject", "message"),
    [
        (Sleigh, "a scene class: eomcheck.validate and eomcheck.check_state check a scene of it"),
        (
            Sleigh.example(),
            "a scene: eomcheck.validate checks it in random states, eomcheck.check_state in one",
        ),
        (
            ENGINES["casadi"],
            "an engine: eomcheck.validate(scene, engines=[...]) compares it with a scene",
        ),
        ({"M": len}, "a dict: of functions call eomcheck.testing.check_functions(n, **functions)"),
        (
            len,
            "a single function: call eomcheck.testing.check_functions(n, M=...), or bias=...",
        ),
        (
            1.0,
            "expected EquationsOfMotion, a KanesMethod or LagrangesMethod of SymPy, or the name "
            "FILE.py or FILE.py:NAME of a file with one or with functions",
        ),
    ],
)
def test_each_wrong_subject_of_a_check_is_told_what_checks_it(subject: Any, message: str):
    with pytest.raises(InputError) as error:
        check(subject)
    assert str(error.value) == f"subject = {subject!r}, {message}"


def test_a_name_that_a_file_has_not_is_reported_with_the_nearest_one(tmp_path: Path):
    file = tmp_path / "swing.py"
    file.write_text("pendulum = {}\n")
    with pytest.raises(InputError) as error:
        check(f"{file}:pendulm")
    assert str(error.value) == f"{str(file)!r} has no 'pendulm' (did you mean 'pendulum'?)"
    with pytest.raises(InputError, match="has none of the functions that are checked"):
        check(f"{file}:pendulum")


def test_numbers_of_a_model_that_are_no_keyword_are_told_their_keyword():
    with pytest.raises(InputError) as error:
        check(EquationsOfMotion(1, M=len), {"m": 1})
    assert str(error.value) == "numbers of a SymPy model are parameters={'m': 1}"
    with pytest.raises(InputError, match=r"^arguments 1, 2: of a scene alone"):
        check(EquationsOfMotion(1, M=len), 1, 2)


def test_what_functions_are_compared_with_may_be_given_in_four_ways():
    own, scene = EquationsOfMotion(2, M=len), Snake.coil(2)
    assert reference_functions(own) is own
    assert reference_functions(scene).name == "snake[2]"
    assert reference_functions(("casadi", scene)).name == "casadi of snake[2]"
    like: Any = SimpleNamespace(mass_matrix=len)
    with pytest.raises(InputError):
        reference_functions(like)


def test_coordinates_and_velocities_have_the_names_that_are_given():
    plain = EquationsOfMotion(2, M=len)
    assert plain.coordinate_names == plain.velocity_names == ("q[0]", "q[1]")
    named = EquationsOfMotion(2, M=len, coordinates=["x", "θ"])
    assert named.coordinate_names == named.velocity_names == ("x", "θ")
    both = EquationsOfMotion(2, M=len, qdot=len, speeds=1, coordinates=["x", "θ"], velocities=["ω"])
    assert (both.coordinate_names, both.velocity_names) == (("x", "θ"), ("ω",))
    wrong = function_checks.check_functions(
        2,
        M=lambda q: [[2.0, q[0]], [-q[0], 3.0]],
        coordinates=("x", "θ"),
        claims=["mass-matrix-symmetric"],
    )
    assert "entry (x, θ)" in wrong[0].detail
    assert "coordinates=('x', 'θ')" in wrong[0].as_python()
