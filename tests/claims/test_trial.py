"""Engines on trial: the sizes that are allowed them, and what is said of what they answer."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.claims.test_checks import SNAKE, Q, V

from eomcheck.claims import CLAIMS, Case, run
from eomcheck.claims import case as trial
from eomcheck.claims.finding import Finding
from eomcheck.engines import PinocchioFile
from eomcheck.engines import answers as interface
from eomcheck.engines.casadi import CasadiEngine
from eomcheck.engines.mujoco import MujocoEngine
from eomcheck.errors import InputError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.mechanics.records import State
from eomcheck.scenes import ChainPendulum, Sleigh, Snake


def somewhere(**more: Any) -> Any:
    """Return numbers of a state of which no two are alike; the last two of 4 velocities turn."""
    M = np.array(
        [[4.0, -1.0, 0.5, 0.0], [-1.0, 3.0, 0.0, -0.25], [0.5, 0, 2, -1], [0, -0.25, -1, 5]]
    )
    a = np.array([[1.0, -2.0, 0.5, 4.0], [0.0, 1.0, -3.0, 0.5]])
    scene = SimpleNamespace(n=4, angle_coordinates=slice(2, 4))
    terms = SimpleNamespace(M=M, a=a)
    here = {"scene": scene, "terms": terms, "q": np.zeros(4), "v": np.array([3.0, -5.0, 2.0, -1.0])}
    at = SimpleNamespace(parameters=(np.ones(3), None), unit_roundoff=2.0**-53, **(here | more))
    at.cached = lambda function: function(at)
    return at


# ---- Sizes ---------------------------------------------------------------------------------------


def test_inertia_forces_are_the_largest_momentum_times_all_rates_of_angles():
    assert interface.inertia_size(somewhere()) == (2 + 1) * (3 + 3 * 5 + 0.25)
    slow = somewhere(v=np.array([0.5, 0.0, 0.0, -7.0]))
    assert interface.inertia_size(slow) == 7 * 35.0


def test_drift_is_the_largest_sum_of_a_row_in_which_every_angle_turns_as_fast_as_all():
    assert interface.drift_size(somewhere()) == 3 * max(3 + 10 + 0.5 * 3 + 4 * 3, 5 + 9 + 1.5)
    free = somewhere()
    free.terms.a = None
    assert interface.drift_size(free) == 0.0


def test_the_size_of_a_state_leaves_it_as_it_is():
    at = somewhere()
    interface.drift_size(at)
    assert at.v.tolist() == [3.0, -5.0, 2.0, -1.0]


def test_mass_is_summed_of_bodies_as_the_engine_has_them():
    """Relative angles: the far one of two bodies is counted in each that it hangs on."""
    at = somewhere(scene=SimpleNamespace(n=2))
    at.terms.M = np.array([[7.0, 3.0], [3.0, 2.0]])
    S = np.array([[1.0, 0.0], [-1.0, 1.0]])
    # M_x of absolute rates is [[15, 5], [5, 2]], and |S| adds what S takes off.
    assert interface.mass_size(at, S) == pytest.approx(15 + 5 + 5 + 2)
    assert interface.mass_size(at, np.eye(2)) == 0.0
    assert interface.mass_size(at, 2 * np.eye(2)) == pytest.approx(7.0)


def tree(**more: Any) -> Any:
    """Return a slide, on which two hinges sit one after the other, and a third on the ground."""
    here = {
        "parent": (-1, 0, 1, -1),
        "joint": ("px", "rz", "rz", "rz"),
        "offset": np.array([[3.0, 4.0, 0], [0, 2.0, 0], [0, 0, 1.0], [0, 0, 0]]),
        "mass": np.array([2.0, 3.0, 0.5, 1.0]),
        "center": np.array([[0.0, 0, 0], [6.0, 8.0, 0], [0, 0, 3.0], [0.25, 0, 0]]),
        "coordinates": np.eye(4),
        "shift": np.array([0.5, 0, 0, 0]),
    }
    return SimpleNamespace(**(here | more))


@pytest.mark.parametrize(
    ("more", "longest"),
    [
        ({}, 5 + 1.5 + 2 + 10),
        ({"center": np.array([[0.0, 0, 0], [0, 1.0, 0], [0, 0, 8.0], [0, 0, 0]])}, 8.5 + 1 + 8),
        ({"mass": np.array([2.0, 0.0, 3.5, 1.0])}, 5 + 1.5 + 2 + 1 + 3),
        ({"joint": ("rx", "rz", "rz", "rz")}, 5 + 2 + 10),
        ({"mass": np.array([0.0, 0.0, 0.0, 6.5])}, 1.0),  # what slides feels the weight itself
        ({"mass": np.array([0, 0, 0, 6.5]), "joint": ("rx", "rz", "rz", "rz")}, 0.25),
    ],
    ids=["second", "third", "without mass", "no slide", "slide", "hinge"],
)
def test_weights_pull_at_arms_as_long_as_the_tree(more: dict, longest: float):
    weight = np.array([0.0, 6.0, -8.0])
    hanging = SimpleNamespace(tree=lambda: tree(**more, gravity=weight))
    at = somewhere(scene=hanging, q=np.array([1.0, 5.0, 7.0, -3.0]))
    assert interface.weight_size(at) == pytest.approx(6.5 * 10 * longest)


@pytest.mark.parametrize(
    ("more", "size"),
    [
        ({}, (3 * 5**2 + 0.5 * 7**2 + 1) * 18.5),  # m ω², and the longest arm of all
        ({"joint": ("rx", "rz", "rz", "rz")}, (2 * 3**2 + 3 * 8**2 + 0.5 * 10**2 + 1) * 17.0),
        ({"mass": np.array([2.0, 0.0, 0.0, 0.0])}, 0.0),  # which slides, and does not turn
        ({"mass": np.array([0.0, 0.0, 0.0, 6.5])}, 6.5 * 0.25),
        ({"coordinates": np.diag([1.0, 0, 2.0, 1.0])}, (0.5 * 4**2 + 1) * 18.5),
    ],
    ids=["slide", "no slide", "slide alone", "hinge", "follows"],
)
def test_a_body_turns_by_the_joints_on_its_path_whatever_turns_elsewhere(more: dict, size: float):
    hanging = SimpleNamespace(tree=lambda: tree(**more))
    at = somewhere(scene=hanging, q=np.array([1.0, 5.0, 7.0, -3.0]))
    assert interface.turning_size(at) == pytest.approx(size)


def test_nothing_weighs_without_a_tree_or_without_gravity():
    for scene in (
        SimpleNamespace(tree=lambda: None, gravity=9.81),
        SimpleNamespace(tree=lambda: tree(gravity=np.zeros(3))),
        SimpleNamespace(tree=lambda: tree(gravity=np.zeros(3)), gravity=9.81),
    ):
        assert interface.weight_size(somewhere(scene=scene)) == 0.0


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({}, False),
        ({"q": np.array([0, 0, 2e100, 0])}, True),
        ({"v": np.array([0, -2e100, 0, 0])}, True),
        ({"q": np.full(4, 5e99)}, False),
    ],
)
def test_a_state_overflows_by_any_of_its_numbers(more: dict, said: bool):
    assert interface.overflows(somewhere(**more)) == said


def test_a_scene_overflows_by_any_of_its_numbers():
    at = somewhere()
    at.parameters = (np.ones(3), None, np.array([1.0, 1e101, 1.0]), np.ones(2))
    assert interface.overflows(at)


def test_each_question_has_the_size_of_its_own_terms():
    scene = ChainPendulum.rods(3)
    q, v = np.array([0.4, -0.7, 1.1]), np.array([1.0, 2.0, -0.5])
    case = Case(Evaluation(scene, q, v), (), ())
    engine = CasadiEngine(scene)
    sizes = {
        method: trial.cancelling_size(case, engine, method)
        for method in ("bias", "forces", "constraint_drift", "mass_matrix", "constraint_jacobian")
    }
    at = case.at
    assert sizes["bias"] == interface.inertia_size(at) + engine.bias_size(q, v, 0.0)
    assert sizes["forces"] == interface.weight_size(at) > 0
    S = engine.velocity_map(q, v).S
    assert sizes["mass_matrix"] == interface.mass_size(at, S)
    assert sizes["constraint_drift"] == interface.drift_size(at)
    assert sizes["constraint_jacobian"] == 0.0
    assert trial.cancelling_size(case, type("Tried", (CasadiEngine,), {})(scene), "bias") == (
        interface.inertia_size(at)
    )


# ---- What takes part -----------------------------------------------------------------------------


def of_links(*links: int) -> Any:
    """Return an engine for snakes of so many links alone."""
    says = classmethod(lambda cls, scene: isinstance(scene, Snake) and scene.n - 2 in links)
    return type("Of", (CasadiEngine,), {"key": "of", "represents": says})


@pytest.mark.parametrize(("links", "said"), [((1,), True), ((3,), True), ((4,), False)])
def test_a_kind_is_represented_where_some_small_scene_of_it_is(links, said):
    assert interface.represents_some(of_links(*links), Snake) == said
    assert not interface.represents_some(of_links(*links), Sleigh)


def test_one_engine_of_several_is_enough_for_a_kind_of_scene():
    sleighs = type(
        "Own", (CasadiEngine,), {"represents": classmethod(lambda cls, x: isinstance(x, Sleigh))}
    )
    kinds = (ChainPendulum, Sleigh, Snake)
    assert interface.represented([of_links(2), sleighs], kinds) == (Sleigh, Snake)
    with pytest.raises(InputError, match="engine of, of represents none of the scenes chain-pend"):
        interface.represented([of_links(2), of_links(3)], kinds[:2])


def said(claim: str, subject: str, verdict: Any) -> Finding:
    return Finding(claim, subject, SNAKE, State(Q, V), 0.0, 1.0, verdict, "compared")


def test_an_engine_is_compared_where_a_claim_that_asks_it_is_decided():
    one, other = CasadiEngine, MujocoEngine
    bias = said("bias", "casadi", "passed")
    both = [bias, said("engine-acceleration", "au ~ mujoco", "failed")]
    run.check_compared([one, other], both)
    for findings, missed in (
        ([bias], "mujoco"),
        (both[1:], "casadi"),
        ([bias, said("bias", "mujoco", "inconclusive")], "mujoco"),
        ([bias, said("bias", "mujoco", "skipped")], "mujoco"),
        ([bias, said("kinetic-energy", "mujoco", "passed")], "mujoco"),
    ):
        with pytest.raises(InputError, match=f"engine {missed}: nothing could be compared"):
            run.check_compared([one, other], findings)


# ---- What is said --------------------------------------------------------------------------------

EXPECTED = np.array([[4.0, -3.0, 2.0], [1.0, 0.0, -0.5]])


def changed(entry: tuple[int, int], by: float) -> np.ndarray:
    found = EXPECTED.copy()
    found[entry] += by
    return found


@pytest.mark.parametrize(
    ("entry", "by", "what"),
    [
        ((0, 1), 6.0, "found 3, expected -3: wrong sign"),
        ((1, 1), 0.25, "found 0.25, expected 0: should vanish"),
        ((0, 0), 0.123456789123, "found 4.12345679, expected 4"),
        ((1, 2), 1e-3, "found -0.499, expected -0.5"),
        ((0, 2), 7.7e-6, "found 2.0000077, expected 2"),  # 4 * 2^-19 is 7.63e-6
        (
            (0, 2),
            7.6e-6,
            "found 2.0000076, expected 2: as large as the rounding of single precision",
        ),
    ],
)
def test_of_an_engine_on_trial_both_numbers_of_the_worst_entry_are_said(entry, by, what):
    found = changed(entry, by)
    found[1, 0] += 1e-7
    assert trial.describe_engine_error(CasadiEngine, found, EXPECTED, 1e-12) == what


def test_of_the_library_of_a_file_nobody_is_blamed():
    kind, found = PinocchioFile, changed((0, 1), 6.0)
    assert (
        trial.describe_engine_error(kind, found, EXPECTED, 1e-12)
        == "3 by the library, -3 by eomcheck"
    )
    own: Any = type("Reader", (PinocchioFile,), {})
    assert (
        trial.describe_engine_error(own, found, EXPECTED, 1e-12)
        == "3 by the library, -3 by eomcheck: wrong sign"
    )
    slight = trial.describe_engine_error(kind, changed((1, 0), -1e-6), EXPECTED, 1e-12)
    assert slight.startswith("0.999999 by the library, 1 by eomcheck: as large as")


def with_answer(found: Any, fresh: Any) -> Finding:
    """Return the Finding on an engine that answers this, and this when it is new."""
    case = Case(Evaluation(SNAKE, Q, V), (), (), CLAIMS["constraint-drift"])

    class Tried(CasadiEngine):
        key = "tried"

    def again(answers: Any) -> Any:
        if fresh is None:
            raise ValueError("no answer")
        return fresh

    names = (SNAKE.constraint_names[:2],)
    engine, ours = Tried(SNAKE), np.array([2.0, -1.0])
    return trial.compare_with_engine(
        case, engine, "tried", ours, np.array(found), 1.0, again, names=names
    )


KEEPS = "; a new engine answers right: it keeps what it was asked before"


@pytest.mark.parametrize(
    ("fresh", "kept"),
    [([2.0, -1.0], True), ([2.0, -1.0 + 1e-15], True), ([2.0, 3.0], False), (None, False)],
)
def test_an_engine_that_is_right_when_it_is_new_keeps_what_it_was_asked(fresh, kept):
    one = with_answer([2.0, 3.0], fresh)
    assert one.verdict == "failed" and one.engine is not None and one.observed == 4.0
    assert one.detail.endswith(KEEPS) == kept
    assert with_answer([2.0, -1.0], fresh).detail == ""
