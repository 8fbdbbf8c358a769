"""Scripts of docs/conformance, each in an environment with NumPy and its library, without eomcheck.

    python -m tests.conformance_scripts [SCRIPT ...] [--versions 1.7.0,1.8.0 | --since]

The environment is that of `--isolated`: Genesis needs PyTorch beside it. The name of a script
begins with the extra of its library, or with the key of the engine of one that comes with eomcheck.
Its output is printed. A library that cannot be installed is named with the reason; the exit code is
1 if a script fails or writes nothing, or if none runs. With versions each script runs in all of
these, oldest first.

`--since` dates the deviation that a script shows: a bisection over the versions of its index
finds the least one in which the script prints the same as in the newest, numbers to `DIGITS`
digits. It is the `since` of `deviations.toml`. A version that cannot be installed, or in which the
script fails with the newest NumPy and with that of before 2, counts as one that does not show it,
and the reason is printed.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from eomcheck.engines import LIBRARIES
from eomcheck.engines.environments import python_with
from eomcheck.engines.tree_engine import TreeEngine, library_key
from eomcheck.errors import EngineError

FOLDER = Path(__file__).parents[1] / "docs" / "conformance"

PATIENCE = 600.0
"""Seconds that a script may take: some libraries compile first."""


ALONE = """import os, runpy, sys
own = os.fdopen(os.dup(1), "w", buffering=1)
os.dup2(2, 1)
runpy.run_path(sys.argv[1], {"print": lambda *x, **more: print(*x, file=own, **more)}, "__main__")
"""
"""Program that runs a script with the output of all but its own `print` turned to stderr."""

SOURCE_ONLY = {"genesis": "pygltflib", "jaxsim": "pptree"}
"""Library -> package that it needs and that its index has as source alone, without a wheel. It is
pure Python, and the `pip install` of a user builds it; eomcheck itself installs wheels alone."""

OLDER_NUMPY = "numpy<2"
"""Requirement of libraries that were compiled for it."""

DIGITS = 3
"""Significant digits in which numbers of two outputs are compared."""


def scripts_of(library: str) -> list[Path]:
    """Return the scripts about a library, see `library_of`."""
    return [path for path in sorted(FOLDER.glob("*.py")) if library_of(path) == library]


def adapters() -> dict[str, type[TreeEngine]]:
    """Return library -> an engine of it: its extra, or its key if it comes with eomcheck."""
    engines = [kind for kind in LIBRARIES.values() if issubclass(kind, TreeEngine)]
    return {kind.extra or library_key(kind): kind for kind in reversed(engines)}


def library_of(script: Path) -> str:
    """Return the library that a script is about, the longest name that begins that of the script.

    Raises:
        ValueError: none does.
    """
    own = [x for x in adapters() if script.stem.startswith(f"{x.replace('-', '_')}_")]
    if not own:
        raise ValueError(f"{script.name} begins with no library")
    return max(own, key=len)


def adapter_of(script: Path) -> type[TreeEngine]:
    """Return an engine of the library that a script is about."""
    return adapters()[library_of(script)]


def run(
    script: Path, version: str = "", *, alone: bool = False, beside: str = ""
) -> tuple[bool, str]:
    """Return whether a script ends well and writes something, and its output.

    Args:
        script: the script.
        version: version of the library; "" for the newest that the adapter supports.
        alone: whether the output has what the script prints alone, without messages of the library.
        beside: another requirement of the environment, numpy of some versions.

    Raises:
        EngineError: the library cannot be installed.
    """
    needed = [*adapter_of(script).requirements(version), *beside.split()]
    if package := SOURCE_ONLY.get(library_of(script)):
        needed.append(f"--no-binary={package}")
    python = python_with(" ".join(needed))
    hidden = {"PYTHONPATH", "VIRTUAL_ENV"}
    environment = {key: value for key, value in os.environ.items() if key not in hidden}
    with tempfile.TemporaryDirectory() as folder:
        try:
            end = subprocess.run(
                [str(python), *(("-c", ALONE) if alone else ()), str(script)],
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


# ---- Dates ---------------------------------------------------------------------------------------


def versions_of(distribution: str) -> list[str]:
    """Return the versions of a distribution that an index lists for this Python, oldest first.

    Raises:
        EngineError: there is none, or no index answers.
    """
    asked = [sys.executable, "-m", "pip", "index", "versions", distribution]
    end = subprocess.run(
        [*asked, "--only-binary", ":all:"], capture_output=True, text=True, errors="replace"
    )
    match = re.search(r"^Available versions: (.+)$", end.stdout, re.MULTILINE)
    if end.returncode or match is None:
        last = (end.stderr.strip().splitlines() or ["no versions"])[-1]
        raise EngineError(f"versions of {distribution}: {last}")
    return match[1].split(", ")[::-1]


def rounded(output: str) -> list[str]:
    """Return the lines of an output, its numbers rounded to `DIGITS` digits.

    >>> rounded("M = 4.0000001 m,  expected 4")
    ['M = 4 m, expected 4']
    """
    number = r"(?<![\w.])-?\d+\.?\d*(?:e[+-]?\d+)?"
    text = re.sub(number, lambda match: f"{float(match[0]):.{DIGITS}g}", output)
    return [" ".join(line.split()) for line in text.splitlines()]


def least_version(versions: Sequence[str], shows: Callable[[str], bool]) -> tuple[str, str]:
    """Return the least version that shows a deviation, by bisection, and the one before.

    Args:
        versions: oldest first; the last one shows it.
        shows: function that tells whether a version shows it.

    Returns:
        The version, and the one before it, which does not show it; "" if none is older.
    """
    before, least = -1, len(versions) - 1
    while least - before > 1:
        middle = (before + least) // 2
        before, least = (before, middle) if shows(versions[middle]) else (middle, least)
    return versions[least], versions[before] if before >= 0 else ""


def output_in(script: Path, version: str) -> tuple[bool, str]:
    """Return whether a script ends well in a version, and what it prints, or its last line."""
    output = ""
    for numpy in ("", OLDER_NUMPY):
        try:
            right, output = run(script, version, alone=True, beside=numpy)
        except EngineError as error:
            return False, f"left out: {error}"
        if right:
            return True, output.strip()
    return False, "fails: " + " ".join(output.strip().splitlines()[-2:])


def since(script: Path) -> tuple[bool, str]:
    """Return whether a deviation could be dated, and the sentences about it.

    Raises:
        EngineError: no index knows the versions of the library.
    """
    versions = versions_of(adapter_of(script).distribution())
    outputs = {versions[-1]: output_in(script, versions[-1])}
    right, newest = outputs[versions[-1]]
    if not right:
        return False, f"{versions[-1]} {newest}"

    def shows(version: str) -> bool:
        outputs[version] = output_in(script, version)
        return rounded(outputs[version][1]) == rounded(newest)

    least, before = least_version(versions, shows)
    older = f"{before} {outputs[before][1]}" if before else "no version is older"
    of = f"{len(versions)} versions from {versions[0]} to {versions[-1]}"
    return True, f"since {least}; asked {', '.join(outputs)} of {of}\n{older}"


def main() -> int:
    """Run scripts, print what they write, and return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("scripts", nargs="*")
    parser.add_argument("--versions", default="")
    parser.add_argument("--since", action="store_true")
    options = parser.parse_args()
    scripts = [FOLDER / name for name in options.scripts] or sorted(FOLDER.glob("*.py"))
    ends = []
    for script in scripts:
        for version in options.versions.split(","):
            try:
                right, output = since(script) if options.since else run(script, version)
                ends.append(right)
            except EngineError as error:
                output = f"left out: {error}"
            print(f"--- {script.name} {version}\n{output.strip()}", flush=True)
    return 0 if ends and all(ends) else 1


if __name__ == "__main__":
    sys.exit(main())
