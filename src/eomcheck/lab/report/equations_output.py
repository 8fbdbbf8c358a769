"""Output of checked equations of motion and answers: on a terminal, as JSON, as Records of a page.

The first lines name what was read and the verdict. Failures follow, one block per cause: what is
wrong, where, the likely cause, and its numbers. Claims that passed are one line, and what could not
be decided comes last, each with the input that would decide it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

from eomcheck import __version__
from eomcheck.claims.finding import Finding
from eomcheck.lab.show.table import say, write_json
from eomcheck.lab.store.record_file import Record
from eomcheck.safe_output import counted
from eomcheck.testing.equations_of_files import FileEquations

INDENT = "     "


def causes_of(findings: Iterable[Finding]) -> list[list[Finding]]:
    """Return the failures by cause: the first of each, and those that follow from it."""
    groups: list[list[Finding]] = []
    for finding in (one for one in findings if one.verdict == "failed"):
        same = [x for x in groups if finding.follows and x[0].cause == finding.cause]
        if same:
            same[0].append(finding)
        else:
            groups.append([finding])
    return groups


def failure_lines(first: Finding, *following: Finding) -> Iterator[str]:
    """Yield the lines on a failure and on those that follow from it.

    Returns:
        What fails and about what, the parts of its detail, its numbers, and the other claims.
    """
    about = f"{first.cause or first.subject} of {first.scene.name}"
    yield f"FAIL {about} ({first.claim} [{first.subject}])"
    for part in first.detail.split("; "):
        yield INDENT + part
    if first.allowed > 0.0:
        yield f"{INDENT}error {first.observed:.3g}, rounding allows {first.allowed:.3g}"
    if following:
        names = dict.fromkeys(one.claim for one in following)
        yield f"{INDENT}follows from it: {', '.join(names)}"


def verdict_line(findings: Sequence[Finding], counts: str = "claim") -> str:
    """Return the verdict on all findings in one sentence.

    Args:
        findings: the Findings.
        counts: attribute of them that is counted, "claim" or "subject".
    """
    of_all = [(getattr(one, counts), one.verdict) for one in findings]
    failed = {name for name, verdict in of_all if verdict == "failed"}
    decided = {name for name, verdict in of_all if verdict in ("passed", "failed")}
    if not decided:
        return "nothing was decided"
    number = counted(len(decided), {"claim": "claim", "subject": "quantity"}[counts])
    if failed:
        names = dict.fromkeys(group[0].cause or group[0].subject for group in causes_of(findings))
        return f"{len(failed)} of {number} failed: {', '.join(names)}"
    return f"{number} passed, 0 failed"


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


def print_checked(
    title: str, notes: Iterable[str], findings: Sequence[Finding], counts: str = "claim"
) -> None:
    """Print the verdict on what was checked, failures by cause, and what was not decided.

    Args:
        title: what was checked, and how.
        notes: sentences on how it was read.
        findings: Findings about it.
        counts: see `verdict_line`.
    """
    failed = any(one.verdict == "failed" for one in findings)
    say(f"eomcheck {__version__}, {title}")
    for note in notes:
        say(note)
    say(verdict_line(findings, counts), "bold red" if failed else "bold green")
    groups = causes_of(findings)
    for group in groups:
        head, *lines = failure_lines(*group)
        say("")
        say(head, "red")
        for line in lines:
            say(line)
    passed = dict.fromkeys(getattr(one, counts) for one in findings if one.verdict == "passed")
    if passed:
        say("")
        say(f"passed: {', '.join(passed)}")
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
    """Return the Records of a report on equations of motion: one per state."""
    from eomcheck.lab.store.validation_runs import findings_record, stored_findings

    by_state: dict[int, list[Finding]] = {}
    for finding in findings:
        by_state.setdefault(id(finding.state), []).append(finding)
    name = findings[0].scene.name
    return [
        findings_record(stored_findings(group, name, case))
        for case, group in enumerate(by_state.values())
    ]
