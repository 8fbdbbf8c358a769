"""Every library of the registry: its classes keep the contract, and it agrees by its key."""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from tests import conformance_scripts, libraries, robots
from tests.samples import random_state

import eomcheck
from eomcheck import engines
from eomcheck.engines import (
    BY_FORMAT,
    COMPARED,
    ENGINES,
    LIBRARIES,
    ON_REQUEST,
    READERS,
    asked_by_default,
    checked_engine,
    engine_of,
    installed_version,
    is_under_test,
    least_version,
    version_of,
)
from eomcheck.engines.tree_engine import TreeEngine, library_key
from eomcheck.lab.fuzzing.screening import keys_in_subject
from eomcheck.lab.library_comparison import AGREES, compare_libraries
from eomcheck.scenes import ChainPendulum, from_mjcf, from_sdf, from_urdf

ASKED = asked_by_default(LIBRARIES)
READING = [(format, key) for format, kinds in BY_FORMAT.items() for key in kinds]
EVERY = [*ENGINES.values(), *(BY_FORMAT[format][key] for format, key in READING)]
PROJECT = tomllib.loads(Path(__file__).parents[2].joinpath("pyproject.toml").read_text())
EXTRAS = PROJECT["project"]["optional-dependencies"]


def asked(key: str, *more: str):
    """Return a case of a library; where it is asked on request only, it is left for the night."""
    marks = [] if key in ASKED else [pytest.mark.night]
    return pytest.param(*more, key, marks=marks, id="-".join((*more, key)))


# ---- Classes -------------------------------------------------------------------------------------


def test_every_class_of_every_file_has_a_key_of_its_own_and_keeps_the_contract():
    classes = [kind for file in (*COMPARED, *ON_REQUEST) for kind in engines._adapters(file)]
    assert sorted(kind.key for kind in classes) == sorted(kind.key for kind in EVERY)
    assert {*map(checked_engine, classes)} == {*EVERY}
    assert len({kind.key for kind in classes}) == len(classes)
    assert {library_key(kind) for kind in classes} == {*LIBRARIES}
    for kind in classes:
        assert (kind.__doc__ or "").strip() and kind.__doc__ != kind.__mro__[1].__doc__, kind
        assert installed_version(kind) == "" or installed_version(kind)[-1].isdigit()
        assert least_version(kind)[:1].isdigit(), f"{kind.key}: `oldest` says no version"


def test_a_key_finds_the_class_that_builds_models_and_else_the_one_that_reads_files():
    for key, kind in LIBRARIES.items():
        assert engine_of(key) is kind and key == library_key(kind)
        assert kind is ENGINES.get(key, READERS.get(key, BY_FORMAT["mjcf"].get(key)))
    assert not [key for key in ENGINES if is_under_test(ENGINES[key])]


def test_the_libraries_on_request_are_asked_by_no_default():
    seven = ["pinocchio", "casadi", "mujoco", "drake", "exudyn", "idyntree", "pybullet"]
    assert [*ASKED] == seven == [*asked_by_default(ENGINES)]
    assert [*asked_by_default(BY_FORMAT["mjcf"])] == ["mujoco"]
    assert {"mjx", "mjx64"} <= {*LIBRARIES} - {*ASKED}


def test_a_library_on_request_has_an_extra_of_its_own_with_its_least_version():
    for kind in EVERY:
        if library_key(kind) in ASKED:
            continue
        assert kind.extra in EXTRAS, f"pyproject.toml has no extra {kind.extra!r}"
        assert issubclass(kind, TreeEngine)
        wanted = f"{kind.distribution()}>={kind.oldest}"
        assert wanted in EXTRAS[kind.extra], f"the extra {kind.extra} does not have {wanted}"
        assert not {*EXTRAS[kind.extra]} - {*EXTRAS["mujoco"]} & {*EXTRAS["engines"]}


def test_an_engine_with_64_in_its_key_is_that_of_float32_in_float64():
    for key in [key for key in LIBRARIES if key.endswith("64")]:
        ours, theirs = LIBRARIES[key], LIBRARIES[key.removesuffix("64")]
        assert (ours.unit_roundoff, theirs.unit_roundoff) == (2.0**-53, 2.0**-24)
        assert issubclass(ours, theirs) and ours.extra == theirs.extra


# ---- Answers -------------------------------------------------------------------------------------


@pytest.mark.parametrize("key", [asked(key) for key in ENGINES])
def test_a_library_agrees_on_a_pendulum_by_its_key(key: str):
    scene = ChainPendulum.example()
    version_of(ENGINES[key])
    findings = eomcheck.check_state(
        scene, *random_state(scene, np.random.default_rng(0)), engines=[key]
    )
    own = [one for one in findings if keys_in_subject(one.subject, [key])]
    assert [str(one) for one in own if one.verdict == "failed"] == []
    assert {"mass-matrix", "bias"} <= {one.claim for one in own if one.verdict == "passed"}


ARM = """
<mujoco><worldbody><body><joint name="turn" axis="0 1 0"/><geom size="0.1" pos="0.3 0 0"/>
<body pos="0.5 0 0"><joint name="slide" type="slide" axis="1 0 0"/><geom size="0.2"/></body>
</body></worldbody></mujoco>
"""


DIFFERS = {
    ("urdf", "roboticstoolbox"): "an axis that is not along x, y or z",
    ("mjcf", "dart"): "moments of inertia",
}
"""Format and key -> what the library reads wrong in the robot."""


@pytest.mark.parametrize(("format", "key"), [asked(key, format) for format, key in READING])
def test_a_library_reads_a_robot_by_its_key(format: str, key: str, tmp_path: Path):
    version_of(BY_FORMAT[format][key])
    file = tmp_path / "arm.xml"
    file.write_text(ARM)
    read = {
        "mjcf": lambda: from_mjcf(file),
        "sdf": lambda: from_sdf(Path(__file__).parents[2] / "docs" / "guides" / "crane.sdf"),
        "urdf": lambda: from_urdf(robots.arm(tmp_path / "arm.urdf")),
    }
    scene = read[format]()
    comparison = compare_libraries(scene, [key], states=2, claims=["mass-matrix", "bias"])
    verdicts = ["differs"] if (format, key) in DIFFERS else [*AGREES, "fewer digits"]
    assert comparison.libraries[key].verdict in verdicts, comparison.readings("")


# ---- At night ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("code", "error", "compared", "right", "sentence"),
    [
        (0, "", ["mjx", "mjx64==*"], True, "as known"),
        (1, "", ["mjx", "mjx64==*"], False, "not as known"),
        (0, "", ["mjx"], False, "nothing was compared of mjx64"),
        (2, "eomcheck: x cannot be installed: offline", [], True, "left out: eomcheck: x cannot"),
        (2, "eomcheck: no such robot", [], False, "exit code 2: eomcheck: no such robot"),
        (-11, "", [], False, "exit code -11"),
        (124, "", [], False, "no end after 3600 s"),
    ],
)
def test_a_library_is_left_out_only_if_it_cannot_be_installed(
    code, error, compared, right, sentence, monkeypatch
):
    def run(words, **how):
        assert {"--isolated", "mjx,mjx64", "a,b"} < {*words}
        records = [{"settings": {"engine": key}, "series": {"rows": []}} for key in compared]
        Path(words[-1]).write_text(json.dumps({"records": records}))
        return subprocess.CompletedProcess(words, code, "", error)

    monkeypatch.setattr(libraries.subprocess, "run", run)
    assert libraries.by_extra()["mjx"] == ["mjx", "mjx64"]
    assert libraries.robots_of(["mjx"]) == [*libraries.ROBOTS]
    assert libraries.robots_of(["opensim"]) == [libraries.SCENE]
    result = libraries.study(["mjx", "mjx64"], ["a", "b"], 1)
    assert result[0] is right and result[1].startswith(sentence)


# ---- Scripts -------------------------------------------------------------------------------------


def test_every_script_of_a_deviation_belongs_to_a_library():
    about = {conformance_scripts.library_of(x) for x in conformance_scripts.FOLDER.glob("*.py")}
    assert about <= {*libraries.by_extra(), "pinocchio"}
    for name, requirement in (
        ("mujoco_warp_x.py", "mujoco-warp>="),
        ("mujoco_x.py", "mujoco>="),
        ("pinocchio_x.py", "pin>="),
    ):
        kind = conformance_scripts.adapter_of(Path(name))
        assert kind.requirements()[0].startswith(requirement)
    with pytest.raises(ValueError, match="begins with no library"):
        conformance_scripts.library_of(Path("nobody.py"))
    every = [x for library in about for x in conformance_scripts.scripts_of(library)]
    assert sorted(every) == sorted(conformance_scripts.FOLDER.glob("*.py"))


@pytest.mark.parametrize(
    ("text", "right", "output"),
    [
        ("print('found')", True, "found"),
        ("", False, "wrote nothing"),
        ("print('so far'); raise SystemExit(3)", False, "so far\nexit code 3"),
        ("import eomcheck; print('found')", False, "ModuleNotFoundError"),
        ("while True: pass", False, "no end after 1 s"),
    ],
)
def test_a_script_runs_without_eomcheck_and_must_end_well_and_write(
    text, right, output, tmp_path, monkeypatch
):
    script = tmp_path / "newton_example.py"
    script.write_text(text)
    bare = tmp_path / "python"
    bare.write_text(f'#!/bin/sh\nexec {sys.executable} -S "$@"\n')
    bare.chmod(0o755)
    asked = []
    monkeypatch.setattr(conformance_scripts, "python_with", lambda x: asked.append(x) or bare)
    monkeypatch.setattr(conformance_scripts, "PATIENCE", 1.0 if "while" in text else 60.0)
    result = conformance_scripts.run(script, "1.7")
    assert result[0] is right and output in result[1] and asked == ["newton==1.7 mujoco"]


def test_what_a_library_needs_and_has_no_wheel_is_built_for_its_scripts(tmp_path, monkeypatch):
    script, asked = tmp_path / "jaxsim_example.py", []
    script.write_text("print('found')")
    monkeypatch.setattr(
        conformance_scripts, "python_with", lambda x: asked.append(x) or Path(sys.executable)
    )
    assert conformance_scripts.run(script, "0.9") == (True, "found\n")
    assert asked == ["jaxsim==0.9 --no-binary=pptree"]
    assert {*conformance_scripts.SOURCE_ONLY} <= {*conformance_scripts.adapters()}


PRINTING = """import os, sys
os.write(1, b"message\\n")
print("mass 2.00001 kg" if {version} > 13 else "mass 14 kg")
"""


@pytest.mark.parametrize(
    ("first", "sentence"),
    [
        (14, "since 1.14; asked 1.20, 1.12, 1.16, 1.14, 1.13 of 16 versions from 1.5 to 1.20\n"),
        (16, "since 1.16; asked 1.20, 1.12, 1.16, 1.14, 1.15 of 16 versions"),
    ],
)
def test_a_deviation_is_dated_by_the_least_version_with_the_output_of_the_newest(
    first, sentence, tmp_path, monkeypatch
):
    script, ran = tmp_path / "newton_example.py", []

    def python_with(requirement):
        version = int(requirement.split()[0].rpartition(".")[2])
        ran.append(requirement)
        if version < 8:
            raise conformance_scripts.EngineError("no wheel")
        if version == 15 and not requirement.endswith(" numpy<2"):
            script.write_text("raise ImportError('compiled for an older NumPy')")
        else:
            script.write_text(PRINTING.format(version=version - first + 14))
        return sys.executable

    every = [f"1.{k}" for k in range(5, 21)]
    monkeypatch.setattr(conformance_scripts, "python_with", python_with)
    monkeypatch.setattr(conformance_scripts, "versions_of", lambda name: every)
    right, output = conformance_scripts.since(script)
    assert right and output.startswith(sentence) and output.endswith("mass 14 kg")
    assert ("newton==1.15 mujoco numpy<2" in ran) == (first == 16)


def test_a_deviation_that_all_versions_show_or_that_the_newest_does_not_print_is_reported(
    monkeypatch,
):
    ends = {"1.0": (True, "a 1.0004"), "2.0": (True, "a 1"), "3.0": (False, "fails: b")}
    monkeypatch.setattr(conformance_scripts, "output_in", lambda script, version: ends[version])
    for last, right, sentence in (
        (2, True, "since 1.0; asked 2.0, 1.0 of 2 versions from 1.0 to 2.0\nno version is older"),
        (3, False, "3.0 fails: b"),
    ):
        monkeypatch.setattr(conformance_scripts, "versions_of", lambda name, n=last: [*ends][:n])
        assert conformance_scripts.since(Path("newton_x.py")) == (right, sentence)
