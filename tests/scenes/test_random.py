"""Random mechanisms: all that was asked for is there, nothing is constant, and all claims hold."""

from __future__ import annotations

import pickle
import re
from collections import Counter
from functools import cache
from pathlib import Path
from typing import Any

import hypothesis
import numpy as np
import pytest
from hypothesis import Phase

from eomcheck import strategies
from eomcheck.claims import CLAIMS
from eomcheck.claims.reproducer import reproducer_code
from eomcheck.claims.run import RunSelection, ValidationRun, make_case_with_engines
from eomcheck.descriptions import first_derivation, random_mechanisms
from eomcheck.descriptions.build import mechanism
from eomcheck.descriptions.constraint_rows import KINDS
from eomcheck.descriptions.elements import COORDINATES, Constraint, Joint, Link, coupling, weld
from eomcheck.descriptions.joint_tree import ROLLING
from eomcheck.descriptions.random_mechanisms import CONSTRAINTS, INDEPENDENT, RANDOM, UPRIGHT, poses
from eomcheck.descriptions.random_trees import (
    BRANCHED,
    ROOT,
    SHAPE,
    URDF_JOINTS,
    RandomDescription,
    random_link,
    urdf_tree,
)
from eomcheck.descriptions.urdf_reader import urdf_text
from eomcheck.descriptions.vector_algebra import (
    multiply_quaternions,
    roll_pitch_yaw_of,
    rotation_matrix,
)
from eomcheck.draws.pairwise_design import (
    AT_REST,
    LINKS,
    MOTION,
    count_levels,
    factors,
    level_pairs,
    levels_of_case,
    pairs_in,
    scene_cases,
)
from eomcheck.errors import InputError, RefusedError, UnknownNameError
from eomcheck.evaluation.dynamics import assembly_error, position_residual
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import check_consistent
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import GeneratorChoices
from eomcheck.scene_lookup import scene_classes_named
from eomcheck.scenes import from_urdf
from eomcheck.strategies import draw_samples

both_kinds = pytest.mark.parametrize("kind", RANDOM.values(), ids=RANDOM)

ENOUGH = 260
"""Draws in which everything has been at least once."""


@cache
def drawn(key: str) -> list:
    return list(scene_cases(RANDOM[key], (1, 12), ENOUGH, 4))


@pytest.fixture(
    scope="module", params=[pytest.param(key, marks=pytest.mark.night) for key in RANDOM]
)
def cases(request) -> list:
    return drawn(request.param)


# ---- What was asked for --------------------------------------------------------------------------


@both_kinds
@pytest.mark.sampled(2)
def test_a_scene_is_in_the_ways_that_were_asked_for(kind):
    choices = GeneratorChoices(np.random.default_rng(0))
    for links in (1, 2, 3, 4, 7):
        entries = kind.topologies(links)
        for _ in range(12):
            ways = {name: choices.one_of(of) for name, of in choices.one_of(entries).items()}
            scene = kind.of_topology(links, ways, choices)()
            found = scene.topology | {MOTION: ways.get(MOTION)}
            assert scene.links == links
            assert {name: found[name] for name in ways} == ways
            assert scene.p > 0, "a motion is left"


@pytest.mark.sampled(2)
def test_draws_have_every_pair_of_strata_and_hardly_rest(cases):
    kind = type(cases[0][0])
    wanted = [ways for n in range(1, 13) for ways in factors(kind, n)]
    found = [levels_of_case(scene, state) for scene, state in cases]
    assert set().union(*map(pairs_in, found)) >= level_pairs(wanted)
    counts = count_levels(cases)
    assert counts[MOTION][AT_REST] <= ENOUGH / 10
    assert set(counts[LINKS]) == {str(n) for n in range(1, 13)}
    assert all(states > 0 for of in counts.values() for states in of.values())


@pytest.mark.night
def test_nearly_every_draw_hangs_together_in_another_way(cases):
    assert len({scene.structure for scene, _ in cases}) > 0.9 * ENOUGH


# ---- Variety -------------------------------------------------------------------------------------


def signs(values) -> set[float]:
    return set(np.sign(values).ravel().tolist())


def test_joints_are_of_all_kinds_at_the_root_and_elsewhere(cases):
    descriptions = [scene.source.description for scene, _ in cases]
    elsewhere = {one.kind for d in descriptions for one in d.joints[1:]}
    assert elsewhere == set(COORDINATES)
    assert {d.joints[0].kind for d in descriptions} == set(COORDINATES) - {"fixed"}
    assert any(scene.topology[SHAPE] == BRANCHED for scene, _ in cases)


def test_no_number_of_a_description_is_constant_and_all_have_their_signs(cases):
    descriptions = [scene.source.description for scene, _ in cases]
    joints = [one for d in descriptions for one in d.joints]
    bodies = [one for d in descriptions for one in d.links if one.mass > 0]
    solid = [one for one in bodies if any(one.products)]
    single = [one for one in joints if one.kind in ("revolute", "prismatic")]
    turned = [one for one in joints if any(one.orientation[1:])]
    gravity = [d.gravity for d in descriptions if d.gravity is not None]
    either, positive = {-1.0, 0.0, 1.0}, {1.0}
    for values, wanted in (
        ([one.origin for one in joints], either),
        ([one.center for one in bodies], either),
        ([one.axis for one in single], either),
        ([one.products for one in solid], {-1.0, 1.0}),
        ([one.orientation[1:] for one in turned], {-1.0, 1.0}),
        ([one.orientation[0] for one in turned], positive),
        ([one.mass for one in bodies], positive),
        ([one.moments for one in bodies], positive),
        ([one.damping for one in joints if one.damping is not None], positive),
        ([one.stiffness for one in joints if one.stiffness is not None], positive),
        ([one.rest_position for one in joints if one.stiffness is not None], {-1.0, 1.0}),
        ([one.armature for one in joints if one.armature is not None], positive),
        ([one.mimics[1:] for one in joints if one.mimics is not None], {-1.0, 1.0}),
        (gravity, either),
    ):
        array = np.array(values)
        assert signs(array) == wanted
        for entry in array.reshape(len(array), -1).T:
            assert len(np.unique(entry)) > 0.1 * len(entry)
    masses = np.log10([one.mass for one in bodies])
    assert masses.min() < -0.8 and masses.max() > 0.8


def can_exist(link: Link) -> bool:
    """Whether no principal moment of inertia is negative or larger than the others together."""
    (xx, yy, zz), (xy, xz, yz) = link.moments, link.products
    a, b, c = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return bool(a >= 0 and c <= (a + b) * (1 + 1e-12))


def test_bodies_are_some_that_can_exist(cases):
    links = [link for scene, _ in cases for link in scene.source.description.links]
    assert all(map(can_exist, links))


@pytest.mark.parametrize("planar", [False, True])
def test_every_body_that_is_drawn_can_exist(planar: bool):
    choices = GeneratorChoices(np.random.default_rng(0))
    links = [random_link(choices, "link", planar) for _ in range(200)]
    assert all(map(can_exist, links))
    assert any(one.products != (0.0, 0.0, 0.0) for one in links) == (not planar)


def test_a_chosen_axis_points_to_both_sides_along_every_axis_and_anywhere(cases):
    solid = [scene for scene, _ in cases if not scene.source.topology.planar]
    axes = {one.axis for scene in solid for one in scene.source.description.joints}
    straight = {tuple(sign * row) for sign in (1.0, -1.0) for row in np.eye(3)}
    assert straight <= axes
    assert any(np.count_nonzero(axis) == 3 for axis in axes)
    lengths = [np.linalg.norm(axis) for axis in axes]
    assert min(lengths) < 0.8 and max(lengths) > 1.2


# ---- Constraints ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def mechanisms() -> list:
    return drawn("random-mechanisms")


@pytest.mark.night
def test_constraints_are_of_all_kinds_alone_and_with_others(mechanisms):
    each = [[one.kind for one in scene.source.description.constraints] for scene, _ in mechanisms]
    assert {kinds[0] for kinds in each} == set(KINDS)
    assert {kinds[1] for kinds in each if len(kinds) > 1} >= {"pin", "distance", "edge", "weld"}


def test_balls_disks_and_circles_roll_on_planes_that_stand_and_that_move(mechanisms):
    seen = set()
    for scene, _ in mechanisms:
        groups: dict[str, list] = {}
        for one in scene.source.description.constraints:
            if one.kind in ROLLING:
                groups.setdefault(one.name.partition(",")[0], []).append(one)
        planar = scene.source.topology.planar
        for rows in groups.values():
            # What rolls does so along all of the plane, and touches it.
            kinds = sorted(one.kind for one in rows)
            assert kinds in (["touching"], ["rolling"] * (1 if planar else 2) + ["touching"])
            (link, _), (on, _) = rows[-1].points
            assert link != on
            what = "disk" if len(rows[-1].directions) == 3 else "ball"
            if what == "disk":
                there = poses(scene.source.description)
                n, e = (there[link].direction(x) for link, x in rows[-1].directions[1:])
                assert np.linalg.norm(np.cross(n, e)) > UPRIGHT - 1e-12
            seen.add(("circle" if planar else what, len(rows) > 1, on == "ground"))
    each = [(what, either) for what in ("circle", "disk", "ball") for either in (False, True)]
    assert {(what, rolls) for what, rolls, _ in seen} == set(each)
    assert {(what, stands) for what, _, stands in seen} == set(each)


@pytest.mark.night
def test_wherever_there_is_room_a_joint_turns_what_shall_stay_square():
    kind, random = RANDOM["random-mechanisms"], np.random.default_rng(1)
    choices, found = GeneratorChoices(random), 0
    for links in (1, 2, 3):
        for entry in kind.topologies(links):
            if "square" not in entry.get(CONSTRAINTS, ()):
                continue
            # Where all slide nothing turns.
            for _ in range(20 if entry[ROOT] == ("prismatic",) else 2):
                ways = {name: choices.one_of(of) for name, of in entry.items()}
                scene = kind.of_topology(links, ways | {CONSTRAINTS: "square"}, choices)()
                (first, *_) = scene.source.description.constraints
                turned = turned_by(scene.source.description)
                (one, _), (other, _) = first.directions
                assert first.kind == "square"
                assert turned[one] != turned[other]
                found += 1
    assert found >= 90


def turned_by(description) -> dict[str, frozenset[str]]:
    """Return which joints turn each link against the ground."""
    found = {"ground": frozenset()}
    for joint in description.joints:
        turns = joint.kind not in ("fixed", "prismatic")
        found[joint.child] = found[joint.parent] | ({joint.name} if turns else set())
    return found


@pytest.mark.night
def test_no_kind_of_constraint_is_drawn_much_more_often_than_others(mechanisms):
    counts = Counter(scene.topology[CONSTRAINTS] for scene, _ in mechanisms)
    assert max(counts.values()) < 3 * ENOUGH / len(KINDS)


def test_a_pose_closes_by_another_derivation_of_places(mechanisms):
    # Where the links are was found from the words alone, the gaps by the scene's own recursion.
    for scene, _ in mechanisms:
        pose = dict(scene.source.description.pose)
        q = np.array([pose[name] for name in scene.coordinate_names])
        at = Evaluation(scene, q, np.zeros(scene.n), 0.0)
        assert np.abs(position_residual(at)).max(initial=0.0) < 1e-13


def test_a_constraint_is_drawn_again_until_its_rows_are_far_from_those_before(monkeypatch):
    """Of two rows of length 1 at an angle φ the smallest singular value is √(1 - cos φ)."""
    names = "α", "β", "γ"
    links = [Link("ground"), *(Link(name, 1.0, moments=(1.0, 1.0, 1.0)) for name in names)]
    joints = [Joint(name, "revolute", "ground", name) for name in names]
    tree = RandomDescription(tuple(links), tuple(joints), pose=tuple((name, 0.3) for name in names))
    tried: list[float] = []

    def turned(name: str, angle: float) -> tuple[Constraint]:
        return (coupling(name, "α", "β", np.tan(np.pi / 4 + angle)),)

    def next_one(*_):
        angle = tried.pop(0)
        return turned(f"at {angle}", angle)

    tree = tree._replace(constraints=turned("before", 0.0))
    monkeypatch.setattr(random_mechanisms, "_constraint", next_one)
    here = "coupling", True, GeneratorChoices(np.random.default_rng(0))
    angle = np.arccos(1.0 - INDEPENDENT**2)
    tried[:] = 0.0, 0.9 * angle, 1.1 * angle, 0.5
    found = random_mechanisms.with_random_constraint(tree, *here)
    assert [one.name for one in found.constraints] == ["before", f"at {1.1 * angle}"]
    assert tried == [0.5]
    tried[:] = [*random_mechanisms.ATTEMPTS * (0.9 * angle,), 0.5]
    with pytest.raises(RefusedError, match="no independent coupling") as refused:
        random_mechanisms.with_random_constraint(tree, *here)
    assert tried == [0.5]
    assert refused.value.rcond == pytest.approx(np.sqrt(1.0 - np.cos(0.9 * angle)))


@pytest.mark.night
def test_states_are_closed_and_consistent_and_rows_independent(mechanisms):
    for scene, state in mechanisms:
        at = Evaluation(scene, *state)
        gap, allowed = assembly_error(at)
        assert gap <= allowed
        check_consistent(at)
        rows = at.terms.a / np.linalg.norm(at.terms.a, axis=1, keepdims=True)
        assert np.linalg.svd(rows, compute_uv=False)[-1] > INDEPENDENT / 50
        planar = scene.source.topology.planar
        kinds = [KINDS[one.kind] for one in scene.source.description.constraints]
        rows = [kind.planar if planar else kind.spatial for kind in kinds]
        assert scene.r == sum(rows) < scene.n


# ---- Claims --------------------------------------------------------------------------------------

SEEN = [one for one in RunSelection.of().claims if one != "machine-code"]
"""Machine code takes longer than all else of a scene that is looked at in one state."""


@pytest.mark.night
@both_kinds
def test_formulations_and_engines_agree_on_random_scenes(kind, sized):
    run, selection, count = (
        ValidationRun(),
        RunSelection.of(claims=SEEN, scenes=[kind]),
        sized(12, 5),
    )
    run.explore(scene_cases(kind, (1, 12), count, 20), selection)
    assert run.cases == count
    assert not [str(one) for one in run.findings if one.verdict == "failed"]
    assert {"pinocchio", "casadi"} <= {x for one in run.findings for x in one.subject.split(" ~ ")}


def test_a_derivation_that_is_wrong_in_one_component_is_found(monkeypatch):
    right, kind = first_derivation.relative_acceleration, RANDOM["random-trees"]

    def wrong(rates, arm):
        x, _, z = right(rates, arm)
        return x, None, z

    monkeypatch.setattr(first_derivation, "relative_acceleration", wrong)
    run, selection = (
        ValidationRun(),
        RunSelection.of(engines=[], claims=["power-balance"], scenes=[kind]),
    )
    run.explore(scene_cases(kind, (2, 4), 40, 0), selection)
    assert run.minimal is not None
    assert run.cases < 10


# ---- Counterexamples that were found, and understood ---------------------------------------------


def scene_of(links, joints, constraints=(), **more):
    return mechanism("Found", links, joints, constraints, gravity=None, **more)()


def failures(scene, state) -> list[str]:
    case = make_case_with_engines(scene, state, RunSelection.of(claims=SEEN, scenes=[scene]))
    findings = [one for claim in SEEN for one in case.evaluate(CLAIMS[claim])]
    return [str(one) for one in findings if one.verdict == "failed"]


@pytest.mark.night
def test_what_cannot_move_is_still_and_not_nearly_so():
    # A weld that lets one slide: rounding left 1e-17 rad/s, and gamma of nothing but that.
    ground = Link("ground")
    links = [Link(name, 1.0, (0.3, 0.2, 0.0), (1.0, 1.0, 1.0)) for name in ("a", "b")]
    slide = Joint("slide", "prismatic", "ground", "a", (0.34, -0.36, 0.0), axis=(-1.0, 0.0, 0.0))
    free = Joint("free", "planar", "ground", "b", (-0.66, 0.69, 0.0))
    turn = (0.9395, 0.0, 0.0, -0.3425)
    closed = weld("weld", "b", "a", (-0.3193, 0.7912, 0.0), (-1.2402, 1.6043, 0.0), turn)
    first = ("free_turn", "free_y", "free_x")
    scene = scene_of([ground, *links], [slide, free], [closed], dependent=first)
    for seed in range(6):
        for state in draw_samples(strategies.states(scene), 4, seed):
            assert state.v[:2].tolist() == [0.0, 0.0]
            check_consistent(Evaluation(scene, *state))
        assert not failures(scene, state)


def test_a_weld_holds_a_link_that_is_turned_on_its_joint_as_it_was_said():
    # Its axes were taken for those of the joint: on an oblique hinge a link was welded askew.
    tilted = 0.8, 0.1, -0.3, 0.2
    links = [Link("ground"), Link("a", 1.0, moments=(1.0, 1.0, 1.0)), Link("frame"),
             Link("b", 1.0, moments=(1.0, 1.0, 1.0))]  # fmt: skip
    joints = [
        Joint("hinge", "revolute", "ground", "a", axis=(0.3, 0.4, 0.5)),
        Joint("fixed", "fixed", "a", "frame", orientation=tilted),
        Joint("free", "floating", "ground", "b"),
    ]
    for turn in ((1.0, 0.0, 0.0, 0.0), (0.7, 0.0, 0.0, 0.2)):
        scene = scene_of(links, joints, [weld("weld", "b", "frame", turn=turn)])
        w, x, y, z = turn
        R = rotation_matrix(multiply_quaternions(tilted, (w, -x, -y, -z)))
        q = np.zeros(scene.n)
        for name, angle in zip(("roll", "pitch", "yaw"), roll_pitch_yaw_of(R), strict=True):
            q[scene.coordinate_names.index(f"free_{name}")] = angle
        gap = position_residual(Evaluation(scene, q, np.zeros(scene.n), 0.0))
        assert np.abs(gap).max() < 1e-14


@pytest.mark.night
def test_a_body_on_its_own_axis_has_no_remainder_but_rounding():
    # Told in a frame that turns, what an engine differentiates cancels: the claim said "missing".
    links = [Link("ground"), Link("carrier"), Link("body", 7.6, moments=(0.8, 3.8, 3.5))]
    joints = [
        Joint("slide", "prismatic", "ground", "carrier", axis=(0.0, 1.0, 0.0)),
        Joint("turn", "revolute", "carrier", "body", (0.7, -0.45, 0.0),
              mimics=("slide", -1.5772, -0.7129)),
    ]  # fmt: skip
    scene = scene_of(links, joints)
    for q in np.linspace(-1.0, 1.0, 25):
        assert not failures(scene, State(np.array([q]), np.array([-2.5]), 0.0))


# ---- hypothesis ----------------------------------------------------------------------------------

trees, mechanisms_of = strategies.random_trees, strategies.random_mechanisms


@pytest.mark.parametrize("strategy", [trees, mechanisms_of], ids=lambda f: f.__name__)
@pytest.mark.night
def test_numbers_of_bodies_are_within_the_bounds(strategy):
    scenes = draw_samples(strategy(2, 4), 30, 0)
    assert {scene.links for scene in scenes} == {2, 3, 4}


@pytest.mark.parametrize("strategy", [trees, mechanisms_of, strategies.urdfs])
@pytest.mark.parametrize(
    ("bounds", "said"),
    [
        ((0, 3), "min_bodies = 0"),
        ((1, 31), "max_bodies = 31, expected at most 30"),
        ((4, 3), "expected min_bodies <= max_bodies"),
        ((1, 2.5), "max_bodies = 2.5"),
    ],
)
def test_numbers_of_bodies_that_there_are_not_are_refused_at_once(strategy, bounds, said):
    with pytest.raises(InputError, match=re.escape(said)):
        strategy(*bounds)
    strategy(30, 30)  # as many as there may be


def found(strategy, condition):
    settings = hypothesis.settings(
        strategies.settings, max_examples=400, database=None, derandomize=True,
        phases=(Phase.generate, Phase.shrink),
    )  # fmt: skip
    return hypothesis.find(strategy, condition, settings=settings)


def test_draws_shrink_to_the_simplest_that_there_are():
    smallest = found(trees(), lambda scene: True)
    (joint,), (_, link) = smallest.source.description.joints, smallest.source.description.links
    assert (joint.kind, joint.origin, joint.damping) == ("revolute", (0.0, 0.0, 0.0), None)
    assert (link.mass, link.center, smallest.gravity) == (1.0, (0.0, 0.0, 0.0), None)


@pytest.mark.night
def test_a_draw_with_a_mimic_joint_shrinks_to_two_links():
    def follows(scene) -> bool:
        return any(one.mimics is not None for one in scene.source.description.joints)

    assert found(trees(), follows).links == 2


# ---- Python and pickle ---------------------------------------------------------------------------


@pytest.mark.night
def test_a_drawn_scene_is_made_again_by_its_python_and_by_pickle(mechanisms):
    for scene, state in mechanisms[:20]:
        code = reproducer_code(scene, state).partition("for finding")[0]
        names: dict = {}
        exec(code, names)
        for again in (names["scene"], pickle.loads(pickle.dumps(scene))):
            M, other = (Evaluation(x, *state).terms.M for x in (scene, again))
            np.testing.assert_array_equal(M, other)
            assert again.coordinate_names == scene.coordinate_names


@both_kinds
def test_a_random_kind_is_found_by_its_key_and_is_not_among_all(kind):
    assert scene_classes_named(kind.key) == (kind,)
    assert kind not in scene_classes_named("all")
    several = scene_classes_named(f"sleigh, {kind.key},sleigh")
    assert [one.key for one in several] == ["sleigh", kind.key]
    with pytest.raises(UnknownNameError, match="unknown scene 'sleig'"):
        scene_classes_named(f"sleig,{kind.key}")
    assert type(kind.example()) is kind


@both_kinds
def test_structures_are_always_the_same_and_all_different(kind):
    first, again = ([x.structure for x in kind.structures(4)] for _ in range(2))
    assert first == again
    assert len(set(first)) == len(first) > 1
    with pytest.raises(InputError, match="links = 31, expected at most 30"):
        next(kind.structures(31))


# ---- URDF ----------------------------------------------------------------------------------------


@pytest.mark.night
def test_a_written_urdf_is_read_as_the_tree_that_it_is_of(tmp_path: Path):
    choices, random = GeneratorChoices(np.random.default_rng(2)), np.random.default_rng(1)
    path = tmp_path / "robot.urdf"
    every = ("revolute", "prismatic", "fixed", "planar", "floating")
    for number in range(60):
        tree = urdf_tree(1 + number % 12, choices, every)
        path.write_text(urdf_text(tree), encoding="utf-8")
        read, scene = from_urdf(path, gravity=None), tree.source("Tree").scene_class()()
        assert read.coordinate_names == scene.coordinate_names
        q, v = random.uniform(-1, 1, (2, scene.n))
        ours, theirs = (Evaluation(x, q, v, 0.0).terms for x in (scene, read))
        size = np.abs(ours.M).max()
        np.testing.assert_allclose(theirs.M, ours.M, rtol=0, atol=1e-12 * size)
        np.testing.assert_allclose(theirs.B, ours.B, rtol=0, atol=1e-11 * size * scene.n)
        for Q in (theirs.Q, ours.Q):
            assert (Q is None) == (theirs.Q is None)
        if ours.Q is not None:
            np.testing.assert_allclose(theirs.Q, ours.Q, rtol=1e-12)


@pytest.mark.night
def test_urdfs_have_only_the_joints_that_are_asked_for():
    def types(text: str) -> set[str]:
        return set(re.findall(r'<joint name="\w+" type="(\w+)"', text))

    texts = draw_samples(strategies.urdfs(), 80, 0)
    assert set().union(*map(types, texts)) == {"continuous", "prismatic", "fixed"}
    assert any("<mimic" in text for text in texts) and any("<dynamics" in text for text in texts)
    plain = draw_samples(strategies.urdfs(joints=["revolute"], mimic=False, massless=False), 40, 0)
    for text in plain:
        assert types(text) == {"continuous"}
        assert "<mimic" not in text
        assert text.count("<inertial>") == text.count("<link ") - 1
    every = set().union(*map(types, draw_samples(strategies.urdfs(joints=URDF_JOINTS), 80, 0)))
    assert every == {"continuous", "prismatic", "fixed", "planar", "floating"}


@pytest.mark.parametrize("left_out", ["mimic", "massless", "dampers"])
def test_urdfs_leave_out_what_they_are_asked_to_and_nothing_else(left_out: str):
    options: dict[str, Any] = {left_out: False}
    texts = draw_samples(strategies.urdfs(8, 8, **options), 8, 0)
    there = {
        "mimic": any("<mimic" in text for text in texts),
        "massless": any(text.count("<inertial>") < text.count("<link ") - 1 for text in texts),
        "dampers": any("<dynamics" in text for text in texts),
    }
    assert there == {name: name != left_out for name in there}


def test_joints_of_a_urdf_are_written_in_any_order():
    choices, early = GeneratorChoices(np.random.default_rng(2)), 0
    for _ in range(10):
        known = {"ground"}
        for joint in urdf_tree(4, choices).joints:
            early += joint.parent not in known
            known.add(joint.child)
    assert early >= 5


@pytest.mark.parametrize("joints", [["prismatic"], ["revolute", "ball"], [], "revolute"])
def test_joints_that_a_urdf_cannot_be_made_of_are_refused(joints):
    with pytest.raises(InputError, match="joints = "):
        strategies.urdfs(joints=joints)
