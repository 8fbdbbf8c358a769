"""One file, several libraries: who agrees, who differs, and why."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
from tests.robots import arm, body, joint
from typer.testing import CliRunner

from eomcheck.cli import app
from eomcheck.engines import Answers, VelocityMap
from eomcheck.engines.files import READERS, PinocchioFile
from eomcheck.engines.files.description import described
from eomcheck.engines.files.said import listening
from eomcheck.errors import EngineError, InputError, UnknownNameError
from eomcheck.lab import comparing
from eomcheck.lab.comparing import QUANTITIES, Comparison, compare
from eomcheck.lab.reasons import Parting, Why, reasons
from eomcheck.lab.report.comparison import print_comparison, write_comparison
from eomcheck.scenes import ChainPendulum, from_urdf

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


@pytest.mark.parametrize("key", READERS)
@pytest.mark.parametrize("more", ["", FINGERS])
def test_a_library_that_reads_the_file_agrees_to_rounding(key: str, more: str, tmp_path: Path):
    installed(key)
    scene = from_urdf(arm(tmp_path / "arm.urdf", more=more))
    found = compare(scene, [key], states=5)
    assert found.verdict(key) in ("agrees", "fewer digits")
    assert set(found.apart) == set(QUANTITIES)
    assert all(table.max() < 1e-9 for table in found.apart.values())
    assert len(found.findings) == 4
    assert found.states == 5


def test_a_joint_that_follows_another_is_no_coordinate_but_the_library_s_own(tmp_path: Path):
    scene = from_urdf(arm(tmp_path / "arm.urdf", more=FINGERS))
    engine = PinocchioFile(scene)
    assert scene.coordinate_names == ("shoulder", "slide", "wrist", "grip")
    assert engine.coordinates.shape == (5, 4)
    assert engine.coordinates[engine.joints().index("follow")].tolist() == [0, 0, 0, -2]


# ---- Who differs is told, and why ----------------------------------------------------------------


class Armature(PinocchioFile):
    key = "armature_file"

    def mass_matrix(self, q, t=0.0):
        return super().mass_matrix(q, t) + np.diag([0.0, 0.1, 0.0])


class Heavy(PinocchioFile):
    key = "heavy_file"

    def forces(self, q, v, t=0.0):
        return super().forces(q, v, t) * (9.80665 / 9.81)


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


def compared(monkeypatch, kind: type[PinocchioFile], path: Path, **options) -> Comparison:
    """Compare with an engine that reads as a faulty library would."""
    monkeypatch.setitem(comparing.READERS, kind.key, kind)
    return compare(from_urdf(arm(path, **options)), [kind.key], states=3)


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
    assert claim in {one.claim for one in found.of(kind.key)}
    assert [one.sentence for one in found.why[kind.key]] == [why]
    assert found.verdict(kind.key) == "differs"
    assert max(table[0, 1] for table in found.apart.values()) > 1e-4


def test_fewer_digits_are_told_apart_from_other_equations(monkeypatch, tmp_path):
    found = compared(monkeypatch, Single, tmp_path / "arm.urdf")
    assert found.verdict("single_file") == "fewer digits"
    assert {one.claim for one in found.failed} == {"mass-matrix"}


def test_a_library_without_damping_says_so_and_nothing_else(tmp_path: Path):
    found = compare(from_urdf(arm(tmp_path / "arm.urdf", damping="0.3")), ["pinocchio"], states=3)
    assert found.verdict("pinocchio") == "no damping"
    assert [one.sentence for one in found.why["pinocchio"]] == ["leaves out the damping of slide"]
    assert {one.claim for one in found.failed} == {"engine-acceleration"}


def test_a_larger_damping_than_the_file_s_is_not_one_that_is_left_out(monkeypatch, tmp_path):
    class Reversed(PinocchioFile):
        key = "reversed_file"

        def free_acceleration(self, q, v):
            twice = np.array([0, 2 * 0.3 * v[1], 0])
            return super().free_acceleration(q, v) - np.linalg.solve(self.mass_matrix(q), twice)

    found = compared(monkeypatch, Reversed, tmp_path / "arm.urdf", damping="0.3")
    assert found.why["reversed_file"] == []
    assert found.verdict("reversed_file") == "differs"


def parting(path: Path, **options) -> Parting:
    ours = {name: np.eye(3) if name == "M" else np.ones(3) for name in QUANTITIES}
    theirs = ours | {"M": ours["M"] + 0.5}
    names = "shoulder", "slide", "wrist"
    return Parting(described(arm(path, **options)), names, np.ones(3), ours, theirs)


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
    assert Why(f"the file has {why}") in reasons(parting(tmp_path / "arm.urdf", last=last))


def test_nothing_odd_is_told_of_a_file_without_it(tmp_path: Path):
    assert reasons(parting(tmp_path / "arm.urdf")) == []


# ---- What cannot be compared ---------------------------------------------------------------------


def test_a_robot_with_other_parameters_than_its_file_is_read_by_no_library(tmp_path: Path):
    scene = from_urdf(arm(tmp_path / "arm.urdf"))
    assert PinocchioFile.represents(scene)
    changed = scene.changed(mass=2 * scene.mass)  # type: ignore[attr-defined]
    assert not PinocchioFile.represents(changed)
    with pytest.raises(InputError, match="no robot as its file describes it"):
        compare(changed)
    with pytest.raises(InputError, match="no robot as its file describes it"):
        compare(ChainPendulum.rods(1))


def test_a_free_base_is_compared_with_who_takes_one(tmp_path: Path):
    heavy = arm(tmp_path / "arm.urdf").read_text().replace('<link name="base"/>', body("base"))
    (tmp_path / "heavy.urdf").write_text(heavy)
    found = compare(from_urdf(tmp_path / "heavy.urdf", floating=True), states=3)
    assert found.verdict("pinocchio") == "agrees"
    assert list(found.versions) == ["pinocchio"]
    assert all(table.max() < 1e-12 for table in found.apart.values())


def test_an_unknown_library_is_refused_by_name(tmp_path: Path):
    with pytest.raises(UnknownNameError, match="unknown engine 'newton'"):
        compare(from_urdf(arm(tmp_path / "arm.urdf")), ["newton"])


def test_a_library_that_cannot_read_the_file_is_told_beside_those_that_can(monkeypatch, tmp_path):
    class Refusing(PinocchioFile):
        key = "refusing_file"

        def _read(self, library, description):
            raise RuntimeError("no such\njoint")

    monkeypatch.setattr(comparing, "READERS", {"a": Refusing, "pinocchio": PinocchioFile})
    found = compare(from_urdf(arm(tmp_path / "arm.urdf")), states=1)
    assert found.refused == {"a": "no such joint"}
    assert list(found.versions) == ["pinocchio"]
    with pytest.raises(InputError, match="nothing to compare arm with: a: no such joint"):
        compare(from_urdf(arm(tmp_path / "arm.urdf")), ["a"])


def test_a_library_that_lacks_a_joint_is_told(monkeypatch, tmp_path):
    class Locked(PinocchioFile):
        key = "locked_file"

        def joints(self):
            return super().joints()[:2]

    monkeypatch.setattr(comparing, "READERS", {"locked": Locked})
    with pytest.raises(InputError, match="locked_file has no joint 'wrist', which the file moves"):
        compare(from_urdf(arm(tmp_path / "arm.urdf")))


# ---- Answers in the coordinates of the file ------------------------------------------------------


def test_accelerations_are_the_library_s_own_under_its_own_forces(tmp_path: Path):
    scene = from_urdf(arm(tmp_path / "arm.urdf", more=FINGERS))
    answers = Answers(PinocchioFile(scene))
    q, v = np.array([0.3, -0.2, 0.9, 0.1]), np.array([0.5, 0.4, -1.0, 0.2])
    vdot = answers.acceleration(q, v, np.full(4, np.nan), None, None).vdot
    F = answers.forces(q, v) - answers.bias(q, v)
    assert answers.mass_matrix(q) @ vdot == pytest.approx(F, rel=1e-12)


def test_what_is_written_while_a_library_reads_is_kept_and_not_shown(capfd):
    with listening() as lines:
        os.write(1, b"one\n")
        os.write(2, b"two\none\n")
    assert lines == ["one", "two"]
    print("after")
    assert capfd.readouterr() == ("after\n", "")


# ---- The command line ----------------------------------------------------------------------------


@pytest.mark.parametrize(("damping", "code"), [("", 0), ("0.3", 1)])
def test_the_command_tells_and_its_exit_code_says_whether_all_agree(tmp_path, damping, code):
    path, out = arm(tmp_path / "arm.urdf", damping=damping), tmp_path / "out.json"
    given = "compare", str(path), "--engine", "pinocchio", "--states", "2", "--json", str(out)
    ran = CliRunner().invoke(app, [*given, "--pairs"])
    assert ran.exit_code == code, ran.output
    assert "M, each library beside each other" in ran.output
    assert ("no damping" in ran.output) == bool(damping)
    written = json.loads(out.read_text(encoding="utf-8"))
    assert written["libraries"] == ["eomcheck", "pinocchio"]
    assert np.array(written["apart"]["M"]).shape == (2, 2)
    assert [one["verdict"] for one in written["findings"]].count("failed") == code


def test_a_file_that_is_not_there_is_one_sentence(tmp_path: Path):
    ran = CliRunner().invoke(app, ["compare", str(tmp_path / "none.urdf")])
    assert isinstance(ran.exception, InputError)
    assert "none.urdf' cannot be read" in str(ran.exception)


def test_what_was_found_is_written_and_printed_of_a_library_that_gave_no_answer(tmp_path, capsys):
    scene = from_urdf(arm(tmp_path / "arm.urdf"))
    found = compare(scene, ["pinocchio"], states=1)
    found.refused["other"] = "cannot"
    write_comparison(found, tmp_path / "out.json")
    assert json.loads((tmp_path / "out.json").read_text())["refused"] == {"other": "cannot"}
    print_comparison(found)
    assert "other gave no answer: cannot" in capsys.readouterr().out
