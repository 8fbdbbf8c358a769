"""Robots from their files: read, compared with what Pinocchio reads, validated and proved."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from eomcheck.claims.finding import DECIDED, Finding
from eomcheck.claims.proof import prove
from eomcheck.claims.run import Run, Selection
from eomcheck.claims.strata import state_cases
from eomcheck.engines.answers import Answers
from eomcheck.engines.parsed import ParsedByPinocchio
from eomcheck.errors import InputError
from eomcheck.evaluation.doubles import Evaluation
from eomcheck.evaluation.tolerance import largest
from eomcheck.lab.options import Seed, at_least_one
from eomcheck.lab.show.sheet import Cell, Sheet
from eomcheck.lab.store.records import Record, Settings, record_of_rows, rows_of
from eomcheck.lab.study import Study, failed, unfinished
from eomcheck.mechanics.described.mechanism import Mechanism
from eomcheck.scenes import from_urdf

POSES = 20
"""Random states in which M, B and Q are compared."""


@dataclass(frozen=True)
class Robot:
    """What came of one robot, called by the name of its file.

    `mass_matrix`, `bias` and `forces` are the largest differences from what Pinocchio's parser and
    algorithms give, relative to the largest entry, None where it cannot hold the joints; `share`
    is the largest observed / allowed of all claims.
    """

    robot: str
    floating: bool
    coordinates: int
    bodies: int
    version: str
    mass_matrix: float | None
    bias: float | None
    forces: float | None
    passed: int
    failed: int
    share: float
    proved: int
    disproved: int
    read_seconds: float
    prove_seconds: float
    left_out: str


def cells(
    *,
    robot: Annotated[list[str] | None, "URDF file, its root fixed; repeat for more."] = None,
    free: Annotated[list[str] | None, "URDF file, its root free; repeat for more."] = None,
    states: Annotated[int, "Random states that every claim is looked at in."] = 5,
    points: Annotated[int, "Random points per identity."] = 4,
    seed: Seed = 0,
) -> Iterator[Settings]:
    """Yield a cell for each robot.

    Raises:
        InputError: no robot, no states or points, or no such file.
    """
    at_least_one(states=states, points=points)
    files = [*((path, False) for path in robot or ()), *((path, True) for path in free or ())]
    if not files:
        raise InputError("no robot: name files by --robot or --free")
    for path, floating in files:
        if not Path(path).is_file():
            raise InputError(f"{path!r} is not a file")
        where = {"robot": path, "floating": floating}
        yield where | {"states": states, "points": points, "seed": seed}


def _look(settings: Settings) -> Record:
    """Read one robot, and judge it."""
    start = time.perf_counter()
    try:
        scene = from_urdf(settings["robot"], floating=settings["floating"])
    except InputError as refusal:
        return Record(STUDY.key, settings, "refused", str(refusal))
    read = time.perf_counter() - start
    engines = [ParsedByPinocchio, "pinocchio", "casadi"]
    selection = Selection.of(None, engines, None, scenes=[scene])
    run = Run()
    for one, state in state_cases(scene, settings["states"], settings["seed"]):
        run.look_at(one, state, selection)
    start = time.perf_counter()
    identities = prove(scene, points=settings["points"], seed=settings["seed"])
    seconds = time.perf_counter() - start
    row = Robot(
        Path(settings["robot"]).stem,
        settings["floating"],
        scene.n,
        scene.plan.bodies,
        ParsedByPinocchio.version(),
        *_differences(scene, settings["seed"]),
        _count(run.findings, "passed"),
        _count(run.findings, "failed"),
        max((one.ratio for one in run.findings if one.verdict in DECIDED), default=0.0),
        _count(identities, "passed"),
        _count(identities, "failed"),
        read,
        seconds,
        scene.made.left_out,
    )
    return record_of_rows(STUDY.key, settings, [row])


def _count(findings: Sequence[Finding], verdict: str) -> int:
    return sum(one.verdict == verdict for one in findings)


def _differences(scene: Mechanism, seed: int) -> tuple[float | None, float | None, float | None]:
    """Return the largest relative differences of M, B and Q from what Pinocchio reads."""
    if not ParsedByPinocchio.represents(scene):
        return None, None, None
    answers, random = Answers(ParsedByPinocchio(scene)), np.random.default_rng(seed)
    found = [0.0, 0.0, 0.0]
    for _ in range(POSES):
        q = np.array([random.uniform(one.low, one.high) for one in scene.coordinate_ranges()])
        v = random.uniform(-3.0, 3.0, scene.n)
        M, Q, B, *_ = Evaluation(scene, q, v).terms
        theirs = answers.mass_matrix(q), answers.bias(q, v), answers.forces(q, v)
        for i, (ours, other) in enumerate(zip((M, B, Q), theirs, strict=True)):
            size = largest(other)
            if ours is not None and size > 0:
                found[i] = max(found[i], largest(ours - other) / size)
    return found[0], found[1], found[2]


# ---- What it comes to ----------------------------------------------------------------------------


def sheets(found: Sequence[Record]) -> Iterator[Sheet]:
    """Yield one line for each robot."""
    rows = [
        (
            Cell(one.robot + (", free" if one.floating else ""), "name"),
            str(one.coordinates),
            str(one.bodies),
            *map(_difference, (one.mass_matrix, one.bias, one.forces)),
            f"{one.proved} of {one.proved + one.disproved}",
            f"{one.prove_seconds:.1f}",
            f"{one.passed} of {one.passed + one.failed}",
            f"{one.share:.0%}",
        )
        for one in rows_of(found, Robot)
    ]
    columns = (
        *("robot", "n", "bodies", "M", "B", "Q", "proved", "seconds"),
        *("passed", "of what rounding allows"),
    )
    yield Sheet("robots", "Robots from their files, against what Pinocchio reads", columns, rows)


def _difference(x: float | None) -> Cell:
    return Cell("-", "none") if x is None else Cell(f"{x:.0e}")


def said(found: Sequence[Record]) -> Iterator[str]:
    """Yield what was refused, and why."""
    for record in found:
        if record.status == "refused":
            yield f"refused: {record.reason}"
    yield from unfinished([record for record in found if record.status != "refused"])


def alarm(found: Sequence[Record]) -> bool:
    """Return whether something was disproved, or failed."""
    return failed(found) or any(one.failed or one.disproved for one in rows_of(found, Robot))


STUDY = Study(
    key="robots",
    cells=cells,
    worker=lambda known: _look,
    sheets=sheets,
    said=said,
    label="looking at robots",
    alarm=alarm,
    reading="M, B, Q: largest difference, relative to the largest entry.",
    small=True,
    spread_by=("robot", "floating"),
)
