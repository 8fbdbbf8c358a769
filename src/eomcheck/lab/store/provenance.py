"""Provenance of a result: machine, versions, digest of the sources, threads and time.

No library is imported to learn its version.
"""

from __future__ import annotations

import hashlib
import os
import platform
import subprocess
from datetime import UTC, datetime
from functools import cache
from importlib import metadata
from pathlib import Path

import eomcheck

LIBRARIES = ("numpy", "scipy", "llvmlite", "CyRK", "heyoka", "casadi", "pin")
LIBRARIES += ("python-flint", "distributed")
"""Distributions whose versions a Record stores, where they are installed."""


THREADS = tuple(f"{library}_NUM_THREADS" for library in ("OPENBLAS", "MKL", "OMP"))
"""Environment variables that set the number of BLAS threads; OpenBLAS prefers its own to OMP."""


def machine() -> dict[str, str | int]:
    """Return CPU model, number of logical cores, operating system and Python version."""
    return dict(_machine())


@cache
def _machine() -> dict[str, str | int]:
    return {
        "cpu": _cpu(),
        "cores": os.cpu_count() or 1,
        "os": platform.platform(),
        "python": platform.python_version(),
    }


def _cpu() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def versions() -> dict[str, str]:
    """Return the versions of eomcheck (with digest and commit) and of the libraries it uses."""
    return dict(_versions())


@cache
def _versions() -> dict[str, str]:
    installed = {"eomcheck": eomcheck.__version__, "sources": sources()}
    head = commit()
    if head is not None:
        installed["commit"] = head
    for name in LIBRARIES:
        try:
            installed[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return installed


@cache
def sources() -> str:
    """Return a digest of the package's sources, which identifies the code of a result."""
    root = Path(eomcheck.__file__).parent
    digest = hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


@cache
def commit() -> str | None:
    """Return the commit of the package's sources, with "+" where they were changed since.

    None where they are not in a git checkout; `sources` identifies them there too.
    """
    root = Path(eomcheck.__file__).parent
    tracked, changed = _git(root, "ls-files", "__init__.py"), _git(root, "status", "-s", ".")
    head = _git(root, "rev-parse", "--short=12", "HEAD") if tracked else None
    return head and head + ("+" if changed else "")


def _git(folder: Path, *arguments: str) -> str | None:
    command = ("git", "-C", str(folder), *arguments)
    try:
        result = subprocess.run(command, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return result.stdout.strip()


def blas_threads() -> int | None:
    """Return the number of BLAS threads that the environment sets, or None: the library chooses."""
    for variable in THREADS:
        value = os.environ.get(variable, "").split(",")[0].strip()
        if value.isdecimal():
            return int(value)
    return None


def now() -> str:
    """Return the time, UTC, as ISO 8601."""
    return datetime.now(UTC).isoformat(timespec="seconds")
