"""Pairs of files of one robot: the URDF of one package beside the MJCF of another.

A cell is one pair of `PAIRS`, whose files are compared as by `eomcheck compare a.urdf b.xml`.
"""

from __future__ import annotations

import tomllib
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, NamedTuple

from eomcheck.descriptions.urdf_reader import FLOATING
from eomcheck.errors import EngineError, UnknownNameError
from eomcheck.lab.option_parsing import check_count
from eomcheck.lab.robot_comparison import QUANTITIES, compare_robots
from eomcheck.lab.show.table import Cell, ResultTable
from eomcheck.lab.store.record_file import Record, Settings
from eomcheck.lab.studies.robots import RobotFile, packaged_file
from eomcheck.lab.study import Study, unfinished
from eomcheck.scene_lookup import robot_named

PAIRS_FILE = Path(__file__).with_name("robot_pairs.toml")


class RobotPair(NamedTuple):
    """A robot in two packages."""

    first: RobotFile
    """Its URDF."""
    second: RobotFile
    """Its MJCF."""
    free: bool = False
    """Whether the root of the URDF is set free, as it is in the MJCF."""


def _pair(first: dict[str, str], second: dict[str, str], free: bool = False) -> RobotPair:
    return RobotPair(RobotFile(**first), RobotFile(**second), free)


PAIRS = {
    name: _pair(**entry)
    for name, entry in tomllib.loads(PAIRS_FILE.read_text(encoding="utf-8")).items()
}
"""Name -> the pair of files."""


def cells(
    *,
    pair: Annotated[list[str] | None, "Pair, or several: a,b. [default: all]"] = None,
    states: Annotated[int, "Random states at which the effect is measured."] = 20,
) -> Iterator[Settings]:
    """Yield a cell for each pair.

    Raises:
        InputError: no states.
        UnknownNameError: there is no such pair.
    """
    check_count(states=states)
    for name in PAIRS if pair is None else pair:
        if name not in PAIRS:
            raise UnknownNameError("pair", name, PAIRS)
        yield {"pair": name, "states": states}


def _compare(settings: Settings) -> Record:
    """Compare the two files of a pair."""
    name, pair = settings["pair"], PAIRS[settings["pair"]]
    try:
        paths = [str(packaged_file(name, robot)) for robot in (pair.first, pair.second)]
    except EngineError as missing:
        return Record(STUDY.key, settings, "refused", str(missing))
    paths[0] += f":{FLOATING}" if pair.free else ""
    first, second = (robot_named(path)() for path in paths)
    comparison = compare_robots(first, second, None, settings["states"])
    differences = comparison.differences
    counts = {"joints": len(comparison.matched), "differences": len(differences)}
    effects = {effect.quantity: effect.size for effect in comparison.effects}
    series = {
        "what": [one.what for one in differences],
        "differences": [str(one) for one in differences],
    }
    return Record(STUDY.key, settings, counts=counts, errors=effects, series=series)


# ---- Results -------------------------------------------------------------------------------------


def tables(records: Sequence[Record]) -> Iterator[ResultTable]:
    """Yield the table of pairs: joints, differences by their sort, and the effect of all."""
    rows = []
    for record in records:
        if record.status != "done":
            continue
        name = record.settings["pair"]
        pair = PAIRS[name]
        sorts = Counter(record.series["what"]).most_common()
        effects = [record.errors.get(quantity) for quantity in QUANTITIES]
        rows.append(
            (
                Cell(name, "name"),
                f"{pair.first.package}, {pair.second.package}",
                str(record.counts["joints"]),
                ", ".join(f"{count} {what}" for what, count in sorts) or Cell("the same", "passed"),
                *("" if x is None else f"{100.0 * x:.3g}" for x in effects),
            )
        )
    heads = ("robot", "URDF and MJCF of", "joints", "differences")
    percent = (f"{quantity}, %" for quantity in QUANTITIES)
    title = "One robot in two packages: differences, and what they do"
    yield ResultTable("robot-pairs", title, (*heads, *percent), rows, note=NOTE)


NOTE = (
    "Joints that are matched. Percent of the largest entry at random states; none where one robot "
    "has further joints."
)


def remarks(records: Sequence[Record]) -> Iterator[str]:
    """Yield the differences of each pair."""
    yield from unfinished(records)
    for record in records:
        for text in record.series.get("differences", ()):
            yield f"{record.settings['pair']}: {text}"


STUDY = Study(
    key="robot-pairs",
    cells=cells,
    worker=lambda stored: _compare,
    tables=tables,
    remarks=remarks,
    label="comparing {pair}",
    alarm=lambda records: any(record.status == "failed" for record in records),
    reading="A difference is a fact about two files, and no fault of either.",
    small=True,
    parallel_by=("pair",),
)
