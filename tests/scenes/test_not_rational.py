"""Right equations that use sines, numpy or lists: no claim fails, and nothing is disproved."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import pytest

import eomcheck
from eomcheck.claims.user_scenes import why_not_rational
from eomcheck.errors import InputError
from eomcheck.mechanics.records import Jacobians, Terms
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import Sleigh, Snake


class Numbers(NamedTuple):
    mass: Any
    inertia: Any


class Sines(Scene):
    """A cart with a rod, all in doubles, with numpy's sines and decimal literals."""

    key, conserves_energy = "sines", True
    named_coordinates = ("x", "θ")
    angle_coordinates = slice(1, 2)

    def parameters(self, arithmetic):
        return Numbers(*(arithmetic.numbers(np.array([x])) for x in (2.0, 0.3)))

    def initial_state(self):
        return np.array([0.1, 0.5]), np.array([0.2, -1.0])

    @staticmethod
    def jacobians(parameters, prepared, q, v):
        cos, sin = np.cos(q[1]), np.sin(q[1])
        J = np.array([[[1.0, 0.7 * cos], [0.0, 0.7 * sin]]])
        rest = 0.7 * v[1] ** 2 * np.array([[-sin, cos]])
        return Jacobians(J, np.array([[[0.0, 1.0]]]), rest, np.array([[0.0]]))

    @staticmethod
    def forces(parameters, prepared, q, v):
        return np.array([0.0, -9.81 * 0.7 * parameters.mass[0] * np.sin(q[1])])

    @staticmethod
    def velocities(parameters, prepared, q, v):
        along, up = v[0] + 0.7 * np.cos(q[1]) * v[1], 0.7 * np.sin(q[1]) * v[1]
        return np.array([[along, up]]), np.array([[v[1]]])

    @staticmethod
    def potential(parameters, prepared, q):
        return -9.81 * 0.7 * parameters.mass[0] * np.cos(q[1])


class Mathematical(Sines):
    """The same, its terms by `math`, which knows no number but doubles and turns others to them."""

    key = "mathematical"

    @staticmethod
    def terms(parameters, prepared, q, v):
        m, central, cos, sin = *(x[0] for x in parameters), math.cos(q[1]), math.sin(q[1])
        M = np.array([[m, 0.7 * m * cos], [0.7 * m * cos, 0.49 * m + central]])
        Q = np.array([0.0, -9.81 * 0.7 * m * sin])
        return Terms(M, Q, np.array([-0.7 * m * sin * v[1] ** 2, 0.0]), None, None, None)


class Blade(Scene):
    """A sled on a blade."""

    key, conserves_energy = "blade", True
    named_coordinates, named_constraints = ("x", "y", "θ"), ("blade",)
    angle_coordinates = slice(2, 3)
    parameters = Sines.parameters

    def initial_state(self):
        return np.array([0.1, 0.5, 0.3]), np.array([np.cos(0.3), np.sin(0.3), 0.7])

    @staticmethod
    def jacobians(parameters, prepared, q, v):
        J = np.array([[[1.0, 0, 0], [0, 1, 0]]])
        return Jacobians(J, np.array([[[0, 0, 1.0]]]), np.zeros((1, 2)), np.zeros((1, 1)))

    @staticmethod
    def velocities(parameters, prepared, q, v):
        return np.array([[v[0], v[1]]]), np.array([[v[2]]])

    @staticmethod
    def constraints(parameters, prepared, q):
        return np.array([[-np.sin(q[2]), np.cos(q[2]), 0.0]]), None

    @staticmethod
    def drift(parameters, prepared, q, v):
        return np.array([-v[2] * (v[0] * np.cos(q[2]) + v[1] * np.sin(q[2]))])

    @staticmethod
    def constraint(parameters, prepared, q, v):
        return np.array([v[1] * np.cos(q[2]) - v[0] * np.sin(q[2])])


class MathematicalBlade(Blade):
    key = "mathematical-blade"

    @staticmethod
    def drift(parameters, prepared, q, v):
        return np.array([-v[2] * (v[0] * math.cos(q[2]) + v[1] * math.sin(q[2]))])


class Decimal(Sleigh):
    """Rational, but for a literal that no exact number takes."""

    key = "decimal"

    @staticmethod
    def terms(parameters, prepared, q, v):
        terms = Sleigh.terms(parameters, prepared, q, v)
        return terms._replace(M=(0.1 * terms.M) * 10)


RIGHT = [Sines, Mathematical, Blade, MathematicalBlade, Decimal]
EXACT = {"enclosures", "true-error"}


@pytest.mark.sampled(6)
@pytest.mark.parametrize("kind", RIGHT)
def test_right_equations_that_are_not_rational_neither_fail_nor_are_disproved(kind):
    scene = kind()
    found = eomcheck.validate(scene, examples=6)
    assert [str(f) for f in found if f.verdict == "failed"] == []
    exact = [f for f in found if f.claim in EXACT]
    assert [(f.claim, f.verdict) for f in exact] == [
        ("enclosures", "skipped"),
        ("true-error", "skipped"),
    ], "each is told once"
    assert all(f.detail.startswith("not rational: ") for f in exact)
    proved = eomcheck.prove(scene, points=1, seed=0)
    assert [f.verdict for f in proved] == ["skipped"]
    assert proved[0].detail.startswith("not rational, in ")
    passed = {f.claim for f in found if f.verdict == "passed"}
    assert {"mass-matrix", "bias", "equivalence", "kinetic-energy", "kane-ml-mass"} <= passed


@pytest.mark.sampled(3)
@pytest.mark.parametrize("kind", RIGHT[:4])
def test_a_wrong_sign_in_such_equations_fails_all_the_same(kind):
    class Wrong(kind):
        @staticmethod
        def terms(parameters, prepared, q, v):
            terms = kind.terms(parameters, prepared, q, v)
            return terms._replace(
                M=terms.M * np.where(np.eye(len(q)), 1, -1) + 0.1 * np.eye(len(q))
            )

    scene = Wrong()
    found = eomcheck.check_state(scene, *scene.initial_state(), engines=["casadi"])
    failed = [f for f in found if f.verdict == "failed"]
    assert failed[0].claim in {"mass-matrix", "kinetic-energy"}


def test_what_is_not_traced_is_told_by_machine_code_once():
    found = eomcheck.validate(MathematicalBlade(), examples=3, engines=[])
    told = [f for f in found if f.claim == "machine-code"]
    assert [f.verdict for f in told] == ["skipped"]


def test_scenes_of_ours_are_rational():
    assert why_not_rational(Snake.coil(2)) == ""
    assert why_not_rational(Sleigh()) == ""
    assert "not rational" in why_not_rational(Sines())


@pytest.mark.parametrize("function", ["jacobians", "forces", "velocities", "terms"])
def test_a_list_in_place_of_an_array_is_told_in_one_sentence(function):
    base = Mathematical

    def lists(*arguments):
        given = getattr(base, function)(*arguments)
        if isinstance(given, np.ndarray):
            return given.tolist()
        fields = (None if x is None else x.tolist() for x in given)
        return type(given)(*fields) if hasattr(given, "_fields") else tuple(fields)

    class Lists(base):
        key = f"lists-{function}"

    setattr(Lists, function, staticmethod(lists))
    scene = Lists()
    for look in (
        lambda: eomcheck.check_state(scene, *scene.initial_state()),
        lambda: eomcheck.prove(scene),
    ):
        with pytest.raises(
            InputError, match=rf"Lists\.{function}: .* is a list, expected an array"
        ):
            look()


# ---- Functions that raise ------------------------------------------------------------------------


def test_a_function_that_raises_fails_with_its_name_and_line_and_does_not_end_the_run():
    class Broken(Blade):
        key = "broken"

        @staticmethod
        def constraint(parameters, prepared, q, v):
            if q[0] > 0:
                raise KeyError("blade")
            return Blade.constraint(parameters, prepared, q, v)

    scene = Broken()
    found = eomcheck.check_state(scene, *scene.initial_state(), engines=[])
    failed = [f for f in found if f.verdict == "failed"]
    assert {f.claim for f in failed} >= {"constraint-velocity"}
    assert (
        "Broken.constraint raised KeyError: 'blade' (test_not_rational.py, line" in failed[0].detail
    )
    assert failed[0].state is not None
    assert "equivalence" in {f.claim for f in found if f.verdict == "passed"}


def test_terms_that_raise_are_one_failure():
    class Broken(Mathematical):
        key = "broken-terms"

        @staticmethod
        def terms(parameters, prepared, q, v):
            if q[0] == 0.1:
                raise ZeroDivisionError("here")
            return Mathematical.terms(parameters, prepared, q, v)

    scene = Broken()
    (finding,) = eomcheck.check_state(scene, *scene.initial_state())
    assert (finding.claim, finding.verdict) == ("finite-terms", "failed")
    assert "Broken.terms raised ZeroDivisionError: here" in finding.detail
    passed = eomcheck.check_state(scene, [0.2, 0.5], [0.2, -1.0], engines=[])
    assert {"equivalence"} <= {f.claim for f in passed if f.verdict == "passed"}


def test_a_function_that_exact_numbers_break_is_not_looked_at_by_proofs():
    class Keyed(Sleigh):
        key = "keyed"

        @staticmethod
        def terms(parameters, prepared, q, v):
            if not isinstance(v[2], float):
                raise KeyError(type(v[2]).__name__)
            return Sleigh.terms(parameters, prepared, q, v)

    (finding,) = eomcheck.prove(Keyed(), points=1, seed=0)
    assert finding.verdict == "skipped"
    assert "Keyed.terms raised KeyError" in finding.detail
    found = eomcheck.validate(Keyed(), examples=2, engines=[])
    assert [str(f) for f in found if f.verdict == "failed"] == []


def test_an_error_of_ours_is_not_blamed_on_a_scene(monkeypatch):
    from eomcheck.claims import case

    def broken(*_):
        raise TypeError("ours")

    monkeypatch.setattr(case.Case, "compare", broken)
    with pytest.raises(TypeError, match="ours"):
        eomcheck.check_state(Sines(), *Sines().initial_state(), engines=[])
