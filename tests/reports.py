"""Records to report on: a validation, proofs and counts that were run, and studies made up."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from eomcheck.claims.run import RunSelection, ValidationRun
from eomcheck.lab.proofs import Proofs, proof_jobs
from eomcheck.lab.store.record_file import Record, Records
from eomcheck.lab.store.validation_runs import validate_kind
from eomcheck.lab.studies import paper, stability, work_precision
from eomcheck.lab.studies.operations import STUDY, counted_in
from eomcheck.lab.studies.operations.measure import Operations
from eomcheck.lab.studies.stability import FAMILIES
from eomcheck.scenes import Sleigh

CLAIMS = ("mass-matrix", "kinetic-energy", "speeds-velocity", "equivalence", "true-error")
KEYS = ("au", "ml", "kane")


class Heavy(Sleigh):
    """A sleigh whose energy is twice what its mass matrix says."""

    key = "heavy"

    @staticmethod
    def energies(parameters, angles, q, v):
        kinetic, potential = Sleigh.energies(parameters, angles, q, v)
        return 2 * kinetic, potential


def validated(path: Path, kind: type[Sleigh] = Sleigh, examples: int = 2) -> ValidationRun:
    """Validate a sleigh into a file of records and return the run."""
    selection = RunSelection.of(KEYS, ["casadi"], CLAIMS, scenes=[kind])
    run = ValidationRun()
    with Records(path) as records:
        validate_kind(kind, run, selection, (1, 1), examples, 0, lambda: None, records)
    return run


def proved(path: Path) -> None:
    """Prove a sleigh into a file of records."""
    with Records(path) as records:
        Proofs(proof_jobs("sleigh", None, 1, 0, KEYS), records=records).run()


def counted(path: Path) -> list[Operations]:
    """Count operations into a file of records and return the counts."""
    return counted_in(STUDY.run(path, links="2..7", formulation=KEYS))


def studied(path: Path) -> None:
    """Write made-up records of the studies that take long."""
    with Records(path) as records:
        for record in (*_work_precision(), *_stability(), *_paper()):
            records.add(record)


def _work_precision():
    for place, key in enumerate(KEYS):
        for k in (4, 6, 8):
            settings = {
                "reference": "paper-rest",
                "formulation": key,
                "integrator": "DOP853",
                "tolerance": 10.0**-k,
            }
            yield Record(
                work_precision.STUDY.key,
                settings,
                seconds=1e-3 * k * (1 + place),
                quartiles=(1e-3, 2e-3),
                cpu_seconds=1e-3 * k if place == 0 else None,
                counts={"right-hand sides": 100 * k, "steps": 9 * k},
                errors={"final": 10.0**-k, "energy": 0.0, "constraint": 1e-15, "floor": 1e-14},
            )
    settings = {"reference": "paper-rest", "formulation": "kane", "integrator": "DOP853"}
    yield Record(
        work_precision.STUDY.key, settings | {"tolerance": 1e-13}, "failed", "too many steps"
    )


def _stability():
    family = next(iter(FAMILIES.values()))
    for key in KEYS:
        for place, severity in enumerate(family.quick):
            method = stability.Method(key)
            settings = stability.settings_of(family.key, family.variants[0], severity, method)
            if key == "kane" and place == len(family.quick) - 1:
                yield Record(stability.STUDY.key, settings, "refused", "M_Kane: rcond <1e-17>")
                continue
            relative = 10.0 ** (place - 14)
            errors = {"relative": relative, "bound": 2 * relative, "predicted": relative}
            yield Record(stability.STUDY.key, settings, errors=errors | {"condition M": 10.0})


def _paper():
    for links in (2, 7, 20, 40):
        for key in KEYS:
            yield Record(
                paper.STUDY.key,
                {
                    "cell": "motion",
                    "links": links,
                    "formulation": key,
                    "integrator": "RK45",
                    "tolerance": 1e-6,
                },
                seconds=1e-3 * links,
                cpu_seconds=1e-3 * links,
                counts={"steps": 10, "state": 2 * links},
                errors={"constraint": 1e-9, "energy": 0.0, "constraint allowed": 1e-12},
                series={
                    "times": [k / 10 for k in range(11)],
                    "q": [[0.0] * (links + 2)] * 11,
                    "constraint": [1e-9 * k for k in range(11)],
                    "energy": [0.0] * 11,
                },
            )


def running_differences(relative: dict[str, np.ndarray]) -> dict[str, Any]:
    """Return differences between libraries that have been computed, by quantity."""
    return {name: SimpleNamespace(relative=table) for name, table in relative.items()}
