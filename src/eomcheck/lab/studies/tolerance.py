"""What the constant C of every tolerance rests on: observed / (κ ε scale) over random states."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from itertools import chain
from statistics import median

from eomcheck.claims import CLAIMS
from eomcheck.claims.finding import DECIDED
from eomcheck.claims.run import Run
from eomcheck.claims.selection import Selection
from eomcheck.claims.strata import scene_cases
from eomcheck.console import progress
from eomcheck.evaluation.tolerance import C
from eomcheck.lab.options import Examples, Links, Seed, at_least_one, interval
from eomcheck.lab.show.sheet import Sheet
from eomcheck.lab.store.records import Record, Settings
from eomcheck.lab.study import Study, failed, unfinished
from eomcheck.scenes import Snake


def cells(
    *, links: Links = "1..40", examples: Examples = 200, seed: Seed = 0
) -> Iterator[Settings]:
    """Yield one cell: all states are drawn together.

    Raises:
        InputError: no such numbers of links, or no examples.
    """
    at_least_one(examples=examples)
    yield {"links": interval(links), "examples": examples, "seed": seed}


def _ratios(settings: Settings) -> Record:
    """Find, per claim, observed / (κ ε scale) of every conclusive Finding."""
    run, selection, examples = Run(), Selection.of(), settings["examples"]
    links, seed = settings["links"], settings["seed"]
    with progress("measuring errors at {state}", examples) as advance:
        run.explore(scene_cases(Snake, links, examples, seed), selection, advance)
    ratios: dict[str, list[float]] = defaultdict(list)
    for finding in run.findings:
        if finding.verdict in DECIDED and finding.claim != "refusals":
            ratios[finding.claim].append(C * finding.ratio)
    return Record(STUDY.key, settings, series=dict(ratios))


def sheets(found: Sequence[Record]) -> Iterator[Sheet]:
    """Yield the median and the largest ratio of each claim."""
    rows = [
        (claim, str(len(values)), f"{median(values):.2g}", f"{max(values):.2g}")
        for record in found
        for claim in CLAIMS
        if (values := record.series.get(claim))
    ]
    title = "observed / (κ ε scale) of each claim"
    yield Sheet("tolerance", title, ("claim", "findings", "median", "largest"), rows)


def said(found: Sequence[Record]) -> Iterator[str]:
    """Yield the largest ratio of all, beside C."""
    yield from unfinished(found)
    top = max(chain.from_iterable(x for r in found for x in r.series.values()), default=0.0)
    yield f"observed / (κ ε scale): largest {top:.3g}; the constant C is {C:g}."


STUDY = Study(
    key="tolerance",
    cells=cells,
    worker=lambda known: _ratios,
    sheets=sheets,
    said=said,
    label="",
    alarm=failed,
    small=True,
)
