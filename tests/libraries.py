"""Optional libraries, each in an environment of its own, on three robots or a pendulum.

    python -m tests.libraries [--only EXTRA,EXTRA] [--states 2] [--robots NAME,NAME] [--jobs 2]

Each takes part in `eomcheck study conformance --isolated`, with the deviations that are known, and
its scripts of docs/conformance are run without eomcheck. A library that cannot be installed is
named with the reason, and the next run tries again. The exit code is 1 if something differs that is
not known to, or what is known does not, if a study comes to no end, if it compares nothing, or if a
script fails. Functions in JAX are compiled once a machine: they are kept in the cache folder.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from tests import conformance_scripts

from eomcheck.engines import BY_FORMAT, LIBRARIES
from eomcheck.engines.environments import cache_folder
from eomcheck.errors import EngineError

KNOWN = Path(__file__).parents[1] / "docs" / "conformance" / "deviations.toml"
"""File of the deviations that are known; without it no difference is judged."""

ROBOTS = "ur5", "panda", "ant"
"""Names of robots, two by URDF and one by MJCF."""

SCENE = "chain-pendulum"
"""Name of the scene for libraries that read no files."""

UNINSTALLED = "cannot be installed"

LONGEST = 3600
"""Seconds that the study of one library may take: JAX may compile a topology for longer."""

TIMED_OUT = 124
"""Exit code of `timeout` for a command that it has ended."""


def by_extra() -> dict[str, list[str]]:
    """Return extra -> keys of the engines of its library."""
    extras: dict[str, list[str]] = {}
    for key, kind in LIBRARIES.items():
        if kind.extra is not None:
            extras.setdefault(kind.extra, []).append(key)
    return extras


def robots_of(keys: list[str]) -> list[str]:
    """Return the names of the robots for the engines of one library, or of the scene."""
    reads = any(key in kinds for kinds in BY_FORMAT.values() for key in keys)
    return [*ROBOTS] if reads else [SCENE]


def study(keys: list[str], robots: list[str], states: int) -> tuple[bool, str, str]:
    """Study the engines of one library.

    Args:
        keys: keys of the engines.
        robots: names of robots and scenes.
        states: number of states of each.

    Returns:
        Whether the study is as known, a sentence on it, and the tables that it printed.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "study.json"
        # It is asked to end, and so ends the processes of the library too.
        words = ["timeout", "--kill-after=60", str(LONGEST), sys.executable, "-m", "eomcheck"]
        words += ["study", "conformance", "--isolated"]
        words += ["--engine", ",".join(keys), "--robot", ",".join(robots), "--states", str(states)]
        words += ["--deviations", str(KNOWN)] if KNOWN.exists() else []
        words += ["--patience", "600", "--json", str(file)]
        compiled = {"JAX_COMPILATION_CACHE_DIR": str(cache_folder() / "jax")}
        end = subprocess.run(
            words, capture_output=True, text=True, errors="replace", env=compiled | os.environ
        )
        last = (end.stderr.strip().splitlines() or [""])[-1]
        if end.returncode == 2 and UNINSTALLED in last:
            return True, f"left out: {last}", ""
        if end.returncode == TIMED_OUT:
            return False, f"no end after {LONGEST} s", end.stdout
        if end.returncode not in (0, 1):
            return False, f"exit code {end.returncode}: {last}", end.stdout
        records = json.loads(file.read_text(encoding="utf-8"))["records"]
    missing = {*keys} - {x["settings"]["engine"].split("==")[0] for x in records if x["series"]}
    if missing:
        return False, f"nothing was compared of {', '.join(sorted(missing))}", end.stdout
    right = end.returncode == 0
    return right, "as known" if right else "not as known, see above", end.stdout


def failed_scripts(extra: str) -> list[str]:
    """Return the ends of the scripts of a library that fail, one text for each."""
    try:
        ends = [
            (x.name, *conformance_scripts.run(x)) for x in conformance_scripts.scripts_of(extra)
        ]
    except EngineError:
        return []  # its study says so
    return [f"{name}: {output}" for name, right, output in ends if not right]


def main() -> int:
    """Study every library, print a sentence on each, and return the exit code."""
    extras = by_extra()
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--only", default=",".join(extras))
    parser.add_argument("--states", type=int, default=2)
    parser.add_argument("--robots", default="")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()

    def ask(extra: str) -> tuple[bool, str, str]:
        start, keys = time.monotonic(), extras[extra]
        robots = options.robots.split(",") if options.robots else robots_of(keys)
        right, sentence, output = study(keys, robots, options.states)
        failed = failed_scripts(extra)
        sentence = "; ".join([sentence, *failed])
        spent = f"{time.monotonic() - start:.0f} s"
        return right and not failed, f"{extra} ({', '.join(keys)}): {sentence}; {spent}", output

    sentences, good = [], True
    with ThreadPoolExecutor(options.jobs) as pool:
        for right, sentence, output in pool.map(ask, options.only.split(",")):
            sentences.append(sentence)
            print(output, sentence, sep="\n", flush=True)
            good = good and right
    print("", *sentences, sep="\n")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
