"""Claims of the paper, each judged by comparisons between Records of the study.

A claim is a number of comparisons. It holds if all of them come out as in the paper, partly if at
least half of them do. A difference below a factor of `CLEAR` does not count: another tolerance or
another machine makes as much. Claims register in the order of this module: equations (Table I,
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
from eomcheck.lab.show.document_text import ranges
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
UNFORESEEN = "Not foreseen: no reason is known."
NOTHING = "Nothing to compare."
GOOD = "GOOD of OF"

KANE, ML = kane.KANE.key, ml.ML.key


class Evidence(NamedTuple):
    """Number of comparisons as in the paper, number of all comparisons, and a sentence of
    numbers.
    """

    good: int
    of: int
    measured: str


@dataclass(frozen=True)
class PaperClaim:
    """One claim of the paper.

    Attributes:
        place: section, equation or figure of the paper.
        says: statement of the claim, in our words.
        measure: function that computes the evidence from Records.
        true: reason why it holds.
        false: reason why it does not hold, or only in part.
    """

    place: str
    says: str
    measure: Callable[[PaperRecords], Evidence]
    true: str
    false: str


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
    if evidence.of == 0:
        return "not measured"
    if evidence.good == evidence.of:
        return "holds"
    return "holds partly" if 2 * evidence.good >= evidence.of else "does not hold here"


def judge_paper_claim(claim: PaperClaim, found: PaperRecords) -> Judgement:
    """Return the judgement of one claim by the Records."""
    evidence = claim.measure(found)
    verdict = verdict_of(evidence)
    why = {"holds": claim.true, "not measured": "These Records do not show it."}
    return Judgement(claim, evidence.measured, verdict, why.get(verdict, claim.false))


def judgements(records: Iterable[Record]) -> list[Judgement]:
    """Return the judgement of every claim by the Records."""
    found = PaperRecords(records)
    return [judge_paper_claim(claim, found) for claim in PAPER_CLAIMS]


def paper_claim(place: str, says: str, true: str = UNFORESEEN, false: str = UNFORESEEN) -> Callable:
    """Register the decorated function as the `measure` of a claim.

    Args:
        place: section, equation or figure of the paper.
        says: statement of the claim.
        true: reason why it holds.
        false: reason why it does not hold, or only in part.
    """

    def register(measure: Callable[[PaperRecords], Evidence]) -> Callable:
        PAPER_CLAIMS.append(PaperClaim(place, says, measure, true, false))
        return measure

    return register


# ---- Ratios of errors and times ------------------------------------------------------------------


class Ratio(NamedTuple):
    """Ratio of two values, with the formulations, number of links and solver."""

    times: float
    where: str
    solver: Solver

    def __str__(self):
        return f"{self.times:.3g} ({self.where}, {self.solver})"


def at_level(found: PaperRecords, level: str) -> list[str]:
    """Return the formulations with constraints at a level, "velocity" or "acceleration"."""
    return [key for key in found.formulations if FORMULATIONS[key].level == level]


def other_formulations(found: PaperRecords) -> list[str]:
    """Return all formulations but Kane's."""
    return [key for key in found.formulations if key != KANE]


def points_of(found: PaperRecords) -> list[tuple[int, Solver]]:
    """Return every number of links with every solver."""
    return list(product(found.links, found.solvers))


def ratios_of(
    found: PaperRecords,
    quantity: str,
    large: Iterable[str],
    small: Iterable[str],
    points: Iterable[tuple[int, Solver]] | None = None,
) -> list[Ratio]:
    """Return the ratios of the errors or times of `large` formulations to those of `small` ones."""
    ratios = []
    chosen, pairs = points_of(found) if points is None else points, product(large, small)
    for (links, solver), (one, other) in product(chosen, pairs):
        x, y = (found.value(quantity, links, key, solver) for key in (one, other))
        if x is not None and y is not None:
            times = x / y if y > 0 else (1.0 if x == 0 else inf)
            ratios.append(Ratio(times, f"{one} to {other}, N = {links}", solver))
    return ratios


def clearly_larger(what: str, ratios: list[Ratio]) -> Evidence:
    """Return the ratios above `CLEAR` as evidence, with the number of those below its inverse."""
    if not ratios:
        return Evidence(0, 0, NOTHING)
    above = Counter(ratio.solver for ratio in ratios if ratio.times > CLEAR)
    below = sum(ratio.times < 1 / CLEAR for ratio in ratios)
    solvers = dict.fromkeys(ratio.solver for ratio in ratios)
    each = ", ".join(f"{above[solver]} by {solver}" for solver in solvers)
    return Evidence(
        above.total(),
        len(ratios),
        f"{what}: more than {CLEAR:g} in {above.total()} of {len(ratios)} comparisons ({each}), "
        f"less than {1 / CLEAR:g} in {below}; median {median(r.times for r in ratios):.3g}, from "
        f"{min(ratios)} to {max(ratios)}.",
    )


def share(good: Iterable[bool]) -> tuple[int, int]:
    """Return the number of true flags, and the number of flags."""
    flags = list(good)
    return sum(flags), len(flags)


def counted_evidence(good: Iterable[bool], measured: str) -> Evidence:
    """Return evidence of flags; `GOOD` in its sentence stands for "3 of 4"."""
    count, of = share(good)
    return Evidence(count, of, measured.replace(GOOD, f"{count} of {of}"))


def at_most_links(found: PaperRecords, values: dict[tuple[int, str], int]) -> str:
    """Return the values (links, key) -> value at the largest number of links, as text."""
    largest = max(found.links, default=0)
    text = ", ".join(f"{key} {x}" for (links, key), x in values.items() if links == largest)
    return f"At N = {largest}: {text}."


# ---- Equations: Table I, Secs. 1 to 10 -----------------------------------------------------------


@paper_claim(
    "Sec. 1",
    "The equations are singular where a wheel i ≥ 2 stands across its link (α_i = ±π/2); wheel 1 "
    "may.",
    false="Only the generalized speeds of ml and kane divide by cos α_i, for i ≥ 2. The partition "
    "of el and em makes a_1 singular for i ≤ N - 2 instead, wheel 1 included. im, au and gw need "
    "neither: it is not the robot that is singular.",
)
def _across(found: PaperRecords) -> Evidence:
    refused: dict[str, list[int]] = {key: [] for _, key in found.across}
    for (wheel, key), record in found.across.items():
        if record.status == "refused":
            refused[key].append(wheel)
    alike = group(refused, lambda key: ranges(refused[key]) or "none")
    good = ((wheel in refused[key]) == (wheel >= 2) for wheel, key in found.across)
    wheels_by_key = "; ".join(f"{', '.join(keys)}: {wheels}" for wheels, keys in alike.items())
    return Evidence(*share(good), f"Wheels refused at N = {PAPER_LINKS}: {wheels_by_key}.")


@paper_claim(
    "Eqs. (6), (8), (14), (19)",
    "Numbers integrated: im 2n + r; au, el and gw n + r; em, ml and kane 2n - r.",
    false="Eq. (8) leaves out q̇, without which the state cannot be integrated; el and gw need no "
    "μ, since no multiplier is left among their unknowns.",
)
def _states(found: PaperRecords) -> Evidence:
    printed = {"im": (2, 1), "au": (1, 1), "el": (1, 1), "gw": (1, 1)}
    printed |= dict.fromkeys(("em", "ml", "kane"), (2, -1))
    sizes = {
        (links, key): record.counts["state"] for (links, key, _), record in found.motions.items()
    }
    good = [
        size == i * (links + 2) + j * links
        for (links, key), size in sizes.items()
        for i, j in [printed[key]]
    ]
    return counted_evidence(good, f"As printed in {GOOD} cases. {at_most_links(found, sizes)}")


@paper_claim(
    "Table I, Eqs. (7)-(23)",
    "The equations solved are 2n + r, n + r, n, n, n - r, n - r, n - r.",
    true="It counts the final system. el and em solve one of order r before it, gw one of order n "
    "and one of order r, which the table does not count.",
)
def _orders(found: PaperRecords) -> Evidence:
    counts = {where: record.counts for where, record in found.solved.items()}
    orders = {where: one["final system"] for where, one in counts.items()}
    good = [
        orders[links, key] == FORMULATIONS[key].unknowns(one["n"], one["r"])
        for (links, key), one in counts.items()
    ]
    text = f"The last system has this order in {GOOD} cases. {at_most_links(found, orders)}"
    return counted_evidence(good, text)


@paper_claim(
    "Table I",
    "im, au, el and gw use the constraints at acceleration level; em, ml and kane at velocity "
    "level, so that these cannot leave them.",
    true="v = W u + offset satisfies the constraints by construction, whatever u is; at "
    "acceleration level each step adds its own error.",
)
def _levels(found: PaperRecords) -> Evidence:
    by_level: dict[str, list[float]] = {"acceleration": [], "velocity": []}
    for (_, key, _), record in found.motions.items():
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
    return Evidence(
        *share(good), f"Norm of the constraint error over what rounding explains: {ratios}."
    )


@paper_claim(
    "Table I",
    "The multipliers come out directly with im and au only.",
    true="The other formulations eliminate them.",
    false="gw computes them by Eq. (12) before it needs the accelerations; they come out as well.",
)
def _multipliers(found: PaperRecords) -> Evidence:
    present = {key: record.counts["multipliers"] > 0 for (_, key), record in found.solved.items()}
    good = (flag == FORMULATIONS[key].multipliers_in_paper for key, flag in present.items())
    with_them = [key for key, flag in present.items() if flag]
    return Evidence(*share(good), f"They come out with {', '.join(with_them) or 'none'}.")


@paper_claim(
    "Sec. 3",
    "The order of the system solved is a useful criterion for the time that a method takes.",
    true="Solving the final system takes most of the time.",
    false="Much of the time goes elsewhere: el, gw and em solve other systems before the final "
    "one, and on the way to a system of order n - r em spends O(N³), ml O(N²) and kane O(N).",
)
def _order_tells_time(found: PaperRecords) -> Evidence:
    orders = {key: FORMULATIONS[key].order for key in found.formulations}
    size = {key: FORMULATIONS[key].unknowns(102, 100) for key in orders}

    def ratios(pairs: Iterable[tuple[str, str]]) -> list[Ratio]:
        return [r for x, y in pairs for r in ratios_of(found, "cpu_seconds", [x], [y])]

    pairs = [(x, y) for x, y in product(orders, orders) if x != y]
    larger = ratios((x, y) for x, y in pairs if size[x] > size[y])
    equal = [r for r in ratios(p for p in pairs if orders[p[0]] == orders[p[1]]) if r.times >= 1]
    if not larger or not equal:
        return Evidence(0, 0, NOTHING)
    slower, alike = share(r.times > 1 for r in larger), share(r.times <= CLEAR for r in equal)
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
    true="They are the same rational functions (`eomcheck prove` proves it for all parameters); "
    "only the rounding differs.",
)
def _kane_is_ml(found: PaperRecords) -> Evidence:
    shares = []
    for links in found.links:
        one, other = (found.solved.get((links, key)) for key in (KANE, ML))
        if one and other:
            apart = np.abs(np.subtract(one.series["vdot"], other.series["vdot"])).max()
            shares.append(float(apart / (one.errors["bound"] + other.errors["bound"])))
    if not shares:
        return Evidence(0, 0, NOTHING)
    return counted_evidence(
        (share <= 1 for share in shares),
        f"In {GOOD} states, one for each N, q̈ is the same within the bounds of rounding; "
        f"the largest difference is {max(shares):.1g} of what they allow.",
    )


@paper_claim(
    "Sec. 10", "The snake has two degrees of freedom, whatever N.", true="a has full rank N."
)
def _degrees_of_freedom(found: PaperRecords) -> Evidence:
    counted = {
        links: record.counts["degrees of freedom"] for (links, _), record in found.solved.items()
    }
    good, of = share(number == 2 for number in counted.values())
    numbers = ", ".join(map(str, sorted(set(counted.values()))))
    return Evidence(good, of, f"n - rank(a) is {numbers} at {of} values of N.")


# ---- Errors: Figs. 3 to 6 ------------------------------------------------------------------------


@paper_claim(
    "Sec. 1",
    "Constraints at acceleration level make errors accumulate.",
    true="ȧv + a v̇ = 0 holds at every step but for its error, and nothing brings a v back to 0.",
    false="Nothing brings a v back to 0 once it is off. But output times lie between steps, and "
    "interpolation has an error of its own there, which comes and goes and is seen at a tight "
    "tolerance; and most error is made early, while the motion is fast.",
)
def _accumulates(found: PaperRecords) -> Evidence:
    ratios = []
    for key, (links, solver) in product(at_level(found, "acceleration"), points_of(found)):
        record = found.finished(links, key, solver)
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
    true=CONSTRUCTION,
)
def _fig_3(found: PaperRecords) -> Evidence:
    return _levels_compared(found, "constraint", _robot(found))


@paper_claim(
    "Fig. 3(b)",
    f"N = {PAPER_LINKS}: the constraint error of kane is much smaller than those of em and ml.",
    false="All three are rounding and nothing else: no formulation can be better. A difference at "
    "this level is one of how v is formed from u, not of the method.",
)
def _fig_3b(found: PaperRecords) -> Evidence:
    same_level = [key for key in at_level(found, "velocity") if key != KANE]
    ratios = ratios_of(found, "constraint", same_level, [KANE], _robot(found))
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
    false=STEPS_DECIDE,
)
def _fig_4(found: PaperRecords) -> Evidence:
    return _levels_compared(found, "energy", _robot(found))


@paper_claim(
    "Fig. 5",
    "N = 2 to 100: the norm of the constraint error is smaller with kane, em and ml.",
    true=CONSTRUCTION,
)
def _fig_5(found: PaperRecords) -> Evidence:
    return _levels_compared(found, "constraint", points_of(found))


@paper_claim(
    "Fig. 6",
    "N = 2 to 100: the norm of the energy error is smaller with kane, em and ml.",
    false=STEPS_DECIDE,
)
def _fig_6(found: PaperRecords) -> Evidence:
    good, of, said = _levels_compared(found, "energy", points_of(found))
    if len(found.solvers) > 1 and of:
        values = {
            solver: [
                value
                for links, key in product(found.links, found.formulations)
                if (value := found.value("energy", links, key, solver)) is not None
            ]
            for solver in found.solvers
        }
        medians = ", ".join(f"{median(v):.1g} J by {s}" for s, v in values.items() if v)
        said += f" Median norm: {medians}."
    return Evidence(good, of, said)


def _robot(found: PaperRecords) -> list[tuple[int, Solver]]:
    return [(links, solver) for links, solver in points_of(found) if links == PAPER_LINKS]


def _levels_compared(
    found: PaperRecords, quantity: str, points: Iterable[tuple[int, Solver]]
) -> Evidence:
    theirs, ours = (at_level(found, level) for level in ("acceleration", "velocity"))
    return clearly_larger(
        f"Error of {', '.join(theirs)} over that of {', '.join(ours)}",
        ratios_of(found, quantity, theirs, ours, points),
    )


# ---- CPU time: Fig. 7 and the conclusion ---------------------------------------------------------


@paper_claim(
    "Fig. 7",
    "N = 2 to 100: kane takes significantly less CPU time than every other method.",
    true="It costs O(N) a right-hand side and forms no matrix of order n.",
    false="The factor of two is missing where ml, with the same recursion, only adds M in O(N²), "
    "and at small N, where the integrator, sines and cosines take the same time for all.",
)
def _fig_7(found: PaperRecords) -> Evidence:
    return clearly_larger(
        "Time over that of kane", ratios_of(found, "cpu_seconds", other_formulations(found), [KANE])
    )


@paper_claim(
    "Fig. 7, Sec. 12",
    "The advantage of kane in CPU time grows with the number of links.",
    true="kane costs O(N) a right-hand side, ml O(N²), the others O(N³).",
    false="ml has the same recursion, and its O(N²) for M is still small beside it at N = 100.",
)
def _grows(found: PaperRecords) -> Evidence:
    ratios, many = [], max(found.links, default=0)
    for key, solver in product(other_formulations(found), found.solvers):
        pair = (key, solver), (KANE, solver)
        both = [n for n in found.links if all(found.finished(n, *one) for one in pair)]
        if len(both) > 1 and both[-1] == many:
            ends = [(both[0], solver), (many, solver)]
            few, most = ratios_of(found, "cpu_seconds", [key], [KANE], ends)
            ratios.append(Ratio(most.times / few.times, key, solver))
    what = f"Time over that of kane at N = {many}, over the same at the fewest links finished"
    good, of, said = clearly_larger(what, ratios)
    slopes = {key: growth(found, key) for key in found.formulations}
    exponents = [
        f"{key} {' to '.join(sorted({f'{min(s):.2f}', f'{max(s):.2f}'}))}"
        for key, s in slopes.items()
        if s
    ]
    if exponents:
        said += f" From N = {LARGE} on time grows as N to the power {', '.join(exponents)}."
    return Evidence(good, of, said)


@paper_claim(
    "Sec. 12",
    "Methods based on Lagrange's equations take about 10 times the CPU time of kane.",
    true="Within a factor of two of 10 throughout.",
    false="There is no one factor: time grows with a power of N that differs from method to "
    "method. What the paper measured also depends on how its right-hand sides were programmed, "
    "which it does not say.",
)
def _ten_times(found: PaperRecords) -> Evidence:
    others = other_formulations(found)
    ratios = ratios_of(found, "cpu_seconds", others, [KANE])
    if not ratios:
        return Evidence(0, 0, NOTHING)
    passes = []
    for solver in found.solvers:
        for links in found.links:
            here = ratios_of(found, "cpu_seconds", others, [KANE], [(links, solver)])
            if here and mean(ratio.times for ratio in here) > 10:
                passes.append(f"N = {links} ({solver})")
                break
    return counted_evidence(
        (10 / CLEAR <= ratio.times <= 10 * CLEAR for ratio in ratios),
        f"{GOOD} ratios lie between {10 / CLEAR:g} and {10 * CLEAR:g}; they go from "
        f"{min(ratios)} to {max(ratios)}, median {median(r.times for r in ratios):.3g}. The mean "
        f"over the methods first exceeds 10 at {', '.join(passes) or 'no N'}.",
    )


@paper_claim(
    "Abstract, Sec. 12",
    "kane is superior to the other methods: in constraint error, energy error and CPU time no "
    "other is clearly better.",
    true="It keeps the constraints and costs O(N) a right-hand side.",
    false="It keeps the constraints and costs O(N) a right-hand side, but has no smaller energy "
    "error than others: see Fig. 6.",
)
def _superior(found: PaperRecords) -> Evidence:
    good: dict[str, list[bool]] = {quantity: [] for quantity in QUANTITIES}
    for quantity, (links, solver) in product(QUANTITIES, points_of(found)):
        ours = found.value(quantity, links, KANE, solver)
        theirs = [found.value(quantity, links, key, solver) for key in other_formulations(found)]
        done = [value for value in theirs if value is not None]
        if ours is None or not done:
            continue
        errors = found.motions[links, KANE, solver].errors
        rounding = quantity == "constraint" and ours <= errors["constraint allowed"]
        good[quantity].append(rounding or ours <= CLEAR * min(done))
    text = ", ".join(
        f"{QUANTITIES[quantity]} in {sum(some)} of {len(some)}"
        for quantity, some in good.items()
        if some
    )
    flags = [flag for some in good.values() for flag in some]
    return Evidence(*share(flags), f"No other is clearly better: {text} cases.")
