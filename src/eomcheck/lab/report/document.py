"""Findings as a JSON document, each state once."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from eomcheck.claims import CLAIMS
from eomcheck.claims.run import Run, Selection
from eomcheck.engines import version_of
from eomcheck.lab.show.document_text import write_json as write_document


def write_json(path: Path, runs: Iterable[Run], selection: Selection) -> None:
    """Write every Finding of `runs`, each case once, to `path`."""
    runs = list(runs)
    minimal = [run.minimal.as_python() for run in runs if run.minimal is not None]
    cases: list[dict[str, Any]] = []
    index: dict[int, int] = {}
    rows = []
    for finding in [finding for run in runs for finding in run.findings]:
        state = finding.state
        case = id(finding.scene if state is None else state.q)
        if case not in index:
            index[case] = len(cases)
            cases.append({} if state is None else finding.place)
        rows.append(finding.as_dict(whole=state is None) | {"case": index[case]})
    document = {
        "engines": [version_of(engine) for engine in selection.engines],
        "formulations": [formulation.key for formulation in selection.formulations],
        "claims": {
            id: {"statement": CLAIMS[id].statement, "equations": CLAIMS[id].equations}
            for id in selection.claims
        },
        "strata": {run.drawn[0].scene.key: run.strata for run in runs if run.drawn},
        "cases": cases,
        "findings": rows,
        "minimal": minimal[0] if minimal else None,
    }
    write_document(path, document)
