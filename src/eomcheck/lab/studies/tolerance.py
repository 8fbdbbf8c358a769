"""Evidence for the constant C of every tolerance: observed / (κ ε scale) over random states."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from itertools import chain
from statistics import median
from typing import Annotated

from eomcheck.claims import CLAIMS
from eomcheck.claims.finding import DECIDED
from eomcheck.claims.run import RunSelection, ValidationRun
from eomcheck.console import progress
from eomcheck.draws.pairwise_design import scene_cases
from eomcheck.errors import InputError
from eomcheck.evaluation.tolerance import C
from eomcheck.lab.option_parsing import Examples, Kind, Seed, check_count, parse_interval
from eomcheck.lab.show.table import ResultTable
from eomcheck.lab.store.record_file import Record, Settings
from eomcheck.lab.study import Study, failed, unfinished
from eomcheck.mechanics.scene import Scene
from eomcheck.scene_lookup import scene_classes_named
from eomcheck.scenes import Snake


def cells(
    *,
    scene: Kind = "snake",
    links: Annotated[str | None, "Number of links, N or N..M. [default: 1..40]"] = None,
    examples: Examples = 200,
    seed: Seed = 0,
) -> Iterator[Settings]:
    """Yield a cell for each scene class: all its states are sampled together.

    Raises:
        InputError: no such numbers of links, links of a scene class without, or no examples.
        UnknownNameError: no such scene.
    """
    check_count(examples=examples)
    for kind in scene_classes_named(scene):
        if links is not None and not kind.has_links:
            raise InputError(f"links = {links!r}: {kind.key} has no number of links to choose")
        sizes = parse_interval("1..40" if links is None else links)
        drawn = {"links": sizes, "examples": examples, "seed": seed}
        yield drawn if kind is Snake else drawn | {"scene": kind.key}


def worker(stored: Sequence[Record], *, scene: Kind = "snake") -> Callable[[Settings], Record]:
    """Return the function that computes the ratios of one scene class."""
    kinds = {kind.key: kind for kind in scene_classes_named(scene)}
    return lambda settings: _ratios(kinds[settings.get("scene", Snake.key)], settings)


def _ratios(kind: type[Scene], settings: Settings) -> Record:
    """Return, per claim, observed / (κ ε scale) of every conclusive Finding."""
    run, selection, examples = ValidationRun(), RunSelection.of(scenes=[kind]), settings["examples"]
    links, seed = settings["links"], settings["seed"]
    with progress("measuring errors at {state}", examples) as advance:
        run.explore(scene_cases(kind, links, examples, seed), selection, advance)
    ratios: dict[str, list[float]] = defaultdict(list)
    for finding in run.findings:
        if finding.verdict in DECIDED and finding.claim != "refusals":
            ratios[finding.claim].append(C * finding.ratio)
    return Record(STUDY.key, settings, series=dict(ratios))


def tables(records: Sequence[Record]) -> Iterator[ResultTable]:
    """Yield the median and the largest ratio of each claim."""
    several = len(records) > 1
    rows = [
        (
            *([record.settings.get("scene", Snake.key)] if several else []),
            *(claim, str(len(values)), f"{median(values):.2g}", f"{max(values):.2g}"),
        )
        for record in records
        for claim in CLAIMS
        if (values := record.series.get(claim))
    ]
    title = "observed / (κ ε scale) of each claim"
    columns = ("claim", "findings", "median", "largest")
    yield ResultTable("tolerance", title, ("scene", *columns) if several else columns, rows)


def remarks(records: Sequence[Record]) -> Iterator[str]:
    """Yield the largest ratio of all claims, beside C."""
    yield from unfinished(records)
    top = max(chain.from_iterable(x for r in records for x in r.series.values()), default=0.0)
    yield f"observed / (κ ε scale): largest {top:.3g}; the constant C is {C:g}."


def alarm(records: Sequence[Record]) -> bool:
    """Return whether an error exceeds the bound by the constant C."""
    ratios = chain.from_iterable(x for r in records for x in r.series.values())
    return failed(records) or any(ratio > C for ratio in ratios)


STUDY = Study(
    key="tolerance",
    cells=cells,
    worker=worker,
    tables=tables,
    remarks=remarks,
    label="",
    alarm=alarm,
    small=True,
)
