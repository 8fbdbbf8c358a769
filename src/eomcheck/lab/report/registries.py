"""Tables of the registries: formulations (Table I), scenes, engines, claims, quantities; of
parameters."""

from __future__ import annotations

from dataclasses import MISSING, Field, fields
from typing import TYPE_CHECKING

import numpy as np

from eomcheck.errors import message_of
from eomcheck.lab.show.table import Cell, ResultTable, table_of

if TYPE_CHECKING:
    from eomcheck.engines import Engine
    from eomcheck.evaluation.scene_quantities import Quantities
    from eomcheck.formulations import Formulation
    from eomcheck.mechanics.parameters import Parametric
    from eomcheck.mechanics.scene import Scene


# ---- Scenes --------------------------------------------------------------------------------------


def registered_scenes() -> ResultTable:
    """Return the table of all registered scenes."""
    from eomcheck.engines import ENGINES, asked_by_default
    from eomcheck.lab.studies.operations.measure import outline
    from eomcheck.numbers.counting import Counting
    from eomcheck.scenes import SCENES

    engines, rows = asked_by_default(ENGINES), []
    for kind in SCENES.values():
        scene = kind.example()
        quantities = outline(scene, Counting())
        rows.append(
            (
                Cell(kind.key, "name"),
                f"{first_line(kind)} {scene.name}: n = {scene.n}, r = {scene.r}",
                _terms(quantities),
                _speeds(quantities),
                _applicable_formulations(kind),
                ", ".join(key for key, engine in engines.items() if engine.represents(scene)),
                _invariants(scene),
            )
        )
    columns = ("key", "what it is", "terms", "speeds", "formulations", "engines", "invariants")
    return ResultTable("scenes", "", columns, rows, (15, 24, 18, 12, 12, 11, 24))


def _terms(quantities: Quantities) -> str:
    """Return the names of the terms present in a scene: Lagrange's, then offset and gyroscopic."""
    present = [name for name, term in quantities.terms._asdict().items() if term is not None]
    names = {"offset": quantities.speeds.offset, "gyroscopic": quantities.bodies.gyroscopic}
    return ", ".join((*present, *(name for name, part in names.items() if part is not None)))


def _speeds(quantities: Quantities) -> str:
    if quantities.speeds.W is None:
        return "the velocities"
    return "natural" if quantities.scene.natural_speeds else "partition"


def _applicable_formulations(kind: type[Scene]) -> str:
    """Return the formulations that apply, as "all" or "all but ..."."""
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


# ---- Parameters of a scene class -----------------------------------------------------------------

SHOWN = 5
"""Largest number of entries of a default that is shown; a larger one is named."""


def parameter_table(kind: type[Parametric]) -> ResultTable:
    """Return the table of a scene class's parameters: meaning, shape, unit, default, sampling
    range.
    """
    rows = []
    for arg in fields(kind):
        spec = kind.declared[arg.name]
        shape: object = spec.shape
        if callable(spec.shape):
            shape = f"{spec.shape.__name__.replace('_', ' ')}, {spec.shape_of(3)} if N = 3"
        drawn = (
            ""
            if spec.sample_range is None
            else f"{spec.sample_range.low:g} to {spec.sample_range.high:g}"
        )
        values = [spec.sign, "or None" if spec.optional else ""]
        about = spec.what, str(shape or "number"), spec.unit, " ".join(filter(None, values))
        rows.append(
            (Cell(arg.name, "name"), *about, _default(kind, arg, spec.computed_default), drawn)
        )
    about = ("name", "what it is", "shape", "SI unit", "value", "default", "drawn from")
    return ResultTable("parameters", "", about, rows)


def _default(kind: type, arg: Field, computed: object) -> str:
    if computed is not None:
        return "follows"
    if arg.default is MISSING:
        return "must be given"
    if np.size(arg.default) > SHOWN:
        return f"{kind.__name__}().{arg.name}"
    return f"{arg.default:.6g}" if isinstance(arg.default, float) else str(arg.default)


# ---- Registries ----------------------------------------------------------------------------------


def yes(flag: bool | None) -> str:
    """Return a flag as "yes", "no", or "" for None."""
    return "" if flag is None else "yes" if flag else "no"


def in_paper(f: Formulation) -> str:
    """Return whether Table I has multipliers for a formulation: "yes", "no" or "not there"."""
    return "not there" if f.multipliers_in_paper is None else yes(f.multipliers_in_paper)


def _formulations() -> ResultTable:
    from eomcheck.formulations import FORMULATIONS

    columns = {
        "key": lambda f: Cell(f.key, "name"),
        "name": lambda f: f.name,
        "equations": lambda f: f.equations or "not there",
        "order": lambda f: f.order_text,
        "constraints at": lambda f: f"{f.level} level",
        "λ in paper": in_paper,
        "λ here": lambda f: yes(f.multipliers),
        "limits": lambda f: f.limits,
    }
    widths = (6, 13, 10, 10, 13, 9, 6, 37)
    return table_of("formulations", "", FORMULATIONS.values(), columns.items(), widths=widths)


def function_claim_table() -> ResultTable:
    """Return the claims on user-supplied functions, and the functions that each claim needs."""
    from eomcheck.testing import FUNCTION_CLAIMS

    columns = {
        "claim": lambda c: Cell(c.id, "name"),
        "statement": lambda c: c.statement,
        "needs": lambda c: ", ".join(name.replace("|", " or ") for name in c.needs) or "any",
    }
    return table_of("function-claims", "", FUNCTION_CLAIMS.values(), columns.items())


def _engines() -> ResultTable:
    from eomcheck.class_lookup import announced
    from eomcheck.engines import (
        BY_FORMAT,
        ENGINE,
        ENGINES,
        LIBRARIES,
        engine_of,
        installed_version,
        least_version,
        version_of,
    )

    rows = []
    for key, engine in LIBRARIES.items():
        facts = installed_version(engine) or "not installed", engine.extra or "none needed"
        reads = [format for format, kinds in BY_FORMAT.items() if key in kinds]
        reads = ", ".join(["scenes"] * (key in ENGINES) + reads)
        facts = *facts, least_version(engine), reads
        rows.append((Cell(key, "name"), *facts, *_about_engine(engine)))
    for name, point in announced(ENGINE).items():
        package = "" if point.dist is None else f"none: package {point.dist.name}"
        try:
            engine = engine_of(name)
            row = version_of(engine), package, "", "", *_about_engine(engine)
        except Exception as error:  # one broken engine of another package hides no other
            row = "cannot be loaded", package, "", "", "", "", message_of(error)
        rows.append((Cell(name, "name"), *row))
    columns = ("key", "library", "extra", "least version", "reads", "precision")
    columns = *columns, "own constraints", "what it is"
    return ResultTable("engines", "", columns, rows)


def _about_engine(engine: type[Engine]) -> tuple[str, str, str]:
    """Return the precision of an engine, whether it has constraints of its own, and its noun."""
    bits = {2.0**-53: "float64", 2.0**-24: "float32"}
    u = engine.unit_roundoff
    precision = bits.get(u, f"unit roundoff {u:.1g}")
    return precision, yes(engine.offers("constraint_jacobian")), first_line(engine)


def _claims() -> ResultTable:
    from eomcheck.claims import CLAIMS

    rows = [(Cell(c.id, "name"), c.statement, c.equations) for c in CLAIMS.values()]
    return ResultTable("claims", "", ("id", "statement", "equations"), rows)


def _shape(sizes: tuple[int | str, ...]) -> str:
    """Return a shape as text, of quantities too: (3, n), (n,)."""
    inside = ", ".join(map(str, sizes))
    return f"({inside},)" if len(sizes) == 1 else f"({inside})" if sizes else "number"


def _quantities() -> ResultTable:
    from eomcheck.evaluation.conformance import MAPPINGS, QUANTITIES

    columns = {
        "method": lambda one: Cell(one.signature, "name"),
        "returns": lambda one: f"{one.symbol}: {', '.join(map(_shape, one.parts))}",
        "unit": lambda one: one.unit,
        "convention": lambda one: one.about,
        "x from w = S v": lambda one: MAPPINGS[one.mapping],
    }
    widths = (22, 18, 12, 34, 16)
    return table_of("quantities", "", QUANTITIES.values(), columns.items(), widths=widths)


_SHEETS = {
    "formulations": _formulations,
    "scenes": registered_scenes,
    "engines": _engines,
    "claims": _claims,
    "quantities": _quantities,
}


def registry_table(name: str) -> ResultTable:
    """Return the table of one registry."""
    return _SHEETS[name]()
