"""Claims about errors: Figs. 3 to 6."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product
from statistics import mean, median

from eomcheck.lab.studies.paper.claims.claim import KANE, Evidence, claim
from eomcheck.lab.studies.paper.claims.comparing import (
    Ratio,
    at_level,
    clearly_larger,
    points_of,
    ratios_of,
)
from eomcheck.lab.studies.paper.measure import PAPER_LINKS, Found, Solver


@claim(
    "Sec. 1",
    "Constraints at acceleration level make errors accumulate.",
    true="ȧv + a v̇ = 0 holds at every step but for its error, and nothing brings a v back to 0.",
    false="Nothing brings a v back to 0 once it is off. But output times lie between steps, and "
    "interpolation has an error of its own there, which comes and goes and is seen at a tight "
    "tolerance; and most error is made early, while the motion is fast.",
)
def _accumulates(found: Found) -> Evidence:
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


@claim(
    "Fig. 3",
    f"N = {PAPER_LINKS}: kane, em and ml have a smaller constraint error than the others.",
    true=CONSTRUCTION,
)
def _fig_3(found: Found) -> Evidence:
    return _levels_compared(found, "constraint", _robot(found))


@claim(
    "Fig. 3(b)",
    f"N = {PAPER_LINKS}: the constraint error of kane is much smaller than those of em and ml.",
    false="All three are rounding and nothing else: no formulation can be better. A difference at "
    "this level is one of how v is formed from u, not of the method.",
)
def _fig_3b(found: Found) -> Evidence:
    same_level = [key for key in at_level(found, "velocity") if key != KANE]
    ratios = ratios_of(found, "constraint", same_level, [KANE], _robot(found))
    return clearly_larger("Error over that of kane", ratios)


STEPS_DECIDE = (
    "It depends on the tolerance, which the paper does not give. The step control holds the "
    "estimated error of the numbers integrated at the tolerance. Formulations integrate different "
    "numbers, take different steps, and their energy errors follow the steps, not the level of "
    "the constraints or the number of equations."
)


@claim(
    "Fig. 4",
    f"N = {PAPER_LINKS}: kane, em and ml, with fewer equations, have a smaller energy error than "
    "the others.",
    false=STEPS_DECIDE,
)
def _fig_4(found: Found) -> Evidence:
    return _levels_compared(found, "energy", _robot(found))


@claim(
    "Fig. 5",
    "N = 2 to 100: the norm of the constraint error is smaller with kane, em and ml.",
    true=CONSTRUCTION,
)
def _fig_5(found: Found) -> Evidence:
    return _levels_compared(found, "constraint", points_of(found))


@claim(
    "Fig. 6",
    "N = 2 to 100: the norm of the energy error is smaller with kane, em and ml.",
    false=STEPS_DECIDE,
)
def _fig_6(found: Found) -> Evidence:
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


def _robot(found: Found) -> list[tuple[int, Solver]]:
    return [(links, solver) for links, solver in points_of(found) if links == PAPER_LINKS]


def _levels_compared(found: Found, quantity: str, points: Iterable[tuple[int, Solver]]) -> Evidence:
    theirs, ours = (at_level(found, level) for level in ("acceleration", "velocity"))
    return clearly_larger(
        f"Error of {', '.join(theirs)} over that of {', '.join(ours)}",
        ratios_of(found, quantity, theirs, ours, points),
    )
