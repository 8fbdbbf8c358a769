"""Tables of a fuzzing campaign, its lines of progress, and the outcome of a replay."""

from __future__ import annotations

import re
import time
from collections import Counter, defaultdict
from collections.abc import Sequence

from eomcheck.console import console
from eomcheck.draws.fuzz_cases import FAMILIES
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.fuzzing.campaign import Campaign
from eomcheck.lab.fuzzing.function_rounds import SKIPPED, FunctionsPlan
from eomcheck.lab.fuzzing.motion_rounds import CROSSED, STOPPED
from eomcheck.lab.fuzzing.replay import ReplayResult
from eomcheck.lab.fuzzing.screening import DECIDED, OPEN
from eomcheck.lab.show.table import Cell, ResultTable, print_tables, say
from eomcheck.safe_output import counted, printable

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
        console.print(
            f"{rate}{high}; {counted(len(campaign.failure_records), 'failure')}", highlight=False
        )


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
        (name, str(x))
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
    """Return the number of states by structural variant."""
    of = campaign.by_variant
    rows = [(_variant_label(one.name), str(of[one.name])) for one in campaign.variants]
    noun = f"{campaign.plan.noun}s"
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
        (Cell(one.claim, "failed"), one.subject, one.whose, one.detail, one.evidence)
        for one in campaign.failure_records.values()
    ]
    columns = "claim", "subject", "fault", "what", "evidence"
    return ResultTable("failures", "Failures", columns, rows, (10, 10, 8, 20, 30))


def print_replayed(results: Sequence[ReplayResult]) -> None:
    """Print the number of stored failures by present outcome, and the reason or code of each that
    does not hold.
    """
    counts = Counter(one.outcome for one in results)
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
