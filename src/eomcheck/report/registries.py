"""Tables of what is registered: formulations (the paper's Table I), scenes, engines, claims."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.table import Table

from eomcheck.console import console

if TYPE_CHECKING:
    from eomcheck.model import Scene
    from eomcheck.quantities import Quantities


def _yes(flag: bool | None) -> str:
    return "" if flag is None else "yes" if flag else "no"


def _formulations() -> Table:
    from eomcheck.formulations import FORMULATIONS

    table = _table(
        "key", "name", "equations", "order", "constraints at", "λ in paper", "λ here", "limits"
    )
    for f in FORMULATIONS.values():
        table.add_row(
            f.key,
            f.name,
            f.equations or "not there",
            f.order_text,
            f"{f.level} level",
            "not there" if f.multipliers_in_paper is None else _yes(f.multipliers_in_paper),
            _yes(f.multipliers),
            f.limits,
        )
    return table


def _scenes() -> Table:
    from eomcheck.arithmetic.counting import Counting
    from eomcheck.engines import ENGINES
    from eomcheck.scenes import SCENES
    from eomcheck.studies.operations import outline

    table = _table("key", "what it is", "terms", "speeds", "formulations", "engines", "invariants")
    for kind in SCENES.values():
        scene = kind.example()
        at = outline(scene, Counting())
        table.add_row(
            kind.key,
            f"{_first_line(kind)} {scene.name}: n = {scene.n}, r = {scene.r}",
            _terms(at),
            _speeds(at),
            _applying(kind),
            ", ".join(key for key, engine in ENGINES.items() if engine.represents(scene)),
            _invariants(scene),
        )
    return table


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

    table = _table("key", "library", "own constraints", "what it is")
    for engine in ENGINES.values():
        try:
            library = engine.version()
        except EngineError:
            library = "not installed"
        table.add_row(
            engine.key, library, _yes(issubclass(engine, DerivingEngine)), _first_line(engine)
        )
    return table


def _claims() -> Table:
    from eomcheck.checks import CLAIMS

    table = _table("id", "statement", "equations")
    for claim in CLAIMS.values():
        table.add_row(claim.id, claim.statement, claim.equations)
    return table


def _first_line(thing: type) -> str:
    return (thing.__doc__ or "").strip().splitlines()[0]


def _table(*columns: str) -> Table:
    table = Table(header_style="bold", show_lines="limits" in columns)
    for column in columns:
        table.add_column(column, no_wrap=column in ("key", "id", "order"))
    return table


_TABLES = {
    "formulations": _formulations,
    "scenes": _scenes,
    "engines": _engines,
    "claims": _claims,
}


def print_registry(name: str) -> None:
    """Print the table of one registry."""
    console.print(_TABLES[name]())
