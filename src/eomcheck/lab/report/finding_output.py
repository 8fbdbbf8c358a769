"""Output of findings: validations, proofs and fuzzing campaigns on a terminal, findings as JSON.

A terminal shows the verdict, the failures, then unresolved and skipped findings, tables where they
are asked for, and last the code that reproduces a failure.
The JSON document contains each state once; findings refer to it by index. A campaign shows its
counts, its failures one per cause, and while it runs a line of progress.
"""

from __future__ import annotations

import re
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from eomcheck import __version__
from eomcheck.claims import CLAIMS
from eomcheck.claims.findings import INDENT
from eomcheck.claims.run import RunSelection, ValidationRun
from eomcheck.console import console, report_progress
from eomcheck.draws.fuzz_cases import FAMILIES
from eomcheck.engines import Engine, represents, version_of
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.fuzzing.campaign import Campaign
from eomcheck.lab.fuzzing.failures import ReplayResult
from eomcheck.lab.fuzzing.motion_rounds import CROSSED, STOPPED
from eomcheck.lab.fuzzing.screening import DECIDED, OPEN
from eomcheck.lab.fuzzing.state_rounds import SKIPPED, FunctionsPlan
from eomcheck.lab.proofs import Proofs
from eomcheck.lab.report.equations_output import print_failure, print_passed, print_verdict
from eomcheck.lab.report.overview import (
    ClaimSummary,
    by_claim,
    claim_link,
    digits_table,
    factor_table,
    participant_table,
    participants,
    scene_table,
    worst_table,
)
from eomcheck.lab.show.table import Cell, ResultTable, print_tables, say, table_of
from eomcheck.lab.show.table import write_json as write_document
from eomcheck.lab.store.record_file import group
from eomcheck.lab.store.validation_runs import StoredFinding, stored_findings_of_runs
from eomcheck.safe_output import counted, listed, printable

# ---- Validation ----------------------------------------------------------------------------------


def print_runs(
    runs: Mapping[str, ValidationRun], selection: RunSelection, wide: bool = False
) -> None:
    """Print the verdict, the failures, undecided claims, and the smallest failing state as code.

    Args:
        runs: key of a scene class -> its run; several have a table of their states.
        selection: formulations, engines and claims of the runs.
        wide: print the tables of claims (by formulation and engine, or by scene), of digits and of
            sampled states too.
    """
    engines = ", ".join(_called(e, selection) for e in selection.engines) or "no engine"
    states = sum(run.cases for run in runs.values())
    rows = stored_findings_of_runs(runs)
    said = f"{counted(states, 'state')}, {counted(len(rows), 'finding')}"
    scenes = next(iter(runs)) if len(runs) == 1 else counted(len(runs), "scene")
    say(f"eomcheck {__version__}, {scenes}, {engines}, {said}")
    print_verdict(rows)
    claims = by_claim(rows)
    print_failures(claims)
    for key, run in runs.items():
        if run.minimal is not None:
            say(
                f"{key}: no further states were drawn after this failure: "
                f"{counted(run.cases, 'state')} checked"
            )
    print_unresolved(claims)
    print_skipped(claims)
    asked = any(CLAIMS[claim].asks for claim in selection.claims)
    if len(runs) > 1 and selection.engines_named and asked:
        print_unrepresented(runs, selection.engines)
    print_passed(summary.claim.id for summary in claims if summary.kind == "passed")
    for row in rows:
        if row.claim == "coverage" and len(runs) == 1:
            say(f"coverage: {row.detail}")
    if len(runs) > 1:
        print_tables([ResultTable("runs", "Checked states by scene", *_totals(runs))])
    if wide:
        print_tables(_wide_tables(runs, selection, rows, claims))
    else:
        say("tables of claims, digits and sampled states: --wide")
    for finding in filter(None, map(_smallest, runs.values())):
        say(f"\nThe smallest failing state, of {finding.location}, to paste into Python:\n")
        say(finding.as_python())


def _wide_tables(
    runs: Mapping[str, ValidationRun],
    selection: RunSelection,
    rows: Sequence[StoredFinding],
    claims: Sequence[ClaimSummary],
) -> Iterator[ResultTable]:
    """Yield the tables of claims, by participant or by scene, of digits and of sampled states."""
    yield worst_table(claims)
    if len(runs) == 1:
        (run,) = runs.values()
        names = [p.key for p in (*selection.formulations, *selection.engines)]
        yield participant_table(claims, names, run.seconds)
        if (digits := digits_table(rows)).rows:
            yield digits
    else:
        yield scene_table(claims, runs).without("statement", "evidence")
    counts = {key: run.level_counts for key, run in runs.items() if run.sampled}
    if counts:
        yield factor_table(counts)


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
        "refused": lambda run: sum(bool(r.refused) for r in run.sampled),
        "time": lambda run: f"{sum(run.seconds.values()):.0f} s",
    }
    rows = [[key, *(str(count(run)) for count in counts.values())] for key, run in runs.items()]
    return ["scene", *counts], rows


def _count(run: ValidationRun, verdict: str) -> int:
    return sum(f.verdict == verdict for f in run.findings)


def _smallest(run: ValidationRun) -> Any:
    failed = (f for f in run.findings if f.verdict == "failed" and f.claim != "coverage")
    return run.minimal or next(failed, None)


def print_failures(claims: Iterable[ClaimSummary]) -> None:
    """Print the worst failed Finding of each claim on each scene, and the number of the others.

    Claims that fail by one formulation on a scene are one block: the first, and the names of those
    after it.
    """
    blocks: list[_Block] = []
    for summary in claims:
        for failed in group(summary.failed, lambda row: row.scene).values():
            row = max(failed, key=lambda row: row.ratio)
            common = _failing_formulations(failed)
            same = [x for x in blocks if x.row.scene == row.scene and x.formulations & common]
            if same:
                k = blocks.index(same[0])
                claims_too = (*same[0].claims_too, row.claim)
                joined = same[0].formulations & common
                blocks[k] = same[0]._replace(formulations=joined, claims_too=claims_too)
            else:
                blocks.append(_Block(row, len(failed) - 1, common))
    for block in blocks:
        print_failure(block.row)
        if block.others:
            say(f"{INDENT}and {counted(block.others, 'further subject')} of this claim")
        if block.claims_too:
            names = ", ".join(sorted(block.formulations))
            say(f"{INDENT}by {names} too: {', '.join(block.claims_too)}")


class _Block(NamedTuple):
    """Block of a failure.

    Attributes:
        row: the worst failed Finding of a claim on a scene.
        others: number of further subjects of this claim that fail.
        formulations: keys that take part in every failure of the block.
        claims_too: claims that fail by these formulations too.
    """

    row: StoredFinding
    others: int
    formulations: frozenset[str]
    claims_too: tuple[str, ...] = ()


def _failing_formulations(rows: Sequence[StoredFinding]) -> frozenset[str]:
    """Return the formulations that take part in each of some failures, none if engines do."""
    parties = [frozenset(participants(row)) for row in rows]
    if not all(one <= FORMULATIONS.keys() for one in parties):
        return frozenset()
    return frozenset.intersection(*parties)


def print_unrepresented(runs: Mapping[str, ValidationRun], engines: Iterable[type[Engine]]) -> None:
    """Print the scene classes of which an engine represents no checked state: nothing was
    compared.
    """
    for key, run in runs.items():
        subjects = {word for f in run.findings for word in f.subject.split(" ~ ")}
        for engine in engines:
            if engine.key in subjects or any(represents(engine, r.scene) for r in run.sampled):
                continue
            states = counted(run.cases, "state")
            say(f"skipped: {key}, {states}: {engine.key} represents none of them")


AS_LARGE = "the rounding error is as large as the value"


def print_unresolved(claims: Iterable[ClaimSummary]) -> None:
    """Print what is resolved in no state, which tables show as passed, or else in some states."""
    for summary in claims:
        for row in summary.unresolved:
            say(f"inconclusive: {summary.claim.id} on {row.scene}: {row.detail}")
        some = [row for row in summary.rows if row.verdict == "inconclusive"]
        # Coverage counts states; of a few it is inconclusive, and its table has the number.
        if some and not summary.unresolved and summary.claim.id != "coverage":
            states = counted(len({row.location for row in some}), "state")
            subjects = listed([*dict.fromkeys(row.subject for row in some)], 3)
            first = max(some, key=lambda row: row.ratio)
            why = first.detail or AS_LARGE
            say(f"inconclusive: {summary.claim.id} [{subjects}] at {states}: {why}")


def print_skipped(claims: Iterable[ClaimSummary]) -> None:
    """Print the skipped checks with their reasons."""
    for summary in claims:
        for subject, (first, *_) in group(summary.skipped, lambda row: row.subject).items():
            say(f"skipped: {summary.claim.id} [{subject}] on {first.location}: {first.detail}")


# ---- Proofs --------------------------------------------------------------------------------------


def proof_table(claims: Iterable[ClaimSummary]) -> ResultTable:
    """Return the table of proofs by claim: verdicts, degrees, heights and failure probability."""

    def count(verdict: str) -> Callable[[ClaimSummary], str]:
        return lambda s: str(sum(row.verdict == verdict for row in s.rows) or "")

    def bound(name: str, form: str) -> Callable[[ClaimSummary], str]:
        def cell(summary: ClaimSummary) -> str:
            values = [getattr(row.proof, name) for row in summary.rows if row.proof is not None]
            return form.format(max(values)) if values else ""

        return cell

    columns = {
        "claim": claim_link,
        "statement": lambda s: s.claim.statement,
        "proved": count("passed"),
        "disproved": count("failed"),
        "skipped": count("skipped"),
        "degree ≤": bound("degree", "{}"),
        "height ≤": bound("height", "{:.0f} bits"),
        "failure probability <": bound("failure_probability", "{:.1e}"),
    }
    return table_of("proofs", "", claims, columns.items())


def print_proofs(proofs: Proofs) -> None:
    """Print the table, the skipped claims, the failure probability in all, the seed, and last the
    verdict.
    """
    rows = [f for findings in proofs.findings.values() for f in findings]
    claims = by_claim(rows)
    if not claims:
        console.print("nothing was proved")
        return
    print_tables([proof_table(claims)])
    say(
        "degree, height: of the polynomial that vanishes if the claim holds; its height is log₂ of "
        "the sum of the magnitudes of its coefficients. failure probability: that a claim passes "
        "although it is false."
    )
    print_skipped(claims)
    if proofs.started_over:
        console.print("an unfinished file of other settings or sources was started over")
    verdicts = group(rows, lambda row: row.verdict)
    if "passed" in verdicts:
        console.print(
            f"Had any identity been false, all its points would have hidden it with a probability "
            f"below {sum(s.failure_probability or 0.0 for s in claims):.1e} ({proofs.jobs.points} "
            "random points and primes each)."
        )
    console.print(f"seed {proofs.seed}", style="dim")
    done, total = len(proofs.findings), len(proofs.jobs.scenes)
    failed = len(verdicts.get("failed", []))
    earlier = f" ({proofs.taken_over} of them in an earlier run)" if proofs.taken_over else ""
    console.print(
        f"[bold {'red' if failed else 'green'}]"
        f"{counted(len(verdicts.get('passed', [])), 'identity')} proved, "
        f"{failed} disproved[/] on {done} of {counted(total, 'structure')}{earlier}"
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


# ---- Fuzzing campaigns ---------------------------------------------------------------------------

SCREENING = {
    "passed in lanes": "screened: within the bound",
    "failed in lanes": "screened: beyond it, which is checked again one by one",
    "inconclusive in lanes": "screened: not decided",
    "suspect": "states beyond it",
    "suspects judged": "of these checked again",
    "unlifted": "states checked by claims that are not screened",
}
"""Name of a count of a campaign -> its label; every other count is labelled by its name."""

EVERY = 10.0
"""Seconds between two lines of progress."""


class ProgressPrinter:
    """Prints progress of a campaign: states, their rate, the worst ratio, number of failures."""

    def __init__(self) -> None:
        self._start = self._last = time.perf_counter()

    def __call__(self, campaign: Campaign) -> None:
        """Print a line if the last one is older than `EVERY`."""
        now = time.perf_counter()
        if now - self._last < EVERY:
            return
        self._last = now
        new = campaign.states - campaign.resumed
        worst = max(campaign.worst.items(), key=lambda item: item[1].score, default=None)
        high = ""
        if worst is not None:
            (claim, formulation), candidate = worst
            high = f"; worst {candidate.score:.2g}, {f'{claim} {formulation}'.strip()}"
        states = counted(campaign.states, campaign.plan.noun)
        rate = f"{states}, {new / (now - self._start):.0f} a second"
        report_progress(f"{rate}{high}; {counted(len(campaign.failure_records), 'failure')}")


def rate_of(campaign: Campaign) -> float:
    """Return states per second of CPU time."""
    return campaign.states / campaign.cpu_seconds if campaign.cpu_seconds else 0.0


def campaign_table(campaign: Campaign) -> ResultTable:
    """Return the table of counts: states or trajectories checked, by family and by method of
    checking.
    """
    counts = campaign.counts
    rows = [
        (f"{campaign.plan.noun}s", str(campaign.states)),
        ("a second of CPU time", f"{rate_of(campaign):.0f}"),
        ("rounds", str(campaign.rounds)),
    ]
    rows += [(name, str(counts[name])) for name in (*FAMILIES, "climbed") if counts[name]]
    shown = {name for name, _ in rows} | {"states"}
    rows += [
        (SCREENING.get(name, name), str(x))
        for name, x in sorted(counts.items())
        if x
        and name not in shown
        and not name.startswith((CROSSED, STOPPED, OPEN, DECIDED, SKIPPED))
    ]
    undecided = sorted(name.removeprefix(OPEN) for name in counts if name.startswith(OPEN))
    rows += [
        (f"{claim}: decided in no state", f"{counts[OPEN + claim]} inconclusive")
        for claim in undecided
        if counts[OPEN + claim] and not counts[DECIDED + claim]
    ]
    rows += [(f"not in lanes: {claim}", why) for claim, why in sorted(campaign.not_batched.items())]
    return ResultTable(
        "fuzzing", f"Fuzzing {campaign.name}, seed {campaign.plan.seed}", ("what", "how many"), rows
    )


def variant_table(campaign: Campaign) -> ResultTable:
    """Return the number of states by structural variant, and the number of those without any."""
    counts, noun = campaign.by_variant, f"{campaign.plan.noun}s"
    names = [variant.name for variant in campaign.variants if counts[variant.name]]
    rows = [(_variant_label(name), str(counts[name])) for name in names]
    if others := len(campaign.variants) - len(names):
        rows.append((f"{others} more" if names else counted(others, "structure"), "none"))
    return ResultTable("strata", f"{noun.capitalize()} by structure", ("structure", noun), rows)


def _variant_label(name: str) -> str:
    # Stored records identify structural variants by these names, so the names themselves stay.
    return re.sub(r"^1 links\b", "1 link", name)


def crossing_table(campaign: Campaign) -> ResultTable | None:
    """Return the number of trajectories through singular configurations (a_1 singular), by
    formulation.
    """
    counts = campaign.counts
    keys = [key for key in FORMULATIONS if counts[CROSSED + key] or counts[STOPPED + key]]
    rows = [(key, str(counts[CROSSED + key]), str(counts[STOPPED + key])) for key in keys]
    columns = "formulation", "crossed", "stopped before, or refused"
    return ResultTable("crossings", "Poses where a_1 is singular", columns, rows) if rows else None


def highest_score_table(campaign: Campaign) -> ResultTable:
    """Return the largest observed / allowed of each claim, and its formulation."""
    best: dict[str, tuple[float, str]] = defaultdict(lambda: (0.0, ""))
    for (claim, formulation), candidate in campaign.worst.items():
        best[claim] = max(best[claim], (candidate.score, formulation))
    rows = [(claim, f"{score:.2g}", f) for claim, (score, f) in sorted(best.items())]
    return ResultTable(
        "worst", "Observed / allowed at most", ("claim", "ratio", "formulation"), rows
    )


def failure_table(campaign: Campaign) -> ResultTable:
    """Return the table of failures, one per cause."""
    rows = [
        (Cell(r.claim, "failed"), r.subject, r.whose, r.detail, r.evidence)
        for r in campaign.failure_records.values()
    ]
    columns = "claim", "subject", "fault", "what", "evidence"
    return ResultTable("failures", "Failures", columns, rows, (10, 10, 8, 20, 30))


def print_replayed(results: Sequence[ReplayResult]) -> None:
    """Print the number of stored failures by present outcome, and the reason or code of each that
    does not hold.
    """
    counts = Counter(r.outcome for r in results)
    inconclusive = f", {counts['inconclusive']} inconclusive" if counts["inconclusive"] else ""
    unchecked = f", {counts['not checked']} not checked" if counts["not checked"] else ""
    say(
        f"{counted(len(results), 'failure')}: {counts['holds']} hold now, {counts['failed']} fail"
        f"{inconclusive}{unchecked}"
    )
    for number, (failure, outcome, reason) in enumerate(results, 1):
        if outcome == "failed":
            say(printable(str(failure)))
            print(failure.python)
        elif outcome != "holds":
            about = f"failure {number}, {failure.claim or 'all claims'} on {failure.scene}"
            say(printable(f"{outcome}: {about}: {reason}"))


def print_campaign(campaign: Campaign) -> None:
    """Print the result of a campaign: tables, code that reproduces each failure, and undecided
    claims.
    """
    sheets = [campaign_table(campaign), variant_table(campaign), crossing_table(campaign)]
    worst = highest_score_table(campaign)
    print_tables([*(sheet for sheet in sheets if sheet is not None), *[worst] * bool(worst.rows)])
    if campaign.failure_records:
        print_tables([failure_table(campaign)])
        for failure in campaign.failure_records.values():
            print(f"# {failure}\n{failure.python}")
    elif campaign.states:
        print("no failure")
    else:
        print(f"nothing was checked: no {campaign.plan.noun} came to its end")
    if isinstance(campaign.plan, FunctionsPlan) and campaign.states:
        for line in campaign.plan.caveats(campaign.counts, campaign.undecided, campaign.entries):
            say(printable(line))
