"""Engines built from a tree, against ours: in other frames, in any order, at the limits."""

from __future__ import annotations

import numpy as np
import pytest
from tests.engines.twisted import twisted
from tests.samples import ordinary

from eomcheck.claims import CLAIMS, Case
from eomcheck.descriptions import elements
from eomcheck.descriptions.build import mechanism
from eomcheck.descriptions.elements import Joint, distance
from eomcheck.engines import ENGINES, Answers, Engine, asked_by_default
from eomcheck.engines.tree_engine import TreeEngine, TreeLink
from eomcheck.evaluation.dynamics import assembled_position
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import largest
from eomcheck.formulations import FORMULATIONS
from eomcheck.mechanics.records import State, Tree
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.linear import null_space
from eomcheck.scenes import SCENES, ChainPendulum

TREES = [key for key, kind in SCENES.items() if kind.example().tree() is not None]
every_tree = pytest.mark.parametrize("scene_key", TREES)
BUILT = [key for key, kind in asked_by_default(ENGINES).items() if issubclass(kind, TreeEngine)]
every_engine = pytest.mark.parametrize("key", BUILT)
HARD = [
    (key, scene)
    for key in BUILT
    for scene in TREES
    if ENGINES[key].offers("acceleration")
    and not (ENGINES[key].compliant and SCENES[scene].example().r)
]
"""Engines and scenes whose accelerations differ by rounding only."""


def in_other_frames(key: str, seed: int) -> type[Engine]:
    """Return an engine that is handed the same bodies in other frames."""
    kind = ENGINES[key]
    assert issubclass(kind, TreeEngine)

    class Twisted(kind):
        @classmethod
        def links(cls, tree: Tree) -> list[TreeLink]:
            return twisted(super().links(tree), seed)

    Twisted.key = key
    return Twisted


def represented(kind: type[Engine], scene: Scene) -> type[Engine]:
    """Return the engine; skip the test where it cannot hold these bodies."""
    if not kind.represents(scene):
        pytest.skip(f"{kind.key} does not hold the bodies of {scene.name}")
    return kind


def look(scene: Scene, state: State, engine: Engine, *claims: str):
    formulations = tuple(f for f in FORMULATIONS.values() if f.applies_to(scene))
    case = Case(Evaluation(scene, *state), formulations, (engine,))
    found = [one for claim in claims for one in case.evaluate(CLAIMS[claim])]
    return [one for one in found if one.subject.split(" ~ ")[-1] == engine.key]


@every_engine
@every_tree
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.sampled(8)
def test_mass_matrix_and_bias_do_not_depend_on_the_frames_that_bodies_are_given_in(
    key, scene_key, seed
):
    scene, state = ordinary(SCENES[scene_key], seed)
    kind = represented(in_other_frames(key, seed), scene)
    found = look(scene, state, kind(scene), "mass-matrix", "bias")
    assert [one.verdict for one in found] == ["passed"] * 2, found


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("key", "scene_key"), HARD)
def test_accelerations_do_not_depend_on_the_frames_that_bodies_are_given_in(key, scene_key):
    scene, state = ordinary(SCENES[scene_key], 1)
    claims = "engine-acceleration", "engine-multipliers"
    kind = represented(in_other_frames(key, 1), scene)
    found = look(scene, state, kind(scene), *claims)
    assert found
    assert {one.verdict for one in found} == {"passed"}, found


@pytest.mark.sampled(3)
@every_engine
@every_tree
def test_an_answer_depends_on_nothing_that_was_asked_before(key, scene_key):
    scene, here = ordinary(SCENES[scene_key], 2)
    _, there = ordinary(SCENES[scene_key], 3)
    there = State(there.q[: scene.n], there.v[: scene.n], there.t)
    engine, at = represented(ENGINES[key], scene)(scene), Evaluation(scene, *here)
    Q = np.zeros(scene.n) if at.terms.Q is None else at.terms.Q
    constraints = at.terms.a, at.terms.gamma

    def answers(engine: Engine) -> list[np.ndarray]:
        asked = Answers(engine)
        found = [asked.mass_matrix(here.q).copy(), asked.bias(here.q, here.v).copy()]
        if engine.offers("acceleration"):
            found.append(asked.acceleration(here.q, here.v, Q, *constraints).vdot.copy())
        return found

    def disturb() -> None:
        asked = Answers(engine)
        if engine.offers("acceleration"):
            asked.acceleration(there.q, there.v, Q + 1.0, *constraints)
        asked.bias(there.q, there.v)
        asked.mass_matrix(there.q)

    first = answers(engine)
    disturb()
    again, fresh = answers(engine), answers(ENGINES[key](scene))
    for one, two, three in zip(first, again, fresh, strict=True):
        assert np.array_equal(one, two)
        assert np.array_equal(one, three)


@every_engine
def test_what_was_answered_stays_as_it_was(key):
    scene, (q, v, _) = ordinary(ChainPendulum, 0)
    engine = ENGINES[key](scene)
    answers = [engine.mass_matrix(q), engine.bias(q, v)]
    kept = [x.copy() for x in answers]
    engine.mass_matrix(2 * q)
    engine.bias(2 * q, 3 * v)
    assert all(np.array_equal(x, y) for x, y in zip(answers, kept, strict=True))


@every_engine
def test_bodies_may_be_points(key):
    scene = ChainPendulum([1.0, 2.0], [1.0, 3.0], [0.0, 0.0])
    state = State(np.array([0.3, -0.8]), np.array([1.1, 0.7]))
    found = look(scene, state, ENGINES[key](scene), "mass-matrix", "bias")
    assert [one.verdict for one in found] == ["passed"] * 2, found


@pytest.mark.parametrize(
    ("moments", "is_body"),
    [
        ((0.0, 0.3, 0.3), True),
        ((0.1, 0.2, 0.1 + 0.2), True),
        ((0.1, 0.2, 0.3 * (1 + 1e-14)), True),
        ((0.1, 0.2, 0.3 * (1 + 1e-10)), False),
        ((-1e-14, 1.0, 1.0), True),
        ((-1e-10, 1.0, 1.0), False),
    ],
)
@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1)])
def test_thin_rods_and_plates_are_bodies_and_what_is_beyond_them_is_none(moments, is_body, order):
    (link, *_) = in_space(0)
    inertia = np.diag([moments[i] for i in order])
    assert TreeEngine.takes(link._replace(inertia=inertia)) is is_body


@every_engine
@pytest.mark.parametrize("seed", range(4))
def test_joints_without_bodies_may_stand_anywhere_between_two(key, seed):
    """All engines say the same of them; some hold them as they are, some hand their joints on."""
    scene, state = ordinary(ChainPendulum, seed)
    others = np.random.default_rng(seed)
    kinds = [("px", "rz", "py", "rz"), ("rz", "px", "rz", "rz"), ("rz", "rz", "px", "rz")][seed % 3]

    def links(cls, tree: Tree) -> list[TreeLink]:
        changed = [
            one._replace(kind=kind, offset=others.normal(size=3))
            for one, kind in zip(TreeEngine.links(tree), kinds, strict=True)
        ]
        changed[seed % 3] = changed[seed % 3]._replace(mass=0.0, inertia=np.zeros((3, 3)))
        return twisted(changed, seed)

    answers = []
    for one in (key, "pinocchio"):
        others = np.random.default_rng(seed)
        kind = type("Changed", (ENGINES[one],), {"links": classmethod(links), "key": one})
        engine = Answers(kind(scene))
        answers.append((engine.mass_matrix(state.q), engine.bias(*state)))
    for theirs, pinocchios in zip(*answers, strict=True):
        assert largest(theirs - pinocchios) <= 1e-13 * largest(pinocchios)


# ---- In space ------------------------------------------------------------------------------------


def in_space(seed: int) -> list[TreeLink]:
    """Return six links of any kind, all of whose numbers count."""
    rng = np.random.default_rng(seed)
    links = []
    for j in range(6):
        moments, axes = rng.uniform(1.0, 1.9, 3), np.linalg.qr(rng.normal(size=(3, 3)))[0]
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        links.append(
            TreeLink(
                name=f"link_{j}",
                parent=j - 1 if j != 4 else 1,
                kind="".join((rng.choice(["r", "r", "p"]), rng.choice(["x", "y", "z"]))),
                rotation=turn * np.sign(np.linalg.det(turn)),
                offset=rng.normal(size=3),
                mass=rng.uniform(0.5, 2.0),
                center=rng.normal(size=3),
                inertia=axes @ np.diag(moments) @ axes.T,
            )
        )
    return links


def answers_in_space(
    key: str, links: list[TreeLink], state: State
) -> tuple[np.ndarray, np.ndarray]:
    options = {"links": classmethod(lambda cls, tree: links), "key": key}
    engine = type("InSpace", (ENGINES[key],), options)(ChainPendulum.rods(6))
    return engine.mass_matrix(state.q), engine.bias(state.q, state.v)


SPACE = State(np.linspace(-1.1, 0.9, 6), np.linspace(1.3, -0.8, 6))


@every_engine
@pytest.mark.parametrize("seed", range(4))
def test_a_tree_in_space_is_the_same_to_every_engine(key, seed):
    links = in_space(seed)
    M, B = answers_in_space("pinocchio", links, SPACE)
    theirs = answers_in_space(key, links, SPACE)
    assert largest(theirs[0] - M) <= 1e-13 * largest(M)
    assert largest(theirs[1] - B) <= 1e-13 * largest(B)


@every_engine
def test_products_of_inertia_are_told_from_those_of_the_other_sign(key):
    """In the plane nothing tells them: each joint stands on a principal axis."""
    links = in_space(0)
    wrong = [
        one._replace(inertia=2 * np.diag(np.diagonal(one.inertia)) - one.inertia) for one in links
    ]
    M, _ = answers_in_space("pinocchio", links, SPACE)
    assert largest(answers_in_space(key, wrong, SPACE)[0] - M) > 1e-3 * largest(M)


# ---- Constraints that give way -------------------------------------------------------------------


@pytest.mark.parametrize("key", ["mujoco"])
@pytest.mark.parametrize("scene_key", [key for key in TREES if SCENES[key].example().r])
def test_constraints_of_mujoco_give_way_by_a_small_part_and_not_by_rounding(key, scene_key):
    scene, state = ordinary(SCENES[scene_key], 0)
    at = Evaluation(scene, *state)
    Q = np.zeros(scene.n) if at.terms.Q is None else at.terms.Q
    a, gamma = at.terms.a, at.terms.gamma
    kind = represented(ENGINES[key], scene)
    found = Answers(kind(scene)).acceleration(state.q, state.v, Q, a, gamma)
    free = np.linalg.solve(at.terms.M, Q - at.terms.B)
    given_way = largest(a @ found.vdot + gamma) / largest(a @ free + gamma)
    assert 1e-8 < given_way < 0.2
    # The equations of motion hold all the same.
    M, B = at.terms.M, at.terms.B
    rest = M @ found.vdot + B - Q - a.T @ found.multipliers
    assert largest(rest) <= 1e-8 * (largest(B) + largest(Q) + largest(a.T @ found.multipliers))


# ---- Joints that follow others -------------------------------------------------------------------


def linked(place: float, closed: bool, axis=(1, 0, 1)):
    """Return three links in a row, the last joint geared to the first; a pin may close them."""
    rod = {"mass": 1.3, "center": (0.4, 0.1, 0.2), "moments": (0.2, 0.3, 0.25)}
    names = ["a", "b", "c"]
    joints = [
        Joint("p", "revolute", "ground", "a", axis=(0.0, 0.6, 0.8)),
        Joint("s", "prismatic", "a", "b", origin=(0.7, 0.1, 0.0), axis=(1.0, 0.0, 0.0)),
        Joint("r", "revolute", "b", "c", (0.5, 0, 0.1), mimics=("p", -1.5, place), axis=axis),
    ]
    ends = [distance("rod", "c", "ground", 1.1, (0.3, 0, 0), (0.2, 1.2, 0))] if closed else []
    links = [elements.Link("ground"), *(elements.Link(name, **rod) for name in names)]
    return mechanism("Linked", links, joints, ends)()


@every_engine
@pytest.mark.parametrize("closed", [False, True])
def test_a_joint_that_follows_another_is_taken_along(key, closed):
    scene = linked(0.3, closed)
    kind = represented(ENGINES[key], scene)
    engine = kind(scene)
    assert isinstance(engine, TreeEngine)
    assert engine.coordinates.shape == (3, 2)
    claims = ["mass-matrix", "bias"]
    if kind.offers("acceleration") and not (kind.compliant and closed):
        claims += ["engine-acceleration", *(["engine-multipliers"] if closed else [])]
    for q, c in np.random.default_rng(0).uniform(-1, 1, (5, 2, 2)):
        q = assembled_position(scene, q) if closed else q
        a = Evaluation(scene, q, c, 0.0).terms.a
        v = c if a is None else null_space(a) @ c[:1]
        found = look(scene, State(q, v, 0.0), engine, *claims)
        assert {(one.claim, one.verdict) for one in found} == {(x, "passed") for x in claims}, found


@pytest.mark.parametrize("axis", [(-1, 0, 0), (0, -1, 0), (0, 0, -1)])
def test_a_joint_that_follows_about_a_negative_axis_is_shifted_along_it(axis):
    scene = linked(0.3, False, axis)
    state = State(np.array([0.4, 0.2]), np.array([0.5, -1.0]), 0.0)
    (found,) = look(scene, state, ENGINES["pinocchio"](scene), "bias")
    assert found.verdict == "passed", found


def test_another_shift_of_a_joint_that_follows_shows():
    state = State(np.array([0.4, 0.2]), np.array([0.5, -1.0]), 0.0)
    (found,) = look(linked(0.3, False), state, ENGINES["pinocchio"](linked(0.4, False)), "bias")
    assert found.verdict == "failed"
