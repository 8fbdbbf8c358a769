"""Choose the robots of `study robots` and `study conformance` among the files that are read.

python -m tests.choose_robots RECORDS

RECORDS is a file of `eomcheck study robot-files`. The names in `lab/studies/robots.toml` stay; from
each package `MOST` further robots of each format are added, one of each folder: that with the
shortest name among the distinct ones of `COORDINATES` that are no test data and no objects.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path, PurePosixPath

from eomcheck.lab.store.record_file import Record, Records, group
from eomcheck.lab.studies.robot_files import distinct_robots
from eomcheck.lab.studies.robots import ROBOTS, ROBOTS_FILE, RobotFile

COORDINATES = range(2, 25)
"""Numbers of coordinates of added robots: larger ones take minutes a library."""

MOST = 3
"""Most robots that are added of one package and format."""

PLAIN = {
    "urdf",
    "robots",
    "robot",
    "xmls",
    "xml",
    "assets",
    "mjcf",
    "model",
    "scene",
    "description",
}
"""Names of folders and files that name no robot."""


def folder_of(file: str) -> tuple[str, ...]:
    """Return the folders of a file, without those that name no robot at the end."""
    parts = list(PurePosixPath(file).parts[:-1])
    while parts and parts[-1] in PLAIN:
        parts.pop()
    return tuple(parts)


def name_of(package: str, file: str, taken: Iterable[str]) -> str:
    """Return the name of a robot by its file, or by its folder where the file names none."""
    stem, folder = PurePosixPath(file).stem, folder_of(file)[-1]
    name = folder if stem in PLAIN else stem
    name = re.sub(r"[-_]?description|[-_]?robot$", "", name) or folder
    name = re.sub(r"[\W_]+", "-", name).strip("-").lower()
    return name if name not in taken else f"{name}-{package.lower()}"


def added(records: Iterable[Record]) -> Iterator[tuple[str, str]]:
    """Yield package and file of the robots to add."""
    records = list(records)
    known = {digest_in(one) for one in records if one.status == "done" and is_known(one)}
    able = [
        one
        for one in distinct_robots(records)
        if one.counts["coordinates"] in COORDINATES
        and not re.search(r"test|object", one.settings["file"])
        and not one.counts.get("free")
    ]
    for mine in group(able, package_and_format).values():
        folders = group(mine, lambda one: folder_of(one.settings["file"]))
        for same in list(folders.values())[:MOST]:
            best = min(same, key=lambda one: (len(one.settings["file"]), one.settings["file"]))
            if digest_in(best) not in known:
                yield best.settings["package"], best.settings["file"]


def digest_in(record: Record) -> str:
    """Return the digest of the robot in a file that was read."""
    return record.series["digest"][0]


def package_and_format(record: Record) -> tuple[str, str]:
    """Return the package of a file and the end of its name."""
    return record.settings["package"], PurePosixPath(record.settings["file"]).suffix


def is_known(record: Record) -> bool:
    """Return whether the file of a Record is that of a robot in the list."""
    package, file = record.settings["package"], record.settings["file"]
    return any(one.package == package and file.endswith(one.file) for one in ROBOTS.values())


def text_of(robots: dict[str, RobotFile]) -> str:
    """Return the contents of `ROBOTS_FILE`."""
    head = ROBOTS_FILE.read_text(encoding="utf-8").partition("\n\n")[0]
    entries = (
        f'[{name}]\npackage = "{one.package}"\nfile = "{one.file}"\n'
        for name, one in robots.items()
    )
    return "\n".join([head + "\n", *entries])


def main(path: str) -> None:
    """Write the list with the robots that are added."""
    robots = dict(ROBOTS)
    with Records(Path(path), readonly=True) as opened:
        for package, file in added(opened.all()):
            robots[name_of(package, file, robots)] = RobotFile(package, file)
    ROBOTS_FILE.write_text(text_of(robots), encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
