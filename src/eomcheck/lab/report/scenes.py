"""Scenes as a table: what each is, and what applies to it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eomcheck.lab.show.table import Cell, Sheet

if TYPE_CHECKING:
    from eomcheck.evaluation.scene_quantities import Quantities
    from eomcheck.mechanics.scene import Scene


def registered_scenes() -> Sheet:
    """Return the table of all registered scenes."""
    from eomcheck.engines import ENGINES
    from eomcheck.lab.studies.operations.measure import outline
    from eomcheck.numbers.counting import Counting
    from eomcheck.scenes import SCENES

    rows = []
    for kind in SCENES.values():
        scene = kind.example()
        at = outline(scene, Counting())
        rows.append(
            (
                Cell(kind.key, "name"),
                f"{first_line(kind)} {scene.name}: n = {scene.n}, r = {scene.r}",
                _terms(at),
                _speeds(at),
                _applying(kind),
                ", ".join(key for key, engine in ENGINES.items() if engine.represents(scene)),
                _invariants(scene),
            )
        )
    columns = ("key", "what it is", "terms", "speeds", "formulations", "engines", "invariants")
    return Sheet("scenes", "", columns, rows, (15, 24, 18, 12, 12, 11, 24))


def _terms(at: Quantities) -> str:
    """Return the terms that a scene has: those of Lagrange, then what only some scenes need."""
    present = [name for name, term in at.terms._asdict().items() if term is not None]
    names = {"offset": at.speeds.offset, "gyroscopic": at.bodies.gyroscopic}
    return ", ".join((*present, *(name for name, part in names.items() if part is not None)))


def _speeds(at: Quantities) -> str:
    if at.speeds.W is None:
        return "the velocities"
    return "natural" if at.scene.natural_speeds else "partition"


def _applying(kind: type[Scene]) -> str:
    """Return which formulations apply."""
    from eomcheck.formulations import FORMULATIONS

    others = [f.key for f in FORMULATIONS.values() if not f.applies_to(kind)]
    return "all" + (f" but {', '.join(others)}" if others else "")


def _invariants(scene: Scene) -> str:
    energy = "energy" if scene.conserves_energy else f"no energy: {scene.why_not_conserved}"
    symmetries = (symmetry.name for symmetry in scene.symmetries(*scene.initial_state()))
    return ", ".join((energy, *symmetries))


def first_line(thing: type) -> str:
    """Return the first line of the docstring of a class."""
    return next(iter((thing.__doc__ or "").strip().splitlines()), "")
