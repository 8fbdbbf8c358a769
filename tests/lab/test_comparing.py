"""One file, several libraries: who agrees, who differs, and why."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.robots import LINK, arm, body, joint
from typer.testing import CliRunner

from eomcheck.claims import CLAIMS
from eomcheck.claims.engine_quantities import CONFORMANCE
from eomcheck.claims.run import ValidationRun, validate
from eomcheck.cli import app
from eomcheck.descriptions.vector_algebra import rotation_matrix
from eomcheck.engines import READERS, Answers, PinocchioFile, VelocityMap, asked_by_default
from eomcheck.engines.answers import weight_size
from eomcheck.engines.file_engine import (
    AXES,
    BaseVelocity,
    capture_output,
    free_base,
    read_description,
)
from eomcheck.errors import EngineError, InputError, UnknownNameError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.lab import library_comparison
from eomcheck.lab.discrepancy import Discrepancy, Explanation, explain
from eomcheck.lab.library_comparison import (
    QUANTITIES,
    LibraryComparison,
    LibraryResult,
    RunningDifference,
    compare_libraries,
    print_comparison,
    write_comparison,
)
from eomcheck.mechanics.records import State
from eomcheck.scenes import ChainPendulum, Snake, from_mjcf, from_urdf

FINGERS = (
    body("left")
    + body("right", mass=0.4)
    + joint("grip", "hand", "left", "prismatic", "1 0 0")
    + joint("follow", "hand", "right", "revolute", "0 0 1", '<mimic joint="grip" multiplier="-2"/>')
)


def installed(key: str) -> None:
    try:
        READERS[key].version()
    except EngineError as error:
        pytest.skip(str(error))


SEVERAL = """<robot name="r">LINKS
<joint name="j" type="revolute"><parent link="base"/><child link="a"/><origin xyz="0 0.1 0.2"
 rpy="0.3 0 0.1"/><axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<joint name="k" type="KIND"><parent link="a"/><child link="b"/>
 <origin xyz="0.3 0.1 0.2" rpy="0.3 0.4 0.1"/><axis xyz="AXIS"/></joint>
<joint name="l" type="continuous"><parent link="b"/><child link="c"/><origin xyz="0 0.1 0.2"/>
 <axis xyz="1 0 0"/></joint></robot>"""


def with_several(path: Path, kind: str, axis: str = "0 0 1") -> Path:
    """Write a robot whose second joint has several coordinates; return `path`."""
    link = (
        '<link name="NAME"><inertial><origin xyz="0.1 0.05 -0.2" rpy="0.1 0.2 0.3"/><mass value="2"'
        '/><inertia ixx="0.3" iyy="0.4" izz="0.5" ixy="0.01" ixz="0.02" iyz="0.03"/></inertial>'
        "</link>"
    )
    text = SEVERAL.replace(
        "LINKS", "".join(link.replace("NAME", name) for name in ("base", *"abc"))
    )
    path.write_text(text.replace("KIND", kind).replace("AXIS", axis))
    return path


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("kind", "axis", "key", "other"),
    [
        ("planar", "0 0 1", "pinocchio", "drake"),
        ("planar", "0 1 2", "mujoco", "drake"),
        ("floating", "0 0 1", "pinocchio", "mujoco"),
        ("spherical", "0 0 1", "mujoco", "pinocchio"),
    ],
)
def test_a_planar_floating_or_ball_joint_agrees_with_a_library_that_reads_it(
    tmp_path: Path, kind: str, axis: str, key: str, other: str
):
    path = with_several(tmp_path / "r.urdf", kind, axis)
    scene = from_urdf(path, floating=True, gravity=(1.0, -2.0, -9.0))
    claims = {"mass-matrix", "bias", "engine-acceleration", "engine-inverse-dynamics"}
    claims |= {"engine-momentum-matrix", "engine-frame-jacobian"}
    if axis == "0 0 1" and kind == "planar":
        claims |= {"engine-inverse-dynamics-derivatives"}
    options = {"engines": [READERS[key]], "formulations": ["gw"], "claims": sorted(claims)}
    found = validate(scene, examples=1, **options)
    assert {one.claim for one in found if one.verdict == "passed"} == claims
    others = {(one.claim, one.verdict) for one in found if one.verdict != "passed"}
    assert others <= {("engine-frame-jacobian", "skipped")}  # of links merged with others
    assert not READERS[other].represents(scene)


def test_pinocchio_takes_the_plane_of_a_planar_joint_across_z_whatever_its_axis(tmp_path: Path):
    scene = from_urdf(with_several(tmp_path / "r.urdf", "planar", "0 1 2"))
    options = {"engines": [READERS["pinocchio"]], "formulations": ["gw"], "claims": ["mass-matrix"]}
    assert "failed" in {one.verdict for one in validate(scene, examples=1, **options)}


@pytest.mark.sampled(11)
@pytest.mark.parametrize("key", asked_by_default(READERS))
@pytest.mark.parametrize("more", ["", FINGERS])
@pytest.mark.parametrize("floating", [False, True])
def test_a_library_that_reads_the_file_agrees_to_rounding(key, more, floating, tmp_path: Path):
    installed(key)
    file = arm(tmp_path / "arm.urdf", more=more)
    file.write_text(file.read_text().replace('<link name="base"/>', body("base")))
    scene = from_urdf(file, floating=floating)
    assert ("base_pitch" in scene.coordinate_names) == floating
    found = compare_libraries(scene, [key], states=5)
    assert found.libraries[key].verdict in ("agrees", "fewer digits")
    assert set(found.differences) == set(QUANTITIES)
    assert all(table.max() < 1e-9 for table in found.differences.values())
    reader = READERS[key]
    offered = {claim for claim in CONFORMANCE if reader.offers(CLAIMS[claim].asks)}
    if reader.derivatives_by_differences:
        offered = {claim for claim in offered if not claim.endswith("-derivatives")}
    assert len(found.libraries[key].findings.keys() - offered) == 4
    left_out = offered - found.libraries[key].findings.keys()
    # Solved without the joint that follows, and no constraint.
    assert not left_out or more
    assert found.states == 5


class Signed(PinocchioFile):
    """A library in which one row of the frame Jacobians has the other sign."""

    key = "signed_file"

    def frame_jacobian(self, f, q, t=0.0):
        J = super().frame_jacobian(f, q, t)
        J[5] = -J[5]
        return J


@pytest.mark.night
def test_a_quantity_that_no_reason_explains_differs_beside_what_one_does(
    monkeypatch, tmp_path, capsys
):
    monkeypatch.setitem(library_comparison.BY_FORMAT["urdf"], Signed.key, Signed)
    scene = from_urdf(arm(tmp_path / "arm.urdf", damping="0.3"))
    found = compare_libraries(scene, [Signed.key, "pinocchio"], states=4)
    signed, right = found.libraries[Signed.key], found.libraries["pinocchio"]
    assert (signed.verdict, right.verdict) == ("differs", "no damping")
    assert signed.why == f"{right.why}; no reason known for frame_jacobian"
    print_comparison(found)
    printed = " ".join(capsys.readouterr().out.split())
    assert "by eomcheck: wrong sign [" in printed
    # Of that quantity alone the dampers are no reason.
    found = compare_libraries(
        scene, [Signed.key, "pinocchio"], states=2, claims=["engine-frame-jacobian"]
    )
    signed, right = found.libraries[Signed.key], found.libraries["pinocchio"]
    assert (signed.verdict, signed.why, right.verdict) == ("differs", "", "agrees")
    assert not found.differences
    assert set(signed.findings) == set(right.findings) == {"engine-frame-jacobian"}


def test_claims_choose_what_libraries_are_compared_by(tmp_path: Path):
    scene = from_urdf(arm(tmp_path / "arm.urdf", damping="0.3"))
    found = compare_libraries(
        scene, ["pinocchio"], states=2, claims=["engine-gravity", "mass-matrix"]
    )
    mine = found.libraries["pinocchio"]
    assert (mine.verdict, list(found.differences)) == ("agrees", ["M"])
    assert list(mine.findings) == ["mass-matrix", "engine-gravity"]
    for name, message in (
        ("mass-matri", "did you mean 'mass-matrix'"),
        ("equivalence", "claim = 'equivalence', expected one that compares libraries"),
    ):
        with pytest.raises(InputError, match=message):
            compare_libraries(scene, ["pinocchio"], states=1, claims=[name])


OWN_READER = """
from eomcheck.engines import PinocchioFile


class Turned(PinocchioFile):
    key = "turned_file"

    @classmethod
    def version(cls):
        return "turned 1.0"

    def inverse_dynamics_derivatives(self, q, v, vdot, t=0.0):
        by_q, by_v = super().inverse_dynamics_derivatives(q, v, vdot, t)
        return by_q.T, by_v


class NoReader:
    pass
"""


def test_an_engine_of_a_user_that_reads_the_file_is_compared(tmp_path: Path):
    own, robot = tmp_path / "own_reader.py", arm(tmp_path / "arm.urdf")
    own.write_text(OWN_READER, encoding="utf-8")
    options = ["--examples", "2", "--claim", "engine-inverse-dynamics-derivatives"]
    command = ["compare", str(robot), "--engine", f"{own}:Turned", *options]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 1, result.output
    assert "transposed [∂τ/∂q]" in " ".join(result.output.split())
    with pytest.raises(InputError, match="is no FileEngine that reads arm"):
        compare_libraries(from_urdf(robot), ["eomcheck.engines.pinocchio:PinocchioEngine"])


def test_a_joint_that_follows_another_is_no_coordinate_but_the_library_s_own(tmp_path: Path):
    scene = from_urdf(arm(tmp_path / "arm.urdf", more=FINGERS))
    engine = PinocchioFile(scene)
    assert scene.coordinate_names == ("shoulder", "slide", "wrist", "grip")
    assert engine.coordinates.shape == (5, 4)
    assert engine.coordinates[engine.joints().index("follow")].tolist() == [0, 0, 0, -2]


@pytest.mark.parametrize("key", ["mujoco", "drake"])
def test_a_root_called_world_cannot_be_free_where_it_is_the_ground(key: str, tmp_path: Path):
    installed(key)
    file = free(tmp_path / "arm.urdf")
    file.write_text(file.read_text().replace('"base"', '"world"'))
    with pytest.raises(InputError, match=f"{key}_file .* a link called world"):
        compare_libraries(from_urdf(file, floating=True), [key], states=1)


@pytest.mark.parametrize("linear", AXES)
@pytest.mark.parametrize("angular", AXES)
@pytest.mark.parametrize("first", [False, True])
def test_a_base_moves_as_differences_of_its_places_say(linear, angular, first):
    told, h = BaseVelocity(linear, angular, first), 1e-6
    q, v = np.array([0.3, -0.2, 0.5, 2.1, -0.7, 1.3]), np.array([0.4, 0.2, -0.6, 0.9, -1.1, 0.8])
    at, turn = np.array([0.2, -0.5, 0.3]), rotation_matrix((0.9, 0.1, -0.3, 0.2))
    before, here, after = (free_base(q + x * v, v, at, turn) for x in (-h, 0, h))
    place = (after.position - before.position) / (2 * h)
    spin = (after.R - before.R) @ here.R.T / (2 * h)
    omega = np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
    parts = [
        here.R.T @ x if axes == "base" else x for x, axes in ((place, linear), (omega, angular))
    ]
    S, rest = here.velocity(told, v)
    assert S @ v == pytest.approx(np.concatenate(parts[::-1] if first else parts), abs=1e-8)
    ends = [one.velocity(told, v)[0] @ v for one in (before, after)]
    assert rest == pytest.approx((ends[1] - ends[0]) / (2 * h), abs=1e-8)
    assert rotation_matrix(tuple(here.quaternion)) == pytest.approx(here.R, abs=1e-14)


# ---- Who differs is told, and why ----------------------------------------------------------------


class Armature(PinocchioFile):
    key = "armature_file"

    def mass_matrix(self, q, t=0.0):
        return super().mass_matrix(q, t) + np.diag([0.0, 0.1, 0.0])


class Heavy(PinocchioFile):
    key = "heavy_file"

    def forces(self, q, v, t=0.0):
        return super().forces(q, v, t) * (9.80665 / 9.81)


class HeavyAbove(Heavy):
    key = "heavy_above"

    def forces(self, q, v, t=0.0):
        return super().forces(q, v, t) if q[1] > 0.0 else PinocchioFile.forces(self, q, v, t)


class Backwards(PinocchioFile):
    key = "backwards_file"

    def velocity_map(self, q, v):
        turned = np.array([1.0, -1.0, 1.0])
        x, S, rest = super().velocity_map(q * turned, v)
        return VelocityMap(x, S * turned, rest)


class Single(PinocchioFile):
    key = "single_file"

    def mass_matrix(self, q, t=0.0):
        return super().mass_matrix(q, t) * (1 + 1e-10)


def compared(monkeypatch, kind: type[PinocchioFile], path: Path, **options) -> LibraryComparison:
    """Compare with an engine that reads as a faulty library would."""
    monkeypatch.setitem(library_comparison.BY_FORMAT["urdf"], kind.key, kind)
    return compare_libraries(from_urdf(arm(path, **options)), [kind.key], states=3)


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("kind", "claim", "why"),
    [
        (Armature, "mass-matrix", "adds to the diagonal of M alone, as an armature does: slide"),
        (Heavy, "generalized-forces", "has 0.999659 times our gravity"),
        (Backwards, "bias", "has the opposite axis: slide"),
    ],
)
def test_what_a_library_reads_otherwise_is_named(monkeypatch, tmp_path, kind, claim, why):
    found = compared(monkeypatch, kind, tmp_path / "arm.urdf")
    one = found.libraries[kind.key]
    assert claim in {finding.claim for finding in one.failures}
    assert [x.sentence for x in one.explanations] == [why]
    assert one.verdict == "differs"
    assert max(table[0, 1] for table in found.differences.values()) > 1e-4


def test_fewer_digits_are_told_apart_from_other_equations(monkeypatch, tmp_path):
    found = compared(monkeypatch, Single, tmp_path / "arm.urdf")
    assert found.libraries["single_file"].verdict == "fewer digits"
    assert {x.claim for x in found.libraries["single_file"].failures} == {"mass-matrix"}


def test_a_library_without_damping_says_so_and_nothing_else(tmp_path: Path):
    found = compare_libraries(
        from_urdf(arm(tmp_path / "arm.urdf", damping="0.3")), ["pinocchio"], states=3
    )
    assert found.libraries["pinocchio"].verdict == "no damping"
    assert [one.sentence for one in found.libraries["pinocchio"].explanations] == [
        "leaves out the damping of slide"
    ]
    assert {x.claim for x in found.libraries["pinocchio"].failures} == {"engine-acceleration"}


def test_a_larger_damping_than_the_file_s_is_not_one_that_is_left_out(monkeypatch, tmp_path):
    class Reversed(PinocchioFile):
        key = "reversed_file"

        def free_acceleration(self, q, v):
            twice = np.array([0, 2 * 0.3 * v[1], 0])
            return super().free_acceleration(q, v) - np.linalg.solve(self.mass_matrix(q), twice)

    found = compared(monkeypatch, Reversed, tmp_path / "arm.urdf", damping="0.3")
    assert found.libraries["reversed_file"].explanations == []
    assert found.libraries["reversed_file"].verdict == "differs"


def opposite(path: Path, wrong: list[str]) -> Discrepancy:
    """Return a robot whose accelerations differ by two dampers, of `wrong` with the wrong sign."""
    at = parting(path)
    damped = frozenset({"shoulder", "slide"})
    missing = np.array([-1.0 if name in wrong else name in damped for name in at.joints])
    theirs = at.reference | {"q̈": at.reference["q̈"] + missing}
    return at._replace(description=at.description._replace(damped=damped), library=theirs)


@pytest.mark.parametrize("wrong", [[], ["shoulder"], ["slide"], ["shoulder", "slide"], ["wrist"]])
def test_dampers_are_left_out_only_where_all_that_differs_is_against_the_velocity(tmp_path, wrong):
    at = opposite(tmp_path / "arm.urdf", wrong)
    assert at.leaves_out_damping == (not wrong)
    turned = opposite(tmp_path / "arm.urdf", ["shoulder"])
    v = np.array([-1.0, 1.0, 1.0])
    assert turned._replace(v=v).leaves_out_damping


def free(path: Path) -> Path:
    """Write the arm on a base that has inertia; return `path`."""
    arm(path).write_text(path.read_text().replace('<link name="base"/>', body("base")))
    return path


@pytest.mark.night
@pytest.mark.parametrize(
    ("taken", "told"),
    [
        (BaseVelocity("ground", "base"), "linear velocity along the axes of the base"),
        (BaseVelocity("base", "ground"), "angular velocity along the axes of the base"),
        (BaseVelocity("base", "base", True), "linear velocity along the axes of the base, then"),
    ],
)
def test_a_base_whose_velocity_is_another_than_taken_is_named(monkeypatch, tmp_path, taken, told):
    class Taken(PinocchioFile):
        key = "taken_file"
        base_velocity = taken

    monkeypatch.setitem(library_comparison.BY_FORMAT["urdf"], "taken_file", Taken)
    scene = from_urdf(free(tmp_path / "arm.urdf"), floating=True)
    found = compare_libraries(scene, ["taken_file"], states=3)
    ((why, *_),) = found.libraries["taken_file"].explanations
    assert why.startswith("has another velocity of the base: ")
    assert told in why
    assert why.endswith(f"not {taken}")


def parting(path: Path, **options) -> Discrepancy:
    ours = {name: np.eye(3) if name == "M" else np.ones(3) for name in QUANTITIES}
    theirs = ours | {"M": ours["M"] + 0.5}
    names = "shoulder", "slide", "wrist"
    return Discrepancy(read_description(arm(path, **options)), names, np.ones(3), ours, theirs, {})


@pytest.mark.parametrize(
    ("last", "why"),
    [
        (body("hand", mass=0), "moments of inertia without mass (hand), which libraries may drop"),
        (
            body("hand", zz=0.3),
            "inertias that no body can have (hand), which libraries may change",
        ),
        ('<link name="hand"/>', "links without inertia (hand), to which libraries may give some"),
    ],
)
def test_what_is_odd_in_the_file_is_told_where_M_differs(tmp_path: Path, last: str, why: str):
    assert Explanation(f"the file has {why}") in explain(parting(tmp_path / "arm.urdf", last=last))


def test_nothing_odd_is_told_of_a_file_without_it(tmp_path: Path):
    assert explain(parting(tmp_path / "arm.urdf")) == []


@pytest.mark.parametrize(
    ("turned", "n"), [([1], 2), ([0], 3), ([1, 2], 3), ([1, 3], 4), ([0, 2], 4), ([2, 4], 5)]
)
def test_joints_with_the_opposite_axis_are_named_though_others_have_the_same_M(
    tmp_path: Path, turned: list[int], n: int
):
    """M is the same if all other joints are turned: their weights tell which."""
    names = tuple("abcde"[:n])
    ours = {"M": np.eye(n) + 0.1, "gravity": np.arange(1.0, n + 1)}
    signs = np.where(np.isin(np.arange(n), turned), -1.0, 1.0)
    theirs = {"M": np.outer(signs, signs) * ours["M"], "gravity": signs * ours["gravity"]}
    rest = {"bias": np.zeros(n), "q̈": np.ones(n)}
    at = Discrepancy(
        read_description(arm(tmp_path / "arm.urdf")), names, np.ones(n), ours | rest, {}, {}
    )
    said = ", ".join(names[i] for i in turned)
    assert explain(at._replace(library=theirs | rest)) == [
        Explanation(f"has the opposite axis: {said}")
    ]
    # Where nothing weighs, fewest joints.
    free = {"gravity": np.zeros(n)} | rest
    (said,) = explain(at._replace(reference=ours | free, library=theirs | free))
    assert said.sentence.count(",") + 1 == min(len(turned), n - len(turned))


@pytest.mark.parametrize("scale", [1e-13, 1.0, 1e6])
def test_an_armature_is_named_at_its_joint_alone_whatever_the_size_of_inertias(tmp_path, scale):
    own = scale * np.diag([1.0, 1e-4, 1e-7])
    ours = {"M": own, "bias": np.ones(3), "gravity": np.ones(3), "q̈": np.ones(3)}
    added = np.diag([0.0, 2e-8 * scale, 2e-15 * scale])
    theirs = ours | {"M": own + added + np.diag([1e-15 * scale, 0.0, 0.0])}
    names = "shoulder", "slide", "wrist"
    at = Discrepancy(
        read_description(arm(tmp_path / "arm.urdf")), names, np.ones(3), ours, theirs, {}
    )
    assert [one.sentence for one in explain(at)] == [
        "adds to the diagonal of M alone, as an armature does: slide"
    ]


# ---- Nobody is blamed, and rounding is no difference ---------------------------------------------

LINKAGE = """<mujoco><worldbody><body name="a"><joint name="a" axis="0 1 0" damping="0.1"/>
<inertial pos="0 0 0.5" mass="1" diaginertia="0.1 0.1 0.01"/>
<body name="b" pos="0 0 1"><joint name="b" axis="0 1 0"/>
<inertial pos="0.5 0 0" mass="1.5" diaginertia="0.01 0.1 0.1"/>
<body name="c" pos="1.2 0 0"><joint name="c" axis="0 1 0"/>
<inertial pos="0 0 -0.4" mass="0.7" diaginertia="0.1 0.1 0.01"/></body></body></body></worldbody>
<equality><connect body1="c" body2="world" anchor="0.1 0 -0.8"/></equality></mujoco>"""


def wheel(path: Path) -> Path:
    """Write a wheel on a hub that steers it, on whose axis both have their weight."""
    link = """<link name="{}"><inertial><origin xyz="{}"/><mass value="{}"/>
    <inertia ixx="1e-3" iyy="1e-3" izz="2e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
    turn = """<joint name="{}" type="continuous"><parent link="{}"/><child link="{}"/>
    <origin xyz="{}" rpy="1.5708 0 0"/><axis xyz="{}"/></joint>"""
    parts = (
        '<robot name="wheel"><link name="base"/>',
        link.format("hub", "0 0 0.1", 0.3),
        link.format("wheel", "0 0 0.01", 0.4),
        turn.format("steer", "base", "hub", "0.3 0.1 0", "0 1 0"),
        turn.format("roll", "hub", "wheel", "0 0.02 0", "0 0 1"),
        "</robot>",
    )
    path.write_text("".join(parts), encoding="utf-8")
    return path


@pytest.mark.parametrize("key", asked_by_default(READERS))
def test_forces_that_cancel_to_rounding_are_no_difference(key: str, tmp_path: Path):
    installed(key)
    found = compare_libraries(from_urdf(wheel(tmp_path / "wheel.urdf")), [key], states=6)
    assert (found.libraries[key].verdict, found.agree) == ("agrees", True)
    assert all(table.max() < 1e-13 for name, table in found.differences.items() if name != "q̈")


def test_a_thousandth_of_what_cancels_is_the_least_that_differences_are_relative_to():
    entries = np.array([1.0, -2.0])
    assert relative(([entries, entries - 1e-3], 1999.0)) == pytest.approx(1e-3 / 2.001)
    assert relative(([entries, entries - 1e-3], 2002.0)) == pytest.approx(1e-3 / 2002)
    assert relative(([entries * 0, entries * 0], 0.0)) == 0
    assert np.isnan(relative(([None, entries], 0.0)))


def relative(*states: tuple[list[Any], float]) -> float:
    """Return the relative difference of two sides over states."""
    running = RunningDifference(2)
    for values, summed in states:
        running.add(values, summed)
    return running.relative[0, 1]


def test_differences_are_relative_to_the_largest_entry_of_all_states():
    entries = np.array([1.0, -2.0])
    small = [1e-16 * entries, 2e-16 * entries], 0.0
    assert relative(small) == pytest.approx(0.5)
    assert relative(small, ([entries, entries], 0.0)) == pytest.approx(1e-16)
    assert relative(small, ([None, entries], 0.0)) == pytest.approx(1e-16)
    assert relative(small, ([entries, None], 0.0)) == pytest.approx(1e-16)


@pytest.mark.night
def test_states_are_those_of_the_seed(tmp_path: Path):
    scene = from_urdf(arm(tmp_path / "arm.urdf"))

    def worst(seed: int) -> list:
        found = compare_libraries(scene, ["pinocchio"], states=2, seed=seed)
        findings = found.libraries["pinocchio"].findings.values()
        return [one.state.q.tolist() for one in findings if one.state]

    assert worst(0) != worst(1)


def test_what_cancels_to_rounding_agrees_but_for_digits(tmp_path: Path):
    at = parting(tmp_path / "arm.urdf")
    at.reference["bias"], at.library["bias"] = np.zeros(3), np.full(3, 1e-16)
    assert not at.agrees_on("bias")
    assert at._replace(summed={"bias": 1.0}).agrees_on("bias")
    assert not at._replace(summed={"bias": 1e-9}).agrees_on("bias")


def test_moments_of_weights_are_as_large_as_the_whole_weight_at_the_end_of_the_arm(tmp_path: Path):
    scene = from_urdf(arm(tmp_path / "arm.urdf"))
    q = np.array([0.3, -0.5, 0.2])
    seat, last = np.linalg.norm([0.1, 0.2, 0.3]), np.linalg.norm([0, 0.1, 0.05])
    expected = (2.5 + 1.2 + 0.7) * 9.81 * (3 * seat + 0.5 + last)
    assert weight_size(Evaluation(scene, q, 0 * q)) == pytest.approx(expected, rel=1e-12)
    still = from_urdf(tmp_path / "arm.urdf", gravity=None)
    assert weight_size(Evaluation(still, q, 0 * q)) == 0.0
    assert weight_size(Evaluation(Snake.coil(2), *Snake.coil(2).initial_state())) == 0.0


def test_fast_motion_takes_no_digits_from_forces_by_mujoco(tmp_path: Path):
    installed("mujoco")
    engine = READERS["mujoco"](from_urdf(arm(tmp_path / "arm.urdf", damping="0.3")))
    q, v = np.array([0.3, -0.2, 0.9]), np.array([3e7, 2e7, -1e7])
    dampers = np.array([0.0, -0.3 * 2e7, 0.0])
    assert (engine.forces(q, v) == engine.forces(q, 0 * v) + dampers).all()


def test_of_a_file_that_is_read_in_two_ways_nobody_is_blamed(monkeypatch, tmp_path, capsys):
    found = compared(monkeypatch, Heavy, tmp_path / "arm.urdf")
    assert (found.self_failures, found.agree) == ([], False)
    failures = found.libraries[Heavy.key].failures
    assert all(" by the library, " in one.detail for one in failures)
    assert not any("expected" in one.detail for one in failures)
    print_comparison(found)
    assert "either reading may be wrong" in " ".join(capsys.readouterr().out.split())


def test_derivations_of_ours_that_differ_from_each_other_are_said(monkeypatch, tmp_path, capsys):
    energies = type(from_urdf(arm(tmp_path / "arm.urdf"))).energies

    def twice(*given):
        T, U = energies(*given)
        return 2 * T, U

    scene = from_urdf(tmp_path / "arm.urdf")
    monkeypatch.setitem(library_comparison.BY_FORMAT["urdf"], Heavy.key, Heavy)
    monkeypatch.setattr(type(scene), "energies", staticmethod(twice))
    found = compare_libraries(scene, [Heavy.key], states=3)
    assert {one.claim for one in found.self_failures} >= {"kinetic-energy"}
    print_comparison(found)
    printed = " ".join(capsys.readouterr().out.split())
    assert "The two derivations of eomcheck differ from each other: kinetic energy" in printed
    assert "either reading" not in printed
    found.libraries[Heavy.key].findings.clear()
    assert not found.agree


def test_derivations_of_ours_are_compared_in_no_state_in_which_all_libraries_agree(
    monkeypatch, tmp_path: Path
):
    scene = from_urdf(arm(tmp_path / "arm.urdf"))
    energies = type(scene).energies
    monkeypatch.setattr(
        type(scene), "energies", staticmethod(lambda *here: (2 * energies(*here)[0], None))
    )
    monkeypatch.setitem(library_comparison.BY_FORMAT["urdf"], HeavyAbove.key, HeavyAbove)
    states = [State(np.array([0.3, x, -0.7]), np.ones(3)) for x in (-0.4, 0.6, -0.8, 1.2)]
    monkeypatch.setattr(library_comparison, "draw_samples", lambda cases, count, seed: states)
    found = compare_libraries(scene, [HeavyAbove.key], states=4)
    assert {one.state.q[1] for one in found.self_failures if one.state is not None} == {0.6, 1.2}


def test_redundant_equalities_leave_all_but_the_acceleration_to_compare(tmp_path, capsys):
    pytest.importorskip("mujoco")
    path = tmp_path / "linkage.xml"
    path.write_text(LINKAGE, encoding="utf-8")
    found = compare_libraries(from_mjcf(path), states=2)
    assert (found.agree, found.libraries["mujoco"].verdict, len(found.skipped)) == (
        True,
        "agrees",
        2,
    )
    mine = found.libraries["mujoco"]
    assert mine.verdict == "agrees"
    passed = {one.claim for one in mine.findings.values() if one.verdict == "passed"}
    assert passed - {*CONFORMANCE} == {
        "mass-matrix",
        "bias",
        "generalized-forces",
    }
    assert not mine.inconclusive_counts
    assert np.isnan(found.differences["q̈"]).all()
    assert all(table.max() < 1e-13 for name, table in found.differences.items() if name != "q̈")
    print_comparison(found)
    printed = " ".join(capsys.readouterr().out.split())
    assert "q̈ is not compared in 2 of 2 states: the 3 x 3 matrix" in printed
    assert "all that answered agree to rounding, without q̈" in printed
    ran = CliRunner().invoke(app, ["compare", str(path), "--examples", "1"])
    assert ran.exit_code == 0, ran.output


def test_a_number_that_rounding_explains_away_is_not_shown(tmp_path, capsys):
    light = {"mass": 1e-12, "xx": 1e-12, "yy": 1e-12, "zz": 1e-12}
    hand = LINK.format(name="hand", at="0 0 0", turn="0 0 0", **light)
    for product in ("0.01", "-0.02", "0.015"):
        hand = hand.replace(f'"{product}"', '"0"')
    found = compare_libraries(
        from_urdf(arm(tmp_path / "arm.urdf", last=hand)), ["pinocchio"], states=2
    )
    mine = found.libraries["pinocchio"]
    assert dict(mine.inconclusive_counts) == {"acceleration": 2}
    assert np.isnan(found.differences["q̈"][0, 1])
    assert found.libraries["pinocchio"].verdict == "agrees where decided"
    assert mine.undecided_claims == ["engine-acceleration"]
    print_comparison(found)
    printed = " ".join(capsys.readouterr().out.split())
    assert "engine-acceleration is not resolved in any of 2 states: gw ~ pinocchio" in printed
    assert "q̈ of pinocchio: inconclusive in 2 of 2 states" in printed
    assert "all that answered agree to rounding where decided" in printed
    mine.decided = False
    assert found.libraries["pinocchio"].verdict == "inconclusive"


@pytest.mark.parametrize("unsure", [0, 1])
def test_a_quantity_unsure_in_one_state_has_the_difference_of_the_others(
    monkeypatch, tmp_path, unsure
):
    right, seen = ValidationRun.check_state, []

    def blind(self, *how):
        found = right(self, *how)
        seen.append(found)
        if len(seen) - 1 != unsure:
            return found
        return [replace(one, verdict="inconclusive") for one in found]

    monkeypatch.setattr(ValidationRun, "check_state", blind)
    scene = from_urdf(arm(tmp_path / "arm.urdf"))
    found = compare_libraries(scene, ["pinocchio"], states=2)
    assert len(seen) == 2 and set(found.libraries["pinocchio"].inconclusive_counts.values()) == {1}
    assert all(0 <= table[0, 1] < 1e-9 for table in found.differences.values())


@pytest.mark.parametrize("verdict", ["inconclusive", "skipped"])
def test_nothing_decided_about_any_library_is_never_agreement(
    monkeypatch, tmp_path, capsys, verdict
):
    right = ValidationRun.check_state

    def undecided(self, *how):
        return [replace(one, verdict=verdict) for one in right(self, *how)]

    monkeypatch.setattr(ValidationRun, "check_state", undecided)
    scene = from_urdf(arm(tmp_path / "arm.urdf"))
    found = compare_libraries(scene, ["pinocchio"], states=2)
    assert (found.agree, found.disagree, found.undecided_libraries) == (False, False, ["pinocchio"])
    where = {"inconclusive": "inconclusive", "skipped": "nothing compared"}[verdict]
    assert found.libraries["pinocchio"].verdict == where
    print_comparison(found)
    assert "agree to rounding" not in capsys.readouterr().out
    with pytest.raises(InputError, match=r"^arm: nothing was decided about pinocchio$"):
        found.check_decided()
    write_comparison(found, tmp_path / "out.json")
    assert json.loads((tmp_path / "out.json").read_text())["decided"] == {"pinocchio": False}


# ---- What a library does instead of an answer ----------------------------------------------------


class Nan(PinocchioFile):
    key = "nan_file"

    def mass_matrix(self, q, t=0.0):
        return np.full((3, 3), np.nan)


class AtRest(PinocchioFile):
    key = "at_rest_file"

    def forces(self, q, v, t=0.0):
        if not v.any():  # nor are there forces then
            raise RuntimeError("no flow")
        return super().forces(q, v, t)


class Elsewhere(PinocchioFile):
    key = "elsewhere_file"

    def free_acceleration(self, q, v):
        raise ZeroDivisionError


@pytest.mark.parametrize(
    ("kind", "quantities", "what"),
    [
        (Nan, ["M"], "mass_matrix returned nan in entry [0, 0]"),
        (
            AtRest,
            ["gravity", "forces"],
            "forces raised RuntimeError: no flow (test_comparing.py, line",
        ),
        (Elsewhere, ["q̈"], "acceleration raised ZeroDivisionError (test_comparing.py, line"),
    ],
)
def test_a_library_that_does_not_answer_is_told_by_quantity(
    monkeypatch, tmp_path, capsys, kind, quantities, what
):
    found = compared(monkeypatch, kind, tmp_path / "arm.urdf")
    faults = found.libraries[kind.key].faults
    assert list(faults) == quantities
    assert all(said.startswith(what) for said in faults.values())
    assert not found.agree
    assert found.libraries[kind.key].verdict == ", ".join(f"no {name}" for name in quantities)
    agreed = [table for name, table in found.differences.items() if name not in quantities]
    assert np.max(agreed) < 1e-12
    print_comparison(found)
    shown = " ".join(capsys.readouterr().out.split())
    assert shown.count("fault") == len(quantities)
    assert all(f"gives no {name}: {what}" in shown for name in quantities)
    assert "agree to rounding" not in shown
    write_comparison(found, tmp_path / "out.json")
    written = json.loads((tmp_path / "out.json").read_text())["faults"]
    assert written == [[kind.key, *fault] for fault in faults.items()]


def test_who_fails_at_rest_alone_does_not_agree(monkeypatch, tmp_path):
    moving = State(np.array([0.3, 0.1, -0.4]), np.array([0.5, -0.2, 1.0]), 0.0)
    monkeypatch.setattr(library_comparison, "draw_samples", lambda *_: [moving])
    found = compared(monkeypatch, AtRest, tmp_path / "arm.urdf")
    mine = found.libraries["at_rest_file"]
    assert (mine.failures, list(mine.faults)) == ([], ["gravity"])
    assert not found.agree
    assert found.libraries["at_rest_file"].verdict == "no gravity"
    print_comparison(found)


def test_a_library_reads_the_file_twice_however_many_states_there_are(monkeypatch, tmp_path):
    class Counted(PinocchioFile):
        key = "counted_file"
        times = 0

        def _read(self, library, description):
            type(self).times += 1
            super()._read(library, description)

    found = compared(monkeypatch, Counted, tmp_path / "arm.urdf")
    assert (found.states, Counted.times) == (3, 2)


# ---- What cannot be compared ---------------------------------------------------------------------


def test_a_robot_with_other_parameters_than_its_file_is_read_by_no_library(tmp_path: Path):
    scene = from_urdf(arm(tmp_path / "arm.urdf"))
    assert PinocchioFile.represents(scene)
    changed = scene.changed(mass=2 * scene.mass)  # type: ignore[attr-defined]
    assert not PinocchioFile.represents(changed)
    with pytest.raises(InputError, match="no robot as its file describes it"):
        compare_libraries(changed)
    with pytest.raises(InputError, match="no robot as its file describes it"):
        compare_libraries(ChainPendulum.rods(1))


def test_an_unknown_library_is_refused_by_name(tmp_path: Path):
    with pytest.raises(UnknownNameError, match="unknown engine 'newton'"):
        compare_libraries(from_urdf(arm(tmp_path / "arm.urdf")), ["newton"])


def test_a_library_that_cannot_read_the_file_is_told_beside_those_that_can(monkeypatch, tmp_path):
    class Refusing(PinocchioFile):
        key = "refusing_file"

        def _read(self, library, description):
            raise RuntimeError("no such\njoint")

    readers = {"a": Refusing, "pinocchio": PinocchioFile}
    monkeypatch.setitem(library_comparison.BY_FORMAT, "urdf", readers)
    found = compare_libraries(from_urdf(arm(tmp_path / "arm.urdf")), states=1)
    assert [(one.library, one.refusal) for one in found.refused] == [("a", "no such joint")]
    assert [one.library for one in found.answered] == ["pinocchio"]
    with pytest.raises(InputError, match="nothing to compare arm with: a: no such joint"):
        compare_libraries(from_urdf(arm(tmp_path / "arm.urdf")), ["a"])


def test_a_library_that_lacks_a_joint_is_told(monkeypatch, tmp_path):
    class Locked(PinocchioFile):
        key = "locked_file"

        def joints(self):
            return super().joints()[:2]

    monkeypatch.setitem(library_comparison.BY_FORMAT, "urdf", {"locked": Locked})
    with pytest.raises(InputError, match="locked_file has no joint 'wrist', which the file moves"):
        compare_libraries(from_urdf(arm(tmp_path / "arm.urdf")))


# ---- Answers in the coordinates of the file ------------------------------------------------------


def test_accelerations_are_the_library_s_own_under_its_own_forces(tmp_path: Path):
    scene = from_urdf(arm(tmp_path / "arm.urdf", more=FINGERS))
    answers = Answers(PinocchioFile(scene))
    q, v = np.array([0.3, -0.2, 0.9, 0.1]), np.array([0.5, 0.4, -1.0, 0.2])
    vdot = answers.acceleration(q, v, np.full(4, np.nan), None, None).vdot
    F = answers.forces(q, v) - answers.bias(q, v)
    assert answers.mass_matrix(q) @ vdot == pytest.approx(F, rel=1e-12)


def test_what_is_written_while_a_library_reads_is_kept_and_not_shown(capfd):
    with capture_output() as lines:
        os.write(1, b"one\n")
        os.write(2, b"two\none\n")
    assert lines == ["one", "two"]
    print("after")
    assert capfd.readouterr() == ("after\n", "")


# ---- The command line ----------------------------------------------------------------------------


@pytest.mark.parametrize(("damping", "code"), [("", 0), ("0.3", 1)])
def test_the_command_tells_and_its_exit_code_says_whether_all_agree(tmp_path, damping, code):
    path, out = arm(tmp_path / "arm.urdf", damping=damping), tmp_path / "out.json"
    given = "compare", str(path), "--engine", "pinocchio", "--examples", "2", "--json", str(out)
    ran = CliRunner().invoke(app, [*given, "--pairs"])
    assert ran.exit_code == code, ran.output
    assert "M, each library beside each other" in ran.output
    assert ("no damping" in ran.output) == bool(damping)
    written = json.loads(out.read_text(encoding="utf-8"))
    assert written["libraries"] == ["eomcheck", "pinocchio"]
    assert np.array(written["apart"]["M"]).shape == (2, 2)
    assert [one["verdict"] for one in written["findings"]].count("failed") == code


@pytest.mark.night
def test_a_free_base_is_asked_for_behind_a_colon(tmp_path: Path):
    path, out = free(tmp_path / "arm.urdf"), tmp_path / "out.json"
    given = "compare", f"{path}:floating", "--engine", "pinocchio", "--examples", "2"
    ran = CliRunner().invoke(app, [*given, "--json", str(out)])
    assert ran.exit_code == 0, ran.output
    assert json.loads(out.read_text(encoding="utf-8"))["coordinates"][0] == "base_x"


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("arm.urdf:free", "scene = 'arm.urdf:free', expected arm.urdf or arm.urdf:floating"),
        (
            "snake",
            "robot = 'snake', expected robot.urdf, robot.urdf:floating, robot.xml or robot.sdf",
        ),
        ("snake:floating", "robot = 'snake:floating', expected robot.urdf, robot.urdf:"),
    ],
)
def test_what_is_no_robot_s_file_is_refused_in_one_sentence(name: str, said: str):
    ran = CliRunner().invoke(app, ["compare", name])
    assert isinstance(ran.exception, InputError)
    assert str(ran.exception).startswith(said)


def test_a_file_that_is_not_there_is_one_sentence(tmp_path: Path):
    ran = CliRunner().invoke(app, ["compare", str(tmp_path / "none.urdf")])
    assert isinstance(ran.exception, InputError)
    assert "none.urdf' cannot be read" in str(ran.exception)


def test_what_was_found_is_written_and_printed_of_a_library_that_gave_no_answer(tmp_path, capsys):
    scene = from_urdf(arm(tmp_path / "arm.urdf"))
    found = compare_libraries(scene, ["pinocchio"], states=1)
    found.libraries["other"] = LibraryResult("other", refusal="cannot")
    write_comparison(found, tmp_path / "out.json")
    assert json.loads((tmp_path / "out.json").read_text())["refused"] == {"other": "cannot"}
    print_comparison(found)
    assert "other gave no answer: cannot" in capsys.readouterr().out
    found.libraries["other"].missing = True
    print_comparison(found)
    printed = capsys.readouterr().out
    assert "not installed" in printed and "no answer" not in printed
    assert "other was left out: cannot" in printed


@pytest.mark.parametrize(
    ("kind", "verdicts"),
    [
        ("planar", {"mujoco": "agrees", "pinocchio": "no damping"}),
        ("spherical", {"mujoco": "agrees"}),
    ],
)
def test_dampers_of_joints_with_several_coordinates_are_mujoco_s(
    tmp_path: Path, kind: str, verdicts: dict[str, str]
):
    path = tmp_path / "damped.urdf"
    text = (
        body("root") + body("link") + body("tip") + joint("k", "link", "tip", "revolute", "0 1 0")
    )
    several = joint("j", "root", "link", kind, "0 0 1", '<dynamics damping="0.5"/>')
    text += several.replace('lower="-2"', 'lower="0"')  # MuJoCo wants it of a ball
    path.write_text(f'<robot name="damped">{text}</robot>', "utf-8")
    claims = ["mass-matrix", "bias", "generalized-forces", "engine-acceleration"]
    compared = compare_libraries(from_urdf(path), [*verdicts], states=2, claims=claims)
    assert {key: one.verdict for key, one in compared.libraries.items()} == verdicts
