"""Commands with libraries in environments of their own that cannot be made."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from tests import robots

from eomcheck.engines import environments


def run(*words: str, patience: float) -> subprocess.CompletedProcess[str]:
    """Return the end of a command."""
    command = [sys.executable, "-m", "eomcheck", *words, "--patience", f"{patience:g}"]
    return subprocess.run(command, capture_output=True, text=True, timeout=500)


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
