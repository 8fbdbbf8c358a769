"""Stiff joints: what explicit and implicit integrators take to the same error."""

from __future__ import annotations

from eomcheck.lab.studies.stiff import measure, show
from eomcheck.lab.study import Study

TRUTHS = Study(
    key=measure.TRUTH,
    cells=measure.truth_cells,
    worker=lambda known: measure.damped_truth,
    sheets=lambda found: (),
    label="integrating {true motion}",
)
STUDY = Study(
    key=measure.STUDY,
    before=(TRUTHS,),
    cells=measure.cells,
    worker=measure.worker,
    sheets=show.sheets,
    charts=show.charts,
    said=show.said,
    label="integrating {motion}",
)
