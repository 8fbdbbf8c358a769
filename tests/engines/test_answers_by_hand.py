"""Answers of engines made by hand: every message whole, every map, and what is built of a tree."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.engines.test_walk import link

from eomcheck.engines import (
    Answers,
    Engine,
    EngineFault,
    VelocityMap,
    make_engine,
    represents,
    version_of,
)
from eomcheck.engines.casadi import CasadiEngine, _solved
from eomcheck.engines.tree_engine import TreeEngine, all_move, bodies_with_mass, tree_links
from eomcheck.errors import CallError, EngineError, InputError
from eomcheck.mechanics.records import Tree
from eomcheck.scenes import ChainPendulum, Snake

HERE = "test_answers_by_hand.py"
SCENE: Any = SimpleNamespace(n=2, r=1, p=1, name="two")
Q, V, ROW = np.array([0.5, -3.0]), np.array([1.0, 8.0]), np.array([[1.0, 2.0]])


class Plain(Engine):
    """An engine with the scene's own coordinates, all of whose answers are right in their kind."""

    solves_like = "au"
    version = classmethod(lambda cls: "plain 1")
    represents = classmethod(lambda cls, scene: True)

    def mass_matrix(self, q, t=0.0):
        return np.diag([2, 3])

    def bias(self, q, v, t=0.0):
        return np.array([4, 5])

    def acceleration(self, q, v, Q, a, gamma, t=0.0):
        return np.array([1.0, 2.0]), None if a is None else np.array([3.0])


def answering(method: str, answer: Any, kind: type[Engine] = Plain) -> Answers:
    """Return answers of an engine one of whose methods returns this."""
    changed: Any = type("Changed", (kind,), {method: lambda self, *_: answer})
    return Answers(changed(SCENE))


# ---- Answers that are none, and their messages ---------------------------------------------------

SIX = "expected an array of shape"


class Odd:
    """No array, though it says that it is one."""

    def __array__(self, *_: Any, **__: Any) -> Any:
        raise OSError("gone")


@pytest.mark.parametrize(
    ("method", "answer", "said"),
    [
        ("bias", None, f"bias returned None, {SIX} (2)"),
        ("bias", 3, f"bias returned an int, {SIX} (2)"),
        ("bias", [1.0, 2.0], f"bias returned a list, {SIX} (2)"),
        ("bias", np.float64(2.0), f"bias returned an array of shape (), {SIX} (2)"),
        ("bias", np.zeros(3), f"bias returned an array of shape (3,), {SIX} (2)"),
        ("mass_matrix", np.zeros((2, 3)), f"mass_matrix returned an array of shape (2, 3), {SIX} "
         "(2, 2)"),
        ("bias", np.array([1.0, 2.0], complex), "bias returned an array of complex128, expected "
         "real numbers"),
        ("bias", np.array([True, False]), "bias returned an array of bool, expected real numbers"),
        ("bias", np.array([1.0, 2.0], object), "bias returned an array of object, expected real "
         "numbers"),
        ("bias", np.array([1.0, -np.inf]), "bias returned -inf in entry [1]"),
        ("mass_matrix", np.array([[1.0, 2.0], [np.nan, np.inf]]), "mass_matrix returned nan in "
         "entry [1, 0]"),
        ("bias", np.ma.array([1.0, 2.0], mask=[False, True]), "bias returned a masked array, of "
         "which entries are masked"),
        ("velocity_map", 1.5, "velocity_map returned a float, expected (x, S, Ṡ v)"),
        ("velocity_map", (Q, np.eye(2)), "velocity_map returned a tuple, expected (x, S, Ṡ v)"),
        ("velocity_map", (Q, np.eye(3), Q), "velocity_map: S returned an array of shape (3, 3), "
         f"{SIX} (any, 2)"),
        ("velocity_map", (np.eye(2), np.eye(2), Q), "velocity_map: x returned an array of shape "
         f"(2, 2), {SIX} (any)"),
        ("velocity_map", (Q, np.ones((3, 2)), Q), "velocity_map: Ṡ v returned an array of shape "
         f"(2,), {SIX} (3)"),
        ("acceleration", Q[:1], "acceleration returned a ndarray, expected (v̇, λ or None)"),
        ("acceleration", (Q, None, 1), "acceleration returned a tuple, expected (v̇, λ or None)"),
        ("acceleration", (ROW, None), "acceleration: v̇ returned an array of shape (1, 2), "
         f"{SIX} (2)"),
        ("acceleration", (Q, Q), f"acceleration: λ returned an array of shape (2,), {SIX} (1)"),
        ("kane_inertia_remainder", (Q, 1.0, 1.0), "kane_inertia_remainder returned an array of "
         f"shape (2,), {SIX} (1)"),
        ("forces", Q[:1], f"forces returned an array of shape (1,), {SIX} (2)"),
        ("constraint_jacobian", Q, "constraint_jacobian returned an array of shape (2,), "
         f"{SIX} (1, 2)"),
        ("constraint_drift", Q, f"constraint_drift returned an array of shape (2,), {SIX} (1)"),
    ],
)  # fmt: skip
def test_an_answer_of_another_kind_is_told_in_these_words(method: str, answer: Any, said: str):
    more = (Q, ROW, Q[:1]) if method == "acceleration" else ()
    asked = "mass_matrix" if method == "velocity_map" else method
    with pytest.raises(EngineFault) as fault:
        answering(method, answer).ask(asked, Q, V, *more, 0.0)
    assert fault.value.what == said


def test_an_array_that_raises_is_told_with_its_kind():
    with pytest.raises(EngineFault) as fault:
        answering("bias", Odd()).bias(Q, V)
    said = f"bias returned an Odd, which raised OSError: gone ({HERE}, line "
    assert fault.value.what.startswith(said)


@pytest.mark.parametrize("kind", [np.int32, np.uint8, np.float32, np.float64])
def test_answers_of_any_real_numbers_are_new_arrays_of_doubles(kind: Any):
    answer = np.array([1, 2], kind)
    found = answering("bias", answer).bias(Q, V)
    assert (found.dtype, found.tolist()) == (np.float64, [1.0, 2.0])
    found[:] = 0.0
    assert answer.tolist() == [1, 2]
    unmasked = np.ma.array([1.0, 2.0], mask=[False, False])
    assert answering("bias", unmasked).bias(Q, V).tolist() == [1.0, 2.0]


def test_an_array_that_an_engine_changes_is_its_own_and_told():
    class Writing(Plain):
        def bias(self, q, v, t=0.0):
            v[0] = 7.0
            return v

    engine: Any = Writing
    with pytest.raises(EngineFault) as fault:
        Answers(engine(SCENE)).bias(Q, V)
    assert fault.value.what == "bias changes an array that it is handed"
    assert V.tolist() == [1.0, 8.0]
    # What is no number stays what it is.
    assert answering("bias", Q).bias(Q, np.array([np.nan, 1.0])).tolist() == Q.tolist()


def broken(cls: Any, *_: Any) -> Any:
    raise KeyError("wheels")


def missing(cls: Any, *_: Any) -> Any:
    raise EngineError("no library")


def test_an_engine_that_cannot_be_made_asked_or_named_is_told_with_the_line():
    line = broken.__code__.co_firstlineno + 1
    how = f"raised KeyError: 'wheels' ({HERE}, line {line})"
    kind: Any = type("Changed", (Plain,), {"__init__": broken})
    with pytest.raises(EngineFault) as fault:
        make_engine(kind, SCENE)
    assert fault.value.what == f"Changed(scene) {how}"
    for name, ask, said in (
        ("represents", lambda x: represents(x, SCENE), "represents(two)"),
        ("version", version_of, "version()"),
    ):
        changed: Any = type("Changed", (Plain,), {name: classmethod(broken)})
        with pytest.raises(InputError) as error:
            ask(changed)
        assert str(error.value) == f"engine Changed: {said} {how}"
        lost: Any = type("Changed", (Plain,), {name: classmethod(missing)})
        with pytest.raises(EngineError, match=r"^no library$"):
            ask(lost)
    lost = type("Changed", (Plain,), {"__init__": missing})
    with pytest.raises(EngineError, match=r"^no library$"):
        make_engine(lost, SCENE)
    right: Any = Plain
    assert make_engine(right, SCENE).scene is SCENE
    assert represents(right, SCENE) is True
    odd: Any = type("Changed", (Plain,), {"represents": classmethod(lambda *_: [])})
    assert represents(odd, SCENE) is False


@pytest.mark.parametrize(
    ("version", "told"),
    [
        ("plain 1", "plain 1"),
        ("  plain\n1\x07 ", "plain 1�"),
        ("", "returned '', expected a text"),
        (" \n", "returned ' \\n', expected a text"),
        (None, "returned None, expected a text"),
        (2, "returned an int, expected a text"),
        ({}, "returned a dict, expected a text"),
    ],
)
def test_a_version_is_one_line_of_text(version: Any, told: str):
    kind: Any = type("Changed", (Plain,), {"version": classmethod(lambda cls: version)})
    if told.startswith("returned"):
        with pytest.raises(InputError) as error:
            version_of(kind)
        assert str(error.value) == f"engine Changed: version() {told}"
    else:
        assert version_of(kind) == told


def test_a_call_that_ends_otherwise_is_told_without_a_line_of_ours():
    with pytest.raises(EngineFault) as fault:
        leaving: Any = type("Leaving", (Plain,), {"bias": leave})
        Answers(leaving(SCENE)).bias(Q, V)
    assert fault.value.what.startswith("bias raised SystemExit: 3")
    assert isinstance(fault.value.__cause__, CallError)


def leave(self: Any, *_: Any) -> Any:
    raise SystemExit(3)


# ---- Coordinates of the engine, and where it is asked elsewhere ----------------------------------


def test_without_a_map_all_is_handed_on_as_it_is():
    asked: dict[str, Any] = {}

    class Asked(Plain):
        def acceleration(self, q, v, Q, a, gamma, t=0.0):
            asked.update(q=q, v=v, Q=Q, a=a, gamma=gamma, t=t)
            return super().acceleration(q, v, Q, a, gamma, t)

    kind: Any = Asked
    answers = Answers(kind(SCENE))
    x, S, rest = answers.velocity_map(Q, V)
    assert (x.tolist(), S.tolist(), rest.tolist()) == ([0.5, -3.0], [[1, 0], [0, 1]], [0, 0])
    assert answers.mass_matrix(Q).tolist() == [[2, 0], [0, 3]]
    assert answers.bias(Q, V).tolist() == [4, 5]
    vdot, multipliers = answers.acceleration(Q, V, 2 * Q, ROW, Q[:1], 0.75)
    assert (vdot.tolist(), multipliers.tolist()) == ([1, 2], [3])
    told = {name: x.tolist() if isinstance(x, np.ndarray) else x for name, x in asked.items()}
    assert told == {
        "q": [0.5, -3.0], "v": [1.0, 8.0], "Q": [1.0, -6.0], "a": [[1.0, 2.0]], "gamma": [0.5],
        "t": 0.75,
    }  # fmt: skip
    vdot, multipliers = answers.acceleration(Q, V, Q, None, None)
    assert multipliers is None and (asked["a"], asked["gamma"], asked["t"]) == (None, None, 0.0)


class Turning(Plain):
    """Velocities w = S v with an Ṡ v of their own; constraints that only some are handed."""

    S = np.array([[2.0, 0.0], [0.0, 4.0], [0.0, 0.0]])

    def velocity_map(self, q, v):
        return VelocityMap(q, self.S, np.array([1.0, 2.0, 3.0]))

    def mass_matrix(self, q, t=0.0):
        return np.diag([1.0, 2.0, 3.0]) * (1 + t)

    def bias(self, q, v, t=0.0):
        return np.array([5.0, 6.0, 7.0])

    def acceleration(self, q, v, Q, a, gamma, t=0.0):
        return 10 * Q, None if a is None else 100 * gamma + a[:, 1]


def test_accelerations_are_mapped_with_the_constraints_that_are_handed():
    kind: Any = Turning
    answers = Answers(kind(SCENE))
    assert answers.mass_matrix(Q, 1.0).tolist() == [[8.0, 0.0], [0.0, 64.0]]
    # Sᵀ (B + M Ṡ v).
    assert answers.bias(Q, V, 1.0).tolist() == [2 * (5 + 2), 4 * (6 + 8)]
    (x, S, rest), M, B = answers.own_terms(Q, V, 1.0)
    assert (x.tolist(), S.tolist(), rest.tolist()) == ([0.5, -3.0], Turning.S.tolist(), [1, 2, 3])
    assert (np.diag(M).tolist(), B.tolist()) == ([2, 4, 6], [5, 6, 7])
    # The inverse of S halves and quarters: 10 of that less Ṡ v, and mapped back once more.
    vdot, multipliers = answers.acceleration(Q, V, np.array([2.0, 8.0]), ROW, np.array([9.0]))
    assert vdot.tolist() == [(10 - 1) / 2, (20 - 2) / 4]
    assert multipliers.tolist() == [100 * (9 - 0.5 - 1) + 0.5]
    for given in ((ROW, None), (None, Q[:1])):
        handed: list[Any] = []
        kind = type("Told", (Turning,), {"acceleration": lambda self, *x, h=handed: h.extend(x)})
        with pytest.raises(EngineFault, match="returned None"):
            Answers(kind(SCENE)).acceleration(Q, V, Q, *given)
        assert [x if x is None else x.tolist() for x in handed[3:5]] == [
            x if x is None else x.tolist() for x in given
        ]


def test_elsewhere_is_one_state_for_each_number_and_nothing_of_it_counts():
    asked: list[Any] = []

    class Asked(Plain):
        def bias(self, q, v, t=0.0):
            asked.append((q.tolist(), v.tolist(), t))
            raise OSError

    kind: Any = Asked
    answers = Answers(kind(SCENE))
    for number in (1, 2):
        answers.ask_elsewhere("bias", (Q, V, 2.5), number)
    # A quarter a number: one way, and half of that the other way; of -v/2, and by sizes above 1.
    assert asked == [
        ([0.75, -3.375], [-0.25, -4.5], 2.5),
        ([1.0, -3.75], [0.0, -5.0], 2.5),
    ]
    asked.clear()
    answers.provoke_stale_answers("bias", Q, V, 2.5)
    near = 2.0**-26
    assert asked == [
        ([0.75, -3.375], [-0.25, -4.5], 2.5),
        ([0.75, -3.375], [-0.25, -4.5], 2.5),
        ([0.5 + near, -3.0 - 1.5 * near], [1.0 + near, 8.0 - 4 * near], 2.5),
        ([0.5, -3.0], [-0.25, -4.5], 2.5),
    ]


# ---- What an engine is by default ----------------------------------------------------------------


def test_an_engine_offers_what_it_overrides_and_nothing_else():
    kind: Any = Plain
    engine = kind(SCENE)
    optional = "forces", "constraint_jacobian", "constraint_drift", "kane_inertia_remainder"
    assert Plain.offers("acceleration") and not any(map(Plain.offers, optional))
    assert not Plain.offers("velocity_map") and Turning.offers("velocity_map")
    assert (engine.bias_size(Q, V), Plain.compliant, Plain.reads_parameters) == (0.0, False, True)
    assert (Plain.reads_file, Plain.extra, Plain.key) == (False, None, "plain")
    x, S, rest = engine.velocity_map(Q, V)
    assert (x is Q, S.tolist(), rest.tolist()) == (True, [[1, 0], [0, 1]], [0, 0])
    for method in optional[:3]:
        with pytest.raises(NotImplementedError):
            getattr(engine, method)(Q, V)
    keys = {"Own_": "own", "Engine": "engine", "TheEngine": "the", "ABC": "abc"}
    assert {name: type(name, (Plain,), {}).key for name in keys} == keys


# ---- What is built of a tree ---------------------------------------------------------------------


class Grown(TreeEngine):
    """An engine of trees whose terms are by hand."""

    key = "grown"
    module = "json"

    def _build(self, library: Any, links: Any) -> None:
        self.built = library.__name__, [one.name for one in links]

    def mass_matrix(self, q, t=0.0):
        return np.diag([1.0 + t, 2.0, 3.0])

    def bias(self, q, v, t=0.0):
        return np.array([1.0, 2.0, 3.0]) * (1 + t)


def tree(coordinates: Any = ((1.0, 0.0), (0.0, 1.0), (2.0, -1.0)), **more: Any) -> Tree:
    """Return three links in a row, the last of which follows both others."""
    count = len(coordinates)
    given = {
        "parent": tuple(range(-1, count - 1)), "joint": ("rz",) * count,
        "rotation": np.array([np.eye(3)] * count), "offset": np.arange(3.0 * count).reshape(-1, 3),
        "coordinates": np.array(coordinates), "shift": np.array([0.0, 0.5, -0.25])[:count],
        "mass": np.array([1.0, 2.0, 4.0])[:count], "center": np.ones((count, 3)),
        "inertia": np.array([np.eye(3)] * count), "armature": np.zeros(count),
    }  # fmt: skip
    return Tree(**(given | more))


class Held(ChainPendulum):
    """A scene of two coordinates whose tree is made by hand."""

    made_tree: Any = None

    def tree(self):
        return self.made_tree


def held(made_tree: Any) -> Held:
    scene = Held.rods(2)
    object.__setattr__(scene, "made_tree", made_tree)
    return scene


def test_an_engine_of_a_tree_is_built_of_its_links_in_coordinates_of_its_joints():
    engine = Grown(held(tree()))
    assert engine.built == ("json", ["link_0", "link_1", "link_2"])
    assert engine.coordinates.tolist() == [[1, 0], [0, 1], [2, -1]] and engine.follow
    x, S, rest = engine.velocity_map(Q, V)
    assert x.tolist() == [0.5, -2.5, 3.75]
    assert S.tolist() == [[1, 0], [0, 1], [2, -1]] and rest.tolist() == [0, 0, 0]
    assert not Grown(held(tree(np.eye(2)))).follow
    assert Grown.version().startswith("grown ")
    assert Grown.solves_like == "gw" and not Grown.reads_parameters


def test_joints_that_follow_are_eliminated_in_the_time_that_is_asked_for():
    engine, T = Grown(held(tree())), tree().coordinates
    x, w, F = np.zeros(3), np.ones(3), np.array([4.0, 9.0, 2.0])
    M = np.diag([2.0, 2.0, 3.0])
    right = F - 2 * np.array([1.0, 2.0, 3.0])
    vdot, multipliers = engine.eliminated(x, w, F, None, None, 1.0)
    free = np.linalg.solve(T.T @ M @ T, T.T @ right)
    np.testing.assert_allclose(vdot, T @ free, rtol=1e-14)
    assert multipliers is None
    a, gamma = np.array([[1.0, -2.0, 0.5]]), np.array([0.75])
    vdot, multipliers = engine.eliminated(x, w, F, a, gamma, 1.0)
    rows = a @ T
    kkt = np.block([[T.T @ M @ T, -rows.T], [rows, np.zeros((1, 1))]])
    expected = np.linalg.solve(kkt, [*(T.T @ right), -0.75])
    np.testing.assert_allclose(vdot, T @ expected[:2], rtol=1e-13)
    np.testing.assert_allclose(multipliers, expected[2:], rtol=1e-13)


def test_a_scene_is_represented_by_a_tree_whose_links_can_be_held_and_all_move():
    assert Grown.represents(held(tree()))
    for none in (
        None,
        tree(((1.0, 0.0), (2.0, 0.0), (3.0, 0.0))),  # a coordinate without a joint
        tree(armature=np.array([0.0, 0.0, 0.1])),
        tree(mass=np.array([1.0, 0.0, 1.0])),
        tree(inertia=np.array([np.eye(3), np.eye(3), np.diag([1.0, 1.0, 3.0])])),
    ):
        assert not Grown.represents(held(none))
        with pytest.raises(EngineError, match=r"^grown cannot represent .*\[2\] as a tree of bod"):
            Grown(held(none))
    free: Any = type("Free", (Grown,), {"any_inertia": True})
    assert free.represents(held(tree(inertia=np.array([np.eye(3)] * 2 + [np.diag([1.0, 1, 3])]))))
    assert all_move(tree()) and not all_move(tree(((1.0, 0.0), (2.0, 0.0), (3.0, 0.0))))


def test_links_are_all_that_the_tree_says_of_them():
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    one = tree_links(tree(rotation=np.array([turn, np.eye(3), turn]), armature=np.arange(3.0)))[2]
    assert (one.name, one.parent, one.kind, one.mass, one.armature) == ("link_2", 1, "rz", 4.0, 2.0)
    assert one.rotation.tolist() == turn.tolist() and one.inertia.tolist() == np.eye(3).tolist()
    assert (one.offset.tolist(), one.center.tolist()) == ([6, 7, 8], [1, 1, 1])


def test_two_links_without_mass_in_a_row_turn_the_body_behind_them_about_these_points():
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    links = [
        link("base", -1, "rz", [9.0, 9.0, 9.0], 2.0),
        link("a", 0, "rx", [1.0, 0.0, 0.0], 0.0, turn),
        link("b", 1, "ry", [0.0, 0.0, 2.0], 0.0, turn),
        link("c", 2, "rx", [0.0, 3.0, 0.0], 5.0, turn),
    ]
    bodies = bodies_with_mass(links)
    assert bodies is not None
    base, one = bodies
    assert (base.parent, one.parent, one.body.name) == (-1, 0, "c")
    # A quarter turn of the first seat, half a turn of the second, three quarters of the third.
    near: Any = lambda x: pytest.approx(np.array(x, float), abs=1e-15)  # noqa: E731
    assert one.rotation == near(turn @ turn @ turn)
    assert one.offset == near([1, -3, 2])
    found = {x.name: (x.slides, *x.position, *x.axis) for x in one.joints}
    # From the body, turned back by three quarters: y of the ground is its -x.
    assert found == {
        "a": near([False, -3, 0, -2, -1, 0, 0]),
        "b": near([False, -3, 0, 0, 1, 0, 0]),
        "c": near([False, 0, 0, 0, 1, 0, 0]),
    }


# ---- CasADi --------------------------------------------------------------------------------------


def test_casadi_solves_with_rows_of_any_size_and_tells_a_singular_matrix():
    A = np.array([[1e12, 2e12], [3e-9, -1e-9]])
    np.testing.assert_allclose(_solved(A, A @ [1.0, 2.0]), [1.0, 2.0], rtol=1e-15)
    with pytest.raises(np.linalg.LinAlgError, match=r"^singular to working precision: rcond is "):
        _solved(np.array([[1.0, 2.0], [2.0, 4.0]]), np.ones(2))


def test_casadi_has_multipliers_with_the_sign_of_forces_and_its_own_forces():
    scene = Snake([2.0], [3.0], [0.7], None, [0.4])
    engine = CasadiEngine(scene)
    q = np.array([0.3, -5.0, 0.8])
    v = np.array([np.cos(1.2), np.sin(1.2), 0.6])
    wrong = np.full(3, np.nan), None, None
    vdot, multipliers = engine.acceleration(q, v, *wrong)
    a, gamma = engine.constraint_jacobian(q, v), engine.constraint_drift(q, v)
    assert multipliers is not None and multipliers.shape == (1,)
    left = engine.mass_matrix(q) @ vdot + engine.bias(q, v) - engine.forces(q, v)
    np.testing.assert_allclose(left, a.T @ multipliers, atol=1e-13)
    np.testing.assert_allclose(a @ vdot, -gamma, atol=1e-13)
    assert abs(multipliers[0]) > 0.1
    free = CasadiEngine(ChainPendulum.rods(2)).acceleration(Q, V, *wrong[:1], None, None)
    assert free.multipliers is None and np.isfinite(free.vdot).all()
