"""Reference solutions of motions: the cases, their files, and their computation.

    eomcheck reference NAME

computes one anew, by two methods (Taylor series and extrapolation in extended precision), and
writes it to `validation/references`. The difference of the two is the uncertainty of the reference.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from eomcheck import __version__
from eomcheck.console import progress
from eomcheck.errors import InputError, registered, safe_repr
from eomcheck.evaluation.dynamics import speeds_of
from eomcheck.lab.show.table import Cell, ResultTable
from eomcheck.lab.store.parallel_map import parallel_map
from eomcheck.mechanics.scene import Scene
from eomcheck.motion.reference import extended_reference, extended_velocity, taylor_reference
from eomcheck.motion.reference_solution import (
    Reference,
    difference,
    load_reference,
    reference_from_runs,
    save_reference,
)
from eomcheck.numbers.generic import Array
from eomcheck.scene_lookup import lookup_name, scene_named
from eomcheck.scenes import (
    Andrews,
    Bicycle,
    Bricard,
    ChainPendulum,
    FlyballGovernor,
    FourBarChain,
    RollingDisk,
    Sleigh,
    Snake,
    TurntableBall,
)

# ---- Cases ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ReferenceCase:
    """A motion with a reference solution, `parts` intervals to `end` from `initial_state().q`.

    It can be pickled, so `scene` is no lambda.
    """

    description: str
    scene: Callable[[], Scene]
    u0: tuple[float, ...] = (0.0, 0.0)
    end: float = 1.0
    """End of the motion, s."""
    parts: int = 20
    minutes: float = 1.0
    """Approximate computing time on one core, min."""

    @property
    def times(self) -> Array:
        """Output times (parts + 1,), s."""
        return np.arange(self.parts + 1) * self.end / self.parts


REFERENCE_CASES: dict[str, ReferenceCase] = {
    "paper-rest": ReferenceCase(
        "the paper's seven-link robot, released at rest", Snake.paper, minutes=4.0
    ),
    "paper-rolling": ReferenceCase(
        "the paper's seven-link robot, started with u = (1 m/s, 0.5 rad/s)",
        Snake.paper,
        (1.0, 0.5),
        minutes=4.0,
    ),
    "coil-2": ReferenceCase(
        "two links coiled by 308°, released at rest", partial(Snake.coil, 2), minutes=2.0
    ),
    # One second of this motion would take the second integration half an hour.
    "coil-20": ReferenceCase(
        "twenty links coiled by 308°, released at rest, 0.25 s only: more would take long",
        partial(Snake.coil, 20),
        end=0.25,
        parts=5,
        minutes=10.0,
    ),
    "free-3": ReferenceCase(
        "three links without springs, started with u = (1 m/s, 0.5 rad/s), 10 s",
        partial(replace, Snake.coil(3), stiffness=None),
        (1.0, 0.5),
        end=10.0,
    ),
    "pendulum-3": ReferenceCase(
        "three rods swung, 2 s", partial(ChainPendulum.rods, 3), (1.0, 0.5, -0.5), end=2.0
    ),
    "sleigh": ReferenceCase(
        "Chaplygin's sleigh, pushed and turning, 5 s", Sleigh, (1.0, 2.0), end=5.0
    ),
    "disk": ReferenceCase("a tilted disk that wobbles and rolls", RollingDisk, (0.3, 1.0, 4.0)),
    "turntable": ReferenceCase(
        "a ball on a turntable whose spin swings, 2 s",
        partial(TurntableBall, swing=1.0, frequency=3.0),
        (1.0, 0.5, 2.0),
        end=2.0,
    ),
    "four-bar-2": ReferenceCase(
        "two windows of the four-bar chain, 1 s",
        partial(replace, FourBarChain.rods(2), angle=1.0),
        (1.0,),
    ),
    "andrews": ReferenceCase(
        "Andrews' squeezing mechanism, released at rest, 0.03 s", Andrews, (0.0,), end=0.03
    ),
    "governor": ReferenceCase(
        "the flyball governor, its springs and dampers as published, 0.1 s",
        FlyballGovernor,
        (0.0, 6.0, 0.0, 0.0),
        end=0.1,
    ),
    "bricard": ReferenceCase(
        "Bricard's mechanism, released along a cube's edges, 1 s", Bricard, (0.0,)
    ),
    "bicycle": ReferenceCase(
        "the benchmark bicycle at 4.6 m/s, pushed to lean, 1 s", Bicycle, (0.5, 0.0, 4.6 / 0.3)
    ),
}
"""Name -> case."""


def reference_case(name: str) -> ReferenceCase:
    """Return the case called `name`.

    Raises:
        UnknownNameError: there is none.
    """
    return registered("reference", name, REFERENCE_CASES)


# ---- Files and table -----------------------------------------------------------------------------


def stored_reference(name: str, folder: Path, scene: str | None = None) -> Reference:
    """Return the reference solution that a folder holds under this name.

    Args:
        name: its name.
        folder: the folder.
        scene: name of its scene, see `eomcheck.scene_lookup.scene_named`, if it is not built in.

    Raises:
        InputError: there is none (the message explains how to get or compute it), or it cannot be
            read.
    """
    path = folder / f"{name}.json"
    if not path.exists():
        hint = (
            f"go to a checkout of eomcheck, name its folder by --references FOLDER, or compute it: "
            f"eomcheck reference {name} --folder FOLDER"
            if name in REFERENCE_CASES
            else f"references of eomcheck are: {', '.join(REFERENCE_CASES)}"
        )
        if scene is not None:
            hint = f"compute it: eomcheck reference {name} --scene {scene} --folder {folder}"
        raise InputError(f"the reference solution {str(path)!r} is missing; {hint}")
    return load_reference(path, None if scene is None else type(scene_named(scene)))


def reference_name(scene: Scene) -> str:
    """Return the name of the reference solution of a scene by default: letters, digits, dashes.

    It is none of `REFERENCE_CASES`.
    """
    name = re.sub(r"[^a-z0-9]+", "-", scene.name.lower()).strip("-") or scene.key
    return f"{name}-motion" if name in REFERENCE_CASES else name


def case_of(scene: Scene, u0: Sequence[float] | None, end: float, parts: int = 20) -> ReferenceCase:
    """Return the case of a scene from its initial state.

    Args:
        scene: the scene, built in, of a user's file or a robot.
        u0: generalized speeds at the start (p,), by default those of the initial state.
        end: end of the motion, s.
        parts: number of intervals between output times.

    Raises:
        InputError: the end is no positive number.
        RefusedError: the scene has no generalized speeds at its start.
    """
    if not 0.0 < end < math.inf:
        raise InputError(f"end = {end}, expected a positive number of seconds")
    q, v = scene.initial_state()
    start = speeds_of(scene, q, v).tolist() if u0 is None else u0
    return ReferenceCase(safe_repr(scene), partial(_same, scene), tuple(start), end, parts)


def _same(scene: Scene) -> Scene:
    return scene


def write_reference(reference: Reference, folder: Path, scene: str | None = None) -> Path:
    """Write `reference` to `folder` under its name and return the path.

    Args:
        reference: the reference.
        folder: the folder.
        scene: name by which its scene is looked up, if it is not built in.

    Raises:
        InputError: the file cannot be written.
    """
    path = folder / f"{reference.name}.json"
    command = f"eomcheck reference {reference.name}" + (f" --scene {scene}" if scene else "")
    kind = "" if scene is None else lookup_name(type(reference.scene), scene)
    save_reference(reference, path, kind, made_by=command, eomcheck=__version__)
    return path


COLUMNS = (
    "reference",
    "to t, s",
    "uncertainty",
    "energy drift: Taylor",
    "extrapolation",
    "steps: Taylor",
    "extrapolation",
    "seconds: Taylor",
    "extrapolation",
)


def reference_table(references: Iterable[Reference]) -> ResultTable:
    """Return the table of references: their uncertainties, energy drifts, steps and run times."""
    rows = [
        (
            Cell(one.name, "name"),
            f"{one.times[-1]:g}",
            f"{one.uncertainty:.1g}",
            *("" if run.drift is None else f"{run.drift:.1g}" for run in one.runs),
            *(str(run.facts["steps"]) for run in one.runs),
            *(f"{run.facts['seconds']:.0f}" for run in one.runs),
        )
        for one in references
    ]
    return ResultTable("references", "", COLUMNS, rows)


# ---- Computing -----------------------------------------------------------------------------------

PERCENT = 100

SHORTER = 3.0
"""Factor by which the second run of the Taylor series has shorter steps than the longest one."""


def produce_all(
    cases: Mapping[str, ReferenceCase], executor: str | None = None
) -> Iterator[Reference]:
    """Yield the `Reference` of each case as it is computed; several cases run in parallel.

    Args:
        cases: name -> case.
        executor: see `eomcheck.lab.store.parallel_map.executor`.

    Raises:
        EngineError: heyoka is not installed.
        RefusedError: a motion cannot be integrated to its end.
        WorkerError, InputError: see `eomcheck.lab.store.parallel_map.parallel_map`.
    """
    if len(cases) < 2:
        for name, case in cases.items():
            yield produce(name, case)
        return
    # The longest first: started last, it would run alone at the end.
    items = sorted(cases.items(), key=lambda item: -item[1].minutes)
    with progress("computing {reference}", len(items)) as advance:
        for _, reference in parallel_map(executor, _produce_quietly, items):
            advance()
            yield reference


def _produce_quietly(item: tuple[str, ReferenceCase]) -> Reference:
    return produce(*item, shown=False)


def produce(name: str, case: ReferenceCase, shown: bool = True) -> Reference:
    """Return the `Reference` of `case`, computed by both methods, with a progress bar if `shown`.

    Raises:
        EngineError: heyoka is not installed.
        RefusedError: the motion cannot be integrated to its end.
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
        v0 = extended_velocity(scene, q0, u0, times[0])
        second = extended_reference(scene, q0, v0, times, watch=watch)
    check = {
        "longest_step": limit,
        "steps": again.facts["steps"],
        "energy_drift": again.drift,
        "largest_difference": max(difference(first, again)),
    }
    return reference_from_runs(name, case.description, scene, q0, u0, (first, second), check)
