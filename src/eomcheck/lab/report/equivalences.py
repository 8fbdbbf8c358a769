"""The page of verified equivalences: every claim, its evidence, and the test that shows it.

Generated from Records of `validate` and `prove` and from the sources of the validation suite, never
by hand.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from eomcheck import __version__
from eomcheck.atomic_write import write_text
from eomcheck.errors import InputError
from eomcheck.lab.report.evidence import evidence_sheet
from eomcheck.lab.report.judged import LEVELS, Judged
from eomcheck.lab.report.named_tests import PROVED, named_tests
from eomcheck.lab.report.other_data import other_data
from eomcheck.lab.report.overview import Overview, made
from eomcheck.lab.show.document_text import ranges, render
from eomcheck.lab.store.findings import PROOFS, RUNS, STATES
from eomcheck.lab.store.groups import group
from eomcheck.scenes import SCENES

RUN = "## The run"
"""Heading of the section that is about one run alone."""


def write_equivalences(overview: Overview, path: Path, suite: Path) -> None:
    """Write the page.

    Args:
        overview: Records of a validation that came to its end, and of proofs.
        path: where.
        suite: folder of the validation suite.

    Raises:
        InputError: the Records hold no finished validation, or one in which a claim fails; there is
            no suite; a claim has no test in it.
        EngineError: jinja2 is not installed.
    """
    if not overview.runs or overview.verdict in ("not finished", "nothing checked"):
        raise InputError(f"no finished validation in the records: {overview.headline}")
    if overview.failed:
        raise InputError(f"not all claims hold: {overview.headline}")
    of_run = [one for one in overview.records if one.study in (STATES, RUNS, PROOFS)]
    text = render(
        "equivalences.md.j2",
        overview=overview,
        entries=list(entries(overview, suite)),
        evidence=evidence_sheet,
        version=__version__,
        heading=RUN,
        other_data=list(other_data(overview)),
        commands=list(dict.fromkeys(commands(overview))),
        provenance=list(dict.fromkeys(made(one) for one in of_run)),
        versions={name: version for one in of_run for name, version in one.versions.items()},
    )
    write_text(path, text)


def commands(overview: Overview) -> Iterator[str]:
    """Yield the commands that made the Records; of `prove`, for each kind of scene."""
    asked = {one.settings["scene"]: one.counts for one in overview.runs}
    same = len({tuple(counts.items()) for counts in map(_options, asked.values())}) == 1
    whole = same and asked.keys() == SCENES.keys()
    for scene, counts in asked.items():
        options = "".join(f" --{name} {value}" for name, value in _options(counts).items())
        yield f"eomcheck validate --scene {'all' if whole else scene}{options}"
    proofs = group(overview.of(PROOFS), lambda one: one.settings["scene"])
    links = {one.settings["links"] for one in overview.of(PROOFS)} - {None}
    every = proofs.keys() == SCENES.keys()
    for scene, records in proofs.items():
        mine = links if every else {one.settings["links"] for one in records} - {None}
        of = f" --links {ranges(mine, '..', ',')}" if mine else ""
        yield f"eomcheck prove --scene {'all' if every else scene}{of}"


def _options(counts: dict[str, int]) -> dict[str, int | str]:
    links = f"{counts['first links']}..{counts['last links']}"
    return {"examples": counts["examples"], "links": links, "seed": counts["seed"]}


def entries(overview: Overview, suite: Path) -> Iterator[tuple[Judged, tuple[str, ...]]]:
    """Yield every claim, with its evidence and its tests.

    Raises:
        InputError: see `write_equivalences`.
    """
    tests = named_tests(suite)
    for judged in overview.claims:
        key = judged.claim.id
        looked_at = [row for row in judged.rows if row.level in LEVELS]
        looked_at.sort(key=lambda row: overview.scenes.index(row.scene))
        shown = tests.get(key, ())
        if any(row.level == PROVED for row in looked_at):
            shown += tests.get(PROVED, ())
        if not shown:
            raise InputError(f"claim {key!r} has no test in {str(suite)!r}")
        yield Judged(tuple(looked_at)), shown
