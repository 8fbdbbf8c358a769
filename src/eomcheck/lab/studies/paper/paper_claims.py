"""Claims of the paper, each judged by comparisons between Records of the study.

A claim is a number of comparisons. It holds if all of them come out as in the paper, partly if at
least half of them do. A difference below a factor of `CLEAR` does not count: another tolerance or
another machine makes as much (except in Sec. 3, where any longer time of a larger order counts, and
where bounds of rounding decide). Claims register in the order of this module: equations (Table I,
Secs. 1 to 10), errors (Figs. 3 to 6), CPU time (Fig. 7 and the conclusion).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import product
from math import inf
from statistics import mean, median
from typing import Literal, NamedTuple

import numpy as np

from eomcheck.formulations import FORMULATIONS, kane, ml
from eomcheck.lab.show.table import ranges
from eomcheck.lab.store.record_file import Record, group
from eomcheck.lab.studies.paper.measure import (
    LARGE,
    PAPER_LINKS,
    QUANTITIES,
    PaperRecords,
    Solver,
    growth,
)

# ---- Claims and judgements -----------------------------------------------------------------------

Verdict = Literal["holds", "holds partly", "does not hold here", "not measured"]

CLEAR = 2.0
"""Factor from which on a difference counts."""

UNFORESEEN = "Not foreseen: no reason is known."
NOTHING = "Nothing to compare."
AGREEING = "<agreeing of total>"
"""Place in a sentence of evidence at which its counts are written, as "3 of 4"."""

KANE, ML = kane.KANE.key, ml.ML.key


class Evidence(NamedTuple):
    """Number of comparisons that agree with the paper, total number, and a sentence of numbers."""

    agreeing: int
    total: int
    measured: str


@dataclass(frozen=True)
class PaperClaim:
    """One claim of the paper.

    Attributes:
        place: section, equation or figure of the paper.
        statement: the claim, in our words.
        measure: function that computes the evidence from Records.
        reason_if_true: reason why it holds.
        reason_if_false: reason why it does not hold, or only in part.
    """

    place: str
    statement: str
    measure: Callable[[PaperRecords], Evidence]
    reason_if_true: str
    reason_if_false: str


class Judgement(NamedTuple):
    """Verdict on a claim, with the numbers measured and the reason."""

    claim: PaperClaim
    measured: str
    verdict: Verdict
    why: str


PAPER_CLAIMS: list[PaperClaim] = []
"""All claims: equations first, then errors, then CPU time."""


def verdict_of(evidence: Evidence) -> Verdict:
    """Return the verdict that the comparisons amount to."""
    if evidence.total == 0:
        return "not measured"
    if evidence.agreeing == evidence.total:
        return "holds"
    return "holds partly" if 2 * evidence.agreeing >= evidence.total else "does not hold here"


def judge_paper_claim(claim: PaperClaim, records: PaperRecords) -> Judgement:
    """Return the judgement of one claim by the Records."""
    evidence = claim.measure(records)
    verdict = verdict_of(evidence)
    if verdict == "holds":
        why = claim.reason_if_true
    elif verdict == "not measured":
        why = "These Records do not show it."
    else:
        why = claim.reason_if_false
    return Judgement(claim, evidence.measured, verdict, why)


def judgements(records: Iterable[Record]) -> list[Judgement]:
    """Return the judgement of every claim by the Records."""
    paper_records = PaperRecords(records)
    return [judge_paper_claim(claim, paper_records) for claim in PAPER_CLAIMS]


def paper_claim(
    place: str,
    statement: str,
    reason_if_true: str = UNFORESEEN,
    reason_if_false: str = UNFORESEEN,
) -> Callable:
    """Register the decorated function as the `measure` of a claim.

    Args:
        place: section, equation or figure of the paper.
        statement: the claim, in our words.
        reason_if_true: reason why it holds.
        reason_if_false: reason why it does not hold, or only in part.
    """

    def register(measure: Callable[[PaperRecords], Evidence]) -> Callable:
        PAPER_CLAIMS.append(PaperClaim(place, statement, measure, reason_if_true, reason_if_false))
        return measure

    return register


# ---- Ratios of errors and times ------------------------------------------------------------------


class Ratio(NamedTuple):
    """Ratio of two values by one solver; `where` names the formulations and number of links.

    Or the formulation alone, where the values are of different numbers of links.
    """

    value: float
    where: str
    solver: Solver

    def __str__(self):
        return f"{self.value:.3g} ({self.where}, {self.solver})"


def at_level(records: PaperRecords, level: str) -> list[str]:
    """Return the formulations with constraints at a level, "velocity" or "acceleration"."""
    return [key for key in records.formulations if FORMULATIONS[key].level == level]


def other_formulations(records: PaperRecords) -> list[str]:
    """Return all formulations but Kane's."""
    return [key for key in records.formulations if key != KANE]


def points_of(records: PaperRecords) -> list[tuple[int, Solver]]:
    """Return every number of links with every solver."""
    return list(product(records.links, records.solvers))


def ratios_of(
    records: PaperRecords,
    quantity: str,
    large: Iterable[str],
    small: Iterable[str],
    points: Iterable[tuple[int, Solver]] | None = None,
) -> list[Ratio]:
    """Return the ratios of the errors or times of `large` formulations to those of `small` ones."""
    ratios = []
    chosen, pairs = points_of(records) if points is None else points, product(large, small)
    for (links, solver), (numerator, denominator) in product(chosen, pairs):
        x, y = (records.value(quantity, links, key, solver) for key in (numerator, denominator))
        if x is not None and y is not None:
            ratio = x / y if y > 0 else (1.0 if x == 0 else inf)
            ratios.append(Ratio(ratio, f"{numerator} to {denominator}, N = {links}", solver))
    return ratios


def clearly_larger(what: str, ratios: list[Ratio]) -> Evidence:
    """Return the number of ratios above `CLEAR` as evidence.

    Its sentence has their number by each solver too, and that of ratios below the inverse.
    """
    if not ratios:
        return Evidence(0, 0, NOTHING)
    above = Counter(ratio.solver for ratio in ratios if ratio.value > CLEAR)
    below = sum(ratio.value < 1 / CLEAR for ratio in ratios)
    solvers = dict.fromkeys(ratio.solver for ratio in ratios)
    by_solver = ", ".join(f"{above[solver]} by {solver}" for solver in solvers)
    return Evidence(
        above.total(),
        len(ratios),
        f"{what}: more than {CLEAR:g} in {above.total()} of {len(ratios)} comparisons "
        f"({by_solver}), "
        f"less than {1 / CLEAR:g} in {below}; median {median(r.value for r in ratios):.3g}, from "
        f"{min(ratios)} to {max(ratios)}.",
    )


def share(flags: Iterable[bool]) -> tuple[int, int]:
    """Return the number of true flags, and the number of flags."""
    flags = list(flags)
    return sum(flags), len(flags)


def counted_evidence(agree: Iterable[bool], measured: str) -> Evidence:
    """Return evidence of comparisons; `AGREEING` in its sentence stands for "3 of 4"."""
    agreeing, total = share(agree)
    return Evidence(agreeing, total, measured.replace(AGREEING, f"{agreeing} of {total}"))


def text_at_largest_size(records: PaperRecords, values: dict[tuple[int, str], int]) -> str:
    """Return the values (links, key) -> value at the largest number of links, as text."""
    largest = max(records.links, default=0)
    text = ", ".join(f"{key} {x}" for (links, key), x in values.items() if links == largest)
    return f"At N = {largest}: {text}."


# ---- Equations: Table I, Secs. 1 to 10 -----------------------------------------------------------


@paper_claim(
    "Sec. 1",
    "The equations are singular where a wheel i ≥ 2 stands across its link (α_i = ±π/2); wheel 1 "
    "may.",
    reason_if_false="Only the generalized speeds of ml and kane divide by cos α_i, for i ≥ 2. The "
    "partition of el and em makes a_1 singular for i ≤ N - 2 instead, wheel 1 included. im, au and "
    "gw need neither: it is not the robot that is singular.",
)
def _across(records: PaperRecords) -> Evidence:
    refused: dict[str, list[int]] = {key: [] for _, key in records.across}
    for (wheel, key), record in records.across.items():
        if record.status == "refused":
            refused[key].append(wheel)
    alike = group(refused, lambda key: ranges(refused[key]) or "none")
    good = ((wheel in refused[key]) == (wheel >= 2) for wheel, key in records.across)
    wheels_by_key = "; ".join(f"{', '.join(keys)}: {wheels}" for wheels, keys in alike.items())
    return counted_evidence(good, f"Wheels refused at N = {PAPER_LINKS}: {wheels_by_key}.")


@paper_claim(
    "Eqs. (6), (8), (14), (19)",
    "Numbers integrated: im 2n + r; au, el and gw n + r; em, ml and kane 2n - r.",
    reason_if_false="Eq. (8) leaves out q̇, without which the state cannot be integrated; el and "
    "gw need no μ, since no multiplier is left among their unknowns.",
)
def _states(records: PaperRecords) -> Evidence:
    printed = {"im": (2, 1), "au": (1, 1), "el": (1, 1), "gw": (1, 1)}
    printed |= dict.fromkeys(("em", "ml", "kane"), (2, -1))
    sizes = {
        (links, key): record.counts["state"] for (links, key, _), record in records.motions.items()
    }
    good = [
        size == i * (links + 2) + j * links
        for (links, key), size in sizes.items()
        for i, j in [printed[key]]
    ]
    return counted_evidence(
        good, f"As printed in {AGREEING} cases. {text_at_largest_size(records, sizes)}"
    )


@paper_claim(
    "Table I, Eqs. (7)-(23)",
    "The equations solved are 2n + r, n + r, n, n, n - r, n - r, n - r.",
    reason_if_true="It counts the final system. el and em solve one of order r before it, gw one "
    "of order n and one of order r, which the table does not count.",
)
def _orders(records: PaperRecords) -> Evidence:
    all_counts = {where: record.counts for where, record in records.solved.items()}
    orders = {where: counts["final system"] for where, counts in all_counts.items()}
    good = [
        orders[links, key] == FORMULATIONS[key].unknowns(counts["n"], counts["r"])
        for (links, key), counts in all_counts.items()
    ]
    at_largest = text_at_largest_size(records, orders)
    text = f"The last system has this order in {AGREEING} cases. {at_largest}"
    return counted_evidence(good, text)


@paper_claim(
    "Table I",
    "im, au, el and gw use the constraints at acceleration level; em, ml and kane at velocity "
    "level, so that these cannot leave them.",
    reason_if_true="v = W u + offset satisfies the constraints by construction, whatever u is; at "
    "acceleration level each step adds its own error.",
)
def _levels(records: PaperRecords) -> Evidence:
    by_level: dict[str, list[float]] = {"acceleration": [], "velocity": []}
    for (_, key, _), record in records.motions.items():
        if record.status == "done":
            over = record.errors["constraint"] / record.errors["constraint allowed"]
            by_level[FORMULATIONS[key].level].append(over)
    good = [over > 1 for over in by_level["acceleration"]]
    good += [over <= 1 for over in by_level["velocity"]]
    ratios = "; ".join(
        f"{level} level {min(overs):.1g} to {max(overs):.1g}"
        for level, overs in by_level.items()
        if overs
    )
    return counted_evidence(
        good, f"Norm of the constraint error over what rounding explains: {ratios}."
    )


@paper_claim(
    "Table I",
    "The multipliers come out directly with im and au only.",
    reason_if_true="The other formulations eliminate them.",
    reason_if_false="gw computes them by Eq. (12) before it needs the accelerations; they come out "
    "as well.",
)
def _multipliers(records: PaperRecords) -> Evidence:
    # By formulation: of its numbers of links the last one counts.
    present = {key: record.counts["multipliers"] > 0 for (_, key), record in records.solved.items()}
    good = (flag == FORMULATIONS[key].multipliers_in_paper for key, flag in present.items())
    with_them = [key for key, flag in present.items() if flag]
    return counted_evidence(good, f"They come out with {', '.join(with_them) or 'none'}.")


@paper_claim(
    "Sec. 3",
    "The order of the system solved is a useful criterion for the time that a method takes.",
    reason_if_true="Solving the final system takes most of the time.",
    reason_if_false="Much of the time goes elsewhere: el, gw and em solve other systems before the "
    "final one, and on the way to a system of order n - r em spends O(N³), ml O(N²) and kane O(N).",
)
def _order_tells_time(records: PaperRecords) -> Evidence:
    # The order is a pair of factors of n and r; its size is compared at N = 100, where r = N and
    # n = N + 2.
    orders = {key: FORMULATIONS[key].order for key in records.formulations}
    size = {key: FORMULATIONS[key].unknowns(n=102, r=100) for key in orders}

    def ratios(pairs: Iterable[tuple[str, str]]) -> list[Ratio]:
        return [r for x, y in pairs for r in ratios_of(records, "cpu_seconds", [x], [y])]

    pairs = [(x, y) for x, y in product(orders, orders) if x != y]
    larger = ratios((x, y) for x, y in pairs if size[x] > size[y])
    equal = [r for r in ratios(p for p in pairs if orders[p[0]] == orders[p[1]]) if r.value >= 1]
    if not larger or not equal:
        return Evidence(0, 0, NOTHING)
    slower, alike = share(r.value > 1 for r in larger), share(r.value <= CLEAR for r in equal)
    return Evidence(
        slower[0] + alike[0],
        slower[1] + alike[1],
        f"The larger order takes longer in {slower[0]} of {slower[1]} comparisons. Of equal order, "
        f"{alike[0]} of {alike[1]} pairs are within a factor of {CLEAR:g}; the largest ratio is "
        f"{max(equal)}.",
    )


@paper_claim(
    "Sec. 9",
    "With the same generalized speeds kane and ml have the same equations of motion.",
    reason_if_true="They are the same rational functions (`eomcheck prove` proves it for all "
    "parameters); only the rounding differs.",
)
def _kane_is_ml(records: PaperRecords) -> Evidence:
    shares = []
    for links in records.links:
        by_kane, by_ml = (records.solved.get((links, key)) for key in (KANE, ML))
        if by_kane and by_ml:
            distance = np.abs(np.subtract(by_kane.series["vdot"], by_ml.series["vdot"])).max()
            shares.append(float(distance / (by_kane.errors["bound"] + by_ml.errors["bound"])))
    if not shares:
        return Evidence(0, 0, NOTHING)
    return counted_evidence(
        (part <= 1 for part in shares),
        f"In {AGREEING} states, one for each N, q̈ is the same within the bounds of rounding; "
        f"the largest difference is {max(shares):.1g} of what they allow.",
    )


@paper_claim(
    "Sec. 10",
    "The snake has two degrees of freedom, whatever N.",
    reason_if_true="a has full rank N.",
)
def _degrees_of_freedom(records: PaperRecords) -> Evidence:
    freedoms = {
        links: record.counts["degrees of freedom"] for (links, _), record in records.solved.items()
    }
    numbers = ", ".join(map(str, sorted(set(freedoms.values()))))
    return counted_evidence(
        (number == 2 for number in freedoms.values()),
        f"n - rank(a) is {numbers} at {len(freedoms)} values of N.",
    )


# ---- Errors: Figs. 3 to 6 ------------------------------------------------------------------------


@paper_claim(
    "Sec. 1",
    "Constraints at acceleration level make errors accumulate.",
    reason_if_true="ȧv + a v̇ = 0 holds at every step but for its error, and nothing brings a v "
    "back to 0.",
    reason_if_false="Nothing brings a v back to 0 once it is off. But output times lie between "
    "steps, and interpolation has an error of its own there, which comes and goes and is seen at a "
    "tight tolerance; and most error is made early, while the motion is fast.",
)
def _accumulates(records: PaperRecords) -> Evidence:
    ratios = []
    for key, (links, solver) in product(at_level(records, "acceleration"), points_of(records)):
        record = records.finished(links, key, solver)
        if record is not None:
            error = record.series["constraint"]
            quarter = len(error) // 4
            first, last = mean(error[1 : quarter + 1]), mean(error[-quarter:])
            ratios.append(Ratio(last / first, f"{key}, N = {links}", solver))
    return clearly_larger("Mean constraint error of the last quarter over the first", ratios)


CONSTRUCTION = "By construction: v = W u + offset satisfies the constraints up to rounding."


@paper_claim(
    "Fig. 3",
    f"N = {PAPER_LINKS}: kane, em and ml have a smaller constraint error than the others.",
    reason_if_true=CONSTRUCTION,
)
def _fig_3(records: PaperRecords) -> Evidence:
    return _levels_compared(records, "constraint", _points_of_paper_size(records))


@paper_claim(
    "Fig. 3(b)",
    f"N = {PAPER_LINKS}: the constraint error of kane is much smaller than those of em and ml.",
    reason_if_false="All three are rounding and nothing else: no formulation can be better. A "
    "difference at this level is one of how v is formed from u, not of the method.",
)
def _fig_3b(records: PaperRecords) -> Evidence:
    same_level = [key for key in at_level(records, "velocity") if key != KANE]
    ratios = ratios_of(records, "constraint", same_level, [KANE], _points_of_paper_size(records))
    return clearly_larger("Error over that of kane", ratios)


STEPS_DECIDE = (
    "It depends on the tolerance, which the paper does not give. The step control holds the "
    "estimated error of the numbers integrated at the tolerance. Formulations integrate different "
    "numbers, take different steps, and their energy errors follow the steps, not the level of "
    "the constraints or the number of equations."
)


@paper_claim(
    "Fig. 4",
    f"N = {PAPER_LINKS}: kane, em and ml, with fewer equations, have a smaller energy error than "
    "the others.",
    reason_if_false=STEPS_DECIDE,
)
def _fig_4(records: PaperRecords) -> Evidence:
    return _levels_compared(records, "energy", _points_of_paper_size(records))


@paper_claim(
    "Fig. 5",
    "N = 2 to 100: the norm of the constraint error is smaller with kane, em and ml.",
    reason_if_true=CONSTRUCTION,
)
def _fig_5(records: PaperRecords) -> Evidence:
    return _levels_compared(records, "constraint", points_of(records))


@paper_claim(
    "Fig. 6",
    "N = 2 to 100: the norm of the energy error is smaller with kane, em and ml.",
    reason_if_false=STEPS_DECIDE,
)
def _fig_6(records: PaperRecords) -> Evidence:
    evidence = _levels_compared(records, "energy", points_of(records))
    if len(records.solvers) > 1 and evidence.total:
        values = {
            solver: [
                value
                for links, key in product(records.links, records.formulations)
                if (value := records.value("energy", links, key, solver)) is not None
            ]
            for solver in records.solvers
        }
        medians = ", ".join(f"{median(v):.1g} J by {s}" for s, v in values.items() if v)
        evidence = evidence._replace(measured=f"{evidence.measured} Median norm: {medians}.")
    return evidence


def _points_of_paper_size(records: PaperRecords) -> list[tuple[int, Solver]]:
    """Return the paper's number of links with every solver."""
    return [(links, solver) for links, solver in points_of(records) if links == PAPER_LINKS]


def _levels_compared(
    records: PaperRecords, quantity: str, points: Iterable[tuple[int, Solver]]
) -> Evidence:
    """Return the errors with constraints at acceleration level over those at velocity level."""
    acceleration, velocity = (at_level(records, level) for level in ("acceleration", "velocity"))
    return clearly_larger(
        f"Error of {', '.join(acceleration)} over that of {', '.join(velocity)}",
        ratios_of(records, quantity, acceleration, velocity, points),
    )


# ---- CPU time: Fig. 7 and the conclusion ---------------------------------------------------------


@paper_claim(
    "Fig. 7",
    "N = 2 to 100: kane takes significantly less CPU time than every other method.",
    reason_if_true="It costs O(N) a right-hand side and forms no matrix of order n.",
    reason_if_false="The factor of two is missing where ml, with the same recursion, only adds M "
    "in O(N²), and at small N, where the integrator, sines and cosines take the same time for all.",
)
def _fig_7(records: PaperRecords) -> Evidence:
    return clearly_larger(
        "Time over that of kane",
        ratios_of(records, "cpu_seconds", other_formulations(records), [KANE]),
    )


@paper_claim(
    "Fig. 7, Sec. 12",
    "The advantage of kane in CPU time grows with the number of links.",
    reason_if_true="kane costs O(N) a right-hand side, ml O(N²), the others O(N³).",
    reason_if_false="ml has the same recursion, and its O(N²) for M is still small beside it at N "
    "= 100.",
)
def _grows(records: PaperRecords) -> Evidence:
    ratios, many = [], max(records.links, default=0)
    for key, solver in product(other_formulations(records), records.solvers):
        pair = (key, solver), (KANE, solver)
        both = [n for n in records.links if all(records.finished(n, *method) for method in pair)]
        if len(both) > 1 and both[-1] == many:
            ends = [(both[0], solver), (many, solver)]
            few, most = ratios_of(records, "cpu_seconds", [key], [KANE], ends)
            ratios.append(Ratio(most.value / few.value, key, solver))
    what = f"Time over that of kane at N = {many}, over the same at the fewest links finished"
    evidence = clearly_larger(what, ratios)
    slopes = {key: growth(records, key) for key in records.formulations}
    exponents = [
        f"{key} {' to '.join(sorted({f'{min(s):.2f}', f'{max(s):.2f}'}))}"
        for key, s in slopes.items()
        if s
    ]
    if exponents:
        powers = f"From N = {LARGE} on time grows as N to the power {', '.join(exponents)}."
        evidence = evidence._replace(measured=f"{evidence.measured} {powers}")
    return evidence


@paper_claim(
    "Sec. 12",
    "Methods based on Lagrange's equations take about 10 times the CPU time of kane.",
    reason_if_true="Within a factor of two of 10 throughout.",
    reason_if_false="There is no one factor: time grows with a power of N that differs from method "
    "to method. What the paper measured also depends on how its right-hand sides were programmed, "
    "which it does not say.",
)
def _ten_times(records: PaperRecords) -> Evidence:
    others = other_formulations(records)
    ratios = ratios_of(records, "cpu_seconds", others, [KANE])
    if not ratios:
        return Evidence(0, 0, NOTHING)
    passes = []
    for solver in records.solvers:
        for links in records.links:
            at_size = ratios_of(records, "cpu_seconds", others, [KANE], [(links, solver)])
            if at_size and mean(ratio.value for ratio in at_size) > 10:
                passes.append(f"N = {links} ({solver})")
                break
    return counted_evidence(
        (10 / CLEAR <= ratio.value <= 10 * CLEAR for ratio in ratios),
        f"{AGREEING} ratios lie between {10 / CLEAR:g} and {10 * CLEAR:g}; they go from "
        f"{min(ratios)} to {max(ratios)}, median {median(r.value for r in ratios):.3g}. The mean "
        f"over the methods first exceeds 10 at {', '.join(passes) or 'no N'}.",
    )


@paper_claim(
    "Abstract, Sec. 12",
    "kane is superior to the other methods: in constraint error, energy error and CPU time no "
    "other is clearly better.",
    reason_if_true="It keeps the constraints and costs O(N) a right-hand side.",
    reason_if_false="It keeps the constraints and costs O(N) a right-hand side, but has no smaller "
    "energy error than others: see Fig. 6.",
)
def _superior(records: PaperRecords) -> Evidence:
    good: dict[str, list[bool]] = {quantity: [] for quantity in QUANTITIES}
    for quantity, (links, solver) in product(QUANTITIES, points_of(records)):
        by_kane = records.value(quantity, links, KANE, solver)
        others = [
            records.value(quantity, links, key, solver) for key in other_formulations(records)
        ]
        finished = [value for value in others if value is not None]
        if by_kane is None or not finished:
            continue
        errors = records.motions[links, KANE, solver].errors
        rounding = quantity == "constraint" and by_kane <= errors["constraint allowed"]
        good[quantity].append(rounding or by_kane <= CLEAR * min(finished))
    text = ", ".join(
        f"{QUANTITIES[quantity]} in {sum(flags)} of {len(flags)}"
        for quantity, flags in good.items()
        if flags
    )
    all_flags = [flag for flags in good.values() for flag in flags]
    return counted_evidence(all_flags, f"No other is clearly better: {text} cases.")
