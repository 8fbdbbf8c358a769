"""Reference solutions that are stored: read, written, and how well each is known."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from eomcheck import __version__
from eomcheck.errors import InputError
from eomcheck.lab.reference_cases import CASES
from eomcheck.lab.show.table import Cell, Sheet
from eomcheck.motion.reference_io import Reference, load_reference, save_reference


def stored(name: str, folder: Path) -> Reference:
    """Return the reference solution that a folder holds under this name.

    Raises:
        InputError: it holds none, and where there is one, or how to make it; or it cannot be read.
    """
    path = folder / f"{name}.json"
    if not path.exists():
        made = (
            f"go to a checkout of eomcheck, say by --references FOLDER where it is, or make it: "
            f"eomcheck reference {name} --folder FOLDER"
            if name in CASES
            else f"references of eomcheck are: {', '.join(CASES)}"
        )
        raise InputError(f"the reference solution {str(path)!r} is missing; {made}")
    return load_reference(path)


def write_reference(reference: Reference, folder: Path) -> Path:
    """Write `reference` to `folder` under its name and return the path.

    Raises:
        InputError: the file cannot be written.
    """
    path = folder / f"{reference.name}.json"
    command = f"eomcheck reference {reference.name}"
    save_reference(reference, path, made_by=command, eomcheck=__version__)
    return path


COLUMNS = (
    "reference",
    "to t, s",
    "uncertainty",
    "energy drift: Taylor",
    "extrapolation",
    "steps: Taylor",
    "extrapolation",
    "seconds: Taylor",
    "extrapolation",
)


def reference_sheet(references: Iterable[Reference]) -> Sheet:
    """Return how well each reference is known, and what it took."""
    rows = [
        (
            Cell(one.name, "name"),
            f"{one.times[-1]:g}",
            f"{one.uncertainty:.1g}",
            *("" if run.drift is None else f"{run.drift:.1g}" for run in one.runs),
            *(str(run.facts["steps"]) for run in one.runs),
            *(f"{run.facts['seconds']:.0f}" for run in one.runs),
        )
        for one in references
    ]
    return Sheet("references", "", COLUMNS, rows)
