"""Pairs of files of one robot in two packages."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.lab.test_recorded_answers import arm_text

from eomcheck.errors import EngineError, UnknownNameError
from eomcheck.lab.studies import robot_pairs, study_of
from eomcheck.lab.studies.robot_pairs import PAIRS
from eomcheck.lab.studies.robots import RobotFile


@pytest.fixture
def arms(tmp_path: Path, monkeypatch) -> Path:
    """Return the folder with two arms, the files of the pair "ur5"."""
    text = arm_text()
    (tmp_path / "ur5_robot.urdf").write_text(text)
    (tmp_path / "robot.xml").with_suffix(".urdf").write_text(
        text.replace('<mass value="2.6"/>', '<mass value="2.5"/>')
    )

    def file(name: str, robot: RobotFile) -> Path:
        if robot.package != "example-robot-data":
            return (tmp_path / Path(robot.file).name).with_suffix(".urdf")
        return tmp_path / Path(robot.file).name

    monkeypatch.setattr(robot_pairs, "packaged_file", file)
    return tmp_path


def test_a_pair_is_compared_and_counted(arms: Path):
    study = study_of("robot-pairs")
    (settings,) = study.cells(pair=["ur5"], states=2)
    record = study.worker([])(settings)
    assert record.counts == {"joints": 6, "differences": 1}
    assert set(record.errors) == {"M", "gravity", "acceleration"}
    (table,) = study.tables([record])
    name, packages, joints, differences, *effects = map(str, table.rows[0])
    assert (name, packages, joints) == ("ur5", "example-robot-data, robosuite", "6")
    assert differences == "1 mass"
    assert all(float(x) > 0 for x in effects)
    (remark,) = study.remarks([record])
    assert remark == "ur5: body of j1 (link1): mass: 2.6 kg, 2.5 kg"


def test_the_same_robot_is_said_to_be_the_same(arms: Path):
    (arms / "robot.urdf").write_text(arm_text())
    study = study_of("robot-pairs")
    (settings,) = study.cells(pair=["ur5"], states=1)
    (table,) = study.tables([study.worker([])(settings)])
    assert str(table.rows[0][3]) == "the same"


def test_a_pair_without_its_package_is_refused_and_an_unknown_one_is_named(monkeypatch):
    def missing(name: str, robot: RobotFile) -> Path:
        raise EngineError(f"{name} comes with {robot.package}, which is not installed")

    monkeypatch.setattr(robot_pairs, "packaged_file", missing)
    study = study_of("robot-pairs")
    record = study.worker([])({"pair": "ur5", "states": 1})
    assert (record.status, next(iter(study.tables([record]))).rows) == ("refused", [])
    assert "not installed" in next(iter(study.remarks([record])))
    with pytest.raises(UnknownNameError, match="ur6"):
        list(study.cells(pair=["ur6"]))


def test_there_are_20_pairs_of_different_packages():
    assert len(PAIRS) >= 20
    for pair in PAIRS.values():
        assert pair.first.package != pair.second.package
        assert pair.first.file.endswith(".urdf") and pair.second.file.endswith(".xml")
