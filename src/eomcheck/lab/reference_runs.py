"""How reference solutions are produced.

    eomcheck reference NAME

computes one anew, twice, and writes it to `validation/references`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from eomcheck.console import progress
from eomcheck.lab.reference_cases import Case
from eomcheck.lab.store.workers import spread
from eomcheck.motion.reference import consistent_velocity, extended_reference, taylor_reference
from eomcheck.motion.reference_io import Reference, difference, reference_of

PERCENT = 100

SHORTER = 3.0
"""The Taylor series runs again with steps shorter than its longest one by this factor."""


def produce_all(cases: Mapping[str, Case], where: str | None = None) -> Iterator[Reference]:
    """Yield the `Reference` of each case as it is known; several are spread over processes.

    Args:
        cases: name -> case.
        where: see `eomcheck.lab.store.executors.executor`.

    Raises:
        EngineError: heyoka is not installed.
        RefusedError: a motion cannot be followed to its end.
        WorkerError, InputError: see `eomcheck.lab.store.workers.spread`.
    """
    if len(cases) < 2:
        for name, case in cases.items():
            yield produce(name, case)
        return
    # The longest first: begun last, it would be waited for alone.
    items = sorted(cases.items(), key=lambda item: -item[1].minutes)
    with progress("computing {reference}", len(items)) as advance:
        for _, made in spread(where, _produce_quietly, items):
            advance()
            yield made


def _produce_quietly(item: tuple[str, Case]) -> Reference:
    return produce(*item, shown=False)


def produce(name: str, case: Case, shown: bool = True) -> Reference:
    """Return the `Reference` of `case`, computed by both methods, under a progress bar if `shown`.

    Raises:
        EngineError: heyoka is not installed.
        RefusedError: the motion cannot be followed to its end.
    """
    scene, u0, times = case.scene(), np.array(case.u0), case.times.tolist()
    q0, _ = scene.initial_state()
    done = 0
    with progress(
        f"computing {name}, about {case.minutes:g} min" if shown else "", PERCENT
    ) as advance:

        def watch(t: float) -> None:
            # The second integration takes nearly all the time.
            nonlocal done
            while done < int(PERCENT * t / case.end):
                advance()
                done += 1

        first = taylor_reference(scene, q0, u0, times)
        limit = first.facts["longest_step"] / SHORTER
        again = taylor_reference(scene, q0, u0, times, longest_step=limit)
        v0 = consistent_velocity(scene, q0, u0, times[0])
        second = extended_reference(scene, q0, v0, times, watch=watch)
    check = {
        "longest_step": limit,
        "steps": again.facts["steps"],
        "energy_drift": again.drift,
        "largest_difference": max(difference(first, again)),
    }
    return reference_of(name, case.description, scene, q0, u0, (first, second), check)
