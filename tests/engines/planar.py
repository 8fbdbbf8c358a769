"""An engine of somebody else's for tests: that of the guide, and faults to plant in it."""

from __future__ import annotations

from pathlib import Path

from eomcheck.engines import Engine, engine_of

PLANAR = Path(__file__).parents[2] / "docs" / "guides" / "planar.py"


def planar(path: Path = PLANAR) -> type[Engine]:
    return engine_of(f"{path}:Planar")


def with_fault(folder: Path, name: str, old: str, new: str) -> Path:
    """Write the engine with one change of its source, and return the file."""
    source = PLANAR.read_text(encoding="utf-8")
    assert source.count(old) == 1, old
    path = folder / f"{name}.py"  # a name of its own: Python keeps modules by name
    path.write_text(source.replace(old, new), encoding="utf-8")
    return path
