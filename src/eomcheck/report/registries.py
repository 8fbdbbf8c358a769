"""Tables of what is registered: formulations (the paper's Table I), scenes, engines, claims."""

from __future__ import annotations

from rich.table import Table

from eomcheck.console import console


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
    from eomcheck.scenes import SCENES

    table = _table("key", "energy conserved", "what it is")
    for scene in SCENES.values():
        table.add_row(scene.key, _yes(scene.conserves_energy), _first_line(scene))
    return table


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
