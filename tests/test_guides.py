"""What the guides show: the formulation that one adds is right, and a mistake in it is found."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import pytest

import eomcheck
from eomcheck.formulations import FORMULATIONS, Formulation
from eomcheck.scenes import Snake

ROOT = Path(__file__).parents[1]
SHIFTED = ROOT / "docs" / "guides" / "shifted.py"


def shifted(path: Path) -> Formulation:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.SHIFTED


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("system(M, F - a.T", "system(M, F + a.T"),
        ("a.T, F - a.T @ gamma", "a.T, F + a.T @ gamma"),
        ("mobility[:, r] + gamma", "mobility[:, r] - gamma"),
        ("shifted = M + np", "shifted = M - np"),
    ],
)
@pytest.mark.sampled(2)
def test_a_mistake_in_an_added_formulation_is_found_and_named(tmp_path, monkeypatch, old, new):
    source = SHIFTED.read_text(encoding="utf-8")
    assert source.count(old) == 1
    path = tmp_path / f"shifted_{abs(hash(new))}.py"
    path.write_text(source.replace(old, new), encoding="utf-8")
    monkeypatch.setitem(FORMULATIONS, "shifted", shifted(path))
    scene = Snake.coil(3)
    q, _ = scene.initial_state()
    found = eomcheck.check_state(scene, q, eomcheck.velocity(scene, q, [1.0, 0.5]))
    proved = eomcheck.prove(Snake, 3, formulations=["au", "shifted"], seed=0)
    for findings in (found, proved):
        failed = [finding for finding in findings if finding.verdict == "failed"]
        assert failed
        assert all("shifted" in str(finding) for finding in failed)


def test_the_citation_is_that_of_this_version():
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    (version,) = re.findall(r"^version: (.*)$", text, re.MULTILINE)
    assert version == eomcheck.__version__
