"""`Findings`: the result of a check, a list of `Finding` with its verdict and its summary.

Failures with one cause are one group, reported once; the claims that follow from it are named. The
same lines are printed by commands, by `repr` (shortened) and, as HTML, in notebooks.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from html import escape
from typing import Any

from eomcheck.claims.finding import DECIDED, Finding, Verdict, worst
from eomcheck.safe_output import counted, listed

INDENT = "     "
"""Indentation of the lines below the first one of a failure."""

UNITS = {"claim": "claim", "subject": "quantity"}
"""Attribute of a Finding that is counted -> the noun."""

SHOWN, WIDTH, FAILURE_LINES = 3, 100, 5
"""Names listed, characters of a line, and lines of the first failure in a `repr`."""


class Findings(list[Finding]):
    """The Findings of a check: a list whose `repr` is a summary of at most ten lines.

    Example:
        >>> from eomcheck.testing import check_functions
        >>> result = check_functions(1, M=lambda q: [[2.0]], bias=lambda q, v: [v[0] ** 2])
        >>> result.verdict, len(result.failures), len(result) > 5
        ('failed', 2, True)
        >>> result.failures[0].claim
        'bias-of-mass-matrix'
    """

    @property
    def verdict(self) -> Verdict:
        """The verdict on everything: "failed" if anything failed, else "passed" if anything did."""
        return worst(self).verdict if self else "skipped"

    @property
    def failures(self) -> list[Finding]:
        """The Findings that failed, in the order of the claims; a cause before its effects."""
        return [one for one in self if one.verdict == "failed"]

    @property
    def undecided(self) -> list[Finding]:
        """The Findings that are inconclusive or skipped; the detail of each gives the reason."""
        return [one for one in self if one.verdict not in DECIDED]

    def as_python(self) -> str:
        """Return Python code that reproduces the first failure, "" without one."""
        return self.failures[0].as_python() if self.failures else ""

    def __repr__(self) -> str:
        return "\n".join(_shortened(line) for line in self._lines())

    def _lines(self) -> Iterator[str]:
        yield headline(self)
        groups = causes_of(self)
        if groups:
            yield from list(failure_lines(*groups[0]))[:FAILURE_LINES]
        if groups[1:]:
            others = dict.fromkeys(f"{cause_name(x[0])} ({x[0].claim})" for x in groups[1:])
            yield f"and {counted(len(others), 'further failure')}: {listed([*others], SHOWN)}"
        yield from _undecided_lines(self.undecided)
        if groups:
            yield "code that reproduces the first failure: print(result.as_python())"

    def _repr_html_(self) -> str:
        """Return the summary as HTML, without styles of its own but the color of the verdict."""
        color = {"failed": "#b3261e", "passed": "#1b7f3b"}.get(self.verdict, "#6b5900")
        first, *lines = self._lines()
        text = "\n".join(escape(line) for line in lines[: -1 if self.failures else None])
        code = ""
        if self.failures:
            code = (
                f"<details><summary>code</summary><pre>{escape(self.as_python())}</pre></details>"
            )
        head = f'<strong style="color:{color}">{escape(first)}</strong>'
        return f"<div>{head}<pre>{text}</pre>{code}</div>"


def _undecided_lines(findings: Sequence[Finding]) -> Iterator[str]:
    """Yield the first undecided claim with its reason, and the names of the others."""
    reasons = {(one.verdict, one.claim): one for one in findings}
    if reasons:
        one = next(iter(reasons.values()))
        yield f"{one.verdict}: {one.claim} [{one.subject}]: {one.detail}"
    others = dict.fromkeys(claim for _, claim in [*reasons][1:])
    if others:
        yield f"undecided too: {listed([*others], SHOWN)}"


def _shortened(line: str) -> str:
    """Return a line of at most `WIDTH` characters."""
    return line if len(line) <= WIDTH else line[: WIDTH - 4] + " ..."


def cause_name(finding: Any) -> str:
    """Return the cause of a failure, or its subject if no cause is known."""
    return getattr(finding, "cause", "") or finding.subject


def causes_of(findings: Iterable[Any]) -> list[list[Any]]:
    """Return the failures by cause: the first of each, and those that follow from it."""
    groups: list[list[Any]] = []
    for finding in (one for one in findings if one.verdict == "failed"):
        follows = getattr(finding, "follows", "")
        same = [x for x in groups if follows and x[0].cause == finding.cause]
        if same:
            same[0].append(finding)
        else:
            groups.append([finding])
    return groups


def failure_lines(first: Any, *following: Any) -> Iterator[str]:
    """Yield the lines on a failure, a `Finding` or a stored one, and on those that follow from it.

    Returns:
        The quantity that fails, and where; the parts of its detail, its numbers, other claims.
    """
    cause = getattr(first, "cause", "")
    if cause:
        yield f"FAIL {cause} of {first.location} ({first.claim} [{first.subject}])"
    else:
        yield f"FAIL {first.claim} ({first.subject}) on {first.location}"
    for part in first.detail.split("; "):
        yield INDENT + part
    if first.allowed > 0.0:
        yield f"{INDENT}error {first.observed:.3g}, rounding allows {first.allowed:.3g}"
    if following:
        names = dict.fromkeys(one.claim for one in following)
        yield f"{INDENT}follows from it: {', '.join(names)}"


def headline(findings: Sequence[Any], counts: str = "claim") -> str:
    """Return the verdict on all findings in one sentence.

    All claims count, also those on which nothing was decided, which are named as undecided.

    Args:
        findings: `Finding`s or stored ones.
        counts: attribute of them that is counted, "claim" or "subject".
    """
    verdicts: dict[str, set[str]] = {}
    for one in findings:
        verdicts.setdefault(getattr(one, counts), set()).add(one.verdict)
    failed = [name for name, of in verdicts.items() if "failed" in of]
    decided = [name for name, of in verdicts.items() if of & {*DECIDED}]
    if not decided:
        return "nothing was decided"
    number = counted(len(verdicts), UNITS[counts])
    undecided = f"{len(verdicts) - len(decided)} undecided" if len(decided) < len(verdicts) else ""
    if failed:
        names = failed
        if counts == "claim" and any(getattr(one, "cause", "") for one in findings):
            names = list(dict.fromkeys(cause_name(group[0]) for group in causes_of(findings)))
        others = f"; {undecided}" if undecided else ""
        return f"{len(failed)} of {number} failed: {', '.join(names)}{others}"
    others = f", {undecided}" if undecided else ""
    return f"{len(decided)} of {number} passed{others}; {_largest(findings)}"


def _largest(findings: Sequence[Any]) -> str:
    """Return the largest error of the findings that passed, relative to the one allowed."""
    largest = worst([one for one in findings if one.verdict == "passed"])
    if largest.ratio == 0.0:
        return "no error larger than 0"
    percent = f"{100 * largest.ratio:.2g} %"
    return f"largest error {percent} of what rounding allows ({largest.claim} [{largest.subject}])"
