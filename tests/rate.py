"""Measure how many ordinary snakes a second are looked at: in lanes, and one by one.

    python -m tests.rate [--links 1..12] [--batch 512] [--alone 4] [--seed 0]

The same claims on the same states, all that lanes can look at. Both are warm, in one process; times
are CPU times, for a core is seldom one's own.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from eomcheck.claims import CLAIMS
from eomcheck.claims.batched_claims import batchable_claims
from eomcheck.draws.fuzz_cases import ORDINARY, draw_cases, structural_variants
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.fuzzing.screening import check_case, screen
from eomcheck.lab.fuzzing.state_rounds import BATCH
from eomcheck.lab.option_parsing import parse_interval
from eomcheck.scenes import Snake


def main() -> None:
    """Measure, and print a line a number of links, and the mean."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--links", default="1..12")
    parser.add_argument("--batch", type=int, default=BATCH)
    parser.add_argument("--alone", type=int, default=4)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    low, high = parse_interval(options.links)
    claims, keys = batchable_claims(tuple(CLAIMS)), tuple(FORMULATIONS)
    formulations = tuple(FORMULATIONS.values())
    times = []
    print("links  states/s in lanes  with drawing  one by one  times")
    for links in range(low, high + 1):
        random = np.random.default_rng([options.seed, links])
        stratum = structural_variants(Snake, (links,))[0]
        warm, _ = draw_cases(Snake, stratum, (ORDINARY,), options.batch, random)
        screen(warm, formulations, claims, enclosed_every=0)
        start = time.process_time()
        cases, _ = draw_cases(Snake, stratum, (ORDINARY,), options.batch, random)
        middle = time.process_time()
        screen(cases, formulations, claims, enclosed_every=0)
        end = time.process_time()
        check_case(cases[0], claims, keys)
        before = time.process_time()
        for case in cases[: options.alone]:
            check_case(case, claims, keys)
        alone = (time.process_time() - before) / options.alone
        drawing, lanes = (middle - start) / len(cases), (end - middle) / len(cases)
        times.append((lanes, drawing + lanes, alone))
        print(_line(str(links), times[-1]), flush=True)
    print(_line("mean", np.mean(times, axis=0).tolist()))


def _line(name: str, seconds) -> str:
    lanes, both, alone = seconds
    rates = f"{1 / lanes:17.0f}  {1 / both:12.0f}  {1 / alone:10.1f}"
    return f"{name:5}  {rates}  {alone / both:5.0f}"


if __name__ == "__main__":
    main()
