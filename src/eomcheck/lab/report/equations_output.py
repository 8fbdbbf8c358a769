"""Output of checked equations of motion and answers: on a terminal, as JSON, as Records of a page.

The first lines name what was read and the verdict. Failures follow, one block per cause: what is
wrong, where, the likely cause, and its numbers. Claims that passed are one line, and what could not
be decided comes last, each with the input that would decide it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

from eomcheck import __version__
from eomcheck.claims.finding import DECIDED, Finding
from eomcheck.claims.findings import causes_of, failure_lines, headline
from eomcheck.console import console
from eomcheck.lab.show.table import say, write_json
from eomcheck.lab.store.record_file import Record
from eomcheck.safe_output import counted
from eomcheck.testing.equations_of_files import FileEquations


def print_equations(
    read: FileEquations, findings: Sequence[Finding], states: int, seed: int, against: str = ""
) -> None:
    """Print the verdict on equations of motion, failures by cause, and what was not decided.

    Args:
        read: the equations, as they were read.
        findings: Findings of all claims.
        states: number of states.
        seed: seed of the states.
        against: name of the reference, "" for none.
    """
    equations = read.equations
    how = f"{counted(states, 'state')}, seed {seed}" + (f", against {against}" if against else "")
    print_checked(f"{equations.structure}; n = {equations.n}; {how}", read.notes, findings)


def print_passed(names: Iterable[str]) -> None:
    """Print the names of what passed, wrapped; nothing if there are none."""
    if text := ", ".join(names):
        console.print(f"\npassed: {text}", markup=False, highlight=False)


def print_verdict(findings: Sequence[Any], counts: str = "claim") -> None:
    """Print the sentence of `headline`: red where something failed, green where all passed, yellow
    where something of it is undecided.
    """
    verdicts = {one.verdict for one in findings}
    decided = {getattr(one, counts) for one in findings if one.verdict in DECIDED}
    whole = decided == {getattr(one, counts) for one in findings}
    passed = "bold green" if whole else "bold yellow"
    style = "bold red" if "failed" in verdicts else passed if "passed" in verdicts else ""
    say(headline(findings, counts), style)


def print_failure(first: Any, *following: Any) -> None:
    """Print the block of lines on a failure, see `failure_lines`."""
    head, *lines = failure_lines(first, *following)
    say("")
    say(head, "red")
    for line in lines:
        say(line)


def print_checked(
    title: str, notes: Iterable[str], findings: Sequence[Finding], counts: str = "claim"
) -> None:
    """Print the verdict on what was checked, failures by cause, and what was not decided.

    Args:
        title: what was checked, and how.
        notes: sentences on how it was read.
        findings: Findings about it.
        counts: see `headline`.
    """
    say(f"eomcheck {__version__}, {title}")
    for note in notes:
        say(note)
    print_verdict(findings, counts)
    groups = causes_of(findings)
    for group in groups:
        print_failure(*group)
    print_passed(dict.fromkeys(getattr(one, counts) for one in findings if one.verdict == "passed"))
    for verdict in ("inconclusive", "skipped"):
        rows = [one for one in findings if one.verdict == verdict]
        for subject, of_subject in groupby(rows, lambda one: (one.subject, one.detail)):
            claims = dict.fromkeys(one.claim for one in of_subject)
            say(f"{verdict}: {', '.join(claims)} [{subject[0]}]: {subject[1]}")
    if groups and groups[0][0].state is not None:
        say("\nThe first failure in its worst state, to paste into Python:\n")
        say(groups[0][0].as_python())


def write_answers(path: Path, title: str, notes: list[str], findings: Sequence[Finding]) -> None:
    """Write every Finding about recorded answers as JSON."""
    found = [finding.as_dict() for finding in findings]
    write_json(path, {"answers": title, "notes": notes, "findings": found})


def write_equations(
    path: Path, read: FileEquations, findings: Sequence[Finding], states: int, seed: int
) -> None:
    """Write every Finding about equations of motion as JSON."""
    document: dict[str, Any] = {
        "equations": {"name": read.equations.name, "functions": list(read.equations.given)},
        "n": read.equations.n,
        "states": states,
        "seed": seed,
        "notes": list(read.notes),
        "findings": [finding.as_dict() for finding in findings],
    }
    write_json(path, document)


def equations_records(findings: Sequence[Finding]) -> list[Record]:
    """Return the Records of a report on equations of motion or on a table: one per state or row."""
    from eomcheck.lab.recorded_finding import RecordedFinding
    from eomcheck.lab.store.validation_runs import findings_record, stored_findings

    by_state: dict[int, list[Finding]] = {}
    for finding in findings:
        about = finding if isinstance(finding, RecordedFinding) else finding.state
        by_state.setdefault(id(about), []).append(finding)
    name = findings[0].scene.name
    return [
        findings_record(stored_findings(group, name, case))
        for case, group in enumerate(by_state.values())
    ]
