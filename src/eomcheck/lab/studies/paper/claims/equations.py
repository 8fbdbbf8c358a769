"""Claims about equations: Table I, Secs. 1 to 10."""

from __future__ import annotations

from itertools import product

import numpy as np

from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.show.text import ranges
from eomcheck.lab.store.groups import group
from eomcheck.lab.studies.paper.claims.claim import CLEAR, KANE, ML, NOTHING, Evidence, claim
from eomcheck.lab.studies.paper.claims.comparing import ratios_of, share
from eomcheck.lab.studies.paper.measure import PAPER_LINKS, Found


@claim(
    "Sec. 1",
    "The equations are singular where a wheel i ≥ 2 stands across its link (α_i = ±π/2); wheel 1 "
    "may.",
    false="Only the generalized speeds of ml and kane divide by cos α_i, for i ≥ 2. The partition "
    "of el and em makes a_1 singular for i ≤ N - 2 instead, wheel 1 included. im, au and gw need "
    "neither: it is not the robot that is singular.",
)
def _across(found: Found) -> Evidence:
    refused: dict[str, list[int]] = {key: [] for _, key in found.across}
    for (wheel, key), record in found.across.items():
        if record.status == "refused":
            refused[key].append(wheel)
    alike = group(refused, lambda key: ranges(refused[key]) or "none")
    good = ((wheel in refused[key]) == (wheel >= 2) for wheel, key in found.across)
    said = "; ".join(f"{', '.join(keys)}: {wheels}" for wheels, keys in alike.items())
    return Evidence(*share(good), f"Wheels refused at N = {PAPER_LINKS}: {said}.")


@claim(
    "Eqs. (6), (8), (14), (19)",
    "Numbers integrated: im 2n + r; au, el and gw n + r; em, ml and kane 2n - r.",
    false="Eq. (8) leaves out q̇, without which the state cannot be integrated; el and gw need no "
    "μ, since no multiplier is left among their unknowns.",
)
def _states(found: Found) -> Evidence:
    printed = {"im": (2, 1), "au": (1, 1), "el": (1, 1), "gw": (1, 1)}
    printed |= dict.fromkeys(("em", "ml", "kane"), (2, -1))
    sizes = {
        (links, key): record.counts["state"] for (links, key, _), record in found.motions.items()
    }
    good = []
    for (links, key), size in sizes.items():
        i, j = printed[key]
        good.append(size == i * (links + 2) + j * links)
    largest = max(found.links, default=0)
    said = ", ".join(f"{key} {size}" for (links, key), size in sizes.items() if links == largest)
    count, of = share(good)
    return Evidence(count, of, f"As printed in {count} of {of} cases. At N = {largest}: {said}.")


@claim(
    "Table I, Eqs. (7)-(23)",
    "The equations solved are 2n + r, n + r, n, n, n - r, n - r, n - r.",
    true="It counts the final system. el and em solve one of order r before it, gw one of order n "
    "and one of order r, which the table does not count.",
)
def _orders(found: Found) -> Evidence:
    good, of = share(
        record.counts["final system"]
        == FORMULATIONS[key].unknowns(record.counts["n"], record.counts["r"])
        for (_, key), record in found.solved.items()
    )
    largest = max(found.links, default=0)
    said = ", ".join(
        f"{key} {record.counts['final system']}"
        for (links, key), record in found.solved.items()
        if links == largest
    )
    return Evidence(
        good,
        of,
        f"The last system has this order in {good} of {of} cases. At N = {largest}: {said}.",
    )


@claim(
    "Table I",
    "im, au, el and gw use the constraints at acceleration level; em, ml and kane at velocity "
    "level, so that these cannot leave them.",
    true="v = W u + offset satisfies the constraints by construction, whatever u is; at "
    "acceleration level each step adds its own error.",
)
def _levels(found: Found) -> Evidence:
    kept: dict[str, list[float]] = {"acceleration": [], "velocity": []}
    for (_, key, _), record in found.motions.items():
        if record.status == "done":
            over = record.errors["constraint"] / record.errors["constraint allowed"]
            kept[FORMULATIONS[key].level].append(over)
    good = [over > 1 for over in kept["acceleration"]] + [over <= 1 for over in kept["velocity"]]
    said = "; ".join(
        f"{level} level {min(overs):.1g} to {max(overs):.1g}"
        for level, overs in kept.items()
        if overs
    )
    return Evidence(
        *share(good), f"Norm of the constraint error over what rounding explains: {said}."
    )


@claim(
    "Table I",
    "The multipliers come out directly with im and au only.",
    true="The other formulations eliminate them.",
    false="gw computes them by Eq. (12) before it needs the accelerations; they come out as well.",
)
def _multipliers(found: Found) -> Evidence:
    given = {key: record.counts["multipliers"] > 0 for (_, key), record in found.solved.items()}
    good = (here == FORMULATIONS[key].multipliers_in_paper for key, here in given.items())
    with_them = [key for key, here in given.items() if here]
    return Evidence(*share(good), f"They come out with {', '.join(with_them) or 'none'}.")


@claim(
    "Sec. 3",
    "The order of the system solved is a useful criterion for the time that a method takes.",
    true="Solving the final system takes most of the time.",
    false="Much of the time goes elsewhere: el, gw and em solve other systems before the final "
    "one, and on the way to a system of order n - r em spends O(N³), ml O(N²) and kane O(N).",
)
def _order_tells_time(found: Found) -> Evidence:
    orders = {key: FORMULATIONS[key].order for key in found.formulations}
    pairs = [(x, y) for x, y in product(orders, orders) if x != y]
    size = {key: FORMULATIONS[key].unknowns(102, 100) for key in orders}
    larger = [
        ratio
        for x, y in pairs
        if size[x] > size[y]
        for ratio in ratios_of(found, "cpu_seconds", [x], [y])
    ]
    equal = [
        ratio
        for x, y in pairs
        if orders[x] == orders[y]
        for ratio in ratios_of(found, "cpu_seconds", [x], [y])
        if ratio.times >= 1
    ]
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


@claim(
    "Sec. 9",
    "With the same generalized speeds kane and ml have the same equations of motion.",
    true="They are the same rational functions (`eomcheck prove` proves it for all parameters); "
    "only the rounding differs.",
)
def _kane_is_ml(found: Found) -> Evidence:
    shares = []
    for links in found.links:
        one, other = (found.solved.get((links, key)) for key in (KANE, ML))
        if one and other:
            apart = np.abs(np.subtract(one.series["vdot"], other.series["vdot"])).max()
            shares.append(float(apart / (one.errors["bound"] + other.errors["bound"])))
    if not shares:
        return Evidence(0, 0, NOTHING)
    good, of = share(share <= 1 for share in shares)
    return Evidence(
        good,
        of,
        f"In {good} of {of} states, one for each N, q̈ is the same within the bounds of rounding; "
        f"the largest difference is {max(shares):.1g} of what they allow.",
    )


@claim("Sec. 10", "The snake has two degrees of freedom, whatever N.", true="a has full rank N.")
def _degrees_of_freedom(found: Found) -> Evidence:
    counted = {
        links: record.counts["degrees of freedom"] for (links, _), record in found.solved.items()
    }
    good, of = share(number == 2 for number in counted.values())
    numbers = ", ".join(map(str, sorted(set(counted.values()))))
    return Evidence(good, of, f"n - rank(a) is {numbers} at {of} values of N.")
