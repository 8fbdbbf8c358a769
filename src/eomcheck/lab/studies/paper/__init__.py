"""Repetition of the paper's simulations: its table, its figures, and verdicts on its claims."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from eomcheck.lab.store.record_file import Record
from eomcheck.lab.studies.paper import measure, show
from eomcheck.lab.study import Study


def _files(found: Sequence[Record], folder: Path) -> list[Path]:
    from eomcheck.lab.studies.paper.robot import write_robot

    return write_robot(found, folder)


STUDY = Study(
    key=measure.STUDY,
    cells=measure.cells,
    label="measuring {case}",
    worker=measure.worker,
    tables=show.tables,
    charts=show.charts,
    remarks=show.remarks,
    files=_files,
    reading="The snake of growing length by the paper's seven formulations, from rest over 1 s: "
    "norms of the errors over the output times (Eqs. (32) and (33)), and CPU time.",
)
