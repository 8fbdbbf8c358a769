"""The silent errors of `banded` once more: a copy of the source with their mend taken out.

A band solve is refined once, whatever its backward error is then; copies that measure how far
rounding goes do not see what is left of it; and a determinant that jumps tells nothing. So it was
before refinement went on until it stalls.
"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import NamedTuple

from tests.mutants import PACKAGE, LostFaultError


class Edit(NamedTuple):
    """Text of a file of the package that is there exactly once, and what it becomes."""

    file: str
    before: str
    after: str


RESIDUAL = "residual = b - self.times(x) + noise.changes", "residual = noise.changes"
EDITS = (
    Edit("numbers/banded_solve.py", "REFINED = BAND_TERMS * EPS", "REFINED = 1.0"),
    Edit("numbers/banded_solve.py", *RESIDUAL),
    Edit("evaluation/perturbed.py", "resolved &= sound.all(axis=0)", "pass"),
)
"""All that the mend is, at the places where it is now."""


def unmended(folder: Path) -> Path:
    """Copy the package into a folder, take the mend out there, and return the copy.

    Raises:
        LostFaultError: one of the places is not there exactly once.
    """
    package = folder / PACKAGE.name
    shutil.copytree(PACKAGE, package)
    for one in EDITS:
        path = package / one.file
        source = path.read_text(encoding="utf-8")
        if source.count(one.before) != 1:
            raise LostFaultError(f"{one.before!r} is not once in {one.file}")
        path.write_text(source.replace(one.before, one.after), encoding="utf-8")
    return package
