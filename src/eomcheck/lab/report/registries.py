"""Tables of what is registered: formulations (the paper's Table I), scenes, engines, claims."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.table import Table

from eomcheck.console import console
from eomcheck.lab.show.layout import table, words

if TYPE_CHECKING:
    from eomcheck.evaluation.point import Quantities
    from eomcheck.mechanics.scene import Scene


def _yes(flag: bool | None) -> str:
    return "" if flag is None else "yes" if flag else "no"


def _formulations() -> Table:
    from eomcheck.formulations import FORMULATIONS

    shown = _table(
        "key", "name", "equations", "order", "constraints at", "λ in paper", "λ here", "limits"
    )
    for f in FORMULATIONS.values():
        shown.add_row(
            f.key,
            f.name,
            f.equations or "not there",
            f.order_text,
            f"{f.level} level",
            "not there" if f.multipliers_in_paper is None else _yes(f.multipliers_in_paper),
            _yes(f.multipliers),
            f.limits,
        )
    return shown


def _scenes() -> Table:
    from eomcheck.engines import ENGINES
    from eomcheck.lab.studies.operations.counting import outline
    from eomcheck.numbers.counting import Counting
    from eomcheck.scenes import SCENES

    shown = _table("key", "what it is", "terms", "speeds", "formulations", "engines", "invariants")
    for kind in SCENES.values():
        scene = kind.example()
        at = outline(scene, Counting())
        shown.add_row(
            kind.key,
            f"{_first_line(kind)} {scene.name}: n = {scene.n}, r = {scene.r}",
            _terms(at),
            _speeds(at),
            _applying(kind),
            ", ".join(key for key, engine in ENGINES.items() if engine.represents(scene)),
            _invariants(scene),
        )
    return shown


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


def _engines() -> Table:
    from eomcheck.engines import ENGINES, DerivingEngine
    from eomcheck.errors import EngineError

    shown = _table("key", "library", "own constraints", "what it is")
    for engine in ENGINES.values():
        try:
            library = engine.version()
        except EngineError:
            library = "not installed"
        shown.add_row(
            engine.key, library, _yes(issubclass(engine, DerivingEngine)), _first_line(engine)
        )
    return shown


def _claims() -> Table:
    from eomcheck.claims import CLAIMS

    shown = _table("id", "statement", "equations")
    for claim in CLAIMS.values():
        shown.add_row(claim.id, claim.statement, claim.equations)
    return shown


def _first_line(thing: type) -> str:
    return (thing.__doc__ or "").strip().splitlines()[0]


def _table(*columns: str) -> Table:
    made = [one for x in columns for one in words(x, no_wrap=x in ("key", "id", "order"))]
    return table(made, show_lines="limits" in columns)


_TABLES = {
    "formulations": _formulations,
    "scenes": _scenes,
    "engines": _engines,
    "claims": _claims,
}


def print_registry(name: str) -> None:
    """Print the table of one registry."""
    console.print(_TABLES[name]())
