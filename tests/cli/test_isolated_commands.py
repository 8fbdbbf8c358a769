"""Commands with libraries in processes of their own, each of which fails in another way.

The environments are stubs, so that nothing is installed: their Python is that of the tests.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from tests import robots
from tests.engines import failing_library

from eomcheck.engines import environments, isolation

FAILING = {
    "SegfaultingFile": "ended its process by SIGSEGV",
    "ExitingFile": "ended its process with exit code 0",
    "BabblingFile": "answered no message",
    "SleepingFile": "gave no answer in",
    "UndefinedFile": "returned nan in entry",
}
"""Class of `failing_library` -> what is said of its bias."""


@pytest.fixture
def stubs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Make the environments of failing libraries; return the file with the ids of processes."""
    cache, pids = tmp_path / "cache", tmp_path / "pids"
    monkeypatch.setenv(environments.CACHE, str(cache))
    for name in FAILING:
        process = isolation.isolated(getattr(failing_library, name)).process  # type: ignore
        python = environments.environment_folder(process.requirement) / "bin" / "python"
        python.parent.mkdir(parents=True, exist_ok=True)
        python.write_text(f'#!/bin/sh\necho $$ >> {pids}\nexec {sys.executable} "$@"\n')
        python.chmod(0o755)
        python.parent.parent.joinpath(environments.READY).touch()
    return pids


def run(*words: str, patience: float) -> subprocess.CompletedProcess[str]:
    """Return the end of a command."""
    command = [sys.executable, "-m", "eomcheck", *words, "--patience", f"{patience:g}"]
    return subprocess.run(command, capture_output=True, text=True, timeout=500)


def engines(*failing: str) -> list[str]:
    """Return the options --engine of failing classes, then of a library that is right."""
    file = Path(failing_library.__file__)
    names = [*(f"{file}:{name}=={isolation.ANY}" for name in failing), "pinocchio"]
    return [word for name in names for word in ("--engine", name)]


def left(pids: Path) -> list[int]:
    """Return the processes that are left after some time to end."""
    until, running = time.monotonic() + 20, [int(x) for x in pids.read_text().split()]
    assert len(running) >= len(FAILING) - 1  # each that dies is started again
    while running and time.monotonic() < until:
        running = [pid for pid in running if not failing_library.has_ended(pid)]
        time.sleep(0.05)
    return running


@pytest.mark.night
def test_compare_tells_the_fault_of_each_library_and_the_rest_of_its_table(
    stubs: Path, tmp_path: Path
):
    robot, file = robots.arm(tmp_path / "arm.urdf"), tmp_path / "compared.json"
    how = "--examples", "2", "--json", str(file)
    end = run("compare", str(robot), *engines(*FAILING), *how, patience=10)
    assert end.returncode == 1, end.stderr
    compared = json.loads(file.read_text())
    keys = [name.lower() for name in FAILING]
    assert [*compared["versions"]] == [*keys, "pinocchio"] and compared["refused"] == {}
    faults = {library: what for library, quantity, what in compared["faults"] if quantity == "bias"}
    for key, text in zip(keys, FAILING.values(), strict=True):
        assert text in faults[key], (key, faults)
        assert text in " ".join(end.stdout.split())
    assert {*faults} == {*keys}
    table = compared["apart"]["M"][0]  # what does not fail is compared with eomcheck
    assert len(table) == len(keys) + 2 and all(x is not None and x < 1e-12 for x in table)
    failed = {one["subject"] for one in compared["findings"] if one["verdict"] == "failed"}
    assert not any("pinocchio" in subject for subject in failed)
    assert left(stubs) == []


@pytest.mark.night
def test_a_study_tells_the_fault_of_each_library_and_the_rest_of_its_table(
    stubs: Path, tmp_path: Path
):
    robot, file = robots.arm(tmp_path / "arm.urdf"), tmp_path / "study.json"
    how = "--states", "2", "--json", str(file)
    words = "study", "conformance", "--robot", str(robot), *engines(*FAILING), *how
    end = run(*words, patience=10)
    assert end.returncode == 1, end.stderr
    records = json.loads(file.read_text())["records"]
    rows = [row for record in records for row in record["series"]["rows"]]
    for name, text in FAILING.items():
        mine = {one["quantity"]: one for one in rows if name in one["engine"]}
        assert mine["bias"]["fault"] and text in mine["bias"]["detail"]
        assert mine["mass_matrix"]["verdict"] == "passed"
        assert {*mine} == {one["quantity"] for one in rows if one["engine"] == "pinocchio"}
    assert not any(one["fault"] for one in rows if one["engine"] == "pinocchio")
    assert "no answer on 1 of 1" in " ".join(end.stdout.split())
    assert left(stubs) == []


@pytest.mark.sampled(2)
@pytest.mark.parametrize("command", ["compare", "study", "validate", "fuzz"])
def test_a_library_that_cannot_be_installed_is_one_sentence(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """As offline, or where a library has no wheels: `uv` stands for both."""
    robot = str(robots.arm(tmp_path / "arm.urdf"))
    uv = tmp_path / "bin" / "uv"
    uv.parent.mkdir()
    uv.write_text("#!/bin/sh\necho 'error: No solution found: no wheels of mujoco' >&2\nexit 1\n")
    uv.chmod(0o755)
    monkeypatch.setenv("PATH", str(uv.parent), prepend=os.pathsep)
    monkeypatch.setenv(environments.CACHE, str(tmp_path / "cache"))
    words = {
        "compare": ("compare", robot),
        "study": ("study", "conformance", "--robot", robot),
        "validate": ("validate", "--scene", "sleigh", "--examples", "1"),
        "fuzz": ("fuzz", "--scene", "sleigh", "--examples", "1"),
    }[command]
    end = run(*words, "--engine", "mujoco", "--isolated", patience=60)
    assert end.returncode == 2 and "Traceback" not in end.stderr
    (line,) = [one for one in end.stderr.splitlines() if "cannot be installed" in one]
    assert line.startswith("eomcheck: mujoco>=") and line.endswith("no wheels of mujoco")
