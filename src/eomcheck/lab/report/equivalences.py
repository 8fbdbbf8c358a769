"""Page of verified equivalences: every claim, its evidence, and the tests that verify it.

The page is generated from Records of `validate` and `prove` and from the sources of the validation
suite, never by hand. A test belongs to the claims that its source names. A parameter of a scene is
independently covered if an engine derives it from the scene's `tree()` instead of `parameters()`.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from eomcheck import __version__
from eomcheck.atomic_write import write_text
from eomcheck.claims import CLAIMS
from eomcheck.draws.pairwise_design import link_count
from eomcheck.engines import ENGINES
from eomcheck.errors import InputError
from eomcheck.lab.report.claim_summary import LEVELS, ClaimSummary, evidence_table
from eomcheck.lab.report.overview import Overview, origin_of
from eomcheck.lab.show.document_text import ranges, render
from eomcheck.lab.store.record_file import group
from eomcheck.lab.store.validation_runs import PROOFS, RUNS, STATES
from eomcheck.scenes import SCENES

# ---- Tests by claim ------------------------------------------------------------------------------

PROVED = LEVELS[0]


def named_tests(suite: Path) -> dict[str, tuple[str, ...]]:
    """Return the tests of each claim: those that name it, or are parametrized by it.

    Tests that prove are under "proved".

    Raises:
        InputError: there is no such folder, or no test in it.

    Returns:
        Id of a claim, or "proved" -> test names `folder/file.py::test`.
    """
    files = sorted(suite.glob("test_*.py"))
    if not files:
        raise InputError(f"{str(suite)!r} holds no validation suite")
    tests: dict[str, tuple[str, ...]] = {}
    for file in files:
        for test in ast.parse(file.read_text(encoding="utf-8")).body:
            if isinstance(test, ast.FunctionDef) and test.name.startswith("test_"):
                chosen = {x for d in test.decorator_list for x in _constants(d)}
                for key in sorted(_claims_in(test)):
                    name = f"{test.name}[{key}]" if key in chosen else test.name
                    tests[key] = (*tests.get(key, ()), f"{suite.name}/{file.name}::{name}")
    return tests


def _constants(tree: ast.AST) -> set[Any]:
    return {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)}


def _claims_in(test: ast.FunctionDef) -> set[str]:
    calls = {
        node.func.attr
        for node in ast.walk(test)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)
    }
    return (CLAIMS.keys() & _constants(test)) | ({PROVED} if "prove" in calls else set())


# ---- Independent parameters ----------------------------------------------------------------------


class IndependentParameters(NamedTuple):
    """Parameters of a scene class, split by whether an engine verifies them independently."""

    scene: str
    covered: str
    """Parameters that an engine reads from another source than `parameters()`, and the engine."""
    common: str
    """Parameters that both derivations read from `parameters()`."""


def independent_parameters(overview: Overview) -> Iterator[IndependentParameters]:
    """Yield, per validated scene, its parameters that an engine obtains independently.

    Those are the parameters that change the scene's `tree()`, if an engine built from the tree took
    part.
    """
    for run in overview.runs:
        if (kind := SCENES.get(run.settings["scene"])) is None:
            continue
        scene: Any = kind.example()
        names = list(kind.ranges(link_count(scene)))
        built_in = [key for key in run.series["engines"] if key in ENGINES]
        keys = [key for key in built_in if not ENGINES[key].reads_parameters]
        in_tree = [name for name in names if keys and _in_tree(scene, name)]
        common = ", ".join(name for name in names if name not in in_tree)
        covered = f"{', '.join(in_tree)} ({', '.join(keys)}, from the tree)" if in_tree else "-"
        uncovered = f"common mode not covered: {common}" if common else "-"
        yield IndependentParameters(kind.key, covered, uncovered)


def _in_tree(scene: Any, name: str) -> bool:
    value, tree = getattr(scene, name), scene.tree()
    if tree is None or value is None:
        return False
    changed = replace(scene, **{name: 1.5 * value + 0.1}).tree()
    return any(not np.array_equal(x, y) for x, y in zip(tree, changed, strict=True))


# ---- The page ------------------------------------------------------------------------------------

RUN = "## The run"
"""Heading of the section about one run alone."""


def write_equivalences(overview: Overview, path: Path, suite: Path) -> None:
    """Write the page of verified equivalences.

    Args:
        overview: Records of a finished validation, and of proofs.
        path: file to write.
        suite: folder of the validation suite.

    Raises:
        InputError: the Records contain no finished validation, or one in which a claim fails; there
            is no suite; a claim has no test in it.
        EngineError: jinja2 is not installed.
    """
    if not overview.runs or overview.verdict in ("not finished", "nothing checked"):
        raise InputError(f"no finished validation in the records: {overview.headline}")
    if overview.failed:
        raise InputError(f"not all claims hold: {overview.headline}")
    of_run = [r for r in overview.records if r.study in (STATES, RUNS, PROOFS)]
    text = render(
        "equivalences.md.j2",
        overview=overview,
        entries=list(claim_entries(overview, suite)),
        evidence=evidence_table,
        version=__version__,
        heading=RUN,
        other_data=list(independent_parameters(overview)),
        commands=list(dict.fromkeys(commands(overview))),
        provenance=list(dict.fromkeys(origin_of(r) for r in of_run)),
        versions={name: version for r in of_run for name, version in r.versions.items()},
    )
    write_text(path, text)


def commands(overview: Overview) -> Iterator[str]:
    """Yield the commands that reproduce the Records; of `prove`, one for each scene class."""
    counts_by_scene = {run.settings["scene"]: run.counts for run in overview.runs}
    same = len({tuple(counts.items()) for counts in map(_options, counts_by_scene.values())}) == 1
    whole = same and counts_by_scene.keys() == SCENES.keys()
    for scene, counts in counts_by_scene.items():
        options = "".join(f" --{name} {value}" for name, value in _options(counts).items())
        yield f"eomcheck validate --scene {'all' if whole else scene}{options}"
    proofs = group(overview.of(PROOFS), lambda r: r.settings["scene"])
    links = {r.settings["links"] for r in overview.of(PROOFS)} - {None}
    every = proofs.keys() == SCENES.keys()
    for scene, records in proofs.items():
        link_counts = links if every else {r.settings["links"] for r in records} - {None}
        links_option = f" --links {ranges(link_counts, '..', ',')}" if link_counts else ""
        yield f"eomcheck prove --scene {'all' if every else scene}{links_option}"


def _options(counts: dict[str, int]) -> dict[str, int | str]:
    links = f"{counts['first links']}..{counts['last links']}"
    return {"examples": counts["examples"], "links": links, "seed": counts["seed"]}


def claim_entries(
    overview: Overview, suite: Path
) -> Iterator[tuple[ClaimSummary, tuple[str, ...]]]:
    """Yield every claim with its evidence, and its tests.

    Raises:
        InputError: see `write_equivalences`.
    """
    tests = named_tests(suite)
    for judged in overview.claims:
        key = judged.claim.id
        evidence = [row for row in judged.rows if row.level in LEVELS]
        evidence.sort(key=lambda row: overview.scenes.index(row.scene))
        shown = tests.get(key, ())
        if any(row.level == PROVED for row in evidence):
            shown += tests.get(PROVED, ())
        if not shown:
            raise InputError(f"claim {key!r} has no test in {str(suite)!r}")
        yield ClaimSummary(tuple(evidence)), shown
