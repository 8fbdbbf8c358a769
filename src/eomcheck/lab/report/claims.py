"""Claims as tables: by formulations and engines, by scenes, and what is worst."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from eomcheck.claims.finding import DECIDED
from eomcheck.lab.report.judged import Judged
from eomcheck.lab.show.table import Cell, Sheet
from eomcheck.lab.store.kept import Kept

CELLS = (
    "Cells: largest error observed, in percent of the error allowed (?: nothing could be "
    "checked, ·: not concerned)."
)
WORST = (
    "worst: largest error observed, in percent of the error allowed (?: nothing could be checked), "
    "by whom and in which state (scene[links] #state); inconclusive: rounding explains any "
    "difference. --wide tells formulations, engines and scenes apart."
)


def name_of(judged: Judged) -> Cell:
    """Return the id of a claim, which leads to what it rests on."""
    return Cell(judged.claim.id, "name", f"#claim-{judged.claim.id}")


def party_sheet(
    claims: Iterable[Judged], names: Sequence[str], seconds: Mapping[str, float] | None = None
) -> Sheet:
    """Return claims × formulations and engines; a cell is the worst observed / allowed.

    Args:
        claims: what was found.
        names: keys of the formulations and engines.
        seconds: id of a claim -> what looking at it took, if that is to be told.
    """
    rows = []
    for one in claims:
        cells = [name_of(one), one.cell, *(one.of(name).cell for name in names), one.evidence]
        time = [] if seconds is None else [f"{seconds.get(one.claim.id, 0.0):.1f} s"]
        rows.append(cells + time)
    columns = ["claim", "all", *names, "evidence, findings"]
    return Sheet("claims", "", columns + ([] if seconds is None else ["time"]), rows, note=CELLS)


def worst_sheet(claims: Iterable[Judged]) -> Sheet:
    """Return what is worst of each claim: observed / allowed, by whom, and where."""
    rows = []
    for one in claims:
        worst = one.worst if one.kind in DECIDED and one.text != "0" else None
        by, on = ("·", "·") if worst is None else (worst.subject, where(worst))
        rows.append([name_of(one), one.cell, by, on, f"{len(one.rows)}{one.undecided}"])
    columns = ["claim", "worst", "by", "on", "findings"]
    return Sheet("worst", "", columns, rows, note=WORST)


def where(row: Kept) -> str:
    """Return the scene and the number of the state of a Finding, in short."""
    links = "" if row.links is None else f"[{row.links}]"
    return f"{row.scene}{links}" + ("" if row.case is None else f" #{row.case}")


def scene_sheet(claims: Iterable[Judged], scenes: Iterable[str]) -> Sheet:
    """Return claims × scenes, with what a claim says; a cell is the worst observed / allowed."""
    scenes = list(scenes)
    rows = []
    for one in claims:
        cells = (one.scenes.get(scene, Judged(())).cell for scene in scenes)
        rows.append([name_of(one), one.claim.statement, ", ".join(one.levels), *cells])
    return Sheet("claims", "", ["claim", "statement", "evidence", *scenes], rows, note=CELLS)
