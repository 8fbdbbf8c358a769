"""Names with control characters: neither the terminal nor a page nor an XML file obeys them."""

from __future__ import annotations

import io
from types import SimpleNamespace
from xml.etree import ElementTree

import pytest
from rich.console import Console

from eomcheck.lab.report.report_formats import write_junit
from eomcheck.lab.show import table
from eomcheck.lab.show.table import Cell, ResultTable
from eomcheck.safe_output import without_control_characters

NAME = "arm\x1b]0;owned\x07\x9b2J\x00\u202e\r"


def test_a_text_of_lines_and_tabs_keeps_these_alone():
    assert without_control_characters("a\n\tb") == "a\n\tb"
    for one in "\r\v\f\b\x7f\x85\u2028\u2029\u202b\u2066\u2069\ud800":
        assert without_control_characters(f"a{one}b") == "a\ufffdb", ascii(one)


@pytest.mark.parametrize("width", [20, 140])
def test_a_table_and_its_title_and_note_control_no_terminal(width, monkeypatch):
    text = io.StringIO()
    monkeypatch.setattr(table, "console", Console(file=text, width=width, force_terminal=False))
    rows = [(NAME, Cell(NAME, "failed"), "1"), ("a", "b", "2")]
    table.print_tables([ResultTable("x", NAME, ("scene", "claim", "number"), rows, note=NAME)])
    printed = text.getvalue()
    assert printed.count("owned") == 4
    assert not set(printed) & set("\x1b\x07\x9b\x00\u202e\r")


def test_a_page_holds_no_control_character():
    jinja2 = pytest.importorskip("jinja2")
    environment = table.environment()
    environment.loader = jinja2.DictLoader({"x.html.j2": "<p>{{ name }}</p>\n"})
    page = environment.get_template("x.html.j2").render(name=NAME + "<b>")
    assert page == "<p>arm\ufffd]0;owned\ufffd\ufffd2J\ufffd\ufffd\ufffd&lt;b&gt;</p>\n"


def test_a_file_of_junit_is_xml_whatever_a_scene_is_called(tmp_path):
    run = SimpleNamespace(
        settings={"scene": NAME}, status="failed", series={"claims": [], "seconds": []}
    )
    overview = SimpleNamespace(runs=[run], scenes=[NAME], claims=[])
    write_junit(overview, path := tmp_path / "x.xml")  # type: ignore[arg-type]
    (suite,) = ElementTree.parse(path).getroot()
    assert "owned" in suite.get("name", "") and suite[0].get("classname", "").count("owned") == 1
