"""Tables as data: what a terminal of any width, Markdown and CSV make of them."""

from __future__ import annotations

import csv
import io
import re

import pytest
from rich.cells import cell_len
from rich.console import Console
from rich.text import Text
from tests import reports

from eomcheck.lab.proofs import Proofs, proof_jobs
from eomcheck.lab.report.finding_output import proof_table
from eomcheck.lab.report.overview import by_claim, evidence_table, participant_table, scene_table
from eomcheck.lab.report.registries import parameter_table, registry_table
from eomcheck.lab.show.table import Cell, ResultTable, _filled, _narrowed
from eomcheck.lab.store.record_file import Records
from eomcheck.lab.store.validation_runs import (
    StoredFinding,
    stored_findings_in,
    stored_findings_of_runs,
)
from eomcheck.scenes import SCENES, Andrews, ChainPendulum

REGISTRIES = ("formulations", "scenes", "engines", "claims")


def printed(sheet: ResultTable, width: int) -> str:
    file = io.StringIO()
    Console(file=file, width=width).print(sheet.text(width))
    return file.getvalue()


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> list[StoredFinding]:
    path = tmp_path_factory.mktemp("kept") / "r.db"
    run = reports.validated(path, reports.Heavy)
    with Records(path) as records:
        assert [(k.claim, k.verdict, k.python) for k in stored_findings_in(records.all())] == [
            (k.claim, k.verdict, k.python) for k in stored_findings_of_runs({"heavy": run})
        ]
    return stored_findings_of_runs({"heavy": run})


def tables(kept: list[StoredFinding]) -> list[ResultTable]:
    claims = by_claim(kept)
    proofs = Proofs(proof_jobs("sleigh", None, 1, 0, reports.KEYS))
    proofs.run()
    names = ("im", "au", "el", "gw", "em", "ml", "kane", "banded", "pinocchio", "casadi")
    return [
        *map(registry_table, REGISTRIES),
        participant_table(claims, names, {"mass-matrix": 0.1}),
        scene_table(claims, SCENES),
        *map(evidence_table, claims),
        proof_table(by_claim(one for found in proofs.findings.values() for one in found)),
    ]


@pytest.mark.parametrize("width", [40, 80, 140])
def test_a_table_fits_into_a_terminal_and_says_all_there(kept: list[StoredFinding], width: int):
    for sheet in tables(kept):
        text = printed(sheet, width)
        assert max(map(cell_len, text.splitlines())) <= width, sheet.name
        words = {word for row in sheet.rows for cell in row for word in cell.split()} - {"·"}
        assert all(word in text for word in words if len(word) <= 30), sheet.name
        assert "…" not in text


def test_headings_break_at_hyphens_where_they_do_not_fit():
    sheet = ResultTable("x", "", ("claim", "flyball-governor"), [("a", "1")])
    assert "flyball-governor" in printed(sheet, 40)
    assert re.search("flyball-.*\n.*governor", printed(sheet, 24))
    assert "claim a" in printed(sheet, 12)


def test_numbers_end_at_the_right_whatever_stands_between_them():
    rows = [("a", "<1%"), ("b", "FAIL"), ("c", "·"), ("d", "12 %"), ("e", "?")]
    assert ResultTable("x", "", ("key", "ratio"), rows).of_numbers(1)
    assert not ResultTable("x", "", ("key", "ratio"), rows).of_numbers(0)


def test_markdown_reads_nothing_as_markup_but_names_as_code():
    sheet = ResultTable("x", "", ("key", "|q̈|"), [(Cell("a_1", "name"), "<1% of a_1")])
    assert sheet.markdown().splitlines() == [
        r"| key | \|q̈\| |",
        "| --- | ---: |",
        r"| `a_1` | \<1% of a\_1 |",
    ]


def test_csv_reads_back():
    rows = [["a", 'x, "y"'], ["b", "two\nlines"]]
    sheet = ResultTable("x", "", ["key", "text"], rows)
    assert list(csv.reader(io.StringIO(sheet.csv()))) == [["key", "text"], *rows]
    assert sheet.without("text").csv() == "key\na\nb\n"


def test_the_parameters_of_a_scene_are_listed_with_units_defaults_and_ranges():
    rows = {row[0]: tuple(row[1:]) for row in parameter_table(ChainPendulum).rows}
    kilograms = "m", "of links, (3,) if N = 3", "kg", "> 0", "must be given", "0.1 to 10"
    assert rows["mass"] == kilograms
    assert rows["gravity"][3:] == (">= 0 or None", "9.81", "0 to 20")
    assert rows["pose"][4:] == ("follows", "")
    rows = {row[0]: tuple(row[1:]) for row in parameter_table(Andrews).rows}
    assert rows["center"][1] == "(7, 2)" and rows["center"][4] == "Andrews().center"
    assert all(len(parameter_table(kind).rows) == len(kind.declared) for kind in SCENES.values())


# ---- Room ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("widths", "least", "room", "made"),
    [
        ([10, 5, 3], [2, 4, 3], 18, [10, 5, 3]),
        ([10, 5, 3], [2, 4, 3], 14, [6, 5, 3]),
        ([10, 5, 3], [8, 1, 3], 14, [8, 3, 3]),
        ([10, 5, 3], [2, 4, 3], 9, [2, 4, 3]),
        ([10, 5, 3], [2, 4, 3], 8, None),
    ],
)
def test_the_widest_columns_are_narrowed_to_what_they_need_at_least(widths, least, room, made):
    assert _narrowed(widths, least, room) == made


def test_texts_are_joined_into_lines_as_long_as_they_fit():
    texts = [Text(text) for text in ("a: 1", "b: 22", "c: 333", "much too long")]
    lines = [[line.plain for line in _filled(texts, room)] for room in (11, 10)]
    assert lines == [
        ["a: 1; b: 22", "c: 333", "much too long"],
        ["a: 1", "b: 22", "c: 333", "much too long"],
    ]


def test_a_table_without_room_is_a_list_of_what_its_rows_say():
    columns = ["claim", "first", "second", "third", "fourth"]
    rows = [("bias", "1", "·", "", "22"), ("motion", "333", "4444", "x", "y")]
    sheet = ResultTable("x", "", columns, rows)
    assert printed(sheet, 24).splitlines() == [
        "claim bias",
        "  first: 1; fourth: 22",
        "claim motion",
        "  first: 333",
        "  second: 4444; third: x",
        "  fourth: y",
    ]
    few = ResultTable("x", "", columns[:3], [("bias", "1", "a long word")])
    lines = [line.rstrip() for line in printed(few, 13).splitlines()]
    assert lines == ["claim bias", "  first: 1", "  second: a", "  long word"]


def test_columns_of_sentences_share_the_width_of_a_wide_terminal_and_are_listed_in_a_narrow_one():
    sheet = ResultTable("x", "", ("key", "what"), [("a", "words " * 30)], widths=(1, 3))
    lines = printed(sheet, 100).splitlines()
    assert {cell_len(line) for line in lines} == {7 + 23 + 69}
    assert [len(x) for x in lines[0].split("┳")] == [1 + 25, 71 + 1]
    assert printed(sheet, 99).startswith("key a\n  what: words")
