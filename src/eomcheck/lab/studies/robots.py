"""Robot descriptions from installed packages: checked, proved, and compared between libraries."""

from __future__ import annotations

import time
import tomllib
from collections.abc import Collection, Iterator, Sequence
from importlib import metadata
from pathlib import Path
from typing import Annotated, NamedTuple

from eomcheck.claims.proof import prove_structure
from eomcheck.claims.run import validate
from eomcheck.descriptions.mechanism_class import Mechanism
from eomcheck.descriptions.urdf_reader import FLOATING
from eomcheck.errors import EngineError, InputError
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.library_comparison import QUANTITIES, LibraryReading, compare_libraries
from eomcheck.lab.option_parsing import Seed, check_count
from eomcheck.lab.show.table import Cell, ResultTable
from eomcheck.lab.store.record_file import Record, Settings, rows_in
from eomcheck.lab.study import Study, failed, unfinished
from eomcheck.scene_lookup import robot_named

ROBOTS_FILE = Path(__file__).with_name("robots.toml")
"""The list of robots; `python -m tests.choose_robots` adds to it."""


class RobotFile(NamedTuple):
    """Robot description in a package."""

    package: str
    """Package on PyPI that contains it."""
    file: str
    """End of its path in the package."""


ROBOTS = {
    name: RobotFile(**entry)
    for name, entry in tomllib.loads(ROBOTS_FILE.read_text(encoding="utf-8")).items()
}
"""Name -> the description of this robot."""

WALKING = "solo12", "anymal"
"""Names of the robots that are also checked with a free base."""


def robot_path(robot: str) -> Path:
    """Return the file of a robot of `ROBOTS`, or `robot` itself as a path.

    Raises:
        EngineError: the package with its description is not installed.
        InputError: it is neither a known name nor a file.
    """
    if robot not in ROBOTS:
        path = Path(robot)
        if not path.is_file():
            known = ", ".join(ROBOTS)
            raise InputError(f"robot = {robot!r}, expected a file or one of: {known}")
        return path
    return packaged_file(robot, ROBOTS[robot])


def packaged_file(name: str, robot: RobotFile) -> Path:
    """Return the path of a robot description in its package.

    Args:
        name: name of the robot.
        robot: its package and file.

    Raises:
        EngineError: the package is not installed, or has no such file.
    """
    package, end = robot
    try:
        files = metadata.files(package) or []
    except metadata.PackageNotFoundError:
        raise EngineError(f"{name} comes with {package}, which is not installed") from None
    for file in files:
        if str(file).endswith(end):
            return Path(str(file.locate()))
    raise EngineError(f"{package} {metadata.version(package)} has no {end}")


def cells(
    *,
    robot: Annotated[list[str] | None, "Robot by name, or its file; repeat for more."] = None,
    free: Annotated[list[str] | None, "The same, its base free; repeat for more."] = None,
    states: Annotated[int, "Random states of a robot."] = 20,
    seed: Seed = 0,
) -> Iterator[Settings]:
    """Yield a cell for each robot.

    Raises:
        InputError: no such robot, or no states.
    """
    check_count(states=states)
    for chosen in chosen_robots(robot, free):
        yield chosen | {"states": states, "seed": seed}


def chosen_robots(
    robot: list[str] | None, free: list[str] | None, more: Collection[str] = ()
) -> Iterator[Settings]:
    """Yield the settings of the robots that are named, by default all, and those with a free base.

    Args:
        robot: names of `ROBOTS`, files, or names in `more`.
        free: the same, with a free base.
        more: further names that stand for no file.

    Raises:
        InputError: it is neither a known name nor a file.
    """
    if robot is free is None:
        robot, free = [*ROBOTS, *more], [*WALKING]
    for name, floating in [*((x, False) for x in robot or ()), *((x, True) for x in free or ())]:
        if name not in ROBOTS and name not in more:
            robot_path(name)
        yield {"robot": name, "free": floating}


def chosen_robot(settings: Settings) -> Mechanism:
    """Return the robot of a cell, as its file describes it.

    Raises:
        EngineError: the package with its description is not installed.
    """
    file = str(robot_path(settings["robot"]))
    return robot_named(f"{file}:{FLOATING}" if settings["free"] else file)()


def _check_robot(settings: Settings) -> Record:
    """Check, prove and compare one robot."""
    states, seed = settings["states"], settings["seed"]
    try:
        scene = chosen_robot(settings)
    except EngineError as missing:
        return Record(STUDY.key, settings, "refused", str(missing))
    start = time.perf_counter()
    checked = [one.verdict for one in validate(scene, examples=states, seed=seed)]
    validated = time.perf_counter()
    formulations = tuple(f for f in FORMULATIONS.values() if f.applies_to(scene))
    proved = [one.verdict for one in prove_structure(scene, formulations, 4, seed)]
    done = time.perf_counter()
    counts = {
        "coordinates": scene.n,
        "passed": checked.count("passed"),
        "failed": checked.count("failed"),
        "proved": proved.count("passed"),
        "disproved": proved.count("failed"),
    }
    seconds = {"checks, s": validated - start, "proof, s": done - validated}
    rows = compare_libraries(scene, None, states, seed).readings(robot_label(settings))
    series = {"rows": [vars(row) for row in rows], "left out": [scene.source.ignored]}
    return Record(STUDY.key, settings, counts=counts, errors=seconds, series=series)


def robot_label(settings: Settings) -> str:
    """Return the name of the robot of a cell in tables."""
    return settings["robot"] + (", free" if settings["free"] else "")


# ---- Results -------------------------------------------------------------------------------------


def tables(records: Sequence[Record]) -> Iterator[ResultTable]:
    """Yield the table of checks and proofs by robot, and the table of libraries by robot."""
    done = [record for record in records if record.status == "done"]
    names = ("coordinates", "passed", "failed", "proved", "disproved")
    rows = [
        (
            Cell(robot_label(record.settings), "name"),
            *(str(record.counts[name]) for name in names),
            *(f"{seconds:.1f}" for seconds in record.errors.values()),
        )
        for record in done
    ]
    heads = ("robot", "coordinates", "checks passed", "failed", "identities proved", "disproved")
    yield ResultTable(
        "robots", "Our equations of each robot", (*heads, "checks, s", "proof, s"), rows
    )
    reads = rows_in(done, LibraryReading)
    libraries = list(dict.fromkeys(_key(one) for one in reads))
    rows = []
    for record in done:
        name = robot_label(record.settings)
        mine = {_key(one): one for one in reads if one.robot == name}
        rows.append((Cell(name, "name"), *(_cell(mine.get(key)) for key in libraries)))
    title = "The same file by others: largest difference of M from ours, and what they differ in"
    yield ResultTable("robots-by-library", title, ("robot", *libraries), rows)


def _key(one: LibraryReading) -> str:
    return one.library.partition(" ")[0]


def _cell(one: LibraryReading | None) -> Cell:
    if one is None:
        return Cell("-", "none")
    number = [f"{one.apart['M']:.0e}"] if one.apart else []
    words = number if one.verdict == "agrees" else [*number, one.verdict]
    return Cell(" ".join(words), one.kind)


def remarks(records: Sequence[Record]) -> Iterator[str]:
    """Yield the reasons why libraries differ or gave no answer."""
    yield from unfinished(records)
    for one in rows_in(records, LibraryReading):
        if one.verdict not in ("agrees", "agrees where decided", "no damping"):
            apart = ", ".join(f"{name} {one.apart[name]:.0e}" for name in QUANTITIES if one.apart)
            yield f"{one.robot}, {one.library}: {', '.join(filter(None, (apart, one.why)))}"


def alarm(records: Sequence[Record]) -> bool:
    """Return whether a check or proof of a robot failed, or a robot could not be checked."""
    bad = (one.counts.get("failed", 0) + one.counts.get("disproved", 0) for one in records)
    return failed(records) or any(bad)


STUDY = Study(
    key="robots",
    cells=cells,
    worker=lambda stored: _check_robot,
    tables=tables,
    remarks=remarks,
    label="looking at {robot}",
    alarm=alarm,
    reading="`no damping`: the library's algorithms leave out the dampers of the file.",
    small=True,
)
