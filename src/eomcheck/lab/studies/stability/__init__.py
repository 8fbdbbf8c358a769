"""The stability atlas: every formulation through families of growing severity, certified."""

from __future__ import annotations

from eomcheck.lab.studies.stability import measure, show
from eomcheck.lab.study import Study

STUDY = Study(
    key=measure.STUDY,
    cells=measure.cells,
    label="measuring formulations at {state}",
    worker=lambda known: measure.measure,
    spread_by=measure.STATE,
    sheets=show.tables,
    charts=show.charts,
    said=show.remarks,
    alarm=show.alarm,
    reading=show.READING,
)
