"""Output of findings: a validation or proofs on a terminal, and findings as a JSON document.

A terminal shows tables of claims, then the skipped and the unresolved findings, and the failures
last. The JSON document contains each state once; findings refer to it by index.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from eomcheck import __version__
from eomcheck.claims import CLAIMS
from eomcheck.claims.run import RunSelection, ValidationRun
from eomcheck.console import console
from eomcheck.engines import Engine, represents, version_of
from eomcheck.lab.proofs import Proofs
from eomcheck.lab.report.claim_summary import (
    ClaimSummary,
    by_claim,
    claim_link,
    digits_table,
    factor_table,
    participant_table,
    scene_table,
    worst_table,
)
from eomcheck.lab.show.document_text import write_json as write_document
from eomcheck.lab.show.table import ResultTable, print_tables, say
from eomcheck.lab.store.record_file import group
from eomcheck.lab.store.stored_findings import stored_findings_of_runs
from eomcheck.safe_output import counted

# ---- Validation ----------------------------------------------------------------------------------


def print_runs(
    runs: Mapping[str, ValidationRun], selection: RunSelection, wide: bool = False
) -> None:
    """Print the table of claims, notes on it, and the smallest failing state as Python code.

    Args:
        runs: key of a scene class -> its run; for several, the table has one column per scene.
        selection: formulations, engines and claims of the runs.
        wide: show each formulation and engine, or each scene, beside the worst of them.
    """
    engines = ", ".join(_called(one, selection) for one in selection.engines) or "no engine"
    states = sum(run.cases for run in runs.values())
    say(f"eomcheck {__version__}, {engines}, {counted(states, 'state')}")
    rows = stored_findings_of_runs(runs)
    claims = by_claim(rows)
    if len(runs) == 1:
        (run,) = runs.values()
        names = [one.key for one in (*selection.formulations, *selection.engines)]
        table = participant_table(claims, names, run.seconds) if wide else worst_table(claims)
        print_tables(sheet for sheet in (table, digits_table(rows)) if sheet.rows)
        for row in rows:
            if row.claim == "coverage":
                say(f"coverage: {row.detail}")
    else:
        table = worst_table(claims)
        if wide:
            table = scene_table(claims, runs).without("statement", "evidence")
        print_tables([table, ResultTable("runs", "What was looked at", *_totals(runs))])
        if selection.engines_named and any(CLAIMS[claim].asks for claim in selection.claims):
            print_unrepresented(runs, selection.engines)
    counts = {key: run.level_counts for key, run in runs.items() if run.sampled}
    if counts and (wide or len(runs) == 1):
        print_tables([factor_table(counts)])
    print_skipped(claims)
    print_unresolved(claims)
    smallest = [_smallest(run) for run in runs.values()]
    for finding in filter(None, smallest):
        console.print("\nThe smallest failing state found, to paste into Python:\n")
        say(finding.as_python())
    print_failures(claims)  # last of all, where a terminal shows it
    if failed := sum(row.verdict == "failed" for row in rows):
        say(f"{failed} of {counted(len(rows), 'finding')} failed.", "bold red")
    else:
        whole = ClaimSummary(tuple(rows))
        passed = len(rows) - whole.undecided_count
        say(f"{counted(passed, 'finding')} passed{whole.undecided}, 0 failed.", "bold green")


def _called(engine: type[Engine], selection: RunSelection) -> str:
    reads = " (reads the file itself)" if engine is selection.reader else ""
    return version_of(engine) + reads


def _totals(runs: Mapping[str, ValidationRun]) -> tuple[list[str], list[list[str]]]:
    """Return the table of runs by scene (states, findings, verdicts, time): headings and rows."""
    counts = {
        "states": lambda run: run.cases,
        "findings": lambda run: len(run.findings),
        "inconclusive": lambda run: _count(run, "inconclusive"),
        "skipped": lambda run: _count(run, "skipped"),
        "refused": lambda run: sum(bool(one.refused) for one in run.sampled),
        "time": lambda run: f"{sum(run.seconds.values()):.0f} s",
    }
    rows = [[key, *(str(of(run)) for of in counts.values())] for key, run in runs.items()]
    return ["scene", *counts], rows


def _count(run: ValidationRun, verdict: str) -> int:
    return sum(one.verdict == verdict for one in run.findings)


def _smallest(run: ValidationRun) -> Any:
    failed = (one for one in run.findings if one.verdict == "failed" and one.claim != "coverage")
    return run.minimal or next(failed, None)


def print_failures(claims: Iterable[ClaimSummary]) -> None:
    """Print the worst failed Finding of each claim on each scene, and the number of the others."""
    for one in claims:
        for failed in group(one.failed, lambda row: row.scene).values():
            row, others = max(failed, key=lambda row: row.ratio), len(failed) - 1
            more = f" (and {others} more of this claim)" if others else ""
            say(f"{row.claim} {row}{more}", "red")


def print_unrepresented(runs: Mapping[str, ValidationRun], engines: Iterable[type[Engine]]) -> None:
    """Print the scene classes of which an engine represents no checked state: nothing was
    compared.
    """
    for key, run in runs.items():
        subjects = {word for one in run.findings for word in one.subject.split(" ~ ")}
        for engine in engines:
            if engine.key in subjects or any(represents(engine, one.scene) for one in run.sampled):
                continue
            states = counted(run.cases, "state")
            say(f"skipped: {key}, {states}: {engine.key} represents none of them")


def print_unresolved(claims: Iterable[ClaimSummary]) -> None:
    """Print the entries that are resolved in no state; tables show them as passed."""
    for one in claims:
        for row in one.unresolved:
            say(f"inconclusive: {one.claim.id} on {row.scene}: {row.detail}")


def print_skipped(claims: Iterable[ClaimSummary]) -> None:
    """Print the skipped checks with their reasons."""
    for one in claims:
        for subject, (first, *_) in group(one.skipped, lambda row: row.subject).items():
            say(f"skipped: {one.claim.id} [{subject}] on {first.location}: {first.detail}")


# ---- Proofs --------------------------------------------------------------------------------------


def proof_table(claims: Iterable[ClaimSummary]) -> ResultTable:
    """Return the table of proofs by claim: verdicts, degrees, heights and failure probability."""
    counts = {"proved": "passed", "disproved": "failed", "skipped": "skipped"}
    bounds = "degree ≤", "height ≤", "failure probability <"
    rows = []
    for one in claims:
        of = group(one.rows, lambda row: row.verdict)
        proofs = [row.proof for row in one.rows if row.proof is not None]
        rows.append(
            [
                claim_link(one),
                one.claim.statement,
                *(str(len(of[verdict])) if verdict in of else "" for verdict in counts.values()),
                str(max((p.degree for p in proofs), default="")),
                f"{max(p.height for p in proofs):.0f} bits" if proofs else "",
                f"{max(p.failure_probability for p in proofs):.1e}" if proofs else "",
            ]
        )
    return ResultTable("proofs", "", ["claim", "statement", *counts, *bounds], rows)


def print_proofs(proofs: Proofs) -> None:
    """Print the table, the total failure probability, and every disproof."""
    rows = [one for found in proofs.findings.values() for one in found]
    claims = by_claim(rows)
    if not claims:
        console.print("nothing was proved")
        return
    print_tables([proof_table(claims)])
    print_skipped(claims)
    if proofs.started_over:
        console.print("an unfinished file of other settings or sources was started over")
    of = group(rows, lambda row: row.verdict)
    done, asked, failed = len(proofs.findings), len(proofs.jobs.scenes), len(of.get("failed", []))
    earlier = f" ({proofs.taken_over} of them in an earlier run)" if proofs.taken_over else ""
    console.print(
        f"[bold {'red' if failed else 'green'}]"
        f"{counted(len(of.get('passed', [])), 'identity')} proved, "
        f"{failed} disproved[/] on {done} of {counted(asked, 'structure')}{earlier}"
    )
    if "passed" not in of:
        return
    console.print(
        f"Had any of them been false, all its points would have hidden it with a probability below "
        f"{sum(one.failure_probability or 0.0 for one in claims):.1e} ({proofs.jobs.points} random "
        f"points and primes each, seed {proofs.seed})."
    )


# ---- JSON ----------------------------------------------------------------------------------------


def write_findings(path: Path, runs: Iterable[ValidationRun], selection: RunSelection) -> None:
    """Write every Finding of `runs`, each state once, to a JSON file."""
    runs = list(runs)
    minimal = [run.minimal.as_python() for run in runs if run.minimal is not None]
    cases: list[dict[str, Any]] = []
    index: dict[int, int] = {}
    rows = []
    for finding in [finding for run in runs for finding in run.findings]:
        state = finding.state
        case = id(finding.scene if state is None else state.q)
        if case not in index:
            index[case] = len(cases)
            cases.append({} if state is None else finding.place)
        rows.append(finding.as_dict(whole=state is None) | {"case": index[case]})
    document = {
        "engines": [version_of(engine) for engine in selection.engines],
        "formulations": [formulation.key for formulation in selection.formulations],
        "claims": {
            id: {"statement": CLAIMS[id].statement, "equations": CLAIMS[id].equations}
            for id in selection.claims
        },
        "factors": {run.sampled[0].scene.key: run.level_counts for run in runs if run.sampled},
        "cases": cases,
        "findings": rows,
        "minimal": minimal[0] if minimal else None,
    }
    write_document(path, document)
