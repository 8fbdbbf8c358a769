"""The library of a robot's file takes part in a validation, and reads the file itself."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from tests.robots import arm
from tests.scenes.mjcf_texts import mjcf_text
from typer.testing import CliRunner

from eomcheck import check_state, validate
from eomcheck.claims.finding import Finding
from eomcheck.claims.run import RunSelection, ValidationRun
from eomcheck.cli import app
from eomcheck.descriptions.mechanism_class import Mechanism
from eomcheck.descriptions.random_trees import COMMON_JOINTS, urdf_tree
from eomcheck.descriptions.urdf_reader import urdf_text
from eomcheck.engines import MjcfFile, PinocchioFile
from eomcheck.engines.tree_engine import SUFFIXES
from eomcheck.mechanics.scene import GeneratorChoices
from eomcheck.scenes import Snake, from_mjcf, from_urdf

TERMS = ("mass-matrix", "bias", "generalized-forces")
ASKED = (*TERMS, "engine-acceleration")
NUMBERS = re.compile(r": (?P<library>\S+) by the library, (?P<eomcheck>\S+) by eomcheck;")
FEATURES = ["hinge", "slide", "ball", "free", "springref", "damping", "armature", "polycoef"]


def by_reader(scene: Mechanism, claims: tuple[str, ...] = ASKED) -> list[Finding]:
    """Return the findings by the library of the file, in two states."""
    found = validate(scene, examples=1, formulations=["gw"], claims=claims)
    return [one for one in found if one.subject.endswith(tuple(SUFFIXES.values()))]


def told(findings: list[Finding]) -> set[tuple[str, str]]:
    return {(one.claim, one.verdict) for one in findings}


@pytest.mark.night
def test_pinocchio_reads_a_urdf_unless_engines_are_named(tmp_path: Path):
    scene = from_urdf(arm(tmp_path / "arm.urdf"))
    assert told(by_reader(scene)) == {(one, "passed") for one in ASKED}
    assert {one.evidence.split()[1] for one in by_reader(scene)} == {"pinocchio"}
    named = validate(scene, examples=1, engines=["casadi"], formulations=["gw"], claims=TERMS)
    assert not [one for one in named if one.subject.endswith(tuple(SUFFIXES.values()))]
    q, v = scene.initial_state()
    assert "pinocchio_file" in {one.subject for one in check_state(scene, q, v)}


def test_mujoco_reads_an_mjcf_unless_engines_are_named(tmp_path: Path):
    pytest.importorskip("mujoco")
    path = tmp_path / "robot.xml"
    path.write_text(mjcf_text(np.random.default_rng(3), 4), encoding="utf-8")
    found = by_reader(from_mjcf(path))
    assert told(found) == {(one, "passed") for one in ASKED}
    assert {one.evidence.split()[1] for one in found} == {"mujoco"}


def test_no_library_reads_what_is_no_file_or_has_other_parameters(tmp_path: Path):
    kind = type(from_urdf(arm(tmp_path / "arm.urdf")))
    assert RunSelection.of(scenes=[kind]).reader is PinocchioFile
    assert RunSelection.of(scenes=[Snake]).reader is None
    assert RunSelection.of(engines=["casadi"], scenes=[kind]).reader is None
    run = ValidationRun()
    run.validate_kind(kind, RunSelection.of(["gw"], None, TERMS, scenes=[kind]), (1, 1), 4, 0)
    subjects = [one for one in run.findings if one.subject == "pinocchio_file"]
    assert {one.verdict for one in subjects} == {"passed"}
    assert all(one.scene.as_described for one in subjects)


@pytest.mark.parametrize("change", ["mass", "axis"])
def test_a_file_that_is_misread_fails_by_its_library_alone_and_nobody_is_blamed(
    tmp_path: Path, change: str
):
    scene = from_urdf(arm(tmp_path / "arm.urdf"))
    text = Path(scene.source.file).read_text(encoding="utf-8")
    old, new = {
        "mass": ('mass value="2.5"', 'mass value="2.75"'),
        "axis": ("0.6 0 0.8", "-0.6 0 0.8"),
    }[change]
    Path(scene.source.file).write_text(text.replace(old, new), encoding="utf-8")
    found = validate(scene, examples=3, formulations=["gw"])
    failed = [one for one in found if one.verdict == "failed"]
    assert {one.engine for one in failed} == {PinocchioFile}
    assert "mass-matrix" in {one.claim for one in failed}
    either = "the file is read in two ways: either reading may be wrong"
    assert all(one.detail.endswith(either) for one in failed)
    if change == "mass":
        numbers = [NUMBERS.search(one.detail) for one in failed if one.claim == "mass-matrix"]
        assert all(float(x["library"]) > float(x["eomcheck"]) for x in numbers if x)
        assert all(numbers)


def test_dampers_that_pinocchio_leaves_out_are_skipped_with_the_reason(tmp_path: Path):
    found = by_reader(from_urdf(arm(tmp_path / "arm.urdf", damping="0.4")))
    assert told(found) >= {(one, "passed") for one in TERMS}
    assert "failed" not in {one.verdict for one in found}
    (skipped,) = {one.detail for one in found if one.verdict == "skipped"}
    assert skipped == "its accelerations leave out the damping of slide"


def test_an_inertial_that_urdfdom_drops_is_skipped_with_its_message(tmp_path: Path):
    path = arm(tmp_path / "arm.urdf")
    text = path.read_text(encoding="utf-8").replace('mass value="2.5"', 'mass value="2.5\n"')
    path.write_text(text, encoding="utf-8")
    found = by_reader(from_urdf(path))
    assert ("mass-matrix", "skipped") in told(found)
    assert "failed" not in {one.verdict for one in found}
    skipped = {one.detail for one in found if one.claim == "mass-matrix"}
    assert all(x.startswith("while it read the file it wrote 'Error") for x in skipped)
    assert all("mass [2.5" in one for one in skipped)


@pytest.mark.night
def test_a_library_that_cannot_read_a_file_is_skipped_with_the_reason(tmp_path, monkeypatch):
    def refuse(*_) -> None:
        raise ValueError("no such\n  element")

    path = arm(tmp_path / "arm.urdf")
    monkeypatch.setattr(PinocchioFile, "_read", refuse)
    (found,) = by_reader(from_urdf(path))
    assert (found.claim, found.verdict) == ("mass-matrix", "skipped")
    assert found.detail == "takes no part: no such element"
    outcome = CliRunner().invoke(app, ["validate", "--scene", str(path), "--examples", "1"])
    assert outcome.exit_code == 0, outcome.output
    assert "(reads the file itself)" in outcome.output


def test_a_joint_with_several_coordinates_is_skipped_with_the_reason(tmp_path: Path):
    path = arm(tmp_path / "arm.urdf")
    text = path.read_text(encoding="utf-8").replace('type="continuous"', 'type="spherical"')
    path.write_text(text, encoding="utf-8")
    (found,) = by_reader(from_urdf(path))
    assert found.verdict == "skipped"
    assert found.detail == "takes no part: pinocchio_file cannot represent arm by its file"


# ---- Random robots -------------------------------------------------------------------------------


@pytest.mark.night
def test_random_urdfs_are_read_as_pinocchio_reads_them(tmp_path: Path):
    choices, path = GeneratorChoices(np.random.default_rng(5)), tmp_path / "robot.urdf"
    claims = set()
    for number in range(12):
        tree = urdf_tree(1 + number % 5, choices, COMMON_JOINTS)
        path.write_text(urdf_text(tree), encoding="utf-8")
        found = by_reader(from_urdf(path))
        assert [str(one) for one in found if one.verdict == "failed"] == []
        claims |= {one.claim for one in found if one.verdict == "passed"}
    assert claims == set(ASKED)


def test_random_mjcfs_are_read_as_mujoco_reads_them(tmp_path: Path):
    pytest.importorskip("mujoco")
    random, path = np.random.default_rng(6), tmp_path / "robot.xml"
    seen = set()
    for number in range(12):
        path.write_text(mjcf_text(random, 1 + number % 5), encoding="utf-8")
        found = by_reader(from_mjcf(path))
        assert {one.engine for one in found} == {MjcfFile}
        assert [str(one) for one in found if one.verdict == "failed"] == []
        assert {one.verdict for one in found if one.claim in TERMS} == {"passed"}
        text = path.read_text(encoding="utf-8")
        seen |= {one for one in FEATURES if one in text}
    assert seen == set(FEATURES)
