"""Robot files of installed packages: those that can be read, and why others cannot.

A cell is one file of a package from PyPI whose name ends as a URDF, MJCF or SDF does. Packages are
found by their metadata and never imported. A file that our readers read is counted once for all
files with the same bodies and joints; a file that they refuse is counted by the kind of the reason.
A URDF or SDF of a body without joints is read with this body set free.
"""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from importlib import metadata
from pathlib import Path
from typing import Annotated

from eomcheck.descriptions.mechanism_class import Mechanism
from eomcheck.descriptions.urdf_reader import FLOATING
from eomcheck.errors import InputError, required
from eomcheck.lab.show.table import Cell, ResultTable
from eomcheck.lab.store.record_file import Record, Settings, group
from eomcheck.lab.study import Study
from eomcheck.scene_lookup import is_robot, robot_named

PACKAGES = (
    "example-robot-data",
    "pybullet",
    "drake",
    "dm_control",
    "gymnasium",
    "gymnasium-robotics",
    "brax",
    "playground",
    "robosuite",
    "metaworld",
    "airo-models",
    "armar",
    "dexmate-urdf",
    "fourier-robot-descriptions",
    "hello-robot-stretch-urdf",
    "icub-models",
    "jvrc_description",
    "rtb-data",
)
"""Packages on PyPI whose wheels contain robot descriptions."""

REASONS: dict[str, str] = {
    "part of other files": r"mujocoinclude",
    "nothing moves": r"no joint of it moves|has no joint|is static: nothing"
    r"|nothing that moves has inertia|moves nothing that has inertia"
    r"|without anything that has inertia|has no link$",
    "several models": r"has \d+ models",
    "no robot description": r"is no XML|declares a document type|^\S+ holds <[^>]+>, expected"
    r"|template for xacro",
    "a file that it names is missing": r"Error opening file|cannot be read: No such file",
    "not described here": r"not understood here|a deformable body|<composite>"
    r"|of a tendon in space|is of the kind|not linear|no part of an? [A-Z]+ known here|more than"
    r"|at most|of the plugin|closes a loop at|has the type '(gearbox|piston)'",
    "refused by MuJoCo": r"is refused by MuJoCo|gave no answer|ended",
    "invalid number or element": r"",
}
"""Kind of reason -> pattern of its sentences; the first that fits counts."""

FREED = ".urdf", ".sdf"
"""Ends of the names of files whose only body is set free."""

STILL, OURS = "nothing moves", "not described here"
"""Kinds of reasons: of files with bodies alone, and of files without a fault of their own."""


def kind_of_reason(sentence: str) -> str:
    """Return the kind of a reason, a key of `REASONS`."""
    return next(kind for kind, pattern in REASONS.items() if re.search(pattern, sentence))


def cells(
    *, package: Annotated[list[str] | None, "Package, or several: a,b. [default: installed]"] = None
) -> Iterator[Settings]:
    """Yield a cell for each robot file of the packages.

    Raises:
        InputError: a package is not installed, or none has a robot file.
        EngineError: MuJoCo, which reads MJCF files, is not installed.
    """
    required("mujoco", "mujoco")
    files = 0
    for name in PACKAGES if package is None else package:
        try:
            version, contents = metadata.version(name), metadata.files(name) or []
        except (metadata.PackageNotFoundError, ValueError):
            if package is None:
                continue
            raise InputError(f"package = {name!r}: it is not installed") from None
        for file in sorted(str(file) for file in contents if is_robot(str(file))):
            files += 1
            yield {"package": name, "version": version, "file": file}
    if not files:
        raise InputError(f"package = {package!r}: no robot file is installed")


def path_in_package(package: str, file: str) -> Path:
    """Return the path of a file of an installed package."""
    return Path(str(metadata.distribution(package).locate_file(file)))


def _read(settings: Settings) -> Record:
    """Read one file."""
    path = path_in_package(settings["package"], settings["file"])
    try:
        scene = _scene_of(path)
    except InputError as refusal:
        reason = str(refusal).replace(f"{path.parent}/", "")
        return Record(STUDY.key, settings, "refused", reason)
    series = {"digest": [digest_of(scene)]}
    counts = {"coordinates": scene.n, "free": int(bool(scene.source.floating))}
    return Record(STUDY.key, settings, counts=counts, series=series)


def _scene_of(path: Path) -> Mechanism:
    """Return the robot in a file; a URDF or SDF in which nothing moves is set free.

    Raises:
        InputError: it cannot be read.
    """
    try:
        return robot_named(str(path))()
    except InputError as refusal:
        static = "is static" in str(refusal)
        if path.suffix not in FREED or static or kind_of_reason(str(refusal)) != STILL:
            raise
        return robot_named(f"{path}:{FLOATING}")()


def digest_of(scene: Mechanism) -> str:
    """Return a digest of the bodies and joints of a robot, in their order, without their names."""
    source = scene.source
    joints = [joint._replace(name="") for joint in source.topology.joints]
    parts = joints, source.topology.constraints, source.defaults
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]


# ---- Results -------------------------------------------------------------------------------------


def distinct_robots(records: Sequence[Record]) -> list[Record]:
    """Return the Records of files that were read, the first one of each robot."""
    read = [record for record in records if record.status == "done"]
    return [same[0] for same in group(read, lambda one: one.series["digest"][0]).values()]


def tables(records: Sequence[Record]) -> Iterator[ResultTable]:
    """Yield the table of files by package: read, distinct, and refused by kind of reason."""
    first = {id(one) for one in distinct_robots(records)}
    count: dict[str, Callable[[Record], bool]] = {
        "files": lambda one: True,
        "read": lambda one: one.status == "done",
        "set free": lambda one: one.status == "done" and bool(one.counts.get("free")),
        "distinct": lambda one: id(one) in first,
        **{
            kind: lambda one, kind=kind: one.status != "done" and kind_of_reason(one.reason) == kind
            for kind in REASONS
        },
    }
    rows = []
    by_package = group(records, lambda one: (one.settings["package"], one.settings["version"]))
    for (package, version), mine in (*by_package.items(), (("all", ""), list(records))):
        numbers = (sum(map(counts, mine)) for counts in count.values())
        name = Cell(f"{package} {version}".strip(), "name")
        rows.append((name, *(str(number or "") for number in numbers)))
    title = "Robot files of packages: read, distinct robots among these, and refused"
    robots = [one for one in records if one.status == "done" or is_of_robot(one.reason)]
    ours = sum(one.status != "done" and kind_of_reason(one.reason) == OURS for one in robots)
    share = f"{100.0 * ours / len(robots):.1f} %" if robots else "-"
    note = (
        f"Refused without a fault of their own, which is 'not described here': {ours} of "
        f"{len(robots)} robot files, {share}. Files that are part of others, hold no robot, "
        "several or nothing that moves are no robot files. Bodies without joints are set free."
    )
    yield ResultTable("robot-files", title, ("package", *count), rows, note=note)


def is_of_robot(reason: str) -> bool:
    """Return whether a file that is refused with a reason should hold a robot."""
    others = STILL, "part of other files", "several models", "no robot description"
    return kind_of_reason(reason) not in others


def remarks(records: Sequence[Record]) -> Iterator[str]:
    """Yield the reasons of invalid files and of those that are not described here."""
    ours = OURS, "invalid number or element", "refused by MuJoCo"
    seen = Counter[str]()
    for record in records:
        if record.status != "done" and kind_of_reason(record.reason) in ours:
            seen[record.reason] += 1
            if seen[record.reason] == 1:
                yield f"{record.settings['package']}: {record.reason}"


STUDY = Study(
    key="robot-files",
    cells=cells,
    worker=lambda stored: _read,
    tables=tables,
    remarks=remarks,
    label="reading {file}",
    alarm=lambda records: any(record.status == "failed" for record in records),
    reading="Files with the same bodies and joints are one robot.",
    small=True,
    parallel_by=("package", "version", "file"),
)
