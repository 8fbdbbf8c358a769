"""Check right models of many libraries and kinds: none of them may be called wrong.

    python -m tests.trials.right_models [--jobs 2] [--seed 0] [--origin Drake] [--markdown FILE]

Prints how many there are of each origin and every Finding that failed; the exit code is 1 if there
is one, or if fewer than `LEAST` models were checked; after Ctrl-C it is 130, and the table holds
what was done. Models in float32 fail `double-precision`, and nothing else.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from pathlib import Path

from tests.trials.formula_models import formula_models
from tests.trials.library_models import Model, library_models
from tests.trials.progress import Progress, ignore_interrupts

from eomcheck.lab.show.table import ResultTable, print_tables
from eomcheck.testing import check

LEAST = 200
"""Fewer models than this are no trial."""


@cache
def models() -> list[Model]:
    """Return all models, in an order that every process finds again."""
    return [*library_models(), *formula_models()]


def judged(index: int, seed: int = 0) -> tuple[int, dict[str, int] | None, list[str]]:
    """Return the index, how many Findings have each verdict, and the false alarms.

    None in place of the numbers where a file holds no model that can be checked so.
    """
    model = models()[index]
    functions = model.make()
    if functions is None:
        return index, None, []
    counts: dict[str, int] = defaultdict(int)
    alarms: list[str] = []
    for finding in check(functions, seed=seed):
        counts[finding.verdict] += 1
        expected = model.single and finding.claim == "double-precision"
        if finding.verdict == "failed" and not expected:
            alarms.append(f"{model.origin}, {model.name}: {finding}")
    return index, dict(counts), alarms


def judgements(
    indices: list[int], seed: int, jobs: int
) -> Iterator[tuple[int, dict[str, int] | None, list[str]]]:
    """Yield what `judged` returns, in order, from several processes if there are."""
    seeds = [seed] * len(indices)
    if jobs == 1:
        yield from map(judged, indices, seeds)
        return
    with ProcessPoolExecutor(jobs, initializer=ignore_interrupts) as pool:
        yield from pool.map(judged, indices, seeds)


def table(rows: dict[str, list[int]]) -> ResultTable:
    """Return the numbers of models, Findings and false alarms of each origin."""
    cells = [[origin, *map(str, numbers)] for origin, numbers in rows.items()]
    total = ["all", *(str(sum(column)) for column in zip(*rows.values(), strict=True))]
    columns = ["origin", "models", "passed", "inconclusive", "skipped", "models with an alarm"]
    return ResultTable("right-models", "Right models", columns, [*cells, total])


def main() -> int:
    """Check all models, print the table and the false alarms, and return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--origin", default="", help="only origins that begin so")
    parser.add_argument("--markdown", type=Path, help="write the table to this file too")
    options = parser.parse_args()
    wanted = [k for k, one in enumerate(models()) if one.origin.startswith(options.origin)]
    if not wanted:
        known = ", ".join(dict.fromkeys(one.origin for one in models()))
        parser.error(f"--origin {options.origin!r}: no model of it, expected one of {known}")
    rows: dict[str, list[int]] = defaultdict(lambda: [0] * 5)
    with Progress(len(wanted)) as progress:
        for index, counts, alarms in progress.of(judgements(wanted, options.seed, options.jobs)):
            if counts is None:
                continue
            verdicts = [counts.get(one, 0) for one in ("passed", "inconclusive", "skipped")]
            added = [1, *verdicts, int(bool(alarms))]
            origin = models()[index].origin
            rows[origin] = [old + new for old, new in zip(rows[origin], added, strict=True)]
            for alarm in alarms:
                print(alarm, flush=True)
    sheet = table(rows)
    print_tables([sheet])
    if options.markdown is not None:
        options.markdown.write_text(sheet.markdown(), encoding="utf-8")
    checked, failed = (sum(row[k] for row in rows.values()) for k in (0, 4))
    few = not options.origin and checked < LEAST
    print(f"{checked} models, {failed} with a false alarm" + (f", at least {LEAST}" if few else ""))
    return 130 if progress.interrupted else int(failed > 0 or few)


if __name__ == "__main__":
    raise SystemExit(main())
