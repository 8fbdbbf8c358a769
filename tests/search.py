"""Search hostile snakes for a right scene judged wrong, or a wrong number that does not say so.

    python -m tests.search [--accuracy 10000] [--checks 5000] [--seed 0] [--links 1..5]

Two campaigns of `eomcheck fuzz` without engines: one climbs true error / stated bound, with the
truth enclosed at every state; the other observed / allowed of every claim. The exit code is 1 if
there is a find.
"""

from __future__ import annotations

import argparse

from eomcheck.claims import CLAIMS
from eomcheck.draws.fuzz_cases import structural_variants
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.fuzzing.campaign import Campaign
from eomcheck.lab.fuzzing.screening import CheckFrequency
from eomcheck.lab.fuzzing.state_rounds import StatePlan
from eomcheck.lab.option_parsing import parse_interval
from eomcheck.lab.report.finding_output import ProgressPrinter, print_campaign
from eomcheck.scenes import Snake

ACCURACY = (
    ("true-error",),
    CheckFrequency(enclosures=1, balls=0, engines=0, checks=0, scalar_only=0),
)
CHECKS = tuple(one for one in CLAIMS if one != "coverage"), CheckFrequency(enclosures=0, engines=0)
"""Claims that take part, and how often what takes long is looked at."""


def main() -> int:
    """Search, print the highest of each, and return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--accuracy", type=int, default=10_000)
    parser.add_argument("--checks", type=int, default=5_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--links", default="1..5")
    options = parser.parse_args()
    low, high = parse_interval(options.links)
    finds = 0
    for (claims, ration), states in ((ACCURACY, options.accuracy), (CHECKS, options.checks)):
        if states:
            plan = StatePlan(
                Snake, options.seed, claims, tuple(FORMULATIONS), check_frequency=ration
            )
            campaign = Campaign(plan, Snake.key, structural_variants(Snake, range(low, high + 1)))
            campaign.run(states, on_round=ProgressPrinter())
            print_campaign(campaign)
            finds += len(campaign.failure_records)
    return 1 if finds else 0


if __name__ == "__main__":
    raise SystemExit(main())
