"""Parts of evaluations, of composed scenes and of runs in many digits, each by hand."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from decimal import Decimal
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
from tests.mechanics.descriptions import GROUND, Driven, Lifted, rod

from eomcheck import with_constraints
from eomcheck.descriptions.build import mechanism
from eomcheck.descriptions.elements import Joint
from eomcheck.errors import InputError, RefusedError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.scene_quantities import net_force, rate_of_velocity, with_literals
from eomcheck.formulations import FORMULATIONS
from eomcheck.mechanics import derived_functions
from eomcheck.mechanics.scene import MAX_COORDINATES, checked_scene, finite_array
from eomcheck.motion import integrators, right_hand_side
from eomcheck.motion.reference_solution import ReferenceRun, decimals, difference
from eomcheck.motion.right_hand_side import ACCELERATION, RightHandSide, exact_jacobian, kernel_of
from eomcheck.numbers.generic import NotRationalError
from eomcheck.scenes import Bricard, ChainPendulum, Snake

# ---- Composed scenes -----------------------------------------------------------------------------


def test_speeds_by_a_partition_are_these_numbers():
    a, b = np.array([[2.0, 1.0, 4.0]]), np.array([6.0])
    W, offset = derived_functions.leading_embedding(a, b)
    assert W.tolist() == [[-0.5, -2.0], [1.0, 0.0], [0.0, 1.0]]
    assert offset.tolist() == [-3.0, 0.0, 0.0]
    assert derived_functions.leading_embedding(a, None)[
        1
    ] is None and derived_functions.leading_embedding(None, None) == (None, None)
    assert derived_functions.embedded_rest(a, np.array([8.0])).tolist() == [-4.0, 0.0, 0.0]
    assert derived_functions.embedded_rest(None, None) is None
    v = np.array([5.0, 6.0, 7.0])
    for known, kept in ((a, [6.0, 7.0]), (None, [5.0, 6.0, 7.0])):
        u = derived_functions.independent(known, v)
        assert u.tolist() == kept
        u[0] = 9.0
        assert v.tolist() == [5.0, 6.0, 7.0]
    J, J_rest = np.arange(6.0).reshape(1, 2, 3), np.array([[10.0, 20.0]])
    assert derived_functions.partials(J, W).tolist() == [[[1.0, 2.0], [2.5, -1.0]]]
    assert derived_functions.partials(J, None) is J
    rest = np.array([-4.0, 1.0, 0.5])
    assert derived_functions.remainders(J, J_rest, rest).tolist() == [[12.0, 14.5]]
    assert derived_functions.remainders(J, J_rest, None) is J_rest
    Q = np.array([2.0, 3.0, 5.0])
    assert derived_functions.projected_forces(W, Q).tolist() == [2.0, 1.0]
    assert (
        derived_functions.projected_forces(None, Q) is Q
        and derived_functions.projected_forces(W, None) is None
    )


def test_bodies_have_these_inertia_forces_and_this_energy():
    mass, inertia = np.array([2.0, 3.0]), np.array([[[1.0, 0.5], [0.5, 4.0]], [[2.0, 0.0], [0, 6]]])
    linear = np.array([[[1.0, 2.0]], [[0.0, 3.0]]])
    angular = np.array([[[1.0, 0.0], [2.0, 1.0]], [[0.0, 1.0], [1.0, 0.0]]])
    rests = np.array([[5.0], [7.0]]), np.array([[1.0, -1.0], [2.0, 0.5]])
    gyroscopic = np.array([[0.25, 0.5], [1.0, -2.0]])
    M, B = derived_functions.inertia_terms(mass, inertia, linear, angular, *rests, None)
    expected, force = np.zeros((2, 2)), np.zeros(2)
    for k in range(2):
        expected += mass[k] * linear[k].T @ linear[k] + angular[k].T @ inertia[k] @ angular[k]
        force += mass[k] * linear[k].T @ rests[0][k] + angular[k].T @ inertia[k] @ rests[1][k]
    np.testing.assert_allclose(M, expected)
    np.testing.assert_allclose(B, force)
    _, more = derived_functions.inertia_terms(mass, inertia, linear, angular, *rests, gyroscopic)
    # 0.25 + 2 0.5 of the first body and -2 of the second; 0.5 of the first and 1 of the second.
    np.testing.assert_allclose(more - B, [-0.75, 1.5])
    V, omega = np.array([[1.0], [2.0]]), np.array([[1.0, 2.0], [0.5, 1.0]])
    # (2 + 12)/2 of what moves; (1 + 2 + 16)/2 and (0.5 + 6)/2 of what turns.
    assert derived_functions.kinetic_energy(mass, inertia, V, omega) == 7.0 + 9.5 + 3.25


def test_a_body_is_moved_by_all_speeds_where_a_dependent_velocity_moves_it():
    moved = np.array([[True, False, False, True], [False, False, True, False], [False] * 4])
    scene = SimpleNamespace(r=1, derived_functions={"kinematics", "bodies", "terms"})
    expected = [[True] * 3, [False, True, False], [False] * 3]
    assert derived_functions.support_of(scene, moved).tolist() == expected
    scene.r = 0
    assert (derived_functions.support_of(scene, moved) == moved).all()
    scene.derived_functions = {"bodies"}
    assert derived_functions.support_of(scene, moved) is None


# ---- Scenes --------------------------------------------------------------------------------------


def test_arrays_are_read_as_new_ones_and_refused_by_their_first_bad_entry():
    given = np.array([1.0, 2.0])
    found = finite_array("q", given, (2,))
    found[0] = 5.0
    assert given[0] == 1.0 and found.dtype == np.float64
    assert finite_array("q", [1, 2], (2,)).tolist() == [1.0, 2.0]
    assert finite_array("t", 3, ()).shape == ()
    bad = [[0.0, 1.0, 2.0], [3.0, np.inf, np.nan]]
    for name, value, shape, said in (
        ("q", [1.0, np.nan, np.inf], (3,), "q[1] = nan, expected a finite number"),
        ("I", bad, (2, 3), "I[1, 1] = inf, expected a finite number"),
        ("t", -np.inf, (), "t = -inf, expected a finite number"),
        ("q", [1.0], (2,), "q has shape (1,), expected (2,)"),
        ("q", [True, False], (2,), "q = [True, False] is not an array of real numbers"),
        ("q", [1.0, 1j], (2,), "q = [1.0, 1j] is not an array of real numbers"),
    ):
        with pytest.raises(InputError) as refused:
            finite_array(name, value, shape)
        assert str(refused.value) == said


@pytest.mark.parametrize(
    ("n", "good"),
    [(0, True), (MAX_COORDINATES, True), (MAX_COORDINATES + 1, False), (-1, False), (2.0, False)],
)
def test_a_scene_has_from_none_to_20000_coordinates(n, good):
    class Counted(ChainPendulum):
        n: Any = property(lambda scene: n)

    scene = ChainPendulum.structures(2)
    counted = object.__new__(Counted)
    vars(counted).update(vars(next(scene)))
    if good:
        assert checked_scene(counted) is counted
        return
    with pytest.raises(InputError, match="expected a whole number from 0 to 20000"):
        checked_scene(counted)


def test_some_constraints_have_the_rows_of_all():
    scene = Lifted()
    for names in (["lift"], ["blade"]):
        some = with_constraints(scene, names)
        q, v = scene.initial_state()
        q, v = q + 0.1, v + np.arange(scene.n)
        here, whole = Evaluation(some, q, v, 0.5), Evaluation(scene, q, v, 0.5)
        (row,) = (scene.constraint_names.index(name) for name in names)
        for name in ("a", "gamma", "b"):
            assert (getattr(here.terms, name) == getattr(whole.terms, name)[[row]]).all(), name
        rates = [at.scene.constraint(at.parameters, at.prepared, q, v) for at in (here, whole)]
        assert rates[0].tolist() == [rates[1][row]]
        (left,) = {*scene.constraint_names} - {*names}
        assert some.structure == f"{scene.structure}, without the constraint of {left}"
        assert some.holonomic == slice(0, int(names == ["lift"]))
        assert some.sketch(q) is None


def test_all_constraints_that_are_left_out_are_named():
    ring = Bricard()
    names = ring.constraint_names
    some = with_constraints(ring, [names[3], names[1]])
    out = ", ".join(name for i, name in enumerate(names) if i not in (1, 3))
    assert some.structure == f"{ring.structure}, without the constraint of {out}"
    assert some.constraint_names == (names[1], names[3])
    assert repr(some) == f"eomcheck.with_constraints({ring!r}, {(names[1], names[3])!r})"


# ---- Evaluations ---------------------------------------------------------------------------------


class Parts(NamedTuple):
    x: Any
    y: Any
    z: Any


def test_literals_become_numbers_and_doubles_that_are_not_whole_are_refused():
    objects = np.array([2, 0.5], object)
    found = with_literals(Parts(3, objects, np.array([[4.0, 5.0]])), lambda x: f"<{x}>")
    assert found.x == "<3>" and found.y.tolist() == ["<2>", 0.5]
    assert found.z.tolist() == [["<4>", "<5>"]]
    assert with_literals(Parts(None, 0.5, "x"), str) == Parts(None, 0.5, "x")
    said = r"an array of doubles, \[1\.  0\.5 3\. \] \.\.\."
    with pytest.raises(NotRationalError, match=said):
        with_literals(Parts(1, None, np.array([[1.0, 0.5], [3.0, 4.0]])), str)


def test_forces_and_rates_leave_out_what_is_absent():
    Q, B = np.array([3.0, 4.0]), np.array([1.0, 5.0])
    for q, b, expected in ((Q, B, [2.0, -1.0]), (Q, None, [3.0, 4.0]), (None, B, [-1.0, -5.0]),
                           (None, None, [0.0, 0.0])):  # fmt: skip
        assert net_force(np.eye(2), q, b).tolist() == expected
    W, rest = np.array([[1.0], [2.0]]), np.array([10.0, 20.0])
    assert rate_of_velocity(np.array([3.0]), W, rest).tolist() == [13.0, 26.0]
    assert rate_of_velocity(B, None, None) is B


def evaluation(**known: Any) -> Any:
    at: Any = object.__new__(Evaluation)
    vars(at).update(known)
    return at


def test_the_pivoted_partition_is_that_of_the_largest_columns_in_order():
    a = np.array([[0.1, 0.0, 5.0, 1.0], [0.0, 4.0, 0.0, 0.2]])
    at = evaluation(terms=SimpleNamespace(a=a), scene=SimpleNamespace(r=2, n=4))
    found = at.pivoted_partition
    assert found.dependent.tolist() == [1, 2] and found.independent.tolist() == [0, 3]
    free = evaluation(terms=SimpleNamespace(a=None), scene=SimpleNamespace(r=0, n=2))
    assert free.pivoted_partition is free.partition
    assert free.partition.dependent.tolist() == [] and free.partition.independent.tolist() == [0, 1]


@pytest.mark.parametrize(
    ("vdot", "multipliers"),
    [([1.0, np.inf], None), ([np.nan, 1.0], [0.0]), ([1.0, 2.0], [0.0, -np.inf])],
)
def test_what_overflows_is_refused_wherever_it_does(vdot, multipliers):
    at, key = evaluation(), FORMULATIONS["au"]
    multipliers = None if multipliers is None else np.array(multipliers)
    with pytest.raises(RefusedError) as refused:
        at.check_finite(np.array(vdot), multipliers, key)
    said = "the acceleration v̇ by au overflows: doubles cannot hold it"
    assert said in str(refused.value) and refused.value.what == "v̇"
    at.check_finite(np.array([1.0, 2.0]), np.array([0.0]), key)
    at.check_finite(np.array([1.0, 2.0]), None, key)


def test_what_a_state_keeps_is_found_once_and_a_refusal_is_raised_again():
    scene = Snake.coil(3)
    at, asked = Evaluation(scene, *scene.initial_state(), 0.5), []

    def found(where: Evaluation) -> int:
        asked.append(where)
        return len(asked)

    def other(where: Evaluation) -> int:
        return 7

    assert [at.cached(found), at.cached(other), at.cached(found)] == [1, 7, 1]
    assert asked == [at]
    with pytest.raises(InputError, match="pivoted = True: au has no partition to choose"):
        at.partition_for(FORMULATIONS["au"], pivoted=True)
    ring = Bricard(redundant=2.0)
    here = Evaluation(ring, *ring.initial_state())
    refusals = []
    for _ in range(2):
        with pytest.raises(RefusedError) as refused:
            here.acceleration(FORMULATIONS["au"])
        refusals.append(refused.value)
    assert refusals[0] is refusals[1]
    elsewhere = at.elsewhere(at.q + 1.0)
    assert (elsewhere.q == at.q + 1.0).all() and (elsewhere.v == at.v).all()
    assert elsewhere.t == 0.5 and elsewhere.scene is scene


# ---- Right-hand sides ----------------------------------------------------------------------------


def test_a_right_hand_side_reads_the_clock_and_tells_when_it_was_asked_last():
    slide = Joint("x", "prismatic", "ground", "a", axis=(1.0, 0.0, 0.0), stiffness=8.0, damping=3.0)
    scene: Any = mechanism("Sprung", [GROUND, rod("a")._replace(mass=2.0)], [slide])()
    rates = RightHandSide(scene, FORMULATIONS["el"])
    # 2 ẍ = -8 x - 3 ẋ.
    assert rates(0.75, np.array([0.5, 4.0])).tolist() == [4.0, -8.0]
    assert (rates.time, rates.calls, rates.failed) == (0.75, 1, 0)
    jacobian: Callable = exact_jacobian(scene, FORMULATIONS["el"])
    assert jacobian(0.0, np.array([0.5, 4.0])).tolist() == [[0.0, 1.0], [-4.0, -1.5]]


@pytest.mark.parametrize("key", ["au", "kane", "em"])
def test_a_kernel_with_accelerations_has_these_outputs(key):
    scene = Driven()
    outputs = kernel_of(scene, FORMULATIONS[key], also=ACCELERATION).outputs
    size = {"au": 5, "kane": 3, "em": 3}[key]
    more = {"multipliers": 1} if key == "au" else {}
    assert outputs == {"rates": size, "vdot": 2, **more}


def test_parameters_that_are_absent_are_no_part_of_a_block_and_come_back_as_none():
    scene = replace(Snake.coil(2), stiffness=None)
    arrays = right_hand_side.parameter_arrays(scene)
    assert "stiffness" not in arrays and "mass" in arrays
    assert arrays["mass"].tolist() == scene.mass.tolist()
    record = right_hand_side.parameter_record(scene, {name: name for name in arrays})
    assert {name: x for name, x in record._asdict().items() if x is not None} == {
        name: name for name in arrays
    }
    assert record.stiffness is None


def test_only_a_chain_with_the_same_terms_is_continued(monkeypatch):
    scene = replace(Snake.coil(3), stiffness=None)
    other: Any = right_hand_side._shorter_scene(scene, 5)
    assert other.links == 5 and other.stiffness is None
    monkeypatch.setattr(Snake, "structures", classmethod(lambda kind, links: [Snake.coil(links)]))
    with pytest.raises(
        right_hand_side.NotRegularError, match="no snake of 5 links has the terms of snake"
    ):
        right_hand_side._shorter_scene(scene, 5)


# ---- Runs in many digits -------------------------------------------------------------------------


def run_of(q: list, v: list, times: list[float]) -> ReferenceRun:
    return ReferenceRun(
        times, decimals(np.array(q, object)), decimals(np.array(v, object)), None, None, {}
    )


def test_two_runs_are_apart_by_their_largest_difference_at_each_time():
    still = run_of([["0", "0"], ["0", "0"]], [["0", "0"], ["0", "0"]], [0.0, 1.0])
    moved = run_of([["1", "-5"], ["0", "2"]], [["3", "0"], ["0", "-7"]], [0.0, 1.0])
    apart = difference(moved, still)
    assert apart == difference(still, moved) == [5.0, 7.0]
    assert all(type(x) is float for x in apart)
    fewer = run_of([["0"], ["0"]], [["0"], ["0"]], [0.0, 1.0])
    with pytest.raises(InputError, match="differ in their times or in their number of coord"):
        difference(still, fewer)


def test_digits_are_read_in_their_places_and_others_are_refused():
    found = decimals(np.array([["1.5", "-2"], ["3e-40", "1" + "0" * 40]], object))
    assert found.tolist() == [
        [Decimal("1.5"), Decimal(-2)],
        [Decimal("3e-40"), Decimal("1e40")],
    ]
    for bad, said in (("x", "not all numbers are strings of digits"),
                      (None, "not all numbers are strings of digits"),
                      ("nan", "not all numbers are finite"),
                      ("-inf", "not all numbers are finite")):  # fmt: skip
        with pytest.raises(ValueError, match=said):
            decimals(np.array(["1", bad], object))


def test_reaching_cyrk_leaves_nothing_of_its_packages_behind():
    names = ("CyRK", "CyRK.nb", "CyRK.cy")
    before = [name in sys.modules for name in names]
    common = integrators._extension("cy.common")
    assert [name in sys.modules for name in names] == before
    assert integrators.load_cyrk().MAX_SIZE == common.MAX_SIZE > 2**31
    assert integrators.load_cyrk() is integrators.load_cyrk()
    assert {*integrators.FUNCTIONS} <= {*vars(integrators.load_cyrk())}
