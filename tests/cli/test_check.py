"""`eomcheck check`: equations of motion of a file, in one command."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import pytest

from eomcheck import cli

RIGHT = """
import numpy as np
M = lambda q: np.array([[3.0, np.cos(q[1])], [np.cos(q[1]), 1.0]])
bias = lambda q, v: np.array([-np.sin(q[1]) * v[1] ** 2, 0.0])
"""


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys):
    """A function that writes a file, runs `check` in its folder and returns code and output."""
    monkeypatch.chdir(tmp_path)
    # Without folders of files that others have checked: a module has its name there.
    monkeypatch.setattr(sys, "path", [x for x in sys.path if not x.endswith("guides")])
    monkeypatch.setattr("eomcheck.console.PATIENCE", 1e4)

    def run_check(name: str, text: str, *words: str) -> tuple[int, str, str]:
        Path(f"{name}.py").write_text(text, encoding="utf-8")
        monkeypatch.delitem(sys.modules, name, raising=False)
        monkeypatch.setattr(sys, "argv", ["eomcheck", "check", f"{name}.py", *words])
        with pytest.raises(SystemExit) as stop:
            cli._run()
        printed = capsys.readouterr()
        monkeypatch.delitem(sys.modules, name, raising=False)
        return int(stop.value.code or 0), printed.out, printed.err

    return run_check


def test_right_equations_exit_with_0_and_wrong_ones_with_1(run, tmp_path: Path):
    code, out, _ = run("cart_right", RIGHT, "--examples", "3")
    assert code == 0
    assert "n = 2; 3 states, seed 0" in out
    wrong = RIGHT.replace("v[1] ** 2", "v[1] ** 2 / 2")
    code, out, _ = run("cart_wrong", wrong, "--json", "a.json", "--report", "a.html")
    assert code == 1
    assert out.index("claims failed") < out.index("FAIL M or bias") < out.index("passed: ")
    document = json.loads(Path("a.json").read_text())
    assert (document["n"], document["states"], document["seed"]) == (2, 20, 0)
    assert document["equations"] == {"name": "cart_wrong", "functions": ["M", "bias"]}
    assert document["notes"] == ["n = 2 coordinates, as M shows"]
    failed = {x["claim"] for x in document["findings"] if x["verdict"] == "failed"}
    assert failed == {"bias-of-mass-matrix", "bias-power"}
    page = Path("a.html").read_text(encoding="utf-8")
    assert "bias-of-mass-matrix" in page
    assert "cart_wrong" in page


def test_a_reference_in_a_file_decides(run, tmp_path: Path):
    Path("other_cart.py").write_text(RIGHT.replace("3.0", "4.0"), encoding="utf-8")
    code, out, _ = run("cart_against", RIGHT, "--against", "other_cart.py", "--examples", "2")
    assert code == 1
    assert "against other_cart.py" in out
    assert "reference" in out


@pytest.mark.parametrize(
    ("text", "words", "message"),
    [
        ("x = 1\n", (), "has none of the functions that are checked"),
        (RIGHT, ("--claim", "coriolis-bias"), "nothing could be decided"),
        (RIGHT, ("--claim", "nothing"), "'nothing'"),
        (RIGHT, ("--examples", "0"), "--examples"),
        (RIGHT, ("--against", "nowhere"), "'nowhere'"),
        ("raise ValueError('no')\n", (), "cannot be imported"),
    ],
)
def test_bad_input_is_one_sentence_and_exit_code_2(run, text: str, words, message: str):
    code, _, error = run("cart_bad", text, *words)
    assert code == 2
    assert message in error
    assert error.startswith("eomcheck: ")
    assert error.count("\n") == 1


GUIDES = Path(__file__).parents[2] / "docs" / "guides"
FIX = "[m_load * length", "[-m_load * length"


@pytest.mark.parametrize(
    ("page", "file", "marker", "fix", "code"),
    [
        ("check-your-own", "half", "half.py", ("", ""), 1),
        ("one-wrong-sign", "trolley", "trolley.py", ("", ""), 1),
        ("one-wrong-sign", "trolley", "trolley.py with the fix", FIX, 0),
    ],
)
def test_a_guide_shows_what_is_printed_of_its_file(run, page, file, marker, fix, code):
    text = (GUIDES / f"{page}.md").read_text(encoding="utf-8")
    (_, shown) = text.split(f"<!-- eomcheck check {marker} -->\n\n```text\n")
    source = (GUIDES / f"{file}.py").read_text(encoding="utf-8")
    ended, out, _ = run(file, source.replace(*fix))
    assert ended == code
    # Numbers of measured errors depend on the processor.
    alike = lambda text: re.sub(r"(largest error).*|(error|allows) \S+", r"\1 x", text)  # noqa: E731
    assert alike(out).startswith(alike(shown.partition("```")[0]))
