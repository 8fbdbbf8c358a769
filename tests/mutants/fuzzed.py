"""Plant faults of scenes and formulations one at a time, and see whether fuzzing finds them.

    python -m tests.mutants.fuzzed [--every 4] [--time 20s] [--seed 0] [--only TEXT] [--table FILE]

Each fault of `tests.faults` is planted into a copy of the source, where `eomcheck fuzz` looks at
the scene that shows it. It is *found* if there is a find, and *named* if one of the finds is of the
claim that the fault breaks, and names its term. Where a fault leaves no state that keeps its own
constraints, fuzzing refuses the scene and says so. The exit code is 0 if all are named or refused.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from tests.faults import FAULTS, scene_of
from tests.mutants import PACKAGE, Mutant
from tests.mutants.__main__ import run

from eomcheck.claims import CLAIMS
from eomcheck.lab.fuzzing.failures import FailureRecord, read_failures

LONGEST = 600.0
"""What a campaign may take with all that follows it, s."""


class Told(NamedTuple):
    """What fuzzing told of a fault: "named", "found", "not found", "refused" or "error"."""

    fault: Mutant
    outcome: str
    claims: tuple[str, ...]
    seconds: float
    said: str = ""


def attempt(fault: Mutant, seconds: str, seed: int) -> Told:
    """Plant one fault into a copy of the source, and fuzz the scene that shows it there."""
    start = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="mutant-") as folder:
        package, kept = Path(folder) / PACKAGE.name, Path(folder) / "found.json"
        shutil.copytree(PACKAGE, package)
        (package / fault.file).write_text(fault.planted(package), encoding="utf-8")
        given = f"--scene {scene_of(fault).key} --time {seconds} --seed {seed} --keep {kept}"
        start_it = "from eomcheck.cli import main; main()"
        code, said = run([sys.executable, "-c", start_it, "fuzz", *given.split()], package, LONGEST)
        finds = read_failures(kept)
    claims = tuple(dict.fromkeys(find.claim for find in finds))
    broken = code not in (0, 1) or "Traceback" in said
    outcome = "error" if broken else outcome_of(fault, finds)
    if code == 2 and "no state could be drawn" in said:
        outcome = "refused"
    return Told(fault, outcome, claims, time.perf_counter() - start, said)


def outcome_of(fault: Mutant, finds: Iterable[FailureRecord]) -> str:
    """Return what finds tell of a fault: "named", "found" or "not found"."""
    finds = list(finds)
    term = CLAIMS[fault.claim].term
    for find in finds:
        said = f"[{find.subject}] {find.detail}"
        if find.claim == fault.claim and (term in said or fault.says in said):
            return "named"
    return "found" if finds else "not found"


def table(told: Iterable[Told]) -> str:
    """Return the counts by what faults are planted in, and those not named, in Markdown."""
    told = list(told)
    lines = [
        "| faults of | planted | found | named | refused |",
        "| --- | --- | --- | --- | --- |",
    ]
    for kind in ("scenes", "formulations"):
        of = [x for x in told if f"{x.fault.kind}s" == kind]
        count = Counter(x.outcome for x in of)
        found = count["named"] + count["found"]
        lines.append(f"| {kind} | {len(of)} | {found} | {count['named']} | {count['refused']} |")
    lines += [""] if any(one.outcome != "named" for one in told) else []
    for one in told:
        if one.outcome != "named":
            why = ", ".join(one.claims) or "nothing"
            lines.append(f"- `{one.fault.id}`: {one.outcome}; found: {why}")
    return "\n".join(lines) + "\n"


def main() -> int:
    """Plant what the command line asks for, and tell."""
    parser = argparse.ArgumentParser("python -m tests.mutants.fuzzed", description=__doc__)
    parser.add_argument("--every", type=int, default=4, help="of so many faults the first")
    parser.add_argument("--time", default="20s", help="how long each is looked for")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", help="faults whose id has this text")
    parser.add_argument("--table", type=Path, help="file to write the table to")
    asked = parser.parse_args()
    chosen = [fault for fault in FAULTS if asked.only is None or asked.only in fault.id]
    told = []
    for fault in chosen[:: asked.every if asked.only is None else 1]:
        told.append(one := attempt(fault, asked.time, asked.seed))
        claims = ", ".join(one.claims)
        print(f"{one.outcome}: {fault.id} ({one.seconds:.0f} s; {claims})", flush=True)
        if one.outcome == "error":
            print(one.said[-2000:])
    text = table(told)
    print(text)
    if asked.table is not None:
        asked.table.write_text(text, encoding="utf-8")
    return 0 if all(one.outcome in ("named", "refused") for one in told) else 1


if __name__ == "__main__":
    raise SystemExit(main())
