"""Robot files of packages: found without imports, counted once, refused by a reason with a kind."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from tests import choose_robots, robots

from eomcheck.errors import InputError
from eomcheck.lab.show.table import ResultTable
from eomcheck.lab.store.record_file import Record
from eomcheck.lab.studies import robot_files, study_of
from eomcheck.lab.studies.robot_files import REASONS, kind_of_reason
from eomcheck.lab.studies.robots import ROBOTS, RobotFile

PENDULUM = """<mujoco><worldbody><body name="{name}"><joint name="{name}" axis="0 1 0"/>
<geom type="sphere" size="0.1" pos="0 0 -1"/></body></worldbody></mujoco>"""


@pytest.fixture
def package(tmp_path: Path, monkeypatch) -> Path:
    """Return the folder of an installed package `models`, which raises where it is imported."""
    folder = tmp_path / "site" / "models"
    folder.mkdir(parents=True)
    arm = robots.arm(folder / "arm.urdf")
    shutil.copy(arm, folder / "copy.urdf")
    renamed = arm.read_text(encoding="utf-8").replace('"shoulder"', '"first"')
    (folder / "renamed.urdf").write_text(renamed, encoding="utf-8")
    heavier = arm.read_text(encoding="utf-8").replace('mass value="2.5"', 'mass value="2.75"')
    assert heavier != arm.read_text(encoding="utf-8")
    (folder / "heavier.urdf").write_text(heavier, encoding="utf-8")
    contents = {
        "__init__.py": "raise RuntimeError('imported')",
        "box.urdf": '<robot name="box"><link name="box"/></robot>',
        "ball.urdf": '<robot name="ball"><link name="ball"><inertial><mass value="1"/><inertia '
        'ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>',
        "odd.urdf": '<robot name="odd"><link name="a"/><loop/></robot>',
        "numbers.urdf": arm.read_text(encoding="utf-8").replace('value="', 'value="x'),
        "pendulum.xml": PENDULUM.format(name="bob"),
        "parts.xml": "<mujocoinclude><default/></mujocoinclude>",
        "menu.xml": "<menu/>",
        "reader.xml": '<mujoco><include file="missing.xml"/></mujoco>',
        "broken.xml": "<mujoco><option colour='blue'/></mujoco>",
        "notes.txt": "no robot",
    }
    for name, text in contents.items():
        (folder / name).write_text(text, encoding="utf-8")
    info = folder.parent / "models-1.5.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: models\nVersion: 1.5\n")
    names = "".join(f"models/{path.name},,\n" for path in sorted(folder.iterdir()))
    (info / "RECORD").write_text(names)
    monkeypatch.syspath_prepend(str(folder.parent))
    return folder


def counts_of(table: ResultTable) -> dict[str, str]:
    """Return the counts of the first package by column."""
    return dict(zip(table.columns, table.rows[0], strict=True))


def records_of_package() -> list[Record]:
    """Return the Records of the files of `models`, read in this process."""
    study = study_of("robot-files")
    return [study.worker([])(settings) for settings in study.cells(package=["models"])]


def test_every_robot_file_of_a_package_is_read_or_refused_by_a_kind_of_reason(package: Path):
    records = records_of_package()
    (table,) = study_of("robot-files").tables(records)
    assert counts_of(table) == {
        "package": "models 1.5",
        "files": "13",
        "read": "6",
        "set free": "1",
        "distinct": "4",
        "part of other files": "1",
        "nothing moves": "1",
        "several models": "",
        "no robot description": "1",
        "a file that it names is missing": "1",
        "not described here": "1",
        "refused by MuJoCo": "1",
        "invalid number or element": "1",
    }
    assert set(REASONS) <= set(table.columns)
    assert "'not described here': 1 of 10 robot files, 10.0 %." in table.note
    assert list(table.rows[1][1:]) == list(table.rows[0][1:]), "the sum of one package"
    for record in records:
        assert (record.status == "done") == (not record.reason)
        assert str(package) not in record.reason, "a reason names the file, not the machine"


def test_files_with_the_same_bodies_and_joints_are_one_robot_whatever_their_names(package: Path):
    first = robot_files.distinct_robots(records_of_package())
    names = [Path(one.settings["file"]).name for one in first]
    assert names == ["arm.urdf", "ball.urdf", "heavier.urdf", "pendulum.xml"]
    assert [one.counts["coordinates"] for one in first] == [3, 6, 3, 1]
    assert [one.counts["free"] for one in first] == [0, 1, 0, 0]


def test_the_remarks_name_the_refusals_that_are_ours_or_of_a_library_each_once(package: Path):
    records = records_of_package()
    said = list(study_of("robot-files").remarks([*records, *records]))
    assert len(said) == 3
    assert any("holds <loop>, which is no part of a URDF known here" in one for one in said)


def test_a_package_that_is_not_installed_is_named():
    with pytest.raises(InputError, match="package = 'nosuch': it is not installed"):
        list(study_of("robot-files").cells(package=["nosuch"]))
    with pytest.raises(InputError, match=r"'pluggy'.*no robot file is installed"):
        list(study_of("robot-files").cells(package=["pluggy"]))


@pytest.mark.parametrize("kind", REASONS)
def test_kinds_of_reasons_are_in_the_order_in_which_they_count(kind: str):
    sentences = {
        "part of other files": "'a' is refused by MuJoCo: Unrecognized XML model type: "
        "'mujocoinclude'",
        "nothing moves": "'a.urdf': no joint of it moves: there are no coordinates",
        "several models": "'a.sdf' has 2 models, name one of them: a.sdf:b, a.sdf:c",
        "no robot description": "'a.xml' holds <menu>, expected <mujoco>: no MJCF",
        "a file that it names is missing": "'a' is refused by MuJoCo: Error opening file 'b.stl'",
        "not described here": "'a.urdf' holds <x>, which is no part of a URDF known here",
        "refused by MuJoCo": "'a' is refused by MuJoCo: XML Error: Schema violation",
        "invalid number or element": "'a': rpy of <origin> is '1,', expected a number",
    }
    assert kind_of_reason(sentences[kind]) == kind


# ---- The list of robots --------------------------------------------------------------------------


def record(package: str, file: str, digest: str, coordinates: int = 5) -> Record:
    """Return the Record of a file that was read."""
    settings = {"package": package, "version": "1", "file": file}
    how = {"counts": {"coordinates": coordinates}, "series": {"digest": [digest]}}
    return Record("robot-files", settings, **how)


def test_one_robot_of_a_folder_is_added_that_is_new_and_not_large(monkeypatch):
    monkeypatch.setattr(choose_robots, "ROBOTS", {"old": RobotFile("one", "old/urdf/old.urdf")})
    records = [
        record("one", "share/old/urdf/old.urdf", "a"),
        record("one", "share/old/urdf/old2.urdf", "b"),
        record("one", "share/new/robots/longer_name.urdf", "c"),
        record("one", "share/new/urdf/new.urdf", "d"),
        record("one", "share/test_data/x.urdf", "e"),
        record("one", "share/large/large.urdf", "f", 40),
        record("one", "share/single/single.urdf", "g", 1),
        record("one", "share/a/a.urdf", "h"),
        record("one", "share/b/b.urdf", "i"),
        record("two", "copy/old.urdf", "a"),
        record("two", "c/c.xml", "j"),
    ]
    added = list(choose_robots.added(records))
    assert added == [
        ("one", "share/new/urdf/new.urdf"),
        ("one", "share/a/a.urdf"),
        ("two", "c/c.xml"),
    ], "three folders of one package, of which the first is known"
    more = {str(k): RobotFile(*one) for k, one in enumerate(added)}
    monkeypatch.setattr(choose_robots, "ROBOTS", choose_robots.ROBOTS | more)
    assert not list(choose_robots.added(records)), "and no more, when it is done again"


@pytest.mark.parametrize(
    ("file", "name"),
    [
        ("share/a1_description/urdf/a1.urdf", "a1"),
        ("share/ur_description/urdf/ur5_robot.urdf", "ur5-models"),
        ("pybullet_data/kuka_iiwa/model.urdf", "kuka-iiwa"),
        ("fourier_robot_descriptions/assets/Left__Hand.v1.urdf", "left-hand-v1"),
    ],
)
def test_a_robot_is_named_by_its_file_or_its_folder(file: str, name: str):
    assert choose_robots.name_of("models", file, ["ur5"]) == name


def test_the_list_is_as_it_would_be_written_and_each_of_it_names_its_file():
    text = choose_robots.text_of(ROBOTS)
    assert text == choose_robots.ROBOTS_FILE.read_text(encoding="utf-8")
    assert {one.package for one in ROBOTS.values()} <= set(robot_files.PACKAGES)
    assert len(ROBOTS) >= 30 and len(set(ROBOTS.values())) == len(ROBOTS)
