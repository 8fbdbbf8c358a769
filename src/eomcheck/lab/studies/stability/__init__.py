"""Stability atlas: every formulation on families of increasingly severe states, certified."""

from __future__ import annotations

from eomcheck.lab.studies.stability import measure, show
from eomcheck.lab.study import Study

STUDY = Study(
    key=measure.STUDY,
    cells=measure.cells,
    label="measuring formulations at {state}",
    worker=lambda known: measure.measure,
    parallel_by=measure.STATE,
    tables=show.tables,
    charts=show.charts,
    remarks=show.remarks,
    alarm=show.alarm,
    reading=show.READING,
)
