"""Optional libraries, each in an environment of its own, on three robots and a pendulum.

    python -m tests.libraries [--only EXTRA,EXTRA] [--states 4] [--robots NAME,NAME]

Each takes part in `eomcheck study conformance --isolated`, with the deviations that are known. A
library that cannot be installed is named with the reason, and the next run tries again. The exit
code is 1 if something differs that is not known to, or what is known does not, if a study comes to
no end, or if it compares nothing.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

from eomcheck.engines import LIBRARIES

KNOWN = Path(__file__).parents[1] / "docs" / "conformance" / "deviations.toml"
"""File of the deviations that are known; without it no difference is judged."""

ROBOTS = "ur5", "panda", "ant", "chain-pendulum"
"""Names of robots, two by URDF and one by MJCF, and the scene for libraries that read no files."""

UNINSTALLED = "cannot be installed"


def by_extra() -> dict[str, list[str]]:
    """Return extra -> keys of the engines of its library."""
    extras: dict[str, list[str]] = {}
    for key, kind in LIBRARIES.items():
        if kind.extra is not None:
            extras.setdefault(kind.extra, []).append(key)
    return extras


def study(keys: list[str], robots: list[str], states: int) -> tuple[bool, str]:
    """Return whether the study of the engines of one library is as known, and a sentence on it.

    Args:
        keys: keys of the engines.
        robots: names of robots and scenes.
        states: number of states of each.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "study.json"
        words = [sys.executable, "-m", "eomcheck", "study", "conformance", "--isolated"]
        words += ["--engine", ",".join(keys), "--robot", ",".join(robots), "--states", str(states)]
        words += ["--deviations", str(KNOWN)] if KNOWN.exists() else []
        words += ["--patience", "600", "--json", str(file)]
        end = subprocess.run(words, stderr=subprocess.PIPE, text=True, errors="replace")
        last = (end.stderr.strip().splitlines() or [""])[-1]
        if end.returncode == 2 and UNINSTALLED in last:
            return True, f"left out: {last}"
        if end.returncode not in (0, 1):
            return False, f"exit code {end.returncode}: {last}"
        records = json.loads(file.read_text(encoding="utf-8"))["records"]
    missing = {*keys} - {x["settings"]["engine"].split("==")[0] for x in records if x["series"]}
    if missing:
        return False, f"nothing was compared of {', '.join(sorted(missing))}"
    return end.returncode == 0, "as known" if end.returncode == 0 else "not as known, see above"


def main() -> int:
    """Study every library, print a sentence on each, and return the exit code."""
    extras = by_extra()
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--only", default=",".join(extras))
    parser.add_argument("--states", type=int, default=4)
    parser.add_argument("--robots", default=",".join(ROBOTS))
    options = parser.parse_args()
    sentences, good = [], True
    for extra in options.only.split(","):
        right, sentence = study(extras[extra], options.robots.split(","), options.states)
        sentences.append(f"{extra} ({', '.join(extras[extra])}): {sentence}")
        print(sentences[-1], flush=True)
        good = good and right
    print("", *sentences, sep="\n")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
