"""What commands print fits into a terminal of any width: no line is too long, nothing is cut."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer
from rich.cells import cell_len
from tests.cli.test_cli import plant_in_au, run
from tests.widths import WIDTHS, check_fits

import eomcheck
from eomcheck import cli
from eomcheck.cli.study_commands import GROUPS
from eomcheck.console import console
from eomcheck.lab.fuzzing import state_rounds
from eomcheck.lab.report.registries import registry_table
from eomcheck.lab.show import table

COMMANDS = {
    "doors": "",
    "formulations": "list formulations",
    "scenes": "list scenes",
    "engines": "list engines",
    "claims": "list claims",
    "quantities": "list quantities",
    "validate": "validate --scene sleigh --examples 2",
    "wide": "validate --scene sleigh --examples 2 --wide",
    "prove": "prove --links 1 --examples 1 --seed 1",
    "acceleration": "acceleration pattern --links 60 --speeds 1,0.5",
    "simulate": "simulate paper --end 0.01 --formulation kane,au",
    "draws": "simulate paper --end 0.01 --examples 3",
    "constraints": "constraints --scene four-bar-chain",
    "rhs": "bench rhs --scene sleigh --repeats 1 --formulation kane,au",
    "differentiation": "bench differentiation --repeats 1 --formulation au",
    "tolerance": "bench tolerance --links 1 --examples 2",
    "operations": "study operations --links 2..4",
    "saved": "study operations --scene sleigh --repeats 0",
    "accuracy": "study accuracy --links 1..2 --examples 2",
    "agreement": "study agreement --links 1..2 --per-size 2",
    "studies": "study --help",
    "check": "check docs/guides/cart.py --examples 2",
}
OTHERS = {"states", "report", "export", "reference", "compare", "fuzz", "badge"}
"""Commands that need files or take long: below; what `reference` prints is a table of
`ResultTable`.
"""
HELP = [
    [],
    *([name] for name in sorted(typer.main.get_command(cli.app).commands)),  # type: ignore[attr-defined]
    *([group, key] for group, keys in GROUPS.items() for key in keys),
    ["draw", "scene"],
    ["draw", "structure"],
]


@pytest.fixture(params=WIDTHS)
def width(request, monkeypatch) -> Iterator[int]:
    """Print for somebody who has so many columns."""
    before = console.width
    console.width = request.param
    monkeypatch.setattr(table, "WIDTH_KNOWN", True)
    monkeypatch.setenv("COLUMNS", str(request.param))
    yield request.param
    console.width = before


@pytest.mark.sampled(5)
@pytest.mark.parametrize("command", COMMANDS)
def test_what_a_command_prints_fits_and_nothing_of_it_is_cut(command, width, monkeypatch, capsys):
    assert run(*COMMANDS[command].split(), monkeypatch=monkeypatch) in (0, 1)
    printed = capsys.readouterr().out
    assert printed.strip()
    check_fits(printed, width)
    words = set(re.findall(r"[\w-]+", printed))
    if command in ("formulations", "scenes", "engines", "claims"):
        assert set(getattr(eomcheck, command.upper())) <= words, "no key is cut"
    if command in ("validate", "wide"):
        assert {"mass-matrix", "constraint-acceleration", "casadi", "sleigh"} <= words


def test_no_command_is_left_out():
    looked_at = {line.split()[0] for line in COMMANDS.values() if line} | OTHERS | {"draw"}
    assert {words[0] for words in HELP if words} == looked_at


FUZZ = ["fuzz", "--links", "2", "--engine", "none", "--check-frequency"]
FUZZ += ["enclosures=0,balls=0,engines=0,checks=0,scalar-only=0"]


def test_what_is_kept_is_reported_and_exported_in_lines_that_fit(
    width, monkeypatch, capsys, tmp_path
):
    kept, page = str(tmp_path / "r.db"), str(tmp_path / "r.md")
    study = "study", "operations", "--links", "2..3", "--records", kept
    assert run(*study, monkeypatch=monkeypatch) == 0
    capsys.readouterr()
    assert run("report", kept, "--markdown", page, monkeypatch=monkeypatch) == 0
    said = capsys.readouterr().out
    # The name of a file is whole, however long it is.
    check_fits(said.replace(page, "r.md"), width)
    assert page in said
    assert run("export", kept, monkeypatch=monkeypatch) == 0
    head, *rows = capsys.readouterr().out.splitlines()
    assert rows and all(row.count(",") >= head.count(",") for row in rows), "CSV is not folded"


@pytest.mark.night
def test_what_fuzzing_prints_fits(width, monkeypatch, capsys):
    monkeypatch.setattr(state_rounds, "BATCH", 8)
    assert run(*FUZZ, "--family", "ordinary,wide", "--examples", "1", monkeypatch=monkeypatch) == 0
    check_fits(capsys.readouterr().out, width)


@pytest.mark.sampled(3)
def test_what_compares_readers_of_a_file_fits(width, monkeypatch, capsys):
    robot = Path(__file__).parents[2] / "docs" / "guides" / "crane.urdf"
    monkeypatch.chdir(robot.parent)
    how = "--engine", "pinocchio", "--examples", "1"
    assert run("compare", robot.name, *how, monkeypatch=monkeypatch) in (0, 1)
    check_fits(capsys.readouterr().out, width)


@pytest.mark.sampled(6)
@pytest.mark.parametrize("of", HELP, ids=" ".join)
def test_help_fits_and_says_whole_sentences(of, width, monkeypatch, capsys):
    assert run(*of, "--help", monkeypatch=monkeypatch) == 0
    printed = capsys.readouterr().out
    check_fits(printed, width)
    assert not re.search(r"<[a-z]+|TEXT|[{}]", printed), "values have names, not Python's types"


def test_the_paper_s_robot_is_named_where_scenes_are(monkeypatch, capsys):
    for words in (["simulate", "--help"], ["draw", "scene", "--help"]):
        assert run(*words, monkeypatch=monkeypatch) == 0
        assert "paper (the paper's robot)" in " ".join(capsys.readouterr().out.split())
    (snake,) = [row for row in registry_table("scenes").rows if row[0] == "snake"]
    assert "the paper's robot" in snake[1]


@pytest.mark.night
def test_the_worst_is_shown_with_its_culprit_and_wide_tells_all(monkeypatch, capsys):
    plant_in_au(monkeypatch)
    arguments = ("validate", "--links", "2", "--examples", "3", "--formulation", "au,kane")
    assert run(*arguments, monkeypatch=monkeypatch) == 1
    assert "FAIL constraint-acceleration (au) on snake, N = 2" in capsys.readouterr().out
    assert run(*arguments, "--wide", monkeypatch=monkeypatch) == 1
    row, parties = [
        line
        for line in capsys.readouterr().out.splitlines()
        if line.startswith("│ constraint-acceleration")
    ]
    _, claim, worst, by, on, *_ = map(str.strip, row.split("│"))
    assert (claim, worst, by) == ("constraint-acceleration", "FAIL", "au")
    assert re.fullmatch(r"snake\[\d\] #\d+", on)
    assert [cell.strip() for cell in parties.split("│")[2:5]] == ["FAIL", "FAIL", "<1%"]


def test_the_culprit_is_who_comes_nearest_to_what_is_allowed(monkeypatch, capsys, tmp_path):
    file = tmp_path / "f.json"
    arguments = ("validate", "--scene", "sleigh", "--wide", "--examples", "2", "--json", str(file))
    assert run(*arguments, monkeypatch=monkeypatch) == 0
    rows = [line.split("│") for line in capsys.readouterr().out.splitlines()]
    printed = {row[1].strip(): row[3].strip() for row in rows if len(row) == 7}
    found: dict[str, list] = {}
    for one in json.loads(file.read_text(encoding="utf-8"))["findings"]:
        if one["verdict"] == "passed" and one["allowed"]:
            ratio = one["observed"] / one["allowed"]
            found.setdefault(one["claim"], []).append((ratio, one["subject"]))
    told: dict[str, set[str]] = {}
    for claim, those in found.items():
        most, _ = max(those)
        if most > 0:
            told[claim] = {subject for ratio, subject in those if ratio == most}
    assert len(told) > 12 and len(set().union(*told.values())) > 6
    assert {claim for claim, subjects in told.items() if printed[claim] in subjects} == set(told)


@pytest.mark.night
@pytest.mark.parametrize(("columns", "most"), [("40", 40), ("80", 80), (None, 140), ("3", 140)])
def test_columns_is_honoured_where_output_is_piped_and_so_is_no_color(columns, most):
    environment = {name: x for name, x in os.environ.items() if name != "COLUMNS"}
    environment |= {"FORCE_COLOR": "1", "NO_COLOR": "1"} | ({"COLUMNS": columns} if columns else {})
    code = "import sys; from eomcheck import cli; sys.argv[1:] = ['list', 'engines']; cli.main()"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=True
    )
    plain = re.sub("\x1b\\[[0-9;]*m", "", done.stdout)
    longest = max(cell_len(line) for line in plain.splitlines())
    assert longest <= most and longest > most - 12
    colors = re.findall("\x1b\\[([0-9;]*)m", done.stdout)
    assert not [x for x in colors if re.search(r"\b(3|4|9)[0-7]\b", x)], "bold is no colour"


@pytest.mark.night
def test_what_tests_compare_does_not_depend_on_who_looks_at_them():
    test = "tests/cli/test_cli.py::test_a_refusal_names_the_matrix_and_its_rcond_and_is_exit_code_1"
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:xdist", "-p", "no:cacheprovider"]
    environment = os.environ | {"COLUMNS": "40", "NO_COLOR": "1", "FORCE_COLOR": "1"}
    done = subprocess.run(
        [*command, "-o", "addopts=--import-mode=importlib", test],
        capture_output=True,
        text=True,
        env=environment,
        cwd=Path(__file__).parents[2],
    )
    assert done.returncode == 0, done.stdout
