"""Operation counts of one right-hand side over the number of links, and savings by absent terms."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Annotated

from eomcheck.errors import InputError
from eomcheck.formulations import FORMULATIONS, formulation_of
from eomcheck.lab.option_parsing import parse_interval
from eomcheck.lab.store.record_file import Record, Settings, record_of_rows
from eomcheck.lab.studies.operations import measure, show
from eomcheck.lab.study import Formulations, Study, failed
from eomcheck.scene_lookup import scene_classes_named
from eomcheck.scenes import Snake

Absent = Annotated[str | None, "Show what absent terms save instead, on a kind of scene or all."]


def cells(
    *,
    links: Annotated[
        str | None, "Numbers of links, N or N..M. [default: 2..100, with --scene 3]"
    ] = None,
    formulation: Formulations = None,
    scene: Absent = None,
    repeats: Annotated[
        int | None, "With --scene: timed runs; the median counts. 0 for counts alone. [default: 15]"
    ] = None,
) -> Iterator[Settings]:
    """Yield a cell for each number of links and formulation; for the last one also with springs.

    Raises:
        InputError: no such numbers of links, or an error of `measure.cells`.
        UnknownNameError: no such formulation or scene.
    """
    low, high = parse_interval(links if links is not None else "2..100" if scene is None else "3")
    if scene is not None:
        kinds = scene_classes_named(scene)
        if links is not None and not any(kind.has_links for kind in kinds):
            raise InputError(f"links = {links!r}: {scene} has no number of links to choose")
        yield from measure.cells(kinds, high, formulation, 15 if repeats is None else repeats)
        return
    if repeats is not None:
        raise InputError(f"repeats = {repeats}: nothing is timed without a scene")
    keys = [formulation_of(key).key for key in dict.fromkeys(formulation or FORMULATIONS)]
    for size in range(low, high + 1):
        yield from ({"formulation": key, "links": size} for key in keys)
    if Snake.coil(high).stiffness is not None:
        for key in keys:
            yield {"formulation": key, "links": high, "springs": "present, absent, alone"}


def worker(known: Sequence[Record], *, scene: Absent = None) -> Callable[[Settings], Record]:
    """Return the function that counts the operations of a cell."""
    kinds = {} if scene is None else {kind.key: kind for kind in scene_classes_named(scene)}

    def work(settings: Settings) -> Record:
        if scene is not None:
            rows = [measure.saving(kinds[settings["scene"]], settings)]
            return record_of_rows(STUDY.key, settings, rows)
        coil = Snake.coil(settings["links"])
        formulation = FORMULATIONS[settings["formulation"]]
        if "springs" in settings:
            rows = [measure.compare_springs(coil, formulation)]
            return record_of_rows(STUDY.key, settings, rows)
        return measure.count_record(measure.count(coil, formulation))

    return work


STUDY = Study(
    key=measure.STUDY,
    cells=cells,
    worker=worker,
    tables=show.tables,
    charts=show.charts,
    remarks=show.remarks,
    label="counting operations in {case}",
    alarm=failed,
    document=show.document,
    reading="Additions, multiplications and divisions are counted one by one; linear systems by LU "
    "of their orders.",
    small=True,
)
