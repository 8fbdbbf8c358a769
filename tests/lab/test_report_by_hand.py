"""Sheets and sections of a report, compared whole with Records and registries made by hand."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import pytest
from tests.lab.test_tables import kept, proof, table

from eomcheck.errors import EngineError, InputError
from eomcheck.lab.report import finding_output, registries, report_formats
from eomcheck.lab.report import report_formats as sections
from eomcheck.lab.report.overview import (
    CELLS,
    WORST,
    Overview,
    by_claim,
    claim_link,
    digits_table,
    factor_table,
    participant_table,
    record_columns,
    record_table,
    scene_table,
    worst_table,
)
from eomcheck.lab.report.registries import parameter_table
from eomcheck.lab.show.table import ResultTable
from eomcheck.lab.store.record_file import Record
from eomcheck.lab.store.validation_runs import RUNS
from eomcheck.lab.study import Study
from eomcheck.scenes import SCENES, ChainPendulum

# ---- Records -------------------------------------------------------------------------------------


def record(study: str, settings: dict[str, Any], **change: Any) -> Record:
    """Return a Record without a machine, versions and a time of its own."""
    usual: dict[str, Any] = {"machine": {}, "versions": {}, "threads": None, "when": "today"}
    return Record(study, settings, **(usual | change))


def test_records_are_a_table_of_plain_columns_in_the_order_of_their_fields():
    first = record(
        "s",
        {"z": "text", "a": [1, 2.5]},
        status="failed",
        reason="why",
        seconds=0.1,
        quartiles=(0.25, 4.0),
        cpu_seconds=1e-30,
        runs=3,
        compile_seconds=7.0,
        counts={"steps": 12},
        errors={"x": 1 / 3},
        series={"θ": ["θ", 1]},
        machine={"cpu": "Abacus", "cores": 2},
        versions={"eomcheck": "7.1"},
        threads=1,
    )
    second = record("t", {"z": None, "b": True})
    sheet = record_table([first, second])
    assert (sheet.name, sheet.title) == ("records", "")
    assert table(sheet) == [
        {
            **{"study": "s", "settings.a": "[1, 2.5]", "settings.b": "", "settings.z": "text"},
            **{"status": "failed", "reason": "why", "seconds": "0.1", "quartiles.low": "0.25"},
            **{"quartiles.high": "4.0", "cpu_seconds": "1e-30", "runs": "3"},
            **{"compile_seconds": "7.0", "counts.steps": "12", "errors.x": repr(1 / 3)},
            **{"series.θ": '["θ", 1]', "machine.cores": "2", "machine.cpu": "Abacus"},
            **{"versions.eomcheck": "7.1", "threads": "1", "when": "today"},
        },
        dict.fromkeys(sheet.columns, "")
        | {"study": "t", "settings.b": "true", "status": "done", "runs": "0", "when": "today"},
    ]
    assert list(sheet.columns) == record_columns([first, second])
    assert record_columns([second])[3:7] == ["status", "reason", "seconds", "quartiles.low"]


# ---- Parameters ----------------------------------------------------------------------------------


def test_parameters_have_shape_unit_bounds_default_and_range_of_draws():
    sheet = parameter_table(ChainPendulum)
    assert (sheet.name, sheet.title) == ("parameters", "")
    heads = ("name", "what it is", "shape", "SI unit", "value", "default", "drawn from")
    assert tuple(sheet.columns) == heads
    links, must = "of links, (3,) if N = 3", "must be given"
    assert [tuple(map(str, row)) for row in sheet.rows] == [
        ("mass", "m", links, "kg", "> 0", must, "0.1 to 10"),
        ("length", "L", links, "m", "> 0", must, "0.1 to 10"),
        ("inertia", "I, central", links, "kg m²", ">= 0", must, "0.01 to 10"),
        ("gravity", "g, along -y", "number", "m/s²", ">= 0 or None", "9.81", "0 to 20"),
        ("pose", "θ at t = 0", links, "rad", "", "follows", ""),
    ]
    assert {row[0].kind for row in sheet.rows} == {"name"}  # type: ignore[attr-defined]
    rows = {str(row[0]): tuple(row[2:]) for row in parameter_table(SCENES["turntable-ball"]).rows}
    assert rows["radius"] == ("number", "m", "> 0", "0.25", "0.1 to 10")
    assert rows["rate"] == ("number", "rad/s", "", "2", "-5 to 5")
    assert rows["start"] == ("(2,)", "m", "", "(0.4, 0.0)", "")
    assert rows["swing"] == ("number", "rad/s", "or None", "None", "-5 to 5")


@pytest.mark.parametrize(
    ("default", "shown"),
    [
        (1 / 3, "0.333333"),
        (1234567.0, "1.23457e+06"),
        ((1.0,) * 5, "(1.0, 1.0, 1.0, 1.0, 1.0)"),
        ((1.0,) * 6, "Own().mass"),
        (None, "None"),
        (2, "2"),
    ],
)
def test_a_default_of_more_than_five_numbers_is_named_and_not_shown(default: Any, shown: str):
    @dataclass
    class Own:
        mass: Any = default
        declared = {  # noqa: RUF012
            "mass": SimpleNamespace(
                **{"shape": (), "sample_range": None, "sign": "", "optional": False},
                **{"what": "m", "unit": "kg", "computed_default": None},
            )
        }

    (row,) = parameter_table(Own).rows  # type: ignore[arg-type]
    assert tuple(map(str, row)) == ("mass", "m", "number", "kg", "", shown, "")


# ---- Registries ----------------------------------------------------------------------------------


def test_each_claim_and_formulation_is_told_in_the_words_of_the_registry():
    from eomcheck import CLAIMS, FORMULATIONS

    sheet = registries.registry_table("claims")
    assert (sheet.name, sheet.columns) == ("claims", ("id", "statement", "equations"))
    assert [tuple(map(str, row)) for row in sheet.rows] == [
        (one.id, one.statement, one.equations) for one in CLAIMS.values()
    ]
    sheet = registries.registry_table("formulations")
    heads = "equations", "order", "constraints at", "λ in paper", "λ here", "limits"
    assert (sheet.name, sheet.columns) == ("formulations", ("key", "name", *heads))
    assert sheet.widths == (6, 13, 10, 10, 13, 9, 6, 37)
    assert [(str(row[0]), row[1], row[-1]) for row in sheet.rows] == [
        (key, one.name, one.limits) for key, one in FORMULATIONS.items()
    ]
    assert [registries.yes(x) for x in (True, False, None)] == ["yes", "no", ""]


def test_what_a_claim_about_functions_needs_is_told_with_its_alternatives(monkeypatch):
    def claim(id: str, *needs: str) -> Any:
        return SimpleNamespace(id=id, statement=f"of {id}", needs=needs)

    claims = {one.id: one for one in (claim("a"), claim("b", "M|T", "bias"), claim("c", "q|r|s"))}
    monkeypatch.setattr("eomcheck.testing.FUNCTION_CLAIMS", claims)
    assert table(registries.function_claim_table()) == [
        {"claim": "a", "statement": "of a", "needs": "any"},
        {"claim": "b", "statement": "of b", "needs": "M or T, bias"},
        {"claim": "c", "statement": "of c", "needs": "q or r or s"},
    ]


COARSE = "", "", "unit roundoff 0.001", "no", "From elsewhere."
"""End of the row of an engine of another package, in numbers of no usual precision."""


def test_engines_are_told_with_what_is_installed_and_those_of_packages_with_what_fails(
    monkeypatch,
):
    class Own:
        """Its first line.

        And more.
        """

        key, extra, unit_roundoff = "own", None, 2.0**-53

        @classmethod
        def offers(cls, name: str) -> bool:
            assert name == "constraint_jacobian"
            return cls.key == "own"

    class Gone(Own):
        """One not there."""

        key, extra, unit_roundoff, oldest = "gone", "spare", 2.0**-24, "1.5"

    class Far(Own):
        """From elsewhere."""

        key, unit_roundoff = "far", 2.0**-10

    def version_of(engine: Any) -> str:
        if engine is Gone:
            raise EngineError("no gone")
        return f"{engine.key} 1.2"

    def engine_of(name: str) -> Any:
        if name == "bad":
            raise RuntimeError("broken\nin two lines")
        return Far

    def dist(name: str) -> Any:
        return SimpleNamespace(dist=SimpleNamespace(name=name))

    points = {"far": dist("farther"), "bad": dist("worse"), "bare": SimpleNamespace(dist=None)}
    monkeypatch.setattr("eomcheck.engines.LIBRARIES", {"own": Own, "gone": Gone})
    monkeypatch.setattr("eomcheck.engines.ENGINES", {"own": Own})
    monkeypatch.setattr("eomcheck.engines.BY_FORMAT", {"urdf": {"gone": Gone}})
    monkeypatch.setattr("eomcheck.engines.version_of", version_of)
    monkeypatch.setattr("eomcheck.engines.engine_of", engine_of)
    monkeypatch.setattr("eomcheck.class_lookup.announced", lambda kind: points)
    sheet = registries.registry_table("engines")
    heads = "library", "extra", "least version", "reads", "precision", "own constraints"
    assert (sheet.name, sheet.columns) == ("engines", ("key", *heads, "what it is"))
    assert [tuple(map(str, row)) for row in sheet.rows] == [
        ("own", "own 1.2", "none needed", "", "scenes", "float64", "yes", "Its first line."),
        ("gone", *("not installed", "spare", "1.5", "urdf", "float32", "no"), "One not there."),
        ("far", "far 1.2", "none: package farther", *COARSE),
        ("bad", "cannot be loaded", "none: package worse", *("",) * 4, "broken in two lines"),
        ("bare", "far 1.2", "", *COARSE),
    ]
    assert {row[0].kind for row in sheet.rows} == {"name"}  # type: ignore[attr-defined]


# ---- Claims, states and proofs -------------------------------------------------------------------


def test_sheets_of_claims_have_names_headings_notes_and_links():
    claims = by_claim([kept(), kept(subject="el", verdict="skipped", detail="no")])
    worst, parties = worst_table(claims), participant_table(claims, ["au"], {"bias": 0.26})
    scenes = scene_table(claims, iter(["snake", "sleigh"]))
    named = [(one.name, one.title, one.note) for one in (worst, parties, scenes)]
    assert named == [("worst", "", WORST), ("claims", "", CELLS), ("claims", "", CELLS)]
    assert list(worst.columns) == ["claim", "worst", "by", "on", "findings"]
    assert list(parties.columns) == ["claim", "all", "au", "evidence, findings", "time"]
    assert list(scenes.columns) == ["claim", "statement", "evidence", "snake", "sleigh"]
    cell = claim_link(claims[0])
    assert (str(cell), cell.kind, cell.link) == ("bias", "name", "#claim-bias")
    assert parties.rows[0][-1] == "0.3 s" and scenes.rows[0][3:] == ["50%", "·"]
    for note in (WORST, CELLS):
        assert "in percent of the error allowed (?: nothing could be checked" in note
    assert WORST.endswith("--wide tells formulations, engines and scenes apart.")


def test_sheets_of_states_have_names_headings_and_titles():
    digits = digits_table([kept(subject="au", digits=9.0)])
    assert (digits.name, list(digits.columns)) == (
        "digits",
        ["formulation", "states solved", "snake"],
    )
    assert digits.title == (
        "Decimal digits of q̈ in doubles that are right, against its true value: fewest (median)"
    )
    strata = factor_table({"snake": {"a": {"b": 1}, "c": {"d": 2, "e": 1}}, "sleigh": {"a": {}}})
    assert (strata.name, strata.title) == ("strata", "Drawn states by factor")
    assert [tuple(row.values()) for row in table(strata)] == [
        ("snake", "a", "b (1 state)"),
        ("snake", "c", "d (2 states), e (1)"),
        ("sleigh", "a", ""),
    ]
    nothing = kept(subject="au", digits=None)
    assert digits_table([nothing]).rows == [] and list(digits_table([nothing]).columns) == [
        "formulation",
        "states solved",
    ]


@pytest.mark.parametrize("failed", [False, True])
@pytest.mark.parametrize("over", [False, True])
def test_proofs_are_printed_with_what_was_started_over_and_how_sure_they_are(capsys, failed, over):
    rows = [proof(1e-20, 4, 30.0), kept("motion", verdict="failed", case=None, structure="s")]
    jobs = SimpleNamespace(scenes=[1], points=9)
    of: Any = SimpleNamespace(findings={"a": rows[: 1 + failed]}, jobs=jobs, started_over=over)
    of.taken_over, of.seed = 0, 3
    finding_output.print_proofs(of)
    said = " ".join(capsys.readouterr().out.split())
    assert ("an unfinished file of other settings or sources was started over" in said) == over
    assert "Had any identity been false" in said
    assert said.endswith(f"1 identity proved, {int(failed)} disproved on 1 of 1 structure")
    of.findings = {"a": rows[1:]}
    finding_output.print_proofs(of)
    said = " ".join(capsys.readouterr().out.split())
    assert said.endswith("0 identities proved, 1 disproved on 1 of 1 structure")
    assert "Had any" not in said
    of.findings = {"a": []}
    finding_output.print_proofs(of)
    assert capsys.readouterr().out == "nothing was proved\n"
    sheet = finding_output.proof_table(by_claim(rows))
    assert (sheet.name, sheet.title) == ("proofs", "")
    assert list(sheet.columns) == [
        *("claim", "statement", "proved", "disproved", "skipped"),
        *("degree ≤", "height ≤", "failure probability <"),
    ]
    lines = {str(row[0]): list(map(str, row[1:])) for row in sheet.rows}
    assert lines["bias"][1:] == ["1", "", "", "4", "30 bits", "1.0e-20"]
    assert lines["motion"][1:] == ["", "1", "", "", "", ""]


# ---- Sections ------------------------------------------------------------------------------------


def study(monkeypatch, **change: Any) -> list[Record]:
    """Register a study as the only one; return the Records that it was asked about."""
    asked: list[Record] = []

    def sheets(found):
        asked.extend(found)
        rows = [["1"]]
        yield ResultTable("a", "", ["x"], rows)
        yield ResultTable("b", "", ["x"], rows, detail=True)
        yield ResultTable("c", "", ["x"], [])
        yield ResultTable("d", "", ["x"], rows)

    usual: dict[str, Any] = {"cells": lambda: [], "worker": lambda found: None, "tables": sheets}
    usual |= {"remarks": lambda found: ["First.", "Second."], "reading": "How to read."}
    usual |= {"charts": lambda found: [f"chart of {len(found)}"]}
    made = Study(key="own-study", **(usual | change))
    monkeypatch.setattr(sections, "STUDIES", {"own-study": "What it is.", "empty": ""})
    monkeypatch.setattr(sections, "study_of", lambda key: made)
    return asked


def test_a_section_of_a_study_has_its_words_and_its_tables_that_are_no_details(monkeypatch):
    asked = study(monkeypatch)
    own = [record("own-study", {"a": 1}), record("own-study", {"a": 2})]
    overview = Overview([*own, record("other", {})])
    (section,) = sections.sections_of(overview)
    assert section[:3] == (
        *("own-study", "Own-study"),
        "What it is. How to read. First. Second.",
    )
    assert [one.name for one in section.tables] == ["a", "d"]
    assert (asked, section.charts()) == (own, ["chart of 2"])
    assert overview.unread == []
    assert sections.Section("a", "", "", ()).charts() == ()


def raising(error: Exception) -> Any:
    def shown(found):
        yield "one"
        raise error

    return shown


@pytest.mark.parametrize(
    "error",
    [
        *(InputError("no such\nscene"), KeyError("no"), IndexError("no"), ZeroDivisionError("no")),
        *(AttributeError("no"), TypeError("no"), ValueError("no")),
    ],
)
@pytest.mark.parametrize("what", ["remarks", "tables", "charts"])
def test_records_that_a_study_cannot_show_are_said_and_leave_no_section(monkeypatch, what, error):
    study(monkeypatch, **{what: raising(error)})
    overview = Overview([record("own-study", {})])
    found = sections.sections_of(overview)
    assert [one.charts() for one in found] == ([[]] if what == "charts" else [])
    message = {"InputError": "no such scene", "KeyError": "'no'"}.get(type(error).__name__, "no")
    assert overview.unread == [
        f"the records of 'own-study' cannot be shown: {type(error).__name__}: {message}"
    ]


def test_a_fault_of_a_study_that_is_no_matter_of_its_records_is_raised(monkeypatch):
    study(monkeypatch, tables=raising(RuntimeError("a bug")))
    with pytest.raises(RuntimeError, match="a bug"):
        sections.sections_of(Overview([record("own-study", {})]))


def test_the_sections_of_states_are_the_first_and_only_where_there_are_any(monkeypatch):
    study(monkeypatch)
    series = {"engines": [], "claims": [], "seconds": []}
    drawn = {"strata": ["speeds"], "ways": ["slow"], "states in them": [3]}
    run = Record(RUNS, {"scene": "snake"}, series=series | drawn)
    overview = Overview([record("own-study", {}), run])
    assert [one.id for one in sections.sections_of(overview)] == ["strata", "own-study"]
    overview.rows = [kept(subject="au", digits=1.0)]
    found = {one.id: one for one in sections.sections_of(overview)}
    assert [*found] == ["digits", "strata", "own-study"]
    assert (found["digits"].title, found["strata"].title) == ("Certified digits", "States drawn")
    assert found["digits"].text.startswith("Decimal digits of q̈ in doubles that are certainly")
    assert found["strata"].text.endswith("a scene class with no state was not checked.")
    bare = Overview([Record(RUNS, {"scene": "snake"}, series=series)])
    assert sections.sections_of(bare) == []


# ---- Data of engines -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Jointed:
    """A scene whose tree knows its mass alone."""

    key = "jointed"
    mass: float = 2.0
    damping: float | None = None
    spring: float = -1.0 / 5.0
    length: float = 4.0

    @classmethod
    def example(cls) -> Jointed:
        return cls()

    @classmethod
    def ranges(cls, links: int | None) -> dict[str, Any]:
        assert links is None
        return dict.fromkeys(("length", "mass", "damping", "spring"))

    def tree(self) -> Any:
        return ([self.mass, 1.0], [self.length])


class Free(Jointed):
    """A scene without a tree."""

    key = "free"

    def tree(self) -> Any:
        return None


@pytest.mark.parametrize(
    ("engines", "by"),
    [
        (["reads", "apart", "twice", "unknown"], "apart, twice"),
        (["twice"], "twice"),
        (["reads"], ""),
        ([], ""),
    ],
)
def test_data_are_another_engine_s_where_they_change_the_tree_that_it_is_built_of(
    monkeypatch, engines, by
):
    kinds = {"jointed": Jointed, "free": Free}
    monkeypatch.setattr(report_formats, "SCENES", kinds)
    monkeypatch.setattr(report_formats, "link_count", lambda scene: None)
    monkeypatch.setattr(
        report_formats,
        "ENGINES",
        {
            "reads": SimpleNamespace(reads_parameters=True),
            "apart": SimpleNamespace(reads_parameters=False),
            "twice": SimpleNamespace(reads_parameters=False),
        },
    )
    runs = [
        SimpleNamespace(settings={"scene": key}, series={"engines": engines})
        for key in ("jointed", "gone", "free")
    ]
    overview: Any = SimpleNamespace(runs=runs)
    every = "common mode not covered: length, mass, damping, spring"
    of_tree = f"length, mass ({by}, from the tree)", "common mode not covered: damping, spring"
    assert [tuple(one) for one in report_formats.independent_parameters(overview)] == [
        ("jointed", *(of_tree if by else ("-", every))),
        ("free", "-", every),
    ]
