"""Tables of what is registered: formulations (the paper's Table I), scenes, engines, claims."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eomcheck.errors import message_of
from eomcheck.lab.report.scenes import first_line, registered_scenes
from eomcheck.lab.show.table import Cell, Sheet

if TYPE_CHECKING:
    from eomcheck.formulations import Formulation


def yes(flag: bool | None) -> str:
    """Return a flag as a word."""
    return "" if flag is None else "yes" if flag else "no"


def in_paper(f: Formulation) -> str:
    """Return whether Table I has multipliers for a formulation."""
    return "not there" if f.multipliers_in_paper is None else yes(f.multipliers_in_paper)


def _formulations() -> Sheet:
    from eomcheck.formulations import FORMULATIONS

    rows = [
        (
            Cell(f.key, "name"),
            f.name,
            f.equations or "not there",
            f.order_text,
            f"{f.level} level",
            in_paper(f),
            yes(f.multipliers),
            f.limits,
        )
        for f in FORMULATIONS.values()
    ]
    about = ("name", "equations", "order", "constraints at", "λ in paper", "λ here", "limits")
    return Sheet("formulations", "", ("key", *about), rows, (6, 13, 10, 10, 13, 9, 6, 37))


def function_claims_sheet() -> Sheet:
    """Return what is claimed of somebody's functions, and which of them a claim needs."""
    from eomcheck.testing import FUNCTION_CLAIMS

    rows = [
        (
            Cell(one.id, "name"),
            one.statement,
            ", ".join(name.replace("|", " or ") for name in one.needs) or "any",
        )
        for one in FUNCTION_CLAIMS.values()
    ]
    return Sheet("function-claims", "", ("claim", "statement", "needs"), rows)


def _engines() -> Sheet:
    from eomcheck.class_lookup import announced
    from eomcheck.engines import ENGINE, ENGINES, engine_of, version_of
    from eomcheck.errors import EngineError

    rows = []
    for engine in ENGINES.values():
        try:
            library = version_of(engine)
        except EngineError:
            library = "not installed"
        own = yes(engine.offers("constraint_jacobian"))
        extra = engine.extra or "none needed"
        rows.append((Cell(engine.key, "name"), library, extra, own, first_line(engine)))
    for name, point in announced(ENGINE).items():
        package = "" if point.dist is None else f"none: package {point.dist.name}"
        try:
            engine = engine_of(name)
            told = version_of(engine), package, yes(engine.offers("constraint_jacobian"))
            row = (*told, first_line(engine))
        except Exception as error:  # whatever somebody else's does, the others are listed
            row = "cannot be loaded", package, "", message_of(error)
        rows.append((Cell(name, "name"), *row))
    columns = ("key", "library", "installed by the extra", "own constraints", "what it is")
    return Sheet("engines", "", columns, rows)


def _claims() -> Sheet:
    from eomcheck.claims import CLAIMS

    rows = [(Cell(one.id, "name"), one.statement, one.equations) for one in CLAIMS.values()]
    return Sheet("claims", "", ("id", "statement", "equations"), rows)


_SHEETS = {
    "formulations": _formulations,
    "scenes": registered_scenes,
    "engines": _engines,
    "claims": _claims,
}


def registry_sheet(name: str) -> Sheet:
    """Return the table of one registry."""
    return _SHEETS[name]()
