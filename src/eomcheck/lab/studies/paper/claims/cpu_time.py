"""Claims about CPU time: Fig. 7 and the conclusion."""

from __future__ import annotations

from itertools import product
from statistics import mean, median

from eomcheck.lab.studies.paper.claims.claim import CLEAR, KANE, NOTHING, Evidence, claim
from eomcheck.lab.studies.paper.claims.comparing import (
    Ratio,
    clearly_larger,
    others,
    points_of,
    ratios_of,
    share,
)
from eomcheck.lab.studies.paper.measure import LARGE, QUANTITIES, Found, growth


@claim(
    "Fig. 7",
    "N = 2 to 100: kane takes significantly less CPU time than every other method.",
    true="It costs O(N) a right-hand side and forms no matrix of order n.",
    false="The factor of two is missing where ml, with the same recursion, only adds M in O(N²), "
    "and at small N, where the integrator, sines and cosines take the same time for all.",
)
def _fig_7(found: Found) -> Evidence:
    return clearly_larger(
        "Time over that of kane", ratios_of(found, "cpu_seconds", others(found), [KANE])
    )


@claim(
    "Fig. 7, Sec. 12",
    "The advantage of kane in CPU time grows with the number of links.",
    true="kane costs O(N) a right-hand side, ml O(N²), the others O(N³).",
    false="ml has the same recursion, and its O(N²) for M is still small beside it at N = 100.",
)
def _grows(found: Found) -> Evidence:
    ratios, many = [], max(found.links, default=0)
    for key, solver in product(others(found), found.solvers):
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


@claim(
    "Sec. 12",
    "Methods based on Lagrange's equations take about 10 times the CPU time of kane.",
    true="Within a factor of two of 10 throughout.",
    false="There is no one factor: time grows with a power of N that differs from method to "
    "method. What the paper measured also depends on how its right-hand sides were programmed, "
    "which it does not say.",
)
def _ten_times(found: Found) -> Evidence:
    ratios = ratios_of(found, "cpu_seconds", others(found), [KANE])
    if not ratios:
        return Evidence(0, 0, NOTHING)
    good, of = share(10 / CLEAR <= ratio.times <= 10 * CLEAR for ratio in ratios)
    passes = []
    for solver in found.solvers:
        for links in found.links:
            here = ratios_of(found, "cpu_seconds", others(found), [KANE], [(links, solver)])
            if here and mean(ratio.times for ratio in here) > 10:
                passes.append(f"N = {links} ({solver})")
                break
    return Evidence(
        good,
        of,
        f"{good} of {of} ratios lie between {10 / CLEAR:g} and {10 * CLEAR:g}; they go from "
        f"{min(ratios)} to {max(ratios)}, median {median(r.times for r in ratios):.3g}. The mean "
        f"over the methods first exceeds 10 at {', '.join(passes) or 'no N'}.",
    )


@claim(
    "Abstract, Sec. 12",
    "kane is superior to the other methods: in constraint error, energy error and CPU time no "
    "other is clearly better.",
    true="It keeps the constraints and costs O(N) a right-hand side.",
    false="It keeps the constraints and costs O(N) a right-hand side, but has no smaller energy "
    "error than others: see Fig. 6.",
)
def _superior(found: Found) -> Evidence:
    good: dict[str, list[bool]] = {quantity: [] for quantity in QUANTITIES}
    for quantity, (links, solver) in product(QUANTITIES, points_of(found)):
        ours = found.value(quantity, links, KANE, solver)
        theirs = [found.value(quantity, links, key, solver) for key in others(found)]
        done = [value for value in theirs if value is not None]
        if ours is None or not done:
            continue
        errors = found.motions[links, KANE, solver].errors
        rounding = quantity == "constraint" and ours <= errors["constraint allowed"]
        good[quantity].append(rounding or ours <= CLEAR * min(done))
    said = ", ".join(
        f"{QUANTITIES[quantity]} in {sum(some)} of {len(some)}"
        for quantity, some in good.items()
        if some
    )
    flags = [flag for some in good.values() for flag in some]
    return Evidence(*share(flags), f"No other is clearly better: {said} cases.")
