"""Environments of libraries: folders with Python, NumPy and one library in one version.

They are made once, of wheels alone, by uv or else by venv and pip, and kept in the cache folder:
`EOMCHECK_CACHE`, or `eomcheck` in `XDG_CACHE_HOME`.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from eomcheck.atomic_write import locked
from eomcheck.console import activity
from eomcheck.errors import EngineError

CACHE = "EOMCHECK_CACHE"
"""Environment variable with the cache folder."""

READY = "ready"
"""Name of the file that shows that an environment is complete."""


def cache_folder() -> Path:
    """Return the folder of what is made once and can be made again."""
    if CACHE in os.environ:
        return Path(os.environ[CACHE])
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "eomcheck"


def environment_folder(requirement: str) -> Path:
    """Return the folder of the environment with a library, see `python_with`."""
    name = re.sub(r"[^0-9A-Za-z.]+", "-", requirement)
    return cache_folder() / "environments" / f"{name}-{sys.implementation.cache_tag}"


def python_with(requirement: str) -> Path:
    """Return the Python of an environment with a library, which is made if there is none yet.

    Args:
        requirement: name and version of the library, "mujoco==4.0.0", or another requirement of it;
            several with a space between.

    Raises:
        EngineError: it cannot be installed.
    """
    folder = environment_folder(requirement)
    executable = folder / "bin" / "python"
    if (folder / READY).exists():
        return executable
    try:
        # A lock of its own: another library may be installed meanwhile.
        lock = folder.with_name(f".{folder.name}")
        lock.mkdir(parents=True, exist_ok=True)
        with locked(lock / READY), activity(f"installing {requirement}"):
            if not (folder / READY).exists():
                shutil.rmtree(folder, ignore_errors=True)
                _install(requirement, folder, executable)
                (folder / READY).write_text(requirement, encoding="utf-8")
    except OSError as error:
        what = f"{requirement} cannot be installed in {str(folder)!r}: {error.strerror or error}"
        raise EngineError(what) from None
    return executable


def _install(requirement: str, folder: Path, executable: Path) -> None:
    """Make an environment with a library and NumPy.

    Raises:
        EngineError: it fails.
    """
    wheels = ["--only-binary", ":all:", "numpy", *requirement.split()]
    if uv := shutil.which("uv"):
        commands = [
            [uv, "venv", "--python", sys.executable, str(folder)],
            [uv, "pip", "install", "--python", str(executable), *wheels],
        ]
    else:
        quiet = ["--quiet", "--disable-pip-version-check"]
        commands = [
            [sys.executable, "-m", "venv", str(folder)],
            [str(executable), "-m", "pip", "install", *quiet, *wheels],
        ]
    for command in commands:
        run = subprocess.run(command, capture_output=True, text=True, errors="replace")
        if run.returncode:
            raise EngineError(f"{requirement} cannot be installed: {_reason(run.stderr)}")


def _reason(output: str) -> str:
    """Return the line of an installer's output that names the reason."""
    lines = [re.sub(r"^\W+", "", line).strip() for line in output.splitlines() if line.strip()]
    errors = [line for line in lines if re.match("error", line, re.IGNORECASE)]
    last = (errors or lines or ["no reason given"])[-1]
    return re.sub(r"^error\W*", "", last, flags=re.IGNORECASE)
