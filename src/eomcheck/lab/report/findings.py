"""Findings as a table of claims × formulations and engines, and as JSON."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from statistics import median
from typing import Any, Protocol, TypeVar

from rich.markup import escape
from rich.table import Table

from eomcheck import __version__
from eomcheck.claims import CLAIMS, Finding
from eomcheck.claims.run import Run, Selection
from eomcheck.console import console
from eomcheck.lab.show.layout import numbers, table, words
from eomcheck.lab.show.layout import write_json as write_document
from eomcheck.lab.show.sheet import Sheet


class Found(Protocol):
    """A Finding, or what was kept of one."""

    @property
    def subject(self) -> str: ...  # noqa: D102
    @property
    def verdict(self) -> str: ...  # noqa: D102
    @property
    def ratio(self) -> float: ...  # noqa: D102


F = TypeVar("F", bound=Found)
T = TypeVar("T")


def worst(findings: Iterable[F]) -> F | None:
    """Return a failed Finding, else the one with the largest observed / allowed that counts."""
    ranked = sorted(
        findings,
        key=lambda f: (f.verdict == "failed", f.verdict == "passed", f.ratio),
    )
    return ranked[-1] if ranked else None


def parties(finding: Found) -> set[str]:
    """Return the formulations and engines that a Finding is about."""
    return set(re.findall(r"\w+", finding.subject))


def _cell(findings: list[Finding]) -> str:
    finding = worst(findings)
    if finding is None:
        return "[dim]·[/]"
    if finding.verdict == "inconclusive":
        return "[yellow]?[/]"
    if finding.verdict == "failed":
        return "[bold red]FAIL[/]"
    return f"[green]{percent(finding.ratio)}[/]"


def percent(ratio: float) -> str:
    """Return observed / allowed in whole percent."""
    return "0" if ratio == 0 else "<1%" if ratio < 0.01 else f"{100 * ratio:.0f}%"


def _evidence(findings: list[Finding]) -> str:
    level = findings[0].evidence.partition(":")[0]
    open_ = sum(finding.verdict == "inconclusive" for finding in findings)
    return f"{level}, {len(findings)}" + (f", {open_} open" if open_ else "")


def findings_table(run: Run, selection: Selection) -> Table:
    """Return claims × formulations and engines; a cell is the worst observed / allowed."""
    columns = [f.key for f in selection.formulations] + [e.key for e in selection.engines]
    cells = numbers("all", *columns, no_wrap=True)
    rest = *words("evidence, findings"), *numbers("time", no_wrap=True)
    made = table([*words("claim"), *cells, *rest], pad_edge=False)
    by_claim = group(run.findings, lambda f: f.claim)
    for id in CLAIMS:
        found = by_claim.get(id, [])
        if not found:
            continue
        made.add_row(
            id,
            _cell(found),
            *(_cell([f for f in found if name in parties(f)]) for name in columns),
            _evidence(found),
            f"{run.seconds.get(id, 0.0):.1f} s",
        )
    return made


def group(findings: Iterable[T], key: Callable[[T], Any]) -> dict[Any, list[T]]:
    """Return the Findings by `key`, in order."""
    groups: dict[Any, list[T]] = {}
    for finding in findings:
        groups.setdefault(key(finding), []).append(finding)
    return groups


CELLS = (
    "Cells: largest error observed, in percent of the error allowed (?: nothing could be "
    "checked, ·: not concerned)."
)


def scenes_table(runs: Mapping[str, Run]) -> Table:
    """Return claims × scenes; a cell is the worst observed / allowed."""
    made = table([*words("claim"), *numbers(*runs)], pad_edge=False)
    columns = [group(run.findings, lambda f: f.claim) for run in runs.values()]
    for id in CLAIMS:
        if any(id in found for found in columns):
            made.add_row(id, *(_cell(found.get(id, [])) for found in columns))
    made.add_section()
    for what, count in (
        ("states", lambda run: run.cases),
        ("findings", lambda run: len(run.findings)),
        ("of them inconclusive", lambda run: _open(run.findings)),
        ("refused by some", lambda run: sum(bool(one.refused) for one in run.drawn)),
        ("time", lambda run: f"{sum(run.seconds.values()):.0f} s"),
    ):
        made.add_row(what, *(str(count(run)) for run in runs.values()))
    return made


def print_scenes(runs: Mapping[str, Run], selection: Selection) -> None:
    """Print one table of all scenes, and what fails on each."""
    _print_head(sum(run.cases for run in runs.values()), selection)
    console.print(scenes_table(runs))
    console.print(CELLS)
    failing = [run for run in runs.values() if print_failures(run)]
    if not failing:
        _print_passed([finding for run in runs.values() for finding in run.findings])


def print_run(run: Run, selection: Selection) -> None:
    """Print the table, what it says, and the smallest failing state as Python."""
    _print_head(run.cases, selection)
    console.print(findings_table(run, selection))
    console.print(CELLS)
    certified = [f for f in run.findings if f.digits is not None]
    if certified:
        found = group(certified, lambda f: f.subject)
        digits = {key: [f.digits or 0.0 for f in mine] for key, mine in found.items()}
        console.print("q̈ in doubles against its true value, enclosed:")
        columns = ("formulation", "states solved", "certified digits: fewest", "median")
        rows = [
            (key, str(len(values)), f"{min(values):.1f}", f"{median(values):.1f}")
            for key, values in digits.items()
        ]
        console.print(Sheet("digits", "", columns, rows).text(console.width))
    for finding in run.findings:
        if finding.claim == "coverage":
            console.print(f"coverage: {finding.detail}")
    if not print_failures(run):
        _print_passed(run.findings)


def _print_head(states: int, selection: Selection) -> None:
    engines = ", ".join(engine.version() for engine in selection.engines) or "no engine"
    console.print(f"eomcheck {__version__}, {engines}, {states} states")


def _open(findings: list[Finding]) -> int:
    return sum(finding.verdict == "inconclusive" for finding in findings)


def _print_passed(findings: list[Finding]) -> None:
    open_ = _open(findings)
    passed = len(findings) - open_
    console.print(f"[bold green]{passed} findings passed, {open_} inconclusive, 0 failed.[/]")


def print_failures(run: Run) -> bool:
    """Print what fails, and the smallest failing state as Python; return whether anything does."""
    failed = [finding for finding in run.findings if finding.verdict == "failed"]
    for found in group(failed, lambda f: (f.claim, f.subject)).values():
        console.print(escape(str(found[0])), style="red", highlight=False, soft_wrap=True)
    smallest = run.minimal or next((f for f in failed if f.claim != "coverage"), None)
    if smallest is None:
        return bool(failed)
    console.print("\nThe smallest failing state found, to paste into Python:\n")
    code = smallest.as_python()
    console.print(code, markup=False, highlight=False, soft_wrap=True)
    return True


def write_json(path: Path, runs: Iterable[Run], selection: Selection) -> None:
    """Write every Finding of `runs`, each case once, to `path`."""
    runs = list(runs)
    minimal = [run.minimal.as_python() for run in runs if run.minimal is not None]
    cases: list[dict[str, Any]] = []
    index: dict[int, int] = {}
    rows = []
    for finding in [finding for run in runs for finding in run.findings]:
        row = finding.as_dict()
        case = {key: row.pop(key) for key in ("scene", "q", "v", "t") if key in row}
        state = id(finding.state.q if finding.state is not None else finding.scene)
        if state not in index:
            index[state] = len(cases)
            cases.append(case)
        rows.append(row | {"case": index[state]})
    document = {
        "engines": [engine.version() for engine in selection.engines],
        "formulations": [formulation.key for formulation in selection.formulations],
        "claims": {
            id: {"statement": CLAIMS[id].statement, "equations": CLAIMS[id].equations}
            for id in selection.claims
        },
        "cases": cases,
        "findings": rows,
        "minimal": minimal[0] if minimal else None,
    }
    write_document(path, document)
