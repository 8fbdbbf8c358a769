"""What one claim rests on: scenes, and levels of evidence."""

from __future__ import annotations

from eomcheck.lab.report.judged import LEVELS, Judged, anchor
from eomcheck.lab.show.document_text import number
from eomcheck.lab.show.table import Cell, Sheet
from eomcheck.safe_output import counted


def evidence_sheet(judged: Judged) -> Sheet:
    """Return what a claim rests on: scenes × levels of evidence."""
    found = judged.by(lambda row: (row.scene, row.level))
    levels = dict.fromkeys((*LEVELS, *judged.levels))
    columns = ["scene", "evidence", "N", "states", "findings", "inconclusive", "not looked at"]
    rows = [
        [scene, level, *_evidence(found[scene, level])]
        for scene in judged.scenes
        for level in levels
        if (scene, level) in found
    ]
    sheet = Sheet("", "", [*columns, "ratio", "observed", "allowed", "where"], rows)
    return sheet if judged.unseen else sheet.without("not looked at")


def _evidence(one: Judged) -> list[str]:
    worst, sure = one.worst, one.failure_probability
    assert worst is not None
    cells = [one.links, str(one.states or "all"), str(len(one.rows))]
    cells += [str(count or "") for count in (one.inconclusive, len(one.unseen))]
    if sure is not None:
        told = (
            f"{counted(len(one.rows), 'identity')}, wrong with a probability below {number(sure)}"
        )
        return [*cells, "", "", "", Cell(told, link=f"#{anchor(worst)}")]
    where = f"{worst.subject}, {f'state {worst.case}' if worst.case is not None else worst.place}"
    link = Cell(where if worst.ratio else "", link=f"#{anchor(worst)}")
    return [*cells, one.cell, number(worst.observed), number(worst.allowed), link]
