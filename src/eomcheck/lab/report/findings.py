"""Findings as tables of claims, on a terminal, and as JSON."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any

from eomcheck import __version__
from eomcheck.claims import CLAIMS
from eomcheck.claims.finding import DECIDED
from eomcheck.claims.run import Run
from eomcheck.claims.selection import Selection
from eomcheck.console import console
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.proofs import Proofs
from eomcheck.lab.report.judged import LEVELS, Judged, anchor, by_claim
from eomcheck.lab.show.sheet import Cell, Sheet, print_sheets, say
from eomcheck.lab.show.templating import number
from eomcheck.lab.show.text import write_json as write_document
from eomcheck.lab.store.findings import kept_of_runs
from eomcheck.lab.store.groups import group
from eomcheck.lab.store.kept import Kept
from eomcheck.output import counted

CELLS = (
    "Cells: largest error observed, in percent of the error allowed (?: nothing could be "
    "checked, ·: not concerned)."
)
WORST = (
    "worst: largest error observed, in percent of the error allowed (?: nothing could be checked), "
    "by whom and in which state (scene[links] #state); inconclusive: rounding explains any "
    "difference. --wide tells formulations, engines and scenes apart."
)

# ---- Tables --------------------------------------------------------------------------------------


def _name(judged: Judged) -> Cell:
    return Cell(judged.claim.id, "name", f"#claim-{judged.claim.id}")


def party_sheet(
    claims: Iterable[Judged], names: Sequence[str], seconds: Mapping[str, float] | None = None
) -> Sheet:
    """Return claims × formulations and engines; a cell is the worst observed / allowed.

    Args:
        claims: what was found.
        names: keys of the formulations and engines.
        seconds: id of a claim -> what looking at it took, if that is to be told.
    """
    rows = []
    for one in claims:
        cells = [_name(one), one.cell, *(one.of(name).cell for name in names), one.evidence]
        time = [] if seconds is None else [f"{seconds.get(one.claim.id, 0.0):.1f} s"]
        rows.append(cells + time)
    columns = ["claim", "all", *names, "evidence, findings"]
    return Sheet("claims", "", columns + ([] if seconds is None else ["time"]), rows, note=CELLS)


def worst_sheet(claims: Iterable[Judged]) -> Sheet:
    """Return what is worst of each claim: observed / allowed, by whom, and where."""
    rows = []
    for one in claims:
        worst = one.worst if one.kind in DECIDED and one.text != "0" else None
        by, on = ("·", "·") if worst is None else (worst.subject, where(worst))
        rows.append([_name(one), one.cell, by, on, f"{len(one.rows)}{one.undecided}"])
    columns = ["claim", "worst", "by", "on", "findings"]
    return Sheet("worst", "", columns, rows, note=WORST)


def where(row: Kept) -> str:
    """Return the scene and the number of the state of a Finding, in short."""
    links = "" if row.links is None else f"[{row.links}]"
    return f"{row.scene}{links}" + ("" if row.case is None else f" #{row.case}")


def scene_sheet(claims: Iterable[Judged], scenes: Iterable[str]) -> Sheet:
    """Return claims × scenes, with what a claim says; a cell is the worst observed / allowed."""
    scenes = list(scenes)
    rows = []
    for one in claims:
        cells = (one.scenes.get(scene, Judged(())).cell for scene in scenes)
        rows.append([_name(one), one.claim.statement, ", ".join(one.levels), *cells])
    return Sheet("claims", "", ["claim", "statement", "evidence", *scenes], rows, note=CELLS)


def evidence_sheet(judged: Judged) -> Sheet:
    """Return what a claim rests on: scenes × levels of evidence."""
    found = judged.by(lambda row: (row.scene, row.level))
    levels = dict.fromkeys((*LEVELS, *judged.levels))
    columns = ["scene", "evidence", "N", "states", "findings", "inconclusive"]
    rows = [
        [scene, level, *_evidence(found[scene, level])]
        for scene in judged.scenes
        for level in levels
        if (scene, level) in found
    ]
    return Sheet("", "", [*columns, "ratio", "observed", "allowed", "where"], rows)


def _evidence(one: Judged) -> list[str]:
    worst, sure = one.worst, one.failure_probability
    assert worst is not None
    cells = [one.links, str(one.states or "all"), str(len(one.rows)), str(one.open or "")]
    if sure is not None:
        told = (
            f"{counted(len(one.rows), 'identity')}, wrong with a probability below {number(sure)}"
        )
        return [*cells, "", "", "", Cell(told, link=f"#{anchor(worst)}")]
    where = f"{worst.subject}, {f'state {worst.case}' if worst.case is not None else worst.place}"
    link = Cell(where if worst.ratio else "", link=f"#{anchor(worst)}")
    return [*cells, one.cell, number(worst.observed), number(worst.allowed), link]


def proof_sheet(claims: Iterable[Judged]) -> Sheet:
    """Return what was proved of each claim, and how surely."""
    counts = {"proved": "passed", "disproved": "failed", "not looked at": "not looked at"}
    bounds = "degree ≤", "height ≤", "failure probability <"
    rows = []
    for one in claims:
        of = group(one.rows, lambda row: row.verdict)
        proofs = [row.proof for row in one.rows if row.proof is not None]
        rows.append(
            [
                _name(one),
                one.claim.statement,
                *(str(len(of[verdict])) if verdict in of else "" for verdict in counts.values()),
                str(max((p.degree for p in proofs), default="")),
                f"{max(p.height for p in proofs):.0f} bits" if proofs else "",
                f"{max(p.failure_probability for p in proofs):.1e}" if proofs else "",
            ]
        )
    return Sheet("proofs", "", ["claim", "statement", *counts, *bounds], rows)


def digits_sheet(rows: Iterable[Kept]) -> Sheet:
    """Return the certified digits of v̇ of each formulation on each scene: fewest and median."""
    certified = group([row for row in rows if row.digits is not None], lambda row: row.subject)
    scenes = list(dict.fromkeys(row.scene for found in certified.values() for row in found))
    made = []
    for key in (key for key in FORMULATIONS if key in certified):
        on = group(certified[key], lambda row: row.scene)
        cells = (_digits([row.digits or 0.0 for row in on.get(scene, [])]) for scene in scenes)
        made.append((key, str(len(certified[key])), *cells))
    title = "Decimal digits of q̈ in doubles that are right, against its true value: fewest (median)"
    return Sheet("digits", title, ("formulation", "states solved", *scenes), made)


def _digits(digits: list[float]) -> str:
    return f"{min(digits):.1f} ({median(digits):.1f})" if digits else "·"


def strata_sheet(strata: Mapping[str, Mapping[str, Mapping[str, int]]]) -> Sheet:
    """Return the strata that were drawn from.

    Args:
        strata: key of a kind of scene -> name of a stratum -> way -> number of states.
    """
    rows = [
        (scene, name, ", ".join(_ways(ways)))
        for scene, of in strata.items()
        for name, ways in of.items()
    ]
    return Sheet("strata", "Drawn states by stratum", ("scene", "stratum", "states"), rows)


def _ways(ways: Mapping[str, int]) -> Iterator[str]:
    """Yield each way with its states in brackets, the first time with the word for them."""
    for i, (way, states) in enumerate(ways.items()):
        yield f"{way} ({states if i else counted(states, 'state')})"


# ---- On a terminal -------------------------------------------------------------------------------


def print_runs(runs: Mapping[str, Run], selection: Selection, wide: bool = False) -> None:
    """Print the table, what it says, and the smallest failing state as Python.

    Args:
        runs: key of a kind of scene -> its run. Of several the table is one of scenes.
        selection: what took part.
        wide: show each formulation and engine, or each scene, beside the worst of them.
    """
    engines = ", ".join(engine.version() for engine in selection.engines) or "no engine"
    states = sum(run.cases for run in runs.values())
    say(f"eomcheck {__version__}, {engines}, {counted(states, 'state')}")
    rows = kept_of_runs(runs)
    claims = by_claim(rows)
    if len(runs) == 1:
        (run,) = runs.values()
        names = [one.key for one in (*selection.formulations, *selection.engines)]
        table = party_sheet(claims, names, run.seconds) if wide else worst_sheet(claims)
        print_sheets(sheet for sheet in (table, digits_sheet(rows)) if sheet.rows)
        for row in rows:
            if row.claim == "coverage":
                say(f"coverage: {row.detail}")
    else:
        whole = scene_sheet(claims, runs).without("statement", "evidence")
        table = whole if wide else worst_sheet(claims)
        print_sheets([table, Sheet("runs", "What was looked at", *_totals(runs))])
    if wide or len(runs) == 1:
        print_sheets([strata_sheet({key: run.strata for key, run in runs.items() if run.drawn})])
    print_unseen(claims)
    smallest = [_smallest(run) for run in runs.values()]
    for finding in filter(None, smallest):
        console.print("\nThe smallest failing state found, to paste into Python:\n")
        say(finding.as_python())
    print_failures(claims)  # last of all, where a terminal shows it
    if failed := sum(row.verdict == "failed" for row in rows):
        say(f"{failed} of {counted(len(rows), 'finding')} failed.", "bold red")
    else:
        whole = Judged(tuple(rows))
        passed = len(rows) - whole.open
        say(f"{counted(passed, 'finding')} passed{whole.undecided}, 0 failed.", "bold green")


def _totals(runs: Mapping[str, Run]) -> tuple[list[str], list[list[str]]]:
    """Return what was looked at on each scene: headings and rows."""
    counts = {
        "states": lambda run: run.cases,
        "findings": lambda run: len(run.findings),
        "inconclusive": lambda run: _count(run, "inconclusive"),
        "not looked at": lambda run: _count(run, "not looked at"),
        "refused": lambda run: sum(bool(one.refused) for one in run.drawn),
        "time": lambda run: f"{sum(run.seconds.values()):.0f} s",
    }
    rows = [[key, *(str(of(run)) for of in counts.values())] for key, run in runs.items()]
    return ["scene", *counts], rows


def _count(run: Run, verdict: str) -> int:
    return sum(one.verdict == verdict for one in run.findings)


def _smallest(run: Run) -> Any:
    failed = (one for one in run.findings if one.verdict == "failed" and one.claim != "coverage")
    return run.minimal or next(failed, None)


def print_failures(claims: Iterable[Judged]) -> None:
    """Print what fails: of each claim the worst Finding on a scene, and how many else there are."""
    for one in claims:
        for failed in group(one.failed, lambda row: row.scene).values():
            row, others = max(failed, key=lambda row: row.ratio), len(failed) - 1
            more = f" (and {others} more of this claim)" if others else ""
            say(f"{row.claim} {row}{more}", "red")


def print_unseen(claims: Iterable[Judged]) -> None:
    """Print what was not looked at, and why."""
    for one in claims:
        for subject, (first, *_) in group(one.unseen, lambda row: row.subject).items():
            say(f"not looked at: {one.claim.id} [{subject}] on {first.place}: {first.detail}")


def print_proofs(proofs: Proofs) -> None:
    """Print the table, the total failure probability, and every disproof."""
    rows = [one for found in proofs.findings.values() for one in found]
    claims = by_claim(rows)
    if not claims:
        console.print("nothing was proved")
        return
    print_sheets([proof_sheet(claims)])
    print_unseen(claims)
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
        "strata": {run.drawn[0].scene.key: run.strata for run in runs if run.drawn},
        "cases": cases,
        "findings": rows,
        "minimal": minimal[0] if minimal else None,
    }
    write_document(path, document)
