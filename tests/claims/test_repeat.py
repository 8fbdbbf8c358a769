"""Code that shows a finding again runs as it is printed, in a process of its own."""

from __future__ import annotations

import importlib
import os
import re
import subprocess
import sys
import textwrap
from html import unescape
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from tests.engines.planar import with_fault

import eomcheck
from eomcheck.claims.reproducer import reproducer_code, scene_code
from eomcheck.engines import engine_of
from eomcheck.mechanics.records import State
from eomcheck.scene_lookup import scene_classes_named
from eomcheck.scenes import Sleigh

GUIDES = Path(__file__).parents[2] / "docs" / "guides"
COMMAND = [sys.executable, "-c", "from eomcheck.cli import main; main()"]

PLAIN = """
from typing import NamedTuple

import numpy as np

from eomcheck.mechanics.records import Jacobians
from eomcheck.mechanics.scene import Scene


class Numbers(NamedTuple):
    mass: object
    inertia: object


class Plain(Scene):
    key, conserves_energy = "plain", True
    named_coordinates = ("x", "y")

    def __init__(self, mass=2.0):
        self.mass = mass

    def parameters(self, arithmetic):
        return Numbers(arithmetic.numbers(np.array([self.mass])), arithmetic.numbers(np.zeros(1)))

    def initial_state(self):
        return np.array([0.1, 0.2]), np.array([0.3, 0.4])

    @staticmethod
    def jacobians(parameters, prepared, q, v):
        J = np.array([[[1, 0], [0, 1]]], v.dtype)
        return Jacobians(J, 0 * J[:, :1], np.zeros((1, 2), v.dtype), np.zeros((1, 1), v.dtype))

    @staticmethod
    def velocities(parameters, prepared, q, v):
        return np.array([[v[0], 2 * v[1]]], v.dtype), np.zeros((1, 1), v.dtype)
"""


def run(code: str) -> str:
    """Run code as a user would paste it, with nothing but the package on its path."""
    source = Path(eomcheck.__file__).parents[1]
    environment = {**os.environ, "PYTHONPATH": str(source)}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment, cwd="/"
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def plain(folder: Path, name: str, text: str = PLAIN):
    path = folder / f"{name}.py"
    path.write_text(text)
    (kind,) = scene_classes_named(f"{path}:Plain")
    return kind


@pytest.mark.parametrize("mass", [2.0, 3.5])
@pytest.mark.sampled(2)
def test_a_scene_in_a_file_is_made_again_from_what_it_keeps_by_name(mass, tmp_path):
    kind = plain(tmp_path, f"plain_{int(10 * mass)}")
    scene = kind(mass)
    assert scene_code(scene) == ("Plain()" if mass == 2.0 else "Plain(mass=3.5)")
    how = {"engines": [], "claims": ["mass-matrix"]}
    (skipped,) = eomcheck.check_state(scene, *scene.initial_state(), **how)
    assert skipped.verdict == "skipped"
    found = eomcheck.check_state(scene, *scene.initial_state(), engines=["casadi"])
    failed = [f for f in found if f.verdict == "failed"]
    assert failed[0].claim == "mass-matrix"
    printed = run(failed[0].as_python())
    assert [str(f) for f in failed] == printed.splitlines()


@pytest.mark.night
def test_a_dataclass_is_made_again_from_its_fields(tmp_path):
    text = PLAIN.replace(
        "    def __init__(self, mass=2.0):\n        self.mass = mass\n",
        "    mass: np.ndarray\n    label: str = 'x'\n",
    ).replace("class Plain", "from dataclasses import dataclass\n@dataclass(eq=False)\nclass Plain")
    scene = plain(tmp_path, "plain_dataclass", text)(np.array(1.5), "mine")
    assert scene_code(scene) == "Plain(mass=1.5, label='mine')"
    code = reproducer_code(scene, State(*scene.initial_state(), 0.0))
    assert "mass-matrix" in run(code)


@pytest.mark.night
def test_the_scene_of_the_guide_is_made_again_with_its_defaults_left_out():
    (kind,) = scene_classes_named(f"{GUIDES / 'trailer.py'}:Trailer")
    assert scene_code(kind()) == "Trailer()"
    assert scene_code(kind(back=1.0)) == "Trailer(back=1.0)"
    code = reproducer_code(kind(), State(*kind().initial_state(), 0.0))
    assert "0x" not in code
    assert run(code) == "", "nothing fails"


def test_a_class_that_nobody_can_import_is_told():
    class Local(Sleigh):
        pass

    code = reproducer_code(Local(), State(*Local().initial_state(), 0.0))
    assert "# test_a_class_that_nobody_can_import_is_told.<locals>.Local is defined nowhere" in code
    compile(code, "printed", "exec")


@pytest.mark.night
def test_a_class_of_a_package_that_is_not_installed_is_found_from_its_root():
    from tests.scenes.test_own_scene import Free

    code = reproducer_code(Free(), State(*Free().initial_state(), 0.0))
    assert str(Path(__file__).parents[2]) in code
    assert run(code) == ""


@pytest.mark.parametrize("file", ["inner.py", "inner/__init__.py"])
def test_a_class_of_a_package_within_a_package_is_found_from_its_root(tmp_path, monkeypatch, file):
    path = tmp_path / "outer" / file
    path.parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / "outer" / "__init__.py").write_text("")
    path.write_text("from eomcheck.scenes import Sleigh\n\n\nclass Own(Sleigh):\n    pass\n")
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("outer", "outer.inner"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    scene: Sleigh = importlib.import_module("outer.inner").Own()
    code = reproducer_code(scene, State(*scene.initial_state(), 0.0))
    root = f"sys.path.insert(0, {str(tmp_path.resolve())!r})\nfrom outer.inner import Own\n"
    assert root in code


@pytest.mark.night
def test_an_engine_on_trial_and_our_scenes_are_found_again(tmp_path):
    path = with_fault(tmp_path, "planar_repeat", "rest - (spin", "rest + (spin")
    engine = engine_of(f"{path}:Planar")
    scene = Sleigh()
    found = eomcheck.check_state(scene, *scene.initial_state(), engines=[engine])
    (bias, *_) = (f for f in found if f.verdict == "failed")
    assert bias.claim == "bias"
    assert bias.engine is engine
    assert str(bias) in run(bias.as_python()).splitlines()


@pytest.mark.night
def test_every_report_prints_code_that_runs(tmp_path):
    path = with_fault(tmp_path, "planar_reported", "rest - (spin", "rest + (spin")
    kept, html = tmp_path / "kept.db", tmp_path / "report.html"
    markdown, junit = tmp_path / "report.md", tmp_path / "report.xml"
    asked = ["--engine", f"{path}:Planar", "--scene", "sleigh", "--examples", "2"]
    done = subprocess.run(
        [*COMMAND, "validate", *asked, "--records", str(kept)], capture_output=True, text=True
    )
    assert done.returncode == 1, done.stderr
    report = ["report", str(kept), "--html", str(html), "--markdown", str(markdown)]
    done_too = subprocess.run(
        [*COMMAND, *report, "--junit", str(junit)], capture_output=True, text=True
    )
    assert done_too.returncode == 1, done_too.stderr
    begin, end = "import eomcheck\n", "print(finding)\n"
    in_terminal = done.stdout[done.stdout.index(begin) : done.stdout.rindex(end) + len(end)]
    failures = ElementTree.parse(junit).iter("failure")
    in_junit = next(one.text or "" for one in failures)
    text = markdown.read_text(encoding="utf-8")
    blocks = map(textwrap.dedent, re.findall(r"```python\n(.*?)```", text, re.DOTALL))
    fenced = next(block for block in blocks if begin in block)
    page = unescape(html.read_text(encoding="utf-8"))
    assert re.search(r"<th[^>]*>\s*(<[^>]*>)?\s*planar", page), "it has a column as ours have"
    in_page = page[page.index(begin) : page.index(end, page.index(begin)) + len(end)]
    for code in {in_terminal, in_junit, fenced, in_page}:  # of one text, one process
        assert "engines=[Planar]" in code
        assert "bias [planar] failed" in run(code)
