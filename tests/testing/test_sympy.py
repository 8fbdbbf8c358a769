"""Equations that SymPy derived: its speeds, its constraints, and a disc that agrees with ours."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import sympy as sm
from sympy.physics.mechanics import (
    KanesMethod,
    LagrangesMethod,
    Lagrangian,
    Particle,
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
    inertia,
)

from eomcheck.errors import InputError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import FORMULATIONS
from eomcheck.scenes import RollingDisk
from eomcheck.testing import (
    check,
    check_functions,
    converters,
    from_kane,
    from_lagrange,
    from_scene,
)

m, r, g = sm.symbols("m r g")
DISK = RollingDisk(mass=1.3, radius=0.4, gravity=9.81)
NUMBERS = {m: 1.3, r: 0.4, g: 9.81}


def disc(sign: int = 1) -> KanesMethod:
    """SymPy's rolling disc: three speeds, with rolling built in."""
    q1, q2, q3 = dynamicsymbols("q1:4")
    u1, u2, u3 = dynamicsymbols("u1:4")
    N = ReferenceFrame("N")
    Y = N.orientnew("Y", "Axis", [q1, N.z])
    L = Y.orientnew("L", "Axis", [q2, Y.x])
    R = L.orientnew("R", "Axis", [q3, L.y])
    turning, speeds = R.ang_vel_in(N), u1 * L.x + u2 * L.y + u3 * L.z
    kinematic = [(turning - speeds).dot(axis) for axis in L]
    R.set_ang_vel(N, speeds)
    contact = Point("C")
    contact.set_vel(N, 0)
    center = contact.locatenew("D", r * L.z)
    center.v2pt_theory(contact, N, R)
    about = inertia(L, m * r**2 / 4, m * r**2 / 2, m * r**2 / 4)
    body = RigidBody("B", center, R, m, (about, center))
    kane = KanesMethod(N, [q1, q2, q3], [u1, u2, u3], kinematic)
    kane.kanes_equations([body], [(center, -sign * m * g * Y.z)])
    return kane


def disc_that_is_held() -> KanesMethod:
    """The same disc with five speeds, two of which follow from its velocity constraints."""
    q1, q2, q3, q4, q5 = q = dynamicsymbols("q1:6")
    u1, u2, u3, u4, u5 = u = dynamicsymbols("u1:6")
    N = ReferenceFrame("N")
    Y = N.orientnew("Y", "Axis", [q1, N.z])
    L = Y.orientnew("L", "Axis", [q2, Y.x])
    R = L.orientnew("R", "Axis", [q3, L.y])
    kinematic = [(R.ang_vel_in(N) - u1 * L.x - u2 * L.y - u3 * L.z).dot(x) for x in L]
    kinematic += [q4.diff() - u4, q5.diff() - u5]
    R.set_ang_vel(N, u1 * L.x + u2 * L.y + u3 * L.z)
    ground = Point("O")
    ground.set_vel(N, 0)
    center = ground.locatenew("D", q4 * N.x + q5 * N.y + r * sm.cos(q2) * N.z)
    center.set_vel(N, u4 * N.x + u5 * N.y - r * sm.sin(q2) * u1 * N.z)
    contact = center.locatenew("C", -r * L.z)
    contact.v2pt_theory(center, N, R)
    rolling = [contact.vel(N).dot(axis) for axis in (Y.x, Y.y)]
    about = inertia(L, m * r**2 / 4, m * r**2 / 2, m * r**2 / 4)
    body = RigidBody("B", center, R, m, (about, center))
    kane = KanesMethod(N, q, u[:3], kinematic, u_dependent=u[3:], velocity_constraints=rolling)
    kane.kanes_equations([body], [(center, -m * g * N.z)])
    return kane


def largest_difference(functions: Any, order: list[int]) -> float:
    """Return the largest difference of u̇ to ours over its size, at 50 states.

    Args:
        functions: of a disc.
        order: which of our coordinates theirs are.
    """
    worst = 0.0
    for seed in range(50):
        rng = np.random.default_rng(seed)
        q, u = rng.uniform(-1, 1, 5), rng.uniform(-3, 3, 3)
        at = Evaluation(DISK, q, np.zeros(5), 0.0)
        at.__dict__["u"] = u
        ours = at.rates(FORMULATIONS["kane"]).vdot
        theirs = functions.qdd(q[order], u)
        worst = max(worst, np.abs(theirs - ours).max() / np.abs(ours).max())
    return worst


def test_the_rolling_disc_of_sympy_is_ours():
    assert largest_difference(from_kane(disc(), NUMBERS), [2, 3, 4]) < 1e-13


def test_the_rolling_disc_with_dependent_speeds_is_ours_too():
    functions = from_kane(disc_that_is_held(), NUMBERS)
    assert (functions.n, functions.p) == (5, 3)
    assert largest_difference(functions, [2, 3, 4, 0, 1]) < 1e-13


@pytest.mark.parametrize("make", [disc, disc_that_is_held])
@pytest.mark.sampled(2)
def test_equations_by_kanes_method_pass(make):
    found = check(from_kane(make(), NUMBERS), states=4)
    assert not [str(x) for x in found if x.verdict == "failed"]
    passed = {x.claim for x in found if x.verdict == "passed"}
    assert {"bias-power", "kinetic-energy", "motion", "power-balance"} <= passed
    # Rolling is built into M, which then does not tell the bias.
    assert "bias-of-mass-matrix" not in passed


WRONG_INPUT = "a velocity or a load of wrong sign in the derivation: against would tell"


@pytest.mark.night
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.sampled(2)
def test_that_a_load_of_wrong_sign_went_into_a_derivation_is_said_to_be_untold(sign):
    functions = from_kane(disc(sign=sign), NUMBERS)
    found = check(functions, states=2)
    assert not [x for x in found if x.verdict == "failed"]
    assert WRONG_INPUT in [x.detail for x in found if x.verdict == "skipped"]
    against = from_kane(disc(), NUMBERS, name="right")
    told = check(functions, states=2, against=against)
    assert WRONG_INPUT not in [x.detail for x in told]
    assert any(x.verdict == "failed" for x in told) == (sign < 0)


def test_functions_that_nobody_derived_together_are_not_said_to_be():
    found = check(replace(from_kane(disc(), NUMBERS), derived=False), states=2)
    assert WRONG_INPUT not in [x.detail for x in found]


def test_a_wrong_force_in_sympy_differs_from_ours():
    assert largest_difference(from_kane(disc(sign=-1), NUMBERS), [2, 3, 4]) > 0.1


@pytest.mark.night
def test_speeds_that_are_not_rates_are_seen_through():
    """M in generalized speeds tells the bias, if nothing is built into it."""
    q1, q2, u1, u2 = dynamicsymbols("q1 q2 u1 u2")
    N = ReferenceFrame("N")
    origin = Point("O")
    origin.set_vel(N, 0)
    there = origin.locatenew("P", q1 * sm.cos(q2) * N.x + q1 * sm.sin(q2) * N.y)
    # Cartesian components of the velocity, along axes that turn with q1: no rates of anything.
    radial, turn = u1 + q2 * u2, (u2 - u1 * sm.sin(q1)) / (2 + q1)
    velocity = there.pos_from(origin).dt(N).subs({q1.diff(): radial, q2.diff(): turn})
    there.set_vel(N, velocity)
    kane = KanesMethod(N, [q1, q2], [u1, u2], [q1.diff() - radial, q2.diff() - turn])
    kane.kanes_equations([Particle("P", there, m)], [(there, -m * g * N.y)])
    functions = from_kane(kane, {m: 2.0, g: 9.81}, holonomic=True)
    found = check(functions, states=4)
    assert not [str(x) for x in found if x.verdict == "failed"]
    assert "bias-of-mass-matrix" in {x.claim for x in found if x.verdict == "passed"}
    wrong = {"bias": lambda q, v: 1.001 * functions.bias(q, v)}
    given = {x: functions.function(x) for x in functions.given} | wrong
    found = check_functions(2, **given, holonomic=True, states=4)
    failed = [x.claim for x in found if x.verdict == "failed"]
    assert failed[0] == "bias-of-mass-matrix"


def pendulum(rod: bool, damping: float = 0.0) -> LagrangesMethod:
    """A pendulum on a cart; with `rod` in coordinates of its end, which a rod holds."""
    N = ReferenceFrame("N")
    origin = Point("O")
    origin.set_vel(N, 0)
    q1, q2, q3 = dynamicsymbols("q1:4")
    cart = origin.locatenew("A", q1 * N.x)
    cart.set_vel(N, q1.diff() * N.x)
    end = (q2 * N.x + q3 * N.y) if rod else (q1 + r * sm.sin(q2)) * N.x - r * sm.cos(q2) * N.y
    tip = origin.locatenew("B", end)
    tip.set_vel(N, end.dt(N))
    bodies = Particle("A", cart, 2 * m), Particle("B", tip, m)
    bodies[1].potential_energy = m * g * end.dot(N.y)
    q = [q1, q2, q3] if rod else [q1, q2]
    held = [(q2 - q1) ** 2 + q3**2 - r**2] if rod else None
    forces = [(cart, -damping * q1.diff() * N.x)] if damping else None
    lagrange = LagrangesMethod(
        Lagrangian(N, *bodies), q, hol_coneqs=held, forcelist=forces, frame=N
    )
    lagrange.form_lagranges_equations()
    return lagrange


@pytest.mark.parametrize("rod", [False, True])
@pytest.mark.parametrize("damping", [0.0, 0.7])
@pytest.mark.sampled(2)
def test_equations_by_lagranges_method_pass(rod: bool, damping: float):
    found = check(from_lagrange(pendulum(rod, damping), NUMBERS), states=4)
    assert not [str(x) for x in found if x.verdict == "failed"]
    passed = {x.claim for x in found if x.verdict == "passed"}
    expected = {"bias-of-mass-matrix", "bias-of-energy", "kinetic-energy", "motion"}
    expected |= {"constraint-drift", "constraint-jacobian"} if rod else {"power-balance"}
    assert expected <= passed


def swung(scale: Any = 1, **options: Any) -> KanesMethod:
    """Return a pendulum whose rate is `scale` times its speed."""
    q, u = dynamicsymbols("q1 u1")
    N, pivot = ReferenceFrame("N"), Point("O")
    rod = N.orientnew("A", "Axis", [q, N.z])
    rod.set_ang_vel(N, scale * u * N.z)
    pivot.set_vel(N, sum(options.get("u_auxiliary", [])) * N.y)
    bob = pivot.locatenew("P", r * rod.x)
    bob.v2pt_theory(pivot, N, rod)
    kane = KanesMethod(N, [q], [u], [scale * u - q.diff()], **options)
    kane.kanes_equations([Particle("P", bob, m)], [(bob, m * g * N.x)])
    return kane


def test_kinematic_equations_may_hold_parameters():
    scale, numbers = sm.Symbol("k"), {m: 1.3, r: 0.4, g: 9.81}
    functions = from_kane(swung(scale), numbers | {scale: 0.7}, holonomic=True)
    found = check(functions, states=3)
    assert {x.verdict for x in found if x.claim != "reference"} == {"passed"}
    q, u = np.array([0.3]), np.array([0.5])
    plain = from_kane(swung(), numbers)
    assert functions.qdot is not None
    assert functions.qdot(q, u) == pytest.approx(0.7 * u)
    assert functions.M(q) == pytest.approx(0.7**2 * plain.M(q))
    assert functions.qdd(q, u) == pytest.approx(plain.qdd(q, 0.7 * u) / 0.7)


def test_names_stand_for_symbols_without_assumptions():
    by_name = from_lagrange(pendulum(False), {"m": 1.3, "r": 0.4, "g": 9.81})
    q = np.array([0.3, -0.8])
    assert np.array_equal(by_name.M(q), from_lagrange(pendulum(False), NUMBERS).M(q))


def test_sympy_can_be_what_functions_are_compared_with():
    functions = from_lagrange(pendulum(False), NUMBERS)
    doubled = {"M": lambda q: 2 * functions.M(q)}
    found = check_functions(2, **doubled, against=functions, states=2, claims=["reference"])
    assert [x.verdict for x in found] == ["failed"]


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: from_kane(3), "kane = 3, expected a sympy.physics.mechanics.KanesMethod"),
        (lambda: from_lagrange(3), "lagrange = 3, expected a sympy.physics.mechanics.Lagranges"),
        (lambda: from_kane(disc(), {m: 1.0}), "parameters of kane have no number for g, r"),
        (
            lambda: from_kane(disc(), NUMBERS | {m: "a"}),
            "parameters of kane have m: 'a', expected a finite real number",
        ),
        (
            lambda: from_lagrange(pendulum(False), NUMBERS | {r: float("nan")}),
            "parameters of lagrange have r: nan, expected a finite real number",
        ),
        (
            lambda: from_kane(disc(), NUMBERS | {g: m}),
            "parameters of kane have g: m, expected a finite real number",
        ),
        (
            lambda: from_kane(disc(), 3),  # type: ignore[arg-type]
            "parameters = 3, expected a dict, symbol -> number",
        ),
        (
            lambda: from_lagrange(pendulum(False), {}),
            "parameters of lagrange have no number for g, m, r",
        ),
        (
            lambda: from_kane(disc(), {**NUMBERS, sm.Symbol("d"): 1.0, sm.Symbol("k"): 2.0}),
            "parameters of kane have a number for d, k, which it has not",
        ),
        (
            lambda: from_kane(disc(), {**NUMBERS, sm.Symbol("g", positive=True): 9.81}),
            "parameters of kane have g of other assumptions than its equations",
        ),
        (
            lambda: from_lagrange(
                pendulum(False), {m: 1.3, r: 0.4, sm.Symbol("g", positive=True): 9.81}
            ),
            "parameters of lagrange have g of other assumptions than its equations",
        ),
        (
            lambda: from_kane(swung(u_auxiliary=[dynamicsymbols("u2")]), NUMBERS),
            "kane has auxiliary speeds u2(t), which are 0 in every motion",
        ),
        (
            lambda: from_kane(disc(), NUMBERS, U=abs),
            "U = <built-in function abs> beside from_kane, which has it from the equations: all",
        ),
        (
            lambda: from_lagrange(pendulum(False), NUMBERS, M=abs),
            "M = <built-in function abs> beside from_lagrange",
        ),
        (
            lambda: from_lagrange(LagrangesMethod(dynamicsymbols("q1"), dynamicsymbols("q1:2"))),
            "lagrange has no equations yet",
        ),
    ],
)
def test_what_is_no_method_or_has_no_numbers_is_refused(make, message):
    with pytest.raises(InputError) as caught:
        make()
    assert str(caught.value).startswith(message)


@pytest.mark.night
def test_our_own_disc_passes_too():
    assert not [x for x in check(from_scene(DISK), states=1) if x.verdict == "failed"]


def test_findings_about_sympys_models_have_its_names():
    by_kane = from_kane(swung(), {m: 1.3, r: 0.4, g: 9.81})
    assert (by_kane.coordinate_names, by_kane.velocity_names) == (("q1",), ("u1",))
    assert from_lagrange(pendulum(False), NUMBERS).coordinate_names == ("q1", "q2")
    own = from_kane(swung(), {m: 1.3, r: 0.4, g: 9.81}, coordinates=["angle"])
    assert own.coordinate_names == ("angle",)


def test_a_model_without_dependent_speeds_evaluates_one_matrix_for_M_and_none_for_its_bias(
    monkeypatch,
):
    compiled: list[int] = []
    compile_expression = converters._Numbers.__call__

    def counted(numbers: Any, expression: Any) -> Any:
        function, number = compile_expression(numbers, expression), len(calls)
        calls.append(0)

        def call(q: Any, v: Any) -> Any:
            compiled.append(number)
            return function(q, v)

        return call

    calls: list[int] = []
    monkeypatch.setattr(converters._Numbers, "__call__", counted)
    q, u = dynamicsymbols("q u")
    N = ReferenceFrame("N")
    P = Point("P")
    P.set_vel(N, u * N.x)
    kane = KanesMethod(N, [q], [u], [u - q.diff()])
    kane.kanes_equations([Particle("p", P, 2)], [(P, -3 * q * N.x)])
    equations = from_kane(kane)
    K, f, loads = 0, 1, 2
    assert equations.M(np.ones(1)) == 2.0 and compiled == [K]
    compiled.clear()
    assert equations.bias(np.ones(1), np.ones(1)) == 0.0 and sorted(compiled) == [f, loads]
