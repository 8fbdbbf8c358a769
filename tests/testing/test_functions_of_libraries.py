"""What libraries have beside M and B: forms of results, missing inputs, constraints, references."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.testing.every_function import TOOL, every_function, random_model, with_free_base

from eomcheck.claims.finding import Finding
from eomcheck.testing import EquationsOfMotion, check_functions
from eomcheck.testing.equations_of_motion import BrokenError, FunctionCaller
from eomcheck.testing.function_state import FunctionState

CHAIN = every_function(random_model(7, chain="RX PZ RY"))
STATE = [([0.3, 0.7, -0.4], [0.5, -0.8, 0.9])]
Q, V, VDOT, TAU = (np.array(x) for x in (*STATE[0], [0.1, 0.2, -0.3], [2.0, 1.0, -1.0]))


def of(names: str, **more: Any) -> dict[str, Any]:
    return {name: CHAIN[name] for name in names.split()} | {"n": 3, **more}


def check(names: str, claims: str = "", **more: Any) -> list[Finding]:
    options = {"states": STATE, "claims": claims.split() or None}
    return check_functions(**of(names, **options | more))


def verdicts(found: list[Finding]) -> dict[str, str]:
    return {x.subject: x.verdict for x in found}


# ---- Forms ---------------------------------------------------------------------------------------


def test_functions_are_called_with_what_they_read():
    seen: dict[str, Any] = {}

    def note(name: str, result: Any):
        return lambda *x: seen.update({name: [y.tolist() for y in x]}) or result

    own = EquationsOfMotion(
        3,
        qdd=lambda q, v, tau: seen.update(qdd=tau.tolist()) or 0.0 * v,
        qdd_q=lambda q, v: np.zeros((3, 3)),
        qdd_v=lambda q, v, tau: seen.update(qdd_v=tau.tolist()) or np.zeros((3, 3)),
        tau_q=note("tau_q", np.zeros((3, 3))),
        parameters=np.arange(10.0),
        mass=lambda: 2.0,
    )
    caller = FunctionCaller(own)
    assert [caller.reads(x) for x in ("qdd", "qdd_q", "qdd_v", "tau_q", "parameters")] == [
        *("qvf", "qv", "qvf", "qva", "")
    ]
    for name in own.given:
        caller(name, Q, V, vdot=VDOT, tau=TAU)
    assert seen == {
        "qdd": TAU.tolist(),
        "qdd_v": TAU.tolist(),
        "tau_q": [*map(np.ndarray.tolist, (Q, V, VDOT))],
    }
    assert caller("mass", Q, V) == 2.0 and caller("parameters", Q, V).tolist() == [*range(10)]
    caller("qdd", Q, V)
    assert seen["qdd"] == [0.0, 0.0, 0.0]


def test_a_write_into_forces_or_accelerations_is_seen():
    def tau_q(q, v, vdot):
        vdot += 1.0
        return np.zeros((3, 3))

    def qdd(q, v, tau):
        tau *= 2.0
        return tau

    for functions in ({"tau_q": tau_q}, {"qdd": qdd}):
        found = check_functions(3, **functions, states=STATE, claims=["arguments-unchanged"])
        if "qdd" in functions:
            found += check_functions(3, M=lambda q: np.eye(3), **functions, states=STATE)
        assert "failed" in {x.verdict for x in found if x.claim == "arguments-unchanged"}


R, P = CHAIN["frame_placement"][TOOL](Q)
WHOLE = np.vstack((np.column_stack((R, P)), [0, 0, 0, 1]))


@pytest.mark.parametrize(
    "placement", [(R, P), (R.tolist(), P.tolist()), (R, P[:, None]), WHOLE, WHOLE[:3]]
)
def test_a_placement_is_a_pair_or_a_matrix(placement: Any):
    caller = FunctionCaller(EquationsOfMotion(3, frame_placement=lambda q: placement))
    np.testing.assert_array_equal(caller("frame_placement", Q, V), WHOLE[None, :3])


@pytest.mark.parametrize(
    ("functions", "why"),
    [
        (
            {"frame_placement": lambda q: (R[:2], P)},
            "answers arrays of shapes (2, 3) and (3,), expected (3, 3) and (3,)",
        ),
        ({"frame_placement": lambda q: R}, "answers an array of shape (3, 3), expected (3, 4)"),
        ({"frame_placement": lambda q: None}, "answers None, expected an array of numbers"),
        (
            {"J": {"tool": lambda q: np.zeros((3, 6))}},
            "of frame tool: answers an array of shape (3, 6), expected (6, 3): transposed?",
        ),
        ({"com": lambda q: np.zeros(2)}, "answers an array of shape (2,), expected (3,)"),
        (
            {"momentum": lambda q, v: np.nan * np.ones(6)},
            "momentum[0] = nan, expected a finite number",
        ),
        (
            {"regressor": lambda q, v, a: np.zeros((2, 10))},
            "answers an array of shape (2, 10), expected (3, 10)",
        ),
    ],
)
def test_a_result_that_is_none_is_told_in_a_sentence(functions: dict[str, Any], why: str):
    (name,) = functions
    caller = FunctionCaller(EquationsOfMotion(3, **functions))
    with pytest.raises(BrokenError) as broken:
        caller(name, Q, V)
    assert broken.value.why == why


def test_accelerations_and_forces_are_those_of_the_state_again():
    """So that code that checks one state again has the same; and they are not small."""
    own = EquationsOfMotion(**of("M qdd tau_q"))
    one, other = (FunctionState(FunctionCaller(own), Q, V, seed) for seed in (0, 5))
    assert one.vdot.tolist() == other.vdot.tolist() and one.tau.tolist() == other.tau.tolist()
    assert (np.abs(one.vdot) >= 0.5).all() and (np.abs(one.tau) >= 0.5 * one.width_tau).all()
    assert one.with_velocity(2.0 * V).vdot.tolist() == one.vdot.tolist()
    assert one.with_loads(tau=TAU).with_velocity(V).tau.tolist() == TAU.tolist()
    assert FunctionState(FunctionCaller(own), Q + 0.1, V).vdot.tolist() != one.vdot.tolist()
    without = EquationsOfMotion(3, qdd=lambda q, v: v)
    assert FunctionState(FunctionCaller(without), Q, V).tau.tolist() == [0.0, 0.0, 0.0]


def test_code_that_checks_again_has_dicts_and_numbers():
    own = EquationsOfMotion(
        3, J={"tool": lambda q: 0}, mass=2.0, parameters=np.arange(3.0), com=lambda q: 0
    )
    code = own.as_python(None)
    assert "J={'tool': J_0}" in code and "# to be put in: J_0 = " in code
    assert "mass=2.0" in code and "parameters=[0.0, 1.0, 2.0]" in code and "com=com" in code


# ---- What is given -------------------------------------------------------------------------------


def test_frames_that_have_no_name_in_common_are_skipped():
    J = {"other": CHAIN["J"][TOOL]}
    found = check("frame_placement", "frame-jacobian", J=J)
    assert [(x.verdict, x.detail) for x in found] == [("skipped", "they have no frame of one name")]
    one = check("", "frame-jacobian", J=J["other"], frame_placement=CHAIN["frame_placement"][TOOL])
    assert verdicts(one) == {"J ~ frame_placement": "passed"}


def test_frames_are_compared_by_their_names_whatever_their_order():
    turned = {name: CHAIN["frame_placement"][name] for name in reversed(CHAIN["frame_placement"])}
    found = verdicts(check("J", "frame-jacobian", frame_placement=turned))
    assert [*turned] != [*CHAIN["J"]] and len(found) == 2 and {*found.values()} == {"passed"}


@pytest.mark.parametrize(
    ("names", "claim", "subject"),
    [
        ("M tau_q", "inverse-dynamics-by-position", "tau_q ~ ∂M/∂q v̇"),
        ("M bias gravity tau_q", "inverse-dynamics-by-position", "tau_q ~ τ"),
        ("M C gravity tau_q", "inverse-dynamics-by-position", "tau_q ~ τ"),
        ("M tau_v", "inverse-dynamics-by-velocity", "tau_v ~ τ"),
        ("T tau_v", "inverse-dynamics-by-velocity", "tau_v ~ τ"),
        ("C tau_v gravity", "inverse-dynamics-by-velocity", "tau_v ~ τ"),
        ("T inverse_dynamics", "inverse-dynamics", "inverse_dynamics ~ M v̇ + B"),
        ("M U inverse_dynamics", "inverse-dynamics", "inverse_dynamics ~ M v̇ + B"),
        ("qdd_tau inverse_mass_matrix", "acceleration-force-mass", "qdd_tau ~ M⁻¹"),
        ("qdd qdd_tau", "acceleration-force", "qdd ~ τ"),
        ("qdd T", "acceleration-force", "qdd ~ τ"),
        (
            "qdd_q tau_q inverse_dynamics qdd_tau",
            "acceleration-inverse-position",
            "qdd_q ~ tau_q",
        ),
        ("M U qdd_v tau_v", "acceleration-inverse-velocity", "qdd_v ~ tau_v"),
        ("M regressor parameters", "regressor-parameters", "regressor ~ τ without gravity"),
        ("T U regressor parameters", "regressor-parameters", "regressor ~ τ"),
        ("com_jacobian com_acceleration", "com-acceleration", "com_acceleration ~ d/dt ċ"),
        ("momentum_matrix com_jacobian mass", "com-momentum", "momentum ~ m ċ"),
        ("momentum_matrix momentum_rate", "momentum-rate", "momentum_rate ~ h"),
        ("J frame_acceleration", "frame-acceleration", "frame_acceleration [tool] ~ d/dt J"),
        ("J frame_bias", "frame-bias", "frame_bias [side] ~ d/dt J"),
    ],
)
def test_right_functions_pass_whatever_else_is_given(names: str, claim: str, subject: str):
    found = verdicts(check(names, claim))
    assert found[subject] == "passed" and "failed" not in found.values()


@pytest.mark.parametrize(
    ("names", "claim", "detail"),
    [
        ("M tau_q", "inverse-dynamics-by-position", "bias and gravity, would tell"),
        ("M inverse_dynamics", "inverse-dynamics", "no force is given"),
        ("M qdd_v tau_v", "acceleration-inverse-velocity", "inverse_dynamics would tell"),
        ("regressor", "regressor-parameters", "which parameter a column of the regressor"),
        ("qdd_tau", "acceleration-by-force", "qdd with tau or M or T"),
        ("qdd_q", "acceleration-by-position", "whether qdd_q is the derivative of q̈"),
        ("com", "reference", "a constant added to the center of mass"),
        ("frame_placement", "reference", "another frame that is fixed to the same link"),
        ("J", "frame-jacobian", "whether J belongs to the frame: frame_placement or against"),
        ("mass", "com-momentum", "whether the mass is that of the bodies"),
    ],
)
def test_what_cannot_be_told_is_said(names: str, claim: str, detail: str):
    assert any(detail in x.detail for x in check(names, claim)), [
        x.detail for x in check(names, claim)
    ]


def test_dampers_and_loads_are_in_inverse_dynamics_and_not_in_regressors():
    D = np.diag([1.0, 2.0, 3.0])

    def damped(q, v, vdot):
        return CHAIN["inverse_dynamics"](q, v, vdot) + D @ v - np.sin(q) * v

    def qdd(q, v, tau):
        return CHAIN["qdd"](q, v, tau - D @ v + np.sin(q) * v)

    found = check(
        "M bias gravity regressor parameters",
        "inverse-dynamics inverse-dynamics-acceleration regressor-parameters acceleration-force",
        inverse_dynamics=damped,
        qdd=qdd,
        R=lambda q, v: v @ D @ v / 2.0,
        Q=lambda q, v: np.sin(q) * v,
    )
    assert len(found) >= 4 and {x.verdict for x in found} == {"passed"}


@pytest.mark.parametrize("names", ["M bias gravity", "M bias"])
def test_loads_and_dampers_are_in_derivatives_of_inverse_dynamics(names: str):
    """Where no force is given, dampers may be in τ: what is even in v is not judged."""
    D = np.diag([1.0, 2.0, 3.0])
    loads = {"Q": lambda q, v: -D @ v} if "gravity" in names else {}
    (found,) = check(
        names,
        "inverse-dynamics-by-velocity",
        tau_v=lambda q, v, vdot: CHAIN["tau_v"](q, v, vdot) + D,
        **loads,
    )
    assert (found.subject, found.verdict) == ("tau_v ~ τ", "passed")


def test_inverse_dynamics_is_affine_in_the_acceleration():
    def cubic(q, v, vdot):
        return CHAIN["inverse_dynamics"](q, v, vdot) + 0.1 * vdot**3  # ∂τ/∂v̇ is symmetric

    found = verdicts(check("", "inverse-dynamics-symmetric", inverse_dynamics=cubic))
    assert found == {"inverse_dynamics ~ ∂τ/∂v̇": "passed", "inverse_dynamics ~ affine": "failed"}


def test_a_coriolis_matrix_need_not_be_skew():
    def C(q, v):
        extra = np.zeros((3, 3))
        extra[0, :2] = v[1], -v[0]  # its product with v vanishes
        return CHAIN["C"](q, v) + extra

    claims = "coriolis-bias coriolis-skew"
    assert [x.verdict for x in check("M bias", claims, C=C)] == ["passed", "failed"]
    free = check("M bias", claims, C=C, coriolis_skew=False)
    assert [(x.verdict, x.detail) for x in free] == [
        ("passed", ""),
        ("skipped", "coriolis_skew = False"),
    ]


def test_everything_is_compared_with_a_reference_under_the_same_loads():
    names = "M qdd tau_q qdd_q com momentum parameters frame_acceleration"
    # Without M other forces would be drawn.
    of_reference = names.removeprefix("M ")
    against = EquationsOfMotion(**of(of_reference, frame_placement=CHAIN["frame_placement"]))
    found = check(names, "reference", frame_placement=CHAIN["frame_placement"], against=against)
    assert {x.verdict for x in found} == {"passed"}
    assert {x.subject.split(" ~ ")[0] for x in found} == {
        *of_reference.split(),
        "frame_placement",
    }


def test_frames_are_compared_with_those_of_a_reference_that_has_all_of_them():
    every = CHAIN["frame_placement"]
    shift = {TOOL: lambda q: (every[TOOL](q)[0], every[TOOL](q)[1] + 0.1)}

    def compared(own: Any, reference: Any) -> Finding:
        against = EquationsOfMotion(**of("com", frame_placement=reference))
        found = check("com", "reference", frame_placement=own, against=against)
        (finding,) = [x for x in found if x.subject.startswith("frame_placement")]
        return finding

    assert compared(shift, every).verdict == "failed"
    other = compared(every, shift)
    assert (other.verdict, other.detail) == (
        "skipped",
        "the reference has shape (1, 3, 4), not (2, 3, 4)",
    )


# ---- Constraints ---------------------------------------------------------------------------------

A = np.array([[1.0, -2.0, 0.5]])


def projected(q, v, tau):
    M, one = CHAIN["M"](q), np.eye(3)
    inverse = np.linalg.inv(M)
    return inverse @ (one - A.T @ np.linalg.solve(A @ inverse @ A.T, A @ inverse))


def test_with_constraints_the_response_to_forces_is_projected():
    def qdd(q, v, tau):
        return projected(q, v, tau) @ (tau - CHAIN["bias"](q, v) - CHAIN["gravity"](q))

    own: dict[str, Any] = {"a": lambda q: A, "qdd": qdd}
    claims = " ".join(
        f"acceleration-{x}" for x in ("by-force", "force-mass", "force", "force-symmetric")
    )
    right = check("M bias gravity", claims, qdd_tau=projected, **own)
    assert [x.verdict for x in right] == ["passed"] * 5
    wrong = check("M bias gravity", claims, qdd_tau=CHAIN["qdd_tau"], **own)
    failed = [x for x in wrong if x.verdict == "failed"]
    assert {x.subject for x in failed} == {"qdd_tau ~ q̈", "qdd_tau ~ a"}
    assert {x.cause for x in failed} == {"qdd_tau"}
    assert any("M⁻¹ without the constraints" in x.detail for x in failed)


@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_with_constraints_applied_forces_count_in_the_directions_that_are_left(factor: float):
    """Two masses on a rod along x: they have one acceleration."""

    def qdd(q, v, tau):
        return factor * np.full(2, (tau[0] + tau[1]) / 3.0)

    given: dict[str, Any] = {"M": lambda q: np.diag([1.0, 2.0]), "a": lambda q: [[1.0, -1.0]]}
    claims = ["acceleration-force"]
    (only,) = check_functions(2, qdd=qdd, claims=claims, states=1, **given)
    assert only.verdict == ("passed" if factor == 1.0 else "failed")


# ---- Conclusions ---------------------------------------------------------------------------------


def conclusions(names: str, **wrong: Any) -> dict[str, str]:
    """Return cause -> detail of the first failure of each cause."""
    failed = [x for x in check(names, **wrong) if x.verdict == "failed" and not x.follows]
    return {x.cause: x.detail for x in failed}


@pytest.mark.parametrize(
    ("first", "other", "names", "passing"),
    [
        ("qdd_q", "qdd_v", "M bias gravity qdd", "motion and acceleration-force pass"),
        ("tau_q", "tau_v", "M bias gravity inverse_dynamics", "inverse-dynamics passes"),
    ],
)
def test_derivatives_that_are_exchanged_are_named_and_what_they_derive_is_cleared(
    first: str, other: str, names: str, passing: str
):
    causes = conclusions(names, **{first: CHAIN[other], other: CHAIN[first]})
    assert causes.keys() == {first, other}
    assert f"{passing}; " in causes[first]
    assert causes[first].endswith(f"{first} and {other} exchanged")
    assert causes[other].endswith(f"{other} and {first} exchanged")
    (right,) = conclusions(names, **{first: CHAIN[other], other: CHAIN[other]}).values()
    assert "exchanged" not in right


@pytest.mark.parametrize(
    ("first", "other", "names"),
    [
        ("qdd_q", "qdd_v", "qdd"),
        ("qdd_q", "qdd_v", "qdd qdd_tau inverse_dynamics"),
        ("tau_q", "tau_v", "inverse_dynamics"),
    ],
)
def test_a_function_is_not_blamed_for_its_derivatives_that_are_exchanged(
    first: str, other: str, names: str
):
    """Without M nothing else confirms it: it agrees with both arrays, each as the other one."""
    causes = conclusions(names, **{first: CHAIN[other], other: CHAIN[first]})
    assert causes.keys() == {first, other}
    assert causes[first].endswith(f"{first} and {other} exchanged")
    of = names.split()[0]
    wrong = {of: lambda *x: 1.1 * CHAIN[of](*x), first: CHAIN[first], other: CHAIN[other]}
    assert conclusions("qdd_tau" if of == "qdd" else "M bias gravity", **wrong).keys() == {of}


def test_a_force_that_is_missing_in_the_acceleration_does_not_clear_it():
    wrong = {"qdd": lambda q, v, tau: CHAIN["qdd"](q, v, tau + CHAIN["gravity"](q))}
    names = "M bias gravity qdd_q qdd_v qdd_tau"
    assert conclusions(names, **wrong).keys() == {"qdd"}


@pytest.mark.parametrize("momentum", ["momentum", "momentum_matrix"])
def test_a_center_of_mass_is_wrong_whose_jacobian_agrees_with_the_momentum(momentum: str):
    wrong = {"com": lambda q: 1.1 * CHAIN["com"](q)}
    (cause, detail), *others = conclusions(f"com_jacobian mass {momentum}", **wrong).items()
    assert (cause, others) == ("com", [])
    assert "center of mass com is wrong: com-jacobian fails, com-momentum passes" in detail


# ---- Bodies --------------------------------------------------------------------------------------

OF_BODIES = "com com_jacobian com_velocity mass momentum momentum_matrix"


def of_other_bodies(free: bool) -> dict[str, Any]:
    """Return functions of a tree, those of `OF_BODIES` with twice the mass of the last link."""
    model = random_model(3, free, joints=2) if free else random_model(7, chain="RX PZ RY")
    make = with_free_base if free else every_function
    right = make(model.copy())
    model.inertias[model.njoints - 1].mass *= 2.0
    wrong = make(model)
    names = ["n", "M", "bias", "gravity", "qdd", "qdot", "speeds", "holonomic"]
    return {x: right[x] for x in names if x in right} | {x: wrong[x] for x in OF_BODIES.split()}


@pytest.mark.parametrize("free", [False, True])
def test_a_center_of_mass_of_other_bodies_is_not_where_gravity_pulls(free: bool):
    found = check_functions(**of_other_bodies(free), states=2, ranges=(-1.0, 1.0))
    failed = {x.claim: x for x in found if x.verdict == "failed"}
    assert failed.keys() == {"com-gravity", "com-kinetic-energy"}
    assert "com_jacobian" in failed["com-gravity"].cause
    assert "gravity" not in failed["com-gravity"].cause
    assert "springs belong in Q" in failed["com-gravity"].detail
    assert "times the energy that M gives" in failed["com-kinetic-energy"].detail


def test_all_energy_of_a_point_mass_is_that_of_its_center():
    """Nothing is left about it but the error of the differences by which its Jacobian is known."""
    found = check_functions(
        1,
        M=lambda q: [[2.0 * (0.36 + 0.01 * np.cos(3.0 * q[0]) ** 2)]],
        mass=2.0,
        com=lambda q: np.array([0.6 * np.sin(q[0]), -0.6 * np.cos(q[0]), np.sin(3.0 * q[0]) / 30]),
        claims=["com-kinetic-energy"],
        states=8,
    )
    assert {x.verdict for x in found} == {"passed"}


def test_a_momentum_without_the_mass_is_recognized():
    wrong = {"momentum": lambda q, v: CHAIN["momentum"](q, v) / CHAIN["mass"]}
    (found,) = check("mass com_velocity", "com-momentum", **wrong)
    assert found.verdict == "failed" and "velocity, without the mass" in found.detail


@pytest.mark.parametrize(
    ("length", "g", "verdict"),
    [
        (lambda q: 0.6, 9.81, "passed"),
        (lambda q: 0.6 + 0.1 * np.sin(q), 9.81, "failed"),
        (lambda q: 0.6, 0.0, "skipped"),
    ],
)
def test_a_pendulum_hangs_at_its_center_of_mass(length: Any, g: float, verdict: str):
    """No motion leaves its plane: the weight across it is not determined."""
    (finding,) = check_functions(
        1,
        gravity=lambda q: 2.0 * g * 0.6 * np.sin(q),
        com=lambda q: length(q[0]) * np.array([np.sin(q[0]), 0.0, -np.cos(q[0])]),
        claims=["com-gravity"],
        states=3,
    )
    assert finding.verdict == verdict
