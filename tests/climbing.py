"""Measure how deep climbing comes, and how deep drawing at random, in the same number of states.

    python -m tests.climbing [--seeds 10] [--states 5000] [--links 4] [--figures FOLDER] [--fuzz]

Looked at is true error / stated bound of `banded`, enclosed at every state: in a copy of the
source where the mend of its silent errors is taken out (`tests.unmended`), and in the source as it
is. With --fuzz, `eomcheck fuzz` looks for these errors from scratch in that copy, as it would at
any time, and the exit code is 1 unless it tells of one of `banded` within five minutes.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from tests.mutants import PACKAGE, ROOT
from tests.unmended import unmended

from eomcheck.draws.fuzz_cases import structural_variants
from eomcheck.lab.fuzzing.campaign import Campaign
from eomcheck.lab.fuzzing.failures import read_failures
from eomcheck.lab.fuzzing.screening import SILENT, TRUTH, CheckFrequency
from eomcheck.lab.fuzzing.state_rounds import StatePlan
from eomcheck.lab.option_parsing import parse_interval
from eomcheck.lab.show.chart import Axis, Chart, Line, Panel
from eomcheck.scenes import Snake

KEY = "banded"
RATION = CheckFrequency(enclosures=1, balls=0, engines=0, checks=0, scalar_only=0)
WITHOUT, AS_IT_IS = "without the fix", "as it is"
WAYS = {False: "drawn at random", True: "by hill climbing"}
MINUTES = 5


@dataclass
class Search:
    """One search: after so many states, how high true error / bound was at most."""

    seed: int
    climbing: bool
    states: list[int]
    best: list[float]


class Campaigned(Campaign):
    """A campaign that makes no find small: only heights matter here."""

    def _new_failure(self, failed, late):
        return None


def search(seed: int, climbing: bool, states: int, links: str, batch: int) -> Search:
    """Return how high a search comes."""
    low, high = parse_interval(links)
    batch = batch if climbing else 2 * batch  # as many states a round
    plan = StatePlan(
        Snake, seed, ("true-error",), (KEY,), climbing=climbing, check_frequency=RATION, batch=batch
    )
    campaign = Campaigned(plan, Snake.key, structural_variants(Snake, range(low, high + 1)))
    found = Search(seed, climbing, [], [])

    def told(campaign: Campaign) -> None:
        worst = campaign.worst.get((TRUTH, KEY))
        found.states.append(campaign.states)
        found.best.append(0.0 if worst is None else worst.score)

    campaign.run(states, on_round=told)
    return found


# ---- In a copy of the source ---------------------------------------------------------------------


def environment(package: Path) -> dict[str, str]:
    """Return the environment in which Python imports this copy."""
    path = os.pathsep.join((str(package.parent), str(ROOT)))
    return os.environ | {"PYTHONPATH": path, "OPENBLAS_NUM_THREADS": "1"}


def searches(package: Path, given: Sequence[str]) -> list[Search]:
    """Return the searches that a copy of the source makes."""
    command = [sys.executable, "-m", "tests.climbing", "--measure", *given]
    found = []
    with subprocess.Popen(
        command, cwd=ROOT, env=environment(package), stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        for line in process.stdout:
            found.append(Search(**json.loads(line)))
            last = found[-1]
            print(f"  seed {last.seed}, {WAYS[last.climbing]}: {last.best[-1]:.3g}", flush=True)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, command)
    return found


def found_again(package: Path, seed: int) -> bool:
    """Return whether `eomcheck fuzz` finds a silent error of `banded`, and say when, and where."""
    start = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        kept = Path(folder) / "found.json"
        begin = "from eomcheck.cli import main; main()"
        given = f"fuzz --engine none --time {MINUTES}m --seed {seed} --keep {kept}"
        command = [sys.executable, "-c", begin, *given.split()]
        subprocess.run(command, cwd=ROOT, env=environment(package), check=False)
        finds = [x for x in read_failures(kept) if x.whose == SILENT and KEY in x.evidence]
    print(f"{time.perf_counter() - start:.0f} s: {len(finds)} finds of silent errors of {KEY}")
    return bool(finds)


# ---- What is told --------------------------------------------------------------------------------


def table(name: str, found: Sequence[Search]) -> str:
    """Return the highest of each seed, and the medians, in Markdown."""
    lines = [
        f"| seed, {name} | drawn at random | by hill climbing | times |",
        "| --- | --- | --- | --- |",
    ]
    ends = {(one.seed, one.climbing): one.best[-1] for one in found}
    rows = [(ends[seed, False], ends[seed, True]) for seed in sorted({one.seed for one in found})]
    for seed, (drawn, climbed) in enumerate(rows):
        lines.append(f"| {seed} | {drawn:.2g} | {climbed:.2g} | {climbed / drawn:.2g} |")
    drawn, climbed = np.median(rows, axis=0)
    times = np.median([climbed / drawn for drawn, climbed in rows])
    lines.append(f"| median | {drawn:.2g} | {climbed:.2g} | {times:.2g} |")
    return "\n".join(lines)


def chart(by_source: dict[str, list[Search]]) -> Chart:
    """Return the best ratio over states: each search thin, and the medians."""
    panels = {}
    for name, found in by_source.items():
        lines = list(_lines(found))
        title = f"Source {name}"
        x, y = Axis("states checked"), Axis("true error / bound", log=True, own=True)
        panels[(name,)] = Panel(x, y, lines, title, level=1.0)
    title = "Largest true error of banded over its bound: above 1 it is silent"
    grid = [[chosen] for chosen in panels]
    return Chart("climbing", title, ["source"], panels, grid)


def _lines(found: Sequence[Search]) -> Iterator[Line]:
    for climbing, key in WAYS.items():
        of = [one for one in found if one.climbing == climbing]
        for one in of:
            yield Line(key, one.states, one.best, label=f"{key}: each seed", appearance="thin")
        count = min(len(one.states) for one in of)
        at = np.median([one.states[:count] for one in of], axis=0)
        best = np.median([one.best[:count] for one in of], axis=0)
        marked = (0, max(1, count // 6))
        yield Line(key, at.tolist(), best.tolist(), label=f"{key}: median", every=marked)


def main() -> int:
    """Measure, and print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--seeds-as-it-is", type=int, default=3)
    parser.add_argument("--states", type=int, default=5000)
    parser.add_argument("--links", default="4")
    parser.add_argument("--batch", type=int, default=64)
    parser.add_argument("--figures", type=Path, help="folder to draw to")
    parser.add_argument("--fuzz", action="store_true", help="look for a find from scratch")
    parser.add_argument("--seed", type=int, default=0, help="of --fuzz")
    parser.add_argument("--measure", action="store_true", help="only this source, told as JSON")
    asked = parser.parse_args()
    numbers = asked.states, asked.links, asked.batch
    if asked.measure:
        for seed in range(asked.seeds):
            for climbing in (False, True):
                print(json.dumps(asdict(search(seed, climbing, *numbers))), flush=True)
        return 0
    with tempfile.TemporaryDirectory() as folder:
        copy = unmended(Path(folder))
        if asked.fuzz:
            return 0 if found_again(copy, asked.seed) else 1
        given = [f"--states={asked.states}", f"--links={asked.links}", f"--batch={asked.batch}"]
        by_source = {}
        for name, package, seeds in (
            (WITHOUT, copy, asked.seeds),
            (AS_IT_IS, PACKAGE, asked.seeds_as_it_is),
        ):
            by_source[name] = searches(package, [*given, f"--seeds={seeds}"])
            print(table(name, by_source[name]), flush=True)
    if asked.figures is not None:
        from eomcheck.lab.show.chart_matplotlib import draw_both

        draw_both(chart(by_source), asked.figures)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
