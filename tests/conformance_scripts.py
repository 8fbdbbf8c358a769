"""Scripts of docs/conformance, each in an environment with NumPy and its library alone.

    python -m tests.conformance_scripts [SCRIPT ...] [--versions 1.7.0,1.8.0]

The name of a script begins with the extra of its library. What it writes is printed; the exit code
is 1 if one fails or writes nothing. With versions each script runs in all of these, oldest first,
which dates a deviation.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from eomcheck.engines import LIBRARIES
from eomcheck.engines.environments import python_with
from eomcheck.engines.tree_engine import TreeEngine
from eomcheck.errors import EngineError

FOLDER = Path(__file__).parents[1] / "docs" / "conformance"

PATIENCE = 600.0
"""Seconds that a script may take: some libraries compile first."""


def scripts_of(extra: str) -> list[Path]:
    """Return the scripts about the library of an extra."""
    return [path for path in sorted(FOLDER.glob("*.py")) if library_of(path) == extra]


def library_of(script: Path) -> str:
    """Return the extra of the library that a script is about, the longest that begins its name.

    Raises:
        ValueError: no extra does.
    """
    extras = {kind.extra for kind in LIBRARIES.values() if kind.extra}
    own = [x for x in extras if script.stem.startswith(f"{x.replace('-', '_')}_")]
    if not own:
        raise ValueError(f"{script.name} begins with no extra of a library")
    return max(own, key=len)


def run(script: Path, version: str = "") -> tuple[bool, str]:
    """Return whether a script ends well and writes something, and its output.

    Args:
        script: the script.
        version: version of the library; "" for the newest that the adapter supports.

    Raises:
        EngineError: the library cannot be installed.
    """
    extra = library_of(script)
    kind = next(kind for kind in LIBRARIES.values() if kind.extra == extra)
    assert issubclass(kind, TreeEngine)
    python = python_with(kind.requirements(version)[0])
    hidden = {"PYTHONPATH", "VIRTUAL_ENV"}
    environment = {key: value for key, value in os.environ.items() if key not in hidden}
    with tempfile.TemporaryDirectory() as folder:
        try:
            end = subprocess.run(
                [str(python), str(script)],
                cwd=folder,
                env=environment,
                capture_output=True,
                text=True,
                errors="replace",
                timeout=PATIENCE,
            )
        except subprocess.TimeoutExpired:
            return False, f"no end after {PATIENCE:g} s"
    if end.returncode:
        return False, f"{end.stdout}{end.stderr}exit code {end.returncode}"
    return bool(end.stdout.strip()), end.stdout or "wrote nothing"


def main() -> int:
    """Run scripts, print what they write, and return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("scripts", nargs="*")
    parser.add_argument("--versions", default="")
    options = parser.parse_args()
    scripts = [FOLDER / name for name in options.scripts] or sorted(FOLDER.glob("*.py"))
    good = True
    for script in scripts:
        for version in options.versions.split(","):
            try:
                right, output = run(script, version)
            except EngineError as error:
                right, output = bool(version), f"left out: {error}"
            good = good and right
            print(f"--- {script.name} {version}\n{output.strip()}", flush=True)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
